//! The verdict in words, and the few numbers behind it.

use super::carrier::Plot;
use super::{Origin, Results, Step};
use crate::diagnosis::refusal;
use crate::format::{count, length, number};
use misfit_campaign::Campaign;
use misfit_core::diagnosis::{Diagnosis, Verdict};
use misfit_core::effects::find;
use misfit_core::fit::noise::Source;
use misfit_core::fit::{Errors, Fit, HeldoutBy};

/// What the section shows.
pub(super) struct Section {
    /// The campaign, the robot, the readings.
    pub subtitle: String,
    /// `good`, `found` or `unsure`: the colour beside it, which says nothing that the words do not.
    pub tone: &'static str,
    /// The verdict in a sentence.
    pub headline: String,
    /// What it means, a paragraph each.
    pub paragraphs: Vec<String>,
    /// Numbers: what, how much, and from where it fell.
    pub numbers: Vec<Number>,
    /// What to do first.
    pub first: Option<Step>,
}

/// A number worth a place at the top.
pub(super) struct Number {
    pub what: &'static str,
    pub value: String,
    pub from: Option<String>,
}

/// Error of held-out poses over that of fitted ones from which on the model has more freedom than the readings hold.
const OVERFIT_RATIO: f64 = 2.0;

/// `plots` are what the next section but one shows of the effects.
pub(super) fn section(
    campaign: &Campaign,
    results: &Results<'_>,
    plots: &[Plot],
    origin: &Origin,
) -> Section {
    let fit = results.fit();
    let ((tone, headline), mut paragraphs) = match results.diagnosis() {
        Some(diagnosis) => (headline(diagnosis), explained(diagnosis, plots)),
        None => fitted(fit, results.before()),
    };
    if !fit.converged {
        paragraphs.insert(
            0,
            format!(
                "The fit has NOT CONVERGED after {}: all figures are where it stopped.",
                count(fit.iterations, "step")
            ),
        );
    }
    paragraphs.extend(too_free(fit));
    let held = match fit.readings.1 {
        0 => String::new(),
        n => format!(", {n} held out"),
    };
    Section {
        subtitle: format!(
            "robot {}, {} fitted{held}",
            campaign.robot.name,
            count(fit.readings.0, "reading")
        ),
        tone: if fit.converged { tone } else { "unsure" },
        headline,
        paragraphs,
        numbers: numbers(results),
        first: origin.next.first().cloned(),
    }
}

/// A warning if fitted readings look much better than held-out ones.
fn too_free(fit: &Fit) -> Option<String> {
    let held = fit.heldout?;
    let ratio = held.position_rms_m / fit.fit.position_rms_m;
    let noise = fit.noise.position_sigma * 3f64.sqrt();
    (ratio > OVERFIT_RATIO && held.position_rms_m > OVERFIT_RATIO * noise).then(|| {
        format!(
            "Poses that were not fitted are off by {}, {} × as much as fitted ones: the model has more freedom than \
             these readings hold. Trust that error, not the other; more poses make it smaller.",
            length(held.position_rms_m),
            number(ratio)
        )
    })
}

/// Tone and headline of a verdict.
fn headline(diagnosis: &Diagnosis) -> (&'static str, String) {
    let effects = diagnosis.effects.join(", ");
    let power = &diagnosis.power;
    let (is, be) = match diagnosis.effects.len() {
        1 => ("is", "it"),
        _ => ("are", "them"),
    };
    match diagnosis.verdict {
        Verdict::Unknown if diagnosis.stopped => (
            "unsure",
            "Something is missing; it was told to stop before it looked for what.".to_owned(),
        ),
        Verdict::Nothing | Verdict::Unknown if !power.is_enough() => (
            "unsure",
            "This campaign cannot say what is missing.".to_owned(),
        ),
        // a design that tells hardly any effect from the others has not said much
        Verdict::Nothing if 2 * power.apart < power.visible => (
            "unsure",
            format!(
                "Nothing detectable is missing, but this campaign could hardly show it: of the {} that a typical size \
                 would show it tells {} from every other.",
                count(power.visible, "effect"),
                power.apart
            ),
        ),
        Verdict::Nothing => (
            "good",
            "Nothing detectable is missing: the model explains these readings down to their noise."
                .to_owned(),
        ),
        Verdict::Named => (
            "found",
            format!("{effects} {is} missing; with {be}, nothing more is detectable."),
        ),
        Verdict::NamedIncomplete => (
            "unsure",
            format!(
                "{effects} {is} missing, but something is left that no effect of the catalogue explains."
            ),
        ),
        Verdict::Alias => (
            "unsure",
            format!("One of {effects} is missing; this campaign cannot tell which."),
        ),
        Verdict::CannotTell => (
            "unsure",
            format!(
                "Nothing can be told: {}.",
                diagnosis.untold.as_deref().unwrap_or("there is no fit")
            ),
        ),
        Verdict::Unknown => (
            "unsure",
            "Something is missing that the catalogue does not hold.".to_owned(),
        ),
    }
}

