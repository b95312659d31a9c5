//! `campaign.toml`: what may stand in it, what it means, and how it is written.

use super::error::{CampaignError, quoted};
use super::keys::Keys;
use super::layout::Layout;
use super::mapping::Mapping;
use super::orientation::unit_quaternion;
use super::{Campaign, Frame, Noise, Target};
use crate::input;
use crate::robot::Robot;
use nalgebra::{Isometry3, Translation3, Vector3};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::fmt::Write;
use toml::Value;

/// Gravity where the file does not say, base frame, m/s².
const STANDARD_GRAVITY: [f64; 3] = [0.0, 0.0, -9.81];

/// The file as written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Document {
    /// Path of the robot file, relative to this one.
    pub robot: String,
    /// The URDF's root if left out.
    pub base: Option<String>,
    /// The table, its path relative to this file; a recording has none.
    table: Option<Value>,
    /// The user's own header words.
    columns: Option<toml::Table>,
    gravity: Option<[f64; 3]>,
    #[serde(default, rename = "target")]
    targets: Vec<TargetEntry>,
    #[serde(default)]
    frames: FramesEntry,
    noise: Option<NoiseEntry>,
    split: Option<SplitEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TargetEntry {
    name: String,
    link: String,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct FramesEntry {
    base_from_tracker: Option<Value>,
    link_from_target: Option<Value>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
struct NoiseEntry {
    position_m: Option<f64>,
    position_per_metre: Option<f64>,
    radial_position_m: Option<f64>,
    radial_position_per_metre: Option<f64>,
    orientation_rad: Option<f64>,
    joint_rad: Option<f64>,
    force_N: Option<f64>,
    torque_Nm: Option<f64>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SplitEntry {
    column: Option<String>,
    fraction: Option<f64>,
    seed: Option<u64>,
}

/// Which readings are held out.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum SplitRule {
    /// None.
    None,
    /// A column of the table says.
    Column(String),
    /// This share of the poses, drawn with this seed.
    Fraction(f64, u64),
}

/// The parts of a campaign that its file settles, the robot being known.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Gravity in the base frame, m/s².
    pub gravity: Vector3<f64>,
    /// What the tracker sees.
    pub targets: Vec<Target>,
    /// Where the tracker stands in the robot's base frame.
    pub base_from_tracker: Frame,
    /// Where each target sits on its link.
    pub link_from_target: Vec<Frame>,
    /// What the file says of the noise.
    pub noise: Option<Noise>,
    pub(super) split: SplitRule,
    pub(super) layout: Option<Layout>,
    pub(super) mapping: Option<Mapping>,
}

impl Document {
    /// Reads the text of a campaign file; `file` names it in messages.
    ///
    /// # Errors
    /// If it is no TOML, or has a key that is not known.
    pub fn parse(file: &str, text: &str) -> Result<Self, CampaignError> {
        input::toml(text).map_err(|message| CampaignError::Toml {
            file: file.into(),
            message,
        })
    }

    /// The same from a table: the part of a scenario that is written like a campaign.
    ///
    /// # Errors
    /// If it has a key that is not known.
    pub fn from_table(file: &str, table: toml::Table) -> Result<Self, CampaignError> {
        table
            .try_into()
            .map_err(|error: toml::de::Error| CampaignError::Toml {
                file: file.into(),
                message: error.to_string().trim_end().to_owned(),
            })
    }

    /// Gives the written words their meaning on this robot.
    ///
    /// # Errors
    /// If a word has no meaning there: a link, a unit, a frame, a share.
    pub fn settle(&self, file: &str, robot: &Robot) -> Result<Settings, CampaignError> {
        let keys = Keys { file };
        let gravity = self.gravity.unwrap_or(STANDARD_GRAVITY);
        if !gravity.iter().all(|x| x.is_finite()) {
            return keys.refuse(
                "gravity",
                format!("{gravity:?}"),
                "three finite numbers, m/s²",
            );
        }
        let targets = self.targets(&keys, robot)?;
        let base_from_tracker = match &self.frames.base_from_tracker {
            None => Frame::Estimate,
            Some(value) => keys.frame("frames.base_from_tracker", value)?,
        };
        let link_from_target = self.link_from_target(&keys, &targets)?;
        let split = keys.split(self.split.as_ref())?;
        let layout = self.table.as_ref();
        let layout = layout
            .map(|value| Layout::settle(&keys, value))
            .transpose()?;
        let mapping = self.columns.as_ref();
        let mapping = mapping
            .map(|table| Mapping::settle(&keys, table, robot, &targets))
            .transpose()?;
        if split != SplitRule::None && mapping.as_ref().is_some_and(Mapping::has_split) {
            return keys.refuse(
                "columns.split",
                "a column of the split beside [split]".into(),
                "one of the two",
            );
        }
        Ok(Settings {
            gravity: Vector3::from(gravity),
            targets,
            base_from_tracker,
            link_from_target,
            noise: self
                .noise
                .as_ref()
                .map(|noise| keys.noise(noise))
                .transpose()?,
            split,
            layout,
            mapping,
        })
    }

    fn targets(&self, keys: &Keys<'_>, robot: &Robot) -> Result<Vec<Target>, CampaignError> {
        if self.targets.is_empty() {
            return keys.refuse(
                "target",
                "none".into(),
                "at least one [[target]] with name and link",
            );
        }
        let mut targets: Vec<Target> = Vec::new();
        for TargetEntry { name, link } in &self.targets {
            if name.trim().is_empty()
                || name.trim() != name
                || name.chars().any(char::is_control)
                || targets.iter().any(|target| target.name == *name)
            {
                return keys.refuse(
                    "target.name",
                    quoted(name),
                    "a name of its own for each target, without outer blanks",
                );
            }
            let Some(link) = robot.link(link) else {
                let links: Vec<&str> = robot.links.iter().map(|l| l.name.as_str()).collect();
                return keys.refuse(
                    "target.link",
                    quoted(link),
                    &format!("a link of the robot: {}", first_names(&links)),
                );
            };
            targets.push(Target {
                name: name.clone(),
                link,
            });
        }
        Ok(targets)
    }

    fn link_from_target(
        &self,
        keys: &Keys<'_>,
        targets: &[Target],
    ) -> Result<Vec<Frame>, CampaignError> {
        let key = "frames.link_from_target";
        match &self.frames.link_from_target {
            None => Ok(vec![Frame::Estimate; targets.len()]),
            Some(Value::Table(table)) => {
                if let Some(unknown) = table.keys().find(|k| targets.iter().all(|t| t.name != **k))
                {
                    let names: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
                    return keys.refuse(
                        key,
                        quoted(unknown),
                        &format!("names of targets: {}", first_names(&names)),
                    );
                }
                targets
                    .iter()
                    .map(|target| match table.get(&target.name) {
                        None => Ok(Frame::Estimate),
                        Some(value) => keys.frame(&format!("{key}.{}", target.name), value),
                    })
                    .collect()
            }
            Some(value) => Ok(vec![keys.frame(key, value)?; targets.len()]),
        }
    }
}

impl Keys<'_> {
    fn frame(&self, key: &str, value: &Value) -> Result<Frame, CampaignError> {
        let accepted =
            "\"estimate\", or a pose [x, y, z, qw, qx, qy, qz] in m with a unit quaternion";
        let numbers: Option<Vec<f64>> = match value {
            Value::String(word) if word == "estimate" => return Ok(Frame::Estimate),
            Value::Array(items) => items.iter().map(number).collect(),
            _ => None,
        };
        match numbers.as_deref() {
            Some(&[x, y, z, qw, qx, qy, qz]) if [x, y, z].iter().all(|v| v.is_finite()) => {
                match unit_quaternion([qw, qx, qy, qz]) {
                    Ok(rotation) => Ok(Frame::Known(Isometry3::from_parts(
                        Translation3::new(x, y, z),
                        rotation,
                    ))),
                    Err(norm) => self.refuse(key, format!("a quaternion of norm {norm}"), accepted),
                }
            }
            _ => self.refuse(key, shown(value), accepted),
        }
    }

    fn noise(&self, entry: &NoiseEntry) -> Result<Noise, CampaignError> {
        let position = entry.position_m.unwrap_or(0.0);
        let position_per_metre = entry.position_per_metre.unwrap_or(0.0);
        let noise = Noise {
            position,
            position_per_metre,
            radial: entry.radial_position_m.unwrap_or(position),
            radial_per_metre: entry
                .radial_position_per_metre
                .unwrap_or(position_per_metre),
            orientation: entry.orientation_rad.unwrap_or(0.0),
            joint: entry.joint_rad.unwrap_or(0.0),
            force: entry.force_N.unwrap_or(0.0),
            torque: entry.torque_Nm.unwrap_or(0.0),
        };
        for (key, value) in noise.by_key() {
            if !value.is_finite() || value < 0.0 {
                return self.refuse(
                    &format!("noise.{key}"),
                    format!("{value}"),
                    "one standard deviation, finite, zero or more",
                );
            }
        }
        Ok(noise)
    }

    fn split(&self, entry: Option<&SplitEntry>) -> Result<SplitRule, CampaignError> {
        let Some(entry) = entry else {
            return Ok(SplitRule::None);
        };
        match (&entry.column, entry.fraction, entry.seed) {
            (Some(column), None, None) => Ok(SplitRule::Column(column.trim().to_owned())),
            (None, Some(fraction), Some(seed)) if (0.0..1.0).contains(&fraction) => {
                Ok(SplitRule::Fraction(fraction, seed))
            }
            (None, Some(fraction), Some(_)) => self.refuse(
                "split.fraction",
                format!("{fraction}"),
                "a share of the poses, at least 0 and below 1",
            ),
            _ => self.refuse(
                "split",
                "another set of keys".into(),
                "either `column = \"name\"`, or `fraction` and `seed`",
            ),
        }
    }
}

