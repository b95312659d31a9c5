//! Where the misfit lies in the design: between poses, loads, directions, over time, or within repeats.
//!
//! Each contrast is the difference of two projectors onto group means of the whitened residual. What the base
//! model absorbs of it is taken off its degrees of freedom: with `Q` an orthonormal basis of the base model's
//! columns, noise alone gives `tr C - ‖C Q‖²`.

use super::score::Against;
use crate::campaign::Reading;
use crate::fit::pose_key;
use nalgebra::DMatrix;
use std::collections::BTreeMap;

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

/// Rows of the readings: whitened residual and an orthonormal basis of the base model, `[Q | M r]`.
pub struct Field<'a> {
    /// Readings by their order.
    pub readings: &'a [&'a Reading],
    /// First row of each reading, and one past the last.
    pub rows: Vec<usize>,
    /// `Q`, then `M r` as the last column.
    pub matrix: DMatrix<f64>,
}

/// Degrees of freedom below which a contrast says nothing.
const FEWEST: f64 = 3.0;

/// All contrasts that the design has.
pub fn contrasts(field: &Field, against: &Against) -> Vec<Contrast> {
    let pose = Groups::by(field, |r| key(r, false, false));
    let load = Groups::by(field, |r| key(r, true, false));
    let direction = Groups::by(field, |r| key(r, false, true));
    let both = Groups::by(field, |r| key(r, true, true));
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

type Key = (usize, (String, Vec<u64>), Vec<u64>, Vec<u64>);

fn key(reading: &Reading, load: bool, direction: bool) -> Key {
    let approach = reading.approach.iter().flatten().map(|x| x.to_bits());
    let weight = match (reading.payload, reading.wrench) {
        (Some(payload), _) => vec![payload.mass.to_bits()],
        // wrenches carry noise: tell loads apart by the newton
        (None, Some(wrench)) => vec![wrench.force.norm().round().to_bits()],
        (None, None) => Vec::new(),
    };
    (
        reading.target,
        pose_key(reading),
        if load { weight } else { Vec::new() },
        if direction {
            approach.collect()
        } else {
            Vec::new()
        },
    )
}

/// Sum of squares of a projected residual, and what noise of unit variance gives.
#[derive(Debug, Clone, Copy, Default)]
struct Moment {
    squares: f64,
    dof: f64,
}

impl Moment {
    fn all(field: &Field) -> Self {
        let last = field.matrix.ncols() - 1;
        Self {
            squares: field.matrix.column(last).norm_squared(),
            dof: (field.matrix.nrows() - last) as f64,
        }
    }
}

/// Groups of readings with the same number of rows.
struct Groups(Vec<Vec<usize>>);

impl Groups {
    fn by(field: &Field, key: impl Fn(&Reading) -> Key) -> Self {
        let mut groups: BTreeMap<(Key, usize), Vec<usize>> = BTreeMap::new();
        for (index, reading) in field.readings.iter().enumerate() {
            let rows = field.rows[index + 1] - field.rows[index];
            groups.entry((key(reading), rows)).or_default().push(index);
        }
        Self(groups.into_values().collect())
    }

    /// Of the projector onto the groups' means.
    fn moment(&self, field: &Field) -> Moment {
        let last = field.matrix.ncols() - 1;
        let mut moment = Moment::default();
        for group in &self.0 {
            let rows = field.rows[group[0] + 1] - field.rows[group[0]];
            let mut sum = DMatrix::zeros(rows, last + 1);
            for &index in group {
                sum += field.matrix.rows(field.rows[index], rows);
            }
            // √n times the mean: the projector keeps lengths
            sum /= (group.len() as f64).sqrt();
            moment.squares += sum.column(last).norm_squared();
            moment.dof += rows as f64 - sum.columns(0, last).norm_squared();
        }
        moment
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
    let end = field.matrix.ncols() - 1;
    let q = field.matrix.columns(0, end);
    let most = field.rows.windows(2).map(|w| w[1] - w[0]).max()?;
    let mut trends = DMatrix::zeros(field.matrix.nrows(), 2 * most);
    for (index, &time) in times.iter().enumerate() {
        let u = 2.0 * (time - first) / (last - first) - 1.0;
        for (k, row) in (field.rows[index]..field.rows[index + 1]).enumerate() {
            trends[(row, 2 * k)] = u;
            trends[(row, 2 * k + 1)] = u * u;
        }
    }
    // what the base model leaves of them
    let left = &trends - q * (q.transpose() * &trends);
    let eigen = left.tr_mul(&left).symmetric_eigen();
    let gradient = left.tr_mul(&field.matrix.column(end));
    let mut moment = Moment::default();
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > 1e-3 {
            moment.squares += vector.dot(&gradient.column(0)).powi(2) / value;
            moment.dof += 1.0;
        }
    }
    Some(moment)
}
