//! A target's poses and wrenches over time, on the clock of the joints.

use super::clock::Path;
use super::offset::{offset, shift};
use super::stream::{self, Series};
use super::{Import, ImportError, Source, TargetSpec, Tracked, WRENCH_TYPES};
use crate::campaign::{Frame, Wrench};
use crate::recording::{Bag, PoseSample, Samples};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A tracker that sees this many times the nominal motion counts in another unit, or tracks another link.
const SCALE_OF_NOMINAL: std::ops::Range<f64> = 0.8..1.25;

/// Streams of a target, on the clock of the joints.
pub(super) fn target(
    source: &Source<'_>,
    index: usize,
    import: &mut Import,
) -> Result<Tracked, ImportError> {
    let &Source {
        bag,
        spec,
        joints,
        start,
    } = source;
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
        && !SCALE_OF_NOMINAL.contains(&scale)
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
        Some(topic) => Some(wrenches(source, index, topic, import)?),
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
    source: &Source<'_>,
    index: usize,
    topic: &str,
    import: &mut Import,
) -> Result<Series<Wrench>, ImportError> {
    let &Source {
        bag,
        spec,
        joints,
        start,
    } = source;
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
