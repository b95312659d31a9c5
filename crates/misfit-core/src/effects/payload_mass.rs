//! Wrong mass of the payload: it weighs a share more than the campaign says.
//!
//! ## Law
//! The payload's mass is `(1 + s) m`, one dimensionless `s` for all payloads.
//!
//! ## Signature
//! Proportional to the load: through the springs into the pose, straight into a wrist sensor.
//!
//! ## Confused with
//! `ft_gain` of all axes together (exactly, in the wrist sensor), and a common factor of all compliances (exactly, in
//! poses). Only weighing the payload settles it.
//!
//! ## Plant
//! The load in MuJoCo weighs that much more.
//!
//! ## Sources
//! Swevers, Verdonck, De Schutter 2007, *Dynamic model identification for industrial robots*, IEEE Control Systems 27(5)
//! (payload identification).

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// One relative error for all payloads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PayloadMass {}

impl Effect for PayloadMass {
    const ID: &'static str = "payload_mass";
    const STAGE: Stage = Stage::Load;
    const NEEDS: &'static [Need] = &[Need::Payload];
    const ALIASES: &'static [&'static str] = &["ft_gain"];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        vec![Parameter::new("share", "kg/kg", 1e-2).at_least(-1.0)]
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        if let Some(payload) = posture.reading.payload {
            posture.add_payload_mass(p[0] * constant(payload.mass));
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let factor = 1.0 + p[0];
        if !(factor.is_finite() && factor >= 0.0) {
            return Err(SpecError::Value {
                effect: Self::ID,
                parameter: "share".to_owned(),
                found: p[0],
                accepted: "-1 (no mass at all) or more",
            });
        }
        plant
            .load_laws
            .push(Arc::new(move |_, load| load.mass *= factor));
        Ok(())
    }
}
