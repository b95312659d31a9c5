//! Drawing the poses that are held out.

use super::{Reading, Split};
use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng, SeedableRng};
use std::collections::BTreeMap;

/// What makes two readings one pose: the label, or else the very same joints.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
enum Pose {
    Label(String),
    Joints(Vec<u64>),
}

/// Holds out a share of the poses, whole, the same ones for the same seed.
///
/// At least one pose is left to fit.
pub(super) fn draw(readings: &mut [Reading], fraction: f64, seed: u64) {
    let mut numbers = BTreeMap::new();
    let of_reading: Vec<usize> = readings
        .iter()
        .map(|reading| {
            let pose = match &reading.pose {
                Some(label) => Pose::Label(label.clone()),
                // + 0.0 makes one zero of the two.
                None => Pose::Joints(reading.joints.iter().map(|q| (q + 0.0).to_bits()).collect()),
            };
            let next = numbers.len();
            *numbers.entry(pose).or_insert(next)
        })
        .collect();
    let poses = numbers.len();
    let count = ((fraction * poses as f64).round() as usize).min(poses.saturating_sub(1));
    // One random key for each pose in the order of the table; the smallest keys are held out.
    // Unlike a library's shuffle this cannot change under a user's feet.
    let mut generator = Pcg64::seed_from_u64(seed);
    let mut keys: Vec<(u64, usize)> = (0..poses).map(|i| (generator.next_u64(), i)).collect();
    keys.sort_unstable();
    let mut heldout = vec![false; poses];
    for (_, pose) in keys.iter().take(count) {
        heldout[*pose] = true;
    }
    for (reading, pose) in readings.iter_mut().zip(of_reading) {
        reading.split = match heldout[pose] {
            true => Split::Heldout,
            false => Split::Fit,
        };
    }
}
