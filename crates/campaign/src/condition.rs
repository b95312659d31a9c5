//! Under which condition a reading was taken: readings of one condition should agree but for noise.
//!
//! A condition is a target, a pose, the direction of approach and a load. Payloads are stated and compared as they are.
//! Wrenches are measured: two of them are one load if they differ by no more than their noise explains.

use super::{Noise, Reading, Wrench};
use std::collections::BTreeMap;

/// Wrenches of one load differ by at most so many standard deviations of the force, ...
const REACH: f64 = 6.0;
/// ... or by this share of the force, where that is more: a load hangs a little differently each time.
const SHARE: f64 = 0.02;
/// Where no noise of the force is stated, forces of two loads are apart by at least this share of their whole range. So
/// many levels of force as readings have a gap between them, and one level if there is none.
const GAP: f64 = 0.15;
/// ... and by so many times what the widest level spans: else it is noise that happens to have gaps.
const CLEAR: f64 = 3.0;
/// A level holds at least so many readings: one alone far from all others is an outlier, no load.
const MIN_OF_A_LEVEL: usize = 2;

/// The condition of a reading, by numbers within the readings that it was compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Condition {
    /// Target and pose.
    pub pose: usize,
    /// Directions of approach of all joints.
    pub direction: usize,
    /// What hangs on the arm.
    pub load: usize,
}

/// Label of a reading's pose: its own, or its encoder angles to the bit.
pub fn pose_key(reading: &Reading) -> (String, Vec<u64>) {
    match &reading.pose {
        Some(label) => (label.clone(), Vec::new()),
        None => (
            String::new(),
            reading.joints.iter().map(|x| x.to_bits()).collect(),
        ),
    }
}

/// Conditions of readings. `noise` is what is stated of it: with the σ of forces wrenches are compared by it.
pub fn conditions(readings: &[&Reading], noise: Option<&Noise>) -> Vec<Condition> {
    let poses = sorted(readings.iter().map(|r| (r.target, pose_key(r))));
    let directions = sorted(readings.iter().map(|reading| -> Vec<u64> {
        let approach = reading.approach.iter().flatten();
        approach.map(|x| x.to_bits()).collect()
    }));
    let loads = loads(readings, &poses, noise);
    let all = poses.into_iter().zip(directions).zip(loads);
    all.map(|((pose, direction), load)| Condition {
        pose,
        direction,
        load,
    })
    .collect()
}

/// Groups of two and more readings of one condition: their indices.
pub fn repeats(readings: &[&Reading], noise: Option<&Noise>) -> Vec<Vec<usize>> {
    let mut order: Vec<(Condition, usize)> = conditions(readings, noise)
        .into_iter()
        .enumerate()
        .map(|(index, condition)| (condition, index))
        .collect();
    order.sort_unstable();
    order
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() > 1)
        .map(|group| group.iter().map(|&(_, index)| index).collect())
        .collect()
}

/// Numbers of keys by their order.
fn sorted<K: Ord>(keys: impl Iterator<Item = K>) -> Vec<usize> {
    let keys: Vec<K> = keys.collect();
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by(|&a, &b| keys[a].cmp(&keys[b]));
    let mut numbers = vec![0; keys.len()];
    let mut number = 0;
    for (place, &index) in order.iter().enumerate() {
        if place > 0 && keys[index] != keys[order[place - 1]] {
            number += 1;
        }
        numbers[index] = number;
    }
    numbers
}

/// Numbers of the loads: of one payload one, of wrenches alone those that differ by more than noise.
fn loads(readings: &[&Reading], poses: &[usize], noise: Option<&Noise>) -> Vec<usize> {
    let stated = |reading: &Reading| {
        let payload = reading.payload;
        payload.map(|p| [p.mass, p.com.x, p.com.y, p.com.z].map(f64::to_bits))
    };
    let alone = |reading: &&Reading| reading.wrench.filter(|_| reading.payload.is_none());
    let sigma = noise.map_or(0.0, |noise| noise.force);
    let wrenches: Vec<Option<Wrench>> = readings.iter().map(alone).collect();
    let forces: Vec<f64> = wrenches.iter().flatten().map(|w| w.force.norm()).collect();
    let gaps = gaps(&forces, sigma);
    let level = |wrench: &Wrench| {
        let force = wrench.force.norm();
        gaps.iter().filter(|gap| force > **gap).count()
    };
    // of a level, forces of other directions are other loads: a pull, no weight
    let mut of_pose: BTreeMap<(usize, usize), Vec<Wrench>> = BTreeMap::new();
    let mut turned = |pose: usize, wrench: &Wrench| {
        let known = of_pose.entry((pose, level(wrench))).or_default();
        let reach = match (sigma > 0.0, gaps.is_empty()) {
            (true, _) => (REACH * sigma).max(SHARE * wrench.force.norm()),
            // one level of unknown noise may be noise alone, of all directions
            (false, true) => f64::INFINITY,
            (false, false) => wrench.force.norm() / 2.0 + gaps[0],
        };
        let near = |other: &Wrench| (other.force - wrench.force).norm() <= reach;
        known.iter().position(near).unwrap_or_else(|| {
            known.push(*wrench);
            known.len() - 1
        })
    };
    let keys = readings.iter().zip(&wrenches).zip(poses);
    let keys: Vec<_> = keys
        .map(|((reading, wrench), &pose)| {
            let measured = wrench.map(|w| (level(&w), turned(pose, &w)));
            (stated(reading), measured)
        })
        .collect();
    sorted(keys.into_iter())
}

