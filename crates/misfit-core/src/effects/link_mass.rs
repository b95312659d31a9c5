//! Wrong masses of the links: a body weighs more than the robot file says.
//!
//! ## Law
//! The mass of the body behind each observed joint is `m + dm`, kg, at its nominal centre. A mass can be less, but not
//! negative.
//!
//! ## Signature
//! A deflection there already without a load: sine and cosine of the link's pitch. Works through the springs alone: a
//! rigid arm does not show it.
//!
//! ## Confused with
//! Nearly everything: geometry and compliances take up 91 % of it, `joint_hardening` 39 %, `bearing_tilt` 34 %. The
//! weakest family of all: 20 to 45 % of a link's mass can be named at best. Unloaded poses over a wide range of pitch
//! help, and torques from motor currents.
//!
//! ## Plant
//! MuJoCo's body weighs that much more.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810).

use super::{Effect, Need, Parameter, Place, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;

/// Masses of the bodies that the observed joints move.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkMass {}

/// Typical error as a share of a mass.
const SHARE: f64 = 0.1;
/// Typical error where the robot file gives no mass, kg.
const UNKNOWN: f64 = 0.2;

impl Effect for LinkMass {
    const ID: &'static str = "link_mass";
    const STAGE: Stage = Stage::Load;
    const NEEDS: &'static [Need] = &[Need::Gravity];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_joint = |&joint: &usize| {
            let mass = setup.robot.bodies[joint + 1].mass;
            let typical = if mass > 0.0 { SHARE * mass } else { UNKNOWN };
            Parameter::new(&setup.robot.joints[joint].name, "kg", typical)
                .at_least(-mass)
                .at(Place::Joint(joint))
        };
        setup.observed.iter().map(of_joint).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &by) in posture.setup.observed.iter().zip(p) {
            posture.add_mass(joint + 1, by);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (&joint, &by) in setup.observed.iter().zip(p) {
            let body = &mut plant.robot.bodies[joint + 1];
            body.mass += by;
            if !(body.mass.is_finite() && body.mass >= 0.0) {
                return Err(SpecError::Value {
                    effect: Self::ID,
                    parameter: setup.robot.joints[joint].name.clone(),
                    found: by,
                    accepted: "no more taken away than the body weighs",
                });
            }
        }
        Ok(())
    }
}
