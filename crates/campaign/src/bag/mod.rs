//! From a ROS 2 bag to a campaign: clocks brought together, stops found and averaged, what was thrown away said.

mod average;
pub mod clock;
pub mod dwells;
mod joints;
mod offset;
mod readings;
mod spec;
pub mod stream;
mod target;

pub use readings::{Drop, Dwells, Scatter};
pub use spec::{ClockSpec, DwellSpec, Spec, TargetSpec};

use crate::campaign::{Campaign, CampaignError, Wrench};
use crate::recording::{Bag, PoseSample, RecordingError};
use clock::{ClockReport, Status};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use stream::{Series, StreamReport};

/// Types that joint states may have.
pub const JOINT_TYPES: [&str; 1] = ["sensor_msgs/msg/JointState"];
/// Types that a tracker's topic may have.
pub const TRACKER_TYPES: [&str; 4] = [
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/TransformStamped",
    "geometry_msgs/msg/PointStamped",
    "tf2_msgs/msg/TFMessage",
];
/// Types that wrenches may have.
pub const WRENCH_TYPES: [&str; 1] = ["geometry_msgs/msg/WrenchStamped"];

/// Why a bag could not become a campaign.
#[derive(Debug, thiserror::Error)]
pub enum ImportError {
    /// The bag.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The spec, or the robot it names.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The two do not fit.
    #[error("{file}, topic {topic}: found {found}; accepted: {accepted}")]
    Unfit {
        /// The bag.
        file: String,
        /// The topic.
        topic: String,
        /// What does not fit.
        found: String,
        /// What would.
        accepted: String,
    },
}

/// A bag's readings, and what became of everything in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Import {
    /// The campaign; `None` if no stop gives a reading.
    pub campaign: Option<Campaign>,
    /// Length of the bag by its log times, s.
    pub length_s: f64,
    /// Topics that were used.
    pub streams: Vec<StreamReport>,
    /// Clocks against that of the joint states.
    pub clocks: Vec<ClockReport>,
    /// Stops and readings.
    pub dwells: Dwells,
    /// How readings scatter, by target.
    pub scatter: Vec<Scatter>,
    /// What the user has to know.
    pub warnings: Vec<String>,
}

impl Import {
    /// Whether the offset of each tracker's clock is known.
    pub fn clocks_are_known(&self) -> bool {
        let mut trackers = self.clocks.iter().filter(|c| c.role.starts_with("tracker"));
        trackers.all(|clock| clock.status != Status::Unknown)
    }
}

/// A target's streams on the clock of the joints.
struct Tracked {
    /// m.
    position: Series<Vector3<f64>>,
    /// One a position, where measured.
    orientation: Option<Vec<UnitQuaternion<f64>>>,
    /// N and N·m on the arm at the target link's origin, in that link's frame.
    wrench: Option<Series<Wrench>>,
}

/// What a target's streams are read from.
struct Source<'a> {
    bag: &'a Bag,
    spec: &'a Spec,
    /// Over time, in the robot's order.
    joints: &'a Series<Vec<f64>>,
    /// First log time of the bag, ns.
    start: i64,
}

/// Makes a campaign of a bag whose topics were read.
///
/// # Errors
/// Topics that are missing or of other types, and joint states that are not of the robot. That no stop is found is a result.
pub fn import(bag: &Bag, spec: &Spec) -> Result<Import, ImportError> {
    bag.require(&spec.joints, &JOINT_TYPES)?;
    for target in &spec.targets {
        bag.require(&target.tracker, &TRACKER_TYPES)?;
        if let Some(wrench) = &target.wrench {
            bag.require(wrench, &WRENCH_TYPES)?;
        }
    }
    let start = bag.span.map_or(0, |(first, _)| first);
    let mut import = Import {
        campaign: None,
        length_s: bag.span.map_or(0.0, |(a, b)| (b - a) as f64 * 1e-9),
        streams: Vec::new(),
        clocks: Vec::new(),
        dwells: Dwells::default(),
        scatter: Vec::new(),
        warnings: Vec::new(),
    };
    let joints = joints::joints(bag, spec, start, &mut import)?;
    let mut tracked = Vec::new();
    let source = Source {
        bag,
        spec,
        joints: &joints,
        start,
    };
    for index in 0..spec.targets.len() {
        tracked.push(target::target(&source, index, &mut import)?);
    }
    for stream in &import.streams {
        if stream.clock_was_set() {
            import.warnings.push(format!(
                "{}: stamps go back by up to {:.3} s: a clock was set while the bag was recorded, and what stands on both sides \
                 of that moment is mixed up",
                stream.topic, stream.farthest_back_s
            ));
        }
    }
    let found = readings::readings(spec, &joints, &tracked);
    import.dwells = found.dwells;
    import.scatter = found.scatter;
    if !found.readings.is_empty() {
        import.campaign = Some(Campaign {
            notes: Vec::new(),
            name: bag.name.clone(),
            robot: spec.robot.clone(),
            robot_file: spec.robot_file.clone(),
            gravity: spec.settings.gravity,
            targets: spec.settings.targets.clone(),
            base_from_tracker: spec.settings.base_from_tracker,
            link_from_target: spec.settings.link_from_target.clone(),
            noise: found.noise,
            readings: found.readings,
            warnings: Vec::new(),
        });
    }
    Ok(import)
}

/// By pair of frames, as a template can name them: those of a bag's transforms, most messages first.
pub fn frame_pairs(
    samples: &BTreeMap<(String, String), Vec<PoseSample>>,
) -> Vec<(&str, &str, usize)> {
    let mut pairs: Vec<_> = samples
        .iter()
        .map(|((a, b), samples)| (a.as_str(), b.as_str(), samples.len()))
        .collect();
    pairs.sort_by_key(|pair| std::cmp::Reverse(pair.2));
    pairs
}
