//! Where every frame of the robot stands: for viewers, computed from the nominal robot.

use super::messages::{Header, Time, TransformStamped, Xyz, Xyzw};
use crate::campaign::{Campaign, Frame, unit_quaternion};
use crate::robot::Robot;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::borrow::Cow;

/// Name of the tracker's frame, unlike any link's.
pub(super) fn tracker_frame(robot: &Robot) -> String {
    let mut name = String::from("tracker");
    while robot.links.iter().any(|link| link.name == name) {
        name.push('_');
    }
    name
}

/// The tracker if its place is known: from the campaign, or as `found`.
pub(super) fn tracker<'a>(
    campaign: &'a Campaign,
    found: Option<&Isometry3<f64>>,
    stamp: Time,
) -> Option<TransformStamped<'a>> {
    let robot = &campaign.robot;
    let base_from_tracker = match campaign.base_from_tracker {
        Frame::Known(pose) => pose,
        Frame::Estimate => *found?,
    };
    // The first body's frame need not be that of the link it is named after.
    let link_from_tracker = robot.body_from_frame(0).inverse() * base_from_tracker;
    let base = &robot.bodies.first()?.name;
    let child = tracker_frame(robot);
    Some(stamped(stamp, base, child, &link_from_tracker))
}

/// Links in the frame of the first link of their body, `before` each name.
pub(super) fn links<'a>(robot: &'a Robot, before: &str, stamp: Time) -> Vec<TransformStamped<'a>> {
    let mut transforms = Vec::new();
    for link in &robot.links {
        if let Some(body) = robot.bodies.get(link.body)
            && body.name != link.name
        {
            let pose = robot.body_from_frame(link.body).inverse() * link.body_from_link;
            let (parent, child) = (format!("{before}{}", body.name), &link.name);
            transforms.push(stamped(stamp, parent, format!("{before}{child}"), &pose));
        }
    }
    transforms
}

/// These joints at these angles, rad or m.
pub(super) fn moving<'a>(
    robot: &'a Robot,
    joints: &[f64],
    stamp: Time,
    wanted: impl Fn(usize) -> bool,
) -> Vec<TransformStamped<'a>> {
    let mut transforms = Vec::with_capacity(robot.joints.len());
    for (index, (joint, q)) in robot.joints.iter().zip(joints).enumerate() {
        if wanted(index)
            && let (Some(parent), Some(child)) =
                (robot.bodies.get(joint.parent), robot.bodies.get(index + 1))
        {
            let pose = robot.body_from_frame(joint.parent).inverse()
                * joint.parent_from_joint
                * joint.motion(*q)
                * robot.body_from_frame(index + 1);
            transforms.push(stamped(stamp, &parent.name, &child.name, &pose));
        }
    }
    transforms
}

/// Pose of a frame in its parent's.
pub(super) fn stamped<'a>(
    stamp: Time,
    parent: impl Into<Cow<'a, str>>,
    child: impl Into<Cow<'a, str>>,
    parent_from_child: &Isometry3<f64>,
) -> TransformStamped<'a> {
    TransformStamped {
        header: Header {
            stamp,
            frame_id: parent.into(),
        },
        child_frame_id: child.into(),
        translation: xyz(&parent_from_child.translation.vector),
        rotation: xyzw(&parent_from_child.rotation),
    }
}

/// A pose from its numbers.
pub(super) fn pose(position: &Xyz, q: &Xyzw) -> Result<Isometry3<f64>, String> {
    let rotation = unit_quaternion([q.w, q.x, q.y, q.z])
        .map_err(|norm| format!("a quaternion of norm {norm}; accepted: 1"))?;
    let translation = Translation3::new(position.x, position.y, position.z);
    Ok(Isometry3::from_parts(translation, rotation))
}

pub(super) fn xyz(v: &Vector3<f64>) -> Xyz {
    Xyz {
        x: v.x,
        y: v.y,
        z: v.z,
    }
}

pub(super) fn xyzw(q: &UnitQuaternion<f64>) -> Xyzw {
    Xyzw {
        x: q.i,
        y: q.j,
        z: q.k,
        w: q.w,
    }
}
