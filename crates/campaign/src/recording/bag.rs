//! A user's own ROS 2 bag: the wanted topics as plain samples, everything else counted.
//!
//! A bag of any size is read record by record; what is kept is limited.

use super::error::RecordingError;
use super::messages::{
    Header, JointState, Message, PointStamped, PoseStamped, TransformStamped, Transforms,
    WrenchStamped, Xyz, Xyzw, decode,
};
use super::records::{damaged, each_record};
use super::{CAMPAIGN_RECORD, CDR};
use mcap::read::ChannelAccumulator;
use mcap::records::Record;
use nalgebra::Vector3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The most that messages of wanted topics may take, bytes.
const MOST_KEPT: u64 = 2_000_000_000;
/// The most that a file of a bag may unpack to, bytes: cameras included.
const MOST_UNPACKED: u64 = 2_000_000_000_000;
/// Most topics, and most frame pairs of a topic: beyond, a file is damaged or made to harm.
const MOST_NAMES: usize = 10_000;

/// When a sample was taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stamp {
    /// `header.stamp`, ns since 1970 or since the sender's own start; zero if the sender left it out.
    pub header: i64,
    /// When the recorder got it, ns.
    pub log: i64,
}

/// Stamp, names of the joints, and their positions, rad (m).
pub type JointSample = (Stamp, Arc<[String]>, Vec<f64>);

/// Position (m) and rotation (x y z w) if the type has one.
pub type PoseSample = (Stamp, Vector3<f64>, Option<[f64; 4]>);

/// Samples of one topic in the order of the bag.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// `sensor_msgs/msg/JointState`: names and positions, rad or m.
    Joints(Vec<JointSample>),
    /// `geometry_msgs/msg/PoseStamped`, `TransformStamped` or `PointStamped`.
    Poses(Vec<PoseSample>),
    /// `tf2_msgs/msg/TFMessage`, by parent and child.
    Transforms(BTreeMap<(String, String), Vec<PoseSample>>),
    /// `geometry_msgs/msg/WrenchStamped`: the first frame, then force (N) and torque (N·m).
    Wrenches(String, Vec<(Stamp, Vector3<f64>, Vector3<f64>)>),
}

impl Samples {
    /// Empty samples of a type; `None` for one that is not known here.
    fn of(kind: &str) -> Option<Self> {
        match kind {
            JointState::NAME => Some(Self::Joints(Vec::new())),
            PoseStamped::NAME | TransformStamped::NAME | PointStamped::NAME => {
                Some(Self::Poses(Vec::new()))
            }
            Transforms::NAME => Some(Self::Transforms(BTreeMap::new())),
            WrenchStamped::NAME => Some(Self::Wrenches(String::new(), Vec::new())),
            _ => None,
        }
    }
}

/// A topic of a bag.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Topic {
    /// Its name.
    pub topic: String,
    /// Its type, `package/msg/Type`.
    #[serde(rename = "type")]
    pub kind: String,
    /// Number of messages.
    pub messages: usize,
}

/// What was read of a bag.
#[derive(Debug, Clone, PartialEq)]
pub struct Bag {
    /// As the user wrote it.
    pub name: String,
    /// The files it is made of.
    pub files: Vec<PathBuf>,
    /// All topics, by name.
    pub topics: Vec<Topic>,
    /// Log times of the first and the last message, ns.
    pub span: Option<(i64, i64)>,
    /// The file is a campaign that this program wrote.
    pub campaign: bool,
    /// By topic: of those wanted, and of a type known here.
    pub samples: BTreeMap<String, Samples>,
}

/// Whether a path ends like something that [`read_bag`] reads or refuses with a remedy.
pub fn is_bag(path: &Path) -> bool {
    path.is_dir() || path.extension().is_some_and(|ending| ending == "mcap")
}

/// Reads a bag: an `.mcap` file, or a folder with one or several; only topics that are `wanted` are kept.
///
/// Chunks may be packed by zstd, lz4 or not at all; messages may be of either byte order. A topic that is
/// wanted and of a type not known here has no samples: who asked says what it needs.
///
/// # Errors
/// What cannot be read, is cut off or damaged; another storage; a message that is not of its type; more than
/// 2 GB of wanted messages.
pub fn read_bag(path: &Path, wanted: impl Fn(&Topic) -> bool) -> Result<Bag, RecordingError> {
    let mut reading = Reading {
        wanted,
        counts: BTreeMap::new(),
        samples: BTreeMap::new(),
        span: None,
        campaign: false,
        kept: 0,
        names: Vec::<String>::new().into(),
    };
    let files = files(path)?;
    for file in &files {
        reading.file(file)?;
    }
    let topics = reading.counts.into_iter();
    Ok(Bag {
        name: path.display().to_string(),
        files,
        topics: topics
            .map(|((topic, kind), messages)| Topic {
                topic,
                kind,
                messages,
            })
            .collect(),
        span: reading.span,
        campaign: reading.campaign,
        samples: reading.samples,
    })
}

