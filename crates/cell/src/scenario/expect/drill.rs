//! Of holes.

use super::super::drill::cutting;
use super::super::drill::summary::summary;
use super::super::drill::{Bored, Drilling, Mode};
use super::{Check, Expect, Range, at_most, within};
use serde::Deserialize;

/// Expectation of a hole.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
pub struct ExpectDrill {
    /// One of `[drill] commands`.
    pub commands: Mode,
    /// Range of the distance of the hole from its place, µm.
    pub hole_um: Option<Range>,
    /// Range of the angle between drill and normal, µrad.
    pub tilt_urad: Option<Range>,
    /// Range of the largest thrust, N.
    pub thrust_N: Option<Range>,
    /// Largest distance of the tip from the back of the board at the largest thrust, µm.
    pub breakthrough_um: Option<f64>,
    /// Range of the largest lateral force, N.
    pub lateral_N: Option<Range>,
    /// Largest sum of the two sensors over the largest thrust, forces and moments.
    pub balance: Option<f64>,
}

impl Expect {
    /// Refuses expectations of commands that no hole is drilled with, and those that expect nothing.
    pub(super) fn check_drill(&self, drill: &Drilling) -> Result<(), String> {
        for wanted in &self.drill {
            if !drill.modes.contains(&wanted.commands) {
                let known: Vec<&str> = drill.modes.iter().map(|mode| mode.word()).collect();
                return Err(format!(
                    "[[expect.drill]] commands = \"{}\"; accepted: one of [drill] commands: {}",
                    wanted.commands.word(),
                    known.join(", ")
                ));
            }
            let idle = wanted.hole_um.is_none()
                && wanted.tilt_urad.is_none()
                && wanted.thrust_N.is_none()
                && wanted.breakthrough_um.is_none()
                && wanted.lateral_N.is_none()
                && wanted.balance.is_none();
            if idle {
                return Err(format!(
                    "[[expect.drill]] {} expects nothing; accepted: hole_um, tilt_urad, thrust_N, breakthrough_um, \
                     lateral_N, balance",
                    wanted.commands.word()
                ));
            }
        }
        Ok(())
    }
}

/// Checks the expectations of holes.
pub fn check_drill(expect: &Expect, drill: &Drilling, holes: &[Bored]) -> Vec<Check> {
    let mut checks = Vec::new();
    for wanted in &expect.drill {
        let Some(hole) = holes.iter().find(|hole| hole.mode == wanted.commands) else {
            continue;
        };
        let found = summary(drill, hole);
        let name = |what: &str| format!("{what}, commands {}", found.mode.word());
        let hole_error = found.hole_error_m.unwrap_or(f64::NAN) * 1e6;
        checks.extend(within(
            &name("hole off its place, µm"),
            hole_error,
            wanted.hole_um,
        ));
        checks.extend(within(
            &name("axis off the normal, µrad"),
            found.tilt_rad * 1e6,
            wanted.tilt_urad,
        ));
        checks.extend(within(
            &name("largest thrust, N"),
            found.thrust_peak_N,
            wanted.thrust_N,
        ));
        let back = cutting::thickness(&drill.layers());
        let off = found
            .through_s
            .map_or(f64::NAN, |_| (found.thrust_peak_depth_m - back).abs());
        checks.extend(at_most(
            &name("tip from the back of the board at the largest thrust, µm"),
            off * 1e6,
            wanted.breakthrough_um,
        ));
        checks.extend(within(
            &name("largest lateral force, N"),
            found.lateral_peak_N,
            wanted.lateral_N,
        ));
        for (what, share) in [
            (
                "sum of both sensors' forces over the largest thrust",
                found.balance,
            ),
            ("sum of their moments", found.moment_balance),
        ] {
            checks.extend(at_most(&name(what), share, wanted.balance));
        }
        checks.extend(at_most(
            &name("ticks without a command"),
            found.unreached as f64,
            Some(0.0),
        ));
    }
    checks
}
