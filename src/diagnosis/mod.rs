//! What is missing: from a campaign and a base model to a verdict.
//!
//! Screen outliers inside pose groups; take the noise from repeats; fit the base model; say which effects the
//! campaign cannot see at all; score all others with the base model partialled out; rank by evidence; join
//! those that cannot be told apart; refit with the best; test what is left; and go on while something is named.

mod contrasts;
mod folds;
pub mod ripple;
mod score;
mod screen;

pub use contrasts::Contrast;

use crate::campaign::{Campaign, Reading, Split};
use crate::effects::{AnyEffect, CATALOGUE};
use crate::fit::noise::{self, Source};
use crate::fit::{self, CampaignProblem, Fit, FitError, Options};
use crate::model::Model;
use contrasts::Field;
use nalgebra::DMatrix;
use ripple::Wave;
use score::{Against, Gram};
use std::ops::Range;
use std::sync::Arc;

/// Families whose expected λ at typical size is below this are invisible to a campaign.
pub const VISIBLE: f64 = 9.0;
/// Probability of any false alarm in one round of tests.
const ALARM: f64 = 1e-3;
/// Families this near to the best, in nats, are its aliases.
const NEAR: f64 = 3.0;
/// A named effect that explains less than this of the excess is not what is missing.
const ENOUGH: f64 = 0.8;
/// Effects named at most.
const MOST: usize = 3;

/// The answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing is detectable.
    Nothing,
    /// These effects are missing, and explain what there was.
    Named,
    /// They are missing, but something is left: their form may be wrong.
    NamedIncomplete,
    /// One of these; this campaign cannot tell which.
    Alias,
    /// Something that the catalogue does not hold.
    Unknown,
}

/// One effect as a candidate.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Candidate {
    /// Effect.
    pub effect: &'static str,
    /// Log evidence against the base model, nats.
    pub log_evidence: f64,
    /// Signal found, σ².
    pub lambda: f64,
    /// Probability of as much from noise alone.
    pub p_value: f64,
    /// Share of the misfit above noise that it explains.
    pub explained: f64,
}

/// An effect that the campaign cannot see.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct CannotSee {
    /// Effect.
    pub effect: &'static str,
    /// Why.
    pub why: String,
}

/// A variable that the misfit goes with.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Where {
    /// Joint.
    pub variable: String,
    /// What was tested.
    pub pattern: &'static str,
    /// Probability of as much from noise alone.
    pub p_value: f64,
}

/// A diagnosis.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// Its effects.
    pub effects: Vec<&'static str>,
    /// Effects added one after the other, also where the verdict is a set of aliases.
    pub named: Vec<&'static str>,
    /// Contrasts of the base model's misfit.
    pub contrasts: Vec<Contrast>,
    /// Joints that the misfit goes with, most likely first.
    pub variables: Vec<Where>,
    /// Effects tried on the base model, best first.
    pub candidates: Vec<Candidate>,
    /// Effects that the campaign cannot see.
    pub cannot_see: Vec<CannotSee>,
    /// The base model's fit.
    pub base: Fit,
    /// The fit with the named effects; the base's if none.
    pub fit: Fit,
    /// Effects added one after the other, each with the fit that then was reached.
    pub steps: Vec<(&'static str, Fit)>,
    /// Did the caller's wish end the search?
    pub stopped: bool,
    /// Contrasts of what the named effects leave.
    pub contrasts_left: Vec<Contrast>,
    /// Joints that this goes with.
    pub variables_left: Vec<Where>,
    /// An effect that alarms still, but with which poses left out are predicted no better.
    pub refused: Option<&'static str>,
    /// Waves of the named `gear_ripple`, in the order in which they were found.
    pub waves: Vec<Wave>,
    /// Lines of the rejected readings.
    pub rejected: Vec<usize>,
}

/// Diagnoses what a model lacks.
///
/// # Errors
/// As [`fit::fit`].
pub fn diagnose(
    campaign: &Campaign,
    model: &Model,
    options: &Options,
    on_step: impl FnMut(&str),
) -> Result<Diagnosis, FitError> {
    diagnose_until(campaign, model, options, on_step, |_, _, _| false)
}