/// The files of a bag in the order of their numbers.
fn files(path: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let file = path.display().to_string();
    let ends = |path: &Path, ending: &str| path.to_string_lossy().ends_with(ending);
    let other = |found: &Path| -> Option<RecordingError> {
        let (what, remedy) = if ends(found, ".db3") {
            (
                "an sqlite3 bag (.db3)",
                "`ros2 bag convert -i BAG -o out.yaml` makes one, with `output_bags: [{uri: BAG_mcap, storage_id: mcap, \
                 all_topics: true}]` in out.yaml",
            )
        } else if ends(found, ".mcap.zstd") {
            (
                "a bag packed as a whole (.mcap.zstd)",
                "`zstd -d` unpacks it",
            )
        } else if ends(found, ".bag") {
            (
                "a ROS 1 bag (.bag)",
                "`rosbags-convert --src X.bag --dst X --dst-storage mcap` makes a ROS 2 bag",
            )
        } else {
            return None;
        };
        Some(RecordingError::Storage {
            file: file.clone(),
            found: what.into(),
            remedy: remedy.into(),
        })
    };
    if !path.is_dir() {
        return match other(path) {
            Some(refusal) => Err(refusal),
            None => Ok(vec![path.to_owned()]),
        };
    }
    let unread = |source: std::io::Error| RecordingError::Read {
        file: file.clone(),
        source: source.into(),
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(path).map_err(unread)? {
        found.push(entry.map_err(unread)?.path());
    }
    found.sort();
    let mut files: Vec<PathBuf> = found.iter().filter(|f| ends(f, ".mcap")).cloned().collect();
    if files.is_empty() {
        return Err(found
            .iter()
            .find_map(|f| other(f))
            .unwrap_or(RecordingError::Storage {
                file,
                found: "a folder without .mcap files".into(),
                remedy: "`ros2 bag record -s mcap` writes them".into(),
            }));
    }
    // bag_2.mcap before bag_10.mcap
    files.sort_by_key(|file| {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        let digits = stem.rsplit('_').next().unwrap_or_default();
        (digits.parse::<u64>().unwrap_or(0), file.clone())
    });
    Ok(files)
}

struct Reading<W> {
    wanted: W,
    /// By topic and type.
    counts: BTreeMap<(String, String), usize>,
    samples: BTreeMap<String, Samples>,
    span: Option<(i64, i64)>,
    campaign: bool,
    kept: u64,
    /// Names of the last joint message: most have the same.
    names: Arc<[String]>,
}

impl<W: Fn(&Topic) -> bool> Reading<W> {
    fn file(&mut self, path: &Path) -> Result<(), RecordingError> {
        let file = path.display().to_string();
        let mut channels = ChannelAccumulator::default();
        let damaged = |error: mcap::McapError| damaged(&file, &error);
        let read = each_record(path, MOST_UNPACKED, |record| match record {
            Record::Schema { header, .. } => {
                self.keeps(&file, header.name.len())?;
                // types are known by name
                channels.add_schema_from_slice(header, &[]).map_err(damaged)
            }
            Record::Channel(mut channel) => {
                channel.metadata.clear();
                self.keeps(&file, channel.topic.len())?;
                channels.add_channel(channel).map_err(damaged)
            }
            Record::Message { header, data } => {
                let channel = channels.get(header.channel_id).ok_or_else(|| {
                    damaged(mcap::McapError::UnknownChannel(
                        header.sequence,
                        header.channel_id,
                    ))
                })?;
                self.message(&file, &channel, header.log_time, &data)
            }
            Record::Metadata(metadata) => {
                self.campaign |= metadata.name == CAMPAIGN_RECORD;
                Ok(())
            }
            _ => Ok(()),
        });
        // a bag is written by a recorder that can be stopped at any moment
        read.map_err(|error| match error {
            RecordingError::Damaged { file, problem } => RecordingError::Damaged {
                file,
                problem: format!(
                    "{problem}; if the recorder was stopped, `mcap recover` saves what is whole"
                ),
            },
            other => other,
        })
    }

    /// Counts what is held in memory.
    fn keeps(&mut self, file: &str, bytes: usize) -> Result<(), RecordingError> {
        self.kept += bytes as u64;
        match self.kept > MOST_KEPT {
            false => Ok(()),
            true => Err(RecordingError::TooLarge {
                file: file.into(),
                limit: "2 GB of messages on the topics asked for".into(),
            }),
        }
    }

    fn message(
        &mut self,
        file: &str,
        channel: &mcap::Channel<'_>,
        time: u64,
        data: &[u8],
    ) -> Result<(), RecordingError> {
        let too_large = |limit: &str| RecordingError::TooLarge {
            file: file.into(),
            limit: limit.into(),
        };
        let kind = match &channel.schema {
            Some(schema) => schema.name.clone(),
            None => "no type".into(),
        };
        // Times beyond 2262 stand at the end of time.
        let log = i64::try_from(time).unwrap_or(i64::MAX);
        let span = self.span.get_or_insert((log, log));
        *span = (span.0.min(log), span.1.max(log));
        let count = self.counts.entry((channel.topic.clone(), kind.clone()));
        *count.or_default() += 1;
        if self.counts.len() > MOST_NAMES {
            return Err(too_large("10 000 topics"));
        }
        let topic = Topic {
            topic: channel.topic.clone(),
            kind,
            messages: 0,
        };
        if !(self.wanted)(&topic) {
            return Ok(());
        }
        let Some(empty) = Samples::of(&topic.kind) else {
            return Ok(());
        };
        self.keeps(file, data.len())?;
        let refuse = |problem| RecordingError::Message {
            file: file.into(),
            topic: channel.topic.clone(),
            log_time: time,
            problem,
        };
        if channel.message_encoding != CDR {
            return Err(refuse(format!(
                "found the encoding {:?}; accepted: {CDR:?}",
                channel.message_encoding
            )));
        }
        let samples = self.samples.entry(topic.topic).or_insert(empty);
        keep(samples, &topic.kind, log, data, &mut self.names).map_err(refuse)
    }
}

/// Adds a message of a known type to the samples of its topic.
fn keep(
    samples: &mut Samples,
    kind: &str,
    log: i64,
    data: &[u8],
    names: &mut Arc<[String]>,
) -> Result<(), String> {
    match (samples, kind) {
        (Samples::Joints(all), JointState::NAME) => {
            let message: JointState = decode(data)?;
            if message.name.len() != message.position.len() {
                return Err(format!(
                    "{} names and {} positions",
                    message.name.len(),
                    message.position.len()
                ));
            }
            if names[..] != message.name[..] {
                *names = message.name.as_ref().into();
            }
            let stamp = stamp(&message.header, log);
            all.push((stamp, names.clone(), message.position.into_owned()));
        }
        (Samples::Poses(all), PoseStamped::NAME) => {
            let message: PoseStamped = decode(data)?;
            let rotation = Some(xyzw(&message.orientation));
            all.push((
                stamp(&message.header, log),
                xyz(&message.position),
                rotation,
            ));
        }
        (Samples::Poses(all), TransformStamped::NAME) => all.push(pose(&decode(data)?, log)),
        (Samples::Poses(all), PointStamped::NAME) => {
            let message: PointStamped = decode(data)?;
            all.push((stamp(&message.header, log), xyz(&message.point), None));
        }
        (Samples::Transforms(pairs), Transforms::NAME) => {
            let message: Transforms = decode(data)?;
            for one in message.transforms {
                let sample = pose(&one, log);
                let pair = (
                    one.header.frame_id.into_owned(),
                    one.child_frame_id.into_owned(),
                );
                pairs.entry(pair).or_default().push(sample);
                if pairs.len() > MOST_NAMES {
                    return Err("more than 10 000 pairs of frames".into());
                }
            }
        }
        (Samples::Wrenches(frame, all), WrenchStamped::NAME) => {
            let message: WrenchStamped = decode(data)?;
            if all.is_empty() {
                *frame = message.header.frame_id.to_string();
            } else if *frame != message.header.frame_id {
                let found = &message.header.frame_id;
                return Err(format!(
                    "found the frame {found:?} after {frame:?}; accepted: one frame for the topic"
                ));
            }
            let (force, torque) = (xyz(&message.force), xyz(&message.torque));
            all.push((stamp(&message.header, log), force, torque));
        }
        _ => return Err(format!("found {kind} among messages of another type")),
    }
    Ok(())
}

impl Bag {
    /// Refuses unless a topic is there with a type that `accepted` knows.
    ///
    /// # Errors
    /// With the topics there are, or the types accepted.
    pub fn require(&self, topic: &str, accepted: &[&str]) -> Result<(), RecordingError> {
        let kinds: BTreeSet<&str> = self
            .topics
            .iter()
            .filter(|t| t.topic == topic)
            .map(|t| t.kind.as_str())
            .collect();
        let refuse = |found: String, accepted: String| {
            Err(RecordingError::Topic {
                file: self.name.clone(),
                topic: topic.into(),
                found,
                accepted,
            })
        };
        if kinds.is_empty() {
            let there = self.topics.iter();
            let there: Vec<String> = there
                .map(|t| format!("{} ({}, {} messages)", t.topic, t.kind, t.messages))
                .collect();
            return refuse(
                "no message on it".into(),
                format!("a topic of the bag: {}", there.join(", ")),
            );
        }
        match kinds.iter().find(|kind| !accepted.contains(*kind)) {
            Some(kind) => refuse((*kind).into(), accepted.join(", ")),
            None => Ok(()),
        }
    }
}

fn pose(message: &TransformStamped, log: i64) -> PoseSample {
    (
        stamp(&message.header, log),
        xyz(&message.translation),
        Some(xyzw(&message.rotation)),
    )
}

fn stamp(header: &Header, log: i64) -> Stamp {
    Stamp {
        header: i64::from(header.stamp.sec) * 1_000_000_000 + i64::from(header.stamp.nanosec),
        log,
    }
}

fn xyz(v: &Xyz) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

fn xyzw(q: &Xyzw) -> [f64; 4] {
    [q.x, q.y, q.z, q.w]
}
