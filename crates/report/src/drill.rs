//! Holes drilled by two arms: on the terminal, as JSON, tick by tick as CSV, and as the paper's six curves for each arm.

use super::format::{angle, length, number, render, say, table, wrap};
use super::format::{model_name, percent};
use crate::plot::{Content, Figure, Panel, Series};
use misfit_campaign::Wrench;
use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::drill::cutting;
use misfit_cell::scenario::drill::summary::{Summary, summary, tare, without};
use misfit_cell::scenario::drill::{Bored, Drilling, Mode, Sample};
use serde::Serialize;
use std::fmt::Write;
use std::io;

/// The holes as data; tick by tick they stand in the CSV.
#[derive(Debug, Serialize)]
pub struct DrillDocument {
    holes: Vec<Summary>,
    findings: Vec<Finding>,
}

/// What the paper found of its drilling, and whether it holds here.
#[derive(Debug, Clone, Serialize)]
pub struct Finding {
    /// The paper's words, shortened.
    pub finding: &'static str,
    /// Does it hold? None if the holes do not tell.
    pub holds: Option<bool>,
    /// By which figures.
    pub figures: String,
}

/// The document.
pub fn document(wanted: &Drilling, holes: &[Bored]) -> DrillDocument {
    let summaries: Vec<Summary> = holes.iter().map(|hole| summary(wanted, hole)).collect();
    DrillDocument {
        findings: findings(wanted, &summaries),
        holes: summaries,
    }
}

/// The two sensors' thrusts count as nearly equal up to this share.
const NEARLY: f64 = 0.05;

/// What the paper says of its Figures 10 and 11, against the holes drilled here; comparisons need a hole without and one
/// with compensation, and all of them a steady cut.
pub fn findings(wanted: &Drilling, holes: &[Summary]) -> Vec<Finding> {
    let mut all = Vec::new();
    let (back, cone) = (cutting::thickness(&wanted.layers()), wanted.drill().cone());
    let each = |of: &dyn Fn(&Summary) -> String| {
        let each: Vec<String> = holes
            .iter()
            .map(|hole| format!("{} {}", hole.mode.word(), of(hole)))
            .collect();
        each.join(", ")
    };
    let every = |of: &dyn Fn(&Summary) -> Option<bool>| {
        holes
            .iter()
            .try_fold(true, |all, hole| Some(all && of(hole)?))
    };
    all.push(Finding {
        finding: "thrust is largest where the drill comes through",
        holds: every(&|hole| {
            // within the height of its point
            hole.through_s?;
            Some((hole.thrust_peak_depth_m - back).abs() <= cone)
        }),
        figures: each(&|hole| {
            format!(
                "{} mm deep of {}",
                number(hole.thrust_peak_depth_m * 1e3),
                number(back * 1e3)
            )
        }),
    });
    all.push(Finding {
        finding: "the two sensors' thrusts are nearly equal",
        holds: every(&|hole| {
            let gap = (hole.board_fz_N.abs() / hole.tool_fz_N.abs() - 1.0).abs();
            gap.is_finite().then_some(gap <= NEARLY)
        }),
        figures: each(&|hole| {
            format!(
                "{} and {} N",
                number(hole.board_fz_N),
                number(hole.tool_fz_N)
            )
        }),
    });
    let without = holes.iter().find(|hole| hole.mode == Mode::Nominal);
    let with = holes.iter().rfind(|hole| hole.mode != Mode::Nominal);
    if let (Some(without), Some(with)) = (without, with) {
        let pairs = [
            (
                "lateral forces are smaller with compensation",
                (without.lateral_peak_N, with.lateral_peak_N),
                (without.lateral_steady_N, with.lateral_steady_N),
            ),
            (
                "thrust is smaller with compensation",
                (without.thrust_peak_N, with.thrust_peak_N),
                (without.thrust_steady_N, with.thrust_steady_N),
            ),
        ];
        for (finding, most, steady) in pairs {
            let known = steady.0.is_finite() && steady.1.is_finite();
            let fall = |(a, b): (f64, f64)| format!("{} → {} N", number(a), number(b));
            all.push(Finding {
                finding,
                holds: known.then_some(most.1 < most.0 && steady.1 < steady.0),
                figures: format!("largest {}, steady {}", fall(most), fall(steady)),
            });
        }
    }
    all
}

