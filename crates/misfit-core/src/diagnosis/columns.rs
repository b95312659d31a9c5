//! The columns that tests look at: those of the base model, of effects beside it, and the residual; whitened, by readings.

use super::contrasts::Field;
use super::families::Family;
use super::score::Gram;
use crate::campaign::Reading;
use crate::effects::{AnyEffect, find};
use crate::fit::alike::reads_clock;
use crate::fit::noise::Whitener;
use crate::fit::{CampaignProblem, Fit};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::sync::Arc;

/// Rows of `[base | effects | r]`, whitened and scaled, and where each effect has its columns.
pub fn columns(
    fit: &Fit,
    effects: &[Arc<dyn AnyEffect>],
    readings: &[&Reading],
    whiteners: &[Whitener],
) -> (Vec<Family>, Vec<DMatrix<f64>>) {
    // those that repeats do not tell apart first: their columns are computed once for all repeats
    let clock = |effect: &&Arc<dyn AnyEffect>| reads_clock(&***effect);
    let (last, first): (Vec<_>, Vec<_>) = effects.iter().partition(clock);
    let (mut families, mut blocks) = columns_of(fit, &first, None, readings, whiteners);
    let behind = blocks[0].ncols() - 1 - fit.free.len();
    let (more, own) = columns_of(fit, &last, Some(behind), readings, whiteners);
    insert(&mut blocks, own);
    families.extend(more);
    let place = |own: &Family| effects.iter().position(|e| Arc::ptr_eq(e, &own.effect));
    families.sort_by_key(place);
    (families, blocks)
}

/// The families of some effects, and their rows: `[X | r]`, the columns `behind` so many of others, or `[base | X | r]`.
pub fn columns_of(
    fit: &Fit,
    effects: &[&Arc<dyn AnyEffect>],
    behind: Option<usize>,
    readings: &[&Reading],
    whiteners: &[Whitener],
) -> (Vec<Family>, Vec<DMatrix<f64>>) {
    let mut model = fit.model.clone();
    let mut free = match behind {
        Some(_) => Vec::new(),
        None => fit.free.clone(),
    };
    let mut values = fit.values.clone();
    let mut families: Vec<Family> = Vec::new();
    let mut place = behind.unwrap_or(0);
    for effect in effects {
        let family = Family::new(effect, &model, place);
        place = family.columns.end;
        families.push(family);
        let first = values.len();
        model = model.with(effect);
        let count = model.start().len();
        free.extend(first..count);
        values.resize(count, 0.0);
    }
    let problem = CampaignProblem::new(&model, readings, whiteners, &free, &values);
    let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
    // the effects of the catalogue do nothing with parameters of zero
    let rests =
        |effect: &&Arc<dyn AnyEffect>| reads_clock(&***effect) && find(effect.kind()).is_some();
    let clocked = fit
        .model
        .terms
        .iter()
        .any(|term| reads_clock(&*term.effect));
    let blocks = match !clocked && effects.iter().all(rests) {
        true => problem.blocks_at_rest(&at),
        false => problem.blocks(&at),
    };
    (families, blocks)
}

/// Puts the columns of `own` but its last before the last of `blocks`.
pub fn insert(blocks: &mut [DMatrix<f64>], own: Vec<DMatrix<f64>>) {
    blocks.par_iter_mut().zip(own).for_each(|(block, own)| {
        let (before, more) = (block.ncols() - 1, own.ncols() - 1);
        let mut both = std::mem::take(block).insert_columns(before, more, 0.0);
        both.columns_mut(before, more)
            .copy_from(&own.columns(0, more));
        *block = both;
    });
}

/// `[Q | M r]`ᵀ by rows of the readings.
pub fn field<'a>(
    readings: &'a [&'a Reading],
    whiteners: &[Whitener],
    blocks: &[DMatrix<f64>],
    gram: &Gram,
    base: usize,
) -> Field<'a> {
    let mut places = Vec::with_capacity(readings.len());
    let (mut part, mut first) = (0, 0);
    for whitener in whiteners {
        if whitener.rows > 0 && first == blocks[part].nrows() {
            (part, first) = (part + 1, 0);
        }
        places.push((part, first, whitener.rows));
        first += whitener.rows;
    }
    let inverse = gram.base_inverse();
    let eigen = inverse.clone().symmetric_eigen();
    let mut root = DMatrix::zeros(base, gram.rank);
    let largest = eigen.eigenvalues.iter().copied().fold(0.0, f64::max);
    let mut order: Vec<usize> = (0..base).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    for (column, &k) in order.iter().take(gram.rank).enumerate() {
        let value = eigen.eigenvalues[k].max(0.0).min(largest);
        root.set_column(column, &(eigen.eigenvectors.column(k) * value.sqrt()));
    }
    let back = root.transpose();
    // a reading's rows are columns here, and lie together
    let turn = |block: &DMatrix<f64>| {
        let mut part = DMatrix::zeros(gram.rank + 1, block.nrows());
        let turned = block.columns(0, base).transpose();
        back.mul_to(&turned, &mut part.rows_mut(0, gram.rank));
        let residual = block.column(block.ncols() - 1);
        part.row_mut(gram.rank).tr_copy_from(&residual);
        let along = part.rows(0, gram.rank) * residual;
        (part, along)
    };
    let found: Vec<(DMatrix<f64>, DVector<f64>)> = blocks.par_iter().map(turn).collect();
    let (mut parts, along): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let along = along
        .iter()
        .fold(DVector::zeros(gram.rank), |sum, own| sum + own);
    parts.par_iter_mut().for_each(|part| {
        let taken = part.rows(0, gram.rank).tr_mul(&along);
        let mut left = part.row_mut(gram.rank);
        left -= taken.transpose();
    });
    Field {
        readings,
        rank: gram.rank,
        parts,
        places,
    }
}
