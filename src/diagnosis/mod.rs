//! What is missing: from a campaign and a base model to a verdict.
//!
//! Screen outliers inside pose groups; take the noise from repeats; fit the base model; say which effects the
//! campaign cannot see at all; score all others with the base model partialled out; find the set of them with the
//! most evidence; join those that cannot be told apart; refit with the set; test what is left; and compare with
//! patterns that no effect has, so that what the catalogue does not hold is not given the name of its nearest.

mod contrasts;
mod families;
mod patterns;
mod prediction;
pub(crate) mod score;
mod screen;
mod search;

pub use contrasts::Contrast;

use crate::campaign::{Campaign, Reading, Split};
use crate::effects::{AnyEffect, CATALOGUE};
use crate::fit::noise::{self, Source};
use crate::fit::{self, CampaignProblem, Fit, FitError, Options};
use crate::model::Model;
use contrasts::Field;
use families::{Family, FamilyScore};
use nalgebra::DMatrix;
pub use patterns::Pattern;
use prediction::{Folds, Gain};
use score::{Against, Gram, Information};
use std::sync::Arc;

/// Families whose expected λ at typical size is below this are invisible to a campaign.
pub const VISIBLE: f64 = 9.0;
/// Probability of any false alarm in one round of tests.
const ALARM: f64 = 1e-3;
/// Families this near to the best, in nats, are its aliases.
const NEAR: f64 = 3.0;
/// A named effect that explains less than this of the evidence is not what is missing.
const ENOUGH: f64 = 0.9;
/// What is known to imitate an effect does so if it explains this share of its signal.
const IMITATES: f64 = 0.8;
/// What is worth less than this share of its worth on poses left out is not the cause.
const WORTH: f64 = 0.25;
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
    /// Effects added one after the other, also where the verdict is a set of aliases.
    pub named: Vec<String>,
    /// Contrasts of the base model's misfit.
    pub contrasts: Vec<Contrast>,
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
    /// Lines of the rejected readings.
    pub rejected: Vec<usize>,
}

impl Diagnosis {
    /// The contrast that tells what class of effect is missing: in `time`, between `direction`s, between `load`s, or
    /// none of these but between `pose`s. None if none is sure.
    pub fn class(&self) -> Option<&'static str> {
        if let (Verdict::Unknown, Some(pattern)) = (self.verdict, self.patterns.first())
            && pattern.log_evidence > NEAR
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

    /// Share of the misfit above noise that the named effects explain.
    pub fn explained(&self) -> f64 {
        explained(&self.base, &self.fit)
    }
}

