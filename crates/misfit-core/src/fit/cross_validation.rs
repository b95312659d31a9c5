//! Cross-validation by pose: errors of poses that a fit has not seen.

use super::folds::FOLDS;
use super::leave_out::without;
use super::noise::Whitener;
use super::residuals::{Errors, residuals, summarise};
use super::solve::{self, Linear, Problem};
use super::triangle::triangle;
use super::{CampaignProblem, Fit, start_values};
use crate::campaign::{Campaign, Reading};
use crate::model::Row;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Below this many poses no cross-validation: a fold would be a pose or two.
const MIN_POSES: usize = 10;
/// Of many readings the linear problem says what a fold's fit leaves of the poses left out: it is believed where the
/// model's sum of squares differs from it by less than this share of it.
const MAX_NONLINEAR_SHARE: f64 = 1e-4;
/// About so many poses of each fold say how a step is straightened, neighbours of all folds together: what changes from pose
/// to pose in a design is there.
const POSES_PER_FOLD: usize = 25;

/// The problem of the poses that are kept, which is known at a point.
struct Kept<'a> {
    problem: CampaignProblem<'a>,
    known: Option<(&'a [f64], Linear)>,
}

impl Problem for Kept<'_> {
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

/// Where a fit of many readings ended.
#[derive(Debug)]
pub(super) struct Ended {
    /// Where its last step began, by free parameters.
    pub before: Vec<f64>,
    /// The problem of each fold there.
    pub folds: Vec<Linear>,
    /// Of all readings that it fitted.
    pub whiteners: Vec<Whitener>,
}

/// A fit and what it fitted.
struct Fitted<'a> {
    campaign: &'a Campaign,
    fit: &'a Fit,
    readings: &'a [&'a Reading],
    whiteners: &'a [Whitener],
    poses: Vec<usize>,
}

/// Errors of poses left out a fifth at a time, none with too few poses; and how many of those fits did not
/// converge.
pub(super) fn cross_validated(
    campaign: &Campaign,
    fit: &Fit,
    readings: &[&Reading],
    whiteners: &[Whitener],
    many: Option<&Ended>,
) -> Option<(Errors, usize)> {
    let poses = super::folds::poses(readings);
    if poses.iter().max().is_none_or(|last| last + 1 < MIN_POSES) {
        return None;
    }
    let fitted = Fitted {
        campaign,
        fit,
        readings,
        whiteners,
        poses,
    };
    // where the fit of all ended, all folds begin: the rows of each are computed there once
    let own = (fit.converged && many.is_none()).then(|| fitted.by_folds());
    let ended = match many {
        Some(ended) => Some((&ended.before[..], &ended.folds[..])),
        None => own.as_ref().map(|(at, folds)| (&at[..], &folds[..])),
    };
    let of_fold = |fold: usize| {
        let one = many.and_then(|ended| fitted.one_step(fold, &ended.before, &ended.folds));
        one.unwrap_or_else(|| fitted.refitted(fold, ended))
    };
    let mut stopped = 0;
    let mut left = vec![Row::zeros(); readings.len()];
    let folds: Vec<(bool, Vec<Row>)> = (0..FOLDS).into_par_iter().map(of_fold).collect();
    for (fold, (converged, rows)) in folds.into_iter().enumerate() {
        stopped += usize::from(!converged);
        for (i, row) in fitted.indices(|own| own == fold).zip(rows) {
            left[i] = row;
        }
    }
    Some((summarise(&left, readings, whiteners), stopped))
}

