//! A scenario's run on the terminal, and as JSON.

use super::control_loop::LoopDocument;
use super::corrections::CorrectionsDocument;
use super::drill::DrillDocument;
use super::format::{angle, count, length, number, percent, render, table, wrap};
use super::json::FitDocument;
use super::map::MapDocument;
use super::paper::PaperDocument;
use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::efficiency::{Bound, Study};
use misfit_cell::scenario::expect::{Check, Comparison};
use misfit_cell::scenario::workspace::Survey;
use misfit_core::effects::Role;
use misfit_core::fit::Status;
use misfit_core::fit::paper::PaperFit;
use serde::Serialize;
use std::fmt::Write;

/// `misfit.run/1`.
#[derive(Debug, Serialize)]
pub struct RunDocument {
    /// `misfit.run/1`.
    pub schema: &'static str,
    /// Scenario name.
    pub scenario: String,
    /// Seed.
    pub seed: u64,
    /// The fit; none in an efficiency study.
    pub fit: Option<FitDocument>,
    /// Parameters beside their truth.
    pub truth: Vec<Comparison>,
    /// The same springs by the paper's estimator, if asked for.
    pub paper: Option<PaperDocument>,
    /// Deflection over the workspace, if asked for.
    pub workspace: Vec<Survey>,
    /// What other designs could do, if asked for.
    pub instead: Vec<Instead>,
    /// The efficiency study, if it was one.
    pub study: Option<StudyDocument>,
    /// Corrected commands by model, if asked for.
    pub compensation: Vec<CorrectionsDocument>,
    /// Control loops by model, if asked for.
    #[serde(rename = "loop")]
    pub loops: Vec<LoopDocument>,
    /// Maps of the workspace, if asked for.
    pub map: Option<MapDocument>,
    /// Holes drilled, if asked for.
    pub drill: Option<DrillDocument>,
    /// Expectations.
    pub expect: Vec<Check>,
    /// All expectations met?
    pub passed: bool,
}

impl RunDocument {
    /// A run of which nothing is told yet but how its expectations were met.
    pub fn new(scenario: &Scenario, expect: Vec<Check>) -> Self {
        Self {
            schema: "misfit.run/1",
            scenario: scenario.name.clone(),
            seed: scenario.seed,
            fit: None,
            truth: Vec::new(),
            paper: None,
            workspace: Vec::new(),
            instead: Vec::new(),
            study: None,
            compensation: Vec::new(),
            loops: Vec::new(),
            map: None,
            drill: None,
            passed: expect.iter().all(|check| check.met),
            expect,
        }
    }
}

/// Cramér-Rao bounds of one design.
#[derive(Debug, Serialize)]
pub struct Instead {
    /// The design in words.
    pub title: String,
    /// By compliance.
    pub bounds: Vec<Bound>,
}

/// A scenario's name and title.
pub fn title(scenario: &Scenario) -> String {
    let title = if scenario.title.is_empty() {
        String::new()
    } else {
        format!(" · {}", scenario.title)
    };
    wrap(&format!("scenario {}{title}", scenario.name), 9)
}

/// An efficiency study as data.
#[derive(Debug, Serialize)]
pub struct StudyDocument {
    campaigns: usize,
    not_converged: usize,
    efficiency: f64,
    efficiency_std: f64,
    coverage: f64,
    paper_efficiency: f64,
    joints: Vec<JointDocument>,
}

#[derive(Debug, Serialize)]
struct JointDocument {
    name: String,
    truth: f64,
    relative_bound: f64,
    efficiency: f64,
    bias_in_bounds: f64,
    coverage: f64,
    paper_efficiency: f64,
}

/// The study's document.
pub fn study_document(study: &Study) -> StudyDocument {
    StudyDocument {
        campaigns: study.campaigns,
        not_converged: study.not_converged,
        efficiency: study.efficiency(),
        efficiency_std: study.efficiency_std(),
        coverage: study.coverage(),
        paper_efficiency: study.paper_efficiency(),
        joints: study
            .joints
            .iter()
            .map(|j| JointDocument {
                name: j.name.clone(),
                truth: j.truth,
                relative_bound: j.relative_bound,
                efficiency: j.efficiency(),
                bias_in_bounds: j.sum / j.count as f64,
                coverage: j.coverage(),
                paper_efficiency: j.paper_efficiency(),
            })
            .collect(),
    }
}

/// Compliances beside the springs of the plant, and what the paper's estimator makes of the same readings.
pub fn springs(compared: &[Comparison], quantile: f64, paper: Option<&PaperFit>) -> String {
    let springs: Vec<&Comparison> = compared
        .iter()
        .filter(|row| row.effect == Role::Spring.id())
        .collect();
    if springs.is_empty() {
        return String::new();
    }
    let mut header = vec!["spring", "in MuJoCo", "identified", "95 % interval"];
    if paper.is_some() {
        header.push("paper's way");
    }
    header.extend(["error", "truth is", "status"]);
    let numbers: Vec<usize> = (1..header.len() - 2).collect();
    let mut rows = table(&header, &numbers);
    for row in springs {
        let seen = row.status != Status::Unobservable;
        let half = row.std.map(|std| std * quantile);
        let inside = half.is_some_and(|half| (row.value - row.truth).abs() <= half);
        let mut cells = vec![
            row.name.clone(),
            stiffness(Some(row.truth)),
            stiffness(seen.then_some(row.value)),
            half.map_or_else(dash, |half| interval(row.value, half)),
        ];
        if let Some(paper) = paper {
            let joint = paper.joints.iter().find(|joint| joint.name == row.name);
            cells.push(match joint.and_then(|joint| joint.compliance) {
                Some(c) if c < 0.0 => "negative".to_owned(),
                other => stiffness(other),
            });
        }
        cells.extend([
            match (seen, row.value > 0.0) {
                (true, true) => percent((1.0 / row.value - 1.0 / row.truth) * row.truth),
                _ => dash(),
            },
            match (seen, half, inside) {
                (true, Some(_), true) => "inside".to_owned(),
                (true, Some(_), false) => "OUTSIDE".to_owned(),
                _ => String::new(),
            },
            row.status.word().to_owned(),
        ]);
        rows.add_row(cells);
    }
    format!(
        "springs of MuJoCo beside those identified, N·m/rad\n{}\n\n",
        render(&rows)
    )
}