impl Noise {
    /// Values with their keys in the campaign file.
    pub(super) fn by_key(&self) -> [(&'static str, f64); 8] {
        [
            ("position_m", self.position),
            ("position_per_metre", self.position_per_metre),
            ("radial_position_m", self.radial),
            ("radial_position_per_metre", self.radial_per_metre),
            ("orientation_rad", self.orientation),
            ("joint_rad", self.joint),
            ("force_N", self.force),
            ("torque_Nm", self.torque),
        ]
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(x) => Some(*x),
        Value::Integer(i) => Some(*i as f64),
        _ => None,
    }
}

/// A value for a message, short and on one line.
fn shown(value: &Value) -> String {
    let text = value.to_string();
    let mut short: String = text
        .chars()
        .take(80)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if text.chars().count() > 80 {
        short.push('…');
    }
    short
}

/// As many names as a message can hold.
fn first_names(names: &[&str]) -> String {
    const MOST: usize = 30;
    let mut list = names[..names.len().min(MOST)].join(", ");
    if names.len() > MOST {
        list.push_str(", …");
    }
    list
}

/// The campaign file of a campaign; `table` is left out in a recording.
///
/// Numbers have as many digits as it takes to read back the very same ones.
pub fn render(campaign: &Campaign, table: Option<&str>) -> String {
    let mut text = String::new();
    let mut line = |words: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{words}");
    };
    line(format_args!(
        "robot = {}",
        string(&campaign.robot_file.name)
    ));
    if let Some(base) = &campaign.robot_file.base {
        line(format_args!("base = {}", string(base)));
    }
    if let Some(table) = table {
        line(format_args!("table = {}", string(table)));
    }
    line(format_args!("gravity = {}", array(campaign.gravity.iter())));
    for target in &campaign.targets {
        line(format_args!("\n[[target]]"));
        line(format_args!("name = {}", string(&target.name)));
        let link = &campaign.robot.links[target.link].name;
        line(format_args!("link = {}", string(link)));
    }
    line(format_args!("\n[frames]"));
    let tracker = frame(&campaign.base_from_tracker);
    line(format_args!("base_from_tracker = {tracker}"));
    let by_name: BTreeMap<String, String> = campaign
        .targets
        .iter()
        .zip(&campaign.link_from_target)
        .map(|(target, pose)| (string(&target.name), frame(pose)))
        .collect();
    let entries: Vec<String> = by_name.iter().map(|(k, v)| format!("{k} = {v}")).collect();
    line(format_args!(
        "link_from_target = {{ {} }}",
        entries.join(", ")
    ));
    if let Some(noise) = &campaign.noise {
        line(format_args!("\n[noise]"));
        for (key, value) in noise.by_key() {
            line(format_args!("{key} = {value:?}"));
        }
    }
    if table.is_some()
        && campaign
            .readings
            .iter()
            .any(|reading| reading.split == super::Split::Heldout)
    {
        line(format_args!("\n[split]\ncolumn = \"split\""));
    }
    text
}

/// A basic string, which may stand as a key too.
fn string(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' | '\\' => quoted.extend(['\\', letter]),
            _ if letter.is_control() => quoted.push_str(&format!("\\u{:04X}", u32::from(letter))),
            _ => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}

fn array<'a>(numbers: impl Iterator<Item = &'a f64>) -> String {
    let words: Vec<String> = numbers.map(|x| format!("{x:?}")).collect();
    format!("[{}]", words.join(", "))
}

fn frame(frame: &Frame) -> String {
    match frame {
        Frame::Estimate => "\"estimate\"".into(),
        Frame::Known(pose) => {
            let (t, q) = (&pose.translation.vector, &pose.rotation.coords);
            array([t.x, t.y, t.z, q.w, q.x, q.y, q.z].iter())
        }
    }
}
