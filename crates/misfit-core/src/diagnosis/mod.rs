//! What is missing: from a campaign and a base model to a verdict.
//!
//! Screen outliers inside pose groups; take the noise from repeats; fit the base model; say which effects the
//! campaign cannot see at all; score all others with the base model partialled out; find the set of them with the
//! most evidence; join those that cannot be told apart; refit with the set; test what is left; and compare with
//! patterns that no effect has, so that what the catalogue does not hold is not given the name of its nearest.

mod analysis;
mod columns;
mod contrasts;
mod families;
mod form;
mod motion;
mod next;
mod patterns;
mod power;
pub mod ripple;
pub mod score;
mod screen;
mod search;
mod tell;

pub use contrasts::Contrast;

use crate::campaign::wrench_is_measured;
use crate::campaign::{Campaign, Reading, Split, conditions};
use crate::effects::{AnyEffect, Role};
use crate::fit::alike::together;
use crate::fit::noise::{self, Source};
use crate::fit::{self, CampaignProblem, Fit, FitError, Options, leave_out};
use crate::model::Model;
use analysis::{Analysis, against, analyse, lacking};
use form::Form;
pub use next::{NextError, POSES, next_poses};
pub use patterns::Pattern;
pub use power::Power;
use ripple::Wave;
use score::Gram;
use std::sync::Arc;

/// Families whose expected λ at typical size is below this are invisible to a campaign.
pub const VISIBLE: f64 = 9.0;
/// Numbers that tests look at, at most: rows of all readings by columns of all effects.
const MAX_NUMBERS: usize = 600_000_000;
/// Memory that a diagnosis takes for each of them, bytes (5.7 GB for 100,000 readings of 12 rows and 257 columns).
const BYTES_PER_NUMBER: usize = 18;
/// Probability of any false alarm in one round of tests.
const ALARM: f64 = 1e-3;
/// A smaller difference of evidence, nats, tells nothing: families this near to the best are its aliases.
const MIN_NATS_TO_TELL: f64 = 3.0;
/// A named effect that explains less than this of the evidence is not what is missing.
const MIN_SHARE_TO_NAME: f64 = 0.9;
/// An effect of another form than the catalogue's explains at least this share of the evidence in the catalogue's.
const MIN_SHARE_OF_USUAL_FORM: f64 = 0.8;
/// What is worth less than this share of its worth on poses left out is not the cause.
const MIN_SHARE_LEFT_OUT: f64 = 0.25;
/// Effects named at most.
const MAX_NAMED_EFFECTS: usize = 3;

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
    /// There is no fit that could tell.
    CannotTell,
}

/// One effect as a candidate.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Candidate {
    /// Effect.
    pub effect: String,
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
    pub effect: String,
    /// Why.
    pub why: String,
}

/// A diagnosis.
#[derive(Debug, Clone)]
pub struct Diagnosis {
    /// The answer.
    pub verdict: Verdict,
    /// Its effects.
    pub effects: Vec<String>,
    /// Pairs that cannot be told apart, if the verdict is a set of aliases; the first of each is in the fit.
    pub alike: Vec<(Arc<dyn AnyEffect>, Arc<dyn AnyEffect>)>,
    /// Effects added one after the other, also where the verdict is a set of aliases.
    pub named: Vec<String>,
    /// What the campaign could say at all.
    pub power: Power,
    /// Contrasts of the base model's misfit.
    pub contrasts: Vec<Contrast>,
    /// Effects added one after the other, each with the fit that then was reached.
    pub steps: Vec<(String, Fit)>,
    /// Did the caller's wish end the search?
    pub stopped: bool,
    /// Contrasts of what the named effects leave.
    pub contrasts_left: Vec<Contrast>,
    /// An effect that alarms still, but with which poses left out are predicted no better.
    pub refused: Option<String>,
    /// Waves of the named `gear_ripple`, in the order in which they were found.
    pub waves: Vec<Wave>,
    /// What the base model's misfit follows, the most evidence first.
    pub patterns: Vec<Pattern>,
    /// What is left after the named effects follows these.
    pub patterns_left: Vec<Pattern>,
    /// Effects tried on the base model, best first.
    pub candidates: Vec<Candidate>,
    /// Effects that the campaign cannot see.
    pub cannot_see: Vec<CannotSee>,
    /// The base model's fit.
    pub base: Fit,
    /// The fit with the named effects; the base's if none.
    pub fit: Fit,
    /// Log evidence of the effects that explain the misfit best, together, nats.
    pub evidence: f64,
    /// What these are worth on poses left out, as a share of what they are on the poses fitted.
    pub predicted: Option<f64>,
    /// Why nothing can be told, if nothing can.
    pub untold: Option<String>,
    /// Lines of the rejected readings.
    pub rejected: Vec<usize>,
    /// Log evidence of each effect alone against the base model, all its parameters together, nats.
    alone: Vec<(Arc<dyn AnyEffect>, f64)>,
}

