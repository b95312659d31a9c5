//! A campaign's readings as plain numbers: what the doctor alters and fits frames to.

use crate::campaign::{Campaign, Frame};
use crate::fit::start::{By, Known, Sighting, Start, frames_of};
use crate::robot::{JointKind, Robot};
use nalgebra::{UnitQuaternion, Vector3};

/// Readings as plain numbers, in the order of the table.
#[derive(Debug, Clone)]
pub struct Table {
    /// Encoder angles by joint, rad or m.
    pub joints: Vec<Vec<f64>>,
    /// In the tracker's frame, m.
    pub positions: Vec<Vector3<f64>>,
    /// tracker_from_target.
    pub orientations: Vec<Option<UnitQuaternion<f64>>>,
    /// Index of the target of each reading.
    pub targets: Vec<usize>,
    /// Body that each target is fixed to.
    pub bodies: Vec<usize>,
    /// Tracker in the base frame.
    pub tracker: Frame,
    /// Targets on their bodies.
    pub offsets: Vec<Frame>,
}

impl Table {
    /// Of the readings with these indices.
    pub fn of(campaign: &Campaign, rows: &[usize]) -> Self {
        let readings = || rows.iter().map(|&row| &campaign.readings[row]);
        let links = || campaign.targets.iter();
        let offset = |(target, frame): (_, &Frame)| {
            let link: &crate::campaign::Target = target;
            match frame {
                Frame::Known(pose) => {
                    Frame::Known(campaign.robot.links[link.link].body_from_link * pose)
                }
                Frame::Estimate => Frame::Estimate,
            }
        };
        Self {
            joints: readings().map(|r| r.joints.clone()).collect(),
            positions: readings().map(|r| r.position).collect(),
            orientations: readings().map(|r| r.orientation).collect(),
            targets: readings().map(|r| r.target).collect(),
            bodies: links().map(|t| campaign.robot.links[t.link].body).collect(),
            tracker: campaign.base_from_tracker,
            offsets: links()
                .zip(&campaign.link_from_target)
                .map(offset)
                .collect(),
        }
    }

    /// Number of readings.
    pub fn len(&self) -> usize {
        self.joints.len()
    }

    /// Some of the readings.
    pub fn select(&self, rows: &[usize]) -> Self {
        Self {
            joints: rows.iter().map(|&k| self.joints[k].clone()).collect(),
            positions: rows.iter().map(|&k| self.positions[k]).collect(),
            orientations: rows.iter().map(|&k| self.orientations[k]).collect(),
            targets: rows.iter().map(|&k| self.targets[k]).collect(),
            ..self.clone()
        }
    }

    /// Joints that move some target, from the base outwards.
    pub fn moving(&self, robot: &Robot) -> Vec<usize> {
        let mut joints: Vec<usize> = self.bodies.iter().flat_map(|&b| robot.chain(b)).collect();
        joints.sort_unstable();
        joints.dedup();
        joints
    }

    fn sightings(&self, robot: &Robot) -> Vec<Sighting> {
        (0..self.len())
            .map(|row| Sighting {
                link: robot.body_poses(&self.joints[row])[self.bodies[self.targets[row]]],
                target: self.targets[row],
                position: self.positions[row],
                orientation: self.orientations[row],
                weight: 1.0,
            })
            .collect()
    }
}

/// What frames alone leave of a table.
#[derive(Debug, Clone)]
pub struct FramesAlone {
    /// The frames.
    pub start: Start,
    /// Distances left, m, by reading.
    pub distances: Vec<f64>,
    /// Angles left, rad, by reading.
    pub angles: Vec<Option<f64>>,
    /// Size of what the positions do, m: the smaller of their spread and of that of the nominal links.
    pub spread: f64,
}

/// Of the best readings this share says how well frames agree: the others may be blunders.
const TRIMMED: f64 = 0.8;
/// Times that readings far off lose weight.
const REWEIGHTED: usize = 3;

impl FramesAlone {
    /// The robust fit of the frames alone: by positions and by orientations, and the better of the two is kept.
    ///
    /// Readings far off lose weight (a Cauchy distribution: Holland and Welsch 1977).
    pub fn fit(robot: &Robot, table: &Table, rounds: usize) -> Self {
        let sightings = table.sightings(robot);
        let by_positions = Self::reweighted(table, sightings.clone(), By::Positions(rounds));
        if table.orientations.iter().all(Option::is_none) {
            return by_positions;
        }
        let by_orientations = Self::reweighted(table, sightings, By::Orientations);
        match by_orientations.misfit() < by_positions.misfit() {
            true => by_orientations,
            false => by_positions,
        }
    }

    fn reweighted(table: &Table, mut sightings: Vec<Sighting>, by: By) -> Self {
        let known = Known {
            tracker: &table.tracker,
            targets: &table.offsets,
        };
        let mut found = Self::left(&sightings, frames_of(known, &sightings, by));
        for _ in 0..REWEIGHTED {
            let sizes = found.sizes();
            let middle = quantile(&sizes, 0.5);
            if !(middle.is_finite() && middle > 0.0) {
                break;
            }
            for (sighting, size) in sightings.iter_mut().zip(&sizes) {
                sighting.weight = 1.0 / (1.0 + (size / (2.0 * middle)).powi(2));
            }
            let next = Self::left(&sightings, frames_of(known, &sightings, by));
            // the mean square in the beginning may be dragged to where the middle is worse
            if next.misfit() < found.misfit() {
                found = next;
            } else {
                break;
            }
        }
        found
    }

