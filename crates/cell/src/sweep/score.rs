//! From a case to a row of the sweep's table: what the diagnosis said beside what was hidden.

use super::case::{Case, draw};
use super::hidden::CaseError;
use super::signal;
use crate::campaign::Split;
use crate::diagnosis::{Diagnosis, Verdict, diagnose, next_poses};
use crate::effects::EffectList;
use crate::fit::{self, Options, noise};
use crate::model_file;
use crate::plan::Outlook;
use crate::scenario::Scenario;
use serde::{Deserialize, Serialize};

/// One case. Several words in a cell are joined by `+`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Number of the case.
    pub case: usize,
    /// `one`, `none`, `two`, `outside`.
    pub class: String,
    /// What was hidden.
    pub hidden: String,
    /// Its largest parameter, typical sizes.
    pub size: String,
    /// Its signal beside the base model and the other hidden effect, σ²; the smaller of two.
    pub lambda: f64,
    /// Where laws have another form than the catalogue's: the part of that signal, of all that is hidden, which the
    /// catalogue's law of the same name cannot take up, σ².
    pub deviation: Option<f64>,
    /// The diagnosis' verdict.
    pub verdict: String,
    /// The effects that it names.
    pub named: String,
    /// First of its ranking with evidence in nats, and the second.
    pub ranking: String,
    /// Contrast in which an effect outside the catalogue shows; the one that the diagnosis found.
    pub contrast: String,
    /// The contrast that the diagnosis found to carry most.
    pub contrast_found: String,
    /// Was it right? See [`judge`].
    pub outcome: String,
    /// Share of the misfit that the named effects explain.
    pub explained: f64,
    /// Worth of the best effects on poses left out, as a share of that on poses fitted.
    pub predicted: Option<f64>,
    /// Evidence of all effects, and of the best pattern before and after.
    pub evidence: String,
    /// Whitened rms of the held-out readings: base model.
    pub heldout_base: Option<f64>,
    /// The same with what was named.
    pub heldout_named: Option<f64>,
    /// The same about their true values: noise alone.
    pub heldout_oracle: Option<f64>,
    /// Readings rejected.
    pub rejected: usize,
    /// After an alias verdict: λ that the proposed poses promise, and what they led to.
    pub resolved: String,
}

/// What a row counts as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Named right (or the exact set of aliases, or nothing where there is nothing).
    Right,
    /// The right one, its form said to be wrong or something else left.
    Incomplete,
    /// One of a set that holds the right one.
    InSet,
    /// One of two.
    Partial,
    /// Nothing, though something was there.
    Missed,
    /// "Something unknown".
    Unknown,
    /// A wrong name, or more names than there were effects.
    Wrong,
}

impl Outcome {
    /// Its word in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::Right => "right",
            Self::Incomplete => "incomplete",
            Self::InSet => "in_set",
            Self::Partial => "partial",
            Self::Missed => "missed",
            Self::Unknown => "unknown",
            Self::Wrong => "wrong",
        }
    }
}

/// Draws a case, diagnoses it without its truth, and scores the answer.
///
/// # Errors
/// As [`draw`], and if there is no fit.
pub fn score(scenario: &Scenario, number: usize) -> Result<Row, CaseError> {
    let case = draw(scenario, number)?;
    let model = model_file::model(&case.campaign, &EffectList::DEFAULT, None)?;
    let quick = Options {
        cross_validate: false,
    };
    let found = diagnose(&case.campaign, &model, &[], &quick, |_| {})?;
    let mut row = row(&case, &found);
    let wanted = scenario
        .blind
        .as_ref()
        .map_or(0, |blind| blind.resolve_poses);
    if wanted > 0 && found.verdict == Verdict::Alias {
        row.resolved = resolve(&case, &found, wanted)?;
    }
    Ok(row)
}

/// Measures again with the proposed poses beside the others: `named` right now, another verdict, or that no poses
/// `cannot` tell, as the plan says.
fn resolve(case: &Case, found: &Diagnosis, poses: usize) -> Result<String, CaseError> {
    let Some(plan) = next_poses(&case.campaign, found, poses)? else {
        return Ok("cannot".to_owned());
    };
    let hidden = |way: &&crate::plan::Way| case.hidden.contains(&way.effect);
    let way = plan.ways.iter().find(hidden);
    if way.is_none_or(|way| way.outlook() != Outlook::Decisive) {
        return Ok("cannot".to_owned());
    }
    let mut scenario = case.scenario.clone();
    scenario.design.more = plan.poses;
    let campaign = super::case::measured(&scenario, &case.plant)?;
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None)?;
    let quick = Options {
        cross_validate: false,
    };
    let again = diagnose(&campaign, &model, &[], &quick, |_| {})?;
    Ok(match judge(case, &again) {
        Outcome::Right if again.verdict == Verdict::Named => "named".to_owned(),
        _ => word(again.verdict).to_owned(),
    })
}