impl Diagnosis {
    /// The contrast that tells what class of effect is missing: in `time`, between `direction`s, between `load`s, or
    /// none of these but between `pose`s. None if none is sure.
    pub fn class(&self) -> Option<&'static str> {
        if let (Verdict::Unknown, Some(pattern)) = (self.verdict, self.patterns.first())
            && pattern.log_evidence > MIN_NATS_TO_TELL
        {
            return Some(pattern.class);
        }
        let sure = |name: &str| {
            let found = self.contrasts.iter().find(|c| c.name == name);
            found.filter(|c| c.p_value < ALARM)
        };
        let order = ["time", "direction", "load", "pose"];
        order.into_iter().find(|name| sure(name).is_some())
    }

    /// Adds lines that were rejected before the diagnosis.
    pub fn reject_too(&mut self, lines: &[usize]) {
        self.rejected.extend(lines);
        self.rejected.sort_unstable();
        self.rejected.dedup();
    }

    /// The campaign without the readings that it rejected: what it fitted.
    pub fn screened(&self, campaign: &Campaign) -> Campaign {
        let mut kept = campaign.clone();
        without(&mut kept, &self.rejected);
        kept
    }

    /// Log evidence of an effect against a model without it, nats: of the base model what the diagnosis found.
    pub fn evidence_of(
        &self,
        effect: &Arc<dyn AnyEffect>,
        without: &Fit,
        campaign: &Campaign,
    ) -> f64 {
        let own = |(known, _): &&(Arc<dyn AnyEffect>, f64)| Arc::ptr_eq(known, effect);
        let known = self.alone.iter().find(own);
        let of_base = without.values == self.base.values && without.free == self.base.free;
        match known.filter(|_| of_base) {
            Some((_, evidence)) => *evidence,
            None => evidence(campaign, without, effect),
        }
    }

    /// Share of the misfit above noise that the named effects explain.
    pub fn explained(&self) -> f64 {
        explained(&self.base, &self.fit)
    }
}

/// Diagnoses what a model lacks; `own` are effects of the user's own to be tried beside the catalogue.
///
/// # Errors
/// As [`fit::fit`].
pub fn diagnose(
    campaign: &Campaign,
    model: &Model,
    own: &[Arc<dyn AnyEffect>],
    options: &Options,
    on_step: impl FnMut(&str),
) -> Result<Diagnosis, FitError> {
    diagnose_until(campaign, model, own, options, on_step, |_, _, _| false)
}

