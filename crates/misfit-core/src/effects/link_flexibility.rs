//! Bending of the links: each is a beam from its joint to the next joint or to the target's link.
//!
//! ## Law
//! An Euler beam of length `L` along the straight line from the joint frame's origin to the origin of the next observed
//! joint, or of the target's link on the last body. Its end is shifted by `L³F/3EI + L²M/2EI` and turned by
//! `L²F/2EI + LM/EI`, `F` and `M` the load across the beam at its end. One parameter a link: `1/EI` in 1/(N·m²). A link
//! without length has none, nor has one from whose body several arms or targets at different places go on. The link's own
//! weight counts as if it were fixed to the beam's end; torsion is `joint_compliance`.
//!
//! ## Signature
//! Proportional to the load; rotation and shift in the ratio `2L/3` under a pure force.
//!
//! ## Confused with
//! `bearing_tilt`, which takes up 95 % of it; both keep less than a tenth of their signal beside compliances and geometry.
//! Loads that differ in the ratio of force to moment (another lever) tell them apart.
//!
//! ## Plant
//! A sprung connection in the middle of the beam, where a beam's compliance is diagonal: two hinges of `EI/L` and two
//! slides of `12EI/L³` across it.
//!
//! ## Sources
//! Any textbook on the strength of materials (cantilever beam); Klimchik et al., ICINCO 2014 (arXiv:1311.6810).

use super::{Effect, Need, Parameter, Place, Stage, at_least_zero};
use crate::dual_quaternion::{Scalar, constant};
use crate::plant::{Carried, Flexure, PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

/// Beams of the observed links.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LinkFlexibility {}

/// Links shorter than this do not bend, m.
const SHORTEST: f64 = 1e-3;

/// The joints whose links bend, and where their links end, in the frame that the joint moves, m.
fn beams(setup: &Setup) -> Vec<(usize, Vector3<f64>)> {
    let robot = &setup.robot;
    let end_of = |&joint: &usize| {
        let body = joint + 1;
        let next = setup.observed.iter().map(|&next| &robot.joints[next]);
        let next = next.filter(|next| next.parent == body);
        let links = setup.targets.iter().map(|target| &robot.links[target.link]);
        let links = links.filter(|link| link.body == body);
        let mut ends = next
            .map(|next| next.parent_from_joint.translation.vector)
            .chain(links.map(|link| link.body_from_link.translation.vector));
        let first = ends.next()?;
        let single = ends.all(|end| (end - first).norm() < SHORTEST);
        (single && first.norm() >= SHORTEST).then_some((joint, first))
    };
    setup.observed.iter().filter_map(end_of).collect()
}

impl Effect for LinkFlexibility {
    const ID: &'static str = "link_flexibility";
    const STAGE: Stage = Stage::Elastic;
    const NEEDS: &'static [Need] = &[Need::Load];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let beams = beams(setup).into_iter();
        beams
            .map(|(joint, _)| {
                let name = &setup.robot.joints[joint].name;
                Parameter::new(name, "1/(N·m²)", 3e-6)
                    .at_least(0.0)
                    .at(Place::Joint(joint))
            })
            .collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for ((joint, end), &bend) in beams(posture.setup).into_iter().zip(p) {
            let length = end.norm();
            let axis: Vector3<S> = (end / length).map(constant);
            let end: Vector3<S> = end.map(constant);
            let across = |v: Vector3<S>| v - axis * axis.dot(&v);
            let wrench = &posture.wrenches[joint + 1];
            let force = across(wrench.fixed_rows::<3>(0).into_owned());
            let moment = wrench.fixed_rows::<3>(3).into_owned();
            let moment = across(moment - end.cross(&force));
            let of = |power: i32, part: f64| bend * constant::<S>(length.powi(power) / part);
            let shift = force * of(3, 3.0) + moment.cross(&axis) * of(2, 2.0);
            let turn = axis.cross(&force) * of(2, 2.0) + moment * of(1, 1.0);
            // the node turns about the joint: shifted so that the beam's end is where it should be
            let shift = shift - turn.cross(&end);
            for k in 0..3 {
                posture.move_node(joint + 1, k, shift[k]);
                posture.move_node(joint + 1, 3 + k, turn[k]);
            }
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for ((joint, end), &bend) in beams(setup).into_iter().zip(p) {
            at_least_zero(Self::ID, &setup.robot.joints[joint].name, bend)?;
            if bend == 0.0 {
                continue;
            }
            // x along the beam
            let turned =
                UnitQuaternion::rotation_between(&Vector3::x(), &end).unwrap_or_else(|| {
                    UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::PI)
                });
            let (rigidity, length) = (1.0 / bend, end.norm());
            let hinge = Some(rigidity / length);
            let slide = Some(12.0 * rigidity / (length * length * length));
            plant.flexures.push(Flexure {
                carries: Carried::Body(joint + 1),
                pivot: Isometry3::from_parts(Translation3::from(end / 2.0), turned),
                stiffness: [None, hinge, hinge, None, slide, slide],
            });
        }
        Ok(())
    }
}
