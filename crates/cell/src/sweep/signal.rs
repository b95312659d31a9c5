//! λ of a hidden effect from the plant itself: two noise-free campaigns, with it and without, their difference
//! whitened, and what the model can absorb taken off. No law of the model's is asked.

use crate::campaign::{Campaign, Noise, Reading, Split};
use crate::diagnosis::score::Gram;
use crate::fit::{self, CampaignProblem, noise};
use crate::model::Model;

/// The signal that `with` has over `without` and that a model with all its parameters free does not absorb, in σ²
/// summed over the fitted readings. `values` are the model's parameters where it is linearised, `sigma` the true
/// noise.
pub fn lambda(
    with: &Campaign,
    without: &Campaign,
    model: &Model,
    values: &[f64],
    sigma: &Noise,
) -> f64 {
    let (with, without) = (readings(with, Split::Fit), readings(without, Split::Fit));
    let whiteners = noise::whiteners(model, values, &without, sigma);
    let free: Vec<usize> = (0..values.len()).collect();
    let problem = CampaignProblem::new(model, &without, &whiteners, &free, values);
    let mut blocks = problem.blocks(values);
    let later = fit::residuals(model, values, &with);
    let earlier = fit::residuals(model, values, &without);
    let mut rows = Vec::new();
    for ((later, earlier), whitener) in later.iter().zip(&earlier).zip(&whiteners) {
        let first = rows.len();
        rows.resize(first + whitener.rows, 0.0);
        whitener.apply(&(later - earlier), &mut |i, value| rows[first + i] = value);
    }
    let mut row = 0;
    for block in &mut blocks {
        // in place of the residual
        let (count, last) = (block.nrows(), block.ncols() - 1);
        let mut column = block.column_mut(last);
        for (place, value) in column.iter_mut().zip(&rows[row..row + count]) {
            *place = *value;
        }
        row += count;
    }
    Gram::new(&blocks, free.len()).misfit()
}

/// The readings of one side of the split.
pub fn readings(campaign: &Campaign, split: Split) -> Vec<&Reading> {
    let all = campaign.readings.iter();
    all.filter(|reading| reading.split == split).collect()
}