/// The same, ended early where `enough` says so of the number of steps so far, the last effect and its fit.
///
/// # Errors
/// As [`fit::fit`].
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub fn diagnose_until(
    campaign: &Campaign,
    model: &Model,
    own: &[Arc<dyn AnyEffect>],
    options: &Options,
    mut on_step: impl FnMut(&str),
    enough: impl Fn(usize, Option<&str>, &Fit) -> bool,
) -> Result<Diagnosis, FitError> {
    check(campaign, model, own)?;
    on_step("fitting the base model");
    let mut campaign = campaign.clone();
    let mut base = finite_fit(&campaign, model, None)?;
    let rejected = reject(&mut campaign, &base);
    if !rejected.is_empty() {
        base = finite_fit(&campaign, model, None)?;
    }
    on_step("scoring the catalogue");
    let first = analyse(&campaign, &base, own, true);
    // where the noise is what is left, nobody knows how much is still to be explained: then one effect at a time
    let measured = base.noise.source != Source::Residual;
    let mut planned = if measured {
        first.set.clone()
    } else {
        Vec::new()
    };
    let (mut evidence, mut steps, mut last, mut stopped, mut refused);
    loop {
        steps = Vec::<(String, Fit)>::new();
        last = first.clone();
        evidence = if planned.is_empty() {
            0.0
        } else {
            first.set_evidence
        };
        (stopped, refused) = (false, None);
        let mut next = planned.iter();
        while next.len() > 0 || (!last.set.is_empty() && steps.len() < MAX_NAMED_EFFECTS) {
            let (so_far, so_named) = match steps.last() {
                Some((id, fit)) => (fit, Some(id.as_str())),
                None => (&base, None),
            };
            if enough(steps.len(), so_named, so_far) {
                stopped = true;
                break;
            }
            let (effect, surely) = match next.next() {
                Some(effect) => (effect.clone(), true),
                None => (last.set[0].clone(), false),
            };
            on_step(&format!("refitting with {}", effect.id()));
            let model = so_far.model.with(&effect);
            let fit = finite_fit(&campaign, &model, Some(so_far))?;
            if next.len() == 0 {
                on_step("testing what is left");
                // one search finds the waves that there are
                let with_waves = fit.model.term_of(Role::Ripple).is_none();
                let analysis = analyse(&campaign, &fit, own, with_waves);
                if !surely {
                    // large effects may hide another until they are refitted
                    if analysis.alarm && !predicts_better(&campaign, &base, so_far, &fit) {
                        refused = Some(effect.id().to_owned());
                        break;
                    }
                    evidence += last.first_evidence;
                }
                last = analysis;
            }
            steps.push((effect.id().to_owned(), fit));
        }
        // taken in beside others, before all were refitted: is each still needed?
        let idle = match steps.last() {
            Some((_, fit)) if planned.len() > 1 => {
                let idle = |effect: &Arc<dyn AnyEffect>| fit.p_value(effect.id()) > ALARM;
                planned.iter().position(idle)
            }
            _ => None,
        };
        match idle {
            Some(idle) => drop(planned.remove(idle)),
            None => break,
        }
    }
    let mut named: Vec<String> = steps.iter().map(|step| step.0.clone()).collect();
    let mut alike = named.clone();
    let mut pairs = Vec::new();
    let is_named = |effect: &Arc<dyn AnyEffect>| named.iter().any(|id| id == effect.id());
    for (effect, others) in first.near.iter().filter(|(effect, _)| is_named(effect)) {
        for other in others {
            pairs.push((effect.clone(), other.clone()));
            if alike.iter().all(|id| id != other.id()) {
                alike.push(other.id().to_owned());
            }
        }
    }
    let pattern = |analysis: &Analysis| analysis.patterns.first().map_or(0.0, |p| p.log_evidence);
    let (before, after) = (pattern(&first), pattern(&last).max(0.0));
    let left = last.alarm || stopped || refused.is_some();
    let verdict = if named.is_empty() {
        if first.alarm {
            Verdict::Unknown
        } else {
            Verdict::Nothing
        }
    } else if stopped || !measured {
        if left {
            Verdict::NamedIncomplete
        } else if alike.len() > named.len() {
            Verdict::Alias
        } else {
            Verdict::Named
        }
    } else {
        let worthless = first
            .gain
            .is_some_and(|gain| gain.is_below(MIN_SHARE_LEFT_OUT));
        let all = before.max(evidence + after);
        let doubtful = left || before > evidence + after + MIN_NATS_TO_TELL;
        // one effect may have another form: so it is if that explains as much as a set of several, or as any pattern; that
        // it takes several, and something is still left, is no finding
        let main = match steps.len() > 1 || doubtful {
            true => main(&campaign, &base, &first),
            false => None,
        };
        let of_other_form = main.as_ref().filter(|(_, form)| {
            let best = if doubtful { all } else { evidence };
            form.usual >= MIN_SHARE_OF_USUAL_FORM * all
                && (form.free >= best || first.one_form && form.usual >= MIN_SHARE_TO_NAME * all)
        });
        if worthless {
            Verdict::Unknown
        } else if let Some((effect, _)) = of_other_form {
            named = vec![effect.id().to_owned()];
            Verdict::NamedIncomplete
        } else if doubtful {
            if named.len() == 1 && evidence >= MIN_SHARE_TO_NAME * all {
                Verdict::NamedIncomplete
            } else {
                Verdict::Unknown
            }
        } else if alike.len() > named.len() {
            Verdict::Alias
        } else {
            Verdict::Named
        }
    };
    let untold = untold(&campaign, &base);
    let verdict = match untold {
        Some(_) => Verdict::CannotTell,
        None => verdict,
    };
    if matches!(verdict, Verdict::Unknown | Verdict::CannotTell) {
        named.clear();
        steps.clear();
        last = first.clone();
    } else if verdict == Verdict::NamedIncomplete && named.len() < steps.len() {
        // of a set that only repairs the form of one, that one
        let one = first.set.iter().find(|effect| effect.id() == named[0]);
        if let Some(effect) = one {
            let fit = finite_fit(&campaign, &base.model.with(effect), Some(&base))?;
            last = analyse(
                &campaign,
                &fit,
                own,
                fit.model.term_of(Role::Ripple).is_none(),
            );
            steps = vec![(named[0].clone(), fit)];
        }
    }
    let effects = if verdict == Verdict::Alias {
        alike
    } else {
        named.clone()
    };
    if options.cross_validate && base.heldout.is_none() {
        on_step("cross-validation");
        base.cross_validate(&campaign);
        for (_, step) in &mut steps {
            step.cross_validate(&campaign);
        }
    }
    let fit = steps.last().map_or(&base, |step| &step.1).clone();
    let mut waves = if named.iter().any(|id| id == Role::Ripple.id()) {
        first.waves
    } else {
        Vec::new()
    };
    ripple::settle(&mut waves, &fit);
    Ok(Diagnosis {
        verdict,
        effects,
        alike: if verdict == Verdict::Alias {
            pairs
        } else {
            Vec::new()
        },
        named,
        power: first.power,
        contrasts: first.contrasts,
        patterns: first.patterns,
        contrasts_left: last.contrasts,
        patterns_left: last.patterns,
        evidence,
        predicted: first
            .gain
            .filter(|_| !first.set.is_empty())
            .map(|gain| gain.share()),
        candidates: first.candidates,
        cannot_see: first.cannot_see,
        base,
        fit,
        steps,
        stopped,
        refused,
        waves,
        untold,
        rejected,
        alone: first.alone,
    })
}