/// The same, ended early where `enough` says so of the number of steps so far, the last effect and its fit.
///
/// # Errors
/// As [`fit::fit`].
pub fn diagnose_until(
    campaign: &Campaign,
    model: &Model,
    options: &Options,
    mut on_step: impl FnMut(&str),
    enough: impl Fn(usize, Option<&str>, &Fit) -> bool,
) -> Result<Diagnosis, FitError> {
    on_step("fitting the base model");
    let mut campaign = campaign.clone();
    let mut base = finite_fit(&campaign, model, None)?;
    let rejected = reject(&mut campaign, &base);
    if !rejected.is_empty() {
        base = finite_fit(&campaign, model, None)?;
    }
    on_step("scoring the catalogue");
    let first = analyse(&campaign, &base, true);
    let mut current = base.clone();
    let mut last = first.clone();
    let mut look = analyse_again(&first);
    let mut named: Vec<&'static str> = Vec::new();
    let mut aliases: Vec<&'static str> = Vec::new();
    let mut waves: Vec<Wave> = Vec::new();
    let mut steps: Vec<(&'static str, Fit)> = Vec::new();
    let mut refused = None;
    let mut stopped = false;
    let mut verdict = Verdict::Nothing;
    // where the noise is what is left, nobody knows how much is still to be explained
    let left_over = |named: &[&str], current: &Fit| {
        let enough = base.noise.source == Source::Residual || explained(&base, current) >= ENOUGH;
        if !named.is_empty() && enough {
            Verdict::NamedIncomplete
        } else {
            Verdict::Unknown
        }
    };
    while look.alarm {
        if enough(steps.len(), steps.last().map(|step| step.0), &current) {
            stopped = true;
            verdict = left_over(&named, &current);
            break;
        }
        let Some(best) = look.best else {
            // something is there that no family explains
            verdict = left_over(&named, &current);
            break;
        };
        if named.len() == MOST {
            verdict = Verdict::NamedIncomplete;
            break;
        }
        if named.is_empty() {
            aliases = look.near.clone();
        }
        on_step(&format!("refitting with {best}"));
        let found = if best == ripple::EFFECT {
            &last.waves[..]
        } else {
            &[]
        };
        let Some(model) = extended(&current.model, best, found) else {
            break;
        };
        let next = finite_fit(&campaign, &model, Some(&current))?;
        // one search finds the waves that there are
        let waves_known = best == ripple::EFFECT || named.contains(&ripple::EFFECT);
        let analysis = analyse(&campaign, &next, !waves_known);
        look = analyse_again(&analysis);
        if look.alarm && !predicts_better(&campaign, &base, &current, &next) {
            refused = Some(best);
            verdict = left_over(&named, &current);
            break;
        }
        if best == ripple::EFFECT {
            waves = last.waves;
        }
        (current, last) = (next, analysis);
        named.push(best);
        steps.push((best, current.clone()));
        verdict = Verdict::Named;
    }
    let mut effects = named.clone();
    match verdict {
        Verdict::Named if named.len() == 1 && aliases.len() > 1 => {
            verdict = Verdict::Alias;
            effects = aliases;
        }
        Verdict::Unknown | Verdict::Nothing => {
            effects.clear();
            named.clear();
            waves.clear();
            steps.clear();
            current = base.clone();
        }
        _ => {}
    }
    if options.cross_validate && base.heldout.is_none() {
        on_step("cross-validation");
        base = fit::fit(&campaign, &base.model, options, |_| {})?;
        for (_, step) in &mut steps {
            *step = fit::fit(&campaign, &step.model, options, |_| {})?;
        }
        current = steps.last().map_or(&base, |step| &step.1).clone();
    }
    ripple::settle(&mut waves, &current);
    Ok(Diagnosis {
        verdict,
        effects,
        named,
        contrasts: first.contrasts,
        variables: first.variables,
        candidates: first.candidates,
        cannot_see: first.cannot_see,
        base,
        fit: current,
        steps,
        stopped,
        contrasts_left: last.contrasts,
        variables_left: last.variables,
        refused,
        waves,
        rejected,
    })
}

/// Log evidence (nats) of an effect for a fit without it.
pub fn evidence(campaign: &Campaign, without: &Fit, effect: &Arc<dyn AnyEffect>) -> f64 {
    let readings = fitted(campaign);
    let whiteners = noise::whiteners(
        &without.model,
        &without.values,
        &readings,
        &without.noise.shape,
    );
    let model = without.model.with(effect);
    let base = without.free.len();
    let mut values = without.values.clone();
    let mut free = without.free.clone();
    free.extend(values.len()..model.start().len());
    values.resize(model.start().len(), 0.0);
    let problem = CampaignProblem::new(&model, &readings, &whiteners, &free, &values);
    let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
    let gram = Gram::new(&problem.blocks(&at), base);
    let variance = against(without, &gram).variance;
    gram.score(base..free.len(), variance).log_evidence
}

/// The model with one more effect, or with more waves of one that it has.
fn extended(model: &Model, id: &str, waves: &[Wave]) -> Option<Model> {
    if id == ripple::EFFECT {
        return ripple::with(model, waves);
    }
    Some(model.with(&effect(id)?))
}

/// Does the later fit predict poses left out better by more than chance, and by a share of what was gained since the
/// base model that is worth having? What alarms and does not is no cause, only the best of the catalogue at imitating
/// one.
fn predicts_better(campaign: &Campaign, base: &Fit, before: &Fit, after: &Fit) -> bool {
    let readings = fitted(campaign);
    let whiteners = noise::whiteners(&base.model, &base.values, &readings, &base.noise.shape);
    let of_reading = folds::by_pose(&readings).into_iter().zip(&whiteners);
    let folds: Vec<usize> = of_reading
        .flat_map(|(fold, whitener)| std::iter::repeat_n(fold, whitener.rows))
        .collect();
    let error = |fit: &Fit| {
        let problem =
            CampaignProblem::new(&fit.model, &readings, &whiteners, &fit.free, &fit.values);
        let at: Vec<f64> = fit.free.iter().map(|&k| fit.values[k]).collect();
        let mut matrix = DMatrix::zeros(folds.len(), at.len() + 1);
        let mut row = 0;
        for block in problem.blocks(&at) {
            matrix.rows_mut(row, block.nrows()).copy_from(&block);
            row += block.nrows();
        }
        folds::cross_validated(&matrix, &folds, &vec![fit::solve::WEAK; at.len()])
    };
    folds::lower(&error(base), &error(before), &error(after))
}

/// A fit whose residuals are numbers: tests on others would not end. `near` is one with fewer effects.
fn finite_fit(campaign: &Campaign, model: &Model, near: Option<&Fit>) -> Result<Fit, FitError> {
    let quick = Options {
        cross_validate: false,
    };
    let found = match near {
        Some(near) => fit::refit(campaign, model, near)?,
        None => fit::fit(campaign, model, &quick, |_| {})?,
    };
    if found.fit.whitened_rms.is_finite() {
        return Ok(found);
    }
    let readings = fitted(campaign);
    let residuals = fit::residuals(&found.model, &found.values, &readings);
    let lost = |row: &&crate::model::Row| row.iter().any(|x| !x.is_finite());
    let first = residuals.iter().position(|row| lost(&row)).unwrap_or(0);
    Err(FitError::NoEquilibrium {
        campaign: campaign.name.clone(),
        line: readings[first].line,
    })
}

fn effect(id: &str) -> Option<Arc<dyn AnyEffect>> {
    crate::effects::find(id)?.make(toml::Table::new()).ok()
}

/// Moves outliers out of the fit; their lines.
fn reject(campaign: &mut Campaign, fit: &Fit) -> Vec<usize> {
    let fitted: Vec<&Reading> = fitted(campaign);
    let whiteners = noise::whiteners(&fit.model, &fit.values, &fitted, &fit.noise.shape);
    let residuals = fit::residuals(&fit.model, &fit.values, &fitted);
    let squares: Vec<f64> = residuals
        .iter()
        .zip(&whiteners)
        .map(|(row, whitener)| whitener.squares(row) / whitener.rows as f64 / fit.noise.factor)
        .collect();
    let lines: Vec<usize> = screen::outliers(&fitted, &squares)
        .into_iter()
        .map(|index| fitted[index].line)
        .collect();
    let keep = |r: &Reading| r.split != Split::Fit || !lines.contains(&r.line);
    campaign.readings.retain(keep);
    lines
}

fn fitted(campaign: &Campaign) -> Vec<&Reading> {
    let readings = campaign.readings.iter();
    readings.filter(|r| r.split == Split::Fit).collect()
}

/// Share of the base model's excess misfit that a later fit explains.
fn explained(base: &Fit, later: &Fit) -> f64 {
    let excess = |fit: &Fit| (fit.fit.whitened_rms.powi(2) / fit.noise.factor - 1.0).max(0.0);
    let before = excess(base);
    if before > 0.0 {
        1.0 - excess(later) / before
    } else {
        0.0
    }
}

/// All tests on one fit.
#[derive(Clone)]
struct Analysis {
    contrasts: Vec<Contrast>,
    variables: Vec<Where>,
    candidates: Vec<Candidate>,
    cannot_see: Vec<CannotSee>,
    waves: Vec<Wave>,
    lack_of_fit: f64,
}

/// What follows from them.
struct Look {
    alarm: bool,
    best: Option<&'static str>,
    near: Vec<&'static str>,
}

fn analyse_again(analysis: &Analysis) -> Look {
    let families = ALARM / analysis.candidates.len().max(1) as f64;
    let tests = (analysis.contrasts.len() + analysis.variables.len() + 1) as f64;
    let others = analysis.contrasts.iter().map(|c| c.p_value);
    let others = others.chain(analysis.variables.iter().map(|v| v.p_value));
    let least = others.fold(analysis.lack_of_fit, f64::min);
    let sure: Vec<&Candidate> = analysis
        .candidates
        .iter()
        .filter(|c| c.p_value < families && c.log_evidence > 0.0)
        .collect();
    let best = sure.first().copied();
    // near in evidence, or known beforehand to imitate the best exactly
    let near = |best: &Candidate| {
        let known = crate::effects::find(best.effect).map_or(&[][..], |entry| entry.aliases);
        let close = |c: &&&Candidate| {
            c.log_evidence > best.log_evidence - NEAR || known.contains(&c.effect)
        };
        sure.iter().filter(close).map(|c| c.effect).collect()
    };
    Look {
        alarm: best.is_some() || least < ALARM / tests,
        near: best.map_or_else(Vec::new, near),
        best: best.map(|c| c.effect),
    }
}

/// Harmonics of the scan over joint angles.
const HARMONICS: usize = 3;

/// Runs all tests on a fit; `with_waves`: the scan for those of a gear too.
fn analyse(campaign: &Campaign, fit: &Fit, with_waves: bool) -> Analysis {
    let readings = fitted(campaign);
    let mut model = fit.model.clone();
    let mut families: Vec<(&'static str, Range<usize>)> = Vec::new();
    let base = fit.free.len();
    let mut free = fit.free.clone();
    let mut values = fit.values.clone();
    for entry in CATALOGUE {
        // the waves of a gear are looked for below
        if model.has(entry.id) || entry.id == ripple::EFFECT {
            continue;
        }
        let Ok(effect) = entry.make(toml::Table::new()) else {
            continue;
        };
        let first = values.len();
        model = model.with(&effect);
        let count = model.start().len() - first;
        families.push((entry.id, free.len()..free.len() + count));
        free.extend(first..first + count);
        values.extend(std::iter::repeat_n(0.0, count));
    }
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &fit.noise.shape);
    let problem = CampaignProblem::new(&model, &readings, &whiteners, &free, &values);
    let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
    let blocks = problem.blocks(&at);
    let gram = Gram::new(&blocks, base);
    let against = against(fit, &gram);
    let excess = (gram.misfit() / against.variance - (gram.rows - gram.rank) as f64).max(1.0);
    let mut candidates = Vec::new();
    let mut cannot_see = Vec::new();
    let mut consider = |effect: &'static str, score: score::Score, p_value: f64| {
        let lacks = crate::effects::find(effect).and_then(|entry| {
            let lacking = entry.needs.iter().find(|need| !need.is_met(campaign));
            lacking.map(|need| need.sentence().to_owned())
        });
        if lacks.is_some() || score.expected < VISIBLE || score.dof == 0 {
            let faint = if score.raw > VISIBLE && score.expected < 1e-6 * score.raw {
                "the model already holds all that it can do".to_owned()
            } else {
                format!(
                    "a typical size would show with λ = {:.1}; {VISIBLE} is needed",
                    score.expected
                )
            };
            cannot_see.push(CannotSee {
                effect,
                why: lacks.unwrap_or(faint),
            });
            return;
        }
        let signal = (score.chi2 - score.dof as f64).max(0.0);
        candidates.push(Candidate {
            effect,
            log_evidence: score.log_evidence,
            lambda: signal,
            p_value,
            explained: (signal / excess).min(1.0),
        });
    };
    for (effect, columns) in families {
        let score = gram.score(columns, against.variance);
        let p_value = against.p_value(score.chi2, score.dof as f64);
        consider(effect, score, p_value);
    }
    let mut waves = Vec::new();
    if with_waves {
        let scan = ripple::Scan::new(fit, &readings, &whiteners, &blocks, base);
        match scan.waves(&against, ALARM) {
            Some(found) => {
                consider(ripple::EFFECT, found.score, found.p_value);
                waves = found.waves;
            }
            None => cannot_see.push(CannotSee {
                effect: ripple::EFFECT,
                why: ripple::NEEDS.to_owned(),
            }),
        }
    }
    candidates.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let field = field(&readings, &whiteners, &blocks, &gram, base);
    let mut variables = scan(&field, &model, fit, &readings, &whiteners, &against);
    variables.sort_by(|a, b| a.p_value.total_cmp(&b.p_value));
    let left = (gram.rows - gram.rank) as f64;
    Analysis {
        contrasts: contrasts::contrasts(&field, &against),
        variables,
        candidates,
        cannot_see,
        waves,
        lack_of_fit: match fit.noise.source {
            // measured against itself nothing is left over
            Source::Residual => 1.0,
            _ => against.p_value(gram.misfit() / against.variance, left),
        },
    }
}

