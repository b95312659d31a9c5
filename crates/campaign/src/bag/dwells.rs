//! Stops: spans of time in which no joint moves, and how each joint came to its place.
//!
//! What counts as still is taken from the streams: over a short time the joints' means before and after are compared; where
//! these differ by less than a loose bound is rest, and the noise found in that rest sets the bound that is used.

use super::stream::{Series, quantile};
use nalgebra::Vector3;

/// Values before and after are compared over this time, s.
const WINDOW: f64 = 0.2;
/// s.
const STEP: f64 = WINDOW / 4.0;
/// Loose bound: surely moving, rad (m) within [`WINDOW`]. It is a choice: 1 mrad/s; the noise found below it sets the bound.
const MOVING: f64 = 2e-4;
/// Tightest bound, rad (m): 0.1 mrad/s, below which nothing is called a motion.
const STILL: f64 = 2e-5;
/// The bound in multiples of the 95 % quantile at rest: 5.9 σ of a coordinate's normal noise.
const JOINT_FACTOR: f64 = 3.0;
/// The same of the length of a vector: 5.6 σ of each of its coordinates.
const TARGET_FACTOR: f64 = 2.0;
/// Most steps of the grid: three days.
const MOST_STEPS: f64 = 5e6;

/// A stop of the joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// Joints' time of its first and last moment, s.
    pub from: f64,
    /// s.
    pub to: f64,
    /// Mean of the joints, rad (m).
    pub joints: Vec<f64>,
    /// Direction of each joint's last motion before it: -1, 0, +1.
    pub approach: Vec<f64>,
}

/// Mean of the samples of a span; `None` without any.
fn mean(series: &Series<Vec<f64>>, from: f64, to: f64) -> Option<Vec<f64>> {
    let values = &series.values[series.range(from, to)];
    let mut sum = values.first()?.clone();
    for value in &values[1..] {
        sum.iter_mut().zip(value).for_each(|(sum, x)| *sum += x);
    }
    let count = values.len() as f64;
    sum.iter_mut().for_each(|sum| *sum /= count);
    Some(sum)
}

/// Value before a time and after it; `None` in gaps and at the ends.
fn around(series: &Series<Vec<f64>>, time: f64) -> Option<(Vec<f64>, Vec<f64>)> {
    let half = WINDOW / 2.0;
    // slow streams have no sample in every half
    let before = mean(series, time - half, time).or_else(|| series.at(time - half))?;
    let after = mean(series, time, time + half).or_else(|| series.at(time + half))?;
    series.at(time)?;
    Some((before, after))
}

/// Stops of the joints in time, and the bounds that were used, by joint.
pub fn stops(joints: &Series<Vec<f64>>, same_pose: f64) -> (Vec<Stop>, Vec<f64>) {
    let Some((start, end)) = joints.span() else {
        return (Vec::new(), Vec::new());
    };
    let count = joints.values.first().map_or(0, Vec::len);
    let steps = ((end - start) / STEP).clamp(0.0, MOST_STEPS) as usize + 1;
    let changes: Vec<Option<Vec<f64>>> = (0..steps)
        .map(|k| {
            let (before, after) = around(joints, start + k as f64 * STEP)?;
            let change = before.iter().zip(&after).map(|(a, b)| (a - b).abs());
            Some(change.collect())
        })
        .collect();
    let rest: Vec<&Vec<f64>> = changes
        .iter()
        .flatten()
        .filter(|change| change.iter().all(|x| *x < MOVING))
        .collect();
    let bounds: Vec<f64> = (0..count)
        .map(|joint| {
            let mut values: Vec<f64> = rest.iter().map(|change| change[joint]).collect();
            let noise = quantile(&mut values, 0.95).unwrap_or(0.0);
            (JOINT_FACTOR * noise).clamp(STILL, MOVING)
        })
        .collect();
    let still = changes.iter().map(|change| {
        change
            .as_ref()
            .is_some_and(|change| change.iter().zip(&bounds).all(|(x, bound)| x < bound))
    });
    let mut found = Vec::new();
    for (first, last) in runs(still) {
        let (from, to) = (start + first as f64 * STEP, start + last as f64 * STEP);
        if let Some(joints) = mean(joints, from, to) {
            found.push(Stop {
                from,
                to,
                joints,
                approach: vec![0.0; count],
            });
        }
    }
    approach(joints, &mut found, same_pose);
    (found, bounds)
}

