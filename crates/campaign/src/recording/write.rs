//! Writing a campaign as a recording.

use super::error::RecordingError;
use super::messages::{
    Header, JointState, PoseStamped, ReadingMessage, Temperature, Text, TransformStamped,
    Transforms, WrenchStamped,
};
use super::recorder::{Encoded, Recorder, channel, header, stamp, writer};
use super::results::{
    self, FITTED, ResultChannels, Results, fitted_bodies, fitted_frames, fitted_names, predictions,
};
use super::transforms::{links, moving, tracker, tracker_frame, xyz, xyzw};
use super::{
    CAMPAIGN_FILE, CAMPAIGN_RECORD, COMMANDS_FORMAT, FORMAT, JOINT_STATES, READING,
    ROBOT_DESCRIPTION, RUN_RECORD, TEMPERATURE, TF, TF_STATIC, TRACKER_POSE, WRENCH, description,
};
use crate::campaign::{Campaign, Reading, Split, render_document, write_atomically};
use mcap::Writer;
use nalgebra::{Isometry3, UnitQuaternion};
use rayon::prelude::*;
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Seek, Write};
use std::path::Path;

/// What the readings of a recording are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Holds {
    /// Measured, or simulated as if measured.
    #[default]
    Readings,
    /// Wanted poses, with the joint commands that are to reach them.
    Commands,
}

impl Holds {
    pub(super) fn format(self) -> &'static str {
        match self {
            Holds::Readings => FORMAT,
            Holds::Commands => COMMANDS_FORMAT,
        }
    }
}

/// What stands in a recording beside the campaign.
#[derive(Debug, Default)]
pub struct Beside<'a> {
    /// What its readings are.
    pub holds: Holds,
    /// What models say of them.
    pub results: Option<&'a Results>,
    /// The record `run`: seed, versions, command.
    pub metadata: BTreeMap<String, String>,
    /// More files: name and bytes.
    pub attachments: Vec<(String, Vec<u8>)>,
}

/// Writes a campaign as an MCAP file that [`read_campaign`](super::read_campaign) reads back equal.
///
/// The same arguments give the same bytes. The file is written beside an old one and then
/// renamed, so a failure leaves the old one whole.
///
/// Messages carry the time of their reading if every reading has one and they increase;
/// otherwise readings are one second apart.
///
/// # Errors
///
/// What the file system says, or why the campaign could not be read back.
pub fn write_campaign(
    campaign: &Campaign,
    path: &Path,
    beside: &Beside<'_>,
) -> Result<(), RecordingError> {
    let file = path.display().to_string();
    let inconsistent = |problem| RecordingError::Inconsistent {
        file: file.clone(),
        problem,
    };
    campaign.check().map_err(inconsistent)?;
    if let Some(results) = beside.results {
        results::check(results, campaign).map_err(inconsistent)?;
    }
    let mut names = BTreeSet::from([CAMPAIGN_FILE, campaign.robot_file.name.as_str()]);
    if let Some((twice, _)) = beside
        .attachments
        .iter()
        .find(|(name, _)| !names.insert(name))
    {
        return Err(inconsistent(format!(
            "two attachments are called {twice:?}"
        )));
    }
    write_atomically(path, |writer| fill(campaign, writer, beside)).map_err(|source| {
        RecordingError::Write {
            file: file.clone(),
            source,
        }
    })
}

fn fill(
    campaign: &Campaign,
    file: impl Write + Seek + Send,
    beside: &Beside<'_>,
) -> io::Result<()> {
    let mut recorder = Recorder {
        writer: writer(file)?,
    };
    // What concerns the whole file comes before the messages, so that a reader of a stream has it.
    let mut record = BTreeMap::from([
        ("format".to_owned(), beside.holds.format().to_owned()),
        ("name".to_owned(), campaign.name.clone()),
    ]);
    for (index, warning) in campaign.warnings.iter().enumerate() {
        record.insert(format!("warning_{index:06}"), warning.clone());
    }
    recorder.metadata(CAMPAIGN_RECORD, record)?;
    recorder.metadata(RUN_RECORD, beside.metadata.clone())?;
    let document = render_document(campaign, None);
    recorder.attach(CAMPAIGN_FILE, document.as_bytes())?;
    recorder.attach(
        &campaign.robot_file.name,
        campaign.robot_file.text.as_bytes(),
    )?;
    for (name, bytes) in &beside.attachments {
        recorder.attach(name, bytes)?;
    }
    let channels = Channels::add(&mut recorder.writer, beside.results.is_some())?;
    recorder.readings(campaign, &channels, beside.results)?;
    recorder.writer.finish().map_err(io::Error::other)?;
    Ok(())
}

