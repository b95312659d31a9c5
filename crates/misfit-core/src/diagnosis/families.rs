//! The effects that a model lacks, as columns beside its own: one score each, alone or once others are in.

use super::score::{Against, Information, Score, log_mean};
use crate::effects::AnyEffect;
use crate::model::Model;
use std::ops::Range;
use std::sync::Arc;

/// One effect that may be missing.
#[derive(Debug, Clone)]
pub struct Family {
    /// The effect.
    pub effect: Arc<dyn AnyEffect>,
    /// Its columns among those of all families.
    pub columns: Range<usize>,
    /// Those of one joint or target (or one parameter) each: real faults often have one place.
    groups: Vec<Range<usize>>,
    /// What finding its form cost, nats.
    pub trials: f64,
}

/// A family's score, with all its parameters or with those of one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FamilyScore {
    /// ‖z‖² of all its directions.
    pub chi2: f64,
    /// How many these are.
    pub dof: usize,
    /// Trace of the information of typical sizes before the base model takes its share, and after.
    pub raw: f64,
    /// After: the sensitivity of the campaign to this family.
    pub expected: f64,
    /// Log evidence, nats.
    pub log_evidence: f64,
    /// Size beside the typical one at which it is largest.
    pub scale: f64,
    /// Probability of as much from noise alone.
    pub p_value: f64,
}

impl FamilyScore {
    /// Signal found, noise's share taken off, σ².
    pub fn signal(&self) -> f64 {
        (self.chi2 - self.dof as f64).max(0.0)
    }

    /// Sure enough to be named when so many families are tried?
    pub fn is_sure(&self, alarm: f64, tried: usize) -> bool {
        self.log_evidence > 0.0 && self.p_value < alarm / tried.max(1) as f64
    }
}

impl Family {
    /// A family whose columns begin at `first`.
    pub fn new(effect: &Arc<dyn AnyEffect>, model: &Model, first: usize) -> Self {
        let parameters = effect.parameters(&model.setup);
        let mut groups: Vec<Range<usize>> = Vec::new();
        for index in 0..parameters.len() {
            let at = first + index;
            match groups.last_mut() {
                Some(last) if parameters[index].shares_place_with(&parameters[index - 1]) => {
                    last.end = at + 1;
                }
                _ => groups.push(at..at + 1),
            }
        }
        Self {
            effect: effect.clone(),
            columns: first..first + parameters.len(),
            groups,
            trials: 0.0,
        }
    }

    /// The family of `times` columns for each of its own, in the same order and behind them.
    pub fn widened(&self, times: usize) -> Self {
        let first = self.columns.end;
        let wide = |own: &Range<usize>| {
            let from = |k: usize| first + (k - self.columns.start) * times;
            from(own.start)..from(own.end)
        };
        Self {
            effect: self.effect.clone(),
            columns: wide(&self.columns),
            groups: self.groups.iter().map(wide).collect(),
            trials: 0.0,
        }
    }

    /// Log evidence of it and a widened one together, nats: in all places, or in one.
    pub fn with_widened(&self, wide: &Self, information: &Information) -> f64 {
        let both = |own: &Range<usize>, wide: &Range<usize>| {
            let score = information.score(own);
            let more = information.given(own, score.scale).score(wide);
            score.log_evidence + more.log_evidence
        };
        let all = both(&self.columns, &wide.columns);
        if self.groups.len() < 2 {
            return all;
        }
        let alone = self.groups.iter().zip(&wide.groups);
        let alone: Vec<f64> = alone.map(|(own, wide)| both(own, wide)).collect();
        log_mean(&[all, log_mean(&alone)])
    }

    /// The same effect, in this form or another?
    pub fn is_form_of(&self, other: &Self) -> bool {
        self.effect.id() == other.effect.id()
    }

    /// Its score.
    pub fn score(&self, information: &Information, against: &Against) -> FamilyScore {
        let all = information.score(&self.columns);
        let p = |score: &Score| against.p_value(score.chi2, score.dof as f64);
        let (mut p_value, mut log_evidence) = (p(&all), all.log_evidence);
        if self.groups.len() > 1 {
            let alone: Vec<Score> = self.groups.iter().map(|g| information.score(g)).collect();
            let logs: Vec<f64> = alone.iter().map(|score| score.log_evidence).collect();
            log_evidence = log_mean(&[log_evidence, log_mean(&logs)]);
            let least = alone.iter().map(p).fold(1.0, f64::min);
            p_value = (2.0 * p_value.min(least * alone.len() as f64)).min(1.0);
        }
        FamilyScore {
            chi2: all.chi2,
            dof: all.dof,
            raw: all.raw,
            expected: all.expected,
            log_evidence: log_evidence - self.trials,
            scale: all.scale,
            p_value: (p_value * self.trials.exp()).min(1.0),
        }
    }
}
