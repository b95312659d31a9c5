//! Writes a plant as MuJoCo's own text (MJCF): hinges with springs, masses, a load and sensors by target.
//!
//! Every name begins with what it is and its index, so that no name of a robot file can clash with
//! another, and only then tells the robot file's name, for whoever opens the text in a viewer.

use super::{Carried, PlantError, PlantSpec, SpecError};
use misfit_arm::robot::JointKind;
use nalgebra::{Isometry3, Vector3};
use std::fmt::Write;

/// The six motions of a flexure, in the order of its stiffnesses.
pub(super) const FLEXURE_AXES: [&str; 6] = ["rx", "ry", "rz", "tx", "ty", "tz"];

/// The motions of a drive, in the order of its axes.
const DRIVE_AXES: [&str; 6] = ["slide", "slide", "slide", "hinge", "hinge", "hinge"];

/// MuJoCo's compiler refuses to move bodies without mass; statics has no need of any. Bodies without one
/// get this (kg, and kg·m²), and lose it when the plant is built. Inertia plays no part in statics.
const TOKEN_MASS: f64 = 1e-12;

/// The MJCF text. Masses of massless bodies are a token 1e-12 kg, loads are massless: the plant sets both
/// once the text is compiled.
pub fn write(spec: &PlantSpec) -> String {
    let mut text = String::new();
    let gravity = numbers(spec.gravity.as_slice());
    // Writing to a String cannot fail, hence the discarded results here and below.
    let _ = write!(
        text,
        "<mujoco model=\"{}\">\n\
         <compiler angle=\"radian\"/>\n\
         <option gravity=\"{gravity}\"><flag contact=\"disable\" constraint=\"disable\"/></option>\n\
         <worldbody>\n",
        clean(&tame(&spec.robot.name))
    );
    body(spec, 0, &mut text);
    text.push_str("</worldbody>\n<sensor>\n");
    for index in 0..spec.targets.len() {
        let name = load_name(spec, index);
        for quantity in ["force", "torque"] {
            let escaped = clean(&name);
            let _ = writeln!(
                text,
                "<{quantity} name=\"{quantity}_{escaped}\" site=\"{escaped}\"/>"
            );
        }
    }
    text.push_str("</sensor>\n</mujoco>\n");
    text
}

/// Whether the specification describes a robot.
pub(super) fn check(spec: &PlantSpec) -> Result<(), PlantError> {
    let wrong = |what: String| Err(SpecError::Spec(what).into());
    let (joints, bodies) = (spec.robot.joints.len(), spec.robot.bodies.len());
    if bodies != joints + 1 {
        return wrong(format!("{bodies} bodies for {joints} joints and a base"));
    }
    if spec.body_from_displaced.len() != bodies {
        return wrong(format!(
            "{} displacements for {bodies} bodies",
            spec.body_from_displaced.len()
        ));
    }
    if spec.stiffness.len() != joints {
        return wrong(format!(
            "{} stiffnesses for {joints} joints",
            spec.stiffness.len()
        ));
    }
    for (index, joint) in spec.robot.joints.iter().enumerate() {
        if joint.parent > index {
            return wrong(format!(
                "joint `{}` comes before the body it hangs on",
                joint.name
            ));
        }
        if !is_finite(&joint.parent_from_joint) || !joint.axis.iter().all(|x| x.is_finite()) {
            return wrong(format!(
                "joint `{}` has a pose or axis that is not finite",
                joint.name
            ));
        }
    }
    for body in &spec.robot.bodies {
        if !(body.mass >= 0.0 && body.mass.is_finite() && body.com.iter().all(|x| x.is_finite())) {
            return wrong(format!(
                "body `{}` of {} kg at {:?}",
                body.name,
                body.mass,
                body.com.as_slice()
            ));
        }
    }
    if !spec.body_from_displaced.iter().all(is_finite) {
        return wrong("a displacement that is not finite".to_owned());
    }
    let flexible = spec.flexures.iter().flat_map(|flexure| flexure.stiffness);
    for stiffness in spec.stiffness.iter().copied().chain(flexible).flatten() {
        if !(stiffness > 0.0 && stiffness.is_finite()) {
            return wrong(format!(
                "a stiffness of {stiffness}; it must be above zero, or none for a rigid joint"
            ));
        }
    }
    for flexure in &spec.flexures {
        let exists = match flexure.carries {
            Carried::Body(body) => body < bodies,
            Carried::Joint(joint) => joint < joints,
        };
        if !exists || !is_finite(&flexure.pivot) {
            return wrong(format!(
                "a flexure that carries {:?} at {}",
                flexure.carries, flexure.pivot
            ));
        }
    }
    for drive in &spec.drives {
        if drive.body >= bodies || drive.axis >= DRIVE_AXES.len() {
            return wrong(format!(
                "a drive of body {} along {}",
                drive.body, drive.axis
            ));
        }
    }
    for &(link, _) in &spec.targets {
        match spec.robot.links.get(link) {
            None => {
                return wrong(format!(
                    "a target on link {link} of {}",
                    spec.robot.links.len()
                ));
            }
            Some(found) if found.body >= bodies || !is_finite(&found.body_from_link) => {
                return wrong(format!("link `{}` belongs to no body", found.name));
            }
            Some(_) => {}
        }
    }
    for (what, value) in [
        ("an expansion", spec.expansion),
        ("an expansion's curvature", spec.expansion_curvature),
        ("a tracker scale", spec.tracker_scale),
    ] {
        if !value.is_finite() {
            return wrong(format!("{what} of {value}"));
        }
    }
    if !spec.gravity.iter().all(|x| x.is_finite()) {
        return wrong("gravity is not finite".to_owned());
    }
    Ok(())
}

