//! Which variable carries the error, and how an effect fits through it.
//!
//! What the readings show of an effect, and the effect as fitted, against the variable that carries it: without the
//! effect and with it.

use super::against::{Bin, EFFECT, MEANS, averaged, bins, range, scatter};
use super::pull::{Pull, Seen, along, of_joint, pull, seen, turned};
use super::variables::{Variable, bare, carrying, different, variables};
use super::{Picture, ReportError, Results, fitted, rms, thinned};
use crate::diagnosis::{p_value, words};
use crate::format::{length, number};
use misfit_campaign::{Campaign, Reading};
use misfit_core::diagnosis::{Diagnosis, Pattern, VISIBLE, Verdict, ripple};
use misfit_core::effects::{AnyEffect, Role};
use misfit_core::fit::Fit;
use misfit_core::fit::noise::Source;
use nalgebra::Vector6;
use std::sync::Arc;

/// What the section shows.
pub(super) struct Section {
    /// What there is, or why there is nothing.
    pub note: String,
    pub plots: Vec<Plot>,
    pub contrasts: Vec<Contrast>,
    /// Is there a column of what the named effects leave?
    pub left: bool,
    /// What the misfit follows, in words.
    pub patterns: Vec<String>,
}

/// An effect, or a pattern without a name.
pub(super) struct Plot {
    /// The effect; empty if it is none.
    pub effect: String,
    /// How large it is, and where most, in a sentence.
    pub most: String,
    pub title: String,
    pub words: String,
    pub pictures: Vec<Picture>,
    pub variable: String,
    pub unit: &'static str,
    /// Is there an effect to be left out?
    pub named: bool,
    pub bins: Vec<Bin>,
}

/// Between what the misfit differs.
pub(super) struct Contrast {
    pub words: &'static str,
    pub before: String,
    pub p_before: String,
    pub after: String,
    pub p_after: String,
}

/// Readings computed and drawn at most.
const MOST: usize = 1000;
/// Effects drawn at most.
const EFFECTS: usize = 3;
/// A variable is said to carry the misfit below this probability.
const CARRIES: f64 = 1e-4;

pub(super) fn section(campaign: &Campaign, results: &Results<'_>) -> Result<Section, ReportError> {
    let all = fitted(campaign);
    let kept = thinned(all.len(), MOST);
    let readings: Vec<&Reading> = kept.iter().map(|&k| all[k]).collect();
    let mut plots = Vec::new();
    let note;
    match results.diagnosis() {
        Some(diagnosis) if diagnosis.named.is_empty() => {
            let pattern = match diagnosis.verdict {
                Verdict::Unknown => unnamed(diagnosis, &readings)?,
                _ => None,
            };
            note = match (diagnosis.verdict, &pattern) {
                (Verdict::Nothing, _) => "No variable carries the error: what is left is noise, as far as this \
                                          campaign can tell."
                    .to_owned(),
                (_, Some(_)) => "No effect of the catalogue is drawn: none explains it. The line is the mean of the \
                                 points about it; where they keep away from zero, the model fails."
                    .to_owned(),
                _ => "No single variable of the readings carries the error.".to_owned(),
            };
            plots.extend(pattern);
        }
        diagnosis => {
            let fit = results.fit();
            let ids = match diagnosis {
                Some(diagnosis) => diagnosis.named.clone(),
                None => added(fit, results.before()),
            };
            let seen = seen(fit, &readings);
            let mut drawn = Vec::new();
            for term in ids.iter().filter_map(|id| fit.model.term(id)) {
                drawn.push(pull(fit, term, &readings));
            }
            drawn.sort_by(|a, b| b.size.total_cmp(&a.size));
            for pull in drawn.iter().take(EFFECTS) {
                let waves = diagnosis.map_or(&[][..], |d| &d.waves);
                plots.push(match pull.size.powi(2) * all.len() as f64 >= VISIBLE {
                    true => named(fit, &seen, pull, &readings, waves)?,
                    false => unmoved(pull),
                });
            }
            note = match plots.iter().all(|plot| plot.pictures.is_empty()) {
                true if !plots.is_empty() => String::new(),
                true => "The model holds no effect beside frames and geometry that could be drawn.".to_owned(),
                false => "Of each effect two pictures on one scale: without it, what the readings show when it is left out of \
                          the model and all other parameters are kept, with the fitted effect as a line; with it, what \
                          is left. A good effect follows the points and leaves a band without a shape."
                    .to_owned(),
            };
        }
    }
    // without a noise that is known, the misfit itself is the unit
    let known = results.fit().noise.source != Source::Residual;
    let few = match readings.len() < all.len() {
        true => format!(" {} of {} readings are drawn.", readings.len(), all.len()),
        false => String::new(),
    };
    let diagnosis = results.diagnosis();
    Ok(Section {
        note: note + &few,
        plots,
        contrasts: diagnosis.filter(|_| known).map_or_else(Vec::new, contrasts),
        left: diagnosis.is_some_and(|d| !d.steps.is_empty()),
        patterns: diagnosis.map_or_else(Vec::new, patterns),
    })
}

