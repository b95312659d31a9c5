//! The robot's joints over time, from the joint states of a bag.

use super::stream::{self, Series};
use super::{Import, ImportError, JOINT_TYPES, Spec};
use crate::recording::{Bag, JointSample, Samples, Stamp};
use crate::robot::{JointKind, Robot};
use crate::setup::Setup;
use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::sync::Arc;

/// Joints of the robot over time, in its order; those that the bag does not hold stand at zero.
pub(super) fn joints(
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
    let there = names_of(samples);
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
    let (rows, partial) = rows(robot, samples, &known);
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
    count_turns(robot, &mut series.values);
    import.streams.push(report);
    Ok(series)
}

/// All names of joints in the messages.
fn names_of(samples: &[JointSample]) -> BTreeSet<&str> {
    let mut there: BTreeSet<&str> = BTreeSet::new();
    let mut last: Option<&Arc<[String]>> = None;
    for (_, list, _) in samples {
        if last.is_none_or(|last| !Arc::ptr_eq(last, list)) {
            there.extend(list.iter().map(String::as_str));
            last = Some(list);
        }
    }
    there
}

/// Positions of messages that hold all known joints, and the number of the others. Joints that move no target are
/// carried along, if they are there.
fn rows(
    robot: &Robot,
    samples: &[JointSample],
    known: &[usize],
) -> (Vec<(Stamp, Vec<f64>)>, usize) {
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
    (rows, partial)
}

/// An endless joint that jumps by turns has not moved.
fn count_turns(robot: &Robot, values: &mut [Vec<f64>]) {
    for (j, joint) in robot.joints.iter().enumerate() {
        if joint.kind == JointKind::Continuous {
            let mut before: Option<f64> = None;
            for value in values.iter_mut() {
                if let Some(before) = before {
                    value[j] -= ((value[j] - before) / TAU).round() * TAU;
                }
                before = Some(value[j]);
            }
        }
    }
}
