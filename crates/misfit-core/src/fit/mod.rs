//! Identification: from a model and a campaign to parameters, what they are worth, and what is left.
//!
//! Held-out readings are never used to fit; where a campaign holds none out, the error beside the fitted one
//! comes from fitting again without a fifth of the poses at a time.

pub mod alike;
mod cross_validation;
mod folds;
pub mod leave_out;
pub mod noise;
pub mod normal;
pub mod paper;
mod problem;
mod rank;
mod residuals;
pub mod solve;
pub mod start;
pub mod triangle;

use crate::campaign::{Campaign, Noise, Reading, Split};
use crate::effects::{AnyEffect, Role};
use crate::model::{Model, Workspace, pose_numbers};
use alike::Alike;
use cross_validation::Ended;
use nalgebra::{DMatrix, DVector};
use noise::{PureError, Source, Whitener};
use rayon::prelude::*;
use solve::{Problem, Solution};
use std::sync::Arc;

pub use folds::{FOLDS, folds};
pub use problem::CampaignProblem;
pub use rank::{LOST, Status, Unobservable};
pub use residuals::{Errors, errors, residuals};

/// Rounds in which noise sizes from the residual settle.
const NOISE_ROUNDS: usize = 6;

/// How to fit.
#[derive(Debug, Clone, Copy)]
pub struct Options {
    /// Cross-validate by pose when no readings are held out.
    pub cross_validate: bool,
}

/// Why there is no fit.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FitError {
    /// Nothing to fit.
    #[error("{campaign}: no reading to fit: all {heldout} are held out")]
    NoReadings {
        /// Campaign file.
        campaign: String,
        /// Held-out readings.
        heldout: usize,
    },
    /// The model cannot be evaluated where the fit has to start.
    #[error(
        "{campaign}: line {line}: the model has no loaded equilibrium here; the arm collapses under its load. \
         Check payload, wrench and link masses, or start from smaller compliances"
    )]
    NoEquilibrium {
        /// Campaign file.
        campaign: String,
        /// Line of the first such reading.
        line: usize,
    },
    /// An effect's law has no value, or no slope, at a reading.
    #[error("{campaign}: line {line}: the law of {effect} has no value or no slope here; {why}")]
    NoNumber {
        /// Campaign file.
        campaign: String,
        /// Line of the first such reading.
        line: usize,
        /// The effect.
        effect: String,
        /// What it lacks, or what is accepted.
        why: String,
    },
    /// More than the memory of a usual machine holds.
    #[error(
        "{campaign}: {readings} readings of up to {columns} columns are too much for a diagnosis: {gigabytes} GB of \
         memory; accepted: about {most} readings. Hold the others out: a column of the table, named by split"
    )]
    TooLarge {
        /// Campaign file.
        campaign: String,
        /// Readings to fit.
        readings: usize,
        /// Parameters of the model and of all effects that are tried.
        columns: usize,
        /// What it would take, GB.
        gigabytes: usize,
        /// Readings of this kind that are accepted.
        most: usize,
    },
}

/// Where the held-out error comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HeldoutBy {
    /// The campaign's own split.
    Split,
    /// Five-fold cross-validation by pose.
    CrossValidation,
}

/// What the fit took the noise to be.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseUsed {
    /// Where its size comes from.
    pub source: Source,
    /// One standard deviation of a coordinate, root mean square over the readings, m.
    pub position_sigma: f64,
    /// The same of an angle, rad; none without orientations.
    pub orientation_sigma: Option<f64>,
    /// What the whitening assumes.
    pub shape: Noise,
    /// Variance found over variance assumed in the whitening.
    pub factor: f64,
    /// Degrees of freedom of the factor; none if it is not an estimate.
    pub dof: Option<usize>,
    /// Pure error of repeats, if there are enough.
    pub replicates: Option<PureError>,
}

