//! Cross-validation without refitting: near a fit the model is linear, and a fold is left out of its rows.
//!
//! Poses are left out a fifth at a time, those of a pose together.

use crate::campaign::Reading;
use crate::fit::pose_key;
use nalgebra::{Cholesky, DMatrix, DVector};
use std::collections::BTreeMap;

/// Folds.
pub const FOLDS: usize = 5;

/// Fold of each reading: poses in order of appearance go round.
pub fn by_pose(readings: &[&Reading]) -> Vec<usize> {
    let mut fold_of: BTreeMap<_, usize> = BTreeMap::new();
    let of = |reading: &&Reading| {
        let next = fold_of.len();
        *fold_of.entry(pose_key(reading)).or_insert(next) % FOLDS
    };
    readings.iter().map(of).collect()
}

/// Sums of squares of the `tested` rows of `[J | r]`, with the step that the `kept` rows ask for, one for each number
/// of leading columns in `counts`. `priors` are the strengths of a prior about no step, by columns of `J`.
pub fn left_out(
    kept: &DMatrix<f64>,
    tested: &DMatrix<f64>,
    priors: &[f64],
    counts: &[usize],
) -> Vec<f64> {
    let n = priors.len();
    let mut normal = kept.transpose() * kept;
    for (k, prior) in priors.iter().enumerate() {
        normal[(k, k)] += prior * prior;
    }
    let error = |&count: &usize| {
        let part = normal.view((0, 0), (count, count)).into_owned();
        let right: DVector<f64> = -normal.view((0, n), (count, 1)).column(0);
        // no step where rounding leaves no factor
        let step = Cholesky::new(part).map_or_else(|| DVector::zeros(count), |c| c.solve(&right));
        (tested.column(n) + tested.columns(0, count) * step).norm_squared()
    };
    counts.iter().map(error).collect()
}

/// Share of the whole fall of an error that a further step has to bring.
const WORTH: f64 = 0.01;

/// Is the second list of errors, by folds, lower than the first by more than the standard error of their difference,
/// and by more than a hundredth of the whole fall from `begin` on?
///
/// Source: the one-standard-error rule of Breiman, Friedman, Olshen, Stone 1984, *Classification and Regression Trees*,
/// section 3.4.3, on paired differences.
pub fn lower(begin: &[f64], first: &[f64], second: &[f64]) -> bool {
    let falls: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    let count = falls.len() as f64;
    let sum: f64 = falls.iter().sum();
    let spread = falls.iter().map(|fall| (fall - sum / count).powi(2));
    let error = (spread.sum::<f64>() * count / (count - 1.0)).sqrt();
    let whole = begin.iter().sum::<f64>() - second.iter().sum::<f64>();
    sum > error && sum > WORTH * whole
}

/// Sums of squares of the rows of `[J | r]` by folds, each predicted without its own. `folds` by rows.
pub fn cross_validated(matrix: &DMatrix<f64>, folds: &[usize], priors: &[f64]) -> Vec<f64> {
    let of = |fold: usize, inside: bool| -> DMatrix<f64> {
        let rows: Vec<usize> = (0..folds.len())
            .filter(|&row| (folds[row] == fold) == inside)
            .collect();
        matrix.select_rows(&rows)
    };
    (0..FOLDS)
        .flat_map(|fold| left_out(&of(fold, false), &of(fold, true), priors, &[priors.len()]))
        .collect()
}
