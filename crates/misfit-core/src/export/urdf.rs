//! The calibrated robot as a URDF: the user's own file with other numbers, or a new one where that is a DH table.
//!
//! The text is edited, not written anew: meshes, collisions, inertias, limits, extensions and comments stay as they are, and
//! so does every number that nothing was found for. A joint's offset goes into its own origin, the motion behind a joint
//! into the origins of what its link carries: joints, shapes, mass. Where the link itself is a target's, a link
//! `<link>_axis` is put between, so that its name means the calibrated frame.

use super::{Calibrated, ExportError, compare};
use crate::campaign::Campaign;
use crate::robot::{Element, Robot, RobotError, clean, escaped, inertial, origin, parse, to_urdf};
use nalgebra::Isometry3;
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

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
    let clean = clean(&own.name, &text).map_err(unfit)?;
    let document = parse(&own.name, &clean).map_err(unfit)?;
    let mut editor = Editor::new(&own.name, &text, Element::root(&own.name, &document));
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

fn unfit(source: RobotError) -> ExportError {
    ExportError::Unfit {
        source,
        advice: ADVICE,
    }
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

/// Elements of a link that have an origin.
const PARTS: [&str; 3] = ["inertial", "visual", "collision"];

/// The text, what is in it, and what is to be changed.
struct Editor<'a> {
    file: &'a str,
    text: &'a str,
    robot: Element<'a>,
    /// From and to which byte, and what is put there.
    edits: Vec<(Range<usize>, String)>,
    /// Put before the end.
    tail: String,
    added: Vec<String>,
    made_up: bool,
}

impl<'a> Editor<'a> {
    fn new(file: &'a str, text: &'a str, robot: Element<'a>) -> Self {
        Self {
            file,
            text,
            robot,
            edits: Vec::new(),
            tail: String::new(),
            added: Vec::new(),
            made_up: false,
        }
    }

    fn joints(&self) -> impl Iterator<Item = Element<'a>> + use<'a> {
        self.robot.all(&["joint"])
    }

    fn links(&self) -> impl Iterator<Item = Element<'a>> + use<'a> {
        self.robot.all(&["link"])
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
        let mut seen = BTreeSet::new();
        for joint in self.joints() {
            let parent = joint.required("parent").and_then(|role| role.text("link"));
            let before = moved.get(parent.map_err(unfit)?);
            let offset = robot.joint(joint.name()).map(|index| {
                seen.insert(index);
                (index, calibrated.offsets[index])
            });
            let mut pose = joint.pose().map_err(unfit)?;
            if let Some(before) = before {
                pose = before * pose;
            }
            if let Some((index, offset)) = offset {
                pose *= robot.joints[index].motion(offset);
            }
            if before.is_some() || offset.is_some_and(|(_, offset)| offset != 0.0) {
                self.set_origin(joint, &pose)?;
            }
        }
        if let Some(index) = (0..robot.joints.len()).find(|index| !seen.contains(index)) {
            return Err(self.lost(format!("joint \"{}\"", robot.joints[index].name)));
        }
        for link in self.links() {
            if let Some(motion) = moved.get(link.name()) {
                for part in link.all(&PARTS) {
                    let pose = motion * part.pose().map_err(unfit)?;
                    self.set_origin(part, &pose)?;
                }
            }
        }
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
        let Some(element) = self.joints().find(|element| element.name() == joint) else {
            return Err(self.lost(format!("joint \"{joint}\"")));
        };
        let tag = element.required("child").map_err(unfit)?;
        self.replace(tag, &format!("<child link=\"{}\"", escaped(&between)));
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
        if whole.mass > 0.0 {
            let factor = (whole.mass + more) / whole.mass;
            for link in self.links().filter(|link| of_body.contains(link.name())) {
                for inertial in link.all(&["inertial"]) {
                    for tag in inertial.all(&["mass", "inertia"]) {
                        self.edits.push((tag.opening(), tag.scaled(factor)));
                    }
                }
            }
            return Ok(());
        }
        self.made_up = true;
        let Some(link) = self.links().find(|link| link.name() == whole.name) else {
            return Err(self.lost(format!("link \"{}\"", whole.name)));
        };
        // An inertial without a mass may stand there already.
        if let Some(old) = link.child("inertial").map_err(unfit)? {
            let mass = old.required("mass").map_err(unfit)?;
            self.replace(mass, &format!("<mass value=\"{more:?}\""));
            return Ok(());
        }
        let pose = behind.copied().unwrap_or_else(Isometry3::identity);
        let mass = inertial(more, &pose);
        let opening = link.opening();
        match self.text[opening.clone()].strip_suffix("/>") {
            Some(start) => self.edits.push((opening, format!("{start}>{mass}</link>"))),
            None => self.edits.push((opening.end..opening.end, mass)),
        }
        Ok(())
    }

    /// Puts another first tag for an element, given without its end.
    fn replace(&mut self, element: Element<'a>, tag: &str) {
        let end = if element.is_empty() { "/>" } else { ">" };
        self.edits.push((element.opening(), format!("{tag}{end}")));
    }

    /// Gives an element another origin; one that it had not is indented as what it stands before.
    fn set_origin(
        &mut self,
        element: Element<'a>,
        pose: &Isometry3<f64>,
    ) -> Result<(), ExportError> {
        let new = origin(pose);
        match element.child("origin").map_err(unfit)? {
            Some(old) => self.replace(old, new.strip_suffix("/>").unwrap_or(&new)),
            None => {
                let at = element.opening().end;
                let rest = &self.text[at..];
                let blanks = &rest[..rest.len() - rest.trim_start().len()];
                self.edits.push((at..at, format!("{blanks}{new}")));
            }
        }
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
        if self.links().all(|link| link.name() != parent) {
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
        let mut taken: BTreeSet<&str> = self.added.iter().map(String::as_str).collect();
        taken.extend(self.robot.all(&["link", "joint"]).map(Element::name));
        while taken.contains(name.as_str()) {
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
        let at = self.robot.opening().end;
        self.edits.push((at..at, format!("\n  <!-- {note} -->")));
    }

    fn relative_meshes(&self) -> usize {
        let parts = self.links().flat_map(|link| link.all(&PARTS));
        let shapes = parts.flat_map(|part| part.all(&["geometry"]));
        let meshes = shapes.flat_map(|shape| shape.all(&["mesh"]));
        meshes
            .filter_map(|mesh| mesh.attribute("filename"))
            .filter(|name| !name.contains("://") && !name.starts_with('/'))
            .count()
    }

    fn finish(mut self) -> String {
        let end = self.robot.closing();
        if !self.tail.is_empty() {
            let tail = std::mem::take(&mut self.tail);
            let tail = match self.text[..end].ends_with('\n') {
                true => format!("\n{tail}"),
                false => format!("\n\n{tail}"),
            };
            self.edits.push((end..end, tail));
        }
        self.edits
            .sort_by_key(|(bytes, _)| (bytes.start, bytes.end));
        let mut text = String::with_capacity(self.text.len() + 1024);
        let mut at = 0;
        for (bytes, new) in &self.edits {
            text.push_str(&self.text[at..bytes.start]);
            text.push_str(new);
            at = bytes.end;
        }
        text.push_str(&self.text[at..]);
        text
    }
}
