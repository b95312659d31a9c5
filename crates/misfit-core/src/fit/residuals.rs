//! What a model leaves of its readings, and its size.

use super::alike::Alike;
use super::noise::Whitener;
use super::rows;
use crate::campaign::Reading;
use crate::campaign::wrench_is_measured;
use crate::dual_quaternion::rotation_vector;
use crate::model::{Model, Prediction, Row, stacked};
use nalgebra::Vector3;

/// Errors of predicted readings.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Errors {
    /// Root mean square distance, m.
    pub position_rms_m: f64,
    /// Mean distance, m.
    pub position_mean_m: f64,
    /// Largest distance, m.
    pub position_max_m: f64,
    /// Root mean square angle, rad; none without orientations.
    pub orientation_rms_rad: Option<f64>,
    /// Root mean square of the whitened rows: 1 is noise alone.
    pub whitened_rms: f64,
}

/// Residuals, measured minus predicted: position (m), rotation vector (rad), in the tracker's frame.
pub fn residuals(model: &Model, p: &[f64], readings: &[&Reading]) -> Vec<Row> {
    residuals_of(&Alike::of(model, readings), model, p, readings)
}

/// The same where it is known which readings are alike.
pub(super) fn residuals_of(
    alike: &Alike,
    model: &Model,
    p: &[f64],
    readings: &[&Reading],
) -> Vec<Row> {
    let predictions = alike.map(model, readings, |workspace, reading| {
        workspace.predict(model, p, reading)
    });
    let pairs = predictions.iter().zip(readings);
    pairs
        .map(|(prediction, reading)| residual(prediction, reading))
        .collect()
}

pub(super) fn residual(prediction: &Prediction, reading: &Reading) -> Row {
    if !prediction.settled {
        return Row::from_element(f64::NAN);
    }
    let position = reading.position - prediction.position;
    let turn = match reading.orientation {
        Some(seen) => rotation_vector(&(seen * prediction.orientation.inverse()).into_inner()),
        None => Vector3::zeros(),
    };
    let mut row = Row::zeros();
    row.fixed_rows_mut::<6>(0)
        .copy_from(&stacked(&position, &turn));
    if let (true, Some(wrench)) = (wrench_is_measured(reading), reading.wrench) {
        let left = stacked(&wrench.force, &wrench.torque) - prediction.wrench;
        row.fixed_rows_mut::<6>(6).copy_from(&left);
    }
    row
}

pub(super) fn squares(residuals: &[Row], whiteners: &[Whitener]) -> f64 {
    let pairs = residuals.iter().zip(whiteners);
    pairs.map(|(row, whitener)| whitener.squares(row)).sum()
}

/// Errors of readings at given parameters.
pub fn errors(model: &Model, p: &[f64], readings: &[&Reading], whiteners: &[Whitener]) -> Errors {
    let residuals = residuals(model, p, readings);
    summarise(&residuals, readings, whiteners)
}

pub(super) fn summarise(
    residuals: &[Row],
    readings: &[&Reading],
    whiteners: &[Whitener],
) -> Errors {
    let distances: Vec<f64> = residuals
        .iter()
        .map(|r| r.fixed_rows::<3>(0).norm())
        .collect();
    let turns: Vec<f64> = residuals
        .iter()
        .zip(readings)
        .filter(|(_, reading)| reading.orientation.is_some())
        .map(|(r, _)| r.fixed_rows::<3>(3).norm())
        .collect();
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let rms = |values: &[f64]| {
        let squares: Vec<f64> = values.iter().map(|x| x * x).collect();
        mean(&squares).sqrt()
    };
    Errors {
        position_rms_m: rms(&distances),
        position_mean_m: mean(&distances),
        position_max_m: distances.iter().copied().fold(0.0, f64::max),
        orientation_rms_rad: (!turns.is_empty()).then(|| rms(&turns)),
        whitened_rms: (squares(residuals, whiteners) / rows(whiteners) as f64).sqrt(),
    }
}
