//! How sure a reading is: its covariance, and where the size of it comes from.
//!
//! The covariance of a reading is the tracker's (across and along the beam, growing with distance; target
//! orientation) plus what the joints' lack of repeatability does at the target, `σ_q² J Jᵀ`. Its shape comes
//! from the campaign file; its size from repeats where there are any.

use super::alike::Alike;
use crate::campaign::MIN_REPEAT_DOF;
use crate::campaign::wrench_is_measured;
use crate::campaign::{Noise, Reading};
use crate::dual_quaternion::rotation_vector;
use crate::model::{Model, Row, Rows, Workspace, stacked};
use nalgebra::{Matrix3, Matrix6, Vector3};
use rayon::prelude::*;

/// Noise below this is rounding: one standard deviation, m and rad.
pub const FLOOR: f64 = 1e-9;

/// Where the size of the noise comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Source {
    /// Readings of one pose under one load from one direction.
    Replicates,
    /// The campaign file.
    Campaign,
    /// What the fit leaves, model errors included.
    Residual,
}

/// Whitens the rows of a reading's residual: `L⁻¹`, `L Lᵀ` its covariance.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Lower triangular, of the pose; position-only readings use the first three rows.
    inverse: Matrix6<f64>,
    /// 3 or 6.
    pose_rows: usize,
    /// One over the deviations of force and torque, where the wrench is measured beside a known load.
    wrench: Option<(f64, f64)>,
    /// Number of rows that count.
    pub rows: usize,
    /// Trace of the covariance of the position / 3, m².
    pub position_variance: f64,
    /// The same of the orientation, rad².
    pub orientation_variance: f64,
}

impl Whitener {
    /// Writes the whitened rows of a residual, or of one column of its derivative.
    pub fn apply(&self, row: &Row, out: &mut impl FnMut(usize, f64)) {
        self.apply_through(&self.inverse, row, out);
    }

    /// The whitening (1/m, 1/rad; 6 × 6) of a change of the pose, the rotation vector of the error answering to the turn of
    /// the target through `turn`.
    pub fn through(&self, turn: &Matrix3<f64>) -> Matrix6<f64> {
        let mut through = self.inverse;
        let turned = self.inverse.fixed_columns::<3>(3) * turn;
        through.fixed_columns_mut::<3>(3).copy_from(&turned);
        through
    }

    /// As [`Whitener::apply`], the pose by a matrix that [`Whitener::through`] made.
    pub fn apply_through(
        &self,
        through: &Matrix6<f64>,
        row: &Row,
        out: &mut impl FnMut(usize, f64),
    ) {
        let pose = through * row.fixed_rows::<6>(0);
        for k in 0..self.pose_rows {
            out(k, pose[k]);
        }
        if let Some((force, torque)) = self.wrench {
            for k in 0..3 {
                out(self.pose_rows + k, row[6 + k] * force);
                out(self.pose_rows + 3 + k, row[9 + k] * torque);
            }
        }
    }

    /// How much it differs from another, as a share of itself; infinite where that has other rows.
    pub fn unlike(&self, other: &Self) -> f64 {
        if self.rows != other.rows
            || self.pose_rows != other.pose_rows
            || self.wrench != other.wrench
        {
            return f64::INFINITY;
        }
        (self.inverse - other.inverse).norm() / self.inverse.norm()
    }

    /// Sum of squares of the whitened rows.
    pub fn squares(&self, row: &Row) -> f64 {
        let mut sum = 0.0;
        self.apply(row, &mut |_, value| sum += value * value);
        sum
    }
}

/// Covariance of the readings as the noise model says, at the parameters `p`.
pub fn whiteners(model: &Model, p: &[f64], readings: &[&Reading], noise: &Noise) -> Vec<Whitener> {
    whiteners_alike(&Alike::of(model, readings), model, p, readings, noise)
}