/// A fitted model.
#[derive(Debug, Clone)]
pub struct Fit {
    /// The model.
    pub model: Model,
    /// All parameters, SI.
    pub values: Vec<f64>,
    /// One standard deviation of each that is estimated, SI.
    pub std: Vec<Option<f64>>,
    /// What became of each parameter.
    pub status: Vec<Status>,
    /// Of the estimated parameters (by `free`), SI.
    pub covariance: DMatrix<f64>,
    /// Indices of the parameters that the fit varied.
    pub free: Vec<usize>,
    /// What the readings do not say, in words.
    pub unobservable: Vec<Unobservable>,
    /// Directions of parameter space that the readings fix.
    pub rank: usize,
    /// Errors of the fitted readings.
    pub fit: Errors,
    /// Errors of readings not used to fit.
    pub heldout: Option<Errors>,
    /// Where those come from.
    pub heldout_by: Option<HeldoutBy>,
    /// Numbers of readings: fitted, held out.
    pub readings: (usize, usize),
    /// Noise.
    pub noise: NoiseUsed,
    /// Did the fit converge?
    pub converged: bool,
    /// Steps taken.
    pub iterations: usize,
    /// Sum of squares of the whitened misfit, prior included, at each step.
    pub costs: Vec<f64>,
    /// What its cross-validation begins with; kept where there are many readings.
    ended: Option<Arc<Ended>>,
}

impl Fit {
    /// Standard normal or Student quantile for a two-sided 95 % interval.
    pub fn quantile(&self) -> f64 {
        use statrs::distribution::{ContinuousCDF, StudentsT};
        let student = self
            .noise
            .dof
            .and_then(|dof| StudentsT::new(0.0, 1.0, dof as f64).ok());
        student.map_or(1.959_963_984_540_054, |t| t.inverse_cdf(0.975))
    }

    /// Pairs of estimated parameters that are known together much better than apart: indices and correlation, those
    /// of at least `least` in size, strongest first.
    pub fn correlations(&self, least: f64) -> Vec<(usize, usize, f64)> {
        let shown: Vec<(usize, usize)> = self
            .free
            .iter()
            .enumerate()
            .filter(|&(_, &k)| self.status[k] == Status::Estimated)
            .map(|(row, &k)| (row, k))
            .collect();
        let mut found = Vec::new();
        for (place, &(i, a)) in shown.iter().enumerate() {
            for &(j, b) in &shown[..place] {
                let scale = (self.covariance[(i, i)] * self.covariance[(j, j)]).sqrt();
                let value = self.covariance[(i, j)] / scale;
                if value.abs() >= least {
                    found.push((b, a, value));
                }
            }
        }
        found.sort_by(|x, y| y.2.abs().total_cmp(&x.2.abs()));
        found
    }

    /// Probability of estimates this far from zero for all parameters of an effect together, if it had none: Wald's
    /// test. 1 if none of them is estimated.
    pub fn p_value(&self, effect: &str) -> f64 {
        use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};
        let Some(term) = self.model.term(effect) else {
            return 1.0;
        };
        let own = term.first..term.first + term.parameters.len();
        let rows: Vec<usize> = (0..self.free.len())
            .filter(|&row| {
                let k = self.free[row];
                own.contains(&k) && self.status[k] == Status::Estimated
            })
            .collect();
        let covariance = self.covariance.select_rows(&rows).select_columns(&rows);
        let values = DVector::from_iterator(
            rows.len(),
            rows.iter().map(|&row| self.values[self.free[row]]),
        );
        let Some(factor) = covariance.cholesky() else {
            return 1.0;
        };
        let squares = values.dot(&factor.solve(&values));
        let dof = rows.len() as f64;
        let p = match self.noise.dof {
            Some(own) => FisherSnedecor::new(dof, own as f64)
                .map(|f| f.sf(squares / dof))
                .ok(),
            None => ChiSquared::new(dof).map(|c| c.sf(squares)).ok(),
        };
        p.unwrap_or(1.0)
    }

    /// Adds the error of poses not fitted, from fits without a fifth of them at a time; nothing where the campaign holds
    /// readings out, or has too few poses.
    pub fn cross_validate(&mut self, campaign: &Campaign) {
        if self.readings.1 > 0 {
            return;
        }
        let readings = campaign.readings.iter();
        let readings: Vec<&Reading> = readings.filter(|r| r.split == Split::Fit).collect();
        let ended = self.ended.clone().filter(|_| self.converged);
        let ended = ended.filter(|ended| ended.whiteners.len() == readings.len());
        let own;
        let whiteners = match &ended {
            Some(ended) => &ended.whiteners,
            None => {
                // where the fit itself took the shape of the noise
                let at = match self.noise.source {
                    Source::Residual => self.values.clone(),
                    _ => start_values(campaign, &self.model, &readings),
                };
                own = noise::whiteners(&self.model, &at, &readings, &self.noise.shape);
                &own
            }
        };
        let found = cross_validation::cross_validated(
            campaign,
            self,
            &readings,
            whiteners,
            ended.as_deref(),
        );
        let Some((errors, stopped)) = found else {
            return;
        };
        self.heldout = Some(errors);
        self.heldout_by = Some(HeldoutBy::CrossValidation);
        if self.fit.position_rms_m.is_finite() {
            without_equilibrium(campaign, self);
        }
        if stopped > 0 {
            self.unobservable.push(Unobservable {
                what: "cross-validated error".to_owned(),
                why: format!("{stopped} of its {FOLDS} fits did not converge: take it as a bound"),
            });
        }
    }

    /// Position of a parameter by effect and name.
    pub fn index(&self, effect: &str, name: &str) -> Option<usize> {
        self.model
            .parameters()
            .position(|(id, parameter)| id == effect && parameter.name == name)
    }
}

