//! One element of a URDF: its parts, numbers and poses, and messages that name it by part and line.

use std::ops::Range;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use roxmltree::{Document, Node};

use super::RobotError;
use super::error::short;
use super::xml;

/// An element of the file that messages name.
#[derive(Clone, Copy)]
pub struct Element<'a> {
    file: &'a str,
    node: Node<'a, 'a>,
}

impl<'a> Element<'a> {
    /// The `<robot>`.
    pub fn root(file: &'a str, document: &'a Document<'a>) -> Self {
        let node = document.root_element();
        Self { file, node }
    }

    /// Its name as a tag; empty for extensions of other namespaces, such as `<x:link>`.
    pub fn tag(self) -> &'a str {
        let tag = self.node.tag_name();
        match tag.namespace() == self.node.default_namespace() {
            true => tag.name(),
            false => "",
        }
    }

    /// The elements directly in it, in file order.
    pub fn children(self) -> impl Iterator<Item = Self> {
        let file = self.file;
        let nodes = self.node.children().filter(Node::is_element);
        nodes.map(move |node| Self { file, node })
    }

    /// Those with one of these tags.
    pub fn all<'b>(self, tags: &'b [&str]) -> impl Iterator<Item = Self> + use<'a, 'b> {
        self.children()
            .filter(move |child| tags.contains(&child.tag()))
    }

    /// The element of this tag directly in it.
    ///
    /// # Errors
    /// If there are several.
    pub fn child(self, tag: &str) -> Result<Option<Self>, RobotError> {
        let mut found = self.children().filter(|child| child.tag() == tag);
        let first = found.next();
        match found.next() {
            None => Ok(first),
            Some(second) => Err(second.refuse(
                format!("a second <{tag}> on line {}", second.line()),
                format!("<{}> takes one <{tag}>", self.tag()),
            )),
        }
    }

    /// The same where it must not be missing.
    ///
    /// # Errors
    /// If there is none, or several.
    pub fn required(self, tag: &str) -> Result<Self, RobotError> {
        self.child(tag)?.ok_or_else(|| {
            self.refuse(
                format!("<{}> on line {} has no <{tag}>", self.tag(), self.line()),
                format!("<{}> takes one <{tag}>", self.tag()),
            )
        })
    }

    /// An attribute, with the entities of XML resolved.
    pub fn attribute(self, name: &str) -> Option<&'a str> {
        self.node.attribute(name)
    }

    /// Its own name; empty where it has none.
    pub fn name(self) -> &'a str {
        self.attribute("name").unwrap_or_default()
    }

    /// An attribute that must not be missing.
    ///
    /// # Errors
    /// If it is missing.
    pub fn text(self, name: &str) -> Result<&'a str, RobotError> {
        self.attribute(name).ok_or_else(|| self.missing(name))
    }

    /// A number, if it is given.
    ///
    /// # Errors
    /// If it is no finite number.
    pub fn number(self, name: &str) -> Result<Option<f64>, RobotError> {
        Ok(self.numbers::<1>(name)?.map(|[number]| number))
    }

    /// Numbers separated by blanks, if they are given.
    ///
    /// # Errors
    /// If these are not `N` finite numbers.
    pub fn numbers<const N: usize>(self, name: &str) -> Result<Option<[f64; N]>, RobotError> {
        let Some(text) = self.attribute(name) else {
            return Ok(None);
        };
        let words = text.split_whitespace().map(str::parse);
        let numbers: Result<Vec<f64>, _> = words.collect();
        match numbers.ok().and_then(|numbers| numbers.try_into().ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(self.refuse(
                format!("{name}=\"{}\" on line {}", short(text), self.line()),
                match N {
                    1 => "only a number is accepted".to_owned(),
                    _ => format!("only {N} numbers separated by blanks are accepted"),
                },
            )),
        }
    }

    /// Numbers that must not be missing.
    ///
    /// # Errors
    /// If it is missing, or these are not `N` finite numbers.
    pub fn needed<const N: usize>(self, name: &str) -> Result<[f64; N], RobotError> {
        self.numbers(name)?.ok_or_else(|| self.missing(name))
    }

    /// The pose that its `<origin>` gives, m and rad: fixed-axis roll, pitch, yaw, `Rz(yaw) Ry(pitch) Rx(roll)`, or
    /// from version 1.1 of the format on a quaternion x y z w.
    ///
    /// # Errors
    /// If a number is not finite, or the quaternion is no unit one.
    pub fn pose(self) -> Result<Isometry3<f64>, RobotError> {
        let Some(origin) = self.child("origin")? else {
            return Ok(Isometry3::identity());
        };
        let xyz = origin.numbers("xyz")?.unwrap_or([0.0; 3]);
        let rpy: Option<[f64; 3]> = origin.numbers("rpy")?;
        let quaternion = match origin.version() >= (1, 1) {
            true => origin.numbers("quat_xyzw")?,
            false => None,
        };
        let rotation = match (quaternion, rpy) {
            (None, rpy) => {
                let [roll, pitch, yaw] = rpy.unwrap_or_default();
                UnitQuaternion::from_euler_angles(roll, pitch, yaw)
            }
            (Some([x, y, z, w]), None) => {
                let unit = UnitQuaternion::try_new(Quaternion::new(w, x, y, z), f64::MIN_POSITIVE);
                unit.ok_or_else(|| {
                    origin.refuse(
                        format!("quat_xyzw=\"{x} {y} {z} {w}\" on line {}", origin.line()),
                        "a quaternion has a length above zero",
                    )
                })?
            }
            (Some(_), Some(_)) => {
                return Err(origin.refuse(
                    format!("both rpy and quat_xyzw on line {}", origin.line()),
                    "give one of them",
                ));
            }
        };
        Ok(Isometry3::from_parts(Translation3::from(xyz), rotation))
    }

    /// Version of the format, 1.0 where the file states none.
    pub fn version(self) -> (u32, u32) {
        let root = self.node.document().root_element();
        let stated = root.attribute("version").and_then(|version| {
            let (major, minor) = version.trim().split_once('.')?;
            Some((major.parse().ok()?, minor.parse().ok()?))
        });
        stated.unwrap_or((1, 0))
    }

    /// The bytes of the file that its first tag takes.
    pub fn opening(self) -> Range<usize> {
        let Range { start, end } = self.node.range();
        let end = match self.node.first_child() {
            Some(first) => first.range().start,
            None if self.is_empty() => end,
            None => end - self.closing_length(),
        };
        start..end
    }

    /// The byte of the file where its last tag begins, if it has two.
    pub fn closing(self) -> usize {
        self.node.range().end - self.closing_length()
    }

    fn closing_length(self) -> usize {
        let source = xml::source(self.node);
        source.len() - source.rfind("</").unwrap_or(source.len())
    }

    /// Is it a single tag, `<…/>`?
    pub fn is_empty(self) -> bool {
        xml::is_empty(self.node)
    }

    /// Its first tag with all numbers multiplied, all else as it stands.
    pub fn scaled(self, factor: f64) -> String {
        let mut text = format!("<{}", self.tag());
        for attribute in self.node.attributes() {
            let source = &self.node.document().input_text()[attribute.range()];
            text += &match attribute.value().trim().parse::<f64>() {
                Ok(number) => format!(" {}=\"{:?}\"", attribute.name(), number * factor),
                Err(_) => format!(" {source}"),
            };
        }
        text + if self.is_empty() { "/>" } else { ">" }
    }

    fn missing(self, attribute: &str) -> RobotError {
        let tag = self.tag();
        self.refuse(
            format!("<{tag}> on line {} has no {attribute}", self.line()),
            format!("write <{tag} {attribute}=\"…\">"),
        )
    }

    fn line(self) -> usize {
        xml::line(self.node.document().input_text(), self.node.range().start)
    }

    /// Refuses what was found in it, naming the link, joint or material that it belongs to.
    pub fn refuse(self, found: impl Into<String>, accepted: impl Into<String>) -> RobotError {
        let root = self.node.document().root_element();
        let mut around = self.node.ancestors();
        let part = around.find(|node| node.parent() == Some(root));
        let file = self.file;
        let part = part.map_or(self, |node| Self { file, node });
        let (tag, line) = (part.tag(), part.line());
        let place = match part.attribute("name") {
            Some(name) => format!("{tag} \"{}\" (line {line})", short(name)),
            None => format!("{tag} (line {line})"),
        };
        RobotError::refused(file, place, found, accepted)
    }
}
