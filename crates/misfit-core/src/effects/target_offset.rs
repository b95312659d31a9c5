//! Where each target sits on its link: the pose of the reflector or 6D probe in the link's frame.
//!
//! ## Law
//! `link_from_target = (x, y, z; rx, ry, rz)` for each target: translation in m and rotation vector in rad,
//! in the link's frame. Not small: any pose can be represented.
//!
//! ## Signature
//! A vector that turns with the link. Estimated whenever the campaign marks it `"estimate"`.
//!
//! ## Confused with
//! A constant motion of the last node (`geometry` of the last joint): exactly the same with one target. The
//! offset of the last joint, if the target's orientation is free. Without orientation readings the three
//! angles are in no reading at all.
//!
//! ## Plant
//! The instrument layer mounts the target there.
//!
//! ## Sources
//! Mooring, Roth, Driels 1991, *Fundamentals of Manipulator Calibration*, ch. 3.

use super::tracker_frame::{POSE, isometry, pose};
use super::{Effect, Parameter, Place, Role, Stage};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;

/// Poses of the targets on their links.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TargetOffset {}

impl Effect for TargetOffset {
    const ID: &'static str = "target_offset";
    const STAGE: Stage = Stage::Instrument;
    const ROLE: Option<Role> = Some(Role::TargetFrame);

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        let of_target = |(index, target): (usize, &crate::campaign::Target)| {
            POSE.map(|(name, unit, typical)| {
                Parameter::new(format!("{}.{name}", target.name), unit, typical)
                    .at(Place::Target(index))
            })
        };
        setup
            .targets
            .iter()
            .enumerate()
            .flat_map(of_target)
            .collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        let first = 6 * posture.reading.target;
        posture.link_from_target = posture.link_from_target * pose(&p[first..first + 6]);
    }

    fn install(&self, p: &[f64], _: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (target, p) in plant.targets.iter_mut().zip(p.chunks_exact(6)) {
            target.1 *= isometry(p);
        }
        Ok(())
    }
}
