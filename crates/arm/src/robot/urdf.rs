//! URDF to tree. The format is that of ROS; of it is read what an arm's geometry, statics and picture need.
//!
//! Source: the XML specification of ROS, wiki.ros.org/urdf/XML; versions 1.1 and 1.2 as in `urdfdom`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use nalgebra::{Isometry3, Translation3, Vector3};

use super::error::short;
use super::tree::{MAX_LINKS, Tree, TreeJoint, TreeLink, too_many_links};
use super::{Element, JointKind, RobotError, Shape, Visual, xml};

/// Colour of a shape the file gives none: light grey.
const GREY: [f64; 4] = [0.7, 0.7, 0.7, 1.0];

/// Reads a URDF; with its `folder`, meshes that are not there are refused.
pub(super) fn read(file: &str, text: &str, folder: Option<&Path>) -> Result<Tree, RobotError> {
    let clean = xml::clean(file, text)?;
    let document = xml::parse(file, &clean)?;
    let robot = Element::root(file, &document);
    let (links, joints) = (robot.all(&["link"]), robot.all(&["joint"]));
    let counts = (links.count(), joints.count());
    // In a tree there is one joint less than there are links.
    if counts.0.max(counts.1) > MAX_LINKS {
        return Err(too_many_links(file, counts.0, counts.1));
    }
    let colours = colours(robot)?;
    let links = robot.all(&["link"]);
    let joints = robot.all(&["joint"]);
    Ok(Tree {
        name: robot.attribute("name").unwrap_or_default().to_owned(),
        links: links
            .map(|link| read_link(link, &colours, folder))
            .collect::<Result<_, _>>()?,
        joints: joints.map(read_joint).collect::<Result<_, _>>()?,
    })
}

/// Colours by material name; a material may be defined at the top or where it is first used.
fn colours(robot: Element<'_>) -> Result<BTreeMap<&str, [f64; 4]>, RobotError> {
    let mut colours = BTreeMap::new();
    let links = robot.all(&["link"]);
    let visuals = links.flat_map(|link| link.all(&["visual"]));
    let used = visuals.flat_map(|visual| visual.all(&["material"]));
    for material in robot.all(&["material"]).chain(used) {
        let name = material.text("name")?;
        if let Some(colour) = material.child("color")? {
            let rgba = colour.needed("rgba")?;
            colours.entry(name).or_insert(rgba);
        }
    }
    Ok(colours)
}

fn read_link(
    link: Element<'_>,
    colours: &BTreeMap<&str, [f64; 4]>,
    folder: Option<&Path>,
) -> Result<TreeLink, RobotError> {
    let (mass, com) = match link.child("inertial")? {
        None => (0.0, Vector3::zeros()),
        Some(inertial) => {
            let [mass] = inertial.required("mass")?.needed("value")?;
            (mass, inertial.pose()?.translation.vector)
        }
    };
    let mut visuals = Vec::new();
    for part in link.all(&["visual", "collision"]) {
        let shape = read_shape(part)?;
        match shape.tag() {
            "mesh" => check_mesh(link, shape.text("filename")?, folder)?,
            _ if part.tag() == "visual" => add_visual(part, shape, colours, &mut visuals)?,
            _ => {}
        }
    }
    Ok(TreeLink {
        name: link.text("name")?.to_owned(),
        mass,
        com,
        visuals,
    })
}

fn read_joint(joint: Element<'_>) -> Result<TreeJoint, RobotError> {
    let (kind, loose) = match joint.text("type")? {
        "fixed" => (None, None),
        "revolute" => (Some(JointKind::Revolute), None),
        "continuous" => (Some(JointKind::Continuous), None),
        "prismatic" => (Some(JointKind::Prismatic), None),
        kind @ ("planar" | "floating" | "spherical") => (None, Some(kind)),
        kind => {
            return Err(joint.refuse(
                format!("type \"{}\"", short(kind)),
                "types are revolute, continuous, prismatic, fixed, floating, planar and spherical",
            ));
        }
    };
    let mimic = match joint.child("mimic")? {
        Some(mimic) => Some(mimic.text("joint")?),
        None => None,
    };
    let unsupported = match (loose, mimic) {
        (Some(name), _) => Some(format!("type {name} has more than one coordinate")),
        (None, Some(other)) => Some(format!(
            "mimics joint \"{other}\", so it has no encoder of its own"
        )),
        (None, None) => None,
    };
    let axis = match joint.child("axis")? {
        Some(axis) => axis.needed("xyz")?,
        None => [1.0, 0.0, 0.0],
    };
    let (limits, effort) = read_limit(joint)?;
    let moves = !matches!(kind, None | Some(JointKind::Continuous));
    Ok(TreeJoint {
        name: joint.text("name")?.to_owned(),
        kind,
        unsupported,
        parent: joint.required("parent")?.text("link")?.to_owned(),
        child: joint.required("child")?.text("link")?.to_owned(),
        parent_from_joint: joint.pose()?,
        joint_from_child: Isometry3::identity(),
        axis: Vector3::from(axis),
        limits: limits.filter(|_| moves),
        effort,
    })
}

