//! A scenario's run on the terminal, and as JSON.

use super::format::{count, number, render, table, wrap};
use super::json::FitDocument;
use crate::fit::Status;
use crate::scenario::efficiency::Study;
use crate::scenario::expect::{Check, Comparison};
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
    /// The efficiency study, if it was one.
    pub study: Option<StudyDocument>,
    /// Expectations.
    pub expect: Vec<Check>,
    /// All expectations met?
    pub passed: bool,
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

/// Compliances beside the springs of the plant.
pub fn springs(compared: &[Comparison], quantile: f64) -> String {
    let rows_of: Vec<&Comparison> = compared
        .iter()
        .filter(|row| row.effect == "joint_compliance")
        .collect();
    if rows_of.is_empty() {
        return String::new();
    }
    let mut rows = table(
        &["springs", "in MuJoCo", "identified", "± 95 %", "error", "", "status"],
        &[1, 2, 3, 4],
    );
    for row in rows_of {
        let stiffness = |c: f64| format!("{} N·m/rad", number(1.0 / c));
        let seen = row.status != Status::Unobservable;
        let dash = || "—".to_owned();
        let half = row.std.map(|std| std * quantile);
        let inside = half.is_some_and(|half| (row.value - row.truth).abs() <= half);
        rows.add_row(vec![
            row.name.clone(),
            if row.truth > 0.0 { stiffness(row.truth) } else { "rigid".to_owned() },
            match (seen, row.value > 0.0) {
                (false, _) => dash(),
                (true, true) => stiffness(row.value),
                (true, false) => "rigid".to_owned(),
            },
            half.map_or_else(dash, |half| percent(half / row.value)),
            if seen { percent((1.0 / row.value - 1.0 / row.truth) * row.truth) } else { dash() },
            match (seen, half, inside) {
                (true, Some(_), true) => "inside".to_owned(),
                (true, Some(_), false) => "OUTSIDE".to_owned(),
                _ => String::new(),
            },
            row.status.word().to_owned(),
        ]);
    }
    render(&rows) + "\n"
}

fn percent(share: f64) -> String {
    format!("{} %", number(share * 100.0))
}

/// The study's table.
pub fn study(study: &Study) -> String {
    let mut rows = table(
        &["compliance of", "bound σ/c", "efficiency", "bias/σ", "coverage", "paper's efficiency"],
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
        let _ = writeln!(out, "\n{} did not converge", count(study.not_converged, "fit"));
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
