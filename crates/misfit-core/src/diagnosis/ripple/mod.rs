//! Waves of unknown frequency in the error of a joint: a scan over cycles per turn.
//!
//! For every joint `j` and number of cycles `N` the score of the pair `g_j sin N q_j`, `g_j cos N q_j` is taken
//! with the base model partialled out (`g_j`: whitened motion of the target by the joint). The best pair is
//! taken up, its cycles refined, and the scan goes on for the next until none stands above noise. How many of
//! them are kept is decided by cross-validation, in which each fold searches anew.
//!
//! The probability of a peak from noise alone counts all frequencies tried: with `p` that of the pair alone and
//! `z = -ln p`, at most `p (1 + W √z)`, where `W = ΔN √(4π var q) / 2π` is the number of independent frequencies.
//! Source: Baluev 2008, *Assessing the statistical significance of periodogram peaks*, MNRAS 385, 1279.

mod grid;
mod lane;
mod search;
mod sums;

use super::motion::Motion;
use super::score::Against;
use crate::campaign::Reading;
use crate::effects::Role;
use crate::fit::noise::Source;
use crate::fit::{FOLDS, Fit, leave_out, solve};
use crate::model::Model;
use grid::Grid;
use nalgebra::DMatrix;
use rayon::prelude::*;
use search::{Peak, Search};
use sums::Sums;

/// Waves taken up at most in one search.
const MAX_WAVES: usize = 48;
/// And in a first one.
const MAX_WAVES_AT_FIRST: usize = 16;

/// One wave found.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Wave {
    /// Joint.
    pub joint: String,
    /// Cycles per turn.
    pub cycles: f64,
    /// One standard deviation of them.
    pub cycles_std: f64,
    /// Amplitude, rad.
    pub amplitude_rad: f64,
    /// Probability of such a wave at any frequency of any joint from noise alone.
    pub p_value: f64,
    /// Other cycles of this joint that explain the readings as well.
    pub also: Vec<f64>,
}

/// What the scan says.
pub struct Found {
    /// Waves, in the order in which they were found.
    pub waves: Vec<Wave>,
    /// What the frequencies tried cost in evidence, nats.
    pub trials: f64,
}

/// Waves of a model: joint and cycles.
pub fn of(model: &Model) -> Vec<(String, f64)> {
    let term = model.term_of(Role::Ripple);
    let waves = term.map_or_else(Vec::new, |term| term.effect.waves(&model.setup));
    let named =
        |(joint, cycles): (usize, f64)| (model.setup.robot.joints[joint].name.clone(), cycles);
    waves.into_iter().map(named).collect()
}

/// The model with these waves beside those that it has, which keep their values.
pub fn with(model: &Model, waves: &[Wave]) -> Option<Model> {
    let mut table = toml::Table::new();
    let found = waves.iter().map(|wave| (wave.joint.clone(), wave.cycles));
    for (joint, cycles) in of(model).into_iter().chain(found) {
        let list = table
            .entry(joint)
            .or_insert_with(|| toml::Value::Array(Vec::new()));
        if let toml::Value::Array(list) = list {
            list.push(cycles.into());
        }
    }
    let mut options = toml::Table::new();
    options.insert("cycles".to_owned(), table.into());
    let effect = Role::Ripple.entry().make(options).ok()?;
    let mut next = model.without(effect.id()).with(&effect);
    if let (Some(old), Some(term)) = (model.term_of(Role::Ripple), next.terms.last_mut()) {
        for parameter in &mut term.parameters {
            let before = old.parameters.iter().find(|p| p.name == parameter.name);
            if let Some(before) = before {
                *parameter = before.clone();
            }
        }
    }
    Some(next)
}

/// Gives waves the amplitudes of a fit.
pub fn settle(waves: &mut [Wave], fit: &Fit) {
    let Some(term) = fit.model.term_of(Role::Ripple) else {
        return;
    };
    let fitted = of(&fit.model);
    for wave in waves {
        let own = |(joint, cycles): &(String, f64)| *joint == wave.joint && *cycles == wave.cycles;
        if let Some(place) = fitted.iter().position(own) {
            let [sin, cos] = [0, 1].map(|k| term.of(&fit.values)[2 * place + k]);
            wave.amplitude_rad = sin.hypot(cos);
        }
    }
}

