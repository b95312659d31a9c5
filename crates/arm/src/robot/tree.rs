//! A robot file's links and joints before folding, whatever its format, and their folding into bodies.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Isometry3, Unit, Vector3};

use super::{Body, Joint, JointKind, Link, Robot, RobotError, Visual};

/// More links than this are a mistake, and would make everything after it slow.
pub(super) const MAX_LINKS: usize = 1000;
/// Longest offset accepted, m: beyond it the file is in millimetres.
const MAX_LENGTH: f64 = 100.0;
/// Heaviest link accepted, kg: beyond it the file is in grams.
const MAX_MASS: f64 = 1.0e5;

/// A robot as its file tells it.
pub(super) struct Tree {
    pub name: String,
    pub links: Vec<TreeLink>,
    pub joints: Vec<TreeJoint>,
}

/// A link; lengths in m in the link's frame, mass in kg.
pub(super) struct TreeLink {
    pub name: String,
    pub mass: f64,
    pub com: Vector3<f64>,
    pub visuals: Vec<Visual>,
}

/// A joint between two links named.
pub(super) struct TreeJoint {
    pub name: String,
    /// `None` is a fixed joint.
    pub kind: Option<JointKind>,
    /// Why it cannot be part of an arm, if so; outside the part kept it does no harm.
    pub unsupported: Option<String>,
    pub parent: String,
    pub child: String,
    /// Pose of the joint frame at q = 0 in the parent link's frame.
    pub parent_from_joint: Isometry3<f64>,
    /// Pose of the child link in the moved joint frame: the identity in a URDF, what follows the axis in a standard DH row.
    pub joint_from_child: Isometry3<f64>,
    pub axis: Vector3<f64>,
    pub limits: Option<(f64, f64)>,
    pub effort: Option<f64>,
}

impl Tree {
    /// Checks the whole file, then keeps what hangs on `base` and folds its fixed joints.
    pub fn assemble(&self, file: &str, base: Option<&str>) -> Result<Robot, RobotError> {
        let links = self.index_links(file)?;
        let parents = self.index_parents(file, &links)?;
        let root = self.find_root(file, &parents)?;
        self.check_numbers(file)?;
        let base = match base {
            None => root,
            Some(name) => *links.get(name).ok_or_else(|| {
                let known: Vec<_> = self.links.iter().map(|l| l.name.as_str()).collect();
                RobotError::refused(
                    file,
                    format!("base link \"{name}\""),
                    "there is no such link",
                    format!("the links are {}", abbreviate(&known)),
                )
            })?,
        };
        self.fold(file, base, &links)
    }

    fn index_links(&self, file: &str) -> Result<BTreeMap<&str, usize>, RobotError> {
        if self.links.is_empty() {
            return Err(RobotError::refused(
                file,
                "robot",
                "has no link",
                "a robot has at least two links and a moving joint between them",
            ));
        }
        if self.links.len() > MAX_LINKS {
            return Err(too_many_links(file, self.links.len(), self.joints.len()));
        }
        let mut links = BTreeMap::new();
        for (index, link) in self.links.iter().enumerate() {
            if link.name.trim().is_empty() {
                return Err(RobotError::refused(
                    file,
                    format!("link number {}", index + 1),
                    "its name is empty",
                    "every link needs a name of its own",
                ));
            }
            if links.insert(link.name.as_str(), index).is_some() {
                return Err(RobotError::refused(
                    file,
                    format!("link \"{}\"", link.name),
                    "two links have this name",
                    "every link needs a name of its own",
                ));
            }
        }
        Ok(links)
    }

    /// For each link, the joint it is the child of.
    fn index_parents(
        &self,
        file: &str,
        links: &BTreeMap<&str, usize>,
    ) -> Result<Vec<Option<usize>>, RobotError> {
        let mut names = BTreeSet::new();
        let mut parents = vec![None; self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            let refuse = |found: String, accepted: &str| {
                Err(RobotError::refused(
                    file,
                    format!("joint \"{}\"", joint.name),
                    found,
                    accepted,
                ))
            };
            if joint.name.trim().is_empty() || !names.insert(&joint.name) {
                return refuse(
                    "its name is empty or another joint has it too".to_owned(),
                    "every joint needs a name of its own",
                );
            }
            for (role, name) in [("parent", &joint.parent), ("child", &joint.child)] {
                if !links.contains_key(name.as_str()) {
                    return refuse(
                        format!("its {role} link \"{name}\" does not exist"),
                        "parent and child must name links of this file",
                    );
                }
            }
            let child = links[joint.child.as_str()];
            if let Some(other) = parents[child] {
                let other: &TreeJoint = &self.joints[other];
                return refuse(
                    format!(
                        "its child link \"{}\" already hangs on joint \"{}\"",
                        joint.child, other.name
                    ),
                    "a link has one parent: closed chains are not supported",
                );
            }
            parents[child] = Some(index);
        }
        Ok(parents)
    }

