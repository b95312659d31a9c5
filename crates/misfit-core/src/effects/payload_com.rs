//! Wrong centre of the payload: it hangs elsewhere on the flange than the campaign says.
//!
//! ## Law
//! The payload's centre is `c + (x, y, z)`, m, in the target link's frame, the same for every payload.
//!
//! ## Signature
//! Torques in proportion to the load that turn with the flange; in a wrist sensor, torque without force.
//!
//! ## Confused with
//! `ft_misalignment`, exactly across the line to the centre, as long as all loads have one centre; `ft_gain` (49 %) and
//! the torque part of `ft_bias`, if the flange is not turned about. A centre on the last joint's axis
//! is as good as none to that joint.
//!
//! ## Plant
//! The load in MuJoCo hangs there.
//!
//! ## Sources
//! Swevers, Verdonck, De Schutter 2007, *Dynamic model identification for industrial robots*, IEEE Control Systems 27(5)
//! (payload identification).

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Deserialize;
use std::sync::Arc;

/// One displacement for all payloads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PayloadCom {}

impl Effect for PayloadCom {
    const ID: &'static str = "payload_com";
    const STAGE: Stage = Stage::Load;
    const NEEDS: &'static [Need] = &[Need::Payload];
    const ALIASES: &'static [&'static str] = &["ft_misalignment"];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        ["x", "y", "z"]
            .map(|axis| Parameter::new(axis, "m", 3e-3))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        posture.move_payload([p[0], p[1], p[2]]);
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let by = Vector3::from_column_slice(p);
        plant
            .load_laws
            .push(Arc::new(move |_, load| load.com += by));
        Ok(())
    }
}
