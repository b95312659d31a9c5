//! All tests on one fit: which effects could explain what it leaves, which set of them explains it best, what looks like
//! these, and what is there that no effect of the catalogue has.

use super::columns::{columns, columns_of, field, insert};
use super::contrasts::{self, Contrast};
use super::families::{Family, FamilyScore};
use super::patterns::{self, Pattern};
use super::power::{self, Power};
use super::ripple::{self, Wave};
use super::score::{Against, Gram, Information};
use super::{
    ALARM, Candidate, CannotSee, MAX_NAMED_EFFECTS, MIN_NATS_TO_TELL, VISIBLE, fitted, motion,
    search,
};
use crate::campaign::{Campaign, Reading, conditions};
use crate::effects::{AnyEffect, CATALOGUE, Role};
use crate::fit::leave_out::{self, Gain};
use crate::fit::noise::{self, Source};
use crate::fit::{self, Fit};
use crate::model::Model;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::sync::Arc;

/// A second effect of which the first could take up this share, and with less signal than the first's law need be wrong
/// by, may be no more than the first's form.
const MIN_SHARE_TAKEN_UP: f64 = 0.3;
/// Share of an effect's signal by which its law may be wrong.
const MAX_ERROR_OF_LAW: f64 = 0.05;
/// What is known to imitate an effect does so if it explains this share of its signal, and what it does not explain
/// would not tell.
const MIN_SHARE_IMITATED: f64 = 0.8;

/// An effect, and those that cannot be told from it.
type Alike = (Arc<dyn AnyEffect>, Vec<Arc<dyn AnyEffect>>);

/// All tests on one fit.
#[derive(Clone)]
pub(super) struct Analysis {
    pub(super) contrasts: Vec<Contrast>,
    pub(super) patterns: Vec<Pattern>,
    pub(super) candidates: Vec<Candidate>,
    pub(super) cannot_see: Vec<CannotSee>,
    /// Is anything there?
    pub(super) alarm: bool,
    /// The effects that explain it best, and the evidence of all and of the first.
    pub(super) set: Vec<Arc<dyn AnyEffect>>,
    pub(super) set_evidence: f64,
    pub(super) first_evidence: f64,
    /// What the set is worth on poses left out.
    pub(super) gain: Option<Gain>,
    /// Are all of the set but the one that explains most perhaps no more than that one's form?
    pub(super) one_form: bool,
    /// By effect of the set: those that cannot be told from it.
    pub(super) near: Vec<Alike>,
    /// Log evidence of each family alone, all its parameters together.
    pub(super) alone: Vec<(Arc<dyn AnyEffect>, f64)>,
    /// What could be seen.
    pub(super) power: Power,
    /// Waves of a gear that the scan found.
    pub(super) waves: Vec<Wave>,
}

/// Effects that a model lacks: of the catalogue, those that need no options, in all their forms, and the user's own.
pub(super) fn lacking(model: &Model, own: &[Arc<dyn AnyEffect>]) -> Vec<Arc<dyn AnyEffect>> {
    let entries = CATALOGUE.iter().filter(|entry| !model.has(entry.id));
    let made = entries.flat_map(|entry| entry.all_forms());
    let own = own.iter().filter(|effect| !model.has(effect.id())).cloned();
    made.chain(own).collect()
}

