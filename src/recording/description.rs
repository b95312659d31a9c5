//! The robot as viewers want it: a URDF.

use super::transforms::body_from_frame;
use crate::campaign::RobotFile;
use crate::robot::{JointKind, Robot, Shape};
use nalgebra::Isometry3;
use std::fmt::Write;

/// The robot file itself if it is a URDF, else a URDF with the same frames and shapes.
pub(super) fn urdf(robot: &Robot, file: &RobotFile) -> String {
    if file.name.to_lowercase().ends_with(".toml") {
        generated(robot)
    } else {
        file.text.clone()
    }
}

/// Links and joints only: what is seen, not what is weighed.
fn generated(robot: &Robot) -> String {
    let mut text = String::from("<?xml version=\"1.0\"?>\n");
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{words}");
    };
    line(format_args!("<robot name=\"{}\">", escaped(&robot.name)));
    for link in &robot.links {
        line(format_args!("  <link name=\"{}\">", escaped(&link.name)));
        for visual in &link.visuals {
            let shape = match visual.shape {
                Shape::Box([x, y, z]) => format!("<box size=\"{x:?} {y:?} {z:?}\"/>"),
                Shape::Cylinder(r, l) => {
                    format!("<cylinder radius=\"{r:?}\" length=\"{l:?}\"/>")
                }
                Shape::Sphere(r) => format!("<sphere radius=\"{r:?}\"/>"),
            };
            let [r, g, b, a] = visual.rgba;
            line(format_args!(
                "    <visual>{}<geometry>{shape}</geometry><material name=\"{r:?} {g:?} {b:?} {a:?}\"><color rgba=\"{r:?} {g:?} {b:?} {a:?}\"/></material></visual>",
                origin(&visual.link_from_shape)
            ));
        }
        line(format_args!("  </link>"));
    }
    for (index, joint) in robot.joints.iter().enumerate() {
        let (Some(parent), Some(child)) =
            (robot.bodies.get(joint.parent), robot.bodies.get(index + 1))
        else {
            continue;
        };
        let parent_from_joint =
            body_from_frame(robot, joint.parent).inverse() * joint.parent_from_joint;
        // A URDF joint moves its child link's own frame; where the link stands elsewhere on the
        // body (standard DH tables), a link without shape comes between.
        let joint_from_child = body_from_frame(robot, index + 1);
        let mut child = escaped(&child.name);
        if joint_from_child != Isometry3::identity() {
            let between = format!("{child}_axis");
            line(format_args!("  <link name=\"{between}\"/>"));
            fixed(&mut line, &between, &child, &joint_from_child);
            child = between;
        }
        let (lower, upper) = joint.limits.unwrap_or((-1e3, 1e3));
        let kind = match joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
        };
        line(format_args!(
            "  <joint name=\"{}\" type=\"{kind}\">{}<parent link=\"{}\"/><child link=\"{child}\"/><axis xyz=\"{:?} {:?} {:?}\"/><limit lower=\"{lower:?}\" upper=\"{upper:?}\" effort=\"0\" velocity=\"0\"/></joint>",
            escaped(&joint.name),
            origin(&parent_from_joint),
            escaped(&parent.name),
            joint.axis.x,
            joint.axis.y,
            joint.axis.z
        ));
    }
    for link in &robot.links {
        if let Some(body) = robot.bodies.get(link.body)
            && body.name != link.name
        {
            let pose = body_from_frame(robot, link.body).inverse() * link.body_from_link;
            fixed(&mut line, &escaped(&body.name), &escaped(&link.name), &pose);
        }
    }
    line(format_args!("</robot>"));
    text
}

fn fixed(
    line: &mut impl FnMut(std::fmt::Arguments<'_>),
    parent: &str,
    child: &str,
    parent_from_child: &Isometry3<f64>,
) {
    line(format_args!(
        "  <joint name=\"{child}_fixed\" type=\"fixed\">{}<parent link=\"{parent}\"/><child link=\"{child}\"/></joint>",
        origin(parent_from_child)
    ));
}

fn origin(pose: &Isometry3<f64>) -> String {
    let t = &pose.translation.vector;
    let (roll, pitch, yaw) = pose.rotation.euler_angles();
    format!(
        "<origin xyz=\"{:?} {:?} {:?}\" rpy=\"{roll:?} {pitch:?} {yaw:?}\"/>",
        t.x, t.y, t.z
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::super::messages::{Header, Time, TransformStamped};
    use super::super::transforms::{links, moving};
    use super::*;
    use nalgebra::{Quaternion, Translation3, UnitQuaternion};
    use std::collections::BTreeMap;

    fn frames(robot: &Robot, joints: &[f64]) -> BTreeMap<String, Isometry3<f64>> {
        let header = Header {
            stamp: Time { sec: 0, nanosec: 0 },
            frame_id: String::new(),
        };
        let mut poses = BTreeMap::from([(robot.bodies[0].name.clone(), Isometry3::identity())]);
        let mut add = |t: &TransformStamped| {
            let (x, q) = (&t.translation, &t.rotation);
            let pose = Isometry3::from_parts(
                Translation3::new(x.x, x.y, x.z),
                UnitQuaternion::new_normalize(Quaternion::new(q.w, q.x, q.y, q.z)),
            );
            let pose = poses[&t.header.frame_id] * pose;
            poses.insert(t.child_frame_id.clone(), pose);
        };
        moving(robot, joints, &header).iter().for_each(&mut add);
        links(robot, &header).iter().for_each(&mut add);
        poses
    }

    #[test]
    fn a_dh_table_becomes_a_urdf_with_the_same_frames() {
        for convention in ["standard", "modified"] {
            let table = format!(
                "name = \"a & b\"\nconvention = \"{convention}\"\n[base]\nxyz_m = [0.1, 0.2, 0.3]\n\
                 [[joint]]\nname = \"j1\"\nalpha_deg = 90\na_mm = 150\nd_mm = 243\ntheta_deg = 30\n\
                 [[joint]]\nname = \"j2\"\nalpha_deg = -40\na_mm = 70\nd_mm = -43\n\
                 [[joint]]\nname = \"j3\"\nkind = \"prismatic\"\nalpha_deg = 20\na_mm = 30\n\
                 [tool]\nxyz_m = [0.0, 0.1, 0.2]\nrpy_deg = [10, 20, 30]\n"
            );
            let robot = Robot::parse("arm.toml", &table, None).unwrap();
            let copy = Robot::parse("arm.urdf", &generated(&robot), None).unwrap();
            let joints = [0.3, -0.7, 0.2];
            let (wanted, got) = (frames(&robot, &joints), frames(&copy, &joints));
            for (name, pose) in wanted {
                let gap = pose.inverse() * got[&name];
                assert!(
                    gap.translation.vector.norm() + gap.rotation.angle() < 1e-12,
                    "{convention}: {name} is off by {gap}"
                );
            }
        }
    }
}
