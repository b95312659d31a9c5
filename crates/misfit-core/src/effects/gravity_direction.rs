//! Gravity is not where the base frame says: the robot is not levelled.
//!
//! ## Law
//! Gravity is turned by small angles about the two base axes that lie most across it (x and y for an upright robot), rad.
//! About its own direction a turn changes nothing.
//!
//! ## Signature
//! All joint torques change a little, loaded or not; a wrist sensor sees its load hang aslant.
//!
//! ## Confused with
//! `tracker_frame`, as the tracker finds the base and not the level: pose readings keep 20 % of it. `ft_misalignment` in
//! one posture of the wrist. A level, or a wrist sensor in several postures, settles it.
//!
//! ## Plant
//! MuJoCo's own gravity, turned.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810) (gravity as the load).

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::{Rotation3, Vector3};
use serde::Deserialize;

/// Two tilts of gravity.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GravityDirection {}

/// The two base axes most across gravity.
fn axes(setup: &Setup) -> [usize; 2] {
    match setup.gravity.iamax() {
        _ if setup.gravity == Vector3::zeros() => [0, 1],
        0 => [1, 2],
        1 => [0, 2],
        _ => [0, 1],
    }
}

impl Effect for GravityDirection {
    const ID: &'static str = "gravity_direction";
    const STAGE: Stage = Stage::Load;
    const NEEDS: &'static [Need] = &[Need::Gravity];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        axes(setup)
            .map(|k| Parameter::new(["x", "y", "z"][k], "rad", 2e-3))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let mut tilt = Vector3::from_element(S::zero());
        for (k, &angle) in axes(posture.setup).into_iter().zip(p) {
            tilt[k] = angle;
        }
        let gravity: Vector3<S> = posture.setup.gravity.map(constant);
        posture.add_gravity(tilt.cross(&gravity).into());
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let mut tilt = Vector3::zeros();
        for (k, &angle) in axes(setup).into_iter().zip(p) {
            tilt[k] = angle;
        }
        plant.gravity = Rotation3::new(tilt) * plant.gravity;
        Ok(())
    }
}
