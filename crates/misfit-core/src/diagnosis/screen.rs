//! Readings that do not belong: single ones far from the others of their pose and load.
//!
//! Two in a hundred of them at ten sigma would make 93 % false alarms. Readings of another load are no measure:
//! beside the unloaded ones of a pose, those under a payload of the wrong mass would all look like outliers.

use crate::campaign::Condition;
use std::collections::BTreeMap;

/// Rejected from this mean square of whitened rows on ...
const FAR: f64 = 12.0;
/// ... if it is as many times that of the middle reading of its group.
const ALONE: f64 = 6.0;

/// More than this share of the readings is no accident: then none is an outlier.
const FEW: f64 = 0.1;

/// Indices of outliers. `squares` is the mean square of each reading's whitened residual rows.
pub fn outliers(conditions: &[Condition], squares: &[f64]) -> Vec<usize> {
    let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, condition) in conditions.iter().enumerate() {
        let key = (condition.pose, condition.load);
        groups.entry(key).or_default().push(index);
    }
    let mut found = Vec::new();
    for group in groups.into_values() {
        // of two that disagree nothing says which is wrong
        if group.len() < 3 {
            continue;
        }
        let mut sorted: Vec<f64> = group.iter().map(|&i| squares[i]).collect();
        sorted.sort_by(f64::total_cmp);
        let middle = sorted[(sorted.len() - 1) / 2];
        let far = |&&i: &&usize| squares[i] > FAR && squares[i] > ALONE * middle;
        found.extend(group.iter().filter(far).copied());
    }
    if found.len() as f64 > FEW * conditions.len() as f64 {
        return Vec::new();
    }
    found.sort_unstable();
    found
}