/// Lower and upper limit (rad, m), and effort (N·m, N) of a joint, as far as they are given.
type Limit = (Option<(f64, f64)>, Option<f64>);

fn read_limit(joint: Element<'_>) -> Result<Limit, RobotError> {
    let Some(limit) = joint.child("limit")? else {
        return Ok((None, None));
    };
    // What is left out reads as 0, from version 1.2 of the format on as infinite; 0 to 0 stands for none too.
    let missing = match limit.version() >= (1, 2) {
        true => f64::INFINITY,
        false => 0.0,
    };
    let lower = limit.number("lower")?.unwrap_or(0.0 - missing);
    let upper = limit.number("upper")?.unwrap_or(missing);
    let unlimited =
        (lower == 0.0 && upper == 0.0) || (lower == f64::NEG_INFINITY && upper == f64::INFINITY);
    let effort = limit.number("effort")?.unwrap_or(0.0);
    Ok((
        (!unlimited).then_some((lower, upper)),
        (effort != 0.0 && effort != f64::INFINITY).then_some(effort),
    ))
}

/// The one shape of a visual or collision.
fn read_shape(part: Element<'_>) -> Result<Element<'_>, RobotError> {
    const SHAPES: [&str; 5] = ["box", "cylinder", "sphere", "capsule", "mesh"];
    let geometry = part.required("geometry")?;
    let mut shapes = geometry.all(&SHAPES);
    match (shapes.next(), shapes.next()) {
        (Some(shape), None) => Ok(shape),
        (first, _) => Err(geometry.refuse(
            match first {
                None => "a <geometry> without a shape",
                Some(_) => "a <geometry> with two shapes",
            },
            format!("it takes one of <{}>", SHAPES.join(">, <")),
        )),
    }
}

fn add_visual(
    visual: Element<'_>,
    shape: Element<'_>,
    colours: &BTreeMap<&str, [f64; 4]>,
    visuals: &mut Vec<Visual>,
) -> Result<(), RobotError> {
    let rgba = match visual.child("material")? {
        None => GREY,
        Some(material) => match material.child("color")? {
            Some(colour) => colour.needed("rgba")?,
            None => *colours.get(material.text("name")?).unwrap_or(&GREY),
        },
    };
    if !rgba.iter().all(|c| (0.0..=1.0).contains(c)) {
        return Err(visual.refuse(
            format!("visual colour {rgba:?}"),
            "red, green, blue and opacity are from 0 to 1",
        ));
    }
    let number = |name: &str| shape.needed(name).map(|[number]| number);
    let shapes = match shape.tag() {
        "box" => vec![(0.0, Shape::Box(shape.needed("size")?))],
        "sphere" => vec![(0.0, Shape::Sphere(number("radius")?))],
        // A capsule is a cylinder with two rounded ends.
        round => {
            let (radius, length) = (number("radius")?, number("length")?);
            let mut shapes = vec![(0.0, Shape::Cylinder(radius, length))];
            if round == "capsule" {
                shapes.push((-length / 2.0, Shape::Sphere(radius)));
                shapes.push((length / 2.0, Shape::Sphere(radius)));
            }
            shapes
        }
    };
    for (along_z, shape) in shapes {
        let sizes = match shape {
            Shape::Box(size) => size.to_vec(),
            Shape::Cylinder(radius, length) => vec![radius, length],
            Shape::Sphere(radius) => vec![radius],
        };
        if !sizes.iter().all(|size| (0.0..=100.0).contains(size)) {
            return Err(visual.refuse(
                format!("visual of size {sizes:?}"),
                "sizes are in m, from 0 to 100",
            ));
        }
        visuals.push(Visual {
            link_from_shape: visual.pose()? * Translation3::new(0.0, 0.0, along_z),
            shape,
            rgba,
        });
    }
    Ok(())
}

fn check_mesh(link: Element<'_>, filename: &str, folder: Option<&Path>) -> Result<(), RobotError> {
    match folder.and_then(|folder| locate(filename, folder)) {
        Some(path) if !path.is_file() => Err(link.refuse(
            format!("mesh file \"{filename}\" not found ({})", path.display()),
            "put the mesh there or remove it: only primitive shapes are used",
        )),
        _ => Ok(()),
    }
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
