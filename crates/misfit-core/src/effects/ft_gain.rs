//! Wrong gains of the wrist sensor: each of its six axes reads a share too much.
//!
//! ## Law
//! Each component of the wrench in the target link's frame is `(1 + g)` times the true one, six dimensionless `g`.
//!
//! ## Signature
//! In proportion to the load, in the wrist sensor only. Where the sensor is all that is known of the load, as a
//! compliance that is a share too small.
//!
//! ## Confused with
//! `payload_mass`, which all six axes together imitate exactly; `payload_com` (it takes up 49 %). A weight that was
//! weighed settles it.
//!
//! ## Plant
//! The instrument layer stretches what MuJoCo's sensor says.
//!
//! ## Sources
//! Six-axis sensors: crosstalk of about 1 % of the rated load (ME-Systeme); drift: arXiv:1812.00650.

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Deserialize;
use std::sync::Arc;

/// Six gains.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FtGain {}

const AXES: [(&str, &str); 6] = [
    ("fx", "N/N"),
    ("fy", "N/N"),
    ("fz", "N/N"),
    ("tx", "N·m/(N·m)"),
    ("ty", "N·m/(N·m)"),
    ("tz", "N·m/(N·m)"),
];

impl Effect for FtGain {
    const ID: &'static str = "ft_gain";
    const STAGE: Stage = Stage::Sensor;
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::WrenchBesidePayload];
    const ALIASES: &'static [&'static str] = &["payload_mass"];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        AXES.map(|(name, unit)| Parameter::new(name, unit, 1e-2))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (component, &gain) in p.iter().enumerate() {
            let by = gain * posture.sensed[component];
            posture.add_sensed(component, by);
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let force = Vector3::from_column_slice(&p[..3]).add_scalar(1.0);
        let torque = Vector3::from_column_slice(&p[3..]).add_scalar(1.0);
        plant.sensor_laws.push(Arc::new(move |wrench| {
            wrench.force.component_mul_assign(&force);
            wrench.torque.component_mul_assign(&torque);
        }));
        Ok(())
    }
}
