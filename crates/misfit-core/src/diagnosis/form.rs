//! One effect of another form than the catalogue's, as a hypothesis of its own: beside two effects, and beside none.
//!
//! Each of its parameters may vary with what its law sees: a rigid one with the joint's own angle, an elastic one with the
//! torque on the joint, any other with time and temperature. Two columns `x φ(v)` are added for each column `x`: a third
//! harmonic is a first that varies with the angle, a drift that slows down a rate that varies with time. What a second
//! effect only repairs of the first is explained as well by these, at less cost; a second cause is not.

use super::families::Family;
use super::score::Gram;
use super::{against, fitted};
use crate::campaign::{Campaign, Reading};
use crate::effects::{AnyEffect, Parameter, Stage};
use crate::fit::{CampaignProblem, Fit, noise};
use crate::model::Workspace;
use nalgebra::DMatrix;
use std::sync::Arc;

/// Functions for each column.
const FUNCTIONS: usize = 2;

/// Log evidence (nats) of an effect against a fit without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Form {
    /// With the catalogue's law.
    pub usual: f64,
    /// With parameters that vary.
    pub free: f64,
}

impl Form {
    /// Of an effect beside this fit.
    pub fn of(campaign: &Campaign, without: &Fit, effect: &Arc<dyn AnyEffect>) -> Self {
        let readings = fitted(campaign);
        let shape = &without.noise.shape;
        let whiteners = noise::whiteners(&without.model, &without.values, &readings, shape);
        let base = without.free.len();
        let usual = Family::new(effect, &without.model, 0);
        let count = usual.columns.len();
        let wide = usual.widened(FUNCTIONS);
        let model = without.model.with(effect);
        let mut values = without.values.clone();
        let mut free = without.free.clone();
        free.extend(values.len()..model.start().len());
        values.resize(model.start().len(), 0.0);
        let problem = CampaignProblem::new(&model, &readings, &whiteners, &free, &values);
        let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
        let functions = functions(without, effect.as_ref(), &readings);
        let mut blocks = problem.blocks(&at);
        let rows = whiteners.iter().enumerate();
        let mut of_row = rows.flat_map(|(reading, own)| std::iter::repeat_n(reading, own.rows));
        for block in &mut blocks {
            let mut next = DMatrix::zeros(block.nrows(), base + count * (1 + FUNCTIONS) + 1);
            let known = base + count;
            next.columns_mut(0, known)
                .copy_from(&block.columns(0, known));
            next.set_column(next.ncols() - 1, &block.column(block.ncols() - 1));
            for (row, reading) in (0..block.nrows()).zip(&mut of_row) {
                for k in 0..count {
                    let own = block[(row, base + k)];
                    for (place, f) in functions[(reading, k)].into_iter().enumerate() {
                        next[(row, known + k * FUNCTIONS + place)] = own * f;
                    }
                }
            }
            *block = next;
        }
        let gram = Gram::new(&blocks, base);
        let against = against(without, &gram);
        let information = gram.families(against.variance);
        let score = usual.score(&information, &against);
        Self {
            usual: score.log_evidence,
            free: usual.with_widened(&wide, &information),
        }
    }
}

/// By reading and parameter: what the parameter may vary with.
fn functions(
    fit: &Fit,
    effect: &dyn AnyEffect,
    readings: &[&Reading],
) -> DMatrix<[f64; FUNCTIONS]> {
    let setup = &fit.model.setup;
    let parameters = effect.parameters(setup);
    let joints: Vec<Option<usize>> = parameters.iter().map(Parameter::joint).collect();
    let mut workspace = Workspace::new(setup);
    let torques: Vec<Vec<f64>> = readings
        .iter()
        .map(|reading| workspace.joint_torques(&fit.model, &fit.values, reading))
        .collect();
    let largest = |joint: usize| {
        let sizes = torques.iter().map(|torques| torques[joint].abs());
        sizes.fold(1e-12, f64::max)
    };
    let scaled = |of: &dyn Fn(&Reading) -> Option<f64>| -> Vec<f64> {
        let values: Option<Vec<f64>> = readings.iter().map(|reading| of(reading)).collect();
        let values = values.unwrap_or_default();
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if high > low {
            let to_unit = |x: &f64| 2.0 * (x - low) / (high - low) - 1.0;
            values.iter().map(to_unit).collect()
        } else {
            vec![0.0; readings.len()]
        }
    };
    let time = scaled(&|reading| reading.time);
    let warmth = scaled(&|reading| reading.temperature);
    let sizes: Vec<f64> = joints
        .iter()
        .map(|joint| joint.map_or(1.0, largest))
        .collect();
    DMatrix::from_fn(readings.len(), parameters.len(), |row, k| {
        match (effect.stage(), joints[k]) {
            (Stage::Rigid, Some(joint)) => {
                let (sin, cos) = readings[row].joints[joint].sin_cos();
                [sin, cos]
            }
            (Stage::Elastic, Some(joint)) => {
                let share = torques[row][joint].abs() / sizes[k];
                [share, share * share]
            }
            _ => [time[row], warmth[row]],
        }
    })
}