/// The same where it is known which readings are alike.
pub(super) fn whiteners_alike(
    alike: &Alike,
    model: &Model,
    p: &[f64],
    readings: &[&Reading],
    noise: &Noise,
) -> Vec<Whitener> {
    let joints = model.setup.robot.joints.len();
    let of_group = |workspace: &mut Workspace, reading: &Reading| {
        let mut jacobian = Rows::zeros(joints);
        workspace.joint_jacobian(model, p, reading, &mut jacobian);
        squares(&jacobian)
    };
    let squares = match noise.joint > 0.0 {
        true => alike.map(model, readings, of_group),
        false => vec![Matrix6::zeros(); readings.len()],
    };
    whiteners_where(readings, noise, |index| squares[index])
}

/// The same where it is known how each reading answers the robot's joints: 12 × joints, m/rad and rad/rad.
pub fn whiteners_of(jacobians: &[Rows], readings: &[&Reading], noise: &Noise) -> Vec<Whitener> {
    whiteners_where(readings, noise, |index| squares(&jacobians[index]))
}

/// `J Jᵀ` of the pose.
fn squares(jacobian: &Rows) -> Matrix6<f64> {
    let pose = jacobian.fixed_rows::<6>(0);
    pose * pose.transpose()
}

fn whiteners_where(
    readings: &[&Reading],
    noise: &Noise,
    squares: impl Fn(usize) -> Matrix6<f64> + Sync,
) -> Vec<Whitener> {
    let each = readings.par_iter().enumerate();
    each.map(|(index, reading)| {
        let mut covariance = tracker_covariance(reading, noise);
        if noise.joint > 0.0 {
            covariance += squares(index) * noise.joint.powi(2);
        }
        whitener(reading, &covariance, noise)
    })
    .collect()
}

/// Covariance (tracker frame) of the instrument alone.
fn tracker_covariance(reading: &Reading, noise: &Noise) -> Matrix6<f64> {
    let distance = reading.position.norm();
    let across = noise.position + noise.position_per_metre * distance;
    let along = noise.radial + noise.radial_per_metre * distance;
    let beam = if distance > 0.0 {
        reading.position / distance
    } else {
        Vector3::x()
    };
    let position = Matrix3::identity() * across.max(FLOOR).powi(2)
        + beam * beam.transpose() * (along.max(FLOOR).powi(2) - across.max(FLOOR).powi(2));
    let mut covariance = Matrix6::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&position);
    covariance
        .fixed_view_mut::<3, 3>(3, 3)
        .copy_from(&(Matrix3::identity() * noise.orientation.max(FLOOR).powi(2)));
    covariance
}

fn whitener(reading: &Reading, covariance: &Matrix6<f64>, noise: &Noise) -> Whitener {
    let inverse = match covariance.cholesky() {
        Some(factor) => {
            let mut inverse = Matrix6::identity();
            // a triangular system with a positive diagonal always has a solution
            factor.l().solve_lower_triangular_mut(&mut inverse);
            inverse
        }
        None => Matrix6::from_diagonal(&covariance.diagonal().map(|v| 1.0 / v.sqrt())),
    };
    let diagonal = covariance.diagonal();
    let pose_rows = if reading.orientation.is_some() { 6 } else { 3 };
    // a sensor of which nothing is known is not believed
    let wrench = (wrench_is_measured(reading) && noise.force > 0.0 && noise.torque > 0.0)
        .then(|| (1.0 / noise.force, 1.0 / noise.torque));
    Whitener {
        inverse,
        pose_rows,
        wrench,
        rows: pose_rows + if wrench.is_some() { 6 } else { 0 },
        position_variance: diagonal.fixed_rows::<3>(0).mean(),
        orientation_variance: diagonal.fixed_rows::<3>(3).mean(),
    }
}

/// Isotropic noise of one size each for positions and orientations.
pub fn isotropic(position: f64, orientation: f64) -> Noise {
    Noise {
        position,
        radial: position,
        orientation,
        ..Noise::default()
    }
}

