//! Weighted nonlinear least squares: Gauss-Newton on the singular value decomposition of the scaled Jacobian,
//! damped (Levenberg 1944, Marquardt 1963) only when a full step does not lower the cost.
//!
//! minimise `‖r(p)‖²`, `lower ≤ p ≤ upper`
//!
//! Columns are scaled to each parameter's typical size, so that a singular value `s` says: along this
//! direction the readings fix the parameters to `1/s` typical sizes. Directions with `s` below [`WEAK`] carry no
//! information worth the name. A prior of that width about the start keeps them near it: without one the fit
//! creeps along curved valleys of equal cost and does not end. What the readings fix it leaves alone: it moves
//! an estimate by `(WEAK/s)²` of its distance from the start. How it ended is a value, not an error.

use super::triangle::triangle;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Weakest singular value that counts: beyond 3.3 typical sizes of uncertainty nothing is learnt.
pub const WEAK: f64 = 0.3;
/// Singular values below this share of the largest are rounding.
const ROUNDING: f64 = 1e-12;
/// Converged when the step after the present one would move by less than this many standard deviations, if steps go on
/// to shrink as the last two did: most shrink faster.
const SMALL_STEP: f64 = 1e-4;
/// Or lower the cost by less than this share of it.
const SMALL_GAIN: f64 = 1e-12;
/// Steps shrink when one is to lower the cost by less than this share of what the one before was to ...
const SHRINKING: f64 = 0.01;
/// ... and are believed to go on so when that is less than this share of the cost.
const NEAR: f64 = 1e-6;
const ITERATIONS: usize = 50;
/// As many again where the last steps lowered the cost of whitened rows by less than this: the end is near.
const NEARLY: f64 = 10.0;
/// A fit that creeps along a curved valley has converged when so many steps ...
const CREEPING: usize = 10;
/// ... together lower the cost of whitened rows by less than this: what is left to go moves no combination of parameters
/// by a tenth of its standard deviation.
const CREEP: f64 = 0.01;
/// Enough to reach the strongest directions there are, `s = 1e10`: each is ten times the one before.
const DAMPINGS: usize = 24;
/// First damping tried: it stops the weakest directions that count, where a full step goes too far first. A
/// share of the strongest would hold all others fast, and the fit would creep.
const LEAST_DAMPING: f64 = WEAK * WEAK;

/// A problem at one point, reduced: `‖r + J x‖² = ‖R x + z‖² + rest`, `x` in typical sizes.
#[derive(Debug, Clone)]
pub struct Linear {
    /// Upper triangular factor of the scaled Jacobian; parameters by columns.
    pub factor: DMatrix<f64>,
    /// Rotated residual.
    pub right: DVector<f64>,
    /// What no step can lower.
    pub rest: f64,
    /// The same of the folds that it is made of, if it was asked for.
    pub folds: Vec<Linear>,
}

impl Linear {
    /// ‖r‖².
    pub fn cost(&self) -> f64 {
        self.right.norm_squared() + self.rest
    }

    /// The same after a step, in typical sizes, if the problem is linear.
    pub fn cost_after(&self, step: &DVector<f64>) -> f64 {
        (&self.factor * step + &self.right).norm_squared() + self.rest
    }

    /// The problem of all rows that these problems of the same parameters have together, at one point.
    pub fn joined<'a>(parts: impl Iterator<Item = &'a Linear> + Clone) -> Linear {
        let block = |part: &Linear| {
            let (rows, columns) = part.factor.shape();
            let mut block = DMatrix::zeros(rows, columns + 1);
            block.columns_mut(0, columns).copy_from(&part.factor);
            block.column_mut(columns).copy_from(&part.right);
            block
        };
        let columns = parts.clone().next().map_or(0, |part| part.factor.ncols());
        let mut joined = reduce(parts.clone().map(block).collect(), columns);
        joined.rest += parts.map(|part| part.rest).sum::<f64>();
        joined
    }
}

/// What is minimised.
pub trait Problem: Sync {
    /// Residual and scaled Jacobian at `p`, reduced; not finite where there is no residual.
    fn linearise(&self, p: &[f64]) -> Linear;
    /// Typical sizes.
    fn scale(&self) -> &[f64];
    /// Least and greatest values.
    fn bounds(&self) -> &[(f64, f64)];
    /// Strength of the prior about the start, per typical size: [`WEAK`], or zero for none.
    fn prior(&self) -> f64;
}

/// Where the solver stopped.
#[derive(Debug, Clone)]
pub struct Solution {
    /// Parameters.
    pub p: Vec<f64>,
    /// Where the last step began.
    pub before: Vec<f64>,
    /// The problem there.
    pub linear: Linear,
    /// Parameters held by a bound.
    pub at_bound: Vec<bool>,
    /// Did it converge?
    pub converged: bool,
    /// Steps taken.
    pub iterations: usize,
}