/// Fits a model to a campaign.
///
/// # Errors
/// If there is nothing to fit, or no equilibrium at the start. Not converging is a result.
pub fn fit(
    campaign: &Campaign,
    model: &Model,
    options: &Options,
    on_step: impl FnMut(&str),
) -> Result<Fit, FitError> {
    fit_from(campaign, model, options, None, on_step)
}

/// The same fit without cross-validation, faster where one with other effects is near: it begins at the values that they
/// share, and ends where [`fit`] does.
///
/// # Errors
/// As [`fit`].
pub fn refit(campaign: &Campaign, model: &Model, near: &Fit) -> Result<Fit, FitError> {
    let options = Options {
        cross_validate: false,
    };
    fit_from(campaign, model, &options, Some(near), |_| {})
}

fn fit_from(
    campaign: &Campaign,
    model: &Model,
    options: &Options,
    near: Option<&Fit>,
    mut on_step: impl FnMut(&str),
) -> Result<Fit, FitError> {
    let of = |split: Split| -> Vec<&Reading> {
        let readings = campaign.readings.iter();
        readings.filter(|reading| reading.split == split).collect()
    };
    let (fitted, heldout) = (of(Split::Fit), of(Split::Heldout));
    if fitted.is_empty() {
        return Err(FitError::NoReadings {
            campaign: campaign.name.clone(),
            heldout: heldout.len(),
        });
    }
    let start = start_values(campaign, model, &fitted);
    // of the fitted ones the estimate sees to it
    if !heldout.is_empty()
        && let Some(error) = no_number(campaign, model, &start, false)
    {
        return Err(error);
    }
    let estimate = estimate(campaign, model, &fitted, start, near, &mut on_step)?;
    let factor = &estimate.solution.linear.factor;
    if factor.iter().any(|x| !x.is_finite())
        && let Some(error) = no_number(campaign, model, &estimate.p, true)
    {
        return Err(error);
    }
    let left = residuals::residuals_of(&estimate.alike, model, &estimate.p, &fitted);
    let errors = residuals::summarise(&left, &fitted, &estimate.whiteners);
    let held = (!heldout.is_empty()).then(|| {
        let whiteners = noise::whiteners(model, &estimate.p, &heldout, &estimate.noise);
        self::errors(model, &estimate.p, &heldout, &whiteners)
    });
    let mut found = finish(model, estimate, errors, held, (&fitted, heldout.len()));
    without_equilibrium(campaign, &mut found);
    if options.cross_validate {
        on_step("cross-validation");
        found.cross_validate(campaign);
    }
    Ok(found)
}