/// Forces between the levels of forces, N, rising.
fn gaps(forces: &[f64], sigma: f64) -> Vec<f64> {
    let mut forces = forces.to_vec();
    forces.sort_by(f64::total_cmp);
    let (Some(&first), Some(&last)) = (forces.first(), forces.last()) else {
        return Vec::new();
    };
    let range = last - first;
    let is_gap = |lower: f64, upper: f64| match sigma > 0.0 {
        true => upper - lower > (REACH * sigma).max(SHARE * upper),
        false => range > 0.0 && upper - lower >= GAP * range,
    };
    let mut found = Vec::new();
    let (mut begin, mut widest, mut narrowest) = (0, 0f64, f64::INFINITY);
    for next in 1..forces.len() {
        let (lower, upper) = (forces[next - 1], forces[next]);
        let enough = next - begin >= MIN_OF_A_LEVEL && forces.len() - next >= MIN_OF_A_LEVEL;
        if is_gap(lower, upper) && (enough || sigma > 0.0) {
            found.push((lower + upper) / 2.0);
            narrowest = narrowest.min(upper - lower);
            widest = widest.max(lower - forces[begin]);
            begin = next;
        }
    }
    widest = widest.max(last - forces[begin]);
    if sigma > 0.0 || narrowest >= CLEAR * widest {
        found
    } else {
        Vec::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Payload;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    fn reading(pose: &str, force: Option<[f64; 3]>, payload: Option<f64>) -> Reading {
        Reading {
            pose: Some(pose.to_owned()),
            wrench: force.map(|force| Wrench {
                force: Vector3::from(force),
                torque: Vector3::zeros(),
            }),
            payload: payload.map(|mass| Payload {
                mass,
                com: Vector3::zeros(),
            }),
            ..Reading::to_be(0, vec![0.0])
        }
    }

    fn groups(readings: &[Reading], sigma: f64) -> Vec<Vec<usize>> {
        let readings: Vec<&Reading> = readings.iter().collect();
        let noise = Noise {
            force: sigma,
            ..Noise::default()
        };
        repeats(&readings, Some(&noise))
    }

    #[test]
    fn wrenches_alone_group_as_payloads_do() {
        // two loads, two repeats, in two poses; noise of 0.05 N about 0 and 49 N
        let forces = [
            [0.03, -0.05, 0.02],
            [-0.06, 0.01, 0.04],
            [0.02, 0.05, -49.03],
            [-0.04, 0.0, -48.95],
        ];
        let by_wrench: Vec<Reading> = ["a", "b"]
            .iter()
            .flat_map(|pose| forces.map(|force| reading(pose, Some(force), None)))
            .collect();
        let masses = [0.0, 0.0, 5.0, 5.0];
        let by_payload: Vec<Reading> = ["a", "b"]
            .iter()
            .flat_map(|pose| masses.map(|mass| reading(pose, None, Some(mass))))
            .collect();
        let expected = vec![vec![0, 1], vec![2, 3], vec![4, 5], vec![6, 7]];
        assert_eq!(groups(&by_payload, 0.0), expected);
        assert_eq!(groups(&by_wrench, 0.05), expected, "σ stated");
        assert_eq!(groups(&by_wrench, 0.0), expected, "σ unknown");
        let all: Vec<&Reading> = by_wrench.iter().collect();
        let loads: std::collections::BTreeSet<usize> =
            conditions(&all, None).iter().map(|c| c.load).collect();
        assert_eq!(loads.len(), 2, "two loads are two, not four");
    }

    #[test]
    fn noise_alone_is_one_load() {
        // forces of an unloaded sensor in all directions, no level of them apart from the others
        let forces = [
            [0.03, 0.0, 0.0],
            [0.0, -0.05, 0.0],
            [0.0, 0.0, 0.04],
            [-0.045, 0.0, 0.0],
            [0.0, 0.035, 0.02],
        ];
        let readings: Vec<Reading> = forces.map(|force| reading("a", Some(force), None)).into();
        assert_eq!(groups(&readings, 0.0), [vec![0, 1, 2, 3, 4]]);
        assert_eq!(groups(&readings, 0.05), [vec![0, 1, 2, 3, 4]]);
    }

    #[test]
    fn levels_of_force_have_gaps_between_them() {
        // forces, σ, number of levels
        let table: [(&[f64], f64, usize); 12] = [
            (&[], 0.0, 1),
            (&[5.0], 0.0, 1),
            (&[0.0, 0.0, 10.0, 10.0], 0.0, 2),
            // a single one far off is no load ...
            (&[0.0, 0.01, 0.02, 10.0], 0.0, 1),
            // ... unless it is off by more than stated noise
            (&[0.0, 0.01, 0.02, 10.0], 0.1, 2),
            (&[0.0, 0.0, 0.61, 0.61], 0.1, 2),
            (&[0.0, 0.0, 0.59, 0.59], 0.1, 1),
            // two hundredths of 100 N are the hand's
            (&[100.0, 100.0, 101.9, 101.9], 0.1, 1),
            // a gap of three times the widest level, and of less
            (&[0.0, 1.0, 4.0, 4.5], 0.0, 2),
            (&[0.0, 1.0, 3.9, 4.5], 0.0, 1),
            // 14 and 15 per cent of the range
            (&[0.0, 0.0, 1.4, 1.4, 10.0, 10.0], 0.0, 2),
            (&[0.0, 0.0, 1.5, 1.5, 10.0, 10.0], 0.0, 3),
        ];
        for (forces, sigma, levels) in table {
            assert_eq!(gaps(forces, sigma).len() + 1, levels, "{forces:?} {sigma}");
        }
    }

    #[test]
    fn a_pull_from_another_side_is_another_load() {
        let readings = [
            reading("a", Some([50.0, 0.0, 0.0]), None),
            reading("a", Some([50.1, 0.0, 0.0]), None),
            reading("a", Some([0.0, 50.0, 0.0]), None),
            reading("a", Some([0.0, 50.1, 0.0]), None),
        ];
        assert_eq!(groups(&readings, 0.1), [vec![0, 1], vec![2, 3]]);
    }

    #[test]
    fn target_pose_direction_and_payload_each_make_a_condition() {
        let same = reading("a", None, Some(5.0));
        let mut other_target = same.clone();
        other_target.target = 1;
        let mut other_side = same.clone();
        other_side.approach = Some(vec![1.0]);
        let mut other_centre = same.clone();
        other_centre.payload = Some(Payload {
            mass: 5.0,
            com: Vector3::x(),
        });
        let all = [
            same.clone(),
            other_target,
            reading("b", None, Some(5.0)),
            other_side,
            reading("a", None, Some(4.0)),
            other_centre,
            reading("a", None, None),
            same,
        ];
        assert_eq!(groups(&all, 0.0), [vec![0, 7]]);
    }

    #[test]
    fn poses_without_a_label_are_their_angles() {
        let at = |angle: f64| Reading::to_be(0, vec![angle]);
        assert_eq!(groups(&[at(0.5), at(0.25), at(0.5)], 0.0), [vec![0, 2]]);
    }

    proptest! {
        /// Neither the order of the rows nor the labels of poses matter.
        #[test]
        fn groups_do_not_depend_on_order_or_names(
            rows in prop::collection::vec((0usize..4, 0usize..3, any::<bool>(), -1.0f64..1.0), 1..40),
            seed in any::<u64>(),
        ) {
            let make = |name: fn(usize) -> String| -> Vec<Reading> {
                let each = rows.iter();
                each.map(|&(pose, load, up, noise)| {
                    let force = [0.01 * noise, 0.0, -25.0 * load as f64 + 0.02 * noise];
                    Reading {
                        approach: Some(vec![if up { 1.0 } else { -1.0 }]),
                        ..reading(&name(pose), Some(force), None)
                    }
                })
                .collect()
            };
            let normal = |mut groups: Vec<Vec<usize>>| {
                groups.iter_mut().for_each(|group| group.sort_unstable());
                groups.sort();
                groups
            };
            let one = make(|pose| format!("p{pose}"));
            let expected = normal(groups(&one, 0.01));
            let renamed = make(|pose| format!("x{}", 9 - pose));
            prop_assert_eq!(&normal(groups(&renamed, 0.01)), &expected);
            // a deterministic shuffle
            let mut order: Vec<usize> = (0..one.len()).collect();
            order.sort_by_key(|&k| (k as u64).wrapping_mul(seed | 1).rotate_left(17));
            let shuffled: Vec<Reading> = order.iter().map(|&k| one[k].clone()).collect();
            let back = groups(&shuffled, 0.01)
                .into_iter()
                .map(|group| group.into_iter().map(|k| order[k]).collect())
                .collect();
            prop_assert_eq!(&normal(back), &expected);
            // and they are those of payload, pose and direction
            let mut by_hand: BTreeMap<_, Vec<usize>> = BTreeMap::new();
            for (index, row) in rows.iter().enumerate() {
                by_hand.entry((row.0, row.1, row.2)).or_default().push(index);
            }
            let by_hand = by_hand.into_values().filter(|group| group.len() > 1).collect();
            prop_assert_eq!(&normal(by_hand), &expected);
        }
    }
}