/// Minimises from `start`, with the prior about `centre`: where it ends depends on that alone, how soon on both.
pub fn solve(
    problem: &dyn Problem,
    start: &[f64],
    centre: &[f64],
    mut on_step: impl FnMut(usize, f64),
) -> Solution {
    let within = |p: &[f64]| -> Vec<f64> {
        p.iter()
            .zip(problem.bounds())
            .map(|(&p, &(lower, upper))| p.clamp(lower, upper))
            .collect()
    };
    let (mut p, centre) = (within(start), within(centre));
    let mut linear = problem.linearise(&p);
    let mut damping = 0.0;
    // what the step before was to lower the cost by, if it was a full one
    let mut taken: Option<f64> = None;
    let mut costs = Vec::new();
    for iteration in 0..2 * ITERATIONS {
        let whole = with_prior(problem, &linear, &p, &centre);
        let cost = whole.cost();
        on_step(iteration, cost);
        if !cost.is_finite() {
            return stop(problem, (p.clone(), p), linear, false, iteration);
        }
        costs.push(cost);
        let whitened = problem.prior() > 0.0;
        if whitened && creeps(&costs, CREEP) {
            return stop(problem, (p.clone(), p), linear, true, iteration);
        }
        if iteration >= ITERATIONS && !(whitened && creeps(&costs, NEARLY)) {
            return stop(problem, (p.clone(), p), linear, false, iteration);
        }
        let gain_of = |step: &DVector<f64>| cost - whole.cost_after(step);
        let mut accepted = None;
        for _ in 0..DAMPINGS {
            let step = bounded_step(problem, &whole, &p, damping);
            let gain = gain_of(&step);
            let next = moved(problem, &p, &step);
            let after = match taken {
                Some(taken) if gain < SHRINKING * taken && gain < NEAR * cost => {
                    gain / taken * gain
                }
                _ => gain,
            };
            if damping == 0.0 && (after < SMALL_STEP.powi(2) || after < SMALL_GAIN * cost) {
                return stop(problem, (p, next), linear, true, iteration);
            }
            // most steps are taken, and the next one begins with this
            let there = problem.linearise(&next);
            let reached = there.cost() + distance(problem, &next, &centre);
            if reached < cost {
                taken = (damping == 0.0).then_some(gain);
                damping = if damping > 10.0 * LEAST_DAMPING && reached < cost - 0.25 * gain {
                    damping * 0.1
                } else {
                    0.0
                };
                accepted = Some((next, there));
                break;
            }
            if damping == 0.0 {
                accepted = corrected(problem, &next, &there, &centre, cost);
                if accepted.is_some() {
                    taken = Some(gain);
                    break;
                }
            }
            damping = (damping * 10.0).max(LEAST_DAMPING);
        }
        match accepted {
            Some(next) => (p, linear) = next,
            // no step lowers the cost: as low as rounding lets it be, or stuck
            None => {
                let gain = gain_of(&bounded_step(problem, &whole, &p, 0.0));
                let low = gain < 1e-6 * (1.0 + cost);
                return stop(problem, (p.clone(), p), linear, low, iteration);
            }
        }
    }
    stop(problem, (p.clone(), p), linear, false, 2 * ITERATIONS)
}

/// Did the last steps together lower the cost by less than this? `costs` are those of whitened rows, σ², by steps.
fn creeps(costs: &[f64], least: f64) -> bool {
    costs
        .len()
        .checked_sub(CREEPING + 1)
        .is_some_and(|first| first >= CREEPING && costs[first] - costs[costs.len() - 1] < least)
}

/// Where a full step leads from `p`, at which the problem is `linear`; and the step, in typical sizes.
pub fn full_step(
    problem: &dyn Problem,
    linear: &Linear,
    p: &[f64],
    centre: &[f64],
) -> (Vec<f64>, DVector<f64>) {
    let whole = with_prior(problem, linear, p, centre);
    let step = bounded_step(problem, &whole, p, 0.0);
    (moved(problem, p, &step), step)
}

/// One more full step from where one went up instead of down, if both together go down: along a curved valley the first
/// leaves its floor, and the second returns to it farther on. None where that is not so.
///
/// Source: the watchdog technique of Chamberlain, Powell, Lemaréchal, Pedersen 1982, *Mathematical Programming Study* 16, 1.
fn corrected(
    problem: &dyn Problem,
    p: &[f64],
    linear: &Linear,
    centre: &[f64],
    cost: f64,
) -> Option<(Vec<f64>, Linear)> {
    let whole = with_prior(problem, linear, p, centre);
    let step = bounded_step(problem, &whole, p, 0.0);
    let expected = whole.cost_after(&step);
    if expected.is_nan() || expected >= cost {
        return None;
    }
    let next = moved(problem, p, &step);
    let there = problem.linearise(&next);
    let reached = there.cost() + distance(problem, &next, centre);
    (reached < cost).then_some((next, there))
}