/// What a verdict means, a paragraph each.
fn explained(diagnosis: &Diagnosis, plots: &[Plot]) -> Vec<String> {
    let power = &diagnosis.power;
    let mut paragraphs: Vec<String> = Vec::new();
    for effect in &diagnosis.effects {
        let term = diagnosis.fit.model.term(effect);
        let kind = term.map_or(effect.as_str(), |term| term.effect.kind());
        if let Some(entry) = find(kind) {
            let evidence = diagnosis.candidates.iter().find(|c| c.effect == *effect);
            let evidence = evidence.map_or_else(String::new, |found| {
                format!(
                    " Signal λ {}, evidence {:+.0} nats.",
                    number(found.lambda),
                    found.log_evidence
                )
            });
            let most = plots.iter().find(|plot| plot.effect == *effect);
            let most = most.map_or_else(String::new, |plot| format!(" {}", plot.most));
            paragraphs.push(format!(
                "{effect}: {}{most}{evidence}",
                entry.summary().replace('`', "")
            ));
        }
    }
    if diagnosis.verdict == Verdict::NamedIncomplete {
        paragraphs.push("The form of what was found may be wrong.".to_owned());
    }
    if diagnosis.verdict == Verdict::Unknown
        && !diagnosis.stopped
        && let Some(pattern) = diagnosis.patterns.first()
    {
        paragraphs.push(format!(
            "The error is as if there were {} (evidence {:+.0} nats).",
            pattern.words, pattern.log_evidence
        ));
    }
    if let Some(effect) = &diagnosis.refused {
        paragraphs.push(format!("Not added: {}.", refusal(effect)));
    }
    if diagnosis.verdict == Verdict::Nothing && power.is_enough() {
        paragraphs.push(format!(
            "Of the effects that are not in the model this campaign would show {} at a typical size, and tell {} of them from \
             every other. What it cannot show may be there all the same: see what this campaign cannot see.",
            power.visible, power.apart
        ));
    }
    if diagnosis.stopped {
        paragraphs.push(
            "The tests still alarm: this model is not the last word on these readings.".to_owned(),
        );
    }
    if !power.is_enough() {
        let lacks = power.lacks();
        let needed = match lacks.is_empty() {
            true => "more poses, heavier loads".to_owned(),
            false => lacks.join("; "),
        };
        paragraphs.push(format!(
            "No diagnosis is possible: of {} rows measured {} go into the model; what is left of most effects, \
             another one could be. Needed: {needed}.",
            power.rows, power.taken
        ));
    }
    paragraphs
}

/// The same of a fit without a diagnosis.
fn fitted(fit: &Fit, before: Option<&Fit>) -> ((&'static str, String), Vec<String>) {
    let left = length(fit.fit.position_rms_m);
    let headline = match before {
        Some(frames) => format!(
            "The model brings the error of the fitted readings from {} to {left}.",
            length(frames.fit.position_rms_m)
        ),
        None => format!("The model leaves an error of {left} in the fitted readings."),
    };
    if fit.noise.source == Source::Residual {
        let says = "Nothing says how large the noise is (no repeats, none in the campaign file): it is taken from what \
                    the fit leaves, and errors of the model count as noise.";
        return (("unsure", headline), vec![says.to_owned()]);
    }
    let ratio = in_noise(fit, &fit.fit);
    // a tenth more than noise is more than chance gives a campaign of some tens of readings
    let (tone, says) = if ratio < 1.1 {
        ("good", "no more than noise leaves")
    } else {
        (
            "unsure",
            "more than noise leaves: an effect may be missing, which misfit diagnose names",
        )
    };
    let says = format!("That is {} × the noise, {says}.", number(ratio));
    ((tone, headline), vec![says])
}

/// Whitened error over what noise gives.
fn in_noise(fit: &Fit, errors: &Errors) -> f64 {
    (errors.whitened_rms.powi(2) / fit.noise.factor).sqrt()
}

fn numbers(results: &Results<'_>) -> Vec<Number> {
    let fit = results.fit();
    let rungs = results.rungs();
    let first = rungs.first().filter(|_| rungs.len() > 1);
    let mut numbers = vec![Number {
        what: "error of the fitted readings, rms",
        value: length(fit.fit.position_rms_m),
        from: first.map(|rung| length(rung.fit.position_rms_m)),
    }];
    if let Some(held) = fit.heldout {
        let before = first.and_then(|rung| rung.heldout);
        numbers.push(Number {
            what: match fit.heldout_by {
                Some(HeldoutBy::CrossValidation) => "of poses not fitted (cross-validated)",
                _ => "of readings held out",
            },
            value: length(held.position_rms_m),
            from: before.map(|errors| length(errors.position_rms_m)),
        });
    }
    if fit.noise.source != Source::Residual {
        numbers.push(Number {
            what: "noise alone would leave",
            value: length(fit.noise.position_sigma * 3f64.sqrt()),
            from: None,
        });
        numbers.push(Number {
            what: "what is left, in noise",
            value: format!("× {}", number(in_noise(fit, &fit.fit))),
            from: None,
        });
    }
    numbers
}