/// Effects that a fit has and the one before has not; without one before, those beside frames and geometry.
fn added(fit: &Fit, before: Option<&Fit>) -> Vec<String> {
    let effects = fit.model.terms.iter().map(|term| &term.effect);
    let new = |effect: &&Arc<dyn AnyEffect>| {
        let usual = effect.role().is_some_and(Role::is_kinematic);
        !usual && before.is_none_or(|fit| !fit.model.has(effect.id()))
    };
    effects
        .filter(new)
        .map(|effect| effect.id().to_owned())
        .collect()
}

fn contrasts(diagnosis: &Diagnosis) -> Vec<Contrast> {
    let row = |contrast: &misfit_core::diagnosis::Contrast| {
        let left = diagnosis
            .contrasts_left
            .iter()
            .find(|c| c.name == contrast.name);
        let ratio = |c: &misfit_core::diagnosis::Contrast| format!("× {}", number(c.ratio.sqrt()));
        Contrast {
            words: words(contrast.name),
            before: ratio(contrast),
            p_before: p_value(contrast.p_value),
            after: left.map_or_else(String::new, ratio),
            p_after: left.map_or_else(String::new, |c| p_value(c.p_value)),
        }
    };
    diagnosis.contrasts.iter().map(row).collect()
}

fn patterns(diagnosis: &Diagnosis) -> Vec<String> {
    let carried = diagnosis.patterns.iter().filter(|p| p.p_value < CARRIES);
    let say = |p: &misfit_core::diagnosis::Pattern| {
        format!(
            "as if there were {}, {} (evidence {:+.0} nats)",
            p.words,
            p_value(p.p_value),
            p.log_evidence
        )
    };
    carried.take(2).map(say).collect()
}

/// An effect of the model.
fn named(
    fit: &Fit,
    seen: &[Seen],
    pull: &Pull,
    readings: &[&Reading],
    waves: &[ripple::Wave],
) -> Result<Plot, ReportError> {
    let turned = turned(fit, seen, pull);
    let shown = match turned {
        Some(place) => of_joint(fit, seen, place, &pull.moves),
        None => along(seen, &pull.moves),
    };
    let keep = different(readings, &shown.pull);
    let all = variables(fit, seen, readings, turned, waves);
    let (variable, carried) = match carrying(all, &shown.pull, &keep) {
        Some(variable) => (variable, true),
        // no single variable: against what the effect itself says
        None => {
            let own = Variable {
                name: format!("what {} predicts, {}", pull.id, shown.unit),
                values: shown.pull.iter().map(|x| x * shown.scale).collect(),
                decimals: 1,
            };
            (own, false)
        }
    };
    let size = format!(
        "{} {}",
        number(rms(shown.pull.iter().map(|x| x * shown.scale))),
        shown.unit
    );
    let (part, most) = match &pull.part {
        Some((joint, count)) if *count > 1 => (
            format!(" Of its {count} joints {joint} is shown, which matters most."),
            format!("Most of it is on joint {joint}: {size} rms."),
        ),
        _ => (String::new(), format!("It makes an error of {size} rms.")),
    };
    let words = match carried {
        true => format!("Shown {}.{part}", shown.words),
        false => format!(
            "No single variable carries it: what the readings show of it, {}, against what it predicts.{part}",
            shown.words
        ),
    };
    let without: Vec<f64> = shown
        .left
        .iter()
        .zip(&shown.pull)
        .map(|(left, pull)| (left + pull) * shown.scale)
        .collect();
    let with: Vec<f64> = shown.left.iter().map(|x| x * shown.scale).collect();
    let effect: Vec<f64> = shown.pull.iter().map(|x| x * shown.scale).collect();
    let line = averaged(&variable.values, &effect, EFFECT);
    let title = format!("{} against {}", pull.id, bare(&variable.name));
    let name = format!("fitted {}", pull.id);
    let (before, after) = (rms(without.iter().copied()), rms(with.iter().copied()));
    let scale = range(&without, &effect, &with);
    let pictures = vec![
        scatter(
            &format!("without {}", pull.id),
            (&variable, &shown.quantity),
            (&without, 0),
            Some((name, line)),
            scale,
            format!("rms {} {}", number(before), shown.unit),
        )?,
        scatter(
            &format!("with {}", pull.id),
            (&variable, &shown.quantity),
            (&with, 1),
            None,
            scale,
            format!("rms {} {}", number(after), shown.unit),
        )?,
    ];
    Ok(Plot {
        effect: pull.id.clone(),
        most,
        title,
        words,
        pictures,
        bins: bins(&variable, &without, &with),
        variable: variable.name,
        unit: shown.unit,
        named: true,
    })
}

