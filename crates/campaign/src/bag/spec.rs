//! `import.toml`: which topics of a bag are what, and what a stop is.

use crate::campaign::{CampaignError, Document, Keys, RobotFile, Settings};
use crate::input;
use crate::robot::Robot;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// What to make of a bag.
#[derive(Debug, Clone)]
pub struct Spec {
    /// The file, for messages.
    pub file: String,
    /// The nominal robot.
    pub robot: Robot,
    /// Its file as read.
    pub robot_file: RobotFile,
    /// Where that file is.
    pub robot_path: PathBuf,
    /// Topic of the joint states.
    pub joints: String,
    /// What is tracked, in the order of `settings.targets`.
    pub targets: Vec<TargetSpec>,
    /// Gravity, targets and frames, as of a campaign file.
    pub settings: Settings,
    /// What a stop is.
    pub dwell: DwellSpec,
    /// Clocks.
    pub clock: ClockSpec,
}

/// Where readings of one target come from.
#[derive(Debug, Clone)]
pub struct TargetSpec {
    /// Topic of its poses or points.
    pub tracker: String,
    /// Parent and child on a topic of transforms.
    pub frames: Option<(String, String)>,
    /// Whether a measured orientation is used.
    pub orientation: bool,
    /// Length of one unit of the topic, m.
    pub unit: f64,
    /// Topic of its wrenches.
    pub wrench: Option<String>,
    /// Link in whose frame the wrench is measured; `None`: the one that the messages name.
    pub wrench_link: Option<usize>,
    /// 1 for the wrench of the load on the arm, -1 for that of the arm on the load.
    pub wrench_sign: f64,
}

/// What a stop is.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DwellSpec {
    /// What is left of it after both ends are cut lasts at least so long, s.
    pub min_s: f64,
    /// Cut off at both ends: vibration, and what a clock may be off, s.
    pub settle_s: f64,
    /// Fewest samples of each stream.
    pub min_samples: usize,
    /// Two stops with every joint nearer than this are one posture, rad (m); a motion smaller than this is none.
    pub same_pose_rad: f64,
}

impl Default for DwellSpec {
    fn default() -> Self {
        Self {
            min_s: 0.5,
            settle_s: 0.3,
            min_samples: 5,
            same_pose_rad: 1e-3,
        }
    }
}

/// Clocks of the streams.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClockSpec {
    /// How far apart the clocks may be, beyond what the log times say, s.
    pub max_offset_s: f64,
    /// Offset of the trackers' clock if it is known, s: their stamp less the joints' of the same instant.
    pub tracker_offset_s: Option<f64>,
    /// The same of the wrenches' clock, s.
    pub wrench_offset_s: Option<f64>,
}

impl Default for ClockSpec {
    fn default() -> Self {
        Self {
            max_offset_s: 30.0,
            tracker_offset_s: None,
            wrench_offset_s: None,
        }
    }
}

/// Topic of the joint states where the file does not say.
pub const JOINTS: &str = "/joint_states";

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    robot: String,
    base: Option<String>,
    gravity: Option<toml::Value>,
    joints: Option<String>,
    #[serde(default, rename = "target")]
    targets: Vec<TargetEntry>,
    frames: Option<toml::Table>,
    #[serde(default)]
    dwell: DwellSpec,
    #[serde(default)]
    clock: ClockSpec,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct TargetEntry {
    name: String,
    link: String,
    tracker: String,
    frames: Option<[String; 2]>,
    orientation: Option<bool>,
    unit: Option<String>,
    wrench: Option<String>,
    wrench_link: Option<String>,
    wrench_sign: Option<f64>,
}

impl Spec {
    /// Reads a file; the robot's path is relative to it.
    ///
    /// # Errors
    /// What does not fit, with file, key, what was found and what is accepted.
    pub fn load(path: &Path) -> Result<Self, CampaignError> {
        let file = path.display().to_string();
        let text = crate::campaign::read_toml(path, &file)?;
        let entry: File = input::toml(&text).map_err(|message| CampaignError::Toml {
            file: file.clone(),
            message,
        })?;
        let robot_path = path.parent().unwrap_or(Path::new("")).join(&entry.robot);
        let (robot, robot_text) = Robot::load_with_text(&robot_path, entry.base.as_deref())?;
        let settings = Document::from_table(&file, campaign_part(&entry))?.settle(&file, &robot)?;
        let keys = Keys { file: &file };
        keys.check_dwell(&entry.dwell)?;
        keys.check_clock(&entry.clock)?;
        let targets = entry.targets.iter();
        let targets: Result<Vec<_>, _> = targets.map(|t| keys.target(t, &robot)).collect();
        Ok(Self {
            robot_file: RobotFile {
                name: robot_path
                    .file_name()
                    .map(|name| name.to_string_lossy().into_owned())
                    .unwrap_or_default(),
                text: robot_text,
                base: entry.base,
            },
            robot,
            robot_path,
            joints: entry.joints.unwrap_or_else(|| JOINTS.to_owned()),
            targets: targets?,
            settings,
            dwell: entry.dwell,
            clock: entry.clock,
            file,
        })
    }

