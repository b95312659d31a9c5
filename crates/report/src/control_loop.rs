//! Compensation in the loop on the terminal, as JSON, and tick by tick as CSV.

use super::format::{angle, count, length, number, render, table, wrap};
use super::format::{model_name, percent};
use misfit_arm::robot::JointKind;
use misfit_campaign::Wrench;
use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::control_loop::{ControlLoop, Errors, Filtered, Looped};
use nalgebra::Vector6;
use serde::Serialize;
use std::fmt::Write;
use std::io;

/// A model's corrections in the loop, as data; tick by tick they stand in the CSV.
#[derive(Debug, Serialize)]
pub struct LoopDocument {
    model: String,
    rate_hz: f64,
    duration_s: f64,
    poses: usize,
    left_out: usize,
    unseen: Option<String>,
    nominal: Errors,
    tool_alone: Errors,
    at_once: Errors,
    filters: Vec<FilterDocument>,
}

#[derive(Debug, Serialize)]
struct FilterDocument {
    #[serde(flatten)]
    found: Filtered,
    reduction: f64,
}

/// The document of one model's loops.
pub fn document(wanted: &ControlLoop, looped: &Looped) -> LoopDocument {
    let filters = looped.filters.iter();
    LoopDocument {
        model: looped.model.clone(),
        rate_hz: wanted.rate_hz,
        duration_s: wanted.duration_s,
        poses: looped.poses,
        left_out: looped.left_out,
        unseen: looped.unseen.as_ref().map(|(name, _)| name.clone()),
        nominal: looped.nominal,
        tool_alone: looped.tool_alone,
        at_once: looped.at_once,
        filters: filters
            .map(|found| FilterDocument {
                found: found.clone(),
                reduction: looped.reduction(found),
            })
            .collect(),
    }
}

/// Poses held in MuJoCo, model by model and filter by filter.
pub fn text(scenario: &Scenario, wanted: &ControlLoop, all: &[Looped]) -> String {
    let target = &scenario.setup.targets[wanted.target(&scenario.setup)].name;
    let mut out = String::new();
    for looped in all {
        let head = format!(
            "loop     {target} holds {} for {} s · {} ticks a second · a tool of {} kg and {} · corrected by the {} · \
             MuJoCo at rest in every tick: no inertia",
            count(looped.poses, "pose"),
            number(wanted.duration_s),
            number(wanted.rate_hz),
            number(wanted.payload.mass_kg),
            count(wanted.pulls.len(), "pull"),
            model_name(&looped.model),
        );
        let _ = writeln!(out, "{}\n", wrap(&head, 9));
        if looped.poses > 0 {
            let _ = writeln!(out, "{}\n", without_sensor(looped));
            let _ = writeln!(out, "{}\n", by_filter(looped));
            out += &verdict(looped);
        }
        if let Some((name, moved)) = &looped.unseen {
            let line = format!(
                "unseen   {name}: no reading of the campaign shows it, but the pull bears on it; a typical size of it moves \
                 a pose held by {}",
                length(*moved)
            );
            let _ = writeln!(out, "{}", wrap(&line, 9));
        }
        if looped.left_out > 0 {
            let line = format!(
                "far      {} left out: no command reaches them under the tool",
                count(looped.left_out, "pose")
            );
            let _ = writeln!(out, "{}", wrap(&line, 9));
        }
        for filtered in looped.filters.iter().filter(|f| f.unreached > 0) {
            let line = format!(
                "far      {}: {} without a command that reaches the pose; the one before stood",
                filtered.filter,
                count(filtered.unreached, "tick")
            );
            let _ = writeln!(out, "{}", wrap(&line, 9));
        }
        out += "\n";
    }
    out
}

fn without_sensor(looped: &Looped) -> String {
    let header = [
        "load taken for",
        "error, rms",
        "at most",
        "turned, rms",
        "at most",
    ];
    let mut rows = table(&header, &[1, 2, 3, 4]);
    let ways = [
        ("none: the nominal robot's commands", &looped.nominal),
        (
            "the tool's weight alone, corrected once",
            &looped.tool_alone,
        ),
        ("the true one, at once: the model's error", &looped.at_once),
    ];
    for (name, errors) in ways {
        rows.add_row(vec![
            name.to_owned(),
            length(errors.rms.position_m),
            length(errors.most.position_m),
            angle(errors.rms.orientation_rad),
            angle(errors.most.orientation_rad),
        ]);
    }
    render(&rows)
}

