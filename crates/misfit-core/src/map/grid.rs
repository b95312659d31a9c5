//! The points of a map.

use super::request::Request;
use crate::compensation::Reach;
use crate::setup::Setup;
use nalgebra::{Isometry3, Vector3};

/// Letters of the axes.
pub const AXES: [&str; 3] = ["x", "y", "z"];
/// Points if nothing says how many.
const POINTS: usize = 10_000;

/// Points in the base frame, m.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Axes that vary, the first one fastest.
    pub axes: Vec<usize>,
    /// The coordinates that do not, m.
    pub at: Vector3<f64>,
    /// Least and greatest along each of the axes, m.
    pub ranges: Vec<(f64, f64)>,
    /// Points along each.
    pub counts: Vec<usize>,
}

impl Grid {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Is there no point?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Coordinates of the points along one of the axes, m.
    pub fn along(&self, axis: usize) -> Vec<f64> {
        let (least, most) = self.ranges[axis];
        let count = self.counts[axis];
        let step = (most - least) / count as f64;
        // points are the middles of cells
        (0..count)
            .map(|k| least + (k as f64 + 0.5) * step)
            .collect()
    }

    /// Indices of the points beside one.
    pub(super) fn beside(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        let mut stride = 1;
        let strides = self.counts.iter().map(move |&count| {
            let own = stride;
            stride *= count;
            (own, count)
        });
        strides.flat_map(move |(stride, count)| {
            let place = index / stride % count;
            let before = (place > 0).then(|| index - stride);
            let after = (place + 1 < count).then_some(index + stride);
            before.into_iter().chain(after)
        })
    }

    /// A point by its index.
    pub fn point(&self, mut index: usize) -> Vector3<f64> {
        let mut point = self.at;
        for (k, &axis) in self.axes.iter().enumerate() {
            let (least, most) = self.ranges[k];
            let count = self.counts[k];
            let step = (most - least) / count as f64;
            point[axis] = least + ((index % count) as f64 + 0.5) * step;
            index /= count;
        }
        point
    }
}

impl Request {
    /// The points for a target whose arm stands in a posture of reference.
    ///
    /// # Errors
    /// For axes that are none.
    pub fn grid(
        &self,
        setup: &Setup,
        target: usize,
        posture: &[f64],
        reach: &Reach,
    ) -> Result<Grid, String> {
        let axes = self.axes()?;
        let link = &setup.robot.links[setup.targets[target].link];
        let poses = setup.robot.body_poses(posture);
        let mut at = (poses[link.body] * link.body_from_link).translation.vector;
        if let Some(told) = self.at_m
            && let Some(third) = (0..3).find(|axis| !axes.contains(axis))
        {
            at[third] = told;
        }
        let (centre, radius) = ball(setup, target, &poses, &reach.moving);
        let ranges: Vec<(f64, f64)> = match &self.range_m {
            Some(ranges) => ranges.iter().map(|r| (r[0], r[1])).collect(),
            None => axes
                .iter()
                .map(|&axis| (centre[axis] - radius, centre[axis] + radius))
                .collect(),
        };
        // cells as square as can be
        let points = self.points.unwrap_or(POINTS) as f64;
        let whole: f64 = ranges.iter().map(|(a, b)| b - a).product();
        let step = (whole / points).powf(1.0 / axes.len() as f64);
        let counts = ranges
            .iter()
            .map(|(a, b)| (((b - a) / step).round() as usize).max(1))
            .collect();
        Ok(Grid {
            axes,
            at,
            ranges,
            counts,
        })
    }
}

/// Where a target can be at most: around the first joint that moves, by the sum of what lies behind it.
pub(super) fn ball(
    setup: &Setup,
    target: usize,
    poses: &[Isometry3<f64>],
    moving: &[usize],
) -> (Vector3<f64>, f64) {
    let robot = &setup.robot;
    let link = &robot.links[setup.targets[target].link];
    let home = (poses[link.body] * link.body_from_link).translation.vector;
    let chain = robot.chain(link.body);
    let Some(from) = chain.iter().position(|joint| moving.contains(joint)) else {
        return (home, 0.0);
    };
    let first = &robot.joints[chain[from]];
    let centre = (poses[first.parent] * first.parent_from_joint)
        .translation
        .vector;
    let slides = |joint: &crate::robot::Joint| match joint.load_row() {
        0 => joint.limits.map_or(0.0, |(a, b)| a.abs().max(b.abs())),
        _ => 0.0,
    };
    let behind = chain[from + 1..].iter().map(|&joint| &robot.joints[joint]);
    let lengths = behind.map(|j| j.parent_from_joint.translation.vector.norm() + slides(j));
    let last = link.body_from_link.translation.vector.norm();
    (centre, last + slides(first) + lengths.sum::<f64>())
}