    /// Whether a topic is one that this file names.
    pub fn wants(&self, topic: &str) -> bool {
        topic == self.joints
            || self
                .targets
                .iter()
                .any(|t| t.tracker == topic || t.wrench.as_deref() == Some(topic))
    }
}

/// What the file has in common with a campaign file.
fn campaign_part(entry: &File) -> toml::Table {
    let text = |word: &str| toml::Value::String(word.to_owned());
    let mut table = toml::Table::new();
    table.insert("robot".into(), text(&entry.robot));
    if let Some(gravity) = &entry.gravity {
        table.insert("gravity".into(), gravity.clone());
    }
    let targets = entry.targets.iter().map(|target| {
        let mut one = toml::Table::new();
        one.insert("name".into(), text(&target.name));
        one.insert("link".into(), text(&target.link));
        toml::Value::Table(one)
    });
    let targets: Vec<toml::Value> = targets.collect();
    if !targets.is_empty() {
        table.insert("target".into(), toml::Value::Array(targets));
    }
    if let Some(frames) = &entry.frames {
        table.insert("frames".into(), toml::Value::Table(frames.clone()));
    }
    table
}

impl Keys<'_> {
    fn check_dwell(&self, dwell: &DwellSpec) -> Result<(), CampaignError> {
        let numbers = [
            ("dwell.min_s", dwell.min_s, 0.0..=3600.0, "0 to 3600 s"),
            ("dwell.settle_s", dwell.settle_s, 0.0..=60.0, "0 to 60 s"),
            (
                "dwell.same_pose_rad",
                dwell.same_pose_rad,
                1e-6..=0.1,
                "1e-6 to 0.1 rad",
            ),
        ];
        for (key, value, range, accepted) in numbers {
            if !range.contains(&value) {
                return self.refuse(key, value.to_string(), accepted);
            }
        }
        if dwell.min_samples == 0 {
            return self.refuse("dwell.min_samples", "0".into(), "1 or more");
        }
        Ok(())
    }

    fn check_clock(&self, clock: &ClockSpec) -> Result<(), CampaignError> {
        if !(0.0..=600.0).contains(&clock.max_offset_s) {
            let found = clock.max_offset_s.to_string();
            return self.refuse("clock.max_offset_s", found, "0 to 600 s");
        }
        let known = [
            ("clock.tracker_offset_s", clock.tracker_offset_s),
            ("clock.wrench_offset_s", clock.wrench_offset_s),
        ];
        for (key, value) in known {
            // A century: stamps hold 68 years.
            if let Some(value) = value.filter(|value| value.is_nan() || value.abs() > 3e9) {
                return self.refuse(key, value.to_string(), "seconds between the clocks");
            }
        }
        Ok(())
    }

    fn target(&self, entry: &TargetEntry, robot: &Robot) -> Result<TargetSpec, CampaignError> {
        let unit = match entry.unit.as_deref() {
            None | Some("m") => 1.0,
            Some("mm") => 1e-3,
            Some(other) => {
                return self.refuse("target.unit", format!("{other:?}"), "\"m\", \"mm\"");
            }
        };
        let wrench_sign = entry.wrench_sign.unwrap_or(1.0);
        if wrench_sign.abs() != 1.0 {
            return self.refuse(
                "target.wrench_sign",
                wrench_sign.to_string(),
                "1 (of the load on the arm), -1 (of the arm on the load)",
            );
        }
        let body = robot.link(&entry.link).map(|link| robot.links[link].body);
        let wrench_link = match &entry.wrench_link {
            None => None,
            Some(name) => match robot.link(name) {
                Some(link) if Some(robot.links[link].body) == body => Some(link),
                _ => {
                    return self.refuse(
                        "target.wrench_link",
                        format!("{name:?}"),
                        &format!("a link that is fixed to {:?}", entry.link),
                    );
                }
            },
        };
        Ok(TargetSpec {
            tracker: entry.tracker.clone(),
            frames: entry.frames.clone().map(|[parent, child]| (parent, child)),
            orientation: entry.orientation.unwrap_or(true),
            unit,
            wrench: entry.wrench.clone(),
            wrench_link,
            wrench_sign,
        })
    }
}
