//! Play on the side on which the load hangs: the joint lies against one or the other flank of its gear.
//!
//! ## Law
//! `dq_j = b_j tanh(τ_j / T_0)`, `b_j` half the play in rad (m). Option `transition`: the torque `T_0` that brings the
//! flanks together, 1 N·m (N) by default.
//!
//! ## Signature
//! A step where the joint's torque changes its sign; hardly depends on the size of the load, and not on the direction of
//! approach.
//!
//! ## Confused with
//! `joint_hardening` (64 % absorbed: it saturates too), `joint_offset` while the torque keeps its sign. Poses near zero
//! torque, with both signs, tell them apart.
//!
//! ## Plant
//! The joint's rest follows the torque that it bears, found with MuJoCo's statics.
//!
//! ## Sources
//! Ruderman 2012; Nordin, Gutman 2002, *Controlling mechanical systems with backlash*, Automatica 38(10).

use super::{Effect, Need, Parameter, Stage, by_joint};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Play of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GravityBacklash {
    /// Torque that brings the flanks together, N·m (N).
    #[serde(default = "usual")]
    transition: f64,
}

fn usual() -> f64 {
    1.0
}

impl Effect for GravityBacklash {
    const ID: &'static str = "gravity_backlash";
    const STAGE: Stage = Stage::Elastic;
    const NEEDS: &'static [Need] = &[Need::Load];

    fn check(&self, _: &Setup) -> Result<(), String> {
        if self.transition.is_finite() && self.transition > 0.0 {
            return Ok(());
        }
        Err(format!(
            "transition is {}; accepted: a torque above 0 N·m",
            self.transition
        ))
    }

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad", 5e-5), ("m", 2e-5))
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let scale: S = constant(1.0 / self.transition);
        for (&joint, &half) in posture.setup.observed.iter().zip(p) {
            let torque = posture.torque(joint);
            // a hyperbolic tangent that does not overflow
            let (size, side) = if torque < S::zero() {
                (-torque * scale, -S::one())
            } else {
                (torque * scale, S::one())
            };
            let rest = (size * constant(-2.0)).exp();
            let tanh = side * (S::one() - rest) / (S::one() + rest);
            posture.move_joint(joint, half * tanh);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let joints = setup.observed.iter().copied();
        let play: Vec<(usize, f64)> = joints.zip(p.iter().copied()).collect();
        let transition = self.transition;
        plant.windup_laws.push(Arc::new(move |_, torques, angles| {
            for &(joint, half) in &play {
                angles[joint] += half * (torques[joint] / transition).tanh();
            }
        }));
        Ok(())
    }
}
