//! What a design is good for, as a number: functions of its information matrix `G = JᵀJ`, `J` the whitened Jacobian with
//! columns in typical sizes.
//!
//! The weak prior of the fit (`WEAK` a typical size) counts as information, `H = G + WEAK² 1`: directions that no
//! reading fixes then add the same to every design, and nothing is ever singular. All these functions are concave in
//! `G` and grow with it, so that the gradient bounds what more readings can bring:
//! `f(G + g) ≤ f(G) + ⟨g, f'(G)⟩`.
//!
//! Sources: Atkinson, Donev, Tobias 2007, *Optimum Experimental Designs* (D, D_s, A, T); Klimchik et al. 2012,
//! arXiv:1211.5739 (test poses); Atkinson, Fedorov 1975, Biometrika 62 (T).

use crate::fit::solve::WEAK;
use nalgebra::{Cholesky, DMatrix, Dyn};
use std::ops::Range;

/// A concave function of the information matrix, to be made large.
pub trait Criterion: Sync {
    /// Its value; minus infinity where there is none.
    fn value(&self, information: &DMatrix<f64>) -> f64;
    /// Its derivative by each entry of the matrix; none where there is none.
    fn gradient(&self, information: &DMatrix<f64>) -> Option<DMatrix<f64>>;
}

/// `H = G + WEAK² 1`, factored.
fn with_prior(information: &DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let mut matrix = information.clone();
    for k in 0..matrix.nrows() {
        matrix[(k, k)] += WEAK * WEAK;
    }
    matrix.cholesky()
}

/// Covariance of the parameters in typical sizes, the prior included.
pub fn covariance(information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    Some(with_prior(information)?.inverse())
}

/// Sum of the logarithms of the pivots, twice: the logarithm of the determinant.
fn log_determinant(factor: &Cholesky<f64, Dyn>) -> f64 {
    let pivots = factor.l_dirty().diagonal();
    2.0 * pivots.iter().map(|pivot| pivot.ln()).sum::<f64>()
}

/// Rows and columns of some parameters.
fn part(matrix: &DMatrix<f64>, rows: &[usize], columns: &[usize]) -> DMatrix<f64> {
    DMatrix::from_fn(rows.len(), columns.len(), |i, j| {
        matrix[(rows[i], columns[j])]
    })
}

/// D-optimality: minus the log determinant of the covariance of the parameters of interest, all others free (D_s).
#[derive(Debug, Clone)]
pub struct Determinant {
    /// Parameters that are of no interest, by column.
    nuisance: Vec<usize>,
}

impl Determinant {
    /// Of `interest` among so many parameters.
    pub fn of(interest: &[usize], parameters: usize) -> Self {
        let nuisance = (0..parameters).filter(|k| !interest.contains(k)).collect();
        Self { nuisance }
    }
}

impl Criterion for Determinant {
    fn value(&self, information: &DMatrix<f64>) -> f64 {
        let Some(all) = with_prior(information) else {
            return f64::NEG_INFINITY;
        };
        if self.nuisance.is_empty() {
            return log_determinant(&all);
        }
        match with_prior(&part(information, &self.nuisance, &self.nuisance)) {
            Some(others) => log_determinant(&all) - log_determinant(&others),
            None => f64::NEG_INFINITY,
        }
    }

    fn gradient(&self, information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let mut gradient = covariance(information)?;
        if !self.nuisance.is_empty() {
            let others = covariance(&part(information, &self.nuisance, &self.nuisance))?;
            for (i, &row) in self.nuisance.iter().enumerate() {
                for (j, &column) in self.nuisance.iter().enumerate() {
                    gradient[(row, column)] -= others[(i, j)];
                }
            }
        }
        Some(gradient)
    }
}

/// A-optimality: minus a weighted sum of variances, `-tr(W C)`, `C` the covariance in typical sizes. With
/// `W = Σ JᵀJ` over test poses it is the mean square error that they will have.
#[derive(Debug, Clone)]
pub struct Variances {
    /// `W`, symmetric and without negative directions.
    pub weight: DMatrix<f64>,
}

impl Criterion for Variances {
    fn value(&self, information: &DMatrix<f64>) -> f64 {
        match with_prior(information) {
            Some(factor) => -factor.solve(&self.weight).trace(),
            None => f64::NEG_INFINITY,
        }
    }

