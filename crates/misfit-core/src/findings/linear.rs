//! A few robust Gauss-Newton steps of the usual model: what it leaves of each reading when the reading's own pose is left
//! out, and what its springs want to be.
//!
//! Much less than a fit, and enough to see one row of millimetres among forty: the noise is the middle of what is left, and
//! poses that the others contradict lose their weight.

use super::table::quantile;
use crate::campaign::pose_key;
use crate::campaign::{Campaign, Reading};
use crate::effects::{EffectList, Role};
use crate::fit::noise::{isotropic, whiteners};
use crate::fit::solve::WEAK;
use crate::fit::start::Start;
use crate::fit::{CampaignProblem, values_with};
use crate::model_file;
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};
use std::collections::BTreeMap;

/// Gauss-Newton steps: frames and millimetres of geometry are found in two.
const STEPS: usize = 3;
/// Keeps normal equations regular where the prior is left out.
const RIDGE: f64 = 1e-9;

/// The usual model near its optimum, linear.
pub struct LinearFit {
    /// Rows of `[J | r]`, by reading, in units of the noise first assumed and of typical sizes.
    blocks: Vec<DMatrix<f64>>,
    /// Readings of each pose.
    pub poses: Vec<Vec<usize>>,
    /// Weight of each reading.
    weights: Vec<f64>,
    /// Columns of the springs of the joints.
    springs: Vec<usize>,
    /// Number of columns.
    columns: usize,
    /// How far the steps led, in typical sizes.
    moved: DVector<f64>,
    /// Position noise assumed, m.
    sigma: f64,
    /// Orientation noise assumed, rad.
    turn: f64,
}

/// What is left of a reading when its pose is left out.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Left {
    /// Sum of squares in units of its deviation.
    pub squares: f64,
    /// Rows.
    pub rows: usize,
    /// Distance, m.
    pub distance: f64,
}

/// What the springs want to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Springs {
    /// All with one compliance: that over its deviation.
    pub together: f64,
    /// Share of the sum of squares without springs that free ones leave.
    pub left: f64,
    /// How many are below and above zero by more than five deviations.
    pub signs: (usize, usize),
}

impl LinearFit {
    /// Takes the steps; none where the model has no value, or the readings are fewer than its parameters.
    pub fn of(
        campaign: &Campaign,
        readings: &[&Reading],
        weights: Vec<f64>,
        start: &Start,
    ) -> Option<Self> {
        let model = model_file::model(campaign, &EffectList::DEFAULT, None).ok()?;
        let free: Vec<usize> = model
            .parameters()
            .enumerate()
            .filter(|(_, (_, parameter))| parameter.vary)
            .map(|(index, _)| index)
            .collect();
        let limits: Vec<(f64, f64, f64)> = model
            .parameters()
            .map(|(_, p)| (p.typical, p.lower, p.upper))
            .collect();
        let term = model.term_of(Role::Spring);
        let springs = free.iter().enumerate().filter(|(_, k)| {
            term.is_some_and(|t| (t.first..t.first + t.parameters.len()).contains(*k))
        });
        let springs = springs.map(|(column, _)| column).collect();
        let start = values_with(&model, start);
        let mut found = Self {
            blocks: Vec::new(),
            poses: by_pose(readings),
            weights,
            springs,
            columns: free.len(),
            moved: DVector::zeros(free.len()),
            sigma: 1e-4,
            turn: 1e-4,
        };
        let mut p = start.clone();
        for step in 0..STEPS {
            let noise = isotropic(found.sigma, found.turn);
            let whiteners = whiteners(&model, &p, readings, &noise);
            let problem = CampaignProblem::new(&model, readings, &whiteners, &free, &p);
            let begin: Vec<f64> = free.iter().map(|&k| p[k]).collect();
            found.blocks = split(problem.blocks(&begin), readings);
            if found.blocks.len() != readings.len() || found.blocks.iter().any(not_finite) {
                return None;
            }
            let solution = found.solve()?;
            if step + 1 == STEPS {
                found.rest(&solution);
                break;
            }
            let left = found.after(&solution);
            (found.sigma, found.turn) = robust_sizes(&left, (found.sigma, found.turn));
            found.reweigh(&left);
            for (column, &k) in free.iter().enumerate() {
                let (typical, lower, upper) = limits[k];
                p[k] = (p[k] + solution[column] * typical).clamp(lower, upper);
                found.moved[column] = (p[k] - start[k]) / typical;
            }
        }
        Some(found)
    }

    /// Degrees of freedom left, of the readings that count.
    pub fn dof(&self) -> usize {
        let rows = self.blocks.iter().zip(&self.weights);
        let rows: usize = rows
            .filter(|(_, w)| **w > 0.1)
            .map(|(b, _)| b.nrows())
            .sum();
        rows.saturating_sub(self.columns)
    }

