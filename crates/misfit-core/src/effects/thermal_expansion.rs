//! Links grow with temperature.
//!
//! ## Law
//! Every distance from a joint to what its body carries (next joint, target's link, centre of mass) is `(1 + α ΔT)` times
//! the nominal one, `ΔT` the body's temperature above the campaign's mean (K), of the link itself where it was measured.
//! One `α` in 1/K for all links: 12e-6 for steel, 23e-6 for aluminium.
//!
//! ## Signature
//! Follows the temperature, and with it often the time, along the links: position errors of stretched arms, no turns.
//!
//! ## Confused with
//! `frame_drift` (13 to 25 % absorbed) while the robot warms up steadily, a scale of the tracker that varies with the air.
//! Poses in random order, the same anchor poses again and again, and a full cooling tell them apart.
//!
//! ## Plant
//! MuJoCo's bodies are moved outwards by that much, for each command.
//!
//! ## Sources
//! Le Reun et al., Robotica 2022 (scatter of 0.15 mm over 6.5 h, 0.05 mm once compensated).

use super::{Effect, Need, Parameter, Role, Stage};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Deserialize;

/// One coefficient for all links.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThermalExpansion {}

/// The bodies that carry a target, base first, and where on each the next one (last: the target's link) sits.
fn stations(setup: &Setup, target: usize) -> Vec<(usize, Vector3<f64>)> {
    let link = &setup.robot.links[setup.targets[target].link];
    let mut stations = Vec::new();
    let mut body = 0;
    for joint in setup.robot.chain(link.body) {
        let origin = setup.robot.joints[joint].parent_from_joint;
        stations.push((body, origin.translation.vector));
        body = joint + 1;
    }
    stations.push((body, link.body_from_link.translation.vector));
    stations
}

impl Effect for ThermalExpansion {
    const ID: &'static str = "thermal_expansion";
    const STAGE: Stage = Stage::Rigid;
    const ROLE: Option<Role> = Some(Role::Thermal);
    const NEEDS: &'static [Need] = &[Need::Temperature];

    fn parameters(&self, _: &Setup) -> Vec<Parameter> {
        vec![Parameter::new("alpha", "1/K", 16e-6)]
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let setup = posture.setup;
        for (body, end) in stations(setup, posture.reading.target) {
            let growth = p[0] * posture.temperature(body);
            // the node moves its body whole, and so the end by as much as it should; the centre of mass too far
            let back: Vector3<f64> = setup.robot.bodies[body].com - end;
            for k in 0..3 {
                posture.move_node(body, k, growth * constant(end[k]));
            }
            posture.move_com(body, [0, 1, 2].map(|k| growth * constant(back[k])));
        }
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        plant.expansion += p[0];
        Ok(())
    }
}
