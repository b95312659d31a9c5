//! A joint in a search: the score of a pair of waves at each frequency, beside what was found so far.

use super::grid::{Grid, Moments, distinct, take_out};
use crate::fit::triangle::triangle;
use nalgebra::allocator::Allocator;
use nalgebra::{
    DMatrix, DMatrixView, DVector, DefaultAllocator, Dim, Dyn, Matrix, OMatrix, RawStorage,
};
use std::f64::consts::{PI, TAU};

/// Products of one joint's motion summed over postures with the same angle of it.
pub struct Lane<'a> {
    /// Frequencies.
    pub grid: &'a Grid,
    /// Different angles, rad.
    angles: Vec<f64>,
    /// Place of each posture's angle among them.
    place: Vec<usize>,
    /// Squared motion at each.
    weight: Vec<f64>,
    /// Products of motion and basis, angles by directions: only their products with each other count.
    basis: Columns,
    /// Products of motion and residual.
    residual: DVector<f64>,
    /// By frequency.
    pub moments: Vec<Moments>,
    /// Directions of the basis that the moments know of.
    done: usize,
    /// Independent frequencies.
    pub trials: f64,
}

impl<'a> Lane<'a> {
    /// From the joint's angles (rad), its squared motion, and its products with the basis and with the residual, all by
    /// postures, and the moments beside the base model; none with too few angles.
    pub fn new(
        grid: &'a Grid,
        moments: Vec<Moments>,
        of_postures: &[f64],
        squares: &DVector<f64>,
        basis: DMatrixView<'_, f64>,
        residual: &DVector<f64>,
    ) -> Option<Self> {
        let angles = distinct(of_postures)?;
        let of = |own: &f64| angles.partition_point(|angle| angle < own);
        let place: Vec<usize> = of_postures.iter().map(of).collect();
        let mut weight = vec![0.0; angles.len()];
        for (&place, square) in place.iter().zip(squares) {
            weight[place] += square;
        }
        let all: f64 = weight.iter().sum();
        if all <= 0.0 {
            return None;
        }
        let mean = |of: &dyn Fn(f64) -> f64| {
            let terms = angles.iter().zip(&weight);
            terms.map(|(&q, w)| w * of(q)).sum::<f64>() / all
        };
        let centre = mean(&|q| q);
        let variance = mean(&|q| (q - centre).powi(2));
        let trials = grid.count as f64 * grid.step * (4.0 * PI * variance).sqrt() / TAU;
        let mut lane = Self {
            grid,
            angles,
            place,
            weight,
            basis: Columns::new(DMatrix::zeros(0, 0)),
            residual: DVector::zeros(0),
            moments,
            done: 0,
            trials,
        };
        lane.basis = Columns::new(compact(lane.by_angle(&basis)));
        lane.done = lane.basis.count;
        lane.residual = lane.by_angle(residual);
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
        self.basis.push(fresh.as_view());
        self.residual = self.by_angle(residual);
    }

    /// Takes the directions that are new out of all moments, and the residual's products anew.
    pub fn update(&mut self) {
        let count = self.basis.count - self.done;
        let directions = self.basis.all().columns(self.done, count).into_owned();
        let parts = self.grid.batches(&self.angles, |batch, sin, cos| {
            let mut moments = self.moments[batch].to_vec();
            let (along_s, along_c) = (sin * &directions, cos * &directions);
            take_out(&mut moments, along_s.as_view(), along_c.as_view());
            let (sr, cr) = (sin * &self.residual, cos * &self.residual);
            for (i, m) in moments.iter_mut().enumerate() {
                (m.sr, m.cr) = (sr[i], cr[i]);
            }
            moments
        });
        self.moments = parts.concat();
        self.done = self.basis.count;
    }

    /// The moments at any number of cycles.
    pub fn at(&self, cycles: f64) -> Moments {
        let waves = self.angles.iter().map(|q| (cycles * q).sin_cos());
        let (sin, cos): (Vec<f64>, Vec<f64>) = waves.unzip();
        let (sin, cos) = (DVector::from_vec(sin), DVector::from_vec(cos));
        let basis = self.basis.all();
        let (along_s, along_c) = (basis.tr_mul(&sin), basis.tr_mul(&cos));
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

/// Columns to which more are added, with room for those to come.
pub struct Columns {
    room: DMatrix<f64>,
    /// How many there are.
    pub count: usize,
}

impl Columns {
    /// These.
    pub fn new(columns: DMatrix<f64>) -> Self {
        Self {
            count: columns.ncols(),
            room: columns,
        }
    }

    /// All of them.
    pub fn all(&self) -> DMatrixView<'_, f64> {
        self.room.columns(0, self.count)
    }

    /// Adds some behind.
    pub fn push(&mut self, more: DMatrixView<'_, f64>) {
        let count = self.count + more.ncols();
        if count > self.room.ncols() {
            self.room.resize_horizontally_mut(count + count / 4, 0.0);
        }
        self.room
            .columns_mut(self.count, more.ncols())
            .copy_from(&more);
        self.count = count;
    }
}
