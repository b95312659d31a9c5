//! Leaving out poses a fold at a time: what the other folds predict of each, where the model is linear near a fit.
//!
//! Source: leave-group-out cross-validation in closed form, with the optimism of a linear smoother taken off both sides
//! (Efron 2004, *The Estimation of Prediction Error*, JASA 99:619).

use super::folds::{FOLDS, folds};
use super::normal::{Normal, SUMMED, add_square};
use super::solve::Linear;
use crate::campaign::Reading;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// A linear least-squares problem of some rows.
pub trait Part: Sized {
    /// The problem of all rows that some parts have together.
    fn joined<'a>(parts: impl Iterator<Item = &'a Self> + Clone) -> Self
    where
        Self: 'a;
}

impl Part for Linear {
    fn joined<'a>(parts: impl Iterator<Item = &'a Self> + Clone) -> Self {
        Linear::joined(parts)
    }
}

impl Part for Normal {
    fn joined<'a>(mut parts: impl Iterator<Item = &'a Self> + Clone) -> Self {
        let first = parts.next().map(|part| part.0.clone());
        let first = first.unwrap_or_else(|| DMatrix::zeros(1, 1));
        Normal(parts.fold(first, |sum, part| sum + &part.0))
    }
}

/// The problem of all folds but one.
pub fn without<P: Part>(folds: &[P], fold: usize) -> P {
    let others = folds.iter().enumerate().filter(|(own, _)| *own != fold);
    P::joined(others.map(|(_, part)| part))
}

/// Normal equations of each fold; `rows` are the numbers of rows of each reading, `blocks` all rows in the order of the
/// readings, `pick` takes the columns out of one.
pub fn by_folds(
    readings: &[&Reading],
    rows: impl Iterator<Item = usize>,
    blocks: &[DMatrix<f64>],
    pick: impl Fn(&DMatrix<f64>) -> DMatrix<f64> + Sync,
) -> Vec<Normal> {
    let folds = folds(readings).0.into_iter().zip(rows);
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
    let squares = |pieces: &[(&DMatrix<f64>, &[usize])]| -> Vec<Normal> {
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
        sums.into_iter().map(Normal).collect()
    };
    let parts: Vec<Vec<Normal>> = pieces.par_chunks(SUMMED).map(squares).collect();
    // in order, so that the sum does not depend on threads
    let of = |fold: usize| {
        let mut sum = Normal::joined(parts.iter().map(|part| &part[fold]));
        sum.0.fill_upper_triangle_with_lower_triangle();
        sum
    };
    (0..FOLDS).map(of).collect()
}

/// Sums of squares of the `tested` rows after the step that the `kept` rows ask for, one for each number of leading
/// columns in `counts`. `priors` are the strengths of a prior about no step, by columns of `J`.
pub fn left_out(kept: &Normal, tested: &Normal, priors: &[f64], counts: &[usize]) -> Vec<f64> {
    let error = |&count: &usize| {
        let right = -kept.gradient(count);
        // no step where rounding leaves no factor
        let factor = kept.factor(&priors[..count]);
        let step = factor.map_or_else(|| DVector::zeros(count), |factor| factor.solve(&right));
        tested.squares_after(&step)
    };
    counts.iter().map(error).collect()
}

/// Sums of squares by folds, each predicted without its own.
pub fn predicted(folds: &[Normal], priors: &[f64]) -> Vec<f64> {
    let of =
        |fold: usize| left_out(&without(folds, fold), &folds[fold], priors, &[priors.len()])[0];
    (0..folds.len()).map(of).collect()
}

/// Share of the whole fall of an error that a further step has to bring.
const MIN_SHARE_OF_FALL: f64 = 0.01;

