//! Where the misfit lies in the design: between poses, loads, directions, over time, or within repeats.
//!
//! Each contrast is the difference of two projectors onto group means of the whitened residual. What the base
//! model absorbs of it is taken off its degrees of freedom: with `Q` an orthonormal basis of the base model's
//! columns, noise alone gives `tr C - ‖C Q‖²`.

use super::score::Against;
use crate::campaign::{Condition, Reading};
use crate::fit::alike::{members, numbered};
use nalgebra::{DMatrix, DMatrixView, DVector};
use rayon::prelude::*;

/// One contrast.
#[derive(Debug, Clone, PartialEq)]
pub struct Contrast {
    /// `pose`, `load`, `direction`, `time` or `repeat`.
    pub name: &'static str,
    /// Mean square over what noise gives.
    pub ratio: f64,
    /// Effective degrees of freedom.
    pub dof: f64,
    /// Probability of as much from noise alone.
    pub p_value: f64,
}

/// Rows of the readings: whitened residual and an orthonormal basis of the base model, `[Q | M r]`ᵀ.
pub struct Field<'a> {
    /// Readings by their order.
    pub readings: &'a [&'a Reading],
    /// Directions of the base model.
    pub rank: usize,
    /// `Qᵀ`, then `M r` as the last of its rows, in parts: a row of a reading is a column here.
    pub parts: Vec<DMatrix<f64>>,
    /// By reading: its part, its first column there, and how many it has.
    pub places: Vec<(usize, usize, usize)>,
}

impl Field<'_> {
    /// The rows of one reading, a column each.
    pub fn of(&self, reading: usize) -> DMatrixView<'_, f64> {
        let (part, first, count) = self.places[reading];
        self.parts[part].columns(first, count)
    }

    /// How many rows a reading has.
    fn rows(&self, reading: usize) -> usize {
        self.places[reading].2
    }
}

/// Readings whose products are summed at once.
const TOGETHER: usize = 512;
/// Degrees of freedom below which a contrast says nothing.
const FEWEST: f64 = 3.0;

/// All contrasts that the design has.
pub fn contrasts(field: &Field, conditions: &[Condition], against: &Against) -> Vec<Contrast> {
    let groups = |load: bool, direction: bool| {
        let key = |(index, condition): (usize, &Condition)| {
            let load = if load { condition.load } else { 0 };
            let direction = if direction { condition.direction } else { 0 };
            (condition.pose, field.rows(index), load, direction)
        };
        let keys = conditions.iter().enumerate().map(key);
        Groups(members(&numbered(keys)))
    };
    let pose = groups(false, false);
    let load = groups(true, false);
    let direction = groups(false, true);
    let both = groups(true, true);
    let mut found = Vec::new();
    let mut add = |name, fine: Moment, coarse: Moment| {
        let dof = fine.dof - coarse.dof;
        let chi2 = (fine.squares - coarse.squares) / against.variance;
        if dof >= FEWEST {
            found.push(Contrast {
                name,
                ratio: chi2 / dof,
                dof,
                p_value: against.p_value(chi2, dof),
            });
        }
    };
    let nothing = Moment::default();
    add("pose", pose.moment(field), nothing);
    add("load", load.moment(field), pose.moment(field));
    add("direction", direction.moment(field), pose.moment(field));
    if let Some(moment) = time(field) {
        add("time", moment, nothing);
    }
    add("repeat", Moment::all(field), both.moment(field));
    found
}

/// Sum of squares of a projected residual, and what noise of unit variance gives.
#[derive(Debug, Clone, Copy, Default)]
struct Moment {
    squares: f64,
    dof: f64,
}

impl Moment {
    fn all(field: &Field) -> Self {
        let rows: usize = field.parts.iter().map(DMatrix::ncols).sum();
        let squares = field.parts.iter().map(|p| p.row(field.rank).norm_squared());
        Self {
            squares: squares.sum(),
            dof: rows as f64 - field.rank as f64,
        }
    }
}

/// Groups of readings with the same number of rows.
struct Groups(Vec<Vec<usize>>);

impl Groups {
    /// Of the projector onto the groups' means.
    fn moment(&self, field: &Field) -> Moment {
        let last = field.rank;
        let of = |group: &Vec<usize>| {
            let mut sum = field.of(group[0]).into_owned();
            for &index in &group[1..] {
                sum += field.of(index);
            }
            // √n times the mean: the projector keeps lengths
            let count = group.len() as f64;
            let squares = sum.row(last).norm_squared();
            Moment {
                squares: squares / count,
                dof: sum.ncols() as f64 - (sum.norm_squared() - squares) / count,
            }
        };
        let parts: Vec<Moment> = self.0.par_iter().map(of).collect();
        // in order, so that the sum does not depend on threads
        parts.iter().fold(Moment::default(), |sum, part| Moment {
            squares: sum.squares + part.squares,
            dof: sum.dof + part.dof,
        })
    }
}

/// Linear and quadratic trends of every row over time.
fn time(field: &Field) -> Option<Moment> {
    let times: Option<Vec<f64>> = field.readings.iter().map(|reading| reading.time).collect();
    let times = times?;
    let (first, last) = times
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &t| {
            (a.min(t), b.max(t))
        });
    if last <= first {
        return None;
    }
    let most = field.places.iter().map(|place| place.2).max()?;
    // products of the trends with each other, with the basis, and with the residual, which is beside that
    let products = |part: &[usize]| {
        let mut squares = DMatrix::zeros(2 * most, 2 * most);
        let mut through = DMatrix::zeros(field.rank, 2 * most);
        let mut gradient = DVector::zeros(2 * most);
        for &index in part {
            let u = 2.0 * (times[index] - first) / (last - first) - 1.0;
            for (k, column) in field.of(index).column_iter().enumerate() {
                let trends = [(2 * k, u), (2 * k + 1, u * u)];
                for (a, one) in trends {
                    through
                        .column_mut(a)
                        .axpy(one, &column.rows(0, field.rank), 1.0);
                    gradient[a] += one * column[field.rank];
                    for (b, other) in trends {
                        squares[(a, b)] += one * other;
                    }
                }
            }
        }
        (squares, through, gradient)
    };
    let all: Vec<usize> = (0..times.len()).collect();
    let parts: Vec<_> = all.par_chunks(TOGETHER).map(products).collect();
    // in order, so that the sum does not depend on threads
    let sum = parts
        .into_iter()
        .reduce(|(a, b, c), (d, e, f)| (a + d, b + e, c + f));
    let (squares, through, gradient) = sum?;
    // what the base model leaves of them
    let eigen = (squares - through.tr_mul(&through)).symmetric_eigen();
    let mut moment = Moment::default();
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > 1e-3 {
            moment.squares += vector.dot(&gradient).powi(2) / value;
            moment.dof += 1.0;
        }
    }
    Some(moment)
}
