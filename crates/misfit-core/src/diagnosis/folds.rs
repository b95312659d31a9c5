//! Cross-validation without refitting: near a fit the model is linear, and a fold is left out of its rows.
//!
//! Poses are left out a fifth at a time, those of a pose together.

use super::score::{SUMMED, add_square};
use crate::campaign::Reading;
use crate::fit::{self, FOLDS};
use nalgebra::{Cholesky, DMatrix, DVector};
use rayon::prelude::*;

/// Products of the columns of `[J | r]` with each other over the rows of each fold; `rows` are those of each reading,
/// `blocks` all rows in the order of the readings, `pick` takes the columns out of one.
pub fn normals(
    readings: &[&Reading],
    rows: impl Iterator<Item = usize>,
    blocks: &[DMatrix<f64>],
    pick: impl Fn(&DMatrix<f64>) -> DMatrix<f64> + Sync,
) -> Vec<DMatrix<f64>> {
    let folds = fit::folds(readings).0.into_iter().zip(rows);
    let folds: Vec<usize> = folds
        .flat_map(|(fold, rows)| std::iter::repeat_n(fold, rows))
        .collect();
    let mut first = 0;
    let pieces: Vec<(&DMatrix<f64>, &[usize])> = blocks
        .iter()
        .map(|block| {
            let own = &folds[first..first + block.nrows()];
            first += block.nrows();
            (block, own)
        })
        .collect();
    let squares = |pieces: &[(&DMatrix<f64>, &[usize])]| -> Vec<DMatrix<f64>> {
        let mut sums: Vec<DMatrix<f64>> = Vec::new();
        for (block, folds) in pieces {
            let columns = pick(block);
            let n = columns.ncols();
            sums.resize_with(FOLDS, || DMatrix::zeros(n, n));
            for (fold, sum) in sums.iter_mut().enumerate() {
                let own: Vec<usize> = (0..folds.len()).filter(|&row| folds[row] == fold).collect();
                add_square(sum, &columns.select_rows(&own));
            }
        }
        sums
    };
    let parts: Vec<Vec<DMatrix<f64>>> = pieces.par_chunks(SUMMED).map(squares).collect();
    // in order, so that the sum does not depend on threads
    let of = |fold: usize| {
        let mut sum = sum(parts.iter().map(|part| &part[fold]));
        sum.fill_upper_triangle_with_lower_triangle();
        sum
    };
    (0..FOLDS).map(of).collect()
}

/// Sum of products over several folds.
pub fn sum<'a>(normals: impl IntoIterator<Item = &'a DMatrix<f64>>) -> DMatrix<f64> {
    let add = |sum: Option<DMatrix<f64>>, normal: &DMatrix<f64>| match sum {
        None => Some(normal.clone()),
        Some(sum) => Some(sum + normal),
    };
    let sum = normals.into_iter().fold(None, add);
    sum.unwrap_or_else(|| DMatrix::zeros(1, 1))
}

/// Sums of squares of the `tested` rows of `[J | r]`, with the step that the `kept` rows ask for, one for each number
/// of leading columns in `counts`; both given by the products of their columns. `priors` are the strengths of a prior
/// about no step, by columns of `J`.
pub fn left_out(
    kept: &DMatrix<f64>,
    tested: &DMatrix<f64>,
    priors: &[f64],
    counts: &[usize],
) -> Vec<f64> {
    let n = priors.len();
    let mut normal = kept.clone();
    for (k, prior) in priors.iter().enumerate() {
        normal[(k, k)] += prior * prior;
    }
    let error = |&count: &usize| {
        let part = normal.view((0, 0), (count, count)).into_owned();
        let right: DVector<f64> = -normal.view((0, n), (count, 1)).column(0);
        // no step where rounding leaves no factor
        let step = Cholesky::new(part).map_or_else(|| DVector::zeros(count), |c| c.solve(&right));
        let own = tested.view((0, 0), (count, count)) * &step;
        let across = tested.view((0, n), (count, 1)).column(0).dot(&step);
        tested[(n, n)] + 2.0 * across + own.dot(&step)
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

/// Sums of squares of `[J | r]` by folds, each predicted without its own, from the products of the columns over each.
pub fn cross_validated(normals: &[DMatrix<f64>], priors: &[f64]) -> Vec<f64> {
    let of = |fold: usize| {
        let others = (0..normals.len()).filter(|&other| other != fold);
        let kept = sum(others.map(|other| &normals[other]));
        left_out(&kept, &normals[fold], priors, &[priors.len()])
    };
    (0..normals.len()).flat_map(of).collect()
}
