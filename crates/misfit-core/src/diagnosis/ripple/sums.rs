//! Products of what waves are made of, summed over the readings of a posture.
//!
//! A wave's column is a joint's motion times a function of that joint's angle, one number for all readings in a posture.
//! So its products with other waves, with the base model and with the residual follow from sums by posture, exactly and
//! however many readings there are.

use crate::campaign::Reading;
use crate::diagnosis::motion::Motion;
use crate::fit::alike::{angles, members, numbered};
use crate::fit::leave_out::{self, Part};
use crate::fit::normal::Normal;
use crate::fit::{self, FOLDS, Fit};
use crate::robot::JointKind;
use nalgebra::{DMatrix, DMatrixView, DVector};
use rayon::prelude::*;

/// A joint that turns; its motion is the whitened motion of the target by it.
pub struct Turning {
    /// As the robot names it.
    pub name: String,
    /// By postures, rad.
    pub angles: Vec<f64>,
    /// Cycles of waves that the base model has already.
    pub known: Vec<f64>,
    /// Products of its motion and the base model's columns, postures by columns.
    pub with_base: DMatrix<f64>,
    /// Products of its motion and the residual, by postures.
    pub with_residual: DVector<f64>,
}

/// A column of rows: a joint's motion times a number for each posture.
pub struct Column {
    /// Place of the joint.
    pub joint: usize,
    /// By postures.
    pub values: DVector<f64>,
}

/// Sums over all readings, by posture and by fold.
pub struct Sums {
    /// Joints that turn.
    pub joints: Vec<Turning>,
    /// Fold of each posture.
    pub folds: Vec<usize>,
    /// Products of the motions of two joints by posture, row by row of a square table.
    cross: Vec<DVector<f64>>,
    /// By fold: products of the base model's columns and, last, the residual with each other.
    grams: Vec<Normal>,
    /// By fold.
    rows: Vec<usize>,
}