/// Runs all tests on a fit; `with_waves`: the scan for those of a gear too.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub(super) fn analyse(
    campaign: &Campaign,
    fit: &Fit,
    own: &[Arc<dyn AnyEffect>],
    with_waves: bool,
) -> Analysis {
    let readings = fitted(campaign);
    let answers = motion::answers(fit, &readings);
    let whiteners = noise::whiteners_of(&answers.0, &readings, &fit.noise.shape);
    let effects = lacking(&fit.model, own);
    let (mut families, mut blocks) = columns(fit, &effects, &readings, &whiteners);
    let base = fit.free.len();
    let forms: Vec<usize> = families
        .iter()
        .map(|own| families.iter().filter(|f| own.is_form_of(f)).count())
        .collect();
    for (family, forms) in families.iter_mut().zip(forms) {
        family.trials = (forms as f64).ln();
    }
    let mut gram = Gram::new(&blocks, base);
    let motions = motion::motions(fit, answers, &whiteners);
    let mut waves = Vec::new();
    if with_waves {
        let against = against(fit, &gram);
        let found = ripple::scan(fit, &readings, &motions, &blocks, base, &against, ALARM);
        if let Some(found) = found
            && let Some(model) = ripple::with(&fit.model, &found.waves)
            && let Some(term) = model.term_of(Role::Ripple)
        {
            let effect = term.effect.clone();
            let first = blocks[0].ncols() - 1 - base;
            let (own, rows) = columns_of(fit, &[&effect], Some(first), &readings, &whiteners);
            for mut family in own {
                family.trials = found.trials;
                families.push(family);
            }
            insert(&mut blocks, rows);
            gram.insert(&blocks, families[families.len() - 1].columns.len());
            waves = found.waves;
        }
    }
    let against = against(fit, &gram);
    let information = gram.families(against.variance);
    let scores: Vec<FamilyScore> = families
        .par_iter()
        .map(|family| family.score(&information, &against))
        .collect();
    let alone = families.iter().map(|family| {
        let score = information.score(&family.columns);
        (family.effect.clone(), score.log_evidence)
    });
    let alone = alone.collect();
    // waves of the usual cycles, or those found?
    let mut beaten = None;
    if !waves.is_empty() {
        let found = families.len() - 1;
        let usual = families
            .iter()
            .position(|f| f.effect.role() == Some(Role::Ripple));
        beaten = usual.filter(|&usual| usual != found);
        if let Some(usual) = beaten
            && scores[usual].log_evidence > scores[found].log_evidence
        {
            beaten = Some(found);
            waves.clear();
        }
    }
    let mut cannot_see = Vec::new();
    let mut tried = Vec::new();
    for (index, (family, score)) in families.iter().zip(&scores).enumerate() {
        if beaten == Some(index) {
            continue;
        }
        match blind(campaign, family.effect.as_ref(), score) {
            Some(why) => cannot_see.push(CannotSee {
                effect: family.effect.id().to_owned(),
                why,
            }),
            None => tried.push(index),
        }
    }
    // what is seen in one form is seen; what is in none is said once
    let mut said: Vec<String> = Vec::new();
    cannot_see.retain(|blind| {
        let seen = |&index: &usize| families[index].effect.id() == blind.effect;
        let first = !tried.iter().any(seen) && !said.contains(&blind.effect);
        if first {
            said.push(blind.effect.clone());
        }
        first
    });
    let see = || {
        let power = Power {
            rows: gram.rows,
            taken: gram.rank,
            ..Power::of(campaign)
        };
        power.seeing(&families, &scores, &tried, &information)
    };
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
    // the best form of each effect
    let mut listed: Vec<String> = Vec::new();
    candidates.retain(|candidate| {
        let first = !listed.contains(&candidate.effect);
        if first {
            listed.push(candidate.effect.clone());
        }
        first
    });
    let find = || {
        let set = search::search(&families, &tried, &information, &against, MAX_NAMED_EFFECTS);
        let near = near(&families, &tried, &set.members, &information, &against);
        let members: Vec<(&Family, f64)> = set
            .members
            .iter()
            .map(|&m| (&families[m], scores[m].scale))
            .collect();
        let gain = gain(&readings, &whiteners, &blocks, &members, base, &against);
        let one_form = is_one_form(&families, &scores, &set.members, &information, &against);
        (set, near, gain, one_form)
    };
    let test = || {
        let field = field(&readings, &whiteners, &blocks, &gram, base);
        let contrasts = contrasts::contrasts(
            &field,
            &conditions(&readings, campaign.noise.as_ref()),
            &against,
        );
        (
            contrasts,
            patterns::patterns(&field, fit, &motions, &against),
        )
    };
    let ((set, near, gain, one_form), ((contrasts, patterns), power)) =
        rayon::join(find, || rayon::join(test, see));
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
        set: set
            .members
            .iter()
            .map(|&m| families[m].effect.clone())
            .collect(),
        one_form,
        near,
        contrasts,
        patterns,
        candidates,
        cannot_see,
        alone,
        power,
        waves,
    }
}

