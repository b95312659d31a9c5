//! The calibrated robot as a URDF: the user's own file with other numbers, or a new one where that is a DH table.
//!
//! The text is edited, not written anew: meshes, collisions, inertias, limits, extensions and comments stay as they are, and
//! so does every number that nothing was found for. A joint's offset goes into its own origin, the motion behind a joint
//! into the origins of what its link carries: joints, shapes, mass. Where the link itself is a target's, a link
//! `<link>_axis` is put between, so that its name means the calibrated frame.

use super::{Calibrated, ExportError, compare};
use crate::campaign::Campaign;
use crate::robot::{Robot, Tag, escaped, inertial, origin, tags, to_urdf};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// A file that was made.
#[derive(Debug, Clone)]
pub struct Written {
    /// Its text.
    pub text: String,
    /// Links that it adds, in order.
    pub added: Vec<String>,
    /// Largest difference from the model without load, over random postures: m, rad.
    pub gap: (f64, f64),
    /// Meshes named relative to the file.
    pub relative_meshes: usize,
    /// Has it masses whose inertias nobody knows?
    pub made_up_inertias: bool,
}

/// What a refused file needs.
const ADVICE: &str = "write a .json file, which holds all numbers";

/// Makes the file, reads it back, and compares it with the model; `file` names it, `note` is put into it as a comment.
///
/// # Errors
/// If the robot's own text cannot be edited, or the outcome is not the calibrated robot.
pub fn write(
    calibrated: &Calibrated,
    campaign: &Campaign,
    file: &str,
    note: &str,
) -> Result<Written, ExportError> {
    let own = &campaign.robot_file;
    let nominal = &calibrated.setup.robot;
    let is_table = own.name.to_lowercase().ends_with(".toml");
    let unfit = |source| ExportError::Unfit {
        source,
        advice: ADVICE,
    };
    let (text, generated);
    let nominal = if is_table {
        // links of its own may stand on the axes, where those of a standard table do not
        text = to_urdf(nominal);
        generated = Robot::parse("table.urdf", &text, None).map_err(unfit)?;
        &generated
    } else {
        text = own.text.clone();
        nominal
    };
    let mut editor = Editor::new(&own.name, &text);
    editor.calibrate(nominal, calibrated)?;
    editor.add_frames(calibrated)?;
    editor.comment(note);
    let weighs = nominal.bodies.iter().any(|body| body.mass > 0.0);
    let made_up_inertias = editor.made_up || is_table && weighs;
    let (relative_meshes, added) = (editor.relative_meshes(), editor.added.clone());
    let text = editor.finish();
    let robot = calibrated.robot();
    // the ending is what tells a URDF, whatever the name that was given
    let name = format!(
        "{file}{}",
        if file.ends_with(".urdf") { "" } else { ".urdf" }
    );
    let read = Robot::parse(&name, &text, own.base.as_deref()).map_err(unfit)?;
    let links: Vec<(usize, usize)> = robot
        .links
        .iter()
        .enumerate()
        .filter(|(_, link)| !stays(nominal, calibrated, link.body, &link.name))
        .filter_map(|(index, link)| Some((read.link(&link.name)?, index)))
        .collect();
    let gap = compare(file, &read, &robot, &links, ADVICE)?;
    Ok(Written {
        text,
        added,
        gap,
        relative_meshes,
        made_up_inertias,
    })
}

/// Does a link's frame stay on its joint's axis, so that what it carries is moved instead?
fn stays(robot: &Robot, calibrated: &Calibrated, body: usize, link: &str) -> bool {
    let first = body > 0 && robot.bodies[body].name == link;
    first && calibrated.motions[body] != Isometry3::identity() && !is_target(calibrated, link)
}

fn is_target(calibrated: &Calibrated, link: &str) -> bool {
    let setup = &calibrated.setup;
    let mut targets = setup.targets.iter();
    targets.any(|target| setup.robot.links[target.link].name == link)
}

/// A tag and where it begins.
type Placed<'a> = (usize, Tag<'a>);

/// An element of the robot: a joint, a link, or a part of a link that has an origin.
struct Element<'a> {
    /// Its first tag.
    opening: Placed<'a>,
    /// Tags of the elements directly in it, by name.
    inner: BTreeMap<&'a str, Placed<'a>>,
    /// Of a link: inertial, visuals and collisions.
    parts: Vec<Element<'a>>,
}

