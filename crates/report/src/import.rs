//! What became of a bag, on the terminal and as JSON; the topics of one, with a spec to start from.

use super::format::{angle, count, length, number, render, significant, table, wrap};
use misfit_campaign::bag::clock::{ClockReport, Status};
use misfit_campaign::bag::stream::StreamReport;
use misfit_campaign::bag::{
    Dwells, Import, JOINT_TYPES, Scatter, Spec, TRACKER_TYPES, WRENCH_TYPES, frame_pairs,
};
use misfit_campaign::recording::{Bag, Samples, Topic};
use serde::Serialize;
use std::fmt::Write;

/// `misfit.import/1`.
#[derive(Debug, Serialize)]
pub struct ImportDocument<'a> {
    schema: &'static str,
    bag: &'a str,
    written: Option<String>,
    length_s: f64,
    streams: &'a [StreamReport],
    clocks: &'a [ClockReport],
    dwells: &'a Dwells,
    scatter: &'a [Scatter],
    noise_written: bool,
    warnings: &'a [String],
}

/// The document; `written` is the campaign's file.
pub fn document<'a>(
    bag: &'a Bag,
    import: &'a Import,
    written: Option<String>,
) -> ImportDocument<'a> {
    ImportDocument {
        schema: "misfit.import/1",
        bag: &bag.name,
        written,
        length_s: import.length_s,
        streams: &import.streams,
        clocks: &import.clocks,
        dwells: &import.dwells,
        scatter: &import.scatter,
        noise_written: noise_is_written(import),
        warnings: &import.warnings,
    }
}

/// `misfit.topics/1`.
#[derive(Debug, Serialize)]
pub struct TopicsDocument<'a> {
    schema: &'static str,
    bag: &'a str,
    topics: &'a [Topic],
    spec: String,
}

/// The document.
pub fn topics_document(bag: &Bag) -> TopicsDocument<'_> {
    TopicsDocument {
        schema: "misfit.topics/1",
        bag: &bag.name,
        topics: &bag.topics,
        spec: template(bag),
    }
}

/// The report.
pub fn text(bag: &Bag, spec: &Spec, import: &Import) -> String {
    let dwells = &import.dwells;
    let mut out = wrap(
        &format!(
            "{} · robot {} · {} s · {} at {}",
            bag.name,
            spec.robot.name,
            number(import.length_s),
            count(dwells.readings, "reading"),
            count(dwells.postures, "posture"),
        ),
        9,
    );
    let _ = write!(out, "\n\n{}\n", streams(&import.streams));
    for line in import.streams.iter().flat_map(thrown_away) {
        let _ = writeln!(out, "{}", wrap(&line, 4));
    }
    out.push('\n');
    for clock in &import.clocks {
        let _ = writeln!(out, "{}", wrap(&clock_line(clock), 9));
    }
    let _ = write!(out, "\n{}", stops(dwells));
    if dwells.readings > 0 {
        let _ = write!(out, "\n{}\n", scatter(&import.scatter));
        let _ = writeln!(out, "{}", wrap(&noise_line(import), 9));
    }
    for warning in &import.warnings {
        let _ = writeln!(out, "{}", wrap(&format!("note     {warning}"), 9));
    }
    out
}

fn streams(streams: &[StreamReport]) -> String {
    let mut rows = table(
        &[
            "topic",
            "used as",
            "messages",
            "used",
            "per s",
            "longest gap",
        ],
        &[2, 3, 4, 5],
    );
    for stream in streams {
        rows.add_row(vec![
            stream.topic.clone(),
            stream.role.clone(),
            stream.messages.to_string(),
            stream.used.to_string(),
            number(stream.rate_hz),
            format!("{} s", number(stream.longest_gap_s)),
        ]);
    }
    render(&rows)
}

fn thrown_away(stream: &StreamReport) -> Vec<String> {
    let mut parts = Vec::new();
    let mut say = |n: usize, what: &str| {
        if n > 0 {
            parts.push(format!("{n} {what}"));
        }
    };
    say(stream.not_finite, "not finite (sight lost), left out");
    say(stream.duplicates, "with the stamp of another, left out");
    for (why, n) in &stream.others {
        say(*n, &format!("{why}, left out"));
    }
    let back = number(stream.farthest_back_s);
    say(
        stream.backwards,
        &format!("with a stamp before an earlier one (by up to {back} s), put in order"),
    );
    if stream.log_time {
        parts.push("stamps are zero: log times are used".to_owned());
    }
    match parts.is_empty() {
        true => Vec::new(),
        false => vec![format!("  {} · {}", stream.topic, parts.join(" · "))],
    }
}

