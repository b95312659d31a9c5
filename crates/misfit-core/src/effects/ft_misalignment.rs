//! The wrist sensor is mounted askew: its axes are turned against the flange's.
//!
//! ## Law
//! The sensor's frame is turned by a small rotation vector `(rx, ry, rz)` in the target link's frame, rad: a wrench `w` is
//! read as `w - r × w`, force and torque alike.
//!
//! ## Signature
//! In proportion to the load and across it, in the wrist sensor only.
//!
//! ## Confused with
//! `payload_com`, exactly, as long as all loads have one centre `c` and the geometry is free: with
//! `r × (c × f) = c × (r × f) + (r × c) × f` a turned sensor is a turned flange, which target and geometry absorb, and a
//! centre that is off by `r × c`. Loads with different centres tell them apart. `gravity_direction` in one posture of
//! the wrist: that one keeps its direction in space, this one turns with the flange.
//!
//! ## Plant
//! The instrument layer expresses MuJoCo's wrench in a frame turned by the whole rotation.
//!
//! ## Sources
//! Six-axis sensors: crosstalk of about 1 % of the rated load (ME-Systeme), of which this is the antisymmetric part.

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::{Rotation3, Vector3};
use serde::Deserialize;
use std::sync::Arc;

/// Three small angles.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FtMisalignment {}

impl Effect for FtMisalignment {
    const ID: &'static str = "ft_misalignment";
    const STAGE: Stage = Stage::Sensor;
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::WrenchBesidePayload];
    const ALIASES: &'static [&'static str] = &["payload_com"];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        ["rx", "ry", "rz"]
            .map(|axis| Parameter::new(axis, "rad", 5e-3))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let turn = Vector3::new(p[0], p[1], p[2]);
        for first in [0, 3] {
            let part = posture.sensed.fixed_rows::<3>(first).into_owned();
            let by = part.cross(&turn);
            for k in 0..3 {
                posture.add_sensed(first + k, by[k]);
            }
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let back = Rotation3::new(Vector3::from_column_slice(p)).inverse();
        plant.sensor_laws.push(Arc::new(move |wrench| {
            wrench.force = back * wrench.force;
            wrench.torque = back * wrench.torque;
        }));
        Ok(())
    }
}