/// Diagnoses what a model lacks.
///
/// # Errors
/// As [`fit::fit`].
pub fn diagnose(
    campaign: &Campaign,
    model: &Model,
    options: &Options,
    mut on_step: impl FnMut(&str),
) -> Result<Diagnosis, FitError> {
    on_step("fitting the base model");
    let mut campaign = campaign.clone();
    let mut base = finite_fit(&campaign, model)?;
    let rejected = reject(&mut campaign, &base);
    if !rejected.is_empty() {
        base = finite_fit(&campaign, model)?;
    }
    on_step("scoring the catalogue");
    let first = analyse(&campaign, &base);
    let mut current = base.clone();
    let mut last = first.clone();
    let mut named: Vec<String> = Vec::new();
    let mut evidence = 0.0;
    for id in first.set.clone() {
        on_step(&format!("refitting with {id}"));
        let Some(effect) = effect(&id) else { continue };
        current = finite_fit(&campaign, &current.model.with(&effect))?;
        named.push(id);
        evidence = first.set_evidence;
    }
    if !named.is_empty() {
        on_step("testing what is left");
        last = analyse(&campaign, &current);
    }
    // large effects may hide another until they are refitted
    while let (Some(id), true) = (last.set.first().cloned(), named.len() < MOST) {
        on_step(&format!("refitting with {id}"));
        let Some(effect) = effect(&id) else { break };
        current = finite_fit(&campaign, &current.model.with(&effect))?;
        named.push(id);
        evidence += last.first_evidence;
        last = analyse(&campaign, &current);
    }
    let pattern = |analysis: &Analysis| analysis.patterns.first().map_or(0.0, |p| p.log_evidence);
    let (before, after) = (pattern(&first), pattern(&last).max(0.0));
    // where the noise is what is left, nobody knows how much is still to be explained
    let measured = base.noise.source != Source::Residual;
    let worthless = first.gain.is_some_and(|gain| gain.is_below(WORTH));
    let verdict = if named.is_empty() {
        if first.alarm {
            Verdict::Unknown
        } else {
            Verdict::Nothing
        }
    } else if measured && (worthless || last.alarm || before > evidence + after + NEAR) {
        // one effect may have another form; that it takes several, and something is still left, is no finding
        let share = evidence / before.max(evidence + after);
        if named.len() == 1 && share >= ENOUGH && !worthless {
            Verdict::NamedIncomplete
        } else {
            Verdict::Unknown
        }
    } else if last.alarm {
        Verdict::NamedIncomplete
    } else if first.near.len() > named.len() {
        Verdict::Alias
    } else {
        Verdict::Named
    };
    let mut effects = named.clone();
    match verdict {
        Verdict::Alias => effects = first.near.clone(),
        Verdict::Unknown | Verdict::Nothing => {
            effects.clear();
            named.clear();
        }
        Verdict::Named | Verdict::NamedIncomplete => {}
    }
    if current.model.terms.len() != base.model.terms.len() + named.len() {
        let made = named.iter().filter_map(|id| effect(id));
        let model = made.fold(base.model.clone(), |model, effect| model.with(&effect));
        current = finite_fit(&campaign, &model)?;
        last = analyse(&campaign, &current);
    }
    if options.cross_validate {
        on_step("cross-validation");
        base = fit::fit(&campaign, &base.model, options, |_| {})?;
        current = fit::fit(&campaign, &current.model, options, |_| {})?;
    }
    Ok(Diagnosis {
        verdict,
        effects,
        named,
        contrasts: first.contrasts,
        patterns: first.patterns,
        patterns_left: last.patterns,
        evidence,
        predicted: first
            .gain
            .filter(|_| !first.set.is_empty())
            .map(|gain| gain.share()),
        candidates: first.candidates,
        cannot_see: first.cannot_see,
        base,
        fit: current,
        rejected,
    })
}

/// A fit whose residuals are numbers: tests on others would not end.
fn finite_fit(campaign: &Campaign, model: &Model) -> Result<Fit, FitError> {
    let quick = Options {
        cross_validate: false,
    };
    let found = fit::fit(campaign, model, &quick, |_| {})?;
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
    patterns: Vec<Pattern>,
    candidates: Vec<Candidate>,
    cannot_see: Vec<CannotSee>,
    /// Is anything there?
    alarm: bool,
    /// The effects that explain it best, and the evidence of all and of the first.
    set: Vec<String>,
    set_evidence: f64,
    first_evidence: f64,
    /// What the set is worth on poses left out.
    gain: Option<Gain>,
    /// The same with all that cannot be told from one of them.
    near: Vec<String>,
}