    fn left(sightings: &[Sighting], start: Start) -> Self {
        let tracker = start.base_from_tracker;
        let (mut distances, mut angles) = (Vec::new(), Vec::new());
        for sighting in sightings {
            let target = sighting.link * start.link_from_target[sighting.target];
            let seen = tracker * nalgebra::Point3::from(sighting.position);
            distances.push((seen.coords - target.translation.vector).norm());
            angles.push(
                sighting
                    .orientation
                    .map(|o| (tracker.rotation * o).angle_to(&target.rotation)),
            );
        }
        let seen: Vec<Vector3<f64>> = sightings.iter().map(|s| s.position).collect();
        let links: Vec<Vector3<f64>> = sightings
            .iter()
            .map(|s| {
                (s.link * start.link_from_target[s.target])
                    .translation
                    .vector
            })
            .collect();
        Self {
            start,
            distances,
            angles,
            spread: spread(&seen).min(spread(&links)),
        }
    }

    /// The frames with the targets on their links.
    pub fn start_on_links(&self, campaign: &Campaign) -> Start {
        let targets = campaign.targets.iter().zip(&self.start.link_from_target);
        let on_link = targets.map(|(target, body_from_target)| {
            let link = &campaign.robot.links[target.link];
            link.body_from_link.inverse() * body_from_target
        });
        Start {
            base_from_tracker: self.start.base_from_tracker,
            link_from_target: on_link.collect(),
        }
    }

    /// Sizes of what these frames leave of other readings of the same robot.
    pub fn sizes_of(&self, robot: &Robot, table: &Table) -> Vec<f64> {
        let mut other = Self::left(&table.sightings(robot), self.start.clone());
        other.spread = self.spread;
        other.sizes()
    }

    /// Of each reading: distance over spread, and angle, rad.
    pub fn sizes(&self) -> Vec<f64> {
        let pairs = self.distances.iter().zip(&self.angles);
        pairs
            .map(|(d, a)| (d / self.spread.max(f64::MIN_POSITIVE)).hypot(a.unwrap_or(0.0)))
            .collect()
    }

    /// What the best readings leave, relative to the spread, rms; angles count as rad.
    pub fn misfit(&self) -> f64 {
        trimmed_rms(&self.sizes())
    }

    /// The same of positions, m.
    pub fn position_rms(&self) -> f64 {
        trimmed_rms(&self.distances)
    }

    /// The same of orientations, rad; none without any.
    pub fn orientation_rms(&self) -> Option<f64> {
        let angles: Vec<f64> = self.angles.iter().flatten().copied().collect();
        (!angles.is_empty()).then(|| trimmed_rms(&angles))
    }
}

/// Does a joint turn?
pub fn turns(robot: &Robot, joint: usize) -> bool {
    robot.joints[joint].kind == JointKind::Revolute
}

/// Root mean square of the best readings.
fn trimmed_rms(sizes: &[f64]) -> f64 {
    let mut squares: Vec<f64> = sizes.iter().map(|s| s * s).collect();
    squares.sort_by(f64::total_cmp);
    let kept = ((squares.len() as f64 * TRIMMED).ceil() as usize).max(1);
    let sum: f64 = squares.iter().take(kept).sum();
    (sum / kept as f64).sqrt()
}

/// A quantile of some numbers; no number of none.
pub fn quantile(numbers: &[f64], share: f64) -> f64 {
    let mut sorted: Vec<f64> = numbers.to_vec();
    sorted.sort_by(f64::total_cmp);
    let index = ((sorted.len() as f64 - 1.0) * share).round();
    sorted.get(index as usize).copied().unwrap_or(f64::NAN)
}

/// Robust size of a cloud: the middle distance from its middle, m.
pub fn spread(points: &[Vector3<f64>]) -> f64 {
    let middle = middle(points);
    let distances: Vec<f64> = points.iter().map(|p| (p - middle).norm()).collect();
    quantile(&distances, 0.5)
}

/// Coordinate by coordinate the middle of a cloud, m.
pub fn middle(points: &[Vector3<f64>]) -> Vector3<f64> {
    let of = |axis: usize| {
        let values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        quantile(&values, 0.5)
    };
    Vector3::new(of(0), of(1), of(2))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fifth_of_blunders_does_not_count() {
        for (sizes, rms) in [
            (vec![3.0; 10], 3.0),
            (vec![1.0, 1.0, 1.0, 1.0, 100.0], 1.0),
            (vec![1.0, 1.0, 1.0, 100.0], 50.01),
        ] {
            assert!((trimmed_rms(&sizes) - rms).abs() < 0.01, "{sizes:?}");
        }
    }

    #[test]
    fn quantiles_and_spread_do_not_see_one_far_point() {
        assert_eq!(quantile(&[5.0, 1.0, 3.0], 0.5), 3.0);
        assert!(quantile(&[], 0.5).is_nan());
        let mut points: Vec<_> = (0..9)
            .map(|k| Vector3::new(f64::from(k), 0.0, 0.0))
            .collect();
        let before = spread(&points);
        assert_eq!(before, 2.0);
        points[8].x = 1e9;
        assert_eq!(spread(&points), before);
    }
}