/// Name of the MuJoCo body that has the mass and carries the links.
pub(super) fn body_name(spec: &PlantSpec, body: usize) -> String {
    format!("body_{body}_{}", tame(&spec.robot.bodies[body].name))
}

/// Name of the MuJoCo body that a body's joint moves: itself, or one before it where something lies between.
pub(super) fn moved_name(spec: &PlantSpec, body: usize) -> String {
    if is_plain(spec, body) {
        body_name(spec, body)
    } else {
        format!("moved_{body}")
    }
}

/// Is a body just where its joint moves it?
fn is_plain(spec: &PlantSpec, body: usize) -> bool {
    let behind = |flexure: &super::Flexure| flexure.carries == Carried::Body(body);
    spec.body_from_displaced[body] == Isometry3::identity()
        && !spec.flexures.iter().any(behind)
        && !spec.drives.iter().any(|drive| drive.body == body)
}

/// Name of a flexure's body.
pub(super) fn flexure_name(flexure: usize) -> String {
    format!("flexure_{flexure}")
}

/// Name of the hinge or slide.
pub(super) fn joint_name(spec: &PlantSpec, joint: usize) -> String {
    format!("joint_{joint}_{}", tame(&spec.robot.joints[joint].name))
}

/// Name of one of a flexure's hinges and slides.
pub(super) fn flexure_joint_name(flexure: usize, axis: usize) -> String {
    format!("flexure_{flexure}_{}", FLEXURE_AXES[axis])
}

/// Name of a drive's body, and of its hinge or slide.
pub(super) fn drive_name(drive: usize) -> String {
    format!("drive_{drive}")
}

/// Name of the body that stands for what hangs on a target, and of its site.
pub(super) fn load_name(spec: &PlantSpec, target: usize) -> String {
    format!(
        "load_{target}_{}",
        tame(&spec.robot.links[spec.targets[target].0].name)
    )
}

/// A body with its joint, and all that hangs on it.
fn body(spec: &PlantSpec, index: usize, text: &mut String) {
    let mut open = 1;
    let mut pose = Isometry3::identity();
    // One more body only where something is displaced or gives way: the innermost has the mass.
    let plain = is_plain(spec, index);
    if let Some(number) = index.checked_sub(1) {
        let joint = &spec.robot.joints[number];
        pose = joint.parent_from_joint;
        flexures(spec, Carried::Joint(number), &mut pose, &mut open, text);
        open_body(&moved_name(spec, index), &pose, text);
        if !plain {
            inertial(TOKEN_MASS, &Vector3::zeros(), text);
        }
        let kind = if joint.kind == JointKind::Prismatic {
            "slide"
        } else {
            "hinge"
        };
        hinge(
            &joint_name(spec, number),
            kind,
            &joint.axis,
            spec.stiffness[number].unwrap_or(0.0),
            text,
        );
        pose = Isometry3::identity();
    }
    if index == 0 || !plain {
        open += usize::from(index > 0);
        flexures(spec, Carried::Body(index), &mut pose, &mut open, text);
        drives(spec, index, &mut pose, &mut open, text);
        open_body(
            &body_name(spec, index),
            &(pose * spec.body_from_displaced[index]),
            text,
        );
    }
    let body = &spec.robot.bodies[index];
    inertial(body.mass.max(TOKEN_MASS), &body.com, text);

    for target in 0..spec.targets.len() {
        let link = &spec.robot.links[spec.targets[target].0];
        if link.body == index {
            let name = load_name(spec, target);
            open_body(&name, &link.body_from_link, text);
            inertial(TOKEN_MASS, &Vector3::zeros(), text);
            let _ = writeln!(text, "<site name=\"{}\"/>\n</body>", clean(&name));
        }
    }
    for (number, joint) in spec.robot.joints.iter().enumerate() {
        if joint.parent == index {
            self::body(spec, number + 1, text);
        }
    }
    for _ in 0..open {
        text.push_str("</body>\n");
    }
}