/// Log time of each reading, ns, strictly increasing.
fn log_times(readings: &[Reading]) -> Vec<u64> {
    const LATEST: f64 = i32::MAX as f64;
    let measured: Option<Vec<u64>> = readings
        .iter()
        .map(|reading| match reading.time {
            // A stamp has 31 bits of seconds.
            Some(time) if (0.0..LATEST).contains(&time) => Some((time * 1e9).round() as u64),
            _ => None,
        })
        .collect();
    match measured {
        Some(times) if times.is_sorted_by(|a, b| a < b) => times,
        _ => (0..readings.len() as u64)
            .map(|index| index * 1_000_000_000)
            .collect(),
    }
}

/// Ids of the channels, in the order in which they are made.
struct Channels {
    robot_description: u16,
    tf_static: u16,
    joint_states: u16,
    tf: u16,
    tracker_pose: u16,
    wrench: u16,
    temperature: u16,
    reading: u16,
    results: Option<ResultChannels>,
}

impl Channels {
    fn add<W: Write + Seek>(writer: &mut Writer<W>, results: bool) -> io::Result<Self> {
        let results = match results {
            true => Some(ResultChannels::add(writer)?),
            false => None,
        };
        Ok(Self {
            results,
            robot_description: channel::<Text, W>(writer, ROBOT_DESCRIPTION, true)?,
            tf_static: channel::<Transforms, W>(writer, TF_STATIC, true)?,
            joint_states: channel::<JointState, W>(writer, JOINT_STATES, false)?,
            tf: channel::<Transforms, W>(writer, TF, false)?,
            tracker_pose: channel::<PoseStamped, W>(writer, TRACKER_POSE, false)?,
            wrench: channel::<WrenchStamped, W>(writer, WRENCH, false)?,
            temperature: channel::<Temperature, W>(writer, TEMPERATURE, false)?,
            reading: channel::<ReadingMessage, W>(writer, READING, false)?,
        })
    }
}

impl<W: Write + Seek> Recorder<W> {
    fn readings(
        &mut self,
        campaign: &Campaign,
        channels: &Channels,
        results: Option<&Results>,
    ) -> io::Result<()>
    where
        W: Send,
    {
        /// Readings encoded at once, while those before them are compressed.
        const AT_ONCE: usize = 256;
        let times = log_times(&campaign.readings);
        let start = times.first().copied().unwrap_or_default();
        let end = times.last().copied().unwrap_or_default();
        let robot = &campaign.robot;
        let description = Text {
            data: description::urdf(robot, &campaign.robot_file),
        };
        self.message(channels.robot_description, 0, start, &description)?;
        let scene = Scene::of(campaign, results);
        let transforms = scene.fixed(start);
        self.message(channels.tf_static, 0, start, &Transforms { transforms })?;
        let encode = |first: usize| -> Vec<io::Result<Encoded>> {
            let last = (first + AT_ONCE).min(times.len());
            (first..last)
                .into_par_iter()
                .map(|index| scene.reading(channels, index, times[index]))
                .collect()
        };
        let mut ready = encode(0);
        let mut first = 0;
        while !ready.is_empty() {
            let next = first + ready.len();
            let write = || -> io::Result<()> {
                for (index, encoded) in (first..next).zip(ready) {
                    let sequence = u32::try_from(index).map_err(io::Error::other)?;
                    let Encoded { bytes, ends } = encoded?;
                    let mut begin = 0;
                    for (channel, end) in ends {
                        self.bytes(channel, sequence, times[index], &bytes[begin..end])?;
                        begin = end;
                    }
                }
                Ok(())
            };
            let (written, more) = rayon::join(write, || encode(next));
            written?;
            (first, ready) = (next, more);
        }
        if let (Some(results), Some(channels)) = (results, &channels.results) {
            self.steps(channels, campaign, results, (start, end), &scene.tracker)?;
        }
        Ok(())
    }
}

/// What all readings have in common.
struct Scene<'a> {
    campaign: &'a Campaign,
    results: Option<&'a Results>,
    /// Name of the tracker's frame.
    tracker: String,
    /// Names of the joints.
    names: Vec<String>,
    /// By joints: do their angles change?
    turns: Vec<bool>,
    /// Frames of the fitted robot's bodies, by readings.
    fitted: Vec<Vec<Isometry3<f64>>>,
    /// Names of these frames.
    fitted_names: Vec<String>,
    /// By bodies: do they move?
    moves: Vec<bool>,
}