    fn find_root(&self, file: &str, parents: &[Option<usize>]) -> Result<usize, RobotError> {
        let roots: Vec<usize> = (0..self.links.len())
            .filter(|&link| parents[link].is_none())
            .collect();
        // Every link has at most one parent, so whatever cannot be reached from a root lies on or behind a loop.
        let mut children = BTreeMap::<&str, Vec<&str>>::new();
        for joint in &self.joints {
            children
                .entry(&joint.parent)
                .or_default()
                .push(&joint.child);
        }
        let mut reached = BTreeSet::new();
        let mut waiting: Vec<&str> = roots.iter().map(|&r| self.links[r].name.as_str()).collect();
        while let Some(link) = waiting.pop() {
            reached.insert(link);
            waiting.extend(children.get(link).into_iter().flatten());
        }
        if let Some(joint) = self
            .joints
            .iter()
            .find(|joint| !reached.contains(joint.child.as_str()))
        {
            return Err(RobotError::refused(
                file,
                format!("joint \"{}\"", joint.name),
                "it is part of a loop of joints or hangs on one",
                "links and joints must form a tree with one root",
            ));
        }
        match roots[..] {
            [root] => Ok(root),
            _ => {
                let names: Vec<_> = roots.iter().map(|&r| self.links[r].name.as_str()).collect();
                Err(RobotError::refused(
                    file,
                    format!("links {}", abbreviate(&names)),
                    format!("{} links hang on no joint", roots.len()),
                    "exactly one link, the root, may have no parent",
                ))
            }
        }
    }

    fn check_numbers(&self, file: &str) -> Result<(), RobotError> {
        for link in &self.links {
            let place = format!("link \"{}\"", link.name);
            if !(0.0..=MAX_MASS).contains(&link.mass) {
                return Err(RobotError::refused(
                    file,
                    place,
                    format!("mass {} kg", link.mass),
                    format!("a mass is from 0 to {MAX_MASS:.0} kg"),
                ));
            }
            check_length(file, &place, "centre of mass", &link.com)?;
            for visual in &link.visuals {
                check_pose(file, &place, "visual origin", &visual.link_from_shape)?;
            }
        }
        for joint in &self.joints {
            let place = format!("joint \"{}\"", joint.name);
            let refuse = |found: String, accepted: &str| {
                Err(RobotError::refused(file, place.as_str(), found, accepted))
            };
            check_pose(file, &place, "origin", &joint.parent_from_joint)?;
            check_pose(file, &place, "origin", &joint.joint_from_child)?;
            if joint.kind.is_some() {
                let norm = joint.axis.norm();
                if !(1.0e-6..1.0e6).contains(&norm) {
                    let [x, y, z] = joint.axis.into();
                    return refuse(
                        format!("axis {x} {y} {z}"),
                        "an axis is a finite direction other than zero, such as 0 0 1",
                    );
                }
            }
            if let Some((lower, upper)) = joint.limits {
                if !(lower.is_finite() && upper.is_finite()) {
                    return refuse(
                        format!("limits {lower} to {upper}"),
                        "limits are two finite numbers, or both are left out",
                    );
                }
                if lower > upper {
                    return refuse(
                        format!("lower limit {lower} above upper limit {upper}"),
                        "the lower limit comes first",
                    );
                }
            }
            if let Some(effort) = joint.effort
                && !(effort > 0.0 && effort.is_finite())
            {
                return refuse(
                    format!("effort {effort}"),
                    "an effort is a finite number above zero, or is left out",
                );
            }
        }
        Ok(())
    }

