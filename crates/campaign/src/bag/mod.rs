//! From a ROS 2 bag to a campaign: clocks brought together, stops found and averaged, what was thrown away said.

mod average;
pub mod clock;
pub mod dwells;
mod readings;
mod spec;
pub mod stream;

pub use readings::{Drop, Dwells, Scatter};
pub use spec::{ClockSpec, DwellSpec, Spec, TargetSpec};

use crate::campaign::{Campaign, CampaignError, Frame, Wrench};
use crate::recording::{Bag, PoseSample, RecordingError, Samples, Stamp};
use crate::robot::JointKind;
use crate::setup::Setup;
use clock::{ClockReport, Offset, Path, Status};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;
use std::sync::Arc;
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

/// A tracker that sees this many times the nominal motion counts in another unit, or tracks another link.
const SCALE: std::ops::Range<f64> = 0.8..1.25;

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
    let joints = joints(bag, spec, start, &mut import)?;
    let mut tracked = Vec::new();
    for index in 0..spec.targets.len() {
        tracked.push(target(bag, spec, index, &joints, start, &mut import)?);
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

/// Joints of the robot over time, in its order; those that the bag does not hold stand at zero.
fn joints(
    bag: &Bag,
    spec: &Spec,
    start: i64,
    import: &mut Import,
) -> Result<Series<Vec<f64>>, ImportError> {
    let empty = Vec::new();
    let samples = match bag.samples.get(&spec.joints) {
        Some(Samples::Joints(samples)) => samples,
        _ => &empty,
    };
    let robot = &spec.robot;
    let setup = Setup::new(
        robot.clone(),
        spec.settings.targets.clone(),
        spec.settings.gravity,
    );
    let names = |joints: &[usize]| -> Vec<&str> {
        joints
            .iter()
            .map(|j| robot.joints[*j].name.as_str())
            .collect()
    };
    let mut there: BTreeSet<&str> = BTreeSet::new();
    let mut last: Option<&Arc<[String]>> = None;
    for (_, list, _) in samples {
        if last.is_none_or(|last| !Arc::ptr_eq(last, list)) {
            there.extend(list.iter().map(String::as_str));
            last = Some(list);
        }
    }
    let unfit = |found: String, accepted: String| ImportError::Unfit {
        file: bag.name.clone(),
        topic: spec.joints.clone(),
        found,
        accepted,
    };
    let (known, missing): (Vec<usize>, Vec<usize>) = setup
        .observed
        .iter()
        .partition(|joint| there.contains(robot.joints[**joint].name.as_str()));
    if known.is_empty() {
        let found: Vec<&str> = there.into_iter().take(30).collect();
        return Err(unfit(
            format!("joints {}", found.join(", ")),
            format!(
                "joints of {}: {}",
                robot.name,
                names(&setup.observed).join(", ")
            ),
        ));
    }
    if !missing.is_empty() {
        import.warnings.push(format!(
            "{}: no joint {}: it stays at zero",
            spec.joints,
            names(&missing).join(", ")
        ));
    }
    // joints that move no target are carried along, if they are there
    let mut partial = 0;
    let mut places: Vec<(usize, usize)> = Vec::new();
    let mut placed: Option<&Arc<[String]>> = None;
    let mut complete = false;
    let mut rows: Vec<(Stamp, Vec<f64>)> = Vec::with_capacity(samples.len());
    for (stamp, list, position) in samples {
        if placed.is_none_or(|last| !Arc::ptr_eq(last, list)) {
            places = list
                .iter()
                .enumerate()
                .filter_map(|(k, name)| Some((k, robot.joint(name)?)))
                .collect();
            complete = known
                .iter()
                .all(|j| places.iter().any(|(_, joint)| joint == j));
            placed = Some(list);
        }
        if !complete {
            partial += 1;
            continue;
        }
        let mut row = vec![0.0; robot.joints.len()];
        for (k, joint) in &places {
            row[*joint] = position[*k];
        }
        rows.push((*stamp, row));
    }
    if rows.is_empty() {
        return Err(unfit(
            format!(
                "{partial} messages, none with all of {}",
                names(&known).join(", ")
            ),
            "joint states of the whole arm in one message".into(),
        ));
    }
    let (mut series, mut report) = stream::series(
        (&spec.joints, JOINT_TYPES[0], "joints"),
        rows,
        start,
        |row| row.iter().all(|q| q.is_finite()),
    );
    report.messages = samples.len();
    if partial > 0 {
        let why = "without all joints of the robot".to_owned();
        report.others.push((why, partial));
    }
    // an endless joint that jumps by turns has not moved
    for (j, joint) in robot.joints.iter().enumerate() {
        if joint.kind == JointKind::Continuous {
            let mut before: Option<f64> = None;
            for value in &mut series.values {
                if let Some(before) = before {
                    value[j] -= ((value[j] - before) / TAU).round() * TAU;
                }
                before = Some(value[j]);
            }
        }
    }
    import.streams.push(report);
    Ok(series)
}

/// Streams of a target, on the clock of the joints.
fn target(
    bag: &Bag,
    spec: &Spec,
    index: usize,
    joints: &Series<Vec<f64>>,
    start: i64,
    import: &mut Import,
) -> Result<Tracked, ImportError> {
    let target = &spec.targets[index];
    let name = &spec.settings.targets[index].name;
    let link = spec.settings.targets[index].link;
    let role = format!("tracker {name}");
    let samples = poses(bag, target)?;
    let kind = kind_of(bag, &target.tracker);
    let unit = target.unit;
    let rows = samples.iter().map(|(stamp, position, rotation)| {
        (*stamp, (position * unit, rotation.unwrap_or_default()))
    });
    let (series, report) = stream::series(
        (&target.tracker, &kind, &role),
        rows.collect(),
        start,
        |(p, q)| p.iter().chain(q).all(|x| x.is_finite()),
    );
    let joints_lag = import.streams.first().map_or(0.0, |s| s.stamp_less_log_s);
    let by_log = report.stamp_less_log_s - joints_lag;
    import.streams.push(report);
    let (positions, rotations): (Vec<Vector3<f64>>, Vec<[f64; 4]>) =
        series.values.into_iter().unzip();
    let mut position = Series {
        times: series.times,
        values: positions,
        gap: series.gap,
    };
    let path = Path::of_link(&spec.robot, link, joints);
    let lever = match spec.settings.link_from_target[index] {
        Frame::Known(pose) => pose.translation.vector,
        Frame::Estimate => Vector3::zeros(),
    };
    let offset = offset(
        (&role, &target.tracker),
        (&path, lever),
        &position,
        (spec.clock.tracker_offset_s, by_log),
        spec,
        import,
    );
    if let Some(scale) = import.clocks.last().and_then(|clock| clock.scale)
        && !SCALE.contains(&scale)
    {
        let hint = match scale {
            800.0..1250.0 => "is the topic in mm? then unit = \"mm\"",
            _ => "is it the right link, robot and unit?",
        };
        import.warnings.push(format!(
            "{}: it moves {scale:.3} times as far as {}: {hint}",
            target.tracker, spec.robot.links[link].name
        ));
    }
    shift(&mut position.times, &offset);
    let orientation = match target.orientation && samples.iter().all(|s| s.2.is_some()) {
        true => orientations(&rotations, &target.tracker, import),
        false => None,
    };
    let wrench = match &target.wrench {
        Some(topic) => Some(wrenches(bag, spec, index, topic, joints, start, import)?),
        None => None,
    };
    Ok(Tracked {
        position,
        orientation,
        wrench,
    })
}

/// Samples of a target's topic, of the pair of frames if it has several.
fn poses(bag: &Bag, target: &TargetSpec) -> Result<Vec<PoseSample>, ImportError> {
    let unfit = |found: String, accepted: String| ImportError::Unfit {
        file: bag.name.clone(),
        topic: target.tracker.clone(),
        found,
        accepted,
    };
    match (bag.samples.get(&target.tracker), &target.frames) {
        (Some(Samples::Poses(samples)), _) => Ok(samples.clone()),
        (Some(Samples::Transforms(pairs)), frames) => {
            let there: Vec<String> = pairs
                .iter()
                .take(30)
                .map(|((a, b), samples)| format!("[\"{a}\", \"{b}\"] ({})", samples.len()))
                .collect();
            let there = format!("frames = one of {}", there.join(", "));
            match frames {
                None => Err(unfit("no `frames` in the spec".into(), there)),
                Some(pair) => match pairs.get(pair) {
                    Some(samples) => Ok(samples.clone()),
                    None => Err(unfit(format!("no [\"{}\", \"{}\"]", pair.0, pair.1), there)),
                },
            }
        }
        _ => Ok(Vec::new()),
    }
}

fn kind_of(bag: &Bag, topic: &str) -> String {
    let found = bag.topics.iter().find(|t| t.topic == topic);
    found.map_or_else(String::new, |t| t.kind.clone())
}

/// Rotations, unless the topic fills the field without measuring it.
fn orientations(
    rotations: &[[f64; 4]],
    topic: &str,
    import: &mut Import,
) -> Option<Vec<UnitQuaternion<f64>>> {
    let turned: Option<Vec<_>> = rotations
        .iter()
        .map(|[x, y, z, w]| {
            // trackers write single precision
            let q = nalgebra::Quaternion::new(*w, *x, *y, *z);
            ((q.norm() - 1.0).abs() < 1e-3).then(|| UnitQuaternion::new_normalize(q))
        })
        .collect();
    let why = match &turned {
        None => "not all quaternions are of norm 1",
        Some(turned) if turned.windows(2).all(|pair| pair[0] == pair[1]) => "it never changes",
        Some(_) => return turned,
    };
    import
        .warnings
        .push(format!("{topic}: the orientation is not used: {why}"));
    None
}

/// Wrenches of the load on the arm at the target link's origin, in its frame.
fn wrenches(
    bag: &Bag,
    spec: &Spec,
    index: usize,
    topic: &str,
    joints: &Series<Vec<f64>>,
    start: i64,
    import: &mut Import,
) -> Result<Series<Wrench>, ImportError> {
    let empty = (String::new(), Vec::new());
    let (frame, samples) = match bag.samples.get(topic) {
        Some(Samples::Wrenches(frame, samples)) => (frame, samples),
        _ => (&empty.0, &empty.1),
    };
    let target = &spec.targets[index];
    let robot = &spec.robot;
    let own = spec.settings.targets[index].link;
    let named = robot
        .link(frame)
        .filter(|l| robot.links[*l].body == robot.links[own].body);
    let sensor = target.wrench_link.or(named).unwrap_or_else(|| {
        import.warnings.push(format!(
            "{topic}: its frame {frame:?} is no link fixed to {0}: taken to be {0}'s own (wrench_link names another)",
            robot.links[own].name
        ));
        own
    });
    let role = format!("wrench {}", spec.settings.targets[index].name);
    let rows = samples.iter().map(|(stamp, force, torque)| {
        let sign = target.wrench_sign;
        let wrench = Wrench {
            force: force * sign,
            torque: torque * sign,
        };
        (*stamp, wrench)
    });
    let (mut series, report) = stream::series(
        (topic, WRENCH_TYPES[0], &role),
        rows.collect(),
        start,
        |w| w.force.iter().chain(&w.torque).all(|x| x.is_finite()),
    );
    let joints_lag = import.streams.first().map_or(0.0, |s| s.stamp_less_log_s);
    let by_log = report.stamp_less_log_s - joints_lag;
    import.streams.push(report);
    let forces = Series {
        times: series.times.clone(),
        values: series.values.iter().map(|w| w.force).collect(),
        gap: series.gap,
    };
    let path = Path::of_gravity(robot, sensor, joints, &spec.settings.gravity);
    let offset = offset(
        (&role, topic),
        (&path, Vector3::zeros()),
        &forces,
        (spec.clock.wrench_offset_s, by_log),
        spec,
        import,
    );
    shift(&mut series.times, &offset);
    let own_from_sensor: Isometry3<f64> =
        robot.links[own].body_from_link.inverse() * robot.links[sensor].body_from_link;
    for wrench in &mut series.values {
        wrench.force = own_from_sensor.rotation * wrench.force;
        wrench.torque = own_from_sensor.rotation * wrench.torque
            + own_from_sensor.translation.vector.cross(&wrench.force);
    }
    Ok(series)
}

/// The offset of a stream: given, estimated, or what the log times say. Reported.
fn offset(
    (role, topic): (&str, &str),
    (path, lever): (&Path, Vector3<f64>),
    measured: &Series<Vector3<f64>>,
    (given, by_log): (Option<f64>, f64),
    spec: &Spec,
    import: &mut Import,
) -> Offset {
    let estimate = clock::estimate(path, measured, lever, spec.clock.max_offset_s);
    let still = Offset {
        offset: 0.0,
        drift: 0.0,
        middle: 0.0,
    };
    let mut report = ClockReport {
        role: format!("{role}, {topic}"),
        status: Status::Unknown,
        offset_s: by_log,
        std_s: None,
        by_log_times_s: by_log,
        correlation: None,
        next_correlation: None,
        drift: None,
        drift_std: None,
        drift_applied: false,
        scale: None,
        why: None,
    };
    let mut used = still.clone();
    match estimate {
        Ok(found) => {
            report.status = Status::Estimated;
            report.offset_s = by_log + found.offset.offset;
            report.std_s = found.std;
            report.correlation = Some(found.correlation);
            report.next_correlation = Some(found.next);
            report.drift = found.drift.map(|d| d.0);
            report.drift_std = found.drift.map(|d| d.1);
            report.drift_applied = found.offset.drift != 0.0;
            report.scale = Some(found.scale);
            used = found.offset;
        }
        Err(unknown) => {
            report.correlation = unknown.correlations.map(|c| c.0);
            report.next_correlation = unknown.correlations.map(|c| c.1);
            report.why = Some(unknown.why);
        }
    }
    if let Some(given) = given {
        if report.status == Status::Estimated && (report.offset_s - given).abs() > 0.05 {
            import.warnings.push(format!(
                "{topic}: the motion says {:+.4} s where the spec gives {given:+.4} s, which is used",
                report.offset_s
            ));
        }
        report.status = Status::Given;
        report.offset_s = given;
        report.std_s = None;
        report.drift_applied = false;
        used = Offset {
            offset: given - by_log,
            ..still
        };
    }
    import.clocks.push(report);
    used
}

fn shift(times: &mut [f64], offset: &Offset) {
    for time in times {
        *time = offset.joints_time(*time);
    }
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
