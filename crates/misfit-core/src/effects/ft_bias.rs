//! Zero error of the wrist sensor: it reads a constant wrench without a load.
//!
//! ## Law
//! `(fx, fy, fz; tx, ty, tz)`, N and N·m, added to the wrench in the target link's frame.
//!
//! ## Signature
//! The same in every posture and under every load, in the wrist sensor only. Where the sensor is all that is known of the
//! load, as a load that is not there.
//!
//! ## Confused with
//! `payload_com` in its torques and a share of the payload in its forces, if the flange is not turned about.
//!
//! ## Plant
//! The instrument layer adds it to what MuJoCo's sensor says.
//!
//! ## Sources
//! Drift of six-axis sensors with temperature: arXiv:1812.00650.

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Deserialize;
use std::sync::Arc;

/// A constant wrench.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FtBias {}

/// Names of a wrench's numbers, with units and typical sizes.
const WRENCH: [(&str, &str, f64); 6] = [
    ("fx", "N", 0.5),
    ("fy", "N", 0.5),
    ("fz", "N", 0.5),
    ("tx", "N·m", 0.05),
    ("ty", "N·m", 0.05),
    ("tz", "N·m", 0.05),
];

impl Effect for FtBias {
    const ID: &'static str = "ft_bias";
    const STAGE: Stage = Stage::Sensor;
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::WrenchBesidePayload];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        WRENCH
            .map(|(name, unit, typical)| Parameter::new(name, unit, typical))
            .into()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (component, &by) in p.iter().enumerate() {
            posture.add_sensed(component, by);
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let force = Vector3::from_column_slice(&p[..3]);
        let torque = Vector3::from_column_slice(&p[3..]);
        plant.sensor_laws.push(Arc::new(move |wrench| {
            wrench.force += force;
            wrench.torque += torque;
        }));
        Ok(())
    }
}