/// Runs all tests on a fit.
fn analyse(campaign: &Campaign, fit: &Fit) -> Analysis {
    let readings = fitted(campaign);
    let mut model = fit.model.clone();
    let base = fit.free.len();
    let mut free = fit.free.clone();
    let mut values = fit.values.clone();
    let mut families: Vec<Family> = Vec::new();
    for entry in CATALOGUE {
        if model.has(entry.id) {
            continue;
        }
        let Ok(effect) = entry.make(toml::Table::new()) else {
            continue;
        };
        families.push(Family::new(&effect, &model, free.len() - base));
        let first = values.len();
        model = model.with(&effect);
        let count = model.start().len();
        free.extend(first..count);
        values.resize(count, 0.0);
    }
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &fit.noise.shape);
    let problem = CampaignProblem::new(&model, &readings, &whiteners, &free, &values);
    let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
    let blocks = problem.blocks(&at);
    let gram = Gram::new(&blocks, base);
    let against = against(fit, &gram);
    let information = gram.families(against.variance);
    let scores: Vec<FamilyScore> = families
        .iter()
        .map(|family| family.score(&information, &against))
        .collect();
    let mut cannot_see = Vec::new();
    let mut tried = Vec::new();
    for (index, (family, score)) in families.iter().zip(&scores).enumerate() {
        match blind(campaign, family.effect.id(), score) {
            Some(why) => cannot_see.push(CannotSee {
                effect: family.effect.id().to_owned(),
                why,
            }),
            None => tried.push(index),
        }
    }
    let left = (gram.rows - gram.rank) as f64;
    let excess = (gram.misfit() / against.variance - left).max(1.0);
    let mut candidates: Vec<Candidate> = tried
        .iter()
        .map(|&index| {
            let score = &scores[index];
            let signal = score.signal();
            Candidate {
                effect: families[index].effect.id().to_owned(),
                log_evidence: score.log_evidence,
                lambda: signal,
                p_value: score.p_value,
                explained: (signal / excess).min(1.0),
            }
        })
        .collect();
    candidates.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    let find = || {
        let set = search::search(&families, &tried, &information, &against, MOST);
        let near = near(&families, &tried, &set.members, &information, &against);
        let folds = Folds::new(&readings, &rows_of(&whiteners), &blocks);
        let gain = gain(&folds, &families, &set.members, &scores, base, &against);
        (set, near, gain)
    };
    let test = || {
        let field = field(&readings, &whiteners, &blocks, &gram, base);
        let contrasts = contrasts::contrasts(&field, &against);
        (
            contrasts,
            patterns::patterns(&field, fit, &whiteners, &against),
        )
    };
    let ((set, near, gain), (contrasts, patterns)) = rayon::join(find, test);
    let id = |&member: &usize| families[member].effect.id().to_owned();
    let ids = |members: &[usize]| members.iter().map(id).collect();
    let lack_of_fit = match fit.noise.source {
        // measured against itself nothing is left over
        Source::Residual => 1.0,
        _ => against.p_value(gram.misfit() / against.variance, left),
    };
    let tests = (contrasts.len() + patterns.len() + 1) as f64;
    let others = contrasts.iter().map(|c| c.p_value);
    let others = others.chain(patterns.iter().map(|p| p.p_value));
    let least = others.fold(lack_of_fit, f64::min);
    Analysis {
        alarm: !set.members.is_empty() || least < ALARM / tests,
        first_evidence: set.members.first().map_or(0.0, |&m| scores[m].log_evidence),
        set_evidence: set.log_evidence,
        gain,
        set: ids(&set.members),
        near: ids(&near),
        contrasts,
        patterns,
        candidates,
        cannot_see,
    }
}

fn rows_of(whiteners: &[noise::Whitener]) -> Vec<usize> {
    whiteners.iter().map(|whitener| whitener.rows).collect()
}

/// What a set is worth, each effect with its most likely size as its prior.
fn gain(
    folds: &Folds,
    families: &[Family],
    members: &[usize],
    scores: &[FamilyScore],
    base: usize,
    against: &Against,
) -> Option<Gain> {
    let without: Vec<(usize, f64)> = (0..base).map(|k| (k, fit::solve::WEAK)).collect();
    let mut with = without.clone();
    for &member in members {
        let prior = against.variance.sqrt() / scores[member].scale;
        let columns = families[member].columns.clone();
        with.extend(columns.map(|k| (base + k, prior)));
    }
    folds.gain(&without, &with, against.variance)
}

/// Why a campaign cannot see a family, if it cannot.
fn blind(campaign: &Campaign, effect: &str, score: &FamilyScore) -> Option<String> {
    let lacks = crate::effects::find(effect).and_then(|entry| {
        let lacking = entry.needs.iter().find(|need| !need.is_met(campaign));
        lacking.map(|need| need.sentence().to_owned())
    });
    if lacks.is_some() {
        return lacks;
    }
    if score.raw > VISIBLE && score.expected < 1e-6 * score.raw {
        return Some("the model already holds all that it can do".to_owned());
    }
    (score.expected < VISIBLE || score.dof == 0).then(|| {
        format!(
            "a typical size would show with λ = {:.1}; {VISIBLE} is needed",
            score.expected
        )
    })
}

/// The members of a set with all families that come near to one of them beside the others, or are known beforehand to
/// imitate it exactly.
fn near(
    families: &[Family],
    tried: &[usize],
    members: &[usize],
    information: &Information,
    against: &Against,
) -> Vec<usize> {
    let mut all = members.to_vec();
    for &member in members {
        let beside = search::beside(families, members, member, information, against);
        let own = families[member].score(&beside, against);
        let known = families[member].effect.aliases();
        for &other in tried.iter().filter(|other| !members.contains(other)) {
            let score = families[other].score(&beside, against);
            let close = score.log_evidence > own.log_evidence - NEAR
                || (known.contains(&families[other].effect.id())
                    && score.signal() > IMITATES * own.signal());
            if close && score.is_sure(ALARM, tried.len()) && !all.contains(&other) {
                all.push(other);
            }
        }
    }
    all
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
