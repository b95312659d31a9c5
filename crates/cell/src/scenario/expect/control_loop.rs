//! Of poses held in a control loop.

use super::super::control_loop::{ControlLoop, Looped};
use super::{Check, Expect, Range, at_least, at_most, within};
use serde::Deserialize;

/// Expectation of a loop: one model with one filter.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectLoop {
    /// One of `[loop] models`.
    pub model: String,
    /// One of its filters, by the name that the report gives it.
    pub filter: String,
    /// Range of the position's error, rms, µm.
    pub position_rms_um: Option<Range>,
    /// Largest error of a position, µm.
    pub position_max_um: Option<f64>,
    /// Range of its part from noise, rms, µm.
    pub noise_rms_um: Option<Range>,
    /// Range of its part from delay, rms, µm.
    pub lag_rms_um: Option<Range>,
    /// Least share by which the error falls, rms, against commands corrected for the tool alone.
    pub reduction: Option<f64>,
    /// Most poses left out and ticks without a command; none if left out.
    pub unreached: Option<usize>,
}

impl Expect {
    /// Refuses expectations of models and filters that the loop does not have, and those that expect nothing.
    pub(super) fn check_loop(&self, control_loop: &ControlLoop) -> Result<(), String> {
        for wanted in &self.loops {
            let filters = control_loop.filter_names();
            let known = [
                ("model", &wanted.model, &control_loop.models),
                ("filter", &wanted.filter, &filters),
            ];
            for (key, word, words) in known {
                if !words.contains(word) {
                    return Err(format!(
                        "[[expect.loop]] {key} = \"{word}\"; accepted: one of those of [loop]: {}",
                        words.join(" · ")
                    ));
                }
            }
            let idle = wanted.position_rms_um.is_none()
                && wanted.position_max_um.is_none()
                && wanted.noise_rms_um.is_none()
                && wanted.lag_rms_um.is_none()
                && wanted.reduction.is_none()
                && wanted.unreached.is_none();
            if idle {
                return Err(format!(
                    "[[expect.loop]] {}, {} expects nothing; accepted: position_rms_um, position_max_um, noise_rms_um, \
                     lag_rms_um, reduction, unreached",
                    wanted.model, wanted.filter
                ));
            }
        }
        Ok(())
    }
}

/// Checks the expectations of control loops.
pub fn check_loop(expect: &Expect, found: &[Looped]) -> Vec<Check> {
    let mut checks = Vec::new();
    // nothing that was held met nothing, whatever is expected
    checks.extend(
        found
            .iter()
            .filter(|looped| looped.poses == 0)
            .map(|looped| Check {
                what: format!("poses held, loop of {}", looped.model),
                found: format!("0, {} left out", looped.left_out),
                accepted: "at least 1".to_owned(),
                met: false,
            }),
    );
    for wanted in &expect.loops {
        let Some(looped) = found.iter().find(|l| l.model == wanted.model) else {
            continue;
        };
        let Some(found) = looped.filters.iter().find(|f| f.filter == wanted.filter) else {
            continue;
        };
        let name = |what: &str| format!("{what}, loop of {}, {}", wanted.model, wanted.filter);
        checks.extend(at_most(
            &name("largest position error, µm"),
            found.errors.most.position_m * 1e6,
            wanted.position_max_um,
        ));
        checks.extend(at_most(
            &name("poses left out and ticks without a command"),
            (looped.left_out + found.unreached) as f64,
            Some(wanted.unreached.unwrap_or(0) as f64),
        ));
        let parts = [
            (
                "position error, rms, µm",
                found.errors.rms,
                wanted.position_rms_um,
            ),
            (
                "position error from noise, rms, µm",
                found.noise,
                wanted.noise_rms_um,
            ),
            (
                "position error from delay, rms, µm",
                found.lag,
                wanted.lag_rms_um,
            ),
        ];
        for (what, part, range) in parts {
            checks.extend(within(&name(what), part.position_m * 1e6, range));
        }
        checks.extend(at_least(
            &name("share by which the position error falls"),
            looped.reduction(found),
            wanted.reduction,
        ));
    }
    checks
}