/// The first reading at which an effect's law has no value; with `slopes` also where only its slope is none.
fn no_number(campaign: &Campaign, model: &Model, p: &[f64], slopes: bool) -> Option<FitError> {
    let find = |workspace: &mut Workspace, reading: &Reading| {
        if !slopes && workspace.predict(model, p, reading).settled {
            return None;
        }
        let id = workspace.lost(model, p, reading)?;
        let needs = model.term(id).map_or(&[][..], |term| term.effect.needs());
        let lacking = needs.iter().find(|need| !need.is_said(reading));
        let why = lacking.map_or_else(
            || {
                "accepted: laws that have both at every reading, from their start values on"
                    .to_owned()
            },
            |need| format!("it {}", need.sentence()),
        );
        Some(FitError::NoNumber {
            campaign: campaign.name.clone(),
            line: reading.line,
            effect: id.to_owned(),
            why,
        })
    };
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    // the first reading of the first group is the first of all
    let groups = Alike::of(model, &readings).groups;
    let found = groups.par_iter().map_init(
        || Workspace::new(&model.setup),
        |workspace, group| find(workspace, readings[group[0]]),
    );
    found.find_map_first(|error| error)
}

/// Do laws that are to be tried beside a model have a value and slopes at every reading?
///
/// # Errors
/// The first that has none, and where.
pub fn check_laws(
    campaign: &Campaign,
    model: &Model,
    own: &[Arc<dyn AnyEffect>],
) -> Result<(), FitError> {
    for effect in own.iter().filter(|effect| !model.has(effect.id())) {
        let mut alone = model.with(effect);
        let p = alone.start();
        alone.terms.retain(|term| Arc::ptr_eq(&term.effect, effect));
        if let Some(error) = no_number(campaign, &alone, &p, true) {
            return Err(error);
        }
    }
    Ok(())
}

/// Errors that are not numbers, said in words: the model has no equilibrium at some reading, or an effect's law no
/// value. A fit that ends so has not converged.
fn without_equilibrium(campaign: &Campaign, found: &mut Fit) {
    let fitted = !found.fit.position_rms_m.is_finite();
    let heldout = found.heldout.is_some_and(|e| !e.position_rms_m.is_finite());
    if !fitted && !heldout {
        return;
    }
    let why = match no_number(campaign, &found.model, &found.values, false) {
        Some(FitError::NoNumber { line, effect, .. }) => {
            format!("the law of {effect} has no value at some of them, line {line} the first")
        }
        _ => {
            "the model has no loaded equilibrium at some of them: the arm collapses under its load"
                .to_owned()
        }
    };
    let say = |what: &str| Unobservable {
        what: what.to_owned(),
        why: why.clone(),
    };
    if fitted {
        found.unobservable.push(say("error of the fitted readings"));
        found.converged = false;
    }
    if heldout {
        found.unobservable.push(say("error of readings not fitted"));
        found.heldout = None;
    }
}

/// Start values: frames in closed form, everything else as the model says.
pub(crate) fn start_values(campaign: &Campaign, model: &Model, readings: &[&Reading]) -> Vec<f64> {
    values_with(model, &start::frames(campaign, &model.setup, readings))
}

/// Start values with these frames, where the model does not hold others.
pub(crate) fn values_with(model: &Model, found: &start::Start) -> Vec<f64> {
    let mut p = model.start();
    for term in &model.terms {
        let poses = match term.effect.role() {
            Some(Role::TrackerFrame) => std::slice::from_ref(&found.base_from_tracker),
            Some(Role::TargetFrame) => &found.link_from_target[..],
            _ => continue,
        };
        for (index, pose) in poses.iter().enumerate() {
            for (k, value) in pose_numbers(pose).into_iter().enumerate() {
                if term.parameters[6 * index + k].vary {
                    p[term.first + 6 * index + k] = value;
                }
            }
        }
    }
    p
}

/// Does the model have an equilibrium at every reading?
fn settled(
    campaign: &Campaign,
    model: &Model,
    readings: &[&Reading],
    p: &[f64],
) -> Result<(), FitError> {
    let settled = Alike::of(model, readings).map(model, readings, |workspace, reading| {
        workspace.predict(model, p, reading).settled
    });
    let Some(first) = settled.iter().position(|settled| !settled) else {
        return Ok(());
    };
    let lost = no_number(campaign, model, p, false);
    Err(lost.unwrap_or_else(|| FitError::NoEquilibrium {
        campaign: campaign.name.clone(),
        line: readings[first].line,
    }))
}

