//! URDF to tree. The format is that of ROS, read by `urdf-rs`; what it lets through silently is refused here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType, Pose};

use super::tree::{Tree, TreeJoint, TreeLink};
use super::xml::{Outline, outline};
use super::{JointKind, RobotError, Shape, Visual};

/// Colour of a shape the file gives none: light grey.
const GREY: [f64; 4] = [0.7, 0.7, 0.7, 1.0];

/// Reads a URDF; with its `folder`, meshes that are not there are refused.
pub(super) fn read(file: &str, text: &str, folder: Option<&Path>) -> Result<Tree, RobotError> {
    let outline = outline(file, text)?;
    let urdf = urdf_rs::read_from_string(&outline.document(&outline.parts))
        .map_err(|error| blame(file, &outline, &error))?;
    let colours = colours(&urdf);
    let mut links = Vec::new();
    for link in &urdf.links {
        if let Some(folder) = folder {
            check_meshes(file, link, folder)?;
        }
        let mut visuals = Vec::new();
        for visual in &link.visual {
            add_visual(file, link, visual, &colours, &mut visuals)?;
        }
        links.push(TreeLink {
            name: link.name.clone(),
            mass: link.inertial.mass.value,
            com: Vector3::from(*link.inertial.origin.xyz),
            visuals,
        });
    }
    Ok(Tree {
        name: urdf.name.clone(),
        links,
        joints: urdf.joints.iter().map(read_joint).collect(),
    })
}

/// Finds the part that `urdf-rs` stumbled over by reading each one alone.
fn blame(file: &str, outline: &Outline, error: &urdf_rs::UrdfError) -> RobotError {
    let accepted = "a URDF as in the ROS specification is accepted";
    for part in &outline.parts {
        if let Err(error) = urdf_rs::read_from_string(&outline.document([part])) {
            return RobotError::refused(file, part.place(), error.to_string(), accepted);
        }
    }
    RobotError::refused(file, "robot", error.to_string(), accepted)
}

fn read_joint(joint: &urdf_rs::Joint) -> TreeJoint {
    let (kind, loose) = match joint.joint_type {
        JointType::Fixed => (None, None),
        JointType::Revolute => (Some(JointKind::Revolute), None),
        JointType::Continuous => (Some(JointKind::Continuous), None),
        JointType::Prismatic => (Some(JointKind::Prismatic), None),
        JointType::Planar => (None, Some("planar")),
        JointType::Floating => (None, Some("floating")),
        JointType::Spherical => (None, Some("spherical")),
    };
    let unsupported = match loose {
        Some(name) => Some(format!("type {name} has more than one coordinate")),
        None => joint.mimic.as_ref().map(|other| {
            format!(
                "mimics joint \"{}\", so it has no encoder of its own",
                other.joint
            )
        }),
    };
    let (lower, upper) = (joint.limit.lower, joint.limit.upper);
    // A limit left out reads as 0 to 0, from version 1.2 of the format as -inf to inf.
    let unlimited = (lower == 0.0 && upper == 0.0)
        || (lower == f64::NEG_INFINITY && upper == f64::INFINITY)
        || matches!(kind, None | Some(JointKind::Continuous));
    let effort = joint.limit.effort;
    TreeJoint {
        name: joint.name.clone(),
        kind,
        unsupported,
        parent: joint.parent.link.clone(),
        child: joint.child.link.clone(),
        parent_from_joint: pose(&joint.origin),
        joint_from_child: Isometry3::identity(),
        axis: Vector3::from(*joint.axis.xyz),
        limits: (!unlimited).then_some((lower, upper)),
        effort: (effort != 0.0 && effort != f64::INFINITY).then_some(effort),
    }
}

/// A pose from translation and fixed-axis roll, pitch, yaw: `Rz(yaw) Ry(pitch) Rx(roll)`.
fn pose(pose: &Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = *pose.rpy;
    Isometry3::from_parts(
        Translation3::from(*pose.xyz),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    )
}