fn row(case: &Case, found: &Diagnosis) -> Row {
    let first = |count: usize| {
        let best = found.candidates.iter().take(count);
        let words: Vec<String> = best
            .map(|c| format!("{} {:.1}", c.effect, c.log_evidence))
            .collect();
        words.join("+")
    };
    let sizes: Vec<String> = case.sizes.iter().map(|size| format!("{size:.3}")).collect();
    Row {
        case: case.number,
        class: case.class.word().to_owned(),
        hidden: case.hidden.join("+"),
        size: sizes.join("+"),
        lambda: case.lambdas.iter().copied().reduce(f64::min).unwrap_or(0.0),
        deviation: case.deviation,
        verdict: word(found.verdict).to_owned(),
        named: found.effects.join("+"),
        ranking: first(2),
        contrast: case.contrast.unwrap_or("").to_owned(),
        contrast_found: found.class().unwrap_or("").to_owned(),
        outcome: judge(case, found).word().to_owned(),
        explained: found.explained(),
        predicted: found.predicted,
        evidence: format!(
            "{:.1}/{:.1}/{:.1}",
            found.evidence,
            pattern(&found.patterns),
            pattern(&found.patterns_left)
        ),
        heldout_base: heldout(case, &found.base),
        heldout_named: heldout(case, &found.fit),
        heldout_oracle: case.oracle,
        rejected: found.rejected.len(),
        resolved: String::new(),
    }
}

fn pattern(patterns: &[crate::diagnosis::Pattern]) -> f64 {
    patterns.first().map_or(0.0, |pattern| pattern.log_evidence)
}

fn word(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Nothing => "nothing",
        Verdict::Named => "named",
        Verdict::NamedIncomplete => "named_incomplete",
        Verdict::Alias => "alias",
        Verdict::Unknown => "unknown",
        Verdict::CannotTell => "cannot_tell",
    }
}

/// Whitened rms of held-out readings, by the noise that the campaign states.
fn heldout(case: &Case, fit: &fit::Fit) -> Option<f64> {
    let readings = signal::readings(&case.campaign, Split::Heldout);
    if readings.is_empty() {
        return None;
    }
    let stated = case.campaign.noise.unwrap_or(case.scenario.noise);
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &stated);
    Some(fit::errors(&fit.model, &fit.values, &readings, &whiteners).whitened_rms)
}

/// What an answer counts as.
pub fn judge(case: &Case, found: &Diagnosis) -> Outcome {
    let hidden = &case.hidden;
    let known = crate::effects::CATALOGUE
        .iter()
        .any(|entry| hidden.iter().any(|id| id == entry.id));
    let set = |names: &[String]| {
        let mut names = names.to_vec();
        names.sort();
        names
    };
    let same = set(hidden) == set(&found.effects);
    match found.verdict {
        Verdict::Nothing if hidden.is_empty() => Outcome::Right,
        Verdict::Nothing => Outcome::Missed,
        Verdict::Unknown if !hidden.is_empty() && !known => Outcome::Right,
        Verdict::Unknown | Verdict::CannotTell => Outcome::Unknown,
        Verdict::Named if same => Outcome::Right,
        Verdict::NamedIncomplete if same => Outcome::Incomplete,
        Verdict::Alias
            if !hidden.is_empty() && hidden.iter().all(|id| found.effects.contains(id)) =>
        {
            // no more in the set than what imitates a hidden one exactly
            let imitates = |id: &str| {
                let mut aliases = hidden.iter().filter_map(|id| crate::effects::find(id));
                aliases.any(|entry| entry.aliases.contains(&id))
            };
            let mut others = found.effects.iter().filter(|id| !hidden.contains(id));
            if others.all(|id| imitates(id)) {
                Outcome::Right
            } else {
                Outcome::InSet
            }
        }
        Verdict::Named if found.effects.iter().all(|id| hidden.contains(id)) => Outcome::Partial,
        _ => Outcome::Wrong,
    }
}
