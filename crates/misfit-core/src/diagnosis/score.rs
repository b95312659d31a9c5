//! Which family of parameters would lower the misfit, without fitting any: score tests with the base model
//! partialled out, and the evidence of each family with its physical size as prior.
//!
//! Everything follows from the Gram matrix of the whitened Jacobian. With `A` the base model's columns, `X` a
//! family's (typical sizes), `r` the residual and `M` the projector that removes `A`:
//! `S = Xᵀ M X = V diag(s²) Vᵀ`, `z = diag(1/s) Vᵀ Xᵀ M r`. The family's score (Lagrange multiplier) is
//! `‖z‖² ~ χ²_k`, and `λ = ‖M X θ‖²` is the signal that the base model cannot absorb.
//!
//! Source: the linear-Gaussian evidence with unknown scale; compared on 880 simulated cases it ranks the right
//! family first more often than score, AIC, BIC or cross-validation.

use crate::fit::normal::Normal;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};
use std::ops::Range;

/// Scales of an effect beside its typical size that the evidence averages over.
const SCALES: [f64; 7] = [0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2];
/// Directions of a family with less signal than this (σ for a typical size) are not counted.
const FAINT: f64 = 0.05;

/// Inner products of all whitened columns `[base | families | residual]`.
pub struct Gram {
    matrix: DMatrix<f64>,
    /// `(AᵀA)⁺` over the directions that count.
    inverse: DMatrix<f64>,
    base: usize,
    /// Rank of the base model.
    pub rank: usize,
    /// Rows in all.
    pub rows: usize,
}

/// A family's score.
#[derive(Debug, Clone, PartialEq)]
pub struct Score {
    /// ‖z‖² over the noise variance.
    pub chi2: f64,
    /// Directions counted.
    pub dof: usize,
    /// The same before the base model takes its share.
    pub raw: f64,
    /// Expected λ of typical sizes: the sensitivity of the campaign to this family.
    pub expected: f64,
    /// Log evidence against the base model, nats.
    pub log_evidence: f64,
    /// The size beside the typical one at which it is largest.
    pub scale: f64,
}

impl Gram {
    /// From blocks of rows; the first `base` columns are the base model's, the last is the residual.
    pub fn new(blocks: &[DMatrix<f64>], base: usize) -> Self {
        let n = blocks.first().map_or(base + 1, DMatrix::ncols);
        let Normal(matrix) = Normal::of(blocks, n);
        let eigen = matrix
            .view((0, 0), (base, base))
            .into_owned()
            .symmetric_eigen();
        let mut inverse = DMatrix::zeros(base, base);
        let mut rank = 0;
        for (value, vector) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            if value.max(0.0).sqrt() >= crate::fit::solve::WEAK {
                inverse += vector * vector.transpose() / *value;
                rank += 1;
            }
        }
        Self {
            matrix,
            inverse,
            base,
            rank,
            rows: blocks.iter().map(DMatrix::nrows).sum(),
        }
    }

    /// Takes in columns that now stand before the residual, `count` of them.
    pub fn insert(&mut self, blocks: &[DMatrix<f64>], count: usize) {
        use rayon::prelude::*;
        let first = self.matrix.ncols() - 1;
        let across = |block: &DMatrix<f64>| block.transpose() * block.columns(first, count);
        let parts: Vec<DMatrix<f64>> = blocks.par_iter().map(across).collect();
        let n = first + count + 1;
        let mut own = DMatrix::zeros(n, count);
        for part in parts {
            own += part;
        }
        let mut matrix = std::mem::take(&mut self.matrix);
        matrix = matrix.insert_columns(first, count, 0.0);
        matrix = matrix.insert_rows(first, count, 0.0);
        matrix.columns_mut(first, count).copy_from(&own);
        matrix.rows_mut(first, count).copy_from(&own.transpose());
        self.matrix = matrix;
    }

    /// `(AᵀA)⁺`.
    pub fn base_inverse(&self) -> &DMatrix<f64> {
        &self.inverse
    }

    /// `Xᵀ M Y` for two ranges of columns.
    fn partial(&self, x: Range<usize>, y: Range<usize>) -> DMatrix<f64> {
        let of = |rows: Range<usize>, columns: Range<usize>| {
            self.matrix
                .view((rows.start, columns.start), (rows.len(), columns.len()))
                .into_owned()
        };
        let direct = of(x.clone(), y.clone());
        if self.base == 0 {
            return direct;
        }
        let left = of(0..self.base, x);
        let right = of(0..self.base, y);
        direct - left.transpose() * &self.inverse * right
    }

    /// ‖M r‖².
    pub fn misfit(&self) -> f64 {
        let r = self.matrix.ncols() - 1;
        self.partial(r..r + 1, r..r + 1)[(0, 0)]
    }

    /// Information `Xᵀ M X` and gradient `Xᵀ M r` of all columns behind the base model's, in units of noise of
    /// `variance`, with the trace of each column before the base model took its share.
    pub fn families(&self, variance: f64) -> Information {
        let r = self.matrix.ncols() - 1;
        let all = self.base..r;
        Information {
            raw: all
                .clone()
                .map(|k| self.matrix[(k, k)] / variance)
                .collect(),
            gradient: self.partial(all.clone(), r..r + 1).column(0) / variance,
            matrix: self.partial(all.clone(), all) / variance,
        }
    }
}

