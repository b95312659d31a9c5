//! Frequencies to try of a joint, and all products of their pairs that the base model and the residual ask for.
//!
//! Kept by fold: a search on some folds adds up theirs.

use super::sums::Sums;
use nalgebra::{DMatrix, DMatrixView};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::ops::Range;

/// Cycles a turn that `transmission_error` takes care of; waves begin one period over a joint's range above.
const SLOWEST: f64 = 2.0;
/// Cycles a turn up to which waves are looked for: two an input turn of a gear of ratio 160.
const FASTEST: f64 = 320.0;
/// Steps of the scan a period over the joint's range: a peak loses 3 % of its height at most between two.
pub const STEPS: f64 = 4.0;
/// Different angles that a joint must have been at.
pub const ANGLES: usize = 10;
/// Typical amplitude, rad.
pub const TYPICAL: f64 = 3e-5;
/// Pairs whose weaker direction has less than this (σ for a typical amplitude) are not counted.
const FAINT: f64 = 0.05;
/// Frequencies in one product of matrices.
const BATCH: usize = 128;

/// Products of a pair's columns with each other and with the residual, the basis partialled out.
#[derive(Debug, Clone, Copy, Default)]
pub struct Moments {
    pub ss: f64,
    pub sc: f64,
    pub cc: f64,
    pub sr: f64,
    pub cr: f64,
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

/// Frequencies to try of a joint.
pub struct Grid {
    /// Period over the range, cycles a turn.
    pub period: f64,
    /// Least frequency.
    first: f64,
    /// From one frequency to the next, cycles a turn.
    pub step: f64,
    /// Number of frequencies.
    pub count: usize,
    folds: Vec<Raw>,
}

/// Sums over one fold, nothing partialled out.
struct Raw {
    /// By frequency.
    moments: Vec<Moments>,
    /// Products of the sines and of the cosines with the base model's columns, frequencies by columns.
    along: [DMatrix<f64>; 2],
}

impl Grid {
    /// Of a joint's place; none with too few angles.
    pub fn new(sums: &Sums, joint: usize, folds: usize) -> Option<Self> {
        let turning = &sums.joints[joint];
        let angles = distinct(&turning.angles)?;
        let period = TAU / (angles[angles.len() - 1] - angles[0]);
        let (first, step) = (SLOWEST + period, period / STEPS);
        let mut grid = Self {
            period,
            first,
            step,
            count: ((FASTEST - first) / step).max(0.0) as usize,
            folds: Vec::new(),
        };
        if grid.count == 0 {
            return None;
        }
        let raw = |fold: usize| grid.raw(sums, joint, fold);
        let raws = (0..folds).map(raw).collect();
        grid.folds = raws;
        Some(grid)
    }

    fn raw(&self, sums: &Sums, joint: usize, fold: usize) -> Raw {
        let postures = sums.postures(&[fold]);
        let turning = &sums.joints[joint];
        let angles: Vec<f64> = postures.iter().map(|&p| turning.angles[p]).collect();
        let weight = sums.cross(joint, joint).select_rows(&postures);
        let with_base = turning.with_base.select_rows(&postures);
        let residual = turning.with_residual.select_rows(&postures);
        let parts: Vec<_> = self.batches(&angles, |batch, sin, cos| {
            let mut moments = vec![Moments::default(); batch.len()];
            for (k, &weight) in weight.iter().enumerate() {
                for (i, m) in moments.iter_mut().enumerate() {
                    let (s, c) = (sin[(i, k)], cos[(i, k)]);
                    m.ss += weight * s * s;
                    m.sc += weight * s * c;
                    m.cc += weight * c * c;
                    m.sr += residual[k] * s;
                    m.cr += residual[k] * c;
                }
            }
            (moments, [sin * &with_base, cos * &with_base])
        });
        let mut along = [0, 1].map(|_| DMatrix::zeros(self.count, with_base.ncols()));
        let mut moments = Vec::new();
        for (own, products) in parts {
            for (along, products) in along.iter_mut().zip(products) {
                let mut rows = along.rows_mut(moments.len(), own.len());
                rows.copy_from(&products);
            }
            moments.extend(own);
        }
        Raw { moments, along }
    }