impl<'a> Scene<'a> {
    fn of(campaign: &'a Campaign, results: Option<&'a Results>) -> Self {
        let (robot, readings) = (&campaign.robot, &campaign.readings);
        let links = results.map_or(&[][..], |results| &results.links);
        let fitted: Vec<Vec<_>> = (links.par_iter())
            .map(|links| fitted_bodies(robot, links))
            .collect();
        let turns = |j: usize| {
            readings
                .iter()
                .any(|r| r.joints[j] != readings[0].joints[j])
        };
        let moved = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
            // frames are quotients: what stands still does so to rounding
            const ROUNDING: f64 = 1e-12;
            let apart = (a.translation.vector - b.translation.vector).norm();
            let turned = (a.rotation.coords - b.rotation.coords).norm();
            apart > ROUNDING || turned > ROUNDING
        };
        let moves = |body: usize| fitted.iter().any(|all| moved(&all[body], &fitted[0][body]));
        Self {
            campaign,
            results,
            tracker: tracker_frame(robot),
            names: robot.joints.iter().map(|j| j.name.clone()).collect(),
            turns: (0..robot.joints.len()).map(turns).collect(),
            moves: (0..robot.bodies.len()).map(moves).collect(),
            fitted,
            fitted_names: fitted_names(robot),
        }
    }

    /// What does not move: links on their bodies, joints that are not turned, and the tracker if its place is known.
    fn fixed(&self, time: u64) -> Vec<TransformStamped<'_>> {
        let robot = &self.campaign.robot;
        let stamp = stamp(time);
        let last = self.results.and_then(|results| results.steps.last());
        let found = last.map(|step| &step.base_from_tracker);
        let mut transforms: Vec<_> = tracker(self.campaign, found, stamp).into_iter().collect();
        transforms.extend(links(robot, "", stamp));
        if let Some(first) = self.campaign.readings.first() {
            transforms.extend(moving(robot, &first.joints, stamp, |j| !self.turns[j]));
        }
        if let Some(first) = self.fitted.first() {
            transforms.extend(links(robot, FITTED, stamp));
            let names = &self.fitted_names;
            transforms.extend(fitted_frames(robot, names, first, time, |body| {
                !self.moves[body]
            }));
        }
        transforms
    }

    /// What no standard message holds.
    fn rest<'b>(&'b self, reading: &'b Reading, header: Header<'b>) -> ReadingMessage<'b> {
        ReadingMessage {
            header,
            line: reading.line as u64,
            target: Cow::Borrowed(&self.campaign.targets[reading.target].name),
            pose: Cow::Borrowed(reading.pose.as_slice()),
            repeat: Cow::Borrowed(reading.repeat.as_slice()),
            heldout: reading.split == Split::Heldout,
            has_orientation: reading.orientation.is_some(),
            has_wrench: reading.wrench.is_some(),
            time: Cow::Borrowed(reading.time.as_slice()),
            temperature: Cow::Borrowed(reading.temperature.as_slice()),
            temperature_links: reading
                .link_temperatures
                .iter()
                .map(|(link, _)| self.campaign.robot.links[*link].name.clone())
                .collect(),
            link_temperatures: reading.link_temperatures.iter().map(|(_, t)| *t).collect(),
            approach: reading
                .approach
                .iter()
                .flatten()
                .map(|direction| *direction as i8)
                .collect(),
            payload: reading
                .payload
                .iter()
                .flat_map(|p| [p.mass, p.com.x, p.com.y, p.com.z])
                .collect(),
        }
    }

    fn reading(&self, channels: &Channels, index: usize, time: u64) -> io::Result<Encoded> {
        let reading = &self.campaign.readings[index];
        let robot = &self.campaign.robot;
        let base = robot.bodies.first().map_or("base", |body| &body.name);
        let target = &self.campaign.targets[reading.target];
        let link = &robot.links[target.link].name;
        let mut out = Encoded {
            bytes: Vec::with_capacity(8192),
            ends: Vec::with_capacity(16),
        };

        let torques = self.results.map(|results| &results.torques[index][..]);
        let joints = JointState {
            header: header(time, base),
            name: Cow::Borrowed(&self.names),
            position: Cow::Borrowed(&reading.joints),
            velocity: Cow::Borrowed(&[]),
            effort: Cow::Borrowed(torques.unwrap_or_default()),
        };
        out.add(channels.joint_states, &joints)?;
        let mut transforms = moving(robot, &reading.joints, stamp(time), |j| self.turns[j]);
        if let Some(bodies) = self.fitted.get(index) {
            let names = &self.fitted_names;
            transforms.extend(fitted_frames(robot, names, bodies, time, |body| {
                self.moves[body]
            }));
        }
        out.add(channels.tf, &Transforms { transforms })?;
        let orientation = reading.orientation.unwrap_or_else(UnitQuaternion::identity);
        let pose = PoseStamped {
            header: header(time, &self.tracker),
            position: xyz(&reading.position),
            orientation: xyzw(&orientation),
        };
        out.add(channels.tracker_pose, &pose)?;
        if let Some(wrench) = &reading.wrench {
            let wrench = WrenchStamped {
                header: header(time, link),
                force: xyz(&wrench.force),
                torque: xyz(&wrench.torque),
            };
            out.add(channels.wrench, &wrench)?;
        }
        if let Some(temperature) = reading.temperature {
            let temperature = Temperature {
                header: header(time, base),
                temperature,
                variance: 0.0,
            };
            out.add(channels.temperature, &temperature)?;
        }
        let rest = self.rest(reading, header(time, link));
        out.add(channels.reading, &rest)?;
        if let (Some(results), Some(channels)) = (self.results, &channels.results) {
            let tracker = &self.tracker;
            predictions(channels, results, (index, reading), time, tracker, &mut out)?;
        }
        Ok(out)
    }
}
