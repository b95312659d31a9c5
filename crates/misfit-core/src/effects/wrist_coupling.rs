//! Coupled wrist drives: a joint moves with the joints before it, because its shaft runs through them.
//!
//! ## Law
//! For the last three turning joints `a, b, c` of each arm: `dq_b = k_ba q_a`, `dq_c = k_ca q_a + k_cb q_b`, dimensionless
//! (rad/rad). The controller's coupling matrix should have removed this; what is left is its error.
//!
//! ## Signature
//! Linear in *another* joint's angle; independent of load, direction and time.
//!
//! ## Confused with
//! `gear_ratio` and `transmission_error` of the other joint (25 %), where poses move the wrist's joints together. A grid
//! over the three wrist angles tells them apart.
//!
//! ## Plant
//! Added to the command before the springs are set to rest there.
//!
//! ## Sources
//! Mooring, Roth, Driels 1991, *Fundamentals of Manipulator Calibration*, ch. 2 (coupled joint drives).

use super::{Effect, Parameter, Place, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::robot::JointKind;
use crate::setup::Setup;
use serde::Deserialize;
use std::sync::Arc;

/// Coupling errors of every arm's wrist.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WristCoupling {}

/// Who moves whom: places in a wrist of three.
const PAIRS: [(usize, usize); 3] = [(1, 0), (2, 0), (2, 1)];

/// The last three turning joints of each arm.
fn wrists(setup: &Setup) -> Vec<[usize; 3]> {
    let mut wrists = Vec::new();
    for target in 0..setup.targets.len() {
        let mut chain = setup.robot.chain(setup.target_body(target));
        chain.retain(|&joint| setup.robot.joints[joint].kind != JointKind::Prismatic);
        if let &[.., a, b, c] = &chain[..]
            && !wrists.contains(&[a, b, c])
        {
            wrists.push([a, b, c]);
        }
    }
    wrists
}

impl Effect for WristCoupling {
    const ID: &'static str = "wrist_coupling";
    const STAGE: Stage = Stage::Rigid;

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let name = |joint: usize| &setup.robot.joints[joint].name;
        let of_wrist = |wrist: [usize; 3]| {
            PAIRS.map(|(moved, by)| {
                let name = format!("{}.{}", name(wrist[moved]), name(wrist[by]));
                Parameter::new(name, "rad/rad", 1e-4).at(Place::Joint(wrist[moved]))
            })
        };
        wrists(setup).into_iter().flat_map(of_wrist).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let wrists = wrists(posture.setup);
        for (wrist, p) in wrists.into_iter().zip(p.chunks_exact(PAIRS.len())) {
            for ((moved, by), &k) in PAIRS.into_iter().zip(p) {
                let q = posture.q(wrist[by]);
                posture.move_joint(wrist[moved], k * q);
            }
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (wrist, p) in wrists(setup).into_iter().zip(p.chunks_exact(3)) {
            let (by_first, last_by_first, last_by_second) = (p[0], p[1], p[2]);
            plant.command_laws.push(Arc::new(move |command, angles| {
                let [first, second] = [wrist[0], wrist[1]].map(|joint| command.joints[joint]);
                angles[wrist[1]] += by_first * first;
                angles[wrist[2]] += last_by_first * first + last_by_second * second;
            }));
        }
        Ok(())
    }
}
