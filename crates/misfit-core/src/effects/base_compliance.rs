//! Compliance of the pedestal: the whole robot leans and turns on its foundation.
//!
//! ## Law
//! A rotation `(k_x m_x, k_y m_y, k_z m_z)` of everything about the origin of the base frame, `m` the moment there of all
//! weights and loads, N·m; compliances in rad/(N·m).
//!
//! ## Signature
//! Common to all arms on the base, and proportional to the moment at its foot. Weights make no moment about gravity's
//! direction: that compliance is in no reading of a hanging load.
//!
//! ## Confused with
//! `bearing_tilt` of the first joint (the pivot's height is the only difference), `frame_drift` if loads vary with time.
//! Loads on opposite sides help; a reflector on the pedestal settles it at once.
//!
//! ## Plant
//! Three hinges with springs under the base body.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810).

use super::{Effect, Need, Parameter, Stage, at_least_zero};
use crate::dual_quaternion::Scalar;
use crate::plant::{Carried, Flexure, PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::Isometry3;
use serde::Deserialize;

/// Three compliances of the pedestal.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BaseCompliance {}

const AXES: [&str; 3] = ["x", "y", "z"];

impl Effect for BaseCompliance {
    const ID: &'static str = "base_compliance";
    const STAGE: Stage = Stage::Elastic;
    const NEEDS: &'static [Need] = &[Need::Load];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        AXES.map(|axis| Parameter::new(axis, "rad/(N·m)", 1e-6).at_least(0.0))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (k, &compliance) in p.iter().enumerate() {
            let moment = posture.wrenches[0][3 + k];
            posture.move_node(0, 3 + k, compliance * moment);
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let mut stiffness = [None; 6];
        for ((name, &compliance), stiffness) in AXES.iter().zip(p).zip(&mut stiffness) {
            at_least_zero(Self::ID, name, compliance)?;
            *stiffness = (compliance > 0.0).then(|| 1.0 / compliance);
        }
        if stiffness.iter().any(Option::is_some) {
            plant.flexures.push(Flexure {
                carries: Carried::Body(0),
                pivot: Isometry3::identity(),
                stiffness,
            });
        }
        Ok(())
    }
}