    /// Position noise of a coordinate from the middle of what is left, m.
    pub fn position_noise(&self) -> f64 {
        let left: Vec<DVector<f64>> = self
            .blocks
            .iter()
            .map(|block| block.column(self.columns).into_owned())
            .collect();
        let rows: usize = left.iter().map(DVector::len).sum();
        let share = self.dof() as f64 / rows.max(1) as f64;
        robust_sizes(&left, (self.sigma, self.turn)).0 / share.max(1e-3).sqrt()
    }

    fn normal(&self) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.columns;
        let mut gram = DMatrix::zeros(n + 1, n + 1);
        for (index, block) in self.blocks.iter().enumerate() {
            if self.weights[index] > 0.0 {
                gram.gemm_tr(self.weights[index], block, block, 1.0);
            }
        }
        let right = gram.view((0, n), (n, 1)).column(0).into_owned();
        (gram.view((0, 0), (n, n)).into_owned(), right)
    }

    /// The step to the optimum, with the weak prior of a fit about the start.
    fn solve(&self) -> Option<DVector<f64>> {
        let (normal, right) = self.normal();
        let right = right + &self.moved * (WEAK * WEAK);
        Some(-with_prior(normal)?.solve(&right))
    }

    /// What a step leaves, by reading.
    fn after(&self, step: &DVector<f64>) -> Vec<DVector<f64>> {
        let n = self.columns;
        let left = |block: &DMatrix<f64>| block.columns(0, n) * step + block.column(n);
        self.blocks.iter().map(left).collect()
    }

    /// Takes the last step: from now on the residual is what it leaves.
    fn rest(&mut self, step: &DVector<f64>) {
        let left = self.after(step);
        let n = self.columns;
        for (block, left) in self.blocks.iter_mut().zip(left) {
            block.column_mut(n).copy_from(&left);
        }
        self.moved += step;
    }

    /// Weights of a Cauchy distribution by what is left of each pose.
    fn reweigh(&mut self, left: &[DVector<f64>]) {
        let size = |members: &[usize]| {
            let sizes: Vec<f64> = members
                .iter()
                .map(|&i| left[i].norm_squared() / left[i].len().max(1) as f64)
                .collect();
            sizes
        };
        let each: Vec<f64> = (0..left.len()).flat_map(|i| size(&[i])).collect();
        let middle = quantile(&each, 0.5);
        if !(middle.is_finite() && middle > 0.0) {
            return;
        }
        for (weight, size) in self.weights.iter_mut().zip(&each) {
            *weight = 1.0 / (1.0 + size / (6.0 * middle));
        }
    }

    /// Counts only these readings, all alike, and takes the step that follows from it.
    pub fn keep(&mut self, kept: &[bool]) -> Option<()> {
        for (weight, kept) in self.weights.iter_mut().zip(kept) {
            *weight = if *kept { 1.0 } else { 0.0 };
        }
        let solution = self.solve()?;
        self.rest(&solution);
        Some(())
    }

    /// What is left of each reading when its pose is left out, in units of the noise first assumed.
    pub fn left_out(&self) -> Option<Vec<Left>> {
        let n = self.columns;
        let (normal, _) = self.normal();
        let whole = with_prior(normal.clone())?;
        let nothing = Left {
            squares: 0.0,
            rows: 0,
            distance: 0.0,
        };
        let mut all = vec![nothing; self.blocks.len()];
        for members in &self.poses {
            let counted = members.iter().any(|&i| self.weights[i] > 0.0);
            let own = match counted {
                true => {
                    let mut normal = normal.clone();
                    let mut right = DVector::zeros(n);
                    for &i in members {
                        let jacobian = self.blocks[i].columns(0, n);
                        normal.gemm_tr(-self.weights[i], &jacobian, &jacobian, 1.0);
                        let weighted = self.blocks[i].column(n) * self.weights[i];
                        right += jacobian.transpose() * weighted;
                    }
                    // at the optimum of all the others pull as hard the other way
                    with_prior(normal).map(|factor| (factor.solve(&right), factor))
                }
                false => Some((DVector::zeros(n), whole.clone())),
            };
            let Some((step, factor)) = own else { continue };
            for &i in members {
                let jacobian = self.blocks[i].columns(0, n);
                let left = jacobian * &step + self.blocks[i].column(n);
                let rows = left.len();
                let mut covariance = DMatrix::identity(rows, rows);
                covariance += jacobian * factor.solve(&jacobian.transpose());
                let squares = covariance
                    .cholesky()
                    .map_or(0.0, |c| left.dot(&c.solve(&left)));
                all[i] = Left {
                    squares,
                    rows,
                    distance: left.rows(0, 3.min(rows)).norm() * self.sigma,
                };
            }
        }
        Some(all)
    }

    /// What the springs want to be, where the model has any; loads act at the nominal posture.
    pub fn springs(&self) -> Option<Springs> {
        if self.springs.is_empty() {
            return None;
        }
        let n = self.columns;
        let (normal, right) = self.normal();
        let squares: f64 = self
            .blocks
            .iter()
            .zip(&self.weights)
            .map(|(block, weight)| weight * block.column(n).norm_squared())
            .sum();
        // back to where there are no springs: the last step has freed them
        let mut back = DVector::zeros(n);
        for &k in &self.springs {
            back[k] = -self.moved[k];
        }
        let squares = squares + 2.0 * back.dot(&right) + back.dot(&(&normal * &back));
        let right = right + &normal * &back;
        let others: Vec<usize> = (0..n).filter(|k| !self.springs.contains(k)).collect();
        let cost = |columns: &[usize]| {
            let normal = normal.select_rows(columns).select_columns(columns);
            let right = right.select_rows(columns);
            let step = factor(normal)?.solve(&right);
            Some((squares - right.dot(&step)).max(0.0))
        };
        let without = cost(&others)?;
        let all: Vec<usize> = (0..n).collect();
        let free = cost(&all)?;
        let variance = (free / self.dof().max(1) as f64).max(f64::MIN_POSITIVE);
        // one compliance for all: the sum of their columns, the others projected out
        let mut sum = DMatrix::zeros(n, others.len() + 1);
        for (column, &k) in others.iter().enumerate() {
            sum[(k, column)] = 1.0;
        }
        for &k in &self.springs {
            sum[(k, others.len())] = 1.0;
        }
        let together = estimate(
            &(sum.transpose() * &normal * &sum),
            &(sum.transpose() * &right),
        )?;
        let last = others.len();
        let each = estimate(&normal, &right)?;
        let sure = |sign: f64| {
            let spring = |k: &&usize| sign * each.0[**k] > 5.0 * (each.1[**k] * variance).sqrt();
            self.springs.iter().filter(spring).count()
        };
        Some(Springs {
            together: together.0[last] / (together.1[last] * variance).sqrt(),
            left: if without > 0.0 { free / without } else { 1.0 },
            signs: (sure(-1.0), sure(1.0)),
        })
    }
}

