//! A plan on the terminal.

mod document;

use super::format::{count, length, number, render, table, wrap};
use misfit_campaign::Campaign;
use misfit_core::effects::{Parameter, Stage, find};
use misfit_core::fit::Fit;
use misfit_core::plan::{Aim, Figures, Outlook, Precision, Separation, Task, Way};
use std::fmt::Write;
use std::path::Path;

pub use document::{PlanDocument, document};

/// What a plan was made of.
pub struct Ground<'a> {
    /// Scenario or campaign, as the user wrote it.
    pub origin: &'a str,
    /// The task.
    pub task: &'a Task<'a>,
    /// The readings to be taken.
    pub future: &'a Campaign,
    /// The fit of a campaign.
    pub fit: Option<&'a Fit>,
    /// Where the commands were written.
    pub csv: Option<&'a Path>,
}

/// What came of it.
pub enum Result {
    /// Poses for precision.
    Precision {
        /// What they were chosen for.
        aim: Aim,
        /// Effects whose parameters count; none for all.
        of: Vec<String>,
        /// The poses and what they are worth.
        found: Box<Precision>,
    },
    /// Poses that tell two effects apart.
    Separation {
        /// The poses and what they are worth.
        found: Separation,
        /// Is λ that of the sizes fitted to the campaign, not of typical ones?
        fitted: bool,
    },
}

impl Result {
    /// Joint angles of the proposed poses, rad or m.
    pub fn poses(&self) -> &[Vec<f64>] {
        match self {
            Result::Precision { found, .. } => &found.poses,
            Result::Separation { found, .. } => &found.poses,
        }
    }
}

/// Effects with more free parameters than this are summed up in one row.
const LISTED: usize = 16;

/// The report.
pub fn text(ground: &Ground<'_>, result: &Result) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "{}", title(ground));
    let ids: Vec<&str> = ground
        .task
        .model
        .terms
        .iter()
        .map(|t| t.effect.id())
        .collect();
    let _ = writeln!(out, "{}", wrap(&format!("model    {}", ids.join(" + ")), 9));
    if let Some(fit) = ground.fit {
        let _ = writeln!(out, "{}", super::fit::noise_line(ground.future, fit));
    }
    let body = match result {
        Result::Precision { aim, of, found } => precision(ground, *aim, of, found),
        Result::Separation { found, fitted } => separation(ground, found, *fitted),
    };
    let _ = write!(out, "{body}\n{}", next(ground, result));
    out
}

/// What is to be measured, and how it was chosen.
fn title(ground: &Ground<'_>) -> String {
    let (task, setup) = (ground.task, &ground.task.model.setup);
    let protocol = &task.protocol;
    let mut parts = vec![count(task.poses, "pose")];
    if protocol.loads.iter().any(Option::is_some) {
        let masses: Vec<String> = protocol
            .loads
            .iter()
            .map(|load| load.map_or("none".to_owned(), |payload| number(payload.mass)))
            .collect();
        parts.push(format!("loads of {} kg", masses.join(", ")));
    }
    if protocol.directions.len() > 1 {
        parts.push(count(protocol.directions.len(), "direction"));
    }
    if protocol.repeats > 1 {
        parts.push(count(protocol.repeats, "repeat"));
    }
    if setup.targets.len() > 1 {
        let names = protocol.targets.iter();
        let names: Vec<&str> = names.map(|&t| setup.targets[t].name.as_str()).collect();
        let word = if names.len() == 1 {
            "target"
        } else {
            "targets"
        };
        parts.push(format!("{word} {}", names.join(", ")));
    }
    let beside = match task.measured.len() {
        0 => String::new(),
        n => format!(", beside the {} of the campaign", count(n, "reading")),
    };
    let name = ground.future.name.trim_end_matches(".toml");
    wrap(
        &format!(
            "{name} · robot {} · {} = {}{beside} · chosen from {} random postures",
            setup.robot.name,
            parts.join(" × "),
            count(ground.future.readings.len(), "reading"),
            task.candidates
        ),
        9,
    )
}

