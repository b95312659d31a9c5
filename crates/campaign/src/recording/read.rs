//! Reading a campaign back from a recording.

use super::error::RecordingError;
use super::messages::{
    FitProgress, JointState, Message, PointCloud, PoseStamped, ReadingMessage, Rung, Text,
    TransformStamped, Transforms, WrenchStamped, Xyz, decode,
};
use super::records::{damaged, each_record};
use super::results::{
    self, FIT_PROGRESS, FITTED, LADDER_CLOUD, LADDER_RUNG, Progress, Results, VERDICT,
};
use super::write::Holds;
use super::{
    CAMPAIGN_FILE, CAMPAIGN_RECORD, CDR, COMMANDS_FORMAT, FORMAT, JOINT_STATES, READING,
    RUN_RECORD, TF, TF_STATIC, TRACKER_POSE, WRENCH,
};
use crate::campaign::{
    Campaign, Document, Payload, Reading, RobotFile, Split, Target, Wrench, plain_file_name,
    unit_quaternion,
};
use crate::input::{LARGEST_RECORDING, MOST_READINGS};
use crate::robot::Robot;
use mcap::read::ChannelAccumulator;
use mcap::records::Record;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::path::Path;

/// Reads a recording written by [`write_campaign`](super::write_campaign), equal in every bit.
///
/// Topics, attachments and metadata it does not know are passed over.
///
/// # Errors
///
/// A file that is not MCAP, is cut off or damaged, is not of a campaign, or whose messages do not
/// fit one another.
pub fn read_campaign(path: &Path) -> Result<Campaign, RecordingError> {
    let recording = read(path, false)?;
    match recording.holds {
        Holds::Readings => Ok(recording.campaign),
        Holds::Commands => Err(foreign(
            &path.display().to_string(),
            "joint commands for wanted poses, which nobody measured".to_owned(),
        )),
    }
}

/// All that a recording of ours holds.
#[derive(Debug)]
pub struct Recording {
    /// The readings, or the commands as if they were readings.
    pub campaign: Campaign,
    /// Which of both.
    pub holds: Holds,
    /// What models say of them, where a fit or a ladder was recorded.
    pub results: Option<Results>,
    /// The record `run`.
    pub metadata: BTreeMap<String, String>,
    /// Files beside campaign and robot: name and bytes.
    pub attachments: BTreeMap<String, Vec<u8>>,
}

/// Reads all of a recording: the campaign as [`read_campaign`] does, and what was found.
///
/// # Errors
/// As [`read_campaign`]; results that do not fit the readings.
pub fn read_recording(path: &Path) -> Result<Recording, RecordingError> {
    read(path, true)
}

fn read(path: &Path, with_results: bool) -> Result<Recording, RecordingError> {
    let file = path.display().to_string();
    let mut contents = Contents::read(path, &file, with_results)?;
    let efforts: BTreeMap<u64, Vec<f64>> = contents.efforts();
    let holds = contents.holds(&file)?;
    let campaign = contents.campaign(&file)?;
    let inconsistent = |problem| RecordingError::Inconsistent {
        file: file.clone(),
        problem,
    };
    campaign.check().map_err(inconsistent)?;
    let results = contents.results(&campaign, efforts).map_err(inconsistent)?;
    Ok(Recording {
        campaign,
        holds,
        results,
        metadata: contents.run,
        attachments: contents.attachments,
    })
}

/// What a recording holds for us.
#[derive(Default)]
struct Contents {
    attachments: BTreeMap<String, Vec<u8>>,
    record: Option<BTreeMap<String, String>>,
    joints: BTreeMap<u64, JointState<'static>>,
    poses: BTreeMap<u64, PoseStamped<'static>>,
    wrenches: BTreeMap<u64, WrenchStamped<'static>>,
    /// In the order of the file.
    readings: Vec<(u64, ReadingMessage<'static>)>,
    run: BTreeMap<String, String>,
    /// Are the topics below wanted?
    with_results: bool,
    /// Frames of the fitted robot's bodies that move, by log time.
    fitted: BTreeMap<u64, Transforms<'static>>,
    /// Of those that do not, by name.
    fixed: BTreeMap<String, TransformStamped<'static>>,
    /// By log time, as the clouds.
    rungs: BTreeMap<u64, Rung<'static>>,
    clouds: BTreeMap<u64, PointCloud<'static>>,
    progress: Vec<Progress>,
    verdict: String,
}

impl Contents {
    /// Reads every record to the end, so that a file cut off anywhere is refused.
    fn read(path: &Path, file: &str, with_results: bool) -> Result<Self, RecordingError> {
        let mut channels = ChannelAccumulator::default();
        let mut contents = Self {
            with_results,
            ..Self::default()
        };
        each_record(path, LARGEST_RECORDING, |record| {
            contents.take(file, record, &mut channels)
        })?;
        Ok(contents)
    }