/// What a user reads.
pub fn text(scenario: &Scenario, wanted: &Drilling, holes: &[Bored]) -> String {
    let summaries: Vec<Summary> = holes.iter().map(|hole| summary(wanted, hole)).collect();
    let thickness: f64 = wanted.layer.iter().map(|layer| layer.thickness_mm).sum();
    let head = format!(
        "drill    Ø {} mm through {} mm in {} layers · {} 1/min · {} µm a revolution = {} mm/s · corrected by the {} · \
         MuJoCo at rest in every of {} ticks a second: no inertia",
        wanted.diameter_mm,
        number(thickness),
        wanted.layer.len(),
        wanted.speed_rpm,
        wanted.feed_um,
        number(wanted.feed_rate() * 1e3),
        model_name(&wanted.model),
        wanted.rate_hz,
    );
    let mut out = wrap(&head, 9) + "\n\n" + &summary_table(&summaries);
    out += "\n\nthe paper's findings\n";
    for finding in findings(wanted, &summaries) {
        let holds = match finding.holds {
            Some(true) => "holds",
            Some(false) => "does not hold",
            None => "not known",
        };
        let line = format!("  {}: {holds} · {}", finding.finding, finding.figures);
        let _ = writeln!(out, "{}", wrap(&line, 4));
    }
    for (hole, bored) in summaries.iter().zip(holes) {
        overloads(&mut out, (scenario, wanted), hole, bored);
    }
    for hole in summaries.iter().filter(|h| h.unreached > 0) {
        let line = format!(
            "far      {}: {} ticks without a command that reaches the pose; the one before stood",
            hole.mode.word(),
            hole.unreached
        );
        say(&mut out, &line);
    }
    out.push('\n');
    out
}

/// The holes side by side, a row per figure.
fn summary_table(summaries: &[Summary]) -> String {
    let mut header = vec!["commands"];
    header.extend(summaries.iter().map(|hole| hole.mode.word()));
    let right: Vec<usize> = (1..header.len()).collect();
    let mut rows = table(&header, &right);
    let mut row = |name: &str, of: &dyn Fn(&Summary) -> String| {
        let mut cells = vec![name.to_owned()];
        cells.extend(summaries.iter().map(of));
        rows.add_row(cells);
    };
    row("hole off its place", &|h| {
        h.hole_error_m.map_or("not drilled".to_owned(), length)
    });
    row("axis off the normal, steady", &|h| angle(h.tilt_rad));
    row("moved to touch", &|h| length(h.touch_m));
    row("thrust, largest, N", &|h| number(h.thrust_peak_N));
    row("  at, s", &|h| format!("{:.2}", h.thrust_peak_s));
    row("  tip through at, s", &|h| {
        h.through_s
            .map_or("never".to_owned(), |t| format!("{t:.2}"))
    });
    row("thrust, steady, N", &|h| number(h.thrust_steady_N));
    row("torque, largest, N·mm", &|h| {
        number(h.torque_peak_Nm * 1e3)
    });
    row("lateral force, largest, N", &|h| number(h.lateral_peak_N));
    row("lateral force, steady, N", &|h| number(h.lateral_steady_N));
    row("board's sensor, Fz steady, N", &|h| number(h.board_fz_N));
    row("drill's sensor, Fz steady, N", &|h| number(h.tool_fz_N));
    row("both sensors, sum over peak", &|h| percent(h.balance));
    row("  of moments", &|h| percent(h.moment_balance));
    render(&rows)
}

/// What a drill or a joint does not bear.
fn overloads(
    out: &mut String,
    (scenario, wanted): (&Scenario, &Drilling),
    hole: &Summary,
    bored: &Bored,
) {
    let word = hole.mode.word();
    if hole.buckling > 1.0 {
        say(
            out,
            &format!(
                "breaks   {word}: the drill buckles at {} N, it bears {} N: the hole is none",
                number(wanted.drill().buckling_load()),
                number(hole.thrust_peak_N)
            ),
        );
    }
    if hole.bending > 1.0 {
        say(
            out,
            &format!(
                "breaks   {word}: bent to {} times what carbide bears: the hole is none",
                number(hole.bending)
            ),
        );
    }
    for &(joint, torque, rating) in &bored.overloaded {
        say(
            out,
            &format!(
                "load     {word}: {} bears {} N·m, rated {}",
                scenario.setup.robot.joints[joint].name,
                number(torque),
                number(rating)
            ),
        );
    }
}

/// The two sensors' readings without the weights, board's first.
fn processes(wanted: &Drilling, hole: &Bored) -> Vec<[Wrench; 2]> {
    let weights = tare(wanted, hole);
    let both = |sample: &Sample| {
        [
            without(&sample.board, &weights[0]),
            without(&sample.tool, &weights[1]),
        ]
    };
    hole.samples.iter().map(both).collect()
}

