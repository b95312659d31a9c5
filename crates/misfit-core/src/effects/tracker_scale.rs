//! The tracker's distances are a share too long: its wavelength or the air is not what it assumes.
//!
//! ## Law
//! Positions in the tracker's frame are `(1 + s)` times the true ones, `s` dimensionless (m/m).
//!
//! ## Signature
//! Radial from the tracker; orientations are right.
//!
//! ## Confused with
//! Free `geometry`, exactly: a robot whose every length is a share longer looks the same. Never to be found beside it
//! without a scale bar, a known length among the readings. With nominal lengths trusted it can be estimated.
//!
//! ## Plant
//! The instrument layer scales the positions.
//!
//! ## Sources
//! Leica AT500 manual, p. 39, and ISO 10360-10:2021 (errors in proportion to the distance).

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;

/// One scale.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrackerScale {}

impl Effect for TrackerScale {
    const ID: &'static str = "tracker_scale";
    const STAGE: Stage = Stage::Instrument;
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::ScaleBar];
    const ALIASES: &'static [&'static str] = &["geometry"];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        vec![Parameter::new("scale", "m/m", 5e-6)]
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        posture.scale_tracker(p[0]);
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        plant.tracker_scale += p[0];
        Ok(())
    }
}
