//! Of commands that models correct.

use super::super::compensated::{Compensate, Corrections};
use super::{Check, Expect, Range, at_least, at_most, within};
use serde::Deserialize;

/// Expectation of the commands that one model corrects.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectCompensation {
    /// One of `[compensate] models`.
    pub model: String,
    /// Largest miss of a position, µm.
    pub position_max_um: Option<f64>,
    /// Largest miss of an orientation, µrad.
    pub orientation_max_urad: Option<f64>,
    /// Range of the position's miss, rms, µm.
    pub position_rms_um: Option<Range>,
    /// Least share by which the position error falls, rms.
    pub reduction: Option<f64>,
    /// Range of the share of coordinates inside their predicted 95 % intervals.
    pub coverage: Option<Range>,
    /// Most poses that no command reaches; none if left out.
    pub unreached: Option<usize>,
}

impl Expect {
    /// Refuses expectations of a model that corrects nothing.
    pub(super) fn check_compensation(&self, compensate: &Compensate) -> Result<(), String> {
        for wanted in &self.compensation {
            if !compensate.models.contains(&wanted.model) {
                return Err(format!(
                    "[[expect.compensation]] model = \"{}\"; accepted: one of [compensate] models: {}",
                    wanted.model,
                    compensate.models.join(", ")
                ));
            }
        }
        Ok(())
    }
}

/// Checks the expectations of corrected commands.
pub fn check_compensation(expect: &Expect, found: &[Corrections]) -> Vec<Check> {
    let mut checks = Vec::new();
    for wanted in &expect.compensation {
        let Some(found) = found.iter().find(|c| c.model == wanted.model) else {
            continue;
        };
        let name = |what: &str| format!("{what}, commands corrected by {}", wanted.model);
        let most = found.most();
        checks.extend(at_most(
            &name("largest position error, µm"),
            most.position_m * 1e6,
            wanted.position_max_um,
        ));
        checks.extend(at_most(
            &name("largest orientation error, µrad"),
            most.orientation_rad * 1e6,
            wanted.orientation_max_urad,
        ));
        checks.extend(at_most(
            &name("poses not reached"),
            found.unreached as f64,
            Some(wanted.unreached.unwrap_or(0) as f64),
        ));
        let rms = found.rms().1.position_m * 1e6;
        checks.extend(within(
            &name("position error, rms, µm"),
            rms,
            wanted.position_rms_um,
        ));
        let coverage = found.coverage().unwrap_or(f64::NAN);
        checks.extend(within(
            &name("coverage of predicted 95 % intervals"),
            coverage,
            wanted.coverage,
        ));
        checks.extend(at_least(
            &name("share by which the position error falls"),
            found.reduction(),
            wanted.reduction,
        ));
    }
    checks
}
