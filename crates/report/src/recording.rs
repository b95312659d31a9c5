//! A fit, a diagnosis or a ladder as what a recording keeps: what each of its models says of every reading.

use super::diagnosis::words_of_verdict;
use super::format::{angle, length};
use super::ladder::stopped_because;
use misfit_campaign::recording::{Progress, Results, Step};
use misfit_campaign::{Campaign, Reading};
use misfit_core::diagnosis::Diagnosis;
use misfit_core::fit::alike::Alike;
use misfit_core::fit::{Errors, Fit};
use misfit_core::ladder::Ladder;
use nalgebra::Isometry3;
use std::fmt::Write;

/// A fit beside that of the frames alone, if it has more than them.
pub fn of_fit(campaign: &Campaign, baseline: Option<&Fit>, fit: &Fit) -> Results {
    let steps = baseline.map(|fit| ("nominal", fit)).into_iter();
    let steps: Vec<(&str, &Fit)> = steps.chain([("fitted", fit)]).collect();
    let verdict = match fit.converged {
        true => "fitted; `misfit diagnose` says what is missing",
        false => "the fit did not converge",
    };
    results(campaign, &steps, verdict)
}

/// A diagnosis: the frames alone, the model as it was given, and each effect added.
pub fn of_diagnosis(campaign: &Campaign, frames: &Fit, diagnosis: &Diagnosis) -> Results {
    let given = [("nominal", frames), ("model", &diagnosis.base)];
    let added = diagnosis.steps.iter().map(|(id, fit)| (id.as_str(), fit));
    let steps: Vec<(&str, &Fit)> = given.into_iter().chain(added).collect();
    results(campaign, &steps, &said(diagnosis))
}

/// A ladder, rung by rung.
pub fn of_ladder(campaign: &Campaign, ladder: &Ladder) -> Results {
    let names = ladder.rungs.iter().map(|rung| rung.added.as_str());
    let steps: Vec<(&str, &Fit)> = names.zip(&ladder.fits).collect();
    let why = stopped_because(ladder);
    results(
        campaign,
        &steps,
        &format!("{}\n\nstopped: {why}", said(&ladder.last)),
    )
}

fn said(diagnosis: &Diagnosis) -> String {
    let words = words_of_verdict(diagnosis);
    let words = words.trim_start_matches("verdict").trim();
    format!("**{words}**")
}

fn results(campaign: &Campaign, steps: &[(&str, &Fit)], verdict: &str) -> Results {
    let mut found = Results {
        verdict: markdown(campaign, steps, verdict),
        ..Results::default()
    };
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    for (index, (added, fit)) in steps.iter().enumerate() {
        let is_last = index + 1 == steps.len();
        let model = &fit.model;
        let alike = Alike::of(model, &readings);
        let seen = alike.map(model, &readings, |workspace, reading| {
            let predicted = workspace.predict(model, &fit.values, reading);
            Seen {
                target: Isometry3::from_parts(predicted.position.into(), predicted.orientation),
                tracker: workspace.base_from_tracker(),
                links: match is_last {
                    true => workspace.links(&model.setup),
                    false => Vec::new(),
                },
                torques: match is_last {
                    true => workspace.torques(model, reading),
                    false => Vec::new(),
                },
            }
        });
        let first = seen.first().map(|seen| seen.tracker);
        found.steps.push(Step {
            added: (*added).to_owned(),
            fitted_rms_m: fit.fit.position_rms_m,
            heldout_rms_m: fit.heldout.map(|errors| errors.position_rms_m),
            base_from_tracker: first.unwrap_or_else(Isometry3::identity),
            predicted: seen.iter().map(|seen| seen.target).collect(),
        });
        let costs = (1..).zip(&fit.costs);
        found
            .progress
            .extend(costs.map(|(iteration, cost)| Progress {
                step: index,
                iteration,
                cost: *cost,
            }));
        if is_last {
            (found.links, found.torques) = seen.into_iter().map(|s| (s.links, s.torques)).unzip();
        }
    }
    found
}

/// What a model says of one reading.
#[derive(Clone)]
struct Seen {
    target: Isometry3<f64>,
    tracker: Isometry3<f64>,
    links: Vec<Isometry3<f64>>,
    torques: Vec<f64>,
}

fn markdown(campaign: &Campaign, steps: &[(&str, &Fit)], verdict: &str) -> String {
    let mut text = format!(
        "# {}\n\nrobot {} · {} readings\n\n{verdict}\n\n\
         | model | fitted, rms | not fitted, rms | orientation, rms |\n|---|---|---|---|\n",
        campaign.name,
        campaign.robot.name,
        campaign.readings.len()
    );
    for (index, (added, fit)) in steps.iter().enumerate() {
        let cell = |errors: Option<Errors>| {
            errors.map_or("—".to_owned(), |errors| length(errors.position_rms_m))
        };
        let turned = fit.fit.orientation_rms_rad.map_or("—".to_owned(), angle);
        let name = match (index, *added) {
            (0, "nominal") => "frames alone".to_owned(),
            (_, "model" | "fitted") => {
                let effects = fit.model.terms.iter().map(|term| term.effect.id());
                effects.collect::<Vec<_>>().join(" + ")
            }
            (0, added) => added.to_owned(),
            (_, added) => format!("+ {added}"),
        };
        let _ = writeln!(
            text,
            "| {name} | {} | {} | {turned} |",
            length(fit.fit.position_rms_m),
            cell(fit.heldout)
        );
    }
    text
}