/// An effect that hardly moves the target: other readings show it.
fn unmoved(pull: &Pull) -> Plot {
    let moves = rms(pull.moves.iter().map(|row| row.fixed_rows::<3>(0).norm()));
    let most = format!(
        "It hardly moves the target ({} rms): the wrist wrenches show it.",
        length(moves)
    );
    Plot {
        effect: pull.id.clone(),
        title: pull.id.clone(),
        words: format!("{most} There is nothing to draw of positions."),
        most,
        pictures: Vec::new(),
        variable: String::new(),
        unit: "",
        named: true,
        bins: Vec::new(),
    }
}

/// What a pattern without a name says: the misfit of the base model against its variable.
fn unnamed(diagnosis: &Diagnosis, readings: &[&Reading]) -> Result<Option<Plot>, ReportError> {
    let fit = &diagnosis.base;
    let patterns = diagnosis.patterns.iter();
    let sure = patterns.filter(|pattern| pattern.log_evidence > 0.0);
    let seen = seen(fit, readings);
    for (place, pattern) in sure.enumerate() {
        if let Some(mut plot) = against_its_variable(diagnosis, &seen, pattern, readings)? {
            if place > 0 {
                plot.words = format!(
                    "What explains most follows no single variable; this is the nearest that does. {}",
                    plot.words
                );
            }
            return Ok(Some(plot));
        }
    }
    Ok(None)
}

/// One pattern, if it follows a variable of single readings.
fn against_its_variable(
    diagnosis: &Diagnosis,
    seen: &[Seen],
    pattern: &Pattern,
    readings: &[&Reading],
) -> Result<Option<Plot>, ReportError> {
    let fit = &diagnosis.base;
    let setup = &fit.model.setup;
    // patterns say in words which joint errs: the longest name that fits is it
    let errs = |place: &usize| {
        let joint = &setup.robot.joints[setup.observed[*place]].name;
        pattern.words.starts_with(&format!("an error of {joint} "))
    };
    let place = (0..setup.observed.len()).find(errs);
    let nothing = vec![Vector6::zeros(); readings.len()];
    let shown = match place {
        Some(place) => of_joint(fit, seen, place, &nothing),
        None => {
            let moves: Vec<Vector6<f64>> = seen.iter().map(|seen| seen.left).collect();
            let mut shown = along(seen, &moves);
            shown.pull = vec![0.0; moves.len()];
            shown
        }
    };
    let all = variables(fit, seen, readings, place, &diagnosis.waves);
    let named = |variable: &&Variable| {
        let name = variable.name.as_str();
        let rest = name.strip_prefix(pattern.variable.as_str());
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(',') || rest.starts_with(" ("))
    };
    let Some(variable) = all.iter().find(named) else {
        return Ok(None);
    };
    let left: Vec<f64> = shown.left.iter().map(|x| x * shown.scale).collect();
    let line = averaged(&variable.values, &left, MEANS);
    let picture = scatter(
        "what the model leaves",
        (variable, &shown.quantity),
        (&left, 0),
        Some(("mean".to_owned(), line)),
        range(&left, &left, &left),
        format!("rms {} {}", number(rms(left.iter().copied())), shown.unit),
    )?;
    Ok(Some(Plot {
        effect: String::new(),
        most: String::new(),
        title: format!("the misfit against {}", bare(&variable.name)),
        words: format!(
            "It is as if there were {}. Shown {}.",
            pattern.words, shown.words
        ),
        pictures: vec![picture],
        bins: bins(variable, &left, &left),
        variable: variable.name.clone(),
        unit: shown.unit,
        named: false,
    }))
}