/// Looks in what a fit leaves for waves whose probability is below `alarm`; none where none of them predicts poses that
/// it has not seen. `blocks` are rows of whitened columns, the first `base` of them those of the fit, the last the
/// residual; `motions` go by readings.
#[expect(
    clippy::too_many_arguments,
    reason = "one procedure, still to be split by its steps"
)]
pub fn scan(
    fit: &Fit,
    readings: &[&Reading],
    motions: &[Motion],
    blocks: &[DMatrix<f64>],
    base: usize,
    against: &Against,
    alarm: f64,
) -> Option<Found> {
    let sums = Sums::new(fit, &of(&fit.model), readings, motions, blocks, base);
    let own_noise = fit.noise.source == Source::Residual;
    let grids: Vec<Option<Grid>> = (0..sums.joints.len())
        .into_par_iter()
        .map(|joint| Grid::new(&sums, joint, FOLDS))
        .collect();
    let begin = |folds: &[usize]| Search::new(&sums, &grids, folds, *against, own_noise);
    let all: Vec<usize> = (0..FOLDS).collect();
    // up to `wanted` waves, and how many of them predict poses left out
    let grown = |wanted: usize| {
        let mut search = begin(&all);
        search.grow(alarm, wanted);
        let most = search.found.len();
        if most == 0 {
            return (search, 0);
        }
        let errors: Vec<Vec<f64>> = (0..FOLDS)
            .into_par_iter()
            .map(|fold| {
                let kept: Vec<usize> = all.iter().copied().filter(|&f| f != fold).collect();
                let mut search = begin(&kept);
                // of fewer readings a wave of all may be less sure
                search.grow(alarm.sqrt(), most);
                let errors = predicted(&sums, &search.found, &kept, fold);
                (0..=most)
                    .map(|k| errors[k.min(errors.len() - 1)])
                    .collect()
            })
            .collect();
        let keep = predicting(&errors, most);
        (search, keep)
    };
    let (mut search, mut keep) = grown(MAX_WAVES_AT_FIRST);
    // where the last half of them tells nothing of other poses, those to come would not either
    if search.found.len() == MAX_WAVES_AT_FIRST && keep > MAX_WAVES_AT_FIRST / 2 {
        (search, keep) = grown(MAX_WAVES);
    }
    if keep == 0 {
        // no wave predicts poses that it has not seen
        return None;
    }
    let trials = search.trials.max(1.0).ln();
    search.truncate(keep);
    let (amplitudes, deviations) = search.refine();
    let waves = search.found.iter().enumerate().map(|(k, peak)| Wave {
        joint: sums.joints[peak.joint].name.clone(),
        cycles: peak.cycles,
        cycles_std: deviations[k],
        amplitude_rad: amplitudes[2 * k].hypot(amplitudes[2 * k + 1]),
        p_value: peak.p_value,
        also: peak.also.clone(),
    });
    Some(Found {
        waves: waves.collect(),
        // each wave pays for the frequencies tried
        trials: trials * keep as f64,
    })
}

/// How many waves predict poses left out as well as any number does; `errors` by folds and numbers of waves.
fn predicting(errors: &[Vec<f64>], most: usize) -> usize {
    let of = |k: usize| -> Vec<f64> { errors.iter().map(|fold| fold[k]).collect() };
    let total = |k: &usize| of(*k).iter().sum::<f64>();
    let least = (0..=most).min_by(|a, b| total(a).total_cmp(&total(b)));
    let best = of(least.unwrap_or(0));
    // the fewest that are not worse by more than chance, or by a share worth having
    (0..=most)
        .find(|&k| !leave_out::is_lower(&of(0), &of(k), &best))
        .unwrap_or(0)
}

/// Squared errors of the tested fold with none, one, … all of the waves fitted to the kept ones.
fn predicted(sums: &Sums, waves: &[Peak], kept: &[usize], tested: usize) -> Vec<f64> {
    let waves: Vec<(usize, f64)> = waves.iter().map(|w| (w.joint, w.cycles)).collect();
    let kept = sums.normal(kept, &waves, grid::TYPICAL);
    let tested = sums.normal(&[tested], &waves, grid::TYPICAL);
    let base = kept.0.nrows() - 1 - 2 * waves.len();
    let counts: Vec<usize> = (0..=waves.len()).map(|k| base + 2 * k).collect();
    let priors = vec![solve::WEAK; kept.0.nrows() - 1];
    leave_out::left_out(&kept, &tested, &priors, &counts)
}
