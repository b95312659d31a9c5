//! The nominal robot: moving joints, bodies, links. Read once from a URDF or a DH table, never changed.
//!
//! Fixed joints are folded away: links that cannot move against one another are one *body*.
//! `bodies[0]` is what the base link belongs to; `bodies[j + 1]` is moved by `joints[j]`.
//! Joints come parents first, so one pass over them in order visits every parent before its children.

mod dh;
mod urdf;

use nalgebra::{Isometry3, Unit, Vector3};

/// A serial or branched arm. Lengths in m, angles in rad, masses in kg.
#[derive(Debug, Clone, PartialEq)]
pub struct Robot {
    /// Name given in the robot file.
    pub name: String,
    /// Moving joints, parents first.
    pub joints: Vec<Joint>,
    /// Rigid bodies: the base, then one for each joint.
    pub bodies: Vec<Body>,
    /// Every link of the file below the base, with the body it belongs to.
    pub links: Vec<Link>,
}

/// How a joint moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis within limits.
    Revolute,
    /// Turns about its axis without limits.
    Continuous,
    /// Slides along its axis.
    Prismatic,
}

/// One moving joint: `body_from_parent = parent_from_joint * motion(axis, q)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Name in the robot file; also the stem of its CSV column.
    pub name: String,
    /// How it moves.
    pub kind: JointKind,
    /// Index of the body it hangs on.
    pub parent: usize,
    /// Pose of the joint frame at q = 0 in the parent body's frame.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint frame.
    pub axis: Unit<Vector3<f64>>,
    /// Lower and upper limit, rad or m.
    pub limits: Option<(f64, f64)>,
    /// Rated torque or force, N·m or N, if the file gives one above zero.
    pub effort: Option<f64>,
}

/// Mass of everything rigidly fixed to one joint's moving side.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Name of its first link.
    pub name: String,
    /// kg; zero if the file gives none.
    pub mass: f64,
    /// Centre of mass in the body's frame, m.
    pub com: Vector3<f64>,
}

/// A named frame of the robot file.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Name in the robot file.
    pub name: String,
    /// Index of the body it belongs to.
    pub body: usize,
    /// Pose of the link's frame in the body's frame.
    pub body_from_link: Isometry3<f64>,
    /// What it looks like: primitive shapes only.
    pub visuals: Vec<Visual>,
}

/// One primitive shape in its link's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Visual {
    /// Pose of the shape's centre in the link's frame.
    pub link_from_shape: Isometry3<f64>,
    /// The shape, m.
    pub shape: Shape,
    /// Red, green, blue, opacity in 0..1.
    pub rgba: [f64; 4],
}

/// Primitive shapes, lengths in m; cylinders and capsules lie along their z axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// Full edge lengths.
    Box([f64; 3]),
    /// Radius and length.
    Cylinder(f64, f64),
    /// Radius.
    Sphere(f64),
}

impl Joint {
    /// Row of a wrench `[f; m]` where the part begins that the joint's axis carries: 0 force, 3 moment.
    pub fn load_row(&self) -> usize {
        match self.kind {
            JointKind::Prismatic => 0,
            JointKind::Revolute | JointKind::Continuous => 3,
        }
    }
}