fn dash() -> String {
    "—".to_owned()
}

/// Stiffness of a compliance, N·m/rad.
fn stiffness(compliance: Option<f64>) -> String {
    match compliance {
        None => dash(),
        Some(0.0) => "rigid".to_owned(),
        Some(c) => number(1.0 / c),
    }
}

/// Interval of a stiffness from one of its compliance; one that may be zero has no upper end.
fn interval(compliance: f64, half: f64) -> String {
    let low = number(1.0 / (compliance + half));
    if compliance > half {
        format!("{low} … {}", number(1.0 / (compliance - half)))
    } else {
        format!("≥ {low}")
    }
}

/// How far the plant gives way over its workspace.
pub fn survey(scenario: &Scenario, rows_of: &[Survey]) -> String {
    if rows_of.is_empty() {
        return String::new();
    }
    let mut rows = table(
        &[
            "springs",
            "target",
            "position, max",
            "median",
            "orientation, max",
            "does not hold",
        ],
        &[2, 3, 4, 5],
    );
    for row in rows_of {
        rows.add_row(vec![
            row.exponent.map_or("as in MuJoCo".to_owned(), |e| {
                format!("paper's tables × 10^{e}")
            }),
            row.target.clone(),
            length(row.position_max_m),
            length(row.position_median_m),
            angle(row.orientation_max_rad),
            format!("{} of {}", row.collapsed, row.postures),
        ]);
    }
    let load = scenario.design.loads.last();
    let title = format!(
        "deflection by {} kg over the workspace, by MuJoCo",
        load.map_or_else(|| "0".to_owned(), |load| number(load.mass))
    );
    let note = match &scenario.note {
        Some(note) => wrap(note, 0) + "\n",
        None => String::new(),
    };
    format!("{title}\n{}\n{note}\n", render(&rows))
}

/// What other designs could do: one column each.
pub fn instead(designs: &[Instead]) -> String {
    let Some(first) = designs.first() else {
        return String::new();
    };
    let mut header = vec!["best σ of a compliance"];
    header.extend(designs.iter().map(|design| design.title.as_str()));
    let numbers: Vec<usize> = (1..header.len()).collect();
    let mut rows = table(&header, &numbers);
    for (index, bound) in first.bounds.iter().enumerate() {
        let mut cells = vec![bound.name.clone()];
        cells.extend(designs.iter().map(|design| {
            let relative = design.bounds.get(index).and_then(|bound| bound.relative);
            relative.map_or("not seen".to_owned(), percent)
        }));
        rows.add_row(cells);
    }
    format!(
        "what each design could know at best (Cramér-Rao bound over the true value)\n{}\n\n",
        render(&rows)
    )
}

/// The study's table.
pub fn study(study: &Study) -> String {
    let mut rows = table(
        &[
            "compliance of",
            "bound σ/c",
            "efficiency",
            "bias/σ",
            "coverage",
            "paper's efficiency",
        ],
        &[1, 2, 3, 4, 5],
    );
    for joint in &study.joints {
        rows.add_row(vec![
            joint.name.clone(),
            percent(joint.relative_bound),
            format!("{:.3}", joint.efficiency()),
            format!("{:+.3}", joint.sum / joint.count as f64),
            format!("{:.1} %", joint.coverage() * 100.0),
            format!("{:.3}", joint.paper_efficiency()),
        ]);
    }
    rows.add_row(vec![
        "pooled".to_owned(),
        String::new(),
        format!("{:.3} ± {:.3}", study.efficiency(), study.efficiency_std()),
        String::new(),
        format!("{:.1} %", study.coverage() * 100.0),
        format!("{:.3}", study.paper_efficiency()),
    ]);
    let mut out = format!(
        "{}: variance of the estimates against the Cramér-Rao bound\n\n{}\n",
        count(study.campaigns, "campaign"),
        render(&rows)
    );
    if study.not_converged > 0 {
        let _ = writeln!(
            out,
            "\n{} did not converge",
            count(study.not_converged, "fit")
        );
    }
    out
}

/// The expectations, missed ones first in detail.
pub fn checks(checks: &[Check]) -> String {
    if checks.is_empty() {
        return "expect   nothing is expected of this scenario\n".to_owned();
    }
    let missed: Vec<&Check> = checks.iter().filter(|check| !check.met).collect();
    let mut out = format!(
        "expect   {} of {} met\n",
        checks.len() - missed.len(),
        checks.len()
    );
    for check in missed {
        let _ = writeln!(
            out,
            "{}",
            wrap(
                &format!(
                    "  MISSED {}: found {}; accepted: {}",
                    check.what, check.found, check.accepted
                ),
                4
            )
        );
    }
    out
}