impl Sums {
    /// `blocks` are rows of whitened columns, the first `base` of them those of the fit, the last the residual; `known` are
    /// the waves of the fit.
    #[expect(
        clippy::too_many_lines,
        reason = "one procedure, still to be split by its steps"
    )]
    pub fn new(
        fit: &Fit,
        known: &[(String, f64)],
        readings: &[&Reading],
        motions: &[Motion],
        blocks: &[DMatrix<f64>],
        base: usize,
    ) -> Self {
        let fold_of = fit::folds(readings).0;
        let own = readings.iter().zip(&fold_of);
        let postures = numbered(own.map(|(reading, fold)| (fold, angles(reading))));
        let members = members(&postures);
        let fold: Vec<usize> = members.iter().map(|own| fold_of[own[0]]).collect();
        let setup = &fit.model.setup;
        let turns =
            |place: &usize| setup.robot.joints[setup.observed[*place]].kind != JointKind::Prismatic;
        let turning: Vec<usize> = (0..setup.observed.len()).filter(turns).collect();
        let joint = |&place: &usize| {
            let joint = setup.observed[place];
            let name = setup.robot.joints[joint].name.clone();
            Turning {
                angles: (members.iter())
                    .map(|own| readings[own[0]].joints[joint])
                    .collect(),
                known: (known.iter().filter(|wave| wave.0 == name))
                    .map(|wave| wave.1)
                    .collect(),
                with_base: DMatrix::zeros(fold.len(), base),
                with_residual: DVector::zeros(fold.len()),
                name,
            }
        };
        let count = turning.len();
        let pick = |block: &DMatrix<f64>| {
            let mut columns = block.columns(0, base + 1).into_owned();
            columns.set_column(base, &block.column(block.ncols() - 1));
            columns
        };
        let mut sums = Self {
            joints: turning.iter().map(joint).collect(),
            cross: vec![DVector::zeros(fold.len()); count * count],
            grams: leave_out::by_folds(
                readings,
                motions.iter().map(|m| m.rates.nrows()),
                blocks,
                pick,
            ),
            rows: vec![0; FOLDS],
            folds: fold,
        };
        // where the rows of each reading are
        let (mut block, mut row) = (0, 0);
        let mut begin = Vec::with_capacity(readings.len());
        for (index, motion) in motions.iter().enumerate() {
            let rows = motion.rates.nrows();
            if rows > 0 && row == blocks[block].nrows() {
                (block, row) = (block + 1, 0);
            }
            begin.push((block, row));
            sums.rows[fold_of[index]] += rows;
            row += rows;
        }
        let of = |members: &Vec<usize>| {
            // motions with the base model's columns, with the residual, and with each other
            let mut products = DMatrix::zeros(count, base + 1 + count);
            for &index in members {
                let rates = motions[index].rates.select_columns(&turning);
                let (block, row) = begin[index];
                let own = blocks[block].rows(row, rates.nrows());
                let turned = rates.transpose();
                let mut add = |first: usize, columns: DMatrixView<'_, f64>| {
                    let mut place = products.columns_mut(first, columns.ncols());
                    place.gemm(1.0, &turned, &columns, 1.0);
                };
                add(0, own.columns(0, base));
                add(base, own.columns(own.ncols() - 1, 1));
                add(base + 1, rates.as_view());
            }
            products
        };
        let found: Vec<DMatrix<f64>> = members.par_iter().map(of).collect();
        for (posture, products) in found.iter().enumerate() {
            for (i, joint) in sums.joints.iter_mut().enumerate() {
                let own = products.row(i);
                let mut with_base = joint.with_base.row_mut(posture);
                with_base.copy_from(&own.columns(0, base));
                joint.with_residual[posture] = own[base];
                for j in 0..count {
                    sums.cross[i * count + j][posture] = own[base + 1 + j];
                }
            }
        }
        sums
    }

    /// Products of the motions of two joints, by posture.
    pub fn cross(&self, one: usize, other: usize) -> &DVector<f64> {
        &self.cross[one * self.joints.len() + other]
    }

    /// Postures of these folds.
    pub fn postures(&self, folds: &[usize]) -> Vec<usize> {
        let all = 0..self.folds.len();
        all.filter(|&p| folds.contains(&self.folds[p])).collect()
    }

    /// Rows of these folds, and the products of the base model's columns and the residual with each other over them.
    pub fn base(&self, folds: &[usize]) -> (usize, Normal) {
        let gram = Normal::joined(folds.iter().map(|&fold| &self.grams[fold]));
        (folds.iter().map(|&fold| self.rows[fold]).sum(), gram)
    }

    /// Product of two columns over these postures, which their values go by.
    pub fn product(&self, postures: &[usize], one: &Column, other: &Column) -> f64 {
        let cross = self.cross(one.joint, other.joint);
        let values = one.values.iter().zip(&other.values);
        let each = postures.iter().zip(values);
        each.map(|(&p, (a, b))| cross[p] * a * b).sum()
    }

    /// Products over these folds of `[base | columns | residual]` with each other, the columns given by cycles.
    pub fn normal(&self, folds: &[usize], waves: &[(usize, f64)], size: f64) -> Normal {
        let postures = self.postures(folds);
        let (_, Normal(gram)) = self.base(folds);
        let base = gram.nrows() - 1;
        let columns: Vec<Column> = waves
            .iter()
            .flat_map(|&(joint, cycles)| self.pair(&postures, joint, cycles, size))
            .collect();
        let all = base + columns.len();
        let mut normal =
            gram.insert_columns(base, columns.len(), 0.0)
                .insert_rows(base, columns.len(), 0.0);
        for (a, column) in columns.iter().enumerate() {
            let joint = &self.joints[column.joint];
            let mut set = |row: usize, value: f64| {
                normal[(row, base + a)] = value;
                normal[(base + a, row)] = value;
            };
            let product = |of: &[f64]| -> f64 {
                let values = postures.iter().zip(&column.values);
                values.map(|(&p, value)| of[p] * value).sum()
            };
            for k in 0..base {
                set(k, product(joint.with_base.column(k).as_slice()));
            }
            set(all, product(joint.with_residual.as_slice()));
            for (b, other) in columns.iter().enumerate().take(a + 1) {
                set(base + b, self.product(&postures, column, other));
            }
        }
        Normal(normal)
    }

    /// Sine and cosine of so many cycles a turn, times `size`.
    pub fn pair(&self, postures: &[usize], joint: usize, cycles: f64, size: f64) -> [Column; 2] {
        let angles = postures.iter().map(|&p| self.joints[joint].angles[p]);
        let (sin, cos): (Vec<f64>, Vec<f64>) = angles
            .map(|q| (cycles * q).sin_cos())
            .map(|(sin, cos)| (size * sin, size * cos))
            .unzip();
        let column = |values: Vec<f64>| Column {
            joint,
            values: DVector::from_vec(values),
        };
        [column(sin), column(cos)]
    }
}
