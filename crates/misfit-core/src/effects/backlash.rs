//! Backlash or lost motion: where a joint stops depends on the side from which it came.
//!
//! ## Law
//! `dq_j = b_j s_j`, `s_j` the direction of the joint's last motion (-1, 0, +1) and `b_j` half the lost motion, rad (m).
//! Coulomb friction that winds the gear up by a constant amount is the same law: the two are one effect here.
//!
//! ## Signature
//! Flips with the direction of approach; the same at every load and time. Readings of one pose from both sides differ by
//! `2 b_j` about each joint's axis.
//!
//! ## Confused with
//! `timestamp_lag`, which is backlash in one common ratio to the joints' speeds. Nothing else flips with direction.
//!
//! ## Plant
//! Added to the command with the sign of the approach, before the joint's spring is set to rest there. MuJoCo's own
//! friction holds no static offset.
//!
//! ## Sources
//! ISO 9283:1998 (multi-directional pose accuracy variation); Ruderman 2012 (Coulomb wind-up of elastic joints).

use super::{Effect, Need, Parameter, Stage, by_joint};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Lost motion of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Backlash {}

impl Effect for Backlash {
    const ID: &'static str = "backlash";
    const STAGE: Stage = Stage::Rigid;
    const NEEDS: &'static [Need] = &[Need::Approach];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad", 5e-5), ("m", 2e-5))
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &half) in posture.setup.observed.iter().zip(p) {
            let side = posture.approach(joint);
            posture.move_joint(joint, half * side);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let joints = setup.observed.iter().copied();
        let lost: Vec<(usize, f64)> = joints.zip(p.iter().copied()).collect();
        plant.command_laws.push(Arc::new(move |command, angles| {
            for &(joint, half) in &lost {
                match command.approach[joint] {
                    side if side > 0.0 => angles[joint] += half,
                    side if side < 0.0 => angles[joint] -= half,
                    _ => {}
                }
            }
        }));
        Ok(())
    }
}
