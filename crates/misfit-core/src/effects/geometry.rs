//! Constant geometric errors: links a little long, axes a little askew.
//!
//! ## Law
//! Behind every joint a constant small motion of all that follows: translation `x, y, z` (m), then rotation
//! vector `rx, ry, rz` (rad), in the frame that the joint moves. Six numbers a node hold every
//! Denavit-Hartenberg and Hayati error; those that leave every reading unchanged are found by the fit's
//! singular value decomposition, not assumed: with the frames, 4 a revolute joint and 6 in all can be seen.
//! Where the pedestal stands is `tracker_frame`'s; how it leans against gravity is no geometric error.
//!
//! ## Signature
//! Independent of load, direction and time; smooth in the joint angles, low harmonics. About 90 % of an
//! uncalibrated robot's error at low load.
//!
//! ## Confused with
//! `joint_offset` (contained in it), `tracker_frame` (a turn about the first axis is the same),
//! `target_offset` (the last node is the same with one target), a scale error of the tracker (exactly). Periodic gear errors keep
//! only 40 to 50 % of their signal beside it.
//!
//! ## Plant
//! What a body carries is moved inside MuJoCo's tree by the same translation and rotation.
//!
//! ## Sources
//! Klimchik et al., ICINCO 2014, *Complete Stiffness Model for a Serial Robot* (arXiv:1311.6810); Everett,
//! Driels, Mooring 1987 (number of identifiable parameters: 4 R + 2 P + 6).

use super::{Effect, Parameter, Place, Role, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::{NODE, Posture};
use crate::setup::Setup;
use nalgebra::{Isometry3, Vector3};
use serde::Deserialize;

/// Node motions of every observed joint.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Geometry {}

const COMPONENTS: [(&str, &str, f64); NODE] = [
    ("x", "m", 5e-4),
    ("y", "m", 5e-4),
    ("z", "m", 5e-4),
    ("rx", "rad", 1e-3),
    ("ry", "rad", 1e-3),
    ("rz", "rad", 1e-3),
];

/// The nodes behind the observed joints.
fn nodes(setup: &Setup) -> impl Iterator<Item = usize> + '_ {
    setup.observed.iter().map(|joint| joint + 1)
}

impl Effect for Geometry {
    const ID: &'static str = "geometry";
    const STAGE: Stage = Stage::Rigid;
    const ROLE: Option<Role> = Some(Role::Geometry);
    const ALIASES: &'static [&'static str] = &["joint_offset", "tracker_scale"];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_node = |node: usize| {
            let joint = node - 1;
            let name = &setup.robot.joints[joint].name;
            COMPONENTS.map(|(component, unit, typical)| {
                Parameter::new(format!("{name}.{component}"), unit, typical).at(Place::Joint(joint))
            })
        };
        nodes(setup).flat_map(of_node).collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (node, p) in nodes(posture.setup).zip(p.chunks_exact(NODE)) {
            for (component, &by) in p.iter().enumerate() {
                posture.move_node(node, component, by);
            }
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (node, p) in nodes(setup).zip(p.chunks_exact(NODE)) {
            let moved = Isometry3::new(
                Vector3::new(p[0], p[1], p[2]),
                Vector3::new(p[3], p[4], p[5]),
            );
            plant.body_from_displaced[node] *= moved;
        }
        Ok(())
    }
}
