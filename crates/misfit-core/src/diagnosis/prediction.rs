//! Does an effect predict poses that it was not fitted to?
//!
//! Near a fit the model is linear: a fold of poses is left out of the normal equations, and predicted from the rest. What
//! is really there is worth as much on poses left out as on those fitted; what only imitates it is worth less.
//!
//! Source: leave-group-out cross-validation in closed form, with the optimism of a linear smoother taken off both sides
//! (Efron 2004, *The Estimation of Prediction Error*, JASA 99:619).

use super::folds::sum;
use nalgebra::{DMatrix, DVector};

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

/// Gain of all columns over the first `base`, each with the strength of a prior about no step; `folds` are the products
/// of the columns of `[J | r]` with each other over each fold.
pub fn gain(folds: &[DMatrix<f64>], base: usize, priors: &[f64], variance: f64) -> Option<Gain> {
    let before = errors(folds, &priors[..base], variance)?;
    let after = errors(folds, priors, variance)?;
    Some(Gain {
        fitted: before.fitted - after.fitted,
        left_out: before.left_out - after.left_out,
    })
}

/// Sums of squares less what noise alone would make them.
fn errors(folds: &[DMatrix<f64>], priors: &[f64], variance: f64) -> Option<Gain> {
    let r = folds[0].ncols() - 1;
    let n = priors.len();
    let pick = |of: &DMatrix<f64>| {
        let right: DVector<f64> = of.view((0, r), (n, 1)).column(0).into_owned();
        (of.view((0, 0), (n, n)).into_owned(), right, of[(r, r)])
    };
    let solve = |normal: &DMatrix<f64>| {
        let mut normal = normal.clone();
        for (k, prior) in priors.iter().enumerate() {
            normal[(k, k)] += prior * prior;
        }
        normal.cholesky()
    };
    let error = |normal: &DMatrix<f64>, right: &DVector<f64>, square: f64, step: &DVector<f64>| {
        square - 2.0 * step.dot(right) + step.dot(&(normal * step))
    };
    let (total, right, square) = pick(&sum(folds));
    let all = solve(&total)?;
    let step = all.solve(&right);
    // a step fitted to its own noise takes 2 tr H - tr H² of it away
    let hat = all.solve(&total);
    let taken = 2.0 * hat.trace() - (&hat * &hat).trace();
    let fitted = error(&total, &right, square, &step) / variance + taken;
    let mut left_out = 0.0;
    for fold in folds {
        let (own, own_right, own_square) = pick(fold);
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
