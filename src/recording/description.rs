//! The robot as viewers want it: a URDF.

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
        let (lower, upper) = joint.limits.unwrap_or((-1e3, 1e3));
        let kind = match joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
        };
        line(format_args!(
            "  <joint name=\"{}\" type=\"{kind}\">{}<parent link=\"{}\"/><child link=\"{}\"/><axis xyz=\"{:?} {:?} {:?}\"/><limit lower=\"{lower:?}\" upper=\"{upper:?}\" effort=\"0\" velocity=\"0\"/></joint>",
            escaped(&joint.name),
            origin(&joint.parent_from_joint),
            escaped(&parent.name),
            escaped(&child.name),
            joint.axis.x,
            joint.axis.y,
            joint.axis.z
        ));
    }
    for link in &robot.links {
        if let Some(body) = robot.bodies.get(link.body)
            && body.name != link.name
        {
            let name = escaped(&link.name);
            line(format_args!(
                "  <joint name=\"{name}_fixed\" type=\"fixed\">{}<parent link=\"{}\"/><child link=\"{name}\"/></joint>",
                origin(&link.body_from_link),
                escaped(&body.name)
            ));
        }
    }
    line(format_args!("</robot>"));
    text
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