    /// The moments over these folds. `root` makes an orthonormal basis of the base model's columns, `along` are the
    /// residual's products with that.
    pub fn moments(&self, folds: &[usize], root: &DMatrix<f64>, along: &[f64]) -> Vec<Moments> {
        let mut found = vec![Moments::default(); self.count];
        let mut sums = [0, 1].map(|_| DMatrix::zeros(self.count, root.nrows()));
        for &fold in folds {
            let raw = &self.folds[fold];
            for (m, own) in found.iter_mut().zip(&raw.moments) {
                m.add(own);
            }
            for (sum, along) in sums.iter_mut().zip(&raw.along) {
                *sum += along;
            }
        }
        let [sin, cos] = sums.map(|sum| sum * root);
        take_out(&mut found, sin.as_view(), cos.as_view());
        for (k, along) in along.iter().enumerate() {
            for (i, m) in found.iter_mut().enumerate() {
                m.sr -= sin[(i, k)] * along;
                m.cr -= cos[(i, k)] * along;
            }
        }
        found
    }

    /// Cycles a turn of a place.
    pub fn frequency(&self, place: usize) -> f64 {
        self.first + self.step * place as f64
    }

    /// What `then` makes of the sines and cosines of these angles, frequencies by angles, batch by batch.
    pub fn batches<T: Send>(
        &self,
        angles: &[f64],
        then: impl Fn(Range<usize>, &DMatrix<f64>, &DMatrix<f64>) -> T + Sync,
    ) -> Vec<T> {
        let batches: Vec<Range<usize>> = (0..self.count)
            .step_by(BATCH)
            .map(|begin| begin..(begin + BATCH).min(self.count))
            .collect();
        let of = |batch: Range<usize>| {
            let mut sin = DMatrix::zeros(batch.len(), angles.len());
            let mut cos = sin.clone();
            let columns = sin.column_iter_mut().zip(cos.column_iter_mut());
            for ((mut sin, mut cos), &q) in columns.zip(angles) {
                let start = self.frequency(batch.start) * q;
                turned(sin.as_mut_slice(), cos.as_mut_slice(), start, self.step * q);
            }
            then(batch, &sin, &cos)
        };
        batches.into_par_iter().map(of).collect()
    }
}

/// Sines and cosines of `start`, `start + step`, …: each by turning the one a stride before, exact to rounding.
fn turned(sin: &mut [f64], cos: &mut [f64], start: f64, step: f64) {
    /// So many at once, which none of them waits for.
    const STRIDE: usize = 8;
    let (turn_s, turn_c) = step.sin_cos();
    let (mut a, mut b) = start.sin_cos();
    for (s, c) in sin.iter_mut().zip(&mut *cos).take(STRIDE) {
        (*s, *c) = (a, b);
        (a, b) = (a * turn_c + b * turn_s, b * turn_c - a * turn_s);
    }
    let (turn_s, turn_c) = (step * STRIDE as f64).sin_cos();
    let (mut sin, mut cos) = (sin, cos);
    while sin.len() > STRIDE {
        let (before_s, rest_s) = sin.split_at_mut(STRIDE);
        let (before_c, rest_c) = cos.split_at_mut(STRIDE);
        let before = before_s.iter().zip(&*before_c);
        for ((s, c), (a, b)) in rest_s.iter_mut().zip(&mut *rest_c).zip(before) {
            (*s, *c) = (a * turn_c + b * turn_s, b * turn_c - a * turn_s);
        }
        (sin, cos) = (rest_s, rest_c);
    }
}

impl Moments {
    fn add(&mut self, other: &Self) {
        self.ss += other.ss;
        self.sc += other.sc;
        self.cc += other.cc;
        self.sr += other.sr;
        self.cr += other.cr;
    }
}

/// Takes directions out of the products of pairs with each other, given the pairs' products with them.
pub fn take_out(moments: &mut [Moments], sin: DMatrixView<'_, f64>, cos: DMatrixView<'_, f64>) {
    for (sin, cos) in sin.column_iter().zip(cos.column_iter()) {
        for (m, (s, c)) in moments.iter_mut().zip(sin.iter().zip(cos.iter())) {
            m.ss -= s * s;
            m.sc -= s * c;
            m.cc -= c * c;
        }
    }
}

/// Different angles, rising; none if they are too few.
pub fn distinct(angles: &[f64]) -> Option<Vec<f64>> {
    let mut angles = angles.to_vec();
    angles.sort_by(f64::total_cmp);
    angles.dedup();
    (angles.len() >= ANGLES).then_some(angles)
}
