//! A spring or cylinder beside a joint that takes part of the arm's weight off its gear.
//!
//! ## Law
//! A torque on the joint `a sin q + b cos q + k q` (N·m; `k` in N·m/rad), `q` its commanded angle: the first terms of any
//! compensator's closed chain. Option `joints`: names of turning joints; by default the second observed one, where such
//! springs usually sit.
//!
//! ## Signature
//! A deflection by the joint's own angle alone, without a load too; through the joint's spring only.
//!
//! ## Confused with
//! `transmission_error` and `gear_ratio` of the same joint (sine, cosine and slope have the same shape, but without the joint's compliance and with nothing to tell them
//! apart unless loads move the joint far), `joint_hardening`. Motor currents settle it. A sweep of the joint helps.
//!
//! ## Plant
//! A torque on MuJoCo's joint within the static solve.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810).

use super::{Effect, Parameter, Place, Stage, turning};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Compensators of one joint or more.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GravityCompensator {
    /// Names of the joints.
    joints: Option<Vec<String>>,
}

const TERMS: [(&str, &str, f64); 3] = [
    ("sin", "N·m", 20.0),
    ("cos", "N·m", 20.0),
    ("linear", "N·m/rad", 10.0),
];

impl GravityCompensator {
    fn joints(&self, setup: &Setup) -> Vec<usize> {
        match &self.joints {
            None => turning(setup).skip(1).take(1).collect(),
            Some(names) => turning(setup)
                .filter(|&joint| names.contains(&setup.robot.joints[joint].name))
                .collect(),
        }
    }
}

impl Effect for GravityCompensator {
    const ID: &'static str = "gravity_compensator";
    const STAGE: Stage = Stage::Load;
    const ALIASES: &'static [&'static str] = &["transmission_error", "gear_ratio"];

    fn check(&self, setup: &Setup) -> Result<(), String> {
        let known: Vec<&str> = turning(setup)
            .map(|joint| setup.robot.joints[joint].name.as_str())
            .collect();
        let mut names = self.joints.iter().flatten();
        match names.find(|name| !known.contains(&name.as_str())) {
            None => Ok(()),
            Some(name) => Err(format!(
                "joints names \"{name}\"; accepted: turning joints that are observed: {}",
                known.join(", ")
            )),
        }
    }

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_joint = |joint: usize| {
            let name = &setup.robot.joints[joint].name;
            TERMS.map(|(term, unit, typical)| {
                Parameter::new(format!("{name}.{term}"), unit, typical).at(Place::Joint(joint))
            })
        };
        self.joints(setup).into_iter().flat_map(of_joint).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let joints = self.joints(posture.setup).into_iter();
        for (joint, p) in joints.zip(p.chunks_exact(TERMS.len())) {
            let q = posture.q(joint);
            posture.add_torque(joint, p[0] * q.sin() + p[1] * q.cos() + p[2] * q);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (joint, p) in self
            .joints(setup)
            .into_iter()
            .zip(p.chunks_exact(TERMS.len()))
        {
            let (size, phase, slope) = (p[0].hypot(p[1]), p[1].atan2(p[0]), p[2]);
            plant.torque_laws.push(Arc::new(move |rest, _, torques| {
                torques[joint] += size * (rest[joint] + phase).sin() + slope * rest[joint];
            }));
        }
        Ok(())
    }
}