/// First and last index of each run of what is true.
fn runs(flags: impl Iterator<Item = bool>) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = Vec::new();
    let mut open = false;
    for (index, flag) in flags.enumerate() {
        match (flag, open, found.last_mut()) {
            (true, true, Some(run)) => run.1 = index,
            (true, _, _) => found.push((index, index)),
            _ => {}
        }
        open = flag;
    }
    found
}

/// Directions as a gear with play feels them: it is dragged along, and turned round by a way back of `tolerance`.
fn approach(joints: &Series<Vec<f64>>, stops: &mut [Stop], tolerance: f64) {
    let Some(first) = joints.values.first() else {
        return;
    };
    let reach = tolerance / 2.0;
    let mut dragged = first.clone();
    let mut direction = vec![0.0; first.len()];
    let mut next = 0;
    for (time, value) in joints.times.iter().zip(&joints.values) {
        for (j, q) in value.iter().enumerate() {
            if q - dragged[j] > reach {
                direction[j] = 1.0;
                dragged[j] = q - reach;
            } else if dragged[j] - q > reach {
                direction[j] = -1.0;
                dragged[j] = q + reach;
            }
        }
        while let Some(stop) = stops.get_mut(next).filter(|stop| stop.from <= *time) {
            stop.approach.clone_from(&direction);
            next += 1;
        }
    }
}

/// Leaves one of neighbouring stops between which no joint left its place by `tolerance`: the longest. The number left out.
pub fn merge(joints: &Series<Vec<f64>>, stops: Vec<Stop>, tolerance: f64) -> (Vec<Stop>, usize) {
    let mut kept: Vec<Stop> = Vec::new();
    let mut left_out = 0;
    for stop in stops {
        let same = kept.last().is_some_and(|last| {
            let between = &joints.values[joints.range(last.to, stop.from)];
            between
                .iter()
                .chain([&stop.joints])
                .all(|q| apart(q, &last.joints) < tolerance)
        });
        match kept.last_mut() {
            Some(last) if same => {
                left_out += 1;
                if stop.to - stop.from > last.to - last.from {
                    let approach = std::mem::take(&mut last.approach);
                    *last = Stop { approach, ..stop };
                }
            }
            _ => kept.push(stop),
        }
    }
    (kept, left_out)
}

/// Largest difference of a joint, rad (m).
pub fn apart(a: &[f64], b: &[f64]) -> f64 {
    let each = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    each.fold(0.0, f64::max)
}

/// Change of a target's place about a time, m; `None` where it is not seen.
fn target_change(target: &Series<Vector3<f64>>, time: f64) -> Option<f64> {
    let half = WINDOW / 2.0;
    Some((target.at(time + half)? - target.at(time - half)?).norm())
}

/// Bound below which a target is still, m, from what it does while the joints stand.
pub fn target_bound(target: &Series<Vector3<f64>>, stops: &[Stop], settle: f64) -> f64 {
    let mut changes: Vec<f64> = stops
        .iter()
        .flat_map(|stop| grid(stop.from + settle, stop.to - settle))
        .filter_map(|time| target_change(target, time))
        .collect();
    (TARGET_FACTOR * quantile(&mut changes, 0.95).unwrap_or(0.0)).max(STILL)
}

/// The longest span of a stop in which the target is seen and still; the share of the stop in which it is seen at all.
pub fn still_span(
    target: &Series<Vector3<f64>>,
    from: f64,
    to: f64,
    bound: f64,
) -> (Option<(f64, f64)>, f64) {
    let times: Vec<f64> = grid(from, to).collect();
    let changes: Vec<Option<f64>> = times.iter().map(|t| target_change(target, *t)).collect();
    let seen = changes.iter().flatten().count() as f64 / times.len().max(1) as f64;
    let still = changes.iter().map(|c| c.is_some_and(|c| c < bound));
    let longest = runs(still)
        .into_iter()
        .max_by_key(|(first, last)| last - first);
    (longest.map(|(a, b)| (times[a], times[b])), seen)
}

fn grid(from: f64, to: f64) -> impl Iterator<Item = f64> {
    let count = ((to - from) / STEP).clamp(-1.0, MOST_STEPS) as i64 + 1;
    (0..count).map(move |k| from + k as f64 * STEP)
}
