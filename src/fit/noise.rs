//! How sure a reading is: its covariance, and where the size of it comes from.
//!
//! The covariance of a reading is the tracker's (across and along the beam, growing with distance; target
//! orientation) plus what the joints' lack of repeatability does at the target, `σ_q² J Jᵀ`. Its shape comes
//! from the campaign file; its size from repeats where there are any.

use crate::campaign::{Campaign, Noise, Reading};
use crate::dual_quaternion::rotation_vector;
use crate::model::{Model, Rows6, Workspace};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Noise below this is rounding: one standard deviation, m and rad.
pub const FLOOR: f64 = 1e-9;
/// Repeats are believed from this many degrees of freedom on.
pub const ENOUGH: usize = 12;

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

/// Whitens the six rows of a reading's residual: `L⁻¹`, `L Lᵀ` its covariance. Position-only readings use
/// the first three rows.
#[derive(Debug, Clone)]
pub struct Whitener {
    /// Lower triangular.
    pub inverse: Matrix6<f64>,
    /// 3 or 6.
    pub rows: usize,
    /// Trace of the covariance of the position / 3, m².
    pub position_variance: f64,
    /// The same of the orientation, rad².
    pub orientation_variance: f64,
}

/// Covariance of the readings as the noise model says, at the parameters `p`.
pub fn whiteners(model: &Model, p: &[f64], readings: &[&Reading], noise: &Noise) -> Vec<Whitener> {
    let joints = model.setup.robot.joints.len();
    readings
        .par_iter()
        .map_init(
            || (Workspace::new(&model.setup), Rows6::zeros(joints)),
            |(workspace, jacobian), reading| {
                let mut covariance = tracker_covariance(reading, noise);
                if noise.joint > 0.0 {
                    workspace.joint_jacobian(model, p, reading, jacobian);
                    covariance += &*jacobian * jacobian.transpose() * noise.joint.powi(2);
                }
                whitener(reading, &covariance)
            },
        )
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

fn whitener(reading: &Reading, covariance: &Matrix6<f64>) -> Whitener {
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
    Whitener {
        inverse,
        rows: if reading.orientation.is_some() { 6 } else { 3 },
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

/// Readings that should agree but for noise: same target, pose, load and direction.
///
/// Indices into `readings`; only groups of two and more. Poses without a label are the same if the encoder
/// angles are, to the bit.
pub fn replicate_groups(campaign: &Campaign, readings: &[&Reading]) -> Vec<Vec<usize>> {
    let bits = |x: &f64| x.to_bits();
    let mut groups: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, reading) in readings.iter().enumerate() {
        let pose = match &reading.pose {
            Some(label) => (label.clone(), Vec::new()),
            None => (String::new(), reading.joints.iter().map(bits).collect()),
        };
        let approach: Vec<u64> = reading.approach.iter().flatten().map(bits).collect();
        let payload = reading
            .payload
            .map(|p| [p.mass, p.com.x, p.com.y, p.com.z].map(f64::to_bits));
        let key = (reading.target, pose, approach, payload);
        groups.entry(key).or_default().push(index);
    }
    groups
        .into_values()
        .flat_map(|group| by_wrench(campaign, readings, group))
        .filter(|group| group.len() > 1)
        .collect()
}

/// Splits a group by load where only the wrench tells: wrenches within 6 sigma, or 2 % of the force, of the
/// first of a subgroup belong together.
fn by_wrench(campaign: &Campaign, readings: &[&Reading], group: Vec<usize>) -> Vec<Vec<usize>> {
    let sigma = campaign.noise.map_or(0.0, |noise| noise.force);
    let mut subgroups: Vec<Vec<usize>> = Vec::new();
    for index in group {
        let (Some(wrench), None) = (readings[index].wrench, readings[index].payload) else {
            match subgroups.first_mut() {
                Some(first) => first.push(index),
                None => subgroups.push(vec![index]),
            }
            continue;
        };
        let near = |other: &Vec<usize>| {
            readings[other[0]].wrench.is_some_and(|w| {
                let reach = (6.0 * sigma).max(0.02 * w.force.norm()).max(1e-6);
                (w.force - wrench.force).norm() <= reach
            })
        };
        match subgroups.iter_mut().find(|other| near(other)) {
            Some(other) => other.push(index),
            None => subgroups.push(vec![index]),
        }
    }
    subgroups
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
    let (mut position_dof, mut orientation_dof) = (0, 0);
    for group in groups {
        let members = deviations(readings, group);
        let rows = if members.iter().any(|m| m.1.is_none()) {
            3
        } else {
            6
        };
        for (&index, (position, orientation)) in group.iter().zip(&members) {
            let mut deviation = Vector6::zeros();
            deviation.fixed_rows_mut::<3>(0).copy_from(position);
            if let (6, Some(turn)) = (rows, orientation) {
                deviation.fixed_rows_mut::<3>(3).copy_from(turn);
                sum.orientation += turn.norm_squared();
            }
            let whitened = whiteners[index].inverse * deviation;
            sum.whitened += whitened.rows(0, rows).norm_squared();
            sum.position += position.norm_squared();
        }
        sum.dof += rows * (group.len() - 1);
        position_dof += 3 * (group.len() - 1);
        orientation_dof += (rows - 3) * (group.len() - 1);
    }
    if sum.dof < ENOUGH {
        return None;
    }
    sum.groups = groups.len();
    sum.whitened /= sum.dof as f64;
    sum.position /= position_dof as f64;
    sum.orientation /= orientation_dof.max(1) as f64;
    Some(sum)
}

/// By member: position (m) and rotation vector (rad) from the group's mean, in the tracker's frame.
fn deviations(readings: &[&Reading], group: &[usize]) -> Vec<(Vector3<f64>, Option<Vector3<f64>>)> {
    let n = group.len() as f64;
    let mean: Vector3<f64> = group
        .iter()
        .map(|&i| readings[i].position)
        .sum::<Vector3<f64>>()
        / n;
    let reference: Option<UnitQuaternion<f64>> = readings[group[0]].orientation;
    let turns: Vec<Option<Vector3<f64>>> = group
        .iter()
        .map(|&i| {
            let turn = readings[i].orientation? * reference?.inverse();
            Some(rotation_vector(&turn.into_inner()))
        })
        .collect();
    let mean_turn: Vector3<f64> = turns.iter().flatten().sum::<Vector3<f64>>() / n;
    group
        .iter()
        .zip(turns)
        .map(|(&i, turn)| (readings[i].position - mean, turn.map(|t| t - mean_turn)))
        .collect()
}
