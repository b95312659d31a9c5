//! Normal equations: the inner products of all columns of whitened rows `[J | r]`.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use rayon::prelude::*;

/// Blocks of rows whose products are summed at once; fixed, so that sums do not depend on threads.
pub const SUMMED: usize = 8;

/// `[J | r]ᵀ [J | r]` of some rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Normal(pub DMatrix<f64>);

impl Normal {
    /// Of blocks of rows with `columns` columns.
    pub fn of(blocks: &[DMatrix<f64>], columns: usize) -> Self {
        let sum = |blocks: &[DMatrix<f64>]| {
            let mut sum = DMatrix::zeros(columns, columns);
            blocks.iter().for_each(|block| add_square(&mut sum, block));
            sum
        };
        let parts: Vec<DMatrix<f64>> = blocks.par_chunks(SUMMED).map(sum).collect();
        let mut matrix = DMatrix::zeros(columns, columns);
        // in order, so that the sum does not depend on threads
        for part in parts {
            matrix += part;
        }
        matrix.fill_upper_triangle_with_lower_triangle();
        Self(matrix)
    }

    /// `JᵀJ` of the leading columns.
    pub fn information(&self, count: usize) -> DMatrix<f64> {
        self.0.view((0, 0), (count, count)).into_owned()
    }

    /// `Jᵀr` of the leading columns.
    pub fn gradient(&self, count: usize) -> DVector<f64> {
        let residual = self.0.ncols() - 1;
        let gradient = self.0.view((0, residual), (count, 1));
        gradient.column(0).into_owned()
    }

    /// `‖r‖²`.
    pub fn squares(&self) -> f64 {
        let residual = self.0.ncols() - 1;
        self.0[(residual, residual)]
    }

    /// `JᵀJ` of as many leading columns as there are priors, with their squares on its diagonal, factored; none where
    /// rounding leaves no factor. A prior is the strength about no step.
    pub fn factor(&self, priors: &[f64]) -> Option<Cholesky<f64, Dyn>> {
        let mut information = self.information(priors.len());
        for (k, prior) in priors.iter().enumerate() {
            information[(k, k)] += prior * prior;
        }
        information.cholesky()
    }

    /// `‖r + J s‖²` after a step of the leading columns.
    pub fn squares_after(&self, step: &DVector<f64>) -> f64 {
        let count = step.len();
        let own = self.information(count) * step;
        let across = self.gradient(count).dot(step);
        self.squares() + 2.0 * across + own.dot(step)
    }
}

/// Adds the lower triangle of `XᵀX`, and nothing of worth above it.
pub fn add_square(sum: &mut DMatrix<f64>, columns: &DMatrix<f64>) {
    /// Columns per panel: what is below it alone is computed.
    const PANEL: usize = 64;
    let n = columns.ncols();
    // turned, a product by blocks: several times as fast as one by dot products
    let turned = columns.transpose();
    for first in (0..n).step_by(PANEL) {
        let width = PANEL.min(n - first);
        let below = turned.rows(first, n - first);
        let mut place = sum.view_mut((first, first), (n - first, width));
        place.gemm(1.0, &below, &columns.columns(first, width), 1.0);
    }
}