fn precision(ground: &Ground<'_>, aim: Aim, of: &[String], found: &Precision) -> String {
    let mut out = String::new();
    let whose = if of.is_empty() {
        String::new()
    } else {
        format!(" of {}", of.join(", "))
    };
    let chosen = match aim {
        Aim::D => format!("smallest volume of uncertainty{whose} (D)"),
        Aim::A if of.is_empty() => {
            "smallest mean square error of predicted positions (A)".to_owned()
        }
        Aim::A => format!("smallest mean variance{whose} (A)"),
    };
    let _ = writeln!(out, "{}\n", wrap(&format!("aim      {chosen}"), 9));
    let (a, b) = (&found.proposed, &found.random);
    let mut header = vec!["", "proposed", "random", "gain"];
    if found.measured.is_some() {
        header.push("measured alone");
    }
    let mut rows = table(&header, &[1, 2, 3, 4]);
    let mut row = |name: &str, value: fn(&Figures) -> String, gain: String| {
        let mut cells = vec![name.to_owned(), value(a), value(b), gain];
        cells.extend(found.measured.as_ref().map(value));
        rows.add_row(cells);
    };
    let times = |gain: f64| format!("{gain:.2}");
    row(
        "position error left by the parameters",
        |f| length(f.accuracy),
        times(b.accuracy / a.accuracy),
    );
    let (p, q) = (&a.observability, &b.observability);
    row(
        &format!("directions fixed (indices over {})", a.observability.over),
        |f| f.observability.directions.to_string(),
        String::new(),
    );
    row(
        "O1, geometric mean",
        |f| number(f.observability.o1),
        times(p.o1 / q.o1),
    );
    row(
        "O2, inverse condition",
        |f| number(f.observability.o2),
        times(p.o2 / q.o2),
    );
    row(
        "O3, least singular value",
        |f| number(f.observability.o3),
        times(p.o3 / q.o3),
    );
    row(
        "O4, noise amplification",
        |f| number(f.observability.o4),
        times(p.o4 / q.o4),
    );
    row(
        "O5, inverse sum of 1/s",
        |f| number(f.observability.o5),
        times(p.o5 / q.o5),
    );
    let _ = writeln!(out, "{}", render(&rows));
    let _ = writeln!(out, "\n{}", deviations(ground, found));
    let _ = writeln!(out, "\n{}", curve(found));
    let _ = writeln!(out, "{}", enough(ground, found));
    out
}

/// Standard deviations: parameter by parameter for physical effects, summed up for frames and large families.
fn deviations(ground: &Ground<'_>, found: &Precision) -> String {
    let task = ground.task;
    let mut rows = table(
        &[
            "one standard deviation",
            "proposed",
            "random",
            "gain",
            "of its value",
        ],
        &[1, 2, 3, 4],
    );
    for term in &task.model.terms {
        let id = term.effect.id();
        let all = term.parameters.iter().enumerate();
        let free: Vec<(usize, &Parameter)> = all
            .filter(|(_, parameter)| parameter.vary)
            .map(|(k, parameter)| (term.first + k, parameter))
            .collect();
        if free.is_empty() {
            continue;
        }
        if term.effect.stage() == Stage::Instrument || free.len() > LISTED {
            let fixed: Vec<(f64, f64)> = free
                .iter()
                .filter_map(|&(k, _)| found.proposed.std[k].zip(found.random.std[k]))
                .collect();
            let logs: f64 = fixed.iter().map(|(a, b)| (b / a).ln()).sum();
            let gain = (logs / fixed.len() as f64).exp();
            rows.add_row(vec![
                format!("{id} · {} of {}, mean", fixed.len(), free.len()),
                String::new(),
                String::new(),
                if fixed.is_empty() {
                    "—".to_owned()
                } else {
                    format!("{gain:.2}")
                },
                String::new(),
            ]);
            continue;
        }
        for (k, parameter) in free {
            let std = |of: &Figures| {
                of.std[k].map_or("not fixed".to_owned(), |std| {
                    format!("{} {}", number(std), parameter.unit)
                })
            };
            let both = found.proposed.std[k].zip(found.random.std[k]);
            let value = task.values[k].abs();
            let share = found.proposed.std[k].filter(|_| value > 0.0);
            rows.add_row(vec![
                format!("{id}.{}", parameter.name),
                std(&found.proposed),
                std(&found.random),
                both.map_or("—".to_owned(), |(a, b)| format!("{:.2}", b / a)),
                share.map_or(String::new(), |std| {
                    format!("{} %", number(100.0 * std / value))
                }),
            ]);
        }
    }
    render(&rows)
}

fn curve(found: &Precision) -> String {
    let mut rows = table(&["poses", "proposed", "random", ""], &[0, 1, 2]);
    for step in &found.curve {
        // a full bar is the noise of a reading, or more
        let share = step.accuracy_m / found.noise;
        rows.add_row(vec![
            step.poses.to_string(),
            length(step.accuracy_m),
            length(step.random_accuracy_m),
            "█".repeat((40.0 * share.clamp(0.0, 1.0)).round() as usize),
        ]);
    }
    render(&rows)
}