fn by_filter(looped: &Looped) -> String {
    let header = [
        "filter",
        "delay",
        "noise ×",
        "error, rms",
        "at most",
        "from delay",
        "from noise",
        "falls by",
    ];
    let mut rows = table(&header, &[1, 2, 3, 4, 5, 6, 7]);
    let mut above = "";
    for filtered in &looped.filters {
        // one beneath the same filter without a look ahead needs no name of its own
        let repeated = filtered.filter.strip_prefix(above);
        let name = match repeated {
            Some(", predicted") if !above.is_empty() => "  … predicted".to_owned(),
            _ => filtered.filter.clone(),
        };
        above = &filtered.filter;
        rows.add_row(vec![
            name,
            milliseconds(filtered.delay_s),
            format!("{:.3}", filtered.noise_gain),
            length(filtered.errors.rms.position_m),
            length(filtered.errors.most.position_m),
            length(filtered.lag.position_m),
            length(filtered.noise.position_m),
            percent(looped.reduction(filtered)),
        ]);
    }
    render(&rows)
}

/// What looking ahead does to each filter, and which loop is the best.
fn verdict(looped: &Looped) -> String {
    let mut out = String::new();
    for ahead in looped.filters.iter().filter(|f| f.foreseen_s > 0.0) {
        let plain = looped
            .filters
            .iter()
            .find(|f| ahead.filter == format!("{}, predicted", f.filter));
        let Some(plain) = plain else { continue };
        let (before, after) = (plain.errors.rms.position_m, ahead.errors.rms.position_m);
        let what = match after < before {
            true => "better",
            false => "WORSE: it brings more noise than it takes delay",
        };
        let line = format!(
            "ahead    {}: {} → {}, {what}",
            plain.filter,
            length(before),
            length(after),
        );
        let _ = writeln!(out, "{}", wrap(&line, 9));
    }
    let best = looped
        .filters
        .iter()
        .min_by(|a, b| f64::total_cmp(&a.errors.rms.position_m, &b.errors.rms.position_m));
    if let Some(best) = best {
        let parts = [
            ("the model", looped.at_once.rms.position_m),
            ("delay", best.lag.position_m),
            ("noise", best.noise.position_m),
        ];
        let most = parts.iter().max_by(|a, b| f64::total_cmp(&a.1, &b.1));
        let most = most.map_or("", |(name, _)| name);
        let line = format!(
            "best     {}: {} are left; alone the model leaves {}, delay {}, noise {}: mostly {most}",
            best.filter,
            length(best.errors.rms.position_m),
            length(parts[0].1),
            length(parts[1].1),
            length(parts[2].1),
        );
        let _ = writeln!(out, "{}", wrap(&line, 9));
    }
    out
}

fn milliseconds(seconds: f64) -> String {
    format!("{} ms", number(seconds * 1e3))
}

/// Every tick of every run as a table: SI, ten digits, columns with their units; `before` is what the command corrected for the tool
/// alone would miss the pose by, `after` what the command in force does (tracker's frame).
///
/// # Errors
/// What the writer says.
pub fn write_csv(
    scenario: &Scenario,
    wanted: &ControlLoop,
    all: &[Looped],
    out: impl io::Write,
) -> io::Result<()> {
    const WRENCH: [&str; 6] = ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"];
    const TWIST: [&str; 6] = ["x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad"];
    let setup = &scenario.setup;
    let moving = setup.robot.chain(setup.target_body(wanted.target(setup)));
    let mut header: Vec<String> = ["model", "filter", "pose", "time_s"]
        .map(str::to_owned)
        .into();
    for what in ["measured", "filtered", "foreseen"] {
        header.extend(WRENCH.map(|name| format!("{what}_{name}")));
    }
    header.extend(moving.iter().map(|&joint| {
        let joint = &setup.robot.joints[joint];
        let unit = match joint.kind {
            JointKind::Prismatic => "m",
            _ => "rad",
        };
        format!("command_{}_{unit}", joint.name)
    }));
    for what in ["before", "after"] {
        header.extend(TWIST.map(|name| format!("{what}_{name}")));
    }
    let mut writer = csv::Writer::from_writer(out);
    writer.write_record(&header)?;
    let wrench = |wrench: &Wrench| -> Vec<f64> {
        let parts = wrench.force.iter().chain(&wrench.torque);
        parts.copied().collect()
    };
    let twist = |twist: &Vector6<f64>| -> Vec<f64> { twist.iter().copied().collect() };
    for looped in all {
        for trace in &looped.traces {
            for moment in &trace.moments {
                let numbers = [
                    wrench(&moment.measured),
                    wrench(&moment.filtered),
                    wrench(&moment.foreseen),
                    moving.iter().map(|&joint| moment.command[joint]).collect(),
                    twist(&moment.before),
                    twist(&moment.after),
                ];
                let mut row = vec![
                    looped.model.clone(),
                    looped.filters[trace.filter].filter.clone(),
                    format!("{}", trace.pose + 1),
                    format!("{}", moment.time),
                ];
                row.extend(numbers.iter().flatten().map(|x| format!("{x:.9e}")));
                writer.write_record(&row)?;
            }
        }
    }
    writer.flush()
}