impl<'a> Element<'a> {
    fn new(opening: Placed<'a>) -> Self {
        Self {
            opening,
            inner: BTreeMap::new(),
            parts: Vec::new(),
        }
    }

    fn name(&self) -> String {
        self.opening.1.value("name").unwrap_or_default()
    }

    /// A link that it names as its parent or child.
    fn link(&self, role: &str) -> Option<String> {
        self.inner.get(role)?.1.value("link")
    }

    fn pose(&self) -> Isometry3<f64> {
        let three = |attribute: &str| {
            let text = self
                .inner
                .get("origin")
                .and_then(|origin| origin.1.value(attribute))
                .unwrap_or_default();
            let numbers: Vec<f64> = text
                .split_whitespace()
                .filter_map(|word| word.parse().ok())
                .collect();
            match numbers[..] {
                [x, y, z] => [x, y, z],
                _ => [0.0; 3],
            }
        };
        let [roll, pitch, yaw] = three("rpy");
        Isometry3::from_parts(
            Translation3::from(Vector3::from(three("xyz"))),
            UnitQuaternion::from_euler_angles(roll, pitch, yaw),
        )
    }
}

/// The text, what is in it, and what is to be changed.
struct Editor<'a> {
    file: &'a str,
    text: &'a str,
    joints: Vec<Element<'a>>,
    links: Vec<Element<'a>>,
    /// Behind the `<robot>` tag, and before the one that closes it.
    inside: (usize, usize),
    /// Meshes by their addresses.
    meshes: Vec<String>,
    /// From and to which byte, and what is put there.
    edits: Vec<(usize, usize, String)>,
    /// Put before the end.
    tail: String,
    added: Vec<String>,
    made_up: bool,
}

impl<'a> Editor<'a> {
    fn new(file: &'a str, text: &'a str) -> Self {
        let mut editor = Self {
            file,
            text,
            joints: Vec::new(),
            links: Vec::new(),
            inside: (0, text.len()),
            meshes: Vec::new(),
            edits: Vec::new(),
            tail: String::new(),
            added: Vec::new(),
            made_up: false,
        };
        let mut path: Vec<&str> = Vec::new();
        for (at, tag) in tags(text) {
            if tag.closing {
                path.pop();
                if path.is_empty() {
                    editor.inside.1 = at;
                }
                continue;
            }
            let (name, empty) = (tag.name, tag.empty);
            match path[..] {
                [] => editor.inside.0 = at + tag.text.len(),
                [_] if name == "joint" => editor.joints.push(Element::new((at, tag))),
                [_] if name == "link" => editor.links.push(Element::new((at, tag))),
                [_, "joint"] => {
                    if let Some(joint) = editor.joints.last_mut() {
                        joint.inner.entry(name).or_insert((at, tag));
                    }
                }
                [_, "link"] if ["inertial", "visual", "collision"].contains(&name) => {
                    if let Some(link) = editor.links.last_mut() {
                        link.parts.push(Element::new((at, tag)));
                    }
                }
                [_, "link", part] if ["inertial", "visual", "collision"].contains(&part) => {
                    let link = editor.links.last_mut();
                    if let Some(part) = link.and_then(|link| link.parts.last_mut()) {
                        part.inner.entry(name).or_insert((at, tag));
                    }
                }
                [_, "link", _, "geometry"] if name == "mesh" => {
                    editor.meshes.extend(tag.value("filename"));
                }
                _ => {}
            }
            if !empty {
                path.push(name);
            }
        }
        editor
    }

    fn lost(&self, what: String) -> ExportError {
        ExportError::Lost {
            file: self.file.to_owned(),
            what,
        }
    }