/// What a set is worth, each effect with its most likely size as its prior; none if it is empty.
fn gain(
    readings: &[&Reading],
    whiteners: &[noise::Whitener],
    blocks: &[DMatrix<f64>],
    members: &[(&Family, f64)],
    base: usize,
    against: &Against,
) -> Option<Gain> {
    if members.is_empty() {
        return None;
    }
    let mut priors = vec![fit::solve::WEAK; base];
    let mut picked: Vec<usize> = (0..base).collect();
    for (family, scale) in members {
        let columns = family.columns.clone();
        priors.extend(columns.clone().map(|_| against.variance.sqrt() / scale));
        picked.extend(columns.map(|k| base + k));
    }
    picked.extend(blocks.first().map(|block| block.ncols() - 1));
    let pick = |block: &DMatrix<f64>| block.select_columns(&picked);
    let rows = whiteners.iter().map(|whitener| whitener.rows);
    let normals = leave_out::by_folds(readings, rows, blocks, pick);
    Gain::of(&normals, base, &priors, against.variance)
}

/// Why a campaign cannot see a family, if it cannot.
fn blind(campaign: &Campaign, effect: &dyn AnyEffect, score: &FamilyScore) -> Option<String> {
    if let Some(need) = effect.needs().iter().find(|need| !need.is_met(campaign)) {
        return Some(need.sentence().to_owned());
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

/// By member of a set: the families that come near to it beside the others, or are known beforehand to imitate it
/// exactly.
fn near(
    families: &[Family],
    tried: &[usize],
    members: &[usize],
    information: &Information,
    against: &Against,
) -> Vec<Alike> {
    let effect = |family: usize| families[family].effect.clone();
    let of = |&member: &usize| {
        let beside = search::beside(families, members, member, information, against);
        let own = families[member].score(&beside, against);
        let known = families[member].effect.aliases();
        let close = |&other: &usize| {
            let score = families[other].score(&beside, against);
            let imitates = known.contains(&families[other].effect.id())
                && score.signal() > MIN_SHARE_IMITATED * own.signal()
                && own.signal() - score.signal() < crate::plan::DECISIVE;
            (imitates || score.log_evidence > own.log_evidence - MIN_NATS_TO_TELL)
                && score.is_sure(ALARM, tried.len())
        };
        let others = tried.iter().copied().filter(|&other| {
            let same = |&member: &usize| families[member].is_form_of(&families[other]);
            !members.iter().any(same)
        });
        // of each effect its best form
        let mut close: Vec<(usize, f64)> = others
            .filter(close)
            .map(|other| (other, families[other].score(&beside, against).log_evidence))
            .collect();
        let all = close.clone();
        close.retain(|&(other, evidence)| {
            let better = |&(form, more): &(usize, f64)| {
                families[form].is_form_of(&families[other])
                    && (more > evidence || (more == evidence && form < other))
            };
            !all.iter().any(better)
        });
        let close = close.into_iter().map(|(other, _)| effect(other));
        (effect(member), close.collect())
    };
    members.iter().map(of).collect()
}

/// Do the effects of a set beside the one that explains most look like it, and have so little signal that they may only
/// repair its form? Less than would tell two effects for sure, and than its law may be wrong by.
fn is_one_form(
    families: &[Family],
    scores: &[FamilyScore],
    members: &[usize],
    information: &Information,
    against: &Against,
) -> bool {
    let evidence = |a: &&usize, b: &&usize| {
        let (a, b) = (&scores[**a], &scores[**b]);
        a.log_evidence.total_cmp(&b.log_evidence)
    };
    let Some(&main) = members.iter().max_by(evidence) else {
        return false;
    };
    let limit = crate::plan::DECISIVE.min(MAX_ERROR_OF_LAW * scores[main].signal());
    let with_main = information.given(&families[main].columns, power::STRETCH);
    let only_repairs = |&&other: &&usize| {
        let own = families[other].columns.clone();
        let left: f64 = own.map(|k| with_main.matrix[(k, k)]).sum();
        let beside = search::beside(families, members, other, information, against);
        left <= (1.0 - MIN_SHARE_TAKEN_UP) * scores[other].expected
            && families[other].score(&beside, against).signal() < limit
    };
    let mut others = members.iter().filter(|&&other| other != main);
    members.len() > 1 && others.all(|other| only_repairs(&other))
}

/// The noise to test against: of repeats, of the file, or of what is left.
pub(super) fn against(fit: &Fit, gram: &Gram) -> Against {
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