fn enough(ground: &Ground<'_>, found: &Precision) -> String {
    let noise = length(found.noise);
    let line = match found.enough {
        Some(0) => format!(
            "enough   no more poses are needed: predictions are within 5 % of the noise of a reading ({noise}) already"
        ),
        Some(poses) => {
            let about = if found.curve.last().is_some_and(|step| poses > step.poses) {
                "about "
            } else {
                ""
            };
            format!(
                "enough   {about}{}: from there on predictions are within 5 % of the noise of a reading ({noise}), \
                 and more gain nothing",
                count(poses, "pose")
            )
        }
        None => format!(
            "enough   no number of poses brings predictions within 5 % of the noise of a reading ({noise}) with these \
             {}: change loads or targets",
            count(ground.task.protocol.readings_a_pose(), "reading") + " a pose"
        ),
    };
    wrap(&line, 9)
}

fn separation(ground: &Ground<'_>, found: &Separation, fitted: bool) -> String {
    let [first, second] = &found.ways;
    let mut out = String::new();
    let sizes = if fitted {
        "the sizes fitted to the campaign"
    } else {
        "typical sizes"
    };
    let aim = format!(
        "aim      tell {} and {} apart; λ is the signal of one that the other cannot take up, for {sizes}",
        first.effect, second.effect
    );
    let _ = writeln!(out, "{}\n", wrap(&aim, 9));
    let measured = !ground.task.measured.is_empty();
    let mut header = vec![
        "if it is",
        "and not",
        "λ random",
        "λ proposed",
        "gain",
        "taken up",
    ];
    if measured {
        header.insert(2, "λ so far");
    }
    let mut rows = table(&header, &[2, 3, 4, 5, 6]);
    for way in &found.ways {
        let mut cells = vec![
            way.effect.to_owned(),
            way.other.to_owned(),
            lambda(way.random),
            lambda(way.proposed),
            if way.outlook() == Outlook::Never || way.random <= 0.0 {
                "—".to_owned()
            } else {
                format!("{:.1}", way.proposed / way.random)
            },
            percent(way.taken_up()),
        ];
        if measured {
            cells.insert(2, lambda(way.measured));
        }
        rows.add_row(cells);
    }
    let _ = writeln!(out, "{}\n", render(&rows));
    for way in &found.ways {
        let _ = writeln!(out, "{}", wrap(&format!("  → {}", verdict(ground, way)), 4));
    }
    out
}

fn lambda(value: f64) -> String {
    if value < 0.01 {
        "0.00".to_owned()
    } else {
        number(value)
    }
}

/// A share that is never rounded to everything or nothing.
fn percent(share: f64) -> String {
    if (0.9995..1.0).contains(&share) {
        "> 99.9 %".to_owned()
    } else {
        format!("{} %", number(100.0 * share))
    }
}

fn verdict(ground: &Ground<'_>, way: &Way) -> String {
    let Way { effect, other, .. } = way;
    match way.outlook() {
        Outlook::Decisive => format!("{effect}: these poses will tell it from {other}"),
        Outlook::Weak => {
            let times = (misfit_core::plan::DECISIVE / way.proposed).ceil();
            let how = if times <= 20.0 {
                format!("{times:.0} times as many readings, or heavier loads, would (λ of 60)")
            } else {
                "other loads or limits may".to_owned()
            };
            format!("{effect}: these poses hardly tell it from {other}; {how}")
        }
        Outlook::Unseen => {
            let lacking = find(effect).and_then(|entry| {
                let needs = entry.needs.iter();
                needs.copied().find(|need| !need.is_met(ground.future))
            });
            match lacking {
                Some(need) => format!(
                    "{effect}: such readings do not show it; it {}",
                    need.sentence()
                ),
                None => format!(
                    "{effect}: such readings hardly show it, with {other} in the model or without (λ {})",
                    lambda(way.alone)
                ),
            }
        }
        Outlook::Never => format!(
            "{effect}: no poses can tell it from {other}, which takes up all of it; another kind of measurement must \
             (misfit effects show {effect})"
        ),
    }
}

/// What to type next.
fn next(ground: &Ground<'_>, result: &Result) -> String {
    let line = match (ground.csv, result) {
        (Some(path), _) => format!(
            "next     {} holds the commands: measure them, add x_m y_m z_m (qw qx qy qz) to each row, and fit",
            path.display()
        ),
        (None, Result::Separation { found, .. })
            if found.ways.iter().all(|w| w.outlook() == Outlook::Never) =>
        {
            format!("next     misfit effects show {}", found.ways[0].effect)
        }
        (None, _) => format!(
            "next     misfit plan {} … --csv poses.csv     (the same again: it writes the commands of these poses)",
            ground.origin
        ),
    };
    wrap(&line, 9) + "\n"
}
