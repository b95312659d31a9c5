//! A robot as a URDF: for viewers, and for robots whose own file is none.

use super::{Joint, JointKind, Link, Robot, Shape};
use nalgebra::{Isometry3, UnitQuaternion};

/// Travel of a slide without limits, m: a URDF must say one.
const TRAVEL: f64 = 1e3;
/// Radius of the ball whose inertia a body is given, m: a DH table has masses, but no inertias, and readers of URDFs
/// refuse a mass without one.
const BALL: f64 = 0.05;

/// The robot's frames, shapes and masses. Each link's frame is where the robot has it; numbers in full.
pub fn to_urdf(robot: &Robot) -> String {
    let mut lines = vec![
        "<?xml version=\"1.0\"?>".to_owned(),
        format!("<robot name=\"{}\">", escaped(&robot.name)),
    ];
    for link in &robot.links {
        add_link(robot, link, &mut lines);
    }
    for (index, joint) in robot.joints.iter().enumerate() {
        add_joint(robot, index, joint, &mut lines);
    }
    for link in &robot.links {
        if let Some(body) = robot.bodies.get(link.body)
            && body.name != link.name
        {
            let pose = robot.body_from_frame(link.body).inverse() * link.body_from_link;
            lines.push(fixed(&escaped(&body.name), &escaped(&link.name), &pose));
        }
    }
    lines.push("</robot>\n".to_owned());
    lines.join("\n")
}

fn add_link(robot: &Robot, link: &Link, lines: &mut Vec<String>) {
    lines.push(format!("  <link name=\"{}\">", escaped(&link.name)));
    let body = &robot.bodies[link.body];
    if body.name == link.name && body.mass > 0.0 {
        let com = link.body_from_link.inverse() * nalgebra::Point3::from(body.com);
        let pose = Isometry3::translation(com.x, com.y, com.z);
        lines.push(format!("    {}", inertial(body.mass, &pose)));
    }
    for visual in &link.visuals {
        let shape = match visual.shape {
            Shape::Box([x, y, z]) => format!("<box size=\"{x:?} {y:?} {z:?}\"/>"),
            Shape::Cylinder(r, l) => format!("<cylinder radius=\"{r:?}\" length=\"{l:?}\"/>"),
            Shape::Sphere(r) => format!("<sphere radius=\"{r:?}\"/>"),
        };
        let [r, g, b, a] = visual.rgba;
        lines.push(format!(
            "    <visual>{}<geometry>{shape}</geometry><material name=\"{r:?} {g:?} {b:?} {a:?}\"><color rgba=\"{r:?} {g:?} {b:?} {a:?}\"/></material></visual>",
            origin(&visual.link_from_shape)
        ));
    }
    lines.push("  </link>".to_owned());
}

fn add_joint(robot: &Robot, index: usize, joint: &Joint, lines: &mut Vec<String>) {
    let (Some(parent), Some(child)) = (robot.bodies.get(joint.parent), robot.bodies.get(index + 1))
    else {
        return;
    };
    let parent_from_joint = robot.body_from_frame(joint.parent).inverse() * joint.parent_from_joint;
    // A URDF joint moves its child link's own frame; where the link stands elsewhere on the
    // body (standard DH tables), a link without shape comes between.
    let joint_from_child = robot.body_from_frame(index + 1);
    let mut child = escaped(&child.name);
    if joint_from_child != Isometry3::identity() {
        let between = format!("{child}_axis");
        lines.push(format!("  <link name=\"{between}\"/>"));
        lines.push(fixed(&between, &child, &joint_from_child));
        child = between;
    }
    let kind = match (joint.kind, joint.limits) {
        (JointKind::Prismatic, _) => "prismatic",
        (JointKind::Revolute, Some(_)) => "revolute",
        // In a URDF a revolute joint without limits is called continuous.
        (JointKind::Revolute, None) | (JointKind::Continuous, _) => "continuous",
    };
    let limits = match (joint.kind, joint.limits) {
        (_, Some((lower, upper))) => format!("lower=\"{lower:?}\" upper=\"{upper:?}\" "),
        (JointKind::Prismatic, None) => format!("lower=\"-{TRAVEL:?}\" upper=\"{TRAVEL:?}\" "),
        (_, None) => String::new(),
    };
    lines.push(format!(
        "  <joint name=\"{}\" type=\"{kind}\">{}<parent link=\"{}\"/><child link=\"{child}\"/><axis xyz=\"{:?} {:?} {:?}\"/><limit {limits}effort=\"{:?}\" velocity=\"0\"/></joint>",
        escaped(&joint.name),
        origin(&parent_from_joint),
        escaped(&parent.name),
        joint.axis.x,
        joint.axis.y,
        joint.axis.z,
        joint.effort.unwrap_or(0.0)
    ));
}

/// An `<inertial>` of a ball of this mass (kg) at this pose.
pub fn inertial(mass: f64, pose: &Isometry3<f64>) -> String {
    let inertia = 0.4 * mass * BALL * BALL;
    format!(
        "<inertial>{}<mass value=\"{mass:?}\"/><inertia ixx=\"{inertia:?}\" ixy=\"0\" ixz=\"0\" iyy=\"{inertia:?}\" iyz=\"0\" izz=\"{inertia:?}\"/></inertial>",
        origin(pose)
    )
}

/// A fixed joint.
fn fixed(parent: &str, child: &str, parent_from_child: &Isometry3<f64>) -> String {
    format!(
        "  <joint name=\"{child}_fixed\" type=\"fixed\">{}<parent link=\"{parent}\"/><child link=\"{child}\"/></joint>",
        origin(parent_from_child)
    )
}

/// An `<origin>` in full precision, m and rad.
pub fn origin(pose: &Isometry3<f64>) -> String {
    let t = &pose.translation.vector;
    let [roll, pitch, yaw] = rpy(&pose.rotation);
    format!(
        "<origin xyz=\"{:?} {:?} {:?}\" rpy=\"{roll:?} {pitch:?} {yaw:?}\"/>",
        t.x, t.y, t.z
    )
}

/// Fixed-axis roll, pitch and yaw, rad: `Rz(yaw) Ry(pitch) Rx(roll)`.
///
/// Yaw first, roll from what it leaves: no arc sine, which near a pitch of 90 degrees loses half of the digits.
/// Source: Shoemake 1994, *Euler angle conversion*, Graphics Gems IV.
pub fn rpy(rotation: &UnitQuaternion<f64>) -> [f64; 3] {
    let m = UnitQuaternion::new_normalize(rotation.into_inner())
        .to_rotation_matrix()
        .into_inner();
    let yaw = m[(1, 0)].atan2(m[(0, 0)]);
    let (sin, cos) = yaw.sin_cos();
    let pitch = (-m[(2, 0)]).atan2(cos * m[(0, 0)] + sin * m[(1, 0)]);
    let roll = (sin * m[(0, 2)] - cos * m[(1, 2)]).atan2(cos * m[(1, 1)] - sin * m[(0, 1)]);
    [roll, pitch, yaw]
}

/// Text as an attribute's value.
pub fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}