/// Refuses what would fill the memory, and laws of the user's own that have no value at a reading, before anything is
/// computed.
///
/// # Errors
/// What is too large, or the reading at which a law has no value.
pub fn check(
    campaign: &Campaign,
    model: &Model,
    own: &[Arc<dyn AnyEffect>],
) -> Result<(), FitError> {
    check_size(campaign, model, own)?;
    fit::check_laws(campaign, model, own)
}

fn check_size(
    campaign: &Campaign,
    model: &Model,
    own: &[Arc<dyn AnyEffect>],
) -> Result<(), FitError> {
    let own_columns = |effect: &Arc<dyn AnyEffect>| effect.parameters(&model.setup).len();
    let columns = model.start().len() + 1;
    let columns: usize = columns + lacking(model, own).iter().map(own_columns).sum::<usize>();
    let rows = |reading: &Reading| {
        let pose = if reading.orientation.is_some() { 6 } else { 3 };
        pose + if wrench_is_measured(reading) { 6 } else { 0 }
    };
    let fitted = || campaign.readings.iter().filter(|r| r.split == Split::Fit);
    let numbers = fitted().map(rows).sum::<usize>().saturating_mul(columns);
    if numbers <= MAX_NUMBERS {
        return Ok(());
    }
    let readings = fitted().count();
    Err(FitError::TooLarge {
        campaign: campaign.name.clone(),
        readings,
        columns,
        gigabytes: numbers.saturating_mul(BYTES_PER_NUMBER) / 1_000_000_000,
        most: (readings as f64 * (MAX_NUMBERS as f64 / numbers as f64)) as usize,
    })
}