/// A converged (or stopped) estimate with the noise it used.
struct Estimate {
    p: Vec<f64>,
    solution: Solution,
    free: Vec<usize>,
    alike: Alike,
    noise: Noise,
    whiteners: Vec<Whitener>,
    used: NoiseUsed,
    costs: Vec<f64>,
}

/// Fits with the noise settled: from repeats, the file, or in rounds from what is left.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
fn estimate(
    campaign: &Campaign,
    model: &Model,
    readings: &[&Reading],
    start: Vec<f64>,
    near: Option<&Fit>,
    on_step: &mut impl FnMut(&str),
) -> Result<Estimate, FitError> {
    let with_orientation = readings.iter().any(|reading| reading.orientation.is_some());
    let groups = crate::campaign::repeats(readings, campaign.noise.as_ref());
    let free: Vec<usize> = model
        .parameters()
        .enumerate()
        .filter(|(_, (_, parameter))| parameter.vary)
        .map(|(index, _)| index)
        .collect();
    // the shape of the covariance: the campaign's, else isotropic with sizes still to be found
    let mut shape = campaign
        .noise
        .unwrap_or_else(|| noise::isotropic(1e-4, 1e-4));
    let alike = Alike::of(model, readings);
    let whitened =
        |p: &[f64], shape: &Noise| noise::whiteners_alike(&alike, model, p, readings, shape);
    let mut whiteners = whitened(&start, &shape);
    let replicates = noise::pure_error(readings, &whiteners, &groups);
    if let (None, Some(pure)) = (campaign.noise, replicates) {
        shape = Noise {
            force: pure.force.sqrt(),
            torque: pure.torque.sqrt(),
            ..noise::isotropic(pure.position.sqrt(), pure.orientation.sqrt())
        };
        whiteners = whitened(&start, &shape);
    }
    let source = match (replicates, campaign.noise) {
        (Some(_), _) => Source::Replicates,
        (None, Some(_)) => Source::Campaign,
        (None, None) => Source::Residual,
    };
    let rounds = match source {
        Source::Residual => NOISE_ROUNDS,
        _ => 1,
    };
    let centre: Vec<f64> = free.iter().map(|&k| start[k]).collect();
    let mut p = start.clone();
    if let Some(near) = near {
        for (k, (effect, parameter)) in model.parameters().enumerate() {
            if let Some(index) = near
                .index(effect, &parameter.name)
                .filter(|_| parameter.vary)
            {
                p[k] = near.values[index];
            }
        }
        if source == Source::Residual {
            shape = near.noise.shape;
            whiteners = whitened(&p, &shape);
        }
    }
    // with none held out the folds of the cross-validation begin where the fit ends
    let of_fold = match campaign.readings.len() == readings.len() {
        true => folds(readings).0,
        false => Vec::new(),
    };
    let mut solution = None;
    let mut dof = None;
    let mut steps = 0;
    let mut costs = Vec::new();
    for round in 0..rounds {
        let problem = CampaignProblem::of(alike.clone(), model, readings, &whiteners, &free, &p)
            .in_folds(&of_fold);
        let mut begin: Vec<f64> = free.iter().map(|&k| p[k]).collect();
        if source != Source::Residual {
            begin = problem.ahead(begin, &centre);
        }
        // what rounds find is the next one's prior, until the noise has settled
        let about = match source {
            Source::Residual => &begin,
            _ => &centre,
        };
        let found = solve::solve(&problem, &begin, about, |iteration, cost| {
            on_step(&format!("step {iteration}, cost {cost:.6e}"));
            costs.push(cost);
        });
        if found.iterations == 0 && !found.linear.cost().is_finite() {
            settled(campaign, model, readings, &start)?;
        }
        p = problem.full(&found.p);
        steps += found.iterations;
        if source == Source::Residual {
            let rank = solve::Spectrum::of(found.linear.factor.clone()).rank;
            let before = (shape.position, shape.orientation);
            shape = from_residual(&alike, model, &p, readings, rank);
            whiteners = whitened(&p, &shape);
            dof = Some(rows(&whiteners).saturating_sub(rank).max(1));
            let settled = (shape.position / before.0 - 1.0).abs() < 0.01
                && (!with_orientation || (shape.orientation / before.1 - 1.0).abs() < 0.01);
            solution = Some(found);
            if settled && round > 0 {
                break;
            }
        } else {
            solution = Some(found);
        }
    }
    let Some(mut solution) = solution else {
        unreachable!("there is at least one round")
    };
    solution.iterations = steps;
    if source == Source::Residual {
        // the factor belongs to the noise sizes of the round before
        let problem = CampaignProblem::of(alike.clone(), model, readings, &whiteners, &free, &p)
            .in_folds(&of_fold);
        solution.linear = problem.linearise(&solution.p);
        solution.before = solution.p.clone();
    }
    let pure_factor = match (source, campaign.noise, replicates) {
        (Source::Replicates, Some(_), Some(pure)) => {
            dof = Some(pure.dof);
            pure.whitened
        }
        (Source::Replicates, None, Some(pure)) => {
            dof = Some(pure.dof);
            1.0
        }
        _ => 1.0,
    };
    let mean = |value: fn(&Whitener) -> f64| {
        whiteners.iter().map(value).sum::<f64>() / whiteners.len() as f64
    };
    let used = NoiseUsed {
        source,
        shape,
        position_sigma: (mean(|w| w.position_variance) * pure_factor).sqrt(),
        orientation_sigma: with_orientation
            .then(|| (mean(|w| w.orientation_variance) * pure_factor).sqrt()),
        factor: pure_factor,
        dof,
        replicates,
    };
    Ok(Estimate {
        p,
        solution,
        free,
        alike,
        noise: shape,
        whiteners,
        used,
        costs,
    })
}

