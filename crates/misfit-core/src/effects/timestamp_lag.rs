//! Tracker and encoders are read at different moments, or the arm had not come to rest.
//!
//! ## Law
//! `dq_j = T v s_j`: one time `T` for all joints (s), `s_j` the direction of the joint's last motion and `v` the speed of
//! approach. Readings carry no speeds: `v` is the option `speed`, nominal for every joint (0.1 rad/s, for sliding
//! joints m/s; 0.1 by default), so that only the product is known.
//!
//! ## Signature
//! Flips with the direction of approach, in one common ratio for all joints. Gone when every reading waits for rest.
//!
//! ## Confused with
//! `backlash`, of which it is exactly the case that all joints lose the same motion: where this explains a campaign,
//! backlash does too, with more parameters.
//!
//! ## Plant
//! The joints stand where they were a moment before they arrive: short of the command, or beyond it.
//!
//! ## Sources
//! ISO 9283:1998 (position stabilization time).

use super::{Effect, Need, Parameter, Stage};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// One lag for all observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimestampLag {
    /// Speed of approach, rad/s (m/s).
    #[serde(default = "usual")]
    speed: f64,
}

fn usual() -> f64 {
    0.1
}

impl Effect for TimestampLag {
    const ID: &'static str = "timestamp_lag";
    const STAGE: Stage = Stage::Rigid;
    const OF_MEASUREMENT: bool = true;
    const NEEDS: &'static [Need] = &[Need::Approach];

    fn check(&self, _: &Setup) -> Result<(), String> {
        if self.speed.is_finite() && self.speed > 0.0 {
            return Ok(());
        }
        Err(format!(
            "speed is {}; accepted: a number above 0",
            self.speed
        ))
    }

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        vec![Parameter::new("lag", "s", 1e-3)]
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let speed: S = constant(self.speed);
        for &joint in &posture.setup.observed {
            let side = posture.approach(joint);
            posture.move_joint(joint, p[0] * speed * side);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let (observed, travel) = (setup.observed.clone(), p[0] * self.speed);
        plant.command_laws.push(Arc::new(move |command, angles| {
            for &joint in &observed {
                angles[joint] += travel * command.approach[joint];
            }
        }));
        Ok(())
    }
}
