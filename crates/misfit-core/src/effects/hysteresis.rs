//! Friction that grows with the load: a gear stays wound up in the direction from which it was approached.
//!
//! ## Law
//! `dq_j = h_j s_j |τ_j|`, `s_j` the direction of the joint's last motion, `h_j` in rad/(N·m) (m/N); near zero torque the
//! bars are rounded off over 0.1 N·m. This is the rate-independent end of Dahl's and LuGre's models after a travel long
//! against their presliding distance: friction is then at its full value against the motion, and winds the gear up by its
//! compliance. Friction in the gear's mesh is in proportion to the torque: this effect. Friction of constant size winds it
//! up by a constant: that *is* `backlash`. Memory of reversals within the presliding distance is in neither.
//!
//! ## Signature
//! Flips with the direction of approach, and grows with the load: a contrast of load and direction together.
//!
//! ## Confused with
//! `backlash`, if only one load was measured. With two loads and both directions, nothing.
//!
//! ## Plant
//! Kept outside MuJoCo, whose friction creeps: the joint's rest follows approach and torque.
//!
//! ## Sources
//! Dhaouadi, Ghorbel, Gandhi 2003, *A new dynamic model of hysteresis in harmonic drives*, IEEE Trans. Industrial
//! Electronics 50(6); Ruderman 2012.

use super::{Effect, Need, Parameter, Stage, by_joint};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Load-dependent friction of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hysteresis {}

/// Torque over which the size of a torque is rounded off, N·m (N).
const ROUND: f64 = 0.1;

impl Effect for Hysteresis {
    const ID: &'static str = "hysteresis";
    const STAGE: Stage = Stage::Elastic;
    const NEEDS: &'static [Need] = &[Need::Approach, Need::Load];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad/(N·m)", 2e-6), ("m/N", 1e-8))
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let round: S = constant(ROUND);
        for (&joint, &friction) in posture.setup.observed.iter().zip(p) {
            let (torque, side) = (posture.torque(joint), posture.approach(joint));
            let size = (torque * torque + round * round).sqrt() - round;
            posture.move_joint(joint, friction * side * size);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        let joints = setup.observed.iter().copied();
        let rough: Vec<(usize, f64)> = joints.zip(p.iter().copied()).collect();
        plant
            .windup_laws
            .push(Arc::new(move |command, torques, angles| {
                for &(joint, friction) in &rough {
                    let size = torques[joint].hypot(0.1) - 0.1;
                    angles[joint] += friction * size * command.approach[joint];
                }
            }));
        Ok(())
    }
}