    fn fold(
        &self,
        file: &str,
        base: usize,
        links: &BTreeMap<&str, usize>,
    ) -> Result<Robot, RobotError> {
        let mut below = vec![Vec::new(); self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            below[links[joint.parent.as_str()]].push(index);
        }
        let mut robot = Robot {
            name: self.name.clone(),
            joints: Vec::new(),
            bodies: Vec::new(),
            links: Vec::new(),
        };
        robot.bodies.push(empty_body(&self.links[base].name));
        // Where each link already visited stands: its body, and its pose in it.
        let mut placed = BTreeMap::new();
        place(&mut robot, &self.links[base], 0, Isometry3::identity());
        placed.insert(base, (0, Isometry3::identity()));
        // Always the first joint of the file that can be taken: file order is kept wherever the tree allows it.
        let mut ready: BTreeSet<usize> = below[base].iter().copied().collect();
        while let Some(index) = ready.pop_first() {
            let joint = &self.joints[index];
            if let Some(why) = &joint.unsupported {
                return Err(RobotError::refused(
                    file,
                    format!("joint \"{}\"", joint.name),
                    why.as_str(),
                    "below the base only revolute, continuous, prismatic and fixed joints are accepted, each free",
                ));
            }
            let (parent_body, body_from_parent) = placed[&links[joint.parent.as_str()]];
            let body_from_joint = body_from_parent * joint.parent_from_joint;
            let (body, body_from_child) = match joint.kind {
                None => (parent_body, body_from_joint * joint.joint_from_child),
                Some(kind) => {
                    robot.joints.push(Joint {
                        name: joint.name.clone(),
                        kind,
                        parent: parent_body,
                        parent_from_joint: body_from_joint,
                        axis: Unit::new_normalize(joint.axis),
                        limits: joint.limits,
                        effort: joint.effort,
                    });
                    robot.bodies.push(empty_body(&joint.child));
                    (robot.bodies.len() - 1, joint.joint_from_child)
                }
            };
            let child = links[joint.child.as_str()];
            place(&mut robot, &self.links[child], body, body_from_child);
            placed.insert(child, (body, body_from_child));
            ready.extend(&below[child]);
        }
        if robot.joints.is_empty() {
            return Err(RobotError::refused(
                file,
                format!("base link \"{}\"", self.links[base].name),
                "no moving joint hangs on it",
                "an arm has at least one revolute, continuous or prismatic joint",
            ));
        }
        Ok(robot)
    }
}

fn empty_body(name: &str) -> Body {
    Body {
        name: name.to_owned(),
        mass: 0.0,
        com: Vector3::zeros(),
    }
}

/// Adds a link to the robot and its mass to its body.
fn place(robot: &mut Robot, link: &TreeLink, body: usize, body_from_link: Isometry3<f64>) {
    let whole = &mut robot.bodies[body];
    let mass = whole.mass + link.mass;
    if mass > 0.0 {
        let com = body_from_link * nalgebra::Point3::from(link.com);
        whole.com += (com.coords - whole.com) * (link.mass / mass);
        whole.mass = mass;
    }
    robot.links.push(Link {
        name: link.name.clone(),
        body,
        body_from_link,
        visuals: link.visuals.clone(),
    });
}

/// The message for a file with an absurd number of links or joints, counted so far.
pub(super) fn too_many_links(file: &str, links: usize, joints: usize) -> RobotError {
    RobotError::refused(
        file,
        "robot",
        match links >= joints {
            true => format!("has {links} links"),
            false => format!("has {joints} joints"),
        },
        format!("at most {MAX_LINKS} are accepted"),
    )
}

fn check_pose(
    file: &str,
    place: &str,
    what: &str,
    pose: &Isometry3<f64>,
) -> Result<(), RobotError> {
    if !pose.rotation.coords.iter().all(|c| c.is_finite()) {
        return Err(RobotError::refused(
            file,
            place,
            format!("the rotation of its {what} is not finite"),
            "rpy takes three finite numbers in rad",
        ));
    }
    check_length(file, place, what, &pose.translation.vector)
}

fn check_length(
    file: &str,
    place: &str,
    what: &str,
    length: &Vector3<f64>,
) -> Result<(), RobotError> {
    if length.iter().all(|c| c.abs() <= MAX_LENGTH) {
        return Ok(());
    }
    let [x, y, z] = (*length).into();
    Err(RobotError::refused(
        file,
        place,
        format!("{what} {x} {y} {z}"),
        format!("lengths are finite, in m, and at most {MAX_LENGTH}"),
    ))
}

/// Quoted names, the first dozen of them.
fn abbreviate(names: &[&str]) -> String {
    const SHOWN: usize = 12;
    let mut text = names
        .iter()
        .take(SHOWN)
        .map(|name| format!("\"{name}\""))
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > SHOWN {
        text += &format!(" and {} more", names.len() - SHOWN);
    }
    text
}
