//! Kinematic error of each gear on its input side: many cycles per turn of the joint.
//!
//! ## Law
//! `dq_j = s sin(N q_j) + c cos(N q_j)`, rad, with `N` cycles per output turn, for one `N` or several. Option `cycles`: a
//! number, a list, or a table of them by joint (`cycles = { shoulder = [25.0, 50.0] }`; joints that it leaves out have no
//! wave). The wave generator of a strain-wave gear makes two cycles per input turn, so that a gear of ratio 100 makes 200,
//! which is the default of a fit. `N` need not be whole, and has to be right to a small share of a cycle over the joint's
//! range: where it is not known, `misfit diagnose` and `misfit ladder` find it. Parameters are named by their cycles
//! (`shoulder.sin25`, `shoulder.cos25`). Sliding joints have none.
//!
//! ## Signature
//! Periodic in the joint's own angle with so short a period that random poses see noise: the residual is as large between
//! neighbouring poses as between distant ones, and repeats exactly when a pose is repeated.
//!
//! ## Confused with
//! Noise, as long as `N` is not known. Waves are looked for up to 320 cycles a turn, and from one period over the joint's
//! range above the slowest two that `transmission_error` has. Where few angles were measured, other numbers of cycles
//! explain the readings as well: a diagnosis names them. Many waves of one joint together may stand for an error of its
//! angle that is not periodic. A sweep of one joint in steps of a degree settles it.
//!
//! ## Plant
//! An amplitude and a phase, added to the command before the joint's spring is set to rest there.
//!
//! ## Sources
//! Tuttle, Seering 1996, *A nonlinear model of a harmonic drive gear transmission*, IEEE Trans. Robotics and
//! Automation 12(3), 368-374. The scan: Baluev 2008, *Assessing the statistical significance of periodogram peaks*,
//! MNRAS 385, 1279.

use super::options::{List, Numbers, PerJoint};
use super::{Effect, Parameter, Place, Role, Stage, turning};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Ripple of the observed turning joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GearRipple {
    /// Cycles per output turn.
    cycles: Option<PerJoint<List>>,
}

/// Two cycles per input turn of a gear of ratio 100.
const USUAL: f64 = 200.0;

impl GearRipple {
    /// As [`Effect::waves`], without the list: predictions ask for them at every reading.
    fn each_wave<'a>(&'a self, setup: &'a Setup) -> impl Iterator<Item = (usize, f64)> + 'a {
        turning(setup).flat_map(|joint| {
            let cycles: &[f64] = match &self.cycles {
                None => &[USUAL],
                Some(given) => {
                    let found = given.of(&setup.robot.joints[joint].name);
                    found.map_or(&[], Numbers::numbers)
                }
            };
            cycles.iter().map(move |&cycles| (joint, cycles))
        })
    }
}

impl Effect for GearRipple {
    const ID: &'static str = "gear_ripple";
    const STAGE: Stage = Stage::Rigid;
    const ROLE: Option<Role> = Some(Role::Ripple);

    fn waves(&self, setup: &Setup) -> Vec<(usize, f64)> {
        self.each_wave(setup).collect()
    }

    fn check(&self, setup: &Setup) -> Result<(), String> {
        PerJoint::check(self.cycles.as_ref(), "cycles", setup)
    }

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_wave = |(joint, cycles): (usize, f64)| {
            let name = &setup.robot.joints[joint].name;
            ["sin", "cos"].map(|term| {
                Parameter::new(format!("{name}.{term}{cycles}"), "rad", 3e-5)
                    .at(Place::Joint(joint))
            })
        };
        self.each_wave(setup).flat_map(of_wave).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for ((joint, cycles), p) in self.each_wave(posture.setup).zip(p.chunks_exact(2)) {
            let cycles: S = constant(cycles);
            let (sin, cos) = (posture.q(joint) * cycles).sin_cos();
            posture.move_joint(joint, p[0] * sin + p[1] * cos);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let waves: Vec<(usize, f64, f64, f64)> = self
            .each_wave(setup)
            .zip(p.chunks_exact(2))
            .map(|((joint, cycles), p)| (joint, cycles, p[0].hypot(p[1]), p[1].atan2(p[0])))
            .collect();
        plant.command_laws.push(Arc::new(move |command, angles| {
            for &(joint, cycles, amplitude, phase) in &waves {
                angles[joint] += amplitude * (cycles * command.joints[joint] + phase).sin();
            }
        }));
        Ok(())
    }
}