/// What is known of columns that a model lacks, in units of the noise: `Xᵀ M X` and `Xᵀ M r` for typical sizes.
#[derive(Debug, Clone)]
pub struct Information {
    /// `Xᵀ M X`.
    pub matrix: DMatrix<f64>,
    /// `Xᵀ M r`.
    pub gradient: DVector<f64>,
    /// Diagonal of `Xᵀ X`.
    pub raw: Vec<f64>,
}

impl Information {
    /// Scores the family of these columns.
    pub fn score(&self, columns: &Range<usize>) -> Score {
        let n = columns.len();
        let information = self.matrix.view((columns.start, columns.start), (n, n));
        let gradient = self.gradient.rows(columns.start, n);
        let raw = self.raw[columns.clone()].iter().sum();
        Score::of(information.into_owned(), &gradient.into_owned(), raw)
    }

    /// `Xᵀ M X` of these columns with their prior, factored; none where rounding leaves no factor.
    pub fn factor(&self, columns: &Range<usize>, scale: f64) -> Option<Cholesky<f64, Dyn>> {
        let n = columns.len();
        let mut own = self
            .matrix
            .view((columns.start, columns.start), (n, n))
            .into_owned();
        for k in 0..n {
            own[(k, k)] += (scale * scale).recip();
        }
        own.cholesky()
    }

    /// Trace of the information of some columns, less what others take of it; `factor` is theirs.
    pub fn beside(
        &self,
        columns: &Range<usize>,
        others: &Range<usize>,
        factor: Option<&Cholesky<f64, Dyn>>,
    ) -> f64 {
        let own: f64 = columns.clone().map(|k| self.matrix[(k, k)]).sum();
        let Some(factor) = factor else { return own };
        let at = (others.start, columns.start);
        let across = self.matrix.view(at, (others.len(), columns.len()));
        own - across.dot(&factor.solve(&across))
    }

    /// What is known of all others once these columns are in the model, at the size that the readings give them.
    pub fn given(&self, columns: &Range<usize>, scale: f64) -> Self {
        let n = columns.len();
        let Some(factor) = self.factor(columns, scale) else {
            return self.clone();
        };
        let across = self.matrix.rows(columns.start, n).into_owned();
        let gradient = self.gradient.rows(columns.start, n).into_owned();
        let back = across.transpose();
        Self {
            matrix: &self.matrix - &back * factor.solve(&across),
            gradient: &self.gradient - back * factor.solve(&gradient),
            raw: self.raw.clone(),
        }
    }
}

impl Score {
    /// Of columns of typical size with this information and gradient, both in units of the noise and with the base
    /// model partialled out; `raw` is the trace of the information before that.
    pub fn of(information: DMatrix<f64>, gradient: &DVector<f64>, raw: f64) -> Self {
        let expected = information.trace();
        let eigen = information.symmetric_eigen();
        let mut directions = Vec::new();
        for (value, vector) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            let s2 = value.max(0.0);
            if s2.sqrt() > FAINT {
                // z = vᵀ g / s, in σ
                directions.push((s2, vector.dot(gradient).powi(2) / s2));
            }
        }
        let log_of = |scale: f64| -> f64 {
            let terms = directions.iter().map(|&(s2, z2)| {
                let gain = scale * scale * s2;
                0.5 * (gain / (1.0 + gain) * z2 - (1.0 + gain).ln())
            });
            terms.sum()
        };
        let logs = SCALES.map(log_of);
        let mut scale = SCALES[0];
        let mut largest = logs[0];
        for (log, at) in logs.into_iter().zip(SCALES) {
            if log > largest {
                (largest, scale) = (log, at);
            }
        }
        Self {
            chi2: directions.iter().map(|d| d.1).sum(),
            dof: directions.len(),
            raw,
            expected,
            log_evidence: log_mean(&logs),
            scale,
        }
    }
}

/// Logarithm of the mean of exponentials.
pub fn log_mean(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return largest;
    }
    let sum = logs.iter().map(|log| (log - largest).exp()).sum::<f64>();
    largest + (sum / logs.len() as f64).ln()
}

/// Noise variance to test against.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Against {
    /// Variance of a whitened row.
    pub variance: f64,
    /// Degrees of freedom of that estimate; none if it is known.
    pub dof: Option<f64>,
}

impl Against {
    /// Probability of a sum of squares over `dof` directions at least this large (already over the variance)
    /// if there is noise alone.
    pub fn p_value(&self, chi2: f64, dof: f64) -> f64 {
        if dof <= 0.0 || !chi2.is_finite() {
            return 1.0;
        }
        match self.dof {
            Some(own) => FisherSnedecor::new(dof, own).map_or(1.0, |f| f.sf(chi2 / dof)),
            None => ChiSquared::new(dof).map_or(1.0, |c| c.sf(chi2)),
        }
    }
}
