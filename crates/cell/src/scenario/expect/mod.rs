//! What must come out of a scenario: its `[expect]`, and how it was met. One file for each thing that a scenario does.

mod compensation;
mod control_loop;
mod drill;
mod fit;
mod map;

pub use compensation::{ExpectCompensation, check_compensation};
pub use control_loop::{ExpectLoop, check_loop};
pub use drill::{ExpectDrill, check_drill};
pub use fit::{Comparison, ExpectParameter, check_fit, check_study, compare};
pub use map::{ExpectMap, check_map};

use super::Job;
use crate::numbers::number;
use crate::setup::Setup;
use serde::{Deserialize, Serialize};

/// Expectations; whatever is left out is not checked.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// The fit converges (or not).
    pub converged: Option<bool>,
    /// Largest fitted position error, rms, mm.
    pub fit_position_rms_mm: Option<f64>,
    /// Largest held-out (or cross-validated) position error, rms, mm.
    pub heldout_position_rms_mm: Option<f64>,
    /// Range of the fitted whitened rms.
    pub whitened_rms: Option<Range>,
    /// Expectations of parameters.
    #[serde(default, rename = "parameter")]
    pub parameters: Vec<ExpectParameter>,
    /// Range of the pooled variance efficiency of the weighted fit against the Cramér-Rao bound.
    pub efficiency: Option<Range>,
    /// Range of the share of 95 % intervals that hold the truth.
    pub coverage: Option<Range>,
    /// Largest variance efficiency of the paper's estimator.
    pub paper_efficiency: Option<f64>,
    /// Expectations of corrected commands.
    #[serde(default)]
    pub compensation: Vec<ExpectCompensation>,
    /// Expectations of control loops.
    #[serde(default, rename = "loop")]
    pub loops: Vec<ExpectLoop>,
    /// Expectations of maps.
    #[serde(default)]
    pub map: Vec<ExpectMap>,
    /// Expectations of holes.
    #[serde(default)]
    pub drill: Vec<ExpectDrill>,
}

impl Expect {
    /// Refuses expectations that would check nothing: of what the scenario does not do, of models, targets and filters
    /// that it does not have, and those that expect nothing.
    ///
    /// # Errors
    /// A sentence that names the key, and what is accepted.
    pub fn check(&self, job: &Job, setup: &Setup) -> Result<(), String> {
        let fit = ["effects", "a fit"];
        let study = ["campaigns", "a study"];
        let keys = [
            (fit, "converged", self.converged.is_some()),
            (
                fit,
                "fit_position_rms_mm",
                self.fit_position_rms_mm.is_some(),
            ),
            (
                fit,
                "heldout_position_rms_mm",
                self.heldout_position_rms_mm.is_some(),
            ),
            (fit, "whitened_rms", self.whitened_rms.is_some()),
            (fit, "[[expect.parameter]]", !self.parameters.is_empty()),
            (study, "efficiency", self.efficiency.is_some()),
            (study, "coverage", self.coverage.is_some()),
            (study, "paper_efficiency", self.paper_efficiency.is_some()),
            (
                ["[compensate]", "corrected commands"],
                "[[expect.compensation]]",
                !self.compensation.is_empty(),
            ),
            (
                ["[loop]", "a control loop"],
                "[[expect.loop]]",
                !self.loops.is_empty(),
            ),
            (["[map]", "a map"], "[[expect.map]]", !self.map.is_empty()),
            (
                ["[drill]", "a hole"],
                "[[expect.drill]]",
                !self.drill.is_empty(),
            ),
        ];
        let own = job.key();
        if let Some(([_, what], key, _)) =
            keys.iter().find(|([of, _], _, given)| *given && *of != own)
        {
            let accepted = keys.iter().filter(|([of, _], ..)| *of == own);
            let accepted: Vec<&str> = accepted.map(|(_, key, _)| *key).collect();
            let does = match job {
                Job::Fit => "that fits once".to_owned(),
                _ => format!("with {own}"),
            };
            return Err(format!(
                "[expect] of {what} in a scenario {does}: {key} would check nothing; accepted: {}",
                accepted.join(", ")
            ));
        }
        match job {
            Job::Fit => self.parameters.iter().try_for_each(ExpectParameter::check),
            Job::Study { .. } => Ok(()),
            Job::Compensate(wanted) => self.check_compensation(wanted),
            Job::Loop(wanted) => self.check_loop(wanted),
            Job::Map(wanted) => self.check_map(wanted, setup),
            Job::Drill(wanted) => self.check_drill(wanted),
        }
    }
}

/// A range, both ends in it.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(try_from = "[f64; 2]")]
pub struct Range {
    least: f64,
    most: f64,
}

impl TryFrom<[f64; 2]> for Range {
    type Error = String;

    fn try_from([least, most]: [f64; 2]) -> Result<Self, String> {
        if least <= most {
            Ok(Self { least, most })
        } else {
            Err(format!(
                "[{least}, {most}] holds no number; accepted: [least, most]"
            ))
        }
    }
}

/// One expectation and how it was met.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// What was expected of what.
    pub what: String,
    /// What was found.
    pub found: String,
    /// What would have been accepted.
    pub accepted: String,
    /// Met?
    pub met: bool,
}

/// Inside a range, if one is asked for.
fn within(what: &str, found: f64, range: Option<Range>) -> Option<Check> {
    let Range { least, most } = range?;
    Some(Check {
        what: what.to_owned(),
        found: number(found),
        accepted: format!("{} to {}", number(least), number(most)),
        met: (least..=most).contains(&found),
    })
}

/// At most a limit, if one is asked for.
fn at_most(what: &str, found: f64, limit: Option<f64>) -> Option<Check> {
    let limit = limit?;
    Some(Check {
        what: what.to_owned(),
        found: number(found),
        accepted: format!("at most {}", number(limit)),
        met: found <= limit,
    })
}

/// At least a limit, if one is asked for.
fn at_least(what: &str, found: f64, limit: Option<f64>) -> Option<Check> {
    let limit = limit?;
    Some(Check {
        what: what.to_owned(),
        found: number(found),
        accepted: format!("at least {}", number(limit)),
        met: found >= limit,
    })
}