/// Pure error: mean square of repeats about their means.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PureError {
    /// Of whitened rows; 1 if the noise model is right.
    pub whitened: f64,
    /// Degrees of freedom of it.
    pub dof: usize,
    /// Per axis, m².
    pub position: f64,
    /// Per axis, rad².
    pub orientation: f64,
    /// Per axis of the wrist sensor, N².
    pub force: f64,
    /// Per axis of the wrist sensor, (N·m)².
    pub torque: f64,
    /// Number of groups of repeats.
    pub groups: usize,
}

/// Pure error of replicate groups; `None` if there are too few repeats.
pub fn pure_error(
    readings: &[&Reading],
    whiteners: &[Whitener],
    groups: &[Vec<usize>],
) -> Option<PureError> {
    let mut sum = PureError::default();
    let (mut position, mut orientation, mut force, mut torque) = (
        Mean::default(),
        Mean::default(),
        Mean::default(),
        Mean::default(),
    );
    for group in groups {
        let free = group.len() - 1;
        for (&index, row) in group.iter().zip(deviations(readings, group)) {
            sum.whitened += whiteners[index].squares(&row);
            position.add(&row.fixed_rows::<3>(0).into_owned());
            orientation.add(&row.fixed_rows::<3>(3).into_owned());
            force.add(&row.fixed_rows::<3>(6).into_owned());
            torque.add(&row.fixed_rows::<3>(9).into_owned());
        }
        let rows = group.iter().map(|&index| whiteners[index].rows).min();
        sum.dof += rows.unwrap_or(0) * free;
        let all = |has: fn(&Reading) -> bool| group.iter().all(|&i| has(readings[i]));
        position.dof += 3 * free;
        orientation.dof += if all(|r| r.orientation.is_some()) {
            3 * free
        } else {
            0
        };
        let wrench = if all(wrench_is_measured) { 3 * free } else { 0 };
        force.dof += wrench;
        torque.dof += wrench;
    }
    if sum.dof < MIN_REPEAT_DOF {
        return None;
    }
    sum.groups = groups.len();
    sum.whitened /= sum.dof as f64;
    sum.position = position.value();
    sum.orientation = orientation.value();
    sum.force = force.value();
    sum.torque = torque.value();
    Some(sum)
}

/// Mean square over degrees of freedom.
#[derive(Default)]
struct Mean {
    squares: f64,
    dof: usize,
}

impl Mean {
    fn add(&mut self, part: &Vector3<f64>) {
        self.squares += part.norm_squared();
    }

    fn value(&self) -> f64 {
        self.squares / self.dof.max(1) as f64
    }
}

/// By member: rows from the group's mean. Parts that not all members have are zero.
fn deviations(readings: &[&Reading], group: &[usize]) -> Vec<Row> {
    let reference = readings[group[0]].orientation;
    let turned = group.iter().all(|&i| readings[i].orientation.is_some());
    let wrenches = group.iter().all(|&i| wrench_is_measured(readings[i]));
    let mut rows: Vec<Row> = group
        .iter()
        .map(|&i| {
            let reading = readings[i];
            let mut row = Row::zeros();
            row.fixed_rows_mut::<3>(0).copy_from(&reading.position);
            if let (true, Some(first), Some(own)) = (turned, reference, reading.orientation) {
                let turn = rotation_vector(&(own * first.inverse()).into_inner());
                row.fixed_rows_mut::<3>(3).copy_from(&turn);
            }
            if let (true, Some(wrench)) = (wrenches, reading.wrench) {
                row.fixed_rows_mut::<6>(6)
                    .copy_from(&stacked(&wrench.force, &wrench.torque));
            }
            row
        })
        .collect();
    let mean = rows.iter().sum::<Row>() / group.len() as f64;
    for row in &mut rows {
        *row -= mean;
    }
    rows
}
