//! Constant error of each joint's zero: the encoder reads `q`, the joint stands at `q + offset`.
//!
//! ## Law
//! `dq_j = o_j`, rad (m for a prismatic joint).
//!
//! ## Signature
//! Independent of load, direction and time; a turn of everything beyond the joint about its axis, the same
//! in every pose. Usually the largest geometric error, and the first rung of a calibration.
//!
//! ## Confused with
//! `geometry`, of which it is a part: a rotation of the joint's node about the joint axis is exactly the
//! same. The first joint's offset is the same as a turn of the tracker, the last one's of the target.
//!
//! ## Plant
//! The joint's spring rests at the commanded angle plus the offset.
//!
//! ## Sources
//! Slamani, Nubiola, Bonev 2012, *Assessment of the positioning performance of an industrial robot*
//! (650 µm and 2.8 mrad before calibration of an IRB 1600).

use super::{Effect, Parameter, Role, Stage, by_joint};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;

/// Offsets of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointOffset {}

impl Effect for JointOffset {
    const ID: &'static str = "joint_offset";
    const STAGE: Stage = Stage::Rigid;
    const ROLE: Option<Role> = Some(Role::Offset);
    const ALIASES: &'static [&'static str] = &["geometry"];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad", 1e-3), ("m", 5e-4))
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &offset) in posture.setup.observed.iter().zip(p) {
            posture.move_joint(joint, offset);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let offsets: Vec<(usize, f64)> = setup
            .observed
            .iter()
            .copied()
            .zip(p.iter().copied())
            .collect();
        plant
            .command_laws
            .push(std::sync::Arc::new(move |_, angles| {
                for &(joint, offset) in &offsets {
                    angles[joint] += offset;
                }
            }));
        Ok(())
    }
}
