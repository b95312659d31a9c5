//! Where the tracker stands: its pose in the robot's base frame.
//!
//! ## Law
//! `base_from_tracker = (x, y, z; rx, ry, rz)`: translation in m and rotation vector in rad, both in the base
//! frame. Not small: any pose can be represented.
//!
//! ## Signature
//! Everything. Without it no reading can be compared with the robot at all; it is estimated whenever the
//! campaign marks it `"estimate"`, whether named in the model or not.
//!
//! ## Confused with
//! A robot that stands elsewhere than thought: exactly the same. The offset of the first joint: exactly a
//! turn of the tracker about its axis.
//!
//! ## Plant
//! The instrument layer places the tracker there.
//!
//! ## Sources
//! Mooring, Roth, Driels 1991, *Fundamentals of Manipulator Calibration*, ch. 3.

use super::{Effect, Parameter, Role, Stage};
use crate::dual_quaternion::{DualQuaternion, Scalar, rotation_exp};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;

/// Pose of the tracker.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerFrame {}

/// Names of the six numbers of a pose, with units and typical sizes.
pub(super) const POSE: [(&str, &str, f64); 6] = [
    ("x", "m", 1.0),
    ("y", "m", 1.0),
    ("z", "m", 1.0),
    ("rx", "rad", 1.0),
    ("ry", "rad", 1.0),
    ("rz", "rad", 1.0),
];

/// A pose from its six numbers.
pub(super) fn pose<S: Scalar>(p: &[S]) -> DualQuaternion<S> {
    DualQuaternion::from_parts(
        Vector3::new(p[0], p[1], p[2]),
        rotation_exp(&Vector3::new(p[3], p[4], p[5])),
    )
}

/// The same for the plant, which shares no code with the model.
pub(super) fn isometry(p: &[f64]) -> Isometry3<f64> {
    Isometry3::new(
        Vector3::new(p[0], p[1], p[2]),
        Vector3::new(p[3], p[4], p[5]),
    )
}

impl Effect for TrackerFrame {
    const ID: &'static str = "tracker_frame";
    const STAGE: Stage = Stage::Instrument;
    const ROLE: Option<Role> = Some(Role::TrackerFrame);

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        POSE.map(|(name, unit, typical)| Parameter::new(name, unit, typical))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        posture.base_from_tracker = pose(p) * posture.base_from_tracker;
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        plant.base_from_tracker = isometry(p) * plant.base_from_tracker;
        Ok(())
    }
}