/// Estimates and their variances in units of the noise.
fn estimate(normal: &DMatrix<f64>, right: &DVector<f64>) -> Option<(DVector<f64>, DVector<f64>)> {
    let factor = factor(normal.clone())?;
    Some((-factor.solve(right), factor.inverse().diagonal()))
}

/// The factor of normal equations with the prior of a fit.
fn with_prior(mut normal: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    for k in 0..normal.nrows() {
        normal[(k, k)] += WEAK * WEAK;
    }
    normal.cholesky()
}

/// The factor of normal equations, kept regular.
fn factor(mut normal: DMatrix<f64>) -> Option<Cholesky<f64, Dyn>> {
    let largest = normal.diagonal().max();
    for k in 0..normal.nrows() {
        let own = normal[(k, k)];
        normal[(k, k)] = own + RIDGE * (own + 1e-3 * largest) + 1e-12;
    }
    normal.cholesky()
}

fn not_finite(block: &DMatrix<f64>) -> bool {
    block.iter().any(|x| !x.is_finite())
}

fn by_pose(readings: &[&Reading]) -> Vec<Vec<usize>> {
    let mut poses: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, reading) in readings.iter().enumerate() {
        poses.entry(pose_key(reading)).or_default().push(index);
    }
    poses.into_values().collect()
}

/// Blocks of many readings as one block each.
fn split(blocks: Vec<DMatrix<f64>>, readings: &[&Reading]) -> Vec<DMatrix<f64>> {
    let mut found = Vec::new();
    let mut readings = readings.iter();
    for block in blocks {
        let mut row = 0;
        while row < block.nrows() {
            let Some(reading) = readings.next() else {
                break;
            };
            let rows = if reading.orientation.is_some() { 6 } else { 3 };
            if row + rows > block.nrows() {
                return Vec::new();
            }
            found.push(block.rows(row, rows).into_owned());
            row += rows;
        }
    }
    found
}

/// Sizes of position and orientation noise from the middle of what is left in units of those assumed.
fn robust_sizes(left: &[DVector<f64>], assumed: (f64, f64)) -> (f64, f64) {
    // of the norm of three standard normal numbers
    const MIDDLE: f64 = 1.538_17;
    let of = |first: usize, assumed: f64| {
        let parts = left.iter().filter(|l| l.len() >= first + 3);
        let sizes: Vec<f64> = parts.map(|l| l.rows(first, 3).norm()).collect();
        let size = quantile(&sizes, 0.5) / MIDDLE * assumed;
        // an exact table has no noise at all
        if size.is_finite() {
            size.max(1e-9)
        } else {
            assumed
        }
    };
    (of(0, assumed.0), of(3, assumed.1))
}
