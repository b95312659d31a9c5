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

use crate::report::format::number;
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
    pub whitened_rms: Option<[f64; 2]>,
    /// Expectations of parameters.
    #[serde(default, rename = "parameter")]
    pub parameters: Vec<ExpectParameter>,
    /// Range of the pooled variance efficiency of the weighted fit against the Cramér-Rao bound.
    pub efficiency: Option<[f64; 2]>,
    /// Range of the share of 95 % intervals that hold the truth.
    pub coverage: Option<[f64; 2]>,
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
    /// Refuses expectations that would check nothing: those of a study in a scenario with one fit, those of a fit
    /// in a study, and a parameter of which nothing is expected.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, study: bool) -> Result<(), String> {
        let of_study = [
            ("efficiency", self.efficiency.is_some()),
            ("coverage", self.coverage.is_some()),
            ("paper_efficiency", self.paper_efficiency.is_some()),
        ];
        let of_fit = [
            ("converged", self.converged.is_some()),
            ("fit_position_rms_mm", self.fit_position_rms_mm.is_some()),
            (
                "heldout_position_rms_mm",
                self.heldout_position_rms_mm.is_some(),
            ),
            ("whitened_rms", self.whitened_rms.is_some()),
            ("parameter", !self.parameters.is_empty()),
        ];
        let (idle, why) = if study {
            (
                &of_fit[..],
                "is of one fit, but campaigns makes this a study of many",
            )
        } else {
            (
                &of_study[..],
                "is of a study, but the scenario has no campaigns = N",
            )
        };
        if let Some((key, _)) = idle.iter().find(|(_, given)| *given) {
            return Err(format!("[expect] {key} {why}; it would check nothing"));
        }
        for wanted in &self.parameters {
            let idle = wanted.status.is_none()
                && wanted.relative_error.is_none()
                && wanted.relative_std.is_none()
                && wanted.sigmas.is_none();
            if idle {
                return Err(format!(
                    "[[expect.parameter]] {} expects nothing; accepted: status, relative_error, \
                     relative_std, sigmas",
                    wanted.name
                ));
            }
        }
        Ok(())
    }
}

impl Expect {
    /// Refuses expectations of a fit in a scenario with a table that does something else: what that reports, and its own
    /// expectations.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_instead(&self, table: &str, reports: &str, own: &str) -> Result<(), String> {
        if self.is_of_fit() {
            return Err(format!(
                "[expect] of a fit in a scenario with {table}, which reports {reports}; it would check nothing; accepted: \
                 {own}"
            ));
        }
        Ok(())
    }

    /// Is anything expected of a fit?
    fn is_of_fit(&self) -> bool {
        self.converged.is_some()
            || self.fit_position_rms_mm.is_some()
            || self.heldout_position_rms_mm.is_some()
            || self.whitened_rms.is_some()
            || !self.parameters.is_empty()
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
fn within(what: &str, found: f64, range: Option<[f64; 2]>) -> Option<Check> {
    let [low, high] = range?;
    Some(Check {
        what: what.to_owned(),
        found: number(found),
        accepted: format!("{} to {}", number(low), number(high)),
        met: (low..=high).contains(&found),
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