fn clock_line(clock: &ClockReport) -> String {
    let correlations = match (clock.correlation, clock.next_correlation) {
        (Some(best), Some(next)) => format!(
            " (correlation {}, any other offset {})",
            significant(best, 4),
            number(next)
        ),
        _ => String::new(),
    };
    let mut line = match clock.status {
        Status::Estimated => {
            let sure = clock
                .std_s
                .map_or_else(String::new, |std| format!(" ± {} s", number(std)));
            format!(
                "clock    {}: stamps {:+.4} s{sure} against those of the joints{correlations}",
                clock.role, clock.offset_s
            )
        }
        Status::Given => format!(
            "clock    {}: stamps {:+.4} s against those of the joints, as the spec says",
            clock.role, clock.offset_s
        ),
        Status::Unknown => format!(
            "clock    {}: OFFSET UNKNOWN, {}{correlations}; taken as the log times say, {:+.4} s",
            clock.role,
            clock.why.as_deref().unwrap_or("no motion"),
            clock.offset_s
        ),
    };
    if clock.status == Status::Estimated {
        line.push_str(", applied");
        if (clock.offset_s - clock.by_log_times_s).abs() > 0.1 {
            let _ = write!(line, "; the log times say {:+.4} s", clock.by_log_times_s);
        }
        if let (Some(drift), Some(std)) = (clock.drift, clock.drift_std) {
            let _ = write!(
                line,
                "; drift {} ± {} µs/s, {}",
                number(drift * 1e6),
                number(std * 1e6),
                if clock.drift_applied {
                    "applied"
                } else {
                    "not significant"
                }
            );
        }
    }
    line
}

fn stops(dwells: &Dwells) -> String {
    let mut line = format!(
        "stops    {} of the joints, {} read at {}",
        dwells.stops,
        dwells.read,
        count(dwells.postures, "posture"),
    );
    if let Some((shortest, longest)) = dwells.averaged_s {
        let _ = write!(
            line,
            "; means over {} to {} s, {} samples of the trackers, {} left out",
            number(shortest),
            number(longest),
            dwells.samples,
            count(dwells.outliers, "outlier"),
        );
    }
    let mut out = wrap(&line, 9) + "\n";
    for drop in &dwells.dropped {
        let of = drop.target.as_ref();
        let of = of.map_or_else(String::new, |target| format!("{target}: "));
        let line = format!(
            "  not read: {of}{}, {} (first at {} s)",
            drop.why,
            count(drop.stops, "stop"),
            number(drop.first_s)
        );
        let _ = writeln!(out, "{}", wrap(&line, 4));
    }
    out
}

fn scatter(all: &[Scatter]) -> String {
    let mut rows = table(
        &[
            "scatter (1 σ)",
            "joints",
            "position",
            "orientation",
            "force",
            "torque",
        ],
        &[1, 2, 3, 4, 5],
    );
    let dash = || "—".to_owned();
    for scatter in all {
        let kinds = [
            (
                format!("{}, a sample", scatter.target),
                Some(scatter.sample),
            ),
            (
                format!("{}, σ/√n of a mean", scatter.target),
                Some(scatter.independent),
            ),
            (
                format!("{}, between repeats", scatter.target),
                scatter.repeats,
            ),
        ];
        for (name, sizes) in kinds {
            let Some(sizes) = sizes else { continue };
            rows.add_row(vec![
                name,
                angle(sizes.joint_rad),
                length(sizes.position_m),
                sizes.orientation_rad.map_or_else(dash, angle),
                sizes
                    .force_N
                    .map_or_else(dash, |f| format!("{} N", number(f))),
                sizes
                    .torque_Nm
                    .map_or_else(dash, |t| format!("{} N·m", number(t))),
            ]);
        }
    }
    render(&rows)
}

fn noise_is_written(import: &Import) -> bool {
    let campaign = import.campaign.as_ref();
    campaign.is_some_and(|campaign| campaign.noise.is_some())
}

fn noise_line(import: &Import) -> String {
    let groups: usize = import.scatter.iter().map(|s| s.groups).sum();
    if noise_is_written(import) {
        format!(
            "noise    between {} of repeats, written as [noise]: samples of one stop are no independent ones, so σ/√n \
             is what a mean would be worth at best",
            count(groups, "group")
        )
    } else {
        "noise    not written: samples of one stop are no independent ones, σ/√n is what a mean would be worth at best, \
         and there are too few repeats (stops at one posture, from one side) to tell; a fit takes what it leaves for noise"
            .to_owned()
    }
}

