//! Wrong gear ratio or encoder scale: a joint turns a little more than its encoder says, in proportion.
//!
//! ## Law
//! `dq_j = s_j q_j`, `q_j` the encoder angle and `s_j` dimensionless (rad/rad, m/m).
//!
//! ## Signature
//! Linear in the joint's own angle; independent of load, direction and time.
//!
//! ## Confused with
//! The first harmonic of `transmission_error`: over a limited range of the joint it takes up 85 % of this effect, so
//! the joint has to be used over its whole range. The linear part of a `gravity_compensator`, exactly. A scale is no offset: `geometry` absorbs little of it.
//!
//! ## Plant
//! The command is scaled before the joint's spring is set to rest there.
//!
//! ## Sources
//! Mooring, Roth, Driels 1991, *Fundamentals of Manipulator Calibration*, ch. 2 (joint transducer gain).

use super::{Effect, Parameter, Stage, by_joint};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Ratios of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GearRatio {}

impl Effect for GearRatio {
    const ID: &'static str = "gear_ratio";
    const STAGE: Stage = Stage::Rigid;
    const ALIASES: &'static [&'static str] = &["gravity_compensator"];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad/rad", 5e-5), ("m/m", 5e-5))
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &scale) in posture.setup.observed.iter().zip(p) {
            let q = posture.q(joint);
            posture.move_joint(joint, scale * q);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let joints = setup.observed.iter().copied();
        let scales: Vec<(usize, f64)> = joints.zip(p.iter().copied()).collect();
        plant.command_laws.push(Arc::new(move |command, angles| {
            for &(joint, scale) in &scales {
                angles[joint] += (1.0 + scale) * command.joints[joint] - command.joints[joint];
            }
        }));
        Ok(())
    }
}
