//! Does an effect predict poses that it was not fitted to?
//!
//! Near a fit the model is linear: a fold of poses is left out of the normal equations, and predicted from the rest. What
//! is really there is worth as much on poses left out as on those fitted; what only imitates it is worth less.
//!
//! Source: leave-group-out cross-validation in closed form, with the optimism of a linear smoother taken off both sides
//! (Efron 2004, *The Estimation of Prediction Error*, JASA 99:619).

use crate::campaign::Reading;
use crate::fit::pose_key;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// Poses are left out a fifth at a time.
const FOLDS: usize = 5;

/// Normal equations `[J | r]ᵀ [J | r]` of all readings and of each fold.
pub struct Folds {
    total: DMatrix<f64>,
    parts: Vec<DMatrix<f64>>,
}

/// Gains of a model over another in ‖r‖², noise's share taken off, σ².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gain {
    /// On the readings fitted.
    pub fitted: f64,
    /// On poses left out.
    pub left_out: f64,
}

impl Gain {
    /// Worth of the gain on poses left out, as a share of that on poses fitted.
    pub fn share(&self) -> f64 {
        self.left_out / self.fitted.max(1e-12)
    }

    /// Is the worth on poses left out below this share, two standard deviations sure?
    pub fn is_below(&self, share: f64) -> bool {
        let spread = 2.0 * self.fitted.max(0.0).sqrt();
        self.left_out + 2.0 * spread < share * self.fitted
    }
}

impl Folds {
    /// From blocks of `[J | r]` in the order of the readings; `rows` are the rows of each reading.
    pub fn new(readings: &[&Reading], rows: &[usize], blocks: &[DMatrix<f64>]) -> Self {
        let mut fold_of = BTreeMap::new();
        let fold: Vec<usize> = readings
            .iter()
            .zip(rows)
            .flat_map(|(reading, &rows)| {
                let next = fold_of.len();
                let fold = *fold_of.entry(pose_key(reading)).or_insert(next) % FOLDS;
                std::iter::repeat_n(fold, rows)
            })
            .collect();
        let n = blocks.first().map_or(1, DMatrix::ncols);
        let mut parts = vec![DMatrix::zeros(n, n); FOLDS];
        let mut first = 0;
        for block in blocks {
            for (part, sum) in parts.iter_mut().enumerate() {
                let own = (0..block.nrows()).filter(|row| fold[first + row] == part);
                let own = block.select_rows(&own.collect::<Vec<_>>());
                sum.gemm_tr(1.0, &own, &own, 1.0);
            }
            first += block.nrows();
        }
        let total = parts
            .iter()
            .fold(DMatrix::zeros(n, n), |sum, part| sum + part);
        Self { total, parts }
    }

    /// Gain of the columns `with` over the columns `without`, each with the strength of a prior about no step.
    pub fn gain(
        &self,
        without: &[(usize, f64)],
        with: &[(usize, f64)],
        variance: f64,
    ) -> Option<Gain> {
        let (before, after) = (
            self.errors(without, variance)?,
            self.errors(with, variance)?,
        );
        Some(Gain {
            fitted: before.fitted - after.fitted,
            left_out: before.left_out - after.left_out,
        })
    }

    /// Sums of squares less what noise alone would make them.
    fn errors(&self, columns: &[(usize, f64)], variance: f64) -> Option<Gain> {
        let r = self.total.ncols() - 1;
        let picked: Vec<usize> = columns.iter().map(|(k, _)| *k).collect();
        let pick = |of: &DMatrix<f64>| {
            let matrix = of.select_columns(&picked).select_rows(&picked);
            let right: DVector<f64> = of.column(r).select_rows(&picked);
            (matrix, right, of[(r, r)])
        };
        let (total, right, square) = pick(&self.total);
        let solve = |normal: &DMatrix<f64>| {
            let mut normal = normal.clone();
            for (k, (_, prior)) in columns.iter().enumerate() {
                normal[(k, k)] += prior * prior;
            }
            normal.cholesky()
        };
        let error =
            |normal: &DMatrix<f64>, right: &DVector<f64>, square: f64, step: &DVector<f64>| {
                square - 2.0 * step.dot(right) + step.dot(&(normal * step))
            };
        let all = solve(&total)?;
        let step = all.solve(&right);
        // a step fitted to its own noise takes 2 tr H - tr H² of it away
        let hat = all.solve(&total);
        let taken = 2.0 * hat.trace() - (&hat * &hat).trace();
        let fitted = error(&total, &right, square, &step) / variance + taken;
        let mut left_out = 0.0;
        for part in &self.parts {
            let (own, own_right, own_square) = pick(part);
            let (kept, kept_right) = (&total - &own, &right - &own_right);
            let factor = solve(&kept)?;
            let step = factor.solve(&kept_right);
            left_out += error(&own, &own_right, own_square, &step) / variance;
            // and one fitted to the noise of others brings it in
            let across = factor.solve(&own);
            let through = factor.solve(&kept);
            left_out -= (across * through).trace();
        }
        Some(Gain { fitted, left_out })
    }
}