impl Fitted<'_> {
    /// Readings of the folds wanted.
    fn indices(&self, wanted: impl Fn(usize) -> bool) -> impl Iterator<Item = usize> {
        (0..self.readings.len()).filter(move |&i| wanted(self.poses[i] % FOLDS))
    }

    fn parts(&self, indices: impl Iterator<Item = usize>) -> (Vec<&Reading>, Vec<Whitener>) {
        indices
            .map(|i| (self.readings[i], self.whiteners[i].clone()))
            .unzip()
    }

    fn of_free(&self, p: &[f64]) -> Vec<f64> {
        self.fit.free.iter().map(|&k| p[k]).collect()
    }

    /// Where the fit ended, and the problem of each fold there.
    fn by_folds(&self) -> (Vec<f64>, Vec<Linear>) {
        let fit = self.fit;
        let begin = self.of_free(&fit.values);
        let of_fold = |fold: usize| {
            let (part, whiteners) = self.parts(self.indices(|own| own == fold));
            CampaignProblem::new(&fit.model, &part, &whiteners, &fit.free, &fit.values)
                .linearise(&begin)
        };
        let folds = (0..FOLDS).into_par_iter().map(of_fold).collect();
        (begin, folds)
    }

    /// Start values of the fit without a fold. The prior is about them: about frames that know nothing of the fold left
    /// out.
    fn start(&self, fold: usize) -> Vec<f64> {
        let kept = self.indices(|own| own != fold);
        let kept: Vec<&Reading> = kept.map(|i| self.readings[i]).collect();
        start_values(self.campaign, &self.fit.model, &kept)
    }

    /// What the parameters `p` leave of a fold's readings.
    fn left(&self, fold: usize, p: &[f64]) -> Vec<Row> {
        let tested = self.indices(|own| own == fold);
        let tested: Vec<&Reading> = tested.map(|i| self.readings[i]).collect();
        residuals(&self.fit.model, p, &tested)
    }

    /// What a fit without a fold leaves of it, and whether that converged.
    fn refitted(&self, fold: usize, ended: Option<(&[f64], &[Linear])>) -> (bool, Vec<Row>) {
        let fit = self.fit;
        let start = self.start(fold);
        let centre = self.of_free(&start);
        let (part, whiteners) = self.parts(self.indices(|own| own != fold));
        let kept = Kept {
            problem: CampaignProblem::new(&fit.model, &part, &whiteners, &fit.free, &start),
            known: ended.map(|(begin, folds)| (begin, without(folds, fold))),
        };
        // where it ends, the prior decides; the first step may begin near it
        let begin = ended.map_or(&centre[..], |(begin, _)| begin);
        let found = solve::solve(&kept, begin, &centre, |_, _| {});
        let p = kept.problem.full(&found.p);
        (found.converged, self.left(fold, &p))
    }

    /// The same where one step is enough: of many readings a fifth moves the estimates that little.
    fn one_step(&self, fold: usize, begin: &[f64], folds: &[Linear]) -> Option<(bool, Vec<Row>)> {
        let fit = self.fit;
        let start = self.start(fold);
        let rounds = self.poses.iter().max().map_or(0, |last| last / FOLDS);
        let one_in = (rounds / POSES_PER_FOLD).max(1);
        let some = self.indices(|own| own != fold);
        let some = some.filter(|&i| (self.poses[i] / FOLDS).is_multiple_of(one_in));
        let (part, whiteners) = self.parts(some);
        let some = CampaignProblem::new(&fit.model, &part, &whiteners, &fit.free, &start);
        let centre = self.of_free(&start);
        let (next, step) = solve::full_step(&some, &without(folds, fold), begin, &centre);
        let expected = folds[fold].cost_after(&step);
        let as_expected = |p: &[f64]| {
            let rows = self.left(fold, &some.full(p));
            let own = self.indices(|own| own == fold);
            let squares = own
                .zip(&rows)
                .map(|(i, row)| self.whiteners[i].squares(row));
            let apart = squares.sum::<f64>() - expected;
            (apart.abs() < MAX_NONLINEAR_SHARE * expected).then_some((true, rows))
        };
        as_expected(&next).or_else(|| as_expected(&straightened(&some, begin, &step, &next)))
    }
}

/// Where the model predicts some readings as it would after a step (typical sizes) from `begin` were it linear there, near
/// `next`, to which that leads. What hardly shows in the readings may change much in a step, and bends all else.
fn straightened(
    some: &CampaignProblem<'_>,
    begin: &[f64],
    step: &DVector<f64>,
    next: &[f64],
) -> Vec<f64> {
    let n = next.len();
    let bent = |(before, mut after): (DMatrix<f64>, DMatrix<f64>)| {
        let mut apart = after.column_mut(n);
        apart -= before.columns(0, n) * step + before.column(n);
        triangle(after)
    };
    let pairs = some.blocks(begin).into_iter().zip(some.blocks(next));
    let linear = solve::reduce(pairs.map(bent).collect(), n);
    solve::full_step(some, &linear, next, next).0
}
