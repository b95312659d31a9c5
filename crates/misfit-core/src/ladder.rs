//! The falling error: from frames alone, rung by rung, until nothing more is detectable.
//!
//! The first rungs are what every robot has: joint offsets, full geometry, joint compliance where something loads
//! the joints. From there on each rung is what the diagnosis names. At the end each effect that it added is left
//! out again, to see what it is worth beside the others.

use crate::campaign::Campaign;
use crate::diagnosis::{self, Diagnosis};
use crate::effects::{AnyEffect, Base, EffectList, Role};
use crate::fit::noise::Source;
use crate::fit::{self, Errors, Fit, FitError, Options};
use crate::model_file::{self, ModelError};
use std::sync::Arc;

/// The first rung: the frames alone.
const NOMINAL: &str = "nominal";

/// One rung.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Rung {
    /// `nominal` (the frames alone) or the effect added.
    pub added: String,
    /// Errors of the fitted readings.
    pub fit: Errors,
    /// Errors of readings not fitted.
    pub heldout: Option<Errors>,
    /// Share of the mean square position error above noise that the rung before left, fitted readings, which this one
    /// takes away.
    pub explained: f64,
}

/// What one effect of the last model is worth: the last model without it.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct LeftOut {
    /// The effect left out.
    pub effect: String,
    /// Errors of the fitted readings.
    pub fit: Errors,
    /// Errors of readings not fitted.
    pub heldout: Option<Errors>,
    /// Log evidence lost, nats.
    pub evidence_lost: f64,
}

/// Where to stop, if not at the end.
#[derive(Debug, Clone, PartialEq)]
pub enum Stop {
    /// At this position error of the fitted readings, rms, m. Readings held out stop nothing.
    Error(f64),
    /// After so many rungs, the frames counted.
    Rungs(usize),
    /// With this effect.
    Effect(String),
}

/// As [`Stop::parse`] reads it.
impl std::fmt::Display for Stop {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Stop::Error(metres) => write!(out, "{metres}m"),
            Stop::Rungs(most) => write!(out, "{most}"),
            Stop::Effect(effect) => write!(out, "{effect}"),
        }
    }
}

impl Stop {
    /// From a word of the command line: `0.3mm`, `5` (rungs) or an effect.
    ///
    /// # Errors
    /// What was found, and what is accepted.
    pub fn parse(word: &str) -> Result<Self, String> {
        let refuse = || {
            Err(format!(
                "\"{word}\" is no place to stop at; accepted: an error with its unit (0.3mm, 300um, 3e-4m), a \
                 number of rungs (5) or an effect ({})",
                crate::effects::ids()
            ))
        };
        if let Ok(rungs) = word.parse::<usize>() {
            return if rungs > 0 {
                Ok(Stop::Rungs(rungs))
            } else {
                refuse()
            };
        }
        if word == NOMINAL || crate::effects::find(word).is_some() {
            return Ok(Stop::Effect(word.to_owned()));
        }
        let units = [("mm", 1e-3), ("um", 1e-6), ("µm", 1e-6), ("m", 1.0)];
        for (unit, metres) in units {
            let number = word.strip_suffix(unit).map(|number| number.trim().parse());
            if let Some(Ok::<f64, _>(size)) = number
                && size.is_finite()
                && size > 0.0
            {
                return Ok(Stop::Error(size * metres));
            }
        }
        refuse()
    }

    /// Is this rung far enough?
    fn reached(&self, rung: &str, rungs: usize, fit: &Fit) -> bool {
        match self {
            Stop::Error(size) => fit.fit.position_rms_m <= *size,
            Stop::Rungs(most) => rungs >= *most,
            Stop::Effect(effect) => effect == rung,
        }
    }
}

/// A climbed ladder.
#[derive(Debug, Clone)]
pub struct Ladder {
    /// Rungs from the frames on.
    pub rungs: Vec<Rung>,
    /// The fit of each.
    pub fits: Vec<Fit>,
    /// The last model without one of the effects that were added, each.
    pub left_out: Vec<LeftOut>,
    /// Position error that noise alone would leave, rms over three coordinates, m; none where nothing but the misfit
    /// itself says how large the noise is.
    pub floor_m: Option<f64>,
    /// The diagnosis at which it ended.
    pub last: Diagnosis,
}

