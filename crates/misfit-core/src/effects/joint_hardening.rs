//! Hardening of the joints: gears are softer under small torques than under large ones.
//!
//! ## Law
//! `dq_j = n_j clip(τ_j, -T_j, T_j)` on top of the linear compliance, `n_j = 1/K_1 - 1/K_2` in rad/(N·m) (m/N). Below the
//! knee `T_j` the joint has the stiffness `K_1`, above it `K_2`: the stiffness zones of gear catalogues, the first two of
//! three. Option `knee`: one number in N·m (N), or a table by joint; by default a seventh of the effort that the robot
//! file gives the joint, and 7 N·m where it gives none. Option `knee_factor`: so many times that default;
//! a diagnosis tries 0.32 to 3.2.
//!
//! ## Signature
//! Odd in the joint's torque and saturating: the deflection plotted over the torque has a kink at the knee.
//!
//! ## Confused with
//! `gravity_backlash` (66 % absorbed: it saturates too), `link_mass` (39 % of that one is absorbed here), and
//! `joint_compliance` while all torques stay on one side of the knee. Three loads and more, small ones among them, and
//! torques of both signs tell them apart.
//!
//! ## Plant
//! Beside the linear spring, the joint's rest follows the torque that it bears, found with MuJoCo's statics.
//!
//! ## Sources
//! Harmonic Drive, torsional stiffness in three zones (CHA manual, p. 83); Appl. Sci. 2019, 9, 65 (the linear part).

use super::options::PerJoint;
use super::{Effect, Need, Parameter, Role, Stage, at_least_zero, by_joint};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Hardening of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointHardening {
    /// Torque at which the stiffness changes, N·m (N).
    knee: Option<PerJoint>,
    /// What joints without a knee of their own have, times the usual.
    knee_factor: Option<f64>,
}

/// Knee as a share of the rated torque.
const SHARE: f64 = 1.0 / 7.0;
/// Knee where no rated torque is known, N·m (N).
const USUAL: f64 = 7.0;

impl JointHardening {
    fn knee(&self, setup: &Setup, joint: usize) -> f64 {
        let joint = &setup.robot.joints[joint];
        let given = self
            .knee
            .as_ref()
            .and_then(|knee| knee.of(&joint.name).copied());
        let factor = self.knee_factor.unwrap_or(1.0);
        given.unwrap_or_else(|| factor * joint.effort.map_or(USUAL, |effort| effort * SHARE))
    }
}

impl Effect for JointHardening {
    const ID: &'static str = "joint_hardening";
    const STAGE: Stage = Stage::Elastic;
    const ROLE: Option<Role> = Some(Role::Hardening);
    const NEEDS: &'static [Need] = &[Need::Load];
    // the size of a gear is seldom known, and the knee doubles from one to the next: half a decade either way
    const FORMS: &'static [&'static str] = &[
        "knee_factor = 0.32",
        "knee_factor = 0.56",
        "knee_factor = 1.8",
        "knee_factor = 3.2",
    ];

    fn check(&self, setup: &Setup) -> Result<(), String> {
        if let Some(factor) = self.knee_factor.filter(|f| !(*f > 0.0 && f.is_finite())) {
            return Err(format!(
                "knee_factor = {factor}; accepted: a number above 0"
            ));
        }
        PerJoint::check(self.knee.as_ref(), "knee", setup)
    }

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad/(N·m)", 2e-5), ("m/N", 2e-8))
            .into_iter()
            .map(|parameter| parameter.at_least(0.0))
            .collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &extra) in posture.setup.observed.iter().zip(p) {
            let torque = posture.torque(joint);
            let knee: S = constant(self.knee(posture.setup, joint));
            let clipped = if torque > knee {
                knee
            } else if torque < -knee {
                -knee
            } else {
                torque
            };
            posture.move_joint(joint, extra * clipped);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let mut soft = Vec::new();
        for (&joint, &extra) in setup.observed.iter().zip(p) {
            at_least_zero(Self::ID, &setup.robot.joints[joint].name, extra)?;
            soft.push((joint, extra, self.knee(setup, joint)));
        }
        plant.windup_laws.push(Arc::new(move |_, torques, angles| {
            for &(joint, extra, knee) in &soft {
                let torque = torques[joint];
                angles[joint] += extra * torque.abs().min(knee).copysign(torque);
            }
        }));
        Ok(())
    }
}