/// Topics of a bag, and a spec that fits it.
pub fn topics_text(bag: &Bag) -> String {
    let total: usize = bag.topics.iter().map(|t| t.messages).sum();
    let length = bag.span.map_or(0.0, |(a, b)| (b - a) as f64 * 1e-9);
    let mut out = wrap(
        &format!(
            "{} · {} · {} s · {}",
            bag.name,
            count(bag.files.len(), "file"),
            number(length),
            count(total, "message")
        ),
        9,
    );
    let mut rows = table(&["topic", "type", "messages", "may be"], &[2]);
    for topic in &bag.topics {
        rows.add_row(vec![
            topic.topic.clone(),
            topic.kind.clone(),
            topic.messages.to_string(),
            may_be(topic).to_owned(),
        ]);
    }
    let _ = write!(out, "\n\n{}\n", render(&rows));
    for (topic, samples) in &bag.samples {
        match samples {
            Samples::Joints(samples) => {
                if let Some((_, names, _)) = samples.first() {
                    let line = format!("  {topic} · joints {}", names.join(", "));
                    let _ = writeln!(out, "{}", wrap(&line, 4));
                }
            }
            Samples::Transforms(pairs) => {
                let pairs: Vec<String> = frame_pairs(pairs)
                    .into_iter()
                    .take(12)
                    .map(|(a, b, n)| format!("{a} → {b} ({n})"))
                    .collect();
                let line = format!("  {topic} · frames {}", pairs.join(", "));
                let _ = writeln!(out, "{}", wrap(&line, 4));
            }
            _ => {}
        }
    }
    let _ = write!(
        out,
        "\na spec to start from; robot and links are to be filled in\n\n{}",
        template(bag)
    );
    out
}

fn may_be(topic: &Topic) -> &'static str {
    let kind = topic.kind.as_str();
    if JOINT_TYPES.contains(&kind) {
        "joints"
    } else if TRACKER_TYPES.contains(&kind) {
        "tracker"
    } else if WRENCH_TYPES.contains(&kind) {
        "wrench"
    } else {
        ""
    }
}

/// A spec that fits the bag, by types alone.
fn template(bag: &Bag) -> String {
    let of = |role: &str| -> Vec<&Topic> {
        let mut all: Vec<&Topic> = bag.topics.iter().filter(|t| may_be(t) == role).collect();
        // transforms are last: most are not of a tracker
        all.sort_by_key(|t| (t.kind == TRACKER_TYPES[3], std::cmp::Reverse(t.messages)));
        all
    };
    let mut text = String::from(
        "robot   = \"robot.urdf\"         # URDF or DH table, relative to this file\n\
         # base  = \"base_link\"          # if it is not the root\n\
         gravity = [0, 0, -9.81]        # in the base frame, m/s²\n",
    );
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let _ = match of("joints").first() {
        Some(topic) => writeln!(text, "joints  = {}", quoted(&topic.topic)),
        None => writeln!(
            text,
            "# joints = \"/joint_states\"   # the bag has no joint states"
        ),
    };
    let _ = write!(
        text,
        "\n[[target]]\nname    = \"flange\"\nlink    = \"tool0\"              # link of the robot that the target sits on\n"
    );
    match of("tracker").first() {
        None => text.push_str("# tracker = \"/tracker/pose\"  # the bag has no poses\n"),
        Some(topic) => {
            let _ = writeln!(text, "tracker = {}", quoted(&topic.topic));
            if let Some(Samples::Transforms(pairs)) = bag.samples.get(&topic.topic)
                && let Some((parent, child, _)) = frame_pairs(pairs).first()
            {
                let _ = writeln!(
                    text,
                    "frames  = [{}, {}]  # parent and child",
                    quoted(parent),
                    quoted(child)
                );
            }
        }
    }
    if let Some(topic) = of("wrench").first() {
        let _ = writeln!(
            text,
            "wrench  = {}             # of the load on the arm; wrench_sign = -1 for the other way",
            quoted(&topic.topic)
        );
    }
    text.push_str(
        "\n[dwell]\nmin_s    = 0.5                 # shortest stop, both ends cut\n\
         settle_s = 0.3                 # cut off at both ends\n",
    );
    text
}