/// Colours by material name; a material may be defined at the top or where it is first used.
fn colours(urdf: &urdf_rs::Robot) -> BTreeMap<&str, [f64; 4]> {
    let visuals = urdf.links.iter().flat_map(|link| &link.visual);
    let used = visuals.filter_map(|visual| visual.material.as_ref());
    let mut colours = BTreeMap::new();
    for material in urdf.materials.iter().chain(used) {
        if let Some(colour) = &material.color {
            colours
                .entry(material.name.as_str())
                .or_insert(*colour.rgba);
        }
    }
    colours
}

fn add_visual(
    file: &str,
    link: &urdf_rs::Link,
    visual: &urdf_rs::Visual,
    colours: &BTreeMap<&str, [f64; 4]>,
    visuals: &mut Vec<Visual>,
) -> Result<(), RobotError> {
    let refuse = |found: String, accepted: &str| {
        RobotError::refused(file, format!("link \"{}\"", link.name), found, accepted)
    };
    let rgba = visual
        .material
        .as_ref()
        .and_then(|m| {
            let own = m.color.as_ref().map(|colour| *colour.rgba);
            own.or_else(|| colours.get(m.name.as_str()).copied())
        })
        .unwrap_or(GREY);
    if !rgba.iter().all(|c| (0.0..=1.0).contains(c)) {
        return Err(refuse(
            format!("visual colour {rgba:?}"),
            "red, green, blue and opacity are from 0 to 1",
        ));
    }
    let shapes = match visual.geometry {
        Geometry::Box { size } => vec![(0.0, Shape::Box(*size))],
        Geometry::Cylinder { radius, length } => vec![(0.0, Shape::Cylinder(radius, length))],
        Geometry::Sphere { radius } => vec![(0.0, Shape::Sphere(radius))],
        // A capsule is a cylinder with two rounded ends.
        Geometry::Capsule { radius, length } => vec![
            (0.0, Shape::Cylinder(radius, length)),
            (-length / 2.0, Shape::Sphere(radius)),
            (length / 2.0, Shape::Sphere(radius)),
        ],
        Geometry::Mesh { .. } => Vec::new(),
    };
    for (along_z, shape) in shapes {
        let sizes = match shape {
            Shape::Box(size) => size.to_vec(),
            Shape::Cylinder(radius, length) => vec![radius, length],
            Shape::Sphere(radius) => vec![radius],
        };
        if !sizes.iter().all(|size| (0.0..=100.0).contains(size)) {
            return Err(refuse(
                format!("visual of size {sizes:?}"),
                "sizes are in m, from 0 to 100",
            ));
        }
        visuals.push(Visual {
            link_from_shape: pose(&visual.origin) * Translation3::new(0.0, 0.0, along_z),
            shape,
            rgba,
        });
    }
    Ok(())
}

fn check_meshes(file: &str, link: &urdf_rs::Link, folder: &Path) -> Result<(), RobotError> {
    let seen = link.visual.iter().map(|visual| &visual.geometry);
    let touched = link.collision.iter().map(|collision| &collision.geometry);
    for geometry in seen.chain(touched) {
        if let Geometry::Mesh { filename, .. } = geometry
            && let Some(path) = locate(filename, folder)
            && !path.is_file()
        {
            return Err(RobotError::refused(
                file,
                format!("link \"{}\"", link.name),
                format!("mesh file \"{filename}\" not found ({})", path.display()),
                "put the mesh there or remove it: only primitive shapes are used",
            ));
        }
    }
    Ok(())
}

/// Where a mesh should be, or `None` if its address cannot be looked up here.
///
/// A `package://` is sought among the folders above the URDF, as ROS packages are laid out. If there is no such
/// package nothing can be said about the mesh, and since it is not used the robot is still good.
fn locate(filename: &str, folder: &Path) -> Option<PathBuf> {
    if let Some(address) = filename.strip_prefix("package://") {
        let (package, inside) = address.split_once('/')?;
        let folder = folder.canonicalize().ok()?;
        let package = folder.ancestors().find_map(|above| {
            let named = above.file_name().is_some_and(|name| name == package);
            let beside = above.join(package);
            match named {
                true => Some(above.to_owned()),
                false => beside.is_dir().then_some(beside),
            }
        })?;
        return Some(package.join(inside));
    }
    let path = filename.strip_prefix("file://").unwrap_or(filename);
    (!path.contains("://")).then(|| folder.join(path))
}
