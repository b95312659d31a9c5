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

use nalgebra::{DMatrix, DVector};
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
}

impl Gram {
    /// From blocks of rows; the first `base` columns are the base model's, the last is the residual.
    pub fn new(blocks: &[DMatrix<f64>], base: usize) -> Self {
        use rayon::prelude::*;
        let n = blocks.first().map_or(base + 1, DMatrix::ncols);
        let parts: Vec<DMatrix<f64>> = blocks.par_iter().map(|block| block.tr_mul(block)).collect();
        let mut matrix = DMatrix::zeros(n, n);
        // in order, so that the sum does not depend on threads
        for part in parts {
            matrix += part;
        }
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

    /// Scores the family in these columns against noise of `variance` (1 if the whitening is right).
    pub fn score(&self, columns: Range<usize>, variance: f64) -> Score {
        let r = self.matrix.ncols() - 1;
        let raw = columns.clone().map(|k| self.matrix[(k, k)]).sum::<f64>();
        let information = self.partial(columns.clone(), columns.clone());
        let gradient: DVector<f64> = self.partial(columns, r..r + 1).column(0).into_owned();
        Score::of(information, gradient, raw, variance)
    }
}

impl Score {
    /// From the information and the gradient of columns of typical size, the base model partialled out of both;
    /// `raw` is the trace of the information before that.
    pub fn of(information: DMatrix<f64>, gradient: DVector<f64>, raw: f64, variance: f64) -> Self {
        let expected = information.trace() / variance;
        let eigen = information.symmetric_eigen();
        let mut directions = Vec::new();
        for (value, vector) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            let s2 = value.max(0.0) / variance;
            if s2.sqrt() > FAINT {
                // z = vᵀ g / s, both in σ
                directions.push((s2, vector.dot(&gradient).powi(2) / value / variance));
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
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let mean = logs.iter().map(|l| (l - largest).exp()).sum::<f64>() / logs.len() as f64;
        Self {
            chi2: directions.iter().map(|d| d.1).sum(),
            dof: directions.len(),
            raw: raw / variance,
            expected,
            log_evidence: largest + mean.ln(),
        }
    }
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
