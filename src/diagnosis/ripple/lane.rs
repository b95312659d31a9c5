//! A scan of one joint: the score of a pair of waves over cycles per turn.

use crate::fit::triangle::triangle;
use nalgebra::allocator::Allocator;
use nalgebra::{
    DMatrix, DMatrixView, DVector, DefaultAllocator, Dim, Dyn, Matrix, OMatrix, RawStorage,
};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Cycles a turn that `transmission_error` takes care of; waves begin one period over a joint's range above.
const SLOWEST: f64 = 2.0;
/// Cycles a turn up to which waves are looked for: two an input turn of a gear of ratio 160.
const FASTEST: f64 = 320.0;
/// Steps of the scan a period over the joint's range: a peak loses 3 % of its height at most between two.
pub const STEPS: f64 = 4.0;
/// Different angles that a joint must have been at.
const ANGLES: usize = 10;
/// Typical amplitude, rad.
pub const TYPICAL: f64 = 3e-5;
/// Pairs whose weaker direction has less than this (σ for a typical amplitude) are not counted.
const FAINT: f64 = 0.05;
/// Frequencies in one product of matrices.
const BATCH: usize = 64;

/// Products of one joint's motion summed over postures with the same angle of it, and the frequencies to try.
pub struct Lane {
    /// Different angles, rad.
    angles: Vec<f64>,
    /// Place of each posture's angle among them.
    place: Vec<usize>,
    /// Squared motion at each.
    weight: Vec<f64>,
    /// Products of motion and basis, angles by directions: only their products with each other count.
    basis: DMatrix<f64>,
    /// Products of motion and residual.
    residual: DVector<f64>,
    /// Period over the range, cycles a turn.
    pub period: f64,
    /// Least frequency.
    first: f64,
    /// From one frequency to the next, cycles a turn.
    pub step: f64,
    /// Number of frequencies.
    count: usize,
    /// By frequency.
    pub moments: Vec<Moments>,
    /// Directions of the basis that the moments know of.
    done: usize,
    /// Independent frequencies.
    pub trials: f64,
}

/// Products of a pair's columns with each other and with the residual, the basis partialled out.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    ss: f64,
    sc: f64,
    cc: f64,
    sr: f64,
    cr: f64,
}

impl Moments {
    /// Score of the pair over the noise variance, zero if one of its directions is faint.
    pub fn chi2(&self, variance: f64) -> f64 {
        let mean = 0.5 * (self.ss + self.cc);
        // sizes near one: no need of the slower `hypot`
        let spread = (0.25 * (self.ss - self.cc).powi(2) + self.sc.powi(2)).sqrt();
        let weaker = mean - spread;
        if weaker * TYPICAL.powi(2) <= FAINT.powi(2) * variance {
            return 0.0;
        }
        let determinant = (mean + spread) * weaker;
        let squares = self.cc * self.sr.powi(2) - 2.0 * self.sc * self.sr * self.cr
            + self.ss * self.cr.powi(2);
        squares / determinant / variance
    }
}

impl Lane {
    /// From the joint's angles (rad), its squared motion, and its products with the basis and with the residual, all by
    /// postures; none with too few angles.
    pub fn new(
        of_postures: &[f64],
        squares: &DVector<f64>,
        basis: &DMatrix<f64>,
        residual: &DVector<f64>,
    ) -> Option<Self> {
        let mut angles = of_postures.to_vec();
        angles.sort_by(f64::total_cmp);
        angles.dedup();
        if angles.len() < ANGLES {
            return None;
        }
        let of = |own: &f64| angles.partition_point(|angle| angle < own);
        let place: Vec<usize> = of_postures.iter().map(of).collect();
        let mut weight = vec![0.0; angles.len()];
        for (&place, square) in place.iter().zip(squares) {
            weight[place] += square;
        }
        let period = TAU / (angles[angles.len() - 1] - angles[0]);
        let (first, step) = (SLOWEST + period, period / STEPS);
        let mut lane = Self {
            weight,
            basis: DMatrix::zeros(0, 0),
            residual: DVector::zeros(0),
            count: ((FASTEST - first) / step).max(0.0) as usize,
            angles,
            place,
            period,
            first,
            step,
            moments: Vec::new(),
            done: 0,
            trials: 0.0,
        };
        lane.basis = compact(lane.by_angle(basis));
        lane.residual = lane.by_angle(residual);
        let all: f64 = lane.weight.iter().sum();
        if all <= 0.0 || lane.count == 0 {
            return None;
        }
        let mean = |of: &dyn Fn(f64) -> f64| {
            let terms = lane.angles.iter().zip(&lane.weight);
            terms.map(|(&q, w)| w * of(q)).sum::<f64>() / all
        };
        let centre = mean(&|q| q);
        let variance = mean(&|q| (q - centre).powi(2));
        lane.trials = lane.count as f64 * lane.step * (4.0 * PI * variance).sqrt() / TAU;
        lane.update();
        Some(lane)
    }