fn rows(whiteners: &[Whitener]) -> usize {
    whiteners.iter().map(|w| w.rows).sum()
}

/// Sizes of isotropic noise from what the fit leaves, its degrees of freedom shared by rows.
fn from_residual(
    alike: &Alike,
    model: &Model,
    p: &[f64],
    readings: &[&Reading],
    rank: usize,
) -> Noise {
    let residuals = residuals::residuals_of(alike, model, p, readings);
    let (mut position, mut orientation, mut turned) = (0.0, 0.0, 0usize);
    for (residual, reading) in residuals.iter().zip(readings) {
        position += residual.fixed_rows::<3>(0).norm_squared();
        if reading.orientation.is_some() {
            orientation += residual.fixed_rows::<3>(3).norm_squared();
            turned += 3;
        }
    }
    let all = (3 * readings.len() + turned) as f64;
    let left = (all - rank as f64).max(1.0) / all;
    let size = |squares: f64, rows: usize| {
        let variance = squares / (rows as f64 * left).max(1.0);
        variance.sqrt().max(noise::FLOOR)
    };
    noise::isotropic(
        size(position, 3 * readings.len()),
        size(orientation, turned.max(1)),
    )
}

/// From an estimate to what it is worth.
fn finish(
    model: &Model,
    estimate: Estimate,
    fit: Errors,
    heldout: Option<Errors>,
    (fitted, heldout_count): (&[&Reading], usize),
) -> Fit {
    let judged = rank::judge(
        model,
        &estimate.free,
        &estimate.solution,
        estimate.used.factor,
    );
    Fit {
        model: model.clone(),
        values: estimate.p,
        std: judged.std,
        status: judged.status,
        covariance: judged.covariance,
        free: estimate.free,
        unobservable: judged.unobservable,
        rank: judged.rank,
        fit,
        heldout,
        heldout_by: heldout.map(|_| HeldoutBy::Split),
        readings: (fitted.len(), heldout_count),
        noise: estimate.used,
        converged: estimate.solution.converged,
        iterations: estimate.solution.iterations,
        costs: estimate.costs,
        ended: (!estimate.solution.linear.folds.is_empty()).then(|| {
            Arc::new(Ended {
                before: estimate.solution.before,
                folds: estimate.solution.linear.folds,
                whiteners: estimate.whiteners,
            })
        }),
    }
}
