//! Kinematic error of each gear on its output side: once and twice per turn of the joint.
//!
//! ## Law
//! `dq_j = s1 sin q_j + c1 cos q_j + s2 sin 2q_j + c2 cos 2q_j`, four amplitudes in rad. Sliding joints have none.
//!
//! ## Signature
//! Periodic in the joint's own angle, whatever the load, direction or time.
//!
//! ## Confused with
//! The first harmonic of one joint: a `gravity_compensator`, exactly. `geometry`, which takes up 50 to 63 % of it (an eccentric axis looks alike), and `gear_ratio` over a limited range.
//! Eight and more distinct angles over the joint's whole range tell them apart.
//!
//! ## Plant
//! An amplitude and a phase for each harmonic, added to the command before the joint's spring is set to rest there.
//!
//! ## Sources
//! Harmonic Drive CSF/CSG catalogue, table 40, positional accuracy (1 to 2 arcmin peak to peak).

use super::{Effect, Parameter, Place, Role, Stage, turning};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Harmonics of the observed turning joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransmissionError {}

const TERMS: [&str; 4] = ["sin1", "cos1", "sin2", "cos2"];

impl Effect for TransmissionError {
    const ID: &'static str = "transmission_error";
    const STAGE: Stage = Stage::Rigid;
    const ROLE: Option<Role> = Some(Role::Transmission);
    const ALIASES: &'static [&'static str] = &["gravity_compensator"];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_joint = |joint: usize| {
            let name = &setup.robot.joints[joint].name;
            TERMS.map(|term| {
                Parameter::new(format!("{name}.{term}"), "rad", 1e-4).at(Place::Joint(joint))
            })
        };
        turning(setup).flat_map(of_joint).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (joint, p) in turning(posture.setup).zip(p.chunks_exact(TERMS.len())) {
            let q = posture.q(joint);
            let (sin1, cos1) = q.sin_cos();
            let (sin2, cos2) = (q * constant(2.0)).sin_cos();
            posture.move_joint(joint, p[0] * sin1 + p[1] * cos1 + p[2] * sin2 + p[3] * cos2);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let mut waves = Vec::new();
        for (joint, p) in turning(setup).zip(p.chunks_exact(TERMS.len())) {
            for (cycles, p) in [1.0, 2.0].into_iter().zip(p.chunks_exact(2)) {
                waves.push((joint, cycles, p[0].hypot(p[1]), p[1].atan2(p[0])));
            }
        }
        plant.command_laws.push(Arc::new(move |command, angles| {
            for &(joint, cycles, amplitude, phase) in &waves {
                angles[joint] += amplitude * (cycles * command.joints[joint] + phase).sin();
            }
        }));
        Ok(())
    }
}