    /// Puts everything found into the numbers of the file.
    fn calibrate(&mut self, robot: &Robot, calibrated: &Calibrated) -> Result<(), ExportError> {
        // by name of a link whose frame stays on the axis: the motion of what it carries
        let mut moved = BTreeMap::new();
        for (body, motion) in calibrated.motions.iter().enumerate().skip(1) {
            let name = robot.bodies[body].name.as_str();
            if stays(robot, calibrated, body, name) {
                moved.insert(name, *motion);
            } else if *motion != Isometry3::identity() {
                self.put_between(&robot.joints[body - 1].name, name, motion)?;
            }
        }
        let mut edits = Vec::new();
        let mut seen = BTreeSet::new();
        for joint in &self.joints {
            let (name, parent) = (joint.name(), joint.link("parent").unwrap_or_default());
            let before = moved.get(parent.as_str());
            let offset = robot.joint(&name).map(|index| {
                seen.insert(index);
                (index, calibrated.offsets[index])
            });
            let mut pose = joint.pose();
            if let Some(before) = before {
                pose = before * pose;
            }
            if let Some((index, offset)) = offset {
                pose *= robot.joints[index].motion(offset);
            }
            if before.is_some() || offset.is_some_and(|(_, offset)| offset != 0.0) {
                edits.push(set_origin(self.text, joint, &pose));
            }
        }
        if let Some(index) = (0..robot.joints.len()).find(|index| !seen.contains(index)) {
            return Err(self.lost(format!("joint \"{}\"", robot.joints[index].name)));
        }
        for link in &self.links {
            if let Some(motion) = moved.get(link.name().as_str()) {
                for part in &link.parts {
                    edits.push(set_origin(self.text, part, &(motion * part.pose())));
                }
            }
        }
        self.edits.extend(edits);
        for (body, &more) in calibrated.masses.iter().enumerate() {
            if more != 0.0 {
                let behind = moved.get(robot.bodies[body].name.as_str());
                self.weigh(robot, body, more, behind)?;
            }
        }
        Ok(())
    }

    /// Puts a link on the axis of a joint, and its child link behind it by a fixed joint.
    fn put_between(
        &mut self,
        joint: &str,
        child: &str,
        motion: &Isometry3<f64>,
    ) -> Result<(), ExportError> {
        let between = self.unused(&format!("{child}_axis"));
        let fixed = self.unused(&format!("{child}_calibrated"));
        let found = self.joints.iter().find(|element| element.name() == joint);
        let tag = found.and_then(|element| element.inner.get("child"));
        let Some((at, tag)) = tag else {
            return Err(self.lost(format!("the child of joint \"{joint}\"")));
        };
        let end = if tag.empty { "/>" } else { ">" };
        let named = format!("<child link=\"{}\"{end}", escaped(&between));
        self.edits.push((*at, at + tag.text.len(), named));
        self.append(&between);
        self.attach(&fixed, &between, child, motion);
        Ok(())
    }

    /// Makes a body weigh more at its centre of mass: all its links by the same share, as if of a denser stuff.
    fn weigh(
        &mut self,
        robot: &Robot,
        body: usize,
        more: f64,
        behind: Option<&Isometry3<f64>>,
    ) -> Result<(), ExportError> {
        let whole = &robot.bodies[body];
        let of_body: BTreeSet<&str> = robot
            .links
            .iter()
            .filter(|link| link.body == body)
            .map(|link| link.name.as_str())
            .collect();
        let mut edits = Vec::new();
        if whole.mass > 0.0 {
            let factor = (whole.mass + more) / whole.mass;
            for link in &self.links {
                if !of_body.contains(link.name().as_str()) {
                    continue;
                }
                let inertials = link.parts.iter().filter(|p| p.opening.1.name == "inertial");
                for (at, tag) in inertials
                    .flat_map(|p| ["mass", "inertia"].map(|n| p.inner.get(n)))
                    .flatten()
                {
                    edits.push((*at, at + tag.text.len(), scaled(tag, factor)));
                }
            }
        } else {
            let found = self.links.iter().find(|link| link.name() == whole.name);
            let Some(link) = found else {
                return Err(self.lost(format!("link \"{}\"", whole.name)));
            };
            let pose = behind.copied().unwrap_or_else(Isometry3::identity);
            let mass = inertial(more, &pose);
            let (at, tag) = &link.opening;
            let end = at + tag.text.len();
            // an inertial without a mass may stand there already
            let old = link.parts.iter().find(|p| p.opening.1.name == "inertial");
            match (old, tag.text.strip_suffix("/>")) {
                (Some(old), _) => {
                    if let Some((at, tag)) = old.inner.get("mass") {
                        let end = if tag.empty { "/>" } else { ">" };
                        let mass = format!("<mass value=\"{more:?}\"{end}");
                        edits.push((*at, at + tag.text.len(), mass));
                    }
                }
                (None, Some(opening)) => {
                    edits.push((*at, end, format!("{opening}>{mass}</link>")));
                }
                (None, None) => edits.push((end, end, mass)),
            }
            self.made_up = true;
        }
        self.edits.extend(edits);
        Ok(())
    }

