//! The nominal robot: moving joints, bodies, links. Read once from a URDF or a DH table, never changed.
//!
//! Fixed joints are folded away: links that cannot move against one another are one *body*.
//! `bodies[0]` is what the base link belongs to; `bodies[j + 1]` is moved by `joints[j]`.
//! Joints come parents first, so one pass over them in order visits every parent before its children.

mod dh;
mod element;
mod error;
mod tree;
mod urdf;
mod write;
mod xml;

use crate::input;
use std::path::Path;

use nalgebra::{Isometry3, Unit, Vector3};

pub use dh::{Convention, Ends, ends};
pub use element::Element;
pub use error::RobotError;
pub use write::{escaped, inertial, origin, rpy, to_urdf};
pub use xml::{clean, parse};

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

/// One moving joint: `parent_from_body = parent_from_joint * motion(axis, q)`.
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

/// Primitive shapes, lengths in m; cylinders lie along their z axis.
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
    /// Motion of the joint from its zero: a turn (rad) or a slide (m).
    pub fn motion(&self, q: f64) -> Isometry3<f64> {
        match self.kind {
            JointKind::Prismatic => Isometry3::from(nalgebra::Translation3::from(*self.axis * q)),
            JointKind::Revolute | JointKind::Continuous => Isometry3::rotation(*self.axis * q),
        }
    }

    /// Row of a wrench `[f; m]` where the part begins that the joint's axis carries: 0 force, 3 moment.
    pub fn load_row(&self) -> usize {
        match self.kind {
            JointKind::Prismatic => 0,
            JointKind::Revolute | JointKind::Continuous => 3,
        }
    }
}
impl Robot {
    /// Reads a robot file: `.urdf` or `.xml` is a URDF, `.toml` a DH table.
    ///
    /// `base` names the link all poses refer to; only what hangs on it is kept. Without it the root is the base.
    /// Meshes are not used, but one that is missing is reported: the file was then moved without its parts.
    ///
    /// # Errors
    /// Whatever keeps the file from being one serial or branched arm, naming the file and the place in it.
    pub fn load(path: &Path, base: Option<&str>) -> Result<Robot, RobotError> {
        Ok(Self::load_with_text(path, base)?.0)
    }

    /// The same with the text of the file, which recordings carry along.
    ///
    /// # Errors
    /// As [`Robot::load`].
    pub fn load_with_text(path: &Path, base: Option<&str>) -> Result<(Robot, String), RobotError> {
        let file = path.display().to_string();
        let limit = format(&file)?.largest();
        let text = input::text(path, limit).map_err(|source| RobotError::Unreadable {
            file: file.clone(),
            source,
        })?;
        Ok((read(&file, &text, base, path.parent())?, text))
    }

    /// The same for text already in memory; `file_name` decides the format and appears in messages.
    ///
    /// # Errors
    /// As [`Robot::load`], except that there is no folder in which a mesh could be missing.
    pub fn parse(file_name: &str, text: &str, base: Option<&str>) -> Result<Robot, RobotError> {
        read(file_name, text, base, None)
    }

    /// Index of the moving joint of this name.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Index of the link of this name.
    pub fn link(&self, name: &str) -> Option<usize> {
        self.links.iter().position(|link| link.name == name)
    }

    /// Frame of the link that a body is named after, in the body's frame.
    pub fn body_from_frame(&self, body: usize) -> Isometry3<f64> {
        self.links
            .iter()
            .find(|link| link.body == body && link.name == self.bodies[body].name)
            .map_or_else(Isometry3::identity, |link| link.body_from_link)
    }

    /// Pose of every body in the base frame at these joint angles (rad or m), nominal and unloaded.
    pub fn body_poses(&self, joints: &[f64]) -> Vec<Isometry3<f64>> {
        let mut poses = vec![Isometry3::identity(); self.bodies.len()];
        for (index, (joint, &q)) in self.joints.iter().zip(joints).enumerate() {
            poses[index + 1] = poses[joint.parent] * joint.parent_from_joint * joint.motion(q);
        }
        poses
    }

    /// Joints that bear more than they are rated for, of torques by joint, N·m (N): index, torque and rating.
    pub fn overloaded(&self, torques: &[f64]) -> Vec<(usize, f64, f64)> {
        let all = self.joints.iter().zip(torques).enumerate();
        all.filter_map(|(index, (joint, torque))| {
            let rating = joint.effort?;
            (torque.abs() > rating).then_some((index, torque.abs(), rating))
        })
        .collect()
    }

    /// Indices of the joints that move `body`, from the base outwards; empty for the base.
    pub fn chain(&self, mut body: usize) -> Vec<usize> {
        let mut chain = Vec::new();
        while let Some(index) = body.checked_sub(1)
            && let Some(joint) = self.joints.get(index)
            && chain.len() < self.joints.len()
        {
            chain.push(index);
            body = joint.parent;
        }
        chain.reverse();
        chain
    }
}

fn read(
    file: &str,
    text: &str,
    base: Option<&str>,
    folder: Option<&Path>,
) -> Result<Robot, RobotError> {
    let format = format(file)?;
    if text.len() as u64 > format.largest() {
        return Err(RobotError::Unreadable {
            file: file.to_owned(),
            source: input::too_large(format.largest()),
        });
    }
    // Editors on some systems put a byte order mark first; neither parser wants it.
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let tree = match format {
        Format::Urdf => urdf::read(file, text, folder)?,
        Format::Dh => dh::read(file, text)?,
    };
    tree.assemble(file, base)
}

/// What a robot file is written in.
#[derive(Clone, Copy)]
enum Format {
    Urdf,
    Dh,
}

impl Format {
    /// Largest file, bytes.
    fn largest(self) -> u64 {
        match self {
            Format::Urdf => input::LARGEST_URDF,
            Format::Dh => input::LARGEST_TOML,
        }
    }
}

/// The format by the ending of the file's name.
fn format(file: &str) -> Result<Format, RobotError> {
    let ending = Path::new(file)
        .extension()
        .and_then(|ending| ending.to_str())
        .unwrap_or_default()
        .to_ascii_lowercase();
    match ending.as_str() {
        "urdf" | "xml" => Ok(Format::Urdf),
        "toml" => Ok(Format::Dh),
        _ => Err(RobotError::Ending {
            file: file.to_owned(),
        }),
    }
}
