//! Which poses are left out together.

use super::alike;
use crate::campaign::{Reading, pose_key};

/// Folds of the cross-validation by pose.
pub const FOLDS: usize = 5;

/// Pose of each reading, numbered in order of appearance.
pub(super) fn poses(readings: &[&Reading]) -> Vec<usize> {
    alike::numbered(readings.iter().map(|reading| pose_key(reading)))
}

/// Fold of each reading, 0 to [`FOLDS`] - 1, poses in order of appearance going round; and the number of poses.
pub fn folds(readings: &[&Reading]) -> (Vec<usize>, usize) {
    let poses = poses(readings);
    let count = poses.iter().max().map_or(0, |last| last + 1);
    (poses.into_iter().map(|pose| pose % FOLDS).collect(), count)
}