/// The noise to test against: of repeats, of the file, or of what is left.
fn against(fit: &Fit, gram: &Gram) -> Against {
    match fit.noise.source {
        Source::Replicates => Against {
            variance: fit.noise.factor,
            dof: fit.noise.dof.map(|dof| dof as f64),
        },
        Source::Campaign => Against {
            variance: 1.0,
            dof: None,
        },
        Source::Residual => {
            let dof = (gram.rows.saturating_sub(gram.rank)).max(1) as f64;
            Against {
                variance: gram.misfit() / dof,
                dof: Some(dof),
            }
        }
    }
}

/// `[Q | M r]` by rows of the readings.
fn field<'a>(
    readings: &'a [&'a Reading],
    whiteners: &[noise::Whitener],
    blocks: &[DMatrix<f64>],
    gram: &Gram,
    base: usize,
) -> Field<'a> {
    let mut rows = vec![0];
    for whitener in whiteners {
        rows.push(rows[rows.len() - 1] + whitener.rows);
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
    let mut matrix = DMatrix::zeros(gram.rows, gram.rank + 1);
    let mut row = 0;
    for block in blocks {
        let q = block.columns(0, base) * &root;
        matrix
            .view_mut((row, 0), (block.nrows(), gram.rank))
            .copy_from(&q);
        matrix
            .view_mut((row, gram.rank), (block.nrows(), 1))
            .copy_from(&block.column(block.ncols() - 1));
        row += block.nrows();
    }
    let along = matrix
        .columns(0, gram.rank)
        .tr_mul(&matrix.column(gram.rank));
    let left = matrix.column(gram.rank) - matrix.columns(0, gram.rank) * along;
    matrix.set_column(gram.rank, &left);
    Field {
        readings,
        rows,
        matrix,
    }
}