    fn take(
        &mut self,
        file: &str,
        record: Record<'_>,
        channels: &mut ChannelAccumulator<'static>,
    ) -> Result<(), RecordingError> {
        let damaged = |error: mcap::McapError| damaged(file, &error);
        match record {
            Record::Schema { header, data } => channels
                .add_schema_from_slice(header, &data)
                .map_err(damaged),
            Record::Channel(channel) => channels.add_channel(channel).map_err(damaged),
            Record::Message { header, data } => {
                let channel = channels.get(header.channel_id).ok_or_else(|| {
                    damaged(mcap::McapError::UnknownChannel(
                        header.sequence,
                        header.channel_id,
                    ))
                })?;
                self.message(file, &channel, header.log_time, &data)
            }
            Record::Attachment { header, data, .. } => {
                match self.attachments.insert(header.name.clone(), data.into()) {
                    None => Ok(()),
                    Some(_) => Err(foreign(
                        file,
                        format!("two attachments called {:?}", header.name),
                    )),
                }
            }
            Record::Metadata(metadata) if metadata.name == CAMPAIGN_RECORD => {
                self.record = Some(metadata.metadata);
                Ok(())
            }
            Record::Metadata(metadata) if metadata.name == RUN_RECORD => {
                self.run = metadata.metadata;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn message(
        &mut self,
        file: &str,
        channel: &mcap::Channel<'_>,
        time: u64,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let at = Place {
            file,
            topic: &channel.topic,
            time,
        };
        match channel.topic.as_str() {
            JOINT_STATES => at.keep(&mut self.joints, at.decode(channel, data)?),
            TRACKER_POSE => at.keep(&mut self.poses, at.decode(channel, data)?),
            WRENCH => at.keep(&mut self.wrenches, at.decode(channel, data)?),
            READING => {
                at.check_count(self.readings.len())?;
                self.readings.push((time, at.decode(channel, data)?));
                Ok(())
            }
            _ if !self.with_results => Ok(()),
            TF => at.keep(&mut self.fitted, at.decode(channel, data)?),
            TF_STATIC => {
                at.check_count(self.fixed.len())?;
                let fixed: Transforms = at.decode(channel, data)?;
                let own = fixed.transforms.into_iter();
                let own = own.filter(|frame| frame.child_frame_id.starts_with(FITTED));
                self.fixed
                    .extend(own.map(|frame| (frame.child_frame_id.to_string(), frame)));
                Ok(())
            }
            LADDER_RUNG => at.keep(&mut self.rungs, at.decode(channel, data)?),
            LADDER_CLOUD => at.keep(&mut self.clouds, at.decode(channel, data)?),
            FIT_PROGRESS => {
                at.check_count(self.progress.len())?;
                let progress: FitProgress = at.decode(channel, data)?;
                self.progress.push(Progress {
                    step: progress.rung as usize,
                    iteration: progress.iteration,
                    cost: progress.cost,
                });
                Ok(())
            }
            VERDICT => {
                let verdict: Text = at.decode(channel, data)?;
                self.verdict = verdict.data;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// What the recording says that its readings are.
    fn holds(&self, file: &str) -> Result<Holds, RecordingError> {
        let record = self
            .record
            .as_ref()
            .ok_or_else(|| foreign(file, format!("no metadata record {CAMPAIGN_RECORD:?}")))?;
        match record.get("format").map(String::as_str) {
            Some(FORMAT) => Ok(Holds::Readings),
            Some(COMMANDS_FORMAT) => Ok(Holds::Commands),
            other => {
                let found = format!("the format {other:?} where {FORMAT:?} is known");
                Err(foreign(file, found))
            }
        }
    }

    /// Joint torques by log time.
    fn efforts(&self) -> BTreeMap<u64, Vec<f64>> {
        let states = self.joints.iter();
        states
            .map(|(time, state)| (*time, state.effort.to_vec()))
            .collect()
    }

    /// What models say of the readings, if the recording has a rung.
    fn results(
        &mut self,
        campaign: &Campaign,
        efforts: BTreeMap<u64, Vec<f64>>,
    ) -> Result<Option<Results>, String> {
        if self.rungs.is_empty() {
            return Ok(None);
        }
        let robot = &campaign.robot;
        let mut found = Results {
            progress: std::mem::take(&mut self.progress),
            verdict: std::mem::take(&mut self.verdict),
            torques: efforts.into_values().collect(),
            ..Results::default()
        };
        for (time, rung) in std::mem::take(&mut self.rungs) {
            let cloud = self.clouds.get(&time).ok_or_else(|| {
                format!("no message on {LADDER_CLOUD} for the one on {LADDER_RUNG} at {time} ns")
            })?;
            found.steps.push(results::step(rung, cloud, robot)?);
        }
        for transforms in std::mem::take(&mut self.fitted).into_values() {
            let links = results::links(robot, &transforms, &self.fixed)?;
            found.links.push(links);
        }
        results::check(&found, campaign)?;
        Ok(Some(found))
    }

    fn campaign(&mut self, file: &str) -> Result<Campaign, RecordingError> {
        let record = self.record.take().unwrap_or_default();
        let name = record.get("name").cloned().unwrap_or_default();
        // The map sorts the numbered keys.
        let warnings = record
            .into_iter()
            .filter(|(key, _)| key.starts_with("warning_"))
            .map(|(_, warning)| warning)
            .collect();

        let text = self.attachment(file, CAMPAIGN_FILE)?;
        let inside = |name: &str| format!("{file}, attachment {name}");
        let document_name = inside(CAMPAIGN_FILE);
        let document = Document::parse(&document_name, &text)?;
        plain_file_name(&document.robot).map_err(|problem| RecordingError::Inconsistent {
            file: file.into(),
            problem,
        })?;
        let robot_file = RobotFile {
            text: self.attachment(file, &document.robot)?,
            name: document.robot.clone(),
            base: document.base.clone(),
        };
        let robot = Robot::parse(
            &inside(&robot_file.name),
            &robot_file.text,
            robot_file.base.as_deref(),
        )?;
        let settings = document.settle(&document_name, &robot)?;

        let mut readings = Vec::with_capacity(self.readings.len());
        for (time, message) in std::mem::take(&mut self.readings) {
            readings.push(self.reading(file, time, message, &robot, &settings.targets)?);
        }
        if readings.is_empty() {
            return Err(foreign(file, format!("no message on {READING}")));
        }
        Ok(Campaign {
            notes: Vec::new(),
            name,
            robot,
            robot_file,
            gravity: settings.gravity,
            targets: settings.targets,
            base_from_tracker: settings.base_from_tracker,
            link_from_target: settings.link_from_target,
            noise: settings.noise,
            readings,
            warnings,
        })
    }

    fn attachment(&mut self, file: &str, name: &str) -> Result<String, RecordingError> {
        let bytes = self
            .attachments
            .remove(name)
            .ok_or_else(|| foreign(file, format!("no attachment {name:?}")))?;
        String::from_utf8(bytes)
            .map_err(|_| foreign(file, format!("an attachment {name:?} that is not UTF-8")))
    }

    /// Joins the messages of one log time. Each is used once, so two readings cannot share them.
    fn reading(
        &mut self,
        file: &str,
        time: u64,
        message: ReadingMessage,
        robot: &Robot,
        targets: &[Target],
    ) -> Result<Reading, RecordingError> {
        let at = |topic| Place { file, topic, time };
        let joints = at(JOINT_STATES).found(self.joints.remove(&time))?;
        let pose = at(TRACKER_POSE).found(self.poses.remove(&time))?;
        let wrench = if message.has_wrench {
            let wrench = at(WRENCH).found(self.wrenches.remove(&time))?;
            Some(Wrench {
                force: vector(&wrench.force),
                torque: vector(&wrench.torque),
            })
        } else {
            None
        };
        let here = at(READING);
        let orientation = if message.has_orientation {
            let q = &pose.orientation;
            let q = unit_quaternion([q.w, q.x, q.y, q.z]).map_err(|norm| {
                at(TRACKER_POSE).refuse(format!("a quaternion of norm {norm}; accepted: 1"))
            })?;
            Some(q)
        } else {
            None
        };
        let target = targets
            .iter()
            .position(|target| target.name == message.target)
            .ok_or_else(|| here.refuse(format!("unknown target {:?}", message.target)))?;
        if message.temperature_links.len() != message.link_temperatures.len() {
            return Err(here.refuse("link temperatures and their links differ in number".into()));
        }
        let mut link_temperatures = Vec::new();
        for (name, value) in message
            .temperature_links
            .iter()
            .zip(message.link_temperatures)
        {
            let link = robot
                .link(name)
                .ok_or_else(|| here.refuse(format!("unknown link {name:?}")))?;
            link_temperatures.push((link, value));
        }
        let payload = match message.payload[..] {
            [] => None,
            [mass, x, y, z] => Some(Payload {
                mass,
                com: Vector3::new(x, y, z),
            }),
            _ => return Err(here.refuse("payload is not mass and x, y, z".into())),
        };
        let line = usize::try_from(message.line)
            .map_err(|_| here.refuse(format!("line {} is too large", message.line)))?;
        let approach = message.approach.iter().map(|d| f64::from(*d)).collect();
        Ok(Reading {
            line,
            pose: here.at_most_one("pose", &message.pose)?,
            repeat: here.at_most_one("repeat", &message.repeat)?,
            target,
            split: match message.heldout {
                true => Split::Heldout,
                false => Split::Fit,
            },
            time: here.at_most_one("time", &message.time)?,
            temperature: here.at_most_one("temperature", &message.temperature)?,
            link_temperatures,
            joints: at(JOINT_STATES).in_order(robot, &joints)?,
            approach: (!message.approach.is_empty()).then_some(approach),
            position: vector(&pose.position),
            orientation,
            wrench,
            payload,
            process: None,
        })
    }
}

/// Where a message stands, for messages about it.
struct Place<'a> {
    file: &'a str,
    topic: &'a str,
    time: u64,
}

impl Place<'_> {
    fn refuse(&self, problem: String) -> RecordingError {
        RecordingError::Message {
            file: self.file.into(),
            topic: self.topic.into(),
            log_time: self.time,
            problem,
        }
    }

    fn decode<M: Message>(
        &self,
        channel: &mcap::Channel<'_>,
        data: &[u8],
    ) -> Result<M, RecordingError> {
        let schema = channel.schema.as_ref().map(|schema| schema.name.as_str());
        if schema != Some(M::NAME) || channel.message_encoding != CDR {
            return Err(self.refuse(format!(
                "found {} as {:?}; accepted: {} as {CDR:?}",
                schema.unwrap_or("no schema"),
                channel.message_encoding,
                M::NAME
            )));
        }
        decode(data).map_err(|problem| self.refuse(problem))
    }

    fn keep<M>(&self, messages: &mut BTreeMap<u64, M>, message: M) -> Result<(), RecordingError> {
        self.check_count(messages.len())?;
        match messages.insert(self.time, message) {
            None => Ok(()),
            Some(_) => Err(self.refuse("two messages at one log time".into())),
        }
    }

    /// Is there room for one more?
    fn check_count(&self, messages: usize) -> Result<(), RecordingError> {
        match messages < MOST_READINGS {
            true => Ok(()),
            false => Err(self.refuse(format!(
                "found more than {MOST_READINGS} messages; accepted: at most {MOST_READINGS}"
            ))),
        }
    }

    fn found<M>(&self, message: Option<M>) -> Result<M, RecordingError> {
        message.ok_or_else(|| {
            self.refuse(format!(
                "no message of its own for the reading on {READING} at this log time"
            ))
        })
    }

    fn at_most_one<T: Clone>(&self, what: &str, items: &[T]) -> Result<Option<T>, RecordingError> {
        match items {
            [] => Ok(None),
            [item] => Ok(Some(item.clone())),
            _ => Err(self.refuse(format!("more than one {what}"))),
        }
    }

    /// Angles in the order of the robot's joints; other joints are not known here.
    fn in_order(&self, robot: &Robot, state: &JointState) -> Result<Vec<f64>, RecordingError> {
        let same_count = state.name.len() == robot.joints.len();
        if !same_count || state.name.len() != state.position.len() {
            return Err(self.refuse(format!(
                "{} names and {} positions for {} joints",
                state.name.len(),
                state.position.len(),
                robot.joints.len()
            )));
        }
        robot
            .joints
            .iter()
            .map(|joint| {
                state
                    .name
                    .iter()
                    .position(|name| *name == joint.name)
                    .map(|index| state.position[index])
                    .ok_or_else(|| self.refuse(format!("no position of joint {:?}", joint.name)))
            })
            .collect()
    }
}

fn foreign(file: &str, found: String) -> RecordingError {
    RecordingError::Foreign {
        file: file.into(),
        found,
    }
}

fn vector(v: &Xyz) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}