/// The prior's share of the cost.
fn distance(problem: &dyn Problem, p: &[f64], centre: &[f64]) -> f64 {
    let moved = p.iter().zip(centre).zip(problem.scale());
    let squares: f64 = moved.map(|((p, c), scale)| ((p - c) / scale).powi(2)).sum();
    problem.prior().powi(2) * squares
}

/// The problem with the prior's rows below it.
fn with_prior(problem: &dyn Problem, linear: &Linear, p: &[f64], centre: &[f64]) -> Linear {
    let strength = problem.prior();
    if strength == 0.0 {
        return linear.clone();
    }
    let (rows, n) = linear.factor.shape();
    let mut stacked = DMatrix::zeros(rows + n, n + 1);
    stacked
        .view_mut((0, 0), (rows, n))
        .copy_from(&linear.factor);
    stacked.view_mut((0, n), (rows, 1)).copy_from(&linear.right);
    for k in 0..n {
        stacked[(rows + k, k)] = strength;
        stacked[(rows + k, n)] = strength * (p[k] - centre[k]) / problem.scale()[k];
    }
    let mut whole = reduce(vec![stacked], n);
    whole.rest += linear.rest;
    whole
}

fn stop(
    problem: &dyn Problem,
    (before, p): (Vec<f64>, Vec<f64>),
    linear: Linear,
    converged: bool,
    iterations: usize,
) -> Solution {
    let at_bound = p
        .iter()
        .zip(problem.bounds())
        .map(|(&p, &(lower, upper))| p <= lower || p >= upper)
        .collect();
    Solution {
        p,
        before,
        linear,
        at_bound,
        converged,
        iterations,
    }
}

fn moved(problem: &dyn Problem, p: &[f64], step: &DVector<f64>) -> Vec<f64> {
    p.iter()
        .zip(step.iter())
        .zip(problem.scale().iter().zip(problem.bounds()))
        .map(|((&p, &step), (&scale, &(lower, upper)))| (p + step * scale).clamp(lower, upper))
        .collect()
}

/// The step, in typical sizes; parameters that it would carry past a bound stop there, and the others are
/// solved for again.
fn bounded_step(problem: &dyn Problem, linear: &Linear, p: &[f64], damping: f64) -> DVector<f64> {
    let n = p.len();
    let mut fixed: Vec<Option<f64>> = vec![None; n];
    loop {
        let free: Vec<usize> = (0..n).filter(|&k| fixed[k].is_none()).collect();
        let mut right = linear.right.clone();
        for (k, step) in fixed.iter().enumerate() {
            if let Some(step) = step {
                right += linear.factor.column(k) * *step;
            }
        }
        let reduced = match whole_step(problem, linear, damping).filter(|_| free.len() == n) {
            Some(step) => step,
            None => least_squares(linear.factor.select_columns(&free), &right, damping),
        };
        let mut step = DVector::zeros(n);
        for (k, value) in fixed.iter().enumerate() {
            step[k] = value.unwrap_or(0.0);
        }
        let mut hit = false;
        for (&k, &value) in free.iter().zip(reduced.iter()) {
            step[k] = value;
            let (lower, upper) = problem.bounds()[k];
            let reached = p[k] + value * problem.scale()[k];
            if reached < lower || reached > upper {
                fixed[k] = Some((reached.clamp(lower, upper) - p[k]) / problem.scale()[k]);
                hit = true;
            }
        }
        if !hit {
            return step;
        }
    }
}

/// The step of all parameters by back substitution, where the prior keeps every direction's singular value above what
/// rounding could make of it.
fn whole_step(problem: &dyn Problem, linear: &Linear, damping: f64) -> Option<DVector<f64>> {
    let factor = &linear.factor;
    let sure = problem.prior() > ROUNDING * factor.norm();
    let square = factor.nrows() == factor.ncols();
    (damping == 0.0 && square && sure)
        .then(|| factor.solve_upper_triangular(&-&linear.right))
        .flatten()
}