/// Smooth tests: does the misfit look like an error of one joint that depends on its angle?
fn scan(
    field: &Field,
    model: &Model,
    fit: &Fit,
    readings: &[&Reading],
    whiteners: &[noise::Whitener],
    against: &Against,
) -> Vec<Where> {
    let setup = &model.setup;
    let mut workspace = crate::model::Workspace::new(setup);
    let mut jacobian = crate::model::Rows::zeros(setup.robot.joints.len());
    let width = 2 * HARMONICS;
    let mut columns = DMatrix::zeros(field.matrix.nrows(), width * setup.observed.len());
    for (index, (reading, whitener)) in readings.iter().zip(whiteners).enumerate() {
        workspace.joint_jacobian(&fit.model, &fit.values, reading, &mut jacobian);
        for (place, &joint) in setup.observed.iter().enumerate() {
            let rate = jacobian.column(joint).into_owned();
            let q = reading.joints[joint];
            whitener.apply(&rate, &mut |i, value| {
                for harmonic in 0..HARMONICS {
                    let (sin, cos) = ((harmonic + 1) as f64 * q).sin_cos();
                    let column = width * place + 2 * harmonic;
                    columns[(field.rows[index] + i, column)] = value * sin;
                    columns[(field.rows[index] + i, column + 1)] = value * cos;
                }
            });
        }
    }
    let last = field.matrix.ncols() - 1;
    let q = field.matrix.columns(0, last);
    let left = &columns - q * q.tr_mul(&columns);
    let residual = field.matrix.column(last);
    let mut found = Vec::new();
    for (place, &joint) in setup.observed.iter().enumerate() {
        let part = left.columns(width * place, width);
        let eigen = part.tr_mul(&part).symmetric_eigen();
        let gradient = part.tr_mul(&residual);
        let (mut chi2, mut dof) = (0.0, 0.0);
        // an amplitude of 0.1 mrad has to show
        for (value, vector) in eigen
            .eigenvalues
            .iter()
            .zip(eigen.eigenvectors.column_iter())
        {
            if value.max(0.0).sqrt() * 1e-4 > 0.05 {
                chi2 += vector.dot(&gradient.column(0)).powi(2) / value / against.variance;
                dof += 1.0;
            }
        }
        found.push(Where {
            variable: setup.robot.joints[joint].name.clone(),
            pattern: "smooth in its angle, 1 to 3 cycles a turn",
            p_value: against.p_value(chi2, dof),
        });
    }
    found
}
