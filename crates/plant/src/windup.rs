//! Wind-up laws: where the joints stand depends on the torque they bear, and the torque on where they stand.
//!
//! A fixed point outside the static solve: equilibrium, torques, laws, and again. Weights answer a wind-up by
//! about a hundredth of what caused it, so that few rounds end at rounding.

use super::{Command, Hanging, Plant, PlantError};
use std::sync::Arc;

/// Changes of a joint's rest this small end the search, rad (m).
const SETTLED: f64 = 1e-15;
/// Changes below this that shrink no more are rounding, rad (m).
const ROUNDING: f64 = 1e-12;
const ROUNDS: usize = 60;

impl Plant {
    /// Equilibrium with all wind-up laws; the torques of the torque laws in it.
    pub(super) fn wind_up(
        &mut self,
        command: &Command,
        rest: &[f64],
        hanging: &[Hanging],
    ) -> Result<Vec<f64>, PlantError> {
        let layout = Arc::clone(&self.layout);
        let mut at = rest.to_vec();
        let mut last = f64::INFINITY;
        let mut worst = 0;
        for _ in 0..ROUNDS {
            let law_torques = self.settle(&at, rest, hanging)?;
            if last <= SETTLED {
                return Ok(law_torques);
            }
            let (applied, bias) = (self.data.qfrc_applied(), self.data.qfrc_bias());
            let joints = layout.joints.iter();
            let borne: Vec<f64> = joints.map(|j| applied[j.dof] - bias[j.dof]).collect();
            let mut next = rest.to_vec();
            for law in &layout.windup_laws {
                law(command, &borne, &mut next);
            }
            if let Some(angle) = next.iter().find(|angle| !angle.is_finite()) {
                return Err(PlantError::Command(format!(
                    "a law makes an angle of {angle}"
                )));
            }
            let mut change = 0.0;
            for (joint, (next, at)) in next.iter().zip(&at).enumerate() {
                if (next - at).abs() > change {
                    change = (next - at).abs();
                    worst = joint;
                }
            }
            if change < ROUNDING && change >= last {
                return Ok(law_torques);
            }
            at = next;
            last = change;
        }
        Err(PlantError::NoEquilibrium {
            joint: format!("joint {} (winding up)", worst + 1),
            residual: last,
            iterations: ROUNDS,
        })
    }
}