/// `x` that minimises `‖A x + b‖² + damping ‖x‖²` over the directions that count.
fn least_squares(factor: DMatrix<f64>, right: &DVector<f64>, damping: f64) -> DVector<f64> {
    let spectrum = Spectrum::of(factor);
    let along = spectrum.u.transpose() * right;
    let mut step = DVector::zeros(spectrum.v.nrows());
    let least = spectrum.rounding();
    for (i, &s) in spectrum.values.iter().enumerate() {
        if s <= least {
            break;
        }
        step -= spectrum.v.column(i) * (s * along[i] / (s * s + damping));
    }
    step
}

/// Singular value decomposition, largest first.
#[derive(Debug, Clone)]
pub struct Spectrum {
    /// Left vectors by columns.
    pub u: DMatrix<f64>,
    /// Singular values, falling.
    pub values: Vec<f64>,
    /// Right vectors by columns: as many as there are parameters.
    pub v: DMatrix<f64>,
    /// How many singular values count.
    pub rank: usize,
}

impl Spectrum {
    /// Standard deviation of a parameter from the directions that count, typical sizes.
    pub fn deviation(&self, parameter: usize) -> f64 {
        let parts = (0..self.rank).map(|i| (self.v[(parameter, i)] / self.values[i]).powi(2));
        parts.sum::<f64>().sqrt()
    }

    /// Share of a parameter in the directions that do not count: squared length of its unit vector there.
    pub fn lost(&self, parameter: usize) -> f64 {
        (self.rank..self.values.len())
            .map(|i| self.v[(parameter, i)].powi(2))
            .sum()
    }

    /// Singular values below this are rounding.
    pub fn rounding(&self) -> f64 {
        ROUNDING * self.values.first().copied().unwrap_or(0.0)
    }

    /// Decomposes a matrix; fewer rows than columns are filled up with zeros.
    pub fn of(factor: DMatrix<f64>) -> Self {
        let n = factor.ncols();
        let rows = factor.nrows().max(n);
        let factor = if factor.nrows() < rows {
            factor.resize_vertically(rows, 0.0)
        } else {
            factor
        };
        // the decomposition of what is no number does not end
        if n == 0 || factor.iter().any(|x| !x.is_finite()) {
            return Self {
                u: DMatrix::zeros(rows, n),
                values: vec![0.0; n],
                v: DMatrix::identity(n, n),
                rank: 0,
            };
        }
        let svd = factor.svd(true, true);
        let values: Vec<f64> = svd.singular_values.iter().copied().collect();
        let least = WEAK.max(ROUNDING * values.first().copied().unwrap_or(0.0));
        let rank = values.iter().filter(|&&s| s >= least).count();
        Self {
            u: svd.u.unwrap_or_else(|| DMatrix::zeros(rows, n)),
            v: svd
                .v_t
                .map_or_else(|| DMatrix::zeros(n, n), |v| v.transpose()),
            values,
            rank,
        }
    }
}

/// Reduces stacked blocks `[J | r]` to triangular form: in groups of neighbours, those again, until one is left.
pub fn reduce(mut blocks: Vec<DMatrix<f64>>, columns: usize) -> Linear {
    /// Blocks stacked on each other at once; fixed, so that the result does not depend on threads.
    const STACKED: usize = 8;
    let triangle = loop {
        let groups = blocks.par_chunks(STACKED);
        blocks = groups
            .map(|group| triangle(stack(group, columns + 1)))
            .collect();
        if blocks.len() <= 1 {
            break blocks.pop();
        }
    };
    let triangle = triangle.unwrap_or_else(|| DMatrix::zeros(0, columns + 1));
    let rows = triangle.nrows().min(columns);
    let rest = (rows..triangle.nrows())
        .map(|row| triangle[(row, columns)].powi(2))
        .sum();
    Linear {
        factor: triangle.view((0, 0), (rows, columns)).into_owned(),
        right: triangle
            .view((0, columns), (rows, 1))
            .column(0)
            .into_owned(),
        rest,
        folds: Vec::new(),
    }
}

fn stack(blocks: &[DMatrix<f64>], columns: usize) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(blocks.iter().map(DMatrix::nrows).sum(), columns);
    let mut row = 0;
    for block in blocks {
        all.rows_mut(row, block.nrows()).copy_from(block);
        row += block.nrows();
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fit_creeps_if_ten_steps_lower_the_cost_by_less_than_a_hundredth() {
        // falls by so much a step, so many steps
        let table = [
            (0.0009, 30, true),
            (0.0011, 30, false),
            (0.0009, 20, false),
            (0.0009, 21, true),
            (1.0, 40, false),
        ];
        for (fall, steps, expected) in table {
            let costs: Vec<f64> = (0..steps).map(|k| 1000.0 - fall * f64::from(k)).collect();
            assert_eq!(creeps(&costs, CREEP), expected, "{fall} {steps}");
        }
        assert!(!creeps(&[], CREEP));
    }
}
