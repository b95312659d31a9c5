//! The tracker or the robot's foot creeps during the campaign.
//!
//! ## Law
//! `base_from_tracker` moves by `t (x, y, z; rx, ry, rz)`: m/h and rad/h in the base frame, about its origin; `t` the time
//! from the middle of the campaign.
//!
//! ## Signature
//! The same rigid motion in all poses, in proportion to time.
//!
//! ## Confused with
//! `thermal_expansion` while the robot warms up steadily (it takes up 13 to 25 % of it); `base_compliance` if loads were
//! changed late. An anchor pose or three reflectors on the floor, measured every 20 minutes, settle it.
//!
//! ## Plant
//! The instrument layer moves the tracker with the command's time.
//!
//! ## Sources
//! ISO 9283:1998 (drift of pose characteristics); Le Reun et al., Robotica 2022.

use super::tracker_frame::{POSE, isometry, pose};
use super::{Effect, Need, Parameter, Role, Stage};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Rate of the tracker's pose.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameDrift {}

/// Seconds in an hour.
const HOUR: f64 = 3600.0;

impl Effect for FrameDrift {
    const ID: &'static str = "frame_drift";
    const STAGE: Stage = Stage::Instrument;
    const ROLE: Option<Role> = Some(Role::Drift);
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::Time];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        POSE.map(|(name, unit, _)| match unit {
            "m" => Parameter::new(name, "m/h", 5e-5),
            _ => Parameter::new(name, "rad/h", 2e-5),
        })
        .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let hours = posture.time() * constant(1.0 / HOUR);
        let moved: Vec<S> = p.iter().map(|&rate| rate * hours).collect();
        posture.base_from_tracker = pose(&moved) * posture.base_from_tracker;
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let rates = p.to_vec();
        plant.tracker_laws.push(Arc::new(move |command, tracker| {
            let moved: Vec<f64> = rates
                .iter()
                .map(|rate| rate / HOUR * command.time)
                .collect();
            *tracker = isometry(&moved) * *tracker;
        }));
        Ok(())
    }
}
