//! Tilting of each joint's bearing under moments across its axis.
//!
//! ## Law
//! Behind joint `j` a rotation `k_j m_⊥`, `m_⊥` the load's moment about the joint frame's origin without its part along
//! the axis, N·m, and `k_j` in rad/(N·m): one compliance for both transverse axes.
//!
//! ## Signature
//! Proportional to the load, and to its moments *across* the axis, which no gear feels.
//!
//! ## Confused with
//! `link_flexibility`, of which it takes up 95 % (and that 61 % of this): only the share of force and moment in a load
//! tells them apart. `base_compliance` for the first joint. Poses with large moments across the axes show it best.
//!
//! ## Plant
//! Two more hinges across the axis, with springs.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810); Abele, Weigold,
//! Rothenbücher 2007, *Modeling and identification of an industrial robot for machining applications*, CIRP Annals 56(1).

use super::{Effect, Need, Parameter, Place, Stage, at_least_zero};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{Carried, Flexure, PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

/// Bearings of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BearingTilt {}

impl Effect for BearingTilt {
    const ID: &'static str = "bearing_tilt";
    const STAGE: Stage = Stage::Elastic;
    const NEEDS: &'static [Need] = &[Need::Load];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_joint = |&joint: &usize| {
            Parameter::new(&setup.robot.joints[joint].name, "rad/(N·m)", 3e-6)
                .at_least(0.0)
                .at(Place::Joint(joint))
        };
        setup.observed.iter().map(of_joint).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &compliance) in posture.setup.observed.iter().zip(p) {
            let axis: Vector3<S> = posture.setup.robot.joints[joint].axis.map(constant);
            let moment = posture.wrenches[joint + 1].fixed_rows::<3>(3).into_owned();
            let across = moment - axis * axis.dot(&moment);
            for k in 0..3 {
                posture.move_node(joint + 1, 3 + k, compliance * across[k]);
            }
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (&joint, &compliance) in setup.observed.iter().zip(p) {
            let (name, axis) = {
                let joint = &setup.robot.joints[joint];
                (&joint.name, *joint.axis)
            };
            at_least_zero(Self::ID, name, compliance)?;
            if compliance == 0.0 {
                continue;
            }
            // the pivot's z lies along the axis, and stays rigid
            let turned =
                UnitQuaternion::rotation_between(&Vector3::z(), &axis).unwrap_or_else(|| {
                    UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI)
                });
            let spring = Some(1.0 / compliance);
            plant.flexures.push(Flexure {
                carries: Carried::Body(joint + 1),
                pivot: Isometry3::from_parts(Translation3::identity(), turned),
                stiffness: [spring, spring, None, None, None, None],
            });
        }
        Ok(())
    }
}