/// Log evidence (nats) of an effect for a fit without it.
fn evidence(campaign: &Campaign, without: &Fit, effect: &Arc<dyn AnyEffect>) -> f64 {
    let readings = fitted(campaign);
    let shape = &without.noise.shape;
    let whiteners = noise::whiteners(&without.model, &without.values, &readings, shape);
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
    let information = gram.families(variance);
    information.score(&(0..free.len() - base)).log_evidence
}

/// Of the effects of a set, the one that explains most alone, and how well it does in another form.
fn main(
    campaign: &Campaign,
    base: &Fit,
    analysis: &Analysis,
) -> Option<(Arc<dyn AnyEffect>, Form)> {
    let rank = |effect: &Arc<dyn AnyEffect>| {
        let of = |candidate: &Candidate| candidate.effect == effect.id();
        analysis
            .candidates
            .iter()
            .position(of)
            .unwrap_or(usize::MAX)
    };
    let effect = analysis.set.iter().min_by_key(|effect| rank(effect))?;
    Some((effect.clone(), Form::of(campaign, base, effect)))
}

/// Does the later fit predict poses left out better by more than chance, and by a share of what was gained since the
/// base model that is worth having? What alarms and does not is no cause, only the best of the catalogue at imitating
/// one.
fn predicts_better(campaign: &Campaign, base: &Fit, before: &Fit, after: &Fit) -> bool {
    let readings = fitted(campaign);
    let whiteners = noise::whiteners(&base.model, &base.values, &readings, &base.noise.shape);
    let error = |fit: &Fit| {
        let problem =
            CampaignProblem::new(&fit.model, &readings, &whiteners, &fit.free, &fit.values);
        let at: Vec<f64> = fit.free.iter().map(|&k| fit.values[k]).collect();
        let rows = whiteners.iter().map(|whitener| whitener.rows);
        let normals = leave_out::by_folds(&readings, rows, &problem.blocks(&at), Clone::clone);
        leave_out::predicted(&normals, &vec![fit::solve::WEAK; at.len()])
    };
    leave_out::is_lower(&error(base), &error(before), &error(after))
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

/// Why a fit of a campaign can tell nothing; none if it can.
fn untold(campaign: &Campaign, fit: &Fit) -> Option<String> {
    let readings = fitted(campaign);
    let start = fit::start_values(campaign, &fit.model, &readings);
    let mut frames = fit.model.start();
    for role in [Role::TrackerFrame, Role::TargetFrame] {
        if let Some(term) = fit.model.term_of(role) {
            let own = term.first..term.first + term.parameters.len();
            frames[own.clone()].copy_from_slice(&start[own]);
        }
    }
    let left = fit::residuals(&fit.model, &frames, &readings);
    let squares: f64 = left
        .iter()
        .map(|row| row.fixed_rows::<3>(0).norm_squared())
        .sum();
    let alone = (squares / readings.len().max(1) as f64).sqrt();
    let rows = |reading: &&Reading| if reading.orientation.is_some() { 6 } else { 3 };
    let rows = readings.iter().map(rows).sum();
    let alone = if alone.is_finite() {
        alone
    } else {
        f64::INFINITY
    };
    tell::cannot_tell(&tell::facts(fit, rows, alone))
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
    let mut lines: Vec<usize> =
        screen::outliers(&conditions(&fitted, campaign.noise.as_ref()), &squares)
            .into_iter()
            .map(|index| fitted[index].line)
            .collect();
    lines.sort_unstable();
    without(campaign, &lines);
    lines
}

/// Takes the fitted readings of these lines out.
fn without(campaign: &mut Campaign, lines: &[usize]) {
    let keep = |r: &Reading| r.split != Split::Fit || !lines.contains(&r.line);
    campaign.readings.retain(keep);
}

/// Readings to fit, repeats together.
fn fitted(campaign: &Campaign) -> Vec<&Reading> {
    let readings = campaign.readings.iter();
    let readings: Vec<&Reading> = readings.filter(|r| r.split == Split::Fit).collect();
    together(&readings)
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
