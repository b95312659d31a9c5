//! Cross-validation by pose: errors of poses that a fit has not seen.

use super::noise::Whitener;
use super::residuals::{Errors, residuals, summarise};
use super::solve::{self, Linear, Problem};
use super::{CampaignProblem, Fit, alike, start_values};
use crate::campaign::{Campaign, Reading};
use crate::model::Row;
use rayon::prelude::*;

/// Folds of the cross-validation by pose.
pub const FOLDS: usize = 5;
/// Below this many poses no cross-validation: a fold would be a pose or two.
const FEWEST_POSES: usize = 10;
/// Of many readings the linear problem says what a fold's fit leaves of the poses left out: it is believed where the model
/// agrees with the sum of squares to this share of it.
const STRAIGHT: f64 = 1e-4;

/// Label of a reading's pose for grouping: its own, or its encoder angles.
pub fn pose_key(reading: &Reading) -> (String, Vec<u64>) {
    match &reading.pose {
        Some(label) => (label.clone(), Vec::new()),
        None => (
            String::new(),
            reading.joints.iter().map(|x| x.to_bits()).collect(),
        ),
    }
}

/// Fold of each reading, 0 to [`FOLDS`] - 1, poses in order of appearance going round; and the number of poses.
pub fn folds(readings: &[&Reading]) -> (Vec<usize>, usize) {
    let poses = alike::numbered(readings.iter().map(|reading| pose_key(reading)));
    let count = poses.iter().max().map_or(0, |last| last + 1);
    (poses.into_iter().map(|pose| pose % FOLDS).collect(), count)
}

/// The problem of the poses that are kept, which is known at a point.
struct Fold<'a> {
    problem: CampaignProblem<'a>,
    known: Option<(&'a [f64], Linear)>,
}

impl Problem for Fold<'_> {
    fn linearise(&self, p: &[f64]) -> Linear {
        match &self.known {
            Some((place, linear)) if *place == p => linear.clone(),
            _ => self.problem.linearise(p),
        }
    }

    fn scale(&self) -> &[f64] {
        self.problem.scale()
    }

    fn bounds(&self) -> &[(f64, f64)] {
        self.problem.bounds()
    }

    fn prior(&self) -> f64 {
        self.problem.prior()
    }
}

/// Errors of poses left out a fifth at a time, none with too few poses; and how many of those fits did not
/// converge.
pub(super) fn cross_validated(
    campaign: &Campaign,
    fit: &Fit,
    readings: &[&Reading],
    whiteners: &[Whitener],
) -> Option<(Errors, usize)> {
    let (folds, poses) = folds(readings);
    if poses < FEWEST_POSES {
        return None;
    }
    let model = &fit.model;
    let of_free = |p: &[f64]| -> Vec<f64> { fit.free.iter().map(|&k| p[k]).collect() };
    let indices = |wanted: &dyn Fn(usize) -> bool| -> Vec<usize> {
        (0..readings.len()).filter(|&i| wanted(folds[i])).collect()
    };
    let parts = |indices: &[usize]| -> (Vec<&Reading>, Vec<Whitener>) {
        let part = indices.iter().map(|&i| (readings[i], whiteners[i].clone()));
        part.unzip()
    };
    // where the fit of all ended, all folds begin: the rows of each are computed there once
    let many = fit
        .folds
        .as_ref()
        .filter(|_| fit.converged && fit.readings.0 == readings.len());
    let ended = match many {
        Some((before, folds)) => Some((before.clone(), folds.clone())),
        None => fit.converged.then(|| {
            let begin = of_free(&fit.values);
            let of_fold = |fold: usize| {
                let (part, whiteners) = parts(&indices(&|own| own == fold));
                CampaignProblem::new(model, &part, &whiteners, &fit.free, &fit.values)
                    .linearise(&begin)
            };
            let folds: Vec<Linear> = (0..FOLDS).into_par_iter().map(of_fold).collect();
            (begin, folds)
        }),
    };
    let of_fold = |fold: usize| {
        let (kept, out) = (indices(&|own| own != fold), indices(&|own| own == fold));
        let (part, of_part) = parts(&kept);
        // the prior is about frames that know nothing of the fold left out, and decides where the fit ends; the
        // first step may begin near it
        let start = start_values(campaign, model, &part);
        let centre = of_free(&start);
        let problem = Fold {
            problem: CampaignProblem::new(model, &part, &of_part, &fit.free, &start),
            known: ended.as_ref().map(|(begin, folds)| {
                let others = folds.iter().enumerate().filter(|(own, _)| *own != fold);
                (&begin[..], Linear::joined(others.map(|(_, linear)| linear)))
            }),
        };
        let tested: Vec<&Reading> = out.iter().map(|&i| readings[i]).collect();
        let left = |p: &[f64]| residuals(model, &problem.problem.full(p), &tested);
        // of many readings a fifth moves the estimates so little that one step does
        let one_step = || {
            let (begin, folds) = many?;
            let (_, linear) = problem.known.as_ref()?;
            let (next, step) = solve::full_step(&problem, linear, begin, &centre);
            let expected = folds[fold].cost_after(&step);
            let seen_to = |p: &[f64]| {
                let rows = left(p);
                let squares = rows.iter().zip(&out);
                let squares: f64 = squares.map(|(row, &i)| whiteners[i].squares(row)).sum();
                ((squares - expected).abs() < STRAIGHT * expected).then_some((true, rows))
            };
            seen_to(&next).or_else(|| {
                let problem = &problem.problem;
                seen_to(&problem.straightened(begin, &step, &next)?)
            })
        };
        let (converged, rows) = one_step().unwrap_or_else(|| {
            let begin = ended.as_ref().map_or(&centre, |(begin, _)| begin);
            let found = solve::solve(&problem, begin, &centre, |_, _| {});
            (found.converged, left(&found.p))
        });
        let rows: Vec<(usize, Row)> = out.into_iter().zip(rows).collect();
        (converged, rows)
    };
    let mut stopped = 0;
    let mut left = vec![Row::zeros(); readings.len()];
    let folds: Vec<_> = (0..FOLDS).into_par_iter().map(of_fold).collect();
    for (converged, rows) in folds {
        stopped += usize::from(!converged);
        for (i, row) in rows {
            left[i] = row;
        }
    }
    Some((summarise(&left, readings, whiteners), stopped))
}