/// Bodies for the flexures at one place. `pose` leads from the last body opened to what comes next.
fn flexures(
    spec: &PlantSpec,
    place: Carried,
    pose: &mut Isometry3<f64>,
    open: &mut usize,
    text: &mut String,
) {
    for (index, flexure) in spec.flexures.iter().enumerate() {
        if flexure.carries != place {
            continue;
        }
        open_body(&flexure_name(index), &(*pose * flexure.pivot), text);
        inertial(TOKEN_MASS, &Vector3::zeros(), text);
        *open += 1;
        for (axis, stiffness) in flexure.stiffness.iter().enumerate() {
            if let Some(stiffness) = stiffness {
                let kind = if axis < 3 { "hinge" } else { "slide" };
                let mut direction = Vector3::zeros();
                direction[axis % 3] = 1.0;
                hinge(
                    &flexure_joint_name(index, axis),
                    kind,
                    &direction,
                    *stiffness,
                    text,
                );
            }
        }
        *pose = flexure.pivot.inverse();
    }
}

/// Bodies for the drives of a body. `pose` as for flexures.
fn drives(
    spec: &PlantSpec,
    body: usize,
    pose: &mut Isometry3<f64>,
    open: &mut usize,
    text: &mut String,
) {
    let all = spec.drives.iter().enumerate();
    for (index, drive) in all.filter(|(_, drive)| drive.body == body) {
        let name = drive_name(index);
        open_body(&name, pose, text);
        inertial(TOKEN_MASS, &Vector3::zeros(), text);
        let direction = Vector3::ith(drive.axis % 3, 1.0);
        hinge(&name, DRIVE_AXES[drive.axis], &direction, 0.0, text);
        *open += 1;
        *pose = Isometry3::identity();
    }
}

fn open_body(name: &str, pose: &Isometry3<f64>, text: &mut String) {
    let q = pose.rotation.quaternion();
    let _ = writeln!(
        text,
        "<body name=\"{}\" pos=\"{}\" quat=\"{}\">",
        clean(name),
        numbers(pose.translation.vector.as_slice()),
        numbers(&[q.w, q.i, q.j, q.k])
    );
}

fn hinge(name: &str, kind: &str, axis: &Vector3<f64>, stiffness: f64, text: &mut String) {
    let _ = writeln!(
        text,
        "<joint name=\"{}\" type=\"{kind}\" axis=\"{}\" stiffness=\"{stiffness}\"/>",
        clean(name),
        numbers(axis.as_slice())
    );
}

fn inertial(mass: f64, com: &Vector3<f64>, text: &mut String) {
    let _ = writeln!(
        text,
        "<inertial pos=\"{}\" mass=\"{mass}\" diaginertia=\"{TOKEN_MASS} {TOKEN_MASS} {TOKEN_MASS}\"/>",
        numbers(com.as_slice())
    );
}

/// Decimal numbers that read back to the same bits.
fn numbers(values: &[f64]) -> String {
    values
        .iter()
        .map(f64::to_string)
        .collect::<Vec<_>>()
        .join(" ")
}

/// A name MuJoCo can hold: XML has no way to write control characters, and very long names help nobody.
fn tame(name: &str) -> String {
    name.chars()
        .take(64)
        .map(|c| if c.is_control() { '\u{fffd}' } else { c })
        .collect()
}

/// Text as the value of an XML attribute.
fn clean(name: &str) -> String {
    let mut escaped = String::with_capacity(name.len());
    for c in name.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&apos;"),
            _ => escaped.push(c),
        }
    }
    escaped
}

fn is_finite(pose: &Isometry3<f64>) -> bool {
    pose.translation
        .vector
        .iter()
        .chain(pose.rotation.coords.iter())
        .all(|x| x.is_finite())
}