    /// Sums by angle of what goes by postures.
    fn by_angle<C: Dim, S: RawStorage<f64, Dyn, C>>(
        &self,
        columns: &Matrix<f64, Dyn, C, S>,
    ) -> OMatrix<f64, Dyn, C>
    where
        DefaultAllocator: Allocator<Dyn, C>,
    {
        let (_, count) = columns.shape_generic();
        let mut sums = OMatrix::zeros_generic(Dyn(self.angles.len()), count);
        for (mut sums, column) in sums.column_iter_mut().zip(columns.column_iter()) {
            for (&place, value) in self.place.iter().zip(column.iter()) {
                sums[place] += value;
            }
        }
        sums
    }

    /// Columns behind those of the basis, and another residual; the moments know of them after the next update.
    pub fn push(&mut self, fresh: DMatrixView<'_, f64>, residual: &DVector<f64>) {
        let fresh = self.by_angle(&fresh);
        append(&mut self.basis, fresh.as_view());
        self.residual = self.by_angle(residual);
    }

    /// Cycles a turn of a place.
    pub fn frequency(&self, place: usize) -> f64 {
        self.first + self.step * place as f64
    }

    /// Takes the directions that are new out of all moments, and the residual's products anew.
    pub fn update(&mut self) {
        let batches: Vec<Range<usize>> = (0..self.count)
            .step_by(BATCH)
            .map(|begin| begin..(begin + BATCH).min(self.count))
            .collect();
        let lane = &*self;
        let directions = self
            .basis
            .columns(self.done, self.basis.ncols() - self.done);
        let directions = directions.into_owned();
        let moments: Vec<Vec<Moments>> = batches
            .into_par_iter()
            .map(|batch| lane.batch(batch, &directions))
            .collect();
        self.moments = moments.concat();
        self.done = self.basis.ncols();
    }

    fn batch(&self, batch: Range<usize>, directions: &DMatrix<f64>) -> Vec<Moments> {
        let mut sin = DMatrix::zeros(batch.len(), self.angles.len());
        let mut cos = sin.clone();
        for (k, &q) in self.angles.iter().enumerate() {
            // the next frequency by turning the last: exact to rounding over a batch
            let (mut s, mut c) = (self.frequency(batch.start) * q).sin_cos();
            let (turn_s, turn_c) = (self.step * q).sin_cos();
            for i in 0..batch.len() {
                sin[(i, k)] = s;
                cos[(i, k)] = c;
                (s, c) = (s * turn_c + c * turn_s, c * turn_c - s * turn_s);
            }
        }
        let (along_s, along_c) = (&sin * directions, &cos * directions);
        let (sr, cr) = (&sin * &self.residual, &cos * &self.residual);
        let fresh = self.moments.is_empty();
        let mut found: Vec<Moments> = if fresh {
            vec![Moments::default(); batch.len()]
        } else {
            self.moments[batch].to_vec()
        };
        if fresh {
            for (k, &weight) in self.weight.iter().enumerate() {
                for (i, m) in found.iter_mut().enumerate() {
                    let (s, c) = (sin[(i, k)], cos[(i, k)]);
                    m.ss += weight * s * s;
                    m.sc += weight * s * c;
                    m.cc += weight * c * c;
                }
            }
        }
        for k in 0..directions.ncols() {
            for (i, m) in found.iter_mut().enumerate() {
                let (s, c) = (along_s[(i, k)], along_c[(i, k)]);
                m.ss -= s * s;
                m.sc -= s * c;
                m.cc -= c * c;
            }
        }
        for (i, m) in found.iter_mut().enumerate() {
            (m.sr, m.cr) = (sr[i], cr[i]);
        }
        found
    }

    /// The moments at any number of cycles.
    pub fn at(&self, cycles: f64) -> Moments {
        let waves = self.angles.iter().map(|q| (cycles * q).sin_cos());
        let (sin, cos): (Vec<f64>, Vec<f64>) = waves.unzip();
        let (sin, cos) = (DVector::from_vec(sin), DVector::from_vec(cos));
        let (along_s, along_c) = (self.basis.tr_mul(&sin), self.basis.tr_mul(&cos));
        let weighted = |a: &DVector<f64>, b: &DVector<f64>| -> f64 {
            let terms = self.weight.iter().zip(a.iter().zip(b.iter()));
            terms.map(|(w, (a, b))| w * a * b).sum()
        };
        Moments {
            ss: weighted(&sin, &sin) - along_s.norm_squared(),
            sc: weighted(&sin, &cos) - along_s.dot(&along_c),
            cc: weighted(&cos, &cos) - along_c.norm_squared(),
            sr: sin.dot(&self.residual),
            cr: cos.dot(&self.residual),
        }
    }
}

/// As few columns with the same products of rows with each other.
fn compact(columns: DMatrix<f64>) -> DMatrix<f64> {
    if columns.ncols() <= columns.nrows() {
        return columns;
    }
    triangle(columns.transpose()).transpose()
}

/// Columns behind columns.
pub fn append(matrix: &mut DMatrix<f64>, more: DMatrixView<'_, f64>) {
    let before = matrix.ncols();
    matrix.resize_horizontally_mut(before + more.ncols(), 0.0);
    matrix.columns_mut(before, more.ncols()).copy_from(&more);
}