    fn gradient(&self, information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let covariance = covariance(information)?;
        Some(&covariance * &self.weight * &covariance)
    }
}

/// T-optimality, both ways round: `ln(1 + λ₁) + ln(1 + λ₂)`, where `λ = tr(Θ S)` is the signal of one effect that the
/// base model and the other effect cannot take up: `S = X₁ᵀ M X₁`, `M` the projector that removes both.
///
/// The logarithms let neither way be bought with the other, and a way that is hopeless does not stand in the way.
#[derive(Debug, Clone)]
pub struct Apart {
    /// Columns of the base model: the first ones.
    pub base: usize,
    /// Columns of the two effects.
    pub effects: [Range<usize>; 2],
    /// `Θ = θθᵀ` for known sizes, the identity for typical ones; in typical sizes.
    pub sizes: [DMatrix<f64>; 2],
}

impl Apart {
    /// λ of each effect against base model and other effect, σ².
    pub fn lambdas(&self, information: &DMatrix<f64>) -> Option<[f64; 2]> {
        let left = self.without_base(information)?;
        let of = |own: usize| {
            let (mine, other) = (self.local(own), self.local(1 - own));
            let block = |a: &Range<usize>, b: &Range<usize>| {
                left.view((a.start, b.start), (a.len(), b.len()))
                    .into_owned()
            };
            let across = block(&other, &mine);
            let taken = with_prior(&block(&other, &other))?.solve(&across);
            let signal = block(&mine, &mine) - across.transpose() * taken;
            // rounding may leave a little less than nothing
            Some(signal.dot(&self.sizes[own]).max(0.0))
        };
        Some([of(0)?, of(1)?])
    }

    /// λ of each effect against the base model alone, σ².
    pub fn alone(&self, information: &DMatrix<f64>) -> Option<[f64; 2]> {
        let left = self.without_base(information)?;
        let of = |own: usize| {
            let mine = self.local(own);
            let signal = left.view((mine.start, mine.start), (mine.len(), mine.len()));
            signal.dot(&self.sizes[own]).max(0.0)
        };
        Some([of(0), of(1)])
    }

    /// `XᵀMX` of both effects' columns together, `M` removing the base model.
    fn without_base(&self, information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let (base, all) = (self.base, information.nrows());
        let own = information.view((base, base), (all - base, all - base));
        if base == 0 {
            return Some(own.into_owned());
        }
        let factor = with_prior(&information.view((0, 0), (base, base)).into_owned())?;
        let across = information.view((0, base), (base, all - base)).into_owned();
        let solved = factor.l_dirty().solve_lower_triangular(&across)?;
        Some(own - solved.transpose() * &solved)
    }

    /// An effect's columns behind the base model's.
    fn local(&self, effect: usize) -> Range<usize> {
        self.effects[effect].start - self.base..self.effects[effect].end - self.base
    }
}

impl Criterion for Apart {
    fn value(&self, information: &DMatrix<f64>) -> f64 {
        self.lambdas(information)
            .map_or(f64::NEG_INFINITY, |[a, b]| a.ln_1p() + b.ln_1p())
    }

    /// `λ = min tr(Θ (X - A B)ᵀ(X - A B))` over `B`, so its derivative is that of the minimum: `W Θ Wᵀ` with
    /// `W = [1; -B]`.
    fn gradient(&self, information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
        let n = information.nrows();
        let lambdas = self.lambdas(information)?;
        let mut gradient = DMatrix::zeros(n, n);
        for (own, lambda) in lambdas.into_iter().enumerate() {
            let mine: Vec<usize> = self.effects[own].clone().collect();
            let others: Vec<usize> = (0..self.base)
                .chain(self.effects[1 - own].clone())
                .collect();
            let factor = with_prior(&part(information, &others, &others))?;
            let taken = factor.solve(&part(information, &others, &mine));
            let mut left = DMatrix::zeros(n, mine.len());
            for (column, &k) in mine.iter().enumerate() {
                left[(k, column)] = 1.0;
                for (row, &other) in others.iter().enumerate() {
                    left[(other, column)] = -taken[(row, column)];
                }
            }
            gradient += &left * &self.sizes[own] * left.transpose() / (1.0 + lambda);
        }
        Some(gradient)
    }
}