/// Is the second list of errors, by folds, lower than the first by more than the standard error of their difference,
/// and by more than a hundredth of the whole fall from `begin` on?
///
/// Source: the one-standard-error rule of Breiman, Friedman, Olshen, Stone 1984, *Classification and Regression Trees*,
/// section 3.4.3, on paired differences.
pub fn is_lower(begin: &[f64], first: &[f64], second: &[f64]) -> bool {
    let falls: Vec<f64> = first.iter().zip(second).map(|(a, b)| a - b).collect();
    let count = falls.len() as f64;
    let sum: f64 = falls.iter().sum();
    let spread = falls.iter().map(|fall| (fall - sum / count).powi(2));
    let error = (spread.sum::<f64>() * count / (count - 1.0)).sqrt();
    let whole = begin.iter().sum::<f64>() - second.iter().sum::<f64>();
    sum > error && sum > MIN_SHARE_OF_FALL * whole
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
    /// Of all columns over the first `base`, each with the strength of a prior about no step.
    pub fn of(folds: &[Normal], base: usize, priors: &[f64], variance: f64) -> Option<Self> {
        let before = errors(folds, &priors[..base], variance)?;
        let after = errors(folds, priors, variance)?;
        Some(Self {
            fitted: before.fitted - after.fitted,
            left_out: before.left_out - after.left_out,
        })
    }

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

/// Sums of squares less what noise alone would make them.
fn errors(folds: &[Normal], priors: &[f64], variance: f64) -> Option<Gain> {
    let count = priors.len();
    let all = Normal::joined(folds.iter());
    let factor = all.factor(priors)?;
    let step = factor.solve(&-all.gradient(count));
    // a step fitted to its own noise takes 2 tr H - tr H² of it away
    let hat = factor.solve(&all.information(count));
    let optimism = 2.0 * hat.trace() - (&hat * &hat).trace();
    let fitted = all.squares_after(&step) / variance + optimism;
    let mut left_out = 0.0;
    for (fold, own) in folds.iter().enumerate() {
        let kept = without(folds, fold);
        let factor = kept.factor(priors)?;
        let step = factor.solve(&-kept.gradient(count));
        left_out += own.squares_after(&step) / variance;
        // and one fitted to the noise of others brings it in
        let across = factor.solve(&own.information(count));
        let through = factor.solve(&kept.information(count));
        left_out -= (across * through).trace();
    }
    Some(Gain { fitted, left_out })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // a test fails there
mod tests {
    use super::*;
    use crate::space::generator;
    use rand::Rng;
    use rand::RngExt;

    /// Sum of twelve uniform numbers less six: variance 1.
    fn noise(random: &mut impl Rng) -> f64 {
        (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0
    }

    /// Rows `[J | r]` of a fold with noise alone as residual.
    fn rows(count: usize, columns: usize, random: &mut impl Rng) -> DMatrix<f64> {
        DMatrix::from_fn(count, columns + 1, |_, _| noise(random))
    }

    fn normals(folds: &[DMatrix<f64>]) -> Vec<Normal> {
        folds
            .iter()
            .map(|rows| Normal(rows.transpose() * rows))
            .collect()
    }

    #[test]
    fn a_fold_is_predicted_as_by_a_fit_of_the_others() {
        let mut random = generator(1, 1);
        let folds: Vec<DMatrix<f64>> = (0..4).map(|_| rows(9, 3, &mut random)).collect();
        let priors = [0.5, 1.0, 2.0];
        let found = predicted(&normals(&folds), &priors);
        for (fold, found) in found.into_iter().enumerate() {
            // least squares by singular values, the prior as rows of its own
            let mut kept: Vec<Vec<f64>> = Vec::new();
            for (_, rows) in folds.iter().enumerate().filter(|(own, _)| *own != fold) {
                kept.extend(rows.row_iter().map(|row| row.iter().copied().collect()));
            }
            for (k, prior) in priors.iter().enumerate() {
                let mut row = vec![0.0; 4];
                row[k] = *prior;
                kept.push(row);
            }
            let kept = DMatrix::from_fn(kept.len(), 4, |row, column| kept[row][column]);
            let right = -kept.column(3).into_owned();
            let svd = kept.columns(0, 3).into_owned().svd(true, true);
            let step = svd.solve(&right, 1e-12).unwrap();
            let tested = folds[fold].columns(0, 3) * step + folds[fold].column(3);
            assert!(
                (found - tested.norm_squared()).abs() < 1e-9,
                "fold {fold}: {found}"
            );
        }
    }

    #[test]
    fn columns_of_no_worth_gain_nothing_on_average() {
        const DRAWS: usize = 600;
        let mut random = generator(1, 2);
        let mut gains = Vec::new();
        for _ in 0..DRAWS {
            let folds: Vec<DMatrix<f64>> = (0..5).map(|_| rows(8, 5, &mut random)).collect();
            gains.push(Gain::of(&normals(&folds), 2, &[1e-3; 5], 1.0).unwrap());
        }
        for (what, of) in [
            ("fitted", (|gain| gain.fitted) as fn(&Gain) -> f64),
            ("left out", |gain| gain.left_out),
        ] {
            let values: Vec<f64> = gains.iter().map(of).collect();
            let mean = values.iter().sum::<f64>() / DRAWS as f64;
            let squares = values
                .iter()
                .map(|value| (value - mean).powi(2))
                .sum::<f64>();
            let error = (squares / DRAWS as f64 / DRAWS as f64).sqrt();
            // without the optimism three columns gain 3 on the rows fitted and lose about 3.5 on those left out
            assert!(error < 0.25, "{what}: {error}");
            assert!(mean.abs() < 3.0 * error, "{what}: {mean} ± {error}");
        }
    }

    #[test]
    fn a_real_effect_gains_its_signal_on_both() {
        let mut random = generator(1, 3);
        let mut folds: Vec<DMatrix<f64>> = (0..5).map(|_| rows(40, 3, &mut random)).collect();
        for rows in &mut folds {
            let pushed = rows.column(2) * 2.0;
            let mut residual = rows.column_mut(3);
            residual += pushed;
        }
        let gain = Gain::of(&normals(&folds), 2, &[1e-3; 3], 1.0).unwrap();
        // 200 rows of variance 1, twice the size: 800, with a spread of 2 √800 from noise and 80 from the rows
        for value in [gain.fitted, gain.left_out] {
            assert!((value - 800.0).abs() < 300.0, "{gain:?}");
        }
        assert!((0.9..1.1).contains(&gain.share()), "{gain:?}");
        assert!(!gain.is_below(0.5) && gain.is_below(1.5), "{gain:?}");
    }

    #[test]
    fn an_error_is_lower_by_more_than_its_standard_error() {
        let begin = [100.0; 4];
        let cases: [([f64; 4], [f64; 4], bool); 6] = [
            // every fold falls alike: no spread
            ([10.0; 4], [9.0; 4], true),
            ([9.0; 4], [10.0; 4], false),
            ([10.0; 4], [10.0; 4], false),
            // sum 4; standard error of the sum √(4/3 · 4 · 0.81) = 2.08
            ([10.0; 4], [8.1, 9.9, 8.1, 9.9], true),
            // sum 4; standard error √(4/3 · 4 · 4) = 4.62
            ([10.0; 4], [7.0, 11.0, 7.0, 11.0], false),
            // sure, but less than a hundredth of the fall of 364 from the beginning
            ([10.0; 4], [9.1; 4], false),
        ];
        for (first, second, lower) in cases {
            assert_eq!(
                is_lower(&begin, &first, &second),
                lower,
                "{first:?} {second:?}"
            );
        }
        // a hundredth of the fall is enough, less is not
        assert!(is_lower(&begin, &[10.0; 4], &[9.05; 4]));
    }
}