/// Why there is no ladder.
#[derive(Debug, thiserror::Error)]
pub enum LadderError {
    /// A model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A fit.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Climbs the ladder of a campaign. The ladder goes on from the model of `effects`. `own` are
/// effects of the user's own to be tried beside the catalogue.
///
/// # Errors
/// If a model or a fit cannot be made.
pub fn climb(
    campaign: &Campaign,
    effects: &EffectList,
    own: &[Arc<dyn AnyEffect>],
    stop: Option<&Stop>,
    options: &Options,
    mut on_step: impl FnMut(&str),
) -> Result<Ladder, LadderError> {
    let enough = |rung: &str, rungs: usize, fit: &Fit| {
        stop.is_some_and(|stop| stop.reached(rung, rungs, fit))
    };
    let start = model_file::model(campaign, effects, None)?;
    diagnosis::check(campaign, &start, own)?;
    let default = model_file::model(campaign, &EffectList::DEFAULT, None)?;
    let mut steps: Vec<(String, Fit)> = Vec::new();
    // joint_offset is part of geometry: a rung of its own, then replaced
    let mut low = vec![(NOMINAL, EffectList::FRAMES)];
    if effects.base == Base::Default {
        let rungs = [Role::Offset, Role::Geometry];
        low.extend(rungs.map(|role| (role.id(), EffectList::only(role))));
    }
    let mut stopped = false;
    for (name, list) in low {
        on_step(name);
        let model = model_file::model(campaign, &list, None)?;
        steps.push((
            name.to_owned(),
            fit::fit(campaign, &model, options, |_| {})?,
        ));
        let (name, fit) = &steps[steps.len() - 1];
        stopped = enough(name, steps.len(), fit);
        if stopped {
            break;
        }
    }
    // where the ladder goes on from, if not from the last rung
    let mut above: Option<String> = None;
    if !stopped {
        let ids: Vec<&str> = effects.effects.iter().map(|entry| entry.id).collect();
        let words = ids.join(" + ");
        let springs = Role::Spring.id();
        if effects.base == Base::Default && default.has(springs) {
            above = Some(springs.to_owned());
            if !effects.is_default() {
                on_step(springs);
                let fit = fit::fit(campaign, &default, options, |_| {})?;
                stopped = enough(springs, steps.len() + 1, &fit);
                steps.push((springs.to_owned(), fit));
                above = (!stopped).then_some(words);
            }
        } else if !effects.is_default() {
            above = Some(words);
        }
    }
    let model = match (&above, steps.last()) {
        (None, Some((_, fit))) => fit.model.clone(),
        _ => start,
    };
    let below = steps.len() + usize::from(above.is_some());
    let last = diagnosis::diagnose_until(
        campaign,
        &model,
        own,
        options,
        &mut on_step,
        |count, effect, fit| {
            let rung = effect.or(above.as_deref()).unwrap_or("");
            stopped || enough(rung, below + count, fit)
        },
    )?;
    if let Some(name) = above {
        steps.push((name, last.base.clone()));
    }
    for (effect, fit) in &last.steps {
        steps.push((effect.clone(), fit.clone()));
    }
    let left_out = left_out(campaign, &last, options, &mut on_step)?;
    let noise = &last.fit.noise;
    let floor_m = (noise.source != Source::Residual).then(|| noise.position_sigma * 3f64.sqrt());
    Ok(Ladder {
        rungs: rungs(&steps, floor_m.unwrap_or(0.0)),
        fits: steps.into_iter().map(|(_, fit)| fit).collect(),
        left_out,
        floor_m,
        last,
    })
}

fn rungs(steps: &[(String, Fit)], floor: f64) -> Vec<Rung> {
    let above = |fit: &Fit| fit.fit.position_rms_m.powi(2) - floor.powi(2);
    let mut before = None;
    let rung = |(added, fit): &(String, Fit)| {
        let left = before.replace(above(fit)).unwrap_or(0.0);
        Rung {
            added: added.clone(),
            fit: fit.fit,
            heldout: fit.heldout,
            explained: if left > 0.0 {
                ((left - above(fit)) / left).min(1.0)
            } else {
                0.0
            },
        }
    };
    steps.iter().map(rung).collect()
}

/// The last model without each of the effects that the diagnosis added.
fn left_out(
    campaign: &Campaign,
    last: &Diagnosis,
    options: &Options,
    on_step: &mut impl FnMut(&str),
) -> Result<Vec<LeftOut>, FitError> {
    let campaign = &last.screened(campaign);
    let mut rows = Vec::new();
    for effect in &last.named {
        let Some(term) = last.fit.model.term(effect) else {
            continue;
        };
        on_step(&format!("without {effect}"));
        let model = last.fit.model.without(effect);
        // often it is a rung below
        let same =
            |fit: &&Fit| !fit.model.has(effect) && fit.model.start().len() == model.start().len();
        let below = std::iter::once(&last.base).chain(last.steps.iter().map(|step| &step.1));
        let fit = match below.into_iter().find(same) {
            Some(fit) => fit.clone(),
            None => fit::fit(campaign, &model, options, |_| {})?,
        };
        rows.push(LeftOut {
            effect: effect.clone(),
            fit: fit.fit,
            heldout: fit.heldout,
            evidence_lost: last.evidence_of(&term.effect, &fit, campaign),
        });
    }
    Ok(rows)
}