    /// Adds links for the tracker on the base and for each target on its link.
    fn add_frames(&mut self, calibrated: &Calibrated) -> Result<(), ExportError> {
        let setup = &calibrated.setup;
        if let Some(pose) = &calibrated.base_from_tracker {
            let base = setup.robot.links.iter().find(|link| link.body == 0);
            let base = base.map_or_else(String::new, |link| link.name.clone());
            self.hang("tracker", &base, pose)?;
        }
        for (target, pose) in setup.targets.iter().zip(&calibrated.link_from_target) {
            if let Some(pose) = pose {
                let link = &setup.robot.links[target.link].name;
                self.hang(&format!("{}_target", target.name), link, pose)?;
            }
        }
        Ok(())
    }

    fn hang(&mut self, name: &str, parent: &str, pose: &Isometry3<f64>) -> Result<(), ExportError> {
        if self.links.iter().all(|link| link.name() != parent) {
            return Err(self.lost(format!("link \"{parent}\"")));
        }
        let name = self.unused(name);
        self.append(&name);
        let joint = self.unused(&format!("{name}_fixed"));
        self.attach(&joint, parent, &name, pose);
        Ok(())
    }

    fn append(&mut self, link: &str) {
        self.tail += &format!("  <link name=\"{}\"/>\n", escaped(link));
        self.added.push(link.to_owned());
    }

    fn attach(&mut self, joint: &str, parent: &str, child: &str, pose: &Isometry3<f64>) {
        self.tail += &format!(
            "  <joint name=\"{}\" type=\"fixed\">\n    <parent link=\"{}\"/>\n    <child link=\"{}\"/>\n    {}\n  </joint>\n",
            escaped(joint),
            escaped(parent),
            escaped(child),
            origin(pose)
        );
    }

    /// A name that no link and no joint of the file has.
    fn unused(&self, name: &str) -> String {
        let mut name = name.to_owned();
        let mut taken: BTreeSet<String> = self.added.iter().cloned().collect();
        taken.extend(self.links.iter().chain(&self.joints).map(Element::name));
        while taken.contains(&name) {
            name.push('_');
        }
        name
    }

    /// Two hyphens would end a comment.
    fn comment(&mut self, note: &str) {
        let mut note = note.to_owned();
        while note.contains("--") {
            note = note.replace("--", "- -");
        }
        let at = self.inside.0;
        self.edits.push((at, at, format!("\n  <!-- {note} -->")));
    }

    fn relative_meshes(&self) -> usize {
        let relative = |name: &&String| !name.contains("://") && !name.starts_with('/');
        self.meshes.iter().filter(relative).count()
    }

    fn finish(mut self) -> String {
        let end = self.inside.1;
        if !self.tail.is_empty() {
            let tail = std::mem::take(&mut self.tail);
            let tail = match self.text[..end].ends_with('\n') {
                true => format!("\n{tail}"),
                false => format!("\n\n{tail}"),
            };
            self.edits.push((end, end, tail));
        }
        self.edits.sort_by_key(|edit| (edit.0, edit.1));
        let mut text = String::with_capacity(self.text.len() + 1024);
        let mut at = 0;
        for (from, to, new) in &self.edits {
            text.push_str(&self.text[at..*from]);
            text.push_str(new);
            at = *to;
        }
        text.push_str(&self.text[at..]);
        text
    }
}

/// Gives an element another origin; one that it had not is indented as what it stands before.
fn set_origin(text: &str, element: &Element<'_>, pose: &Isometry3<f64>) -> (usize, usize, String) {
    let new = origin(pose);
    match element.inner.get("origin") {
        Some((at, tag)) if tag.empty => (*at, at + tag.text.len(), new),
        Some((at, tag)) => {
            let open = new.strip_suffix("/>").unwrap_or(&new);
            (*at, at + tag.text.len(), format!("{open}>"))
        }
        None => {
            let (at, tag) = &element.opening;
            let at = at + tag.text.len();
            let rest = &text[at..];
            let blanks = &rest[..rest.len() - rest.trim_start().len()];
            (at, at, format!("{blanks}{new}"))
        }
    }
}

/// A tag all of whose numbers are multiplied.
fn scaled(tag: &Tag<'_>, factor: f64) -> String {
    let mut text = format!("<{}", tag.name);
    for (name, value) in &tag.attributes {
        let number = value
            .trim()
            .parse::<f64>()
            .map(|x| format!("{:?}", x * factor));
        text += &format!(" {name}=\"{}\"", number.as_deref().unwrap_or(value));
    }
    text + if tag.empty { "/>" } else { ">" }
}