/// Every tick of every hole as a table; the sensors without the weights, each in its link's frame.
///
/// # Errors
/// What the writer says.
pub fn write_csv(wanted: &Drilling, holes: &[Bored], out: impl io::Write) -> io::Result<()> {
    let mut table = csv::Writer::from_writer(out);
    let mut header: Vec<String> = [
        "commands",
        "time_s",
        "depth_mm",
        "thrust_N",
        "torque_Nm",
        "lateral_x_N",
        "lateral_y_N",
        "tilt_mrad",
    ]
    .map(str::to_owned)
    .to_vec();
    for sensor in ["board", "drill"] {
        for quantity in ["fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm"] {
            header.push(format!("{sensor}_{quantity}"));
        }
    }
    table.write_record(&header)?;
    for hole in holes {
        for (sample, both) in hole.samples.iter().zip(processes(wanted, hole)) {
            let mut cells = vec![
                hole.mode.word().to_owned(),
                sample.time.to_string(),
                (sample.depth * 1e3).to_string(),
                sample.need.thrust.to_string(),
                sample.need.torque.to_string(),
                sample.lateral.x.to_string(),
                sample.lateral.y.to_string(),
                (sample.tilt * 1e3).to_string(),
            ];
            for wrench in both {
                let numbers = wrench.force.iter().chain(&wrench.torque);
                cells.extend(numbers.map(f64::to_string));
            }
            table.write_record(&cells)?;
        }
    }
    table.flush()
}

/// A point of a curve is the mean of so long, s: single readings would hide one hole behind the noise of another.
const MEAN_OF: f64 = 0.05;

/// The paper's Figures 10 (the board's sensor) and 11 (the drill's): six curves over time, every hole its own line.
pub fn figures(
    scenario: &Scenario,
    wanted: &Drilling,
    holes: &[Bored],
) -> [(&'static str, Figure); 2] {
    let ticks = ((MEAN_OF * wanted.rate_hz).round() as usize).max(1);
    let processes: Vec<Vec<[Wrench; 2]>> = holes
        .iter()
        .map(|hole| self::processes(wanted, hole))
        .collect();
    let curve = |which: usize, axis: usize, torque: bool| -> Vec<Series> {
        let lines = holes.iter().zip(&processes).enumerate();
        lines
            .map(|(index, (hole, both))| {
                let value = |wrench: &Wrench| match torque {
                    true => wrench.torque[axis] * 1e3,
                    false => wrench.force[axis],
                };
                let points = hole.samples.chunks(ticks).zip(both.chunks(ticks));
                Series {
                    name: hole.mode.word().to_owned(),
                    points: points
                        .map(|(samples, both)| {
                            let count = samples.len() as f64;
                            let time: f64 = samples.iter().map(|s| s.time).sum();
                            let sum: f64 = both.iter().map(|both| value(&both[which])).sum();
                            (time / count, sum / count)
                        })
                        .collect(),
                    colour: [1, 2, 0][index % 3],
                    dashed: false,
                }
            })
            .collect()
    };
    let setup = &scenario.setup;
    let link = |target: &str| {
        let found = setup.targets.iter().find(|t| t.name == target);
        found.map_or("", |t| setup.robot.links[t.link].name.as_str())
    };
    let figure = |which: usize, arm: &str, target: &str| {
        let panels = (0..6).map(|k| {
            let (axis, torque) = (k % 3, k >= 3);
            let letter = if torque { "T" } else { "F" };
            let unit = if torque { "N·mm" } else { "N" };
            let name = format!("{letter}{}", ["x", "y", "z"][axis]);
            Panel {
                title: name.clone(),
                x: "time, s".to_owned(),
                y: format!("{name}, {unit}"),
                content: Content::Curves(curve(which, axis, torque)),
            }
        });
        Figure {
            title: vec![
                format!("Forces and torques at {}, whose arm {arm}", link(target)),
                format!(
                    "drill Ø {} mm, {} 1/min, {} µm a revolution · weights taken off · that link's frame · each point the \
                     mean of {MEAN_OF} s",
                    wanted.diameter_mm, wanted.speed_rpm, wanted.feed_um
                ),
            ],
            panels: panels.collect(),
            columns: 3,
            panel_size: (400, 300),
        }
    };
    [
        ("board", figure(0, "holds the board", &wanted.board)),
        ("drill", figure(1, "drills it", &wanted.tool)),
    ]
}
