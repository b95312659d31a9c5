//! Where the arm may be measured: ranges of the joints, least height, forbidden postures; and random postures there.

use crate::robot::{JointKind, Robot};
use crate::setup::Setup;
use nalgebra::Vector3;
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

/// Draws before a space is given up as empty.
pub const TRIES: usize = 10_000;

/// Ranges by joint: index, least and greatest, rad or m. A posture inside all of them at once is in the region.
pub type Region = Vec<(usize, f64, f64)>;

/// Postures that are allowed.
#[derive(Debug, Clone, PartialEq)]
pub struct Space {
    /// By joint of the robot: least and greatest angle, rad or m; the same number twice for a joint that stays.
    pub ranges: Vec<(f64, f64)>,
    /// Least height of the target links above the base frame's origin, against gravity, m.
    pub least_height: f64,
    /// Forbidden postures.
    pub forbidden: Vec<Region>,
}

impl Space {
    /// All joints within their limits, a share `margin` of each range left free at either end. Joints that turn
    /// without limits have one full turn; those that slide without limits stay at zero.
    pub fn within_limits(robot: &Robot, margin: f64) -> Self {
        let ranges = robot.joints.iter().map(|joint| {
            let (lower, upper) = joint.limits.unwrap_or(match joint.kind {
                JointKind::Prismatic => (0.0, 0.0),
                _ => (-PI, PI),
            });
            let spare = (upper - lower) * margin;
            (lower + spare, upper - spare)
        });
        Self {
            ranges: ranges.collect(),
            least_height: 0.0,
            forbidden: Vec::new(),
        }
    }

    /// Lets joints that none of these targets hangs on stay where they are in a posture, or nearest to zero.
    pub fn park(&mut self, setup: &Setup, targets: &[usize], at: Option<&[f64]>) {
        let chain = |&target: &usize| setup.robot.chain(setup.target_body(target));
        let moving: Vec<usize> = targets.iter().flat_map(chain).collect();
        for (joint, range) in self.ranges.iter_mut().enumerate() {
            if !moving.contains(&joint) {
                let angle = at.map_or(0.0_f64.max(range.0).min(range.1), |at| at[joint]);
                *range = (angle, angle);
            }
        }
    }

    /// Is a posture allowed?
    pub fn allows(&self, setup: &Setup, joints: &[f64]) -> bool {
        let inside = |&(joint, lower, upper): &(usize, f64, f64)| {
            joints[joint] >= lower && joints[joint] <= upper
        };
        let mut ranges = self.ranges.iter().zip(joints);
        ranges.all(|((lower, upper), q)| q >= lower && q <= upper)
            && !self
                .forbidden
                .iter()
                .any(|region| region.iter().all(inside))
            && heights(setup, joints).all(|height| height >= self.least_height)
    }

    /// A random posture, each joint drawn evenly from its range; none if no draw of [`TRIES`] is allowed.
    pub fn random_posture(&self, setup: &Setup, random: &mut impl Rng) -> Option<Vec<f64>> {
        (0..TRIES)
            .map(|_| {
                let ranges = self.ranges.iter();
                ranges
                    .map(|&(lower, upper)| lower + (upper - lower) * random.random::<f64>())
                    .collect::<Vec<f64>>()
            })
            .find(|joints| self.allows(setup, joints))
    }
}

/// Heights of the target links above the base origin, against gravity, m.
pub fn heights(setup: &Setup, joints: &[f64]) -> impl Iterator<Item = f64> {
    let poses = setup.robot.body_poses(joints);
    // without gravity there is no up; the base's z axis serves
    let up = (-setup.gravity)
        .try_normalize(0.0)
        .unwrap_or_else(Vector3::z);
    setup.targets.iter().map(move |target| {
        let link = &setup.robot.links[target.link];
        let pose = poses[link.body] * link.body_from_link;
        pose.translation.vector.dot(&up)
    })
}

/// The random generator of one purpose: each has its own stream, so that none depends on how many another draws.
pub fn generator(seed: u64, stream: u128) -> Pcg64 {
    let mut bytes = [0u8; 32];
    bytes[..8].copy_from_slice(&seed.to_le_bytes());
    bytes[16..32].copy_from_slice(&stream.to_le_bytes());
    Pcg64::from_seed(bytes)
}
