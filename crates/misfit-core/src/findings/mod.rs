//! What is wrong with a campaign's data, before any effect is asked for.
//!
//! Computed once where a campaign is read. Every decision is a function of plain numbers.

mod doctor;
mod finding;
mod linear;
mod loads;
mod repairs;
mod repeats;
mod rows;
mod sizes;
mod stations;
mod strays;
mod table;

pub use finding::{Finding, Severity, lines_in_words, worst};

use crate::campaign::{Campaign, Reading, Split};
use crate::fit::Fit;
use linear::LinearFit;
use rows::BadRows;
use std::collections::BTreeSet;
use table::{FramesAlone, Table};

/// All findings of a campaign, the worst first.
pub fn findings(campaign: &Campaign) -> Vec<Finding> {
    let mut found = from_reading(campaign);
    let slides: Vec<bool> = (0..campaign.robot.joints.len())
        .map(|joint| !table::turns(&campaign.robot, joint))
        .collect();
    let bad = BadRows::of(&campaign.readings, &slides);
    found.extend(bad.findings(campaign));
    let unusable = bad.unusable();
    // readings held out are only shown
    let usable: Vec<usize> = (0..campaign.readings.len())
        .filter(|&row| campaign.readings[row].split == Split::Fit)
        .filter(|row| unusable.binary_search(row).is_err())
        .collect();
    found.extend(repeats::unstated(campaign));
    let doctor = doctor::diagnose(campaign, &usable);
    let fitted: Vec<&Reading> = usable.iter().map(|&row| &campaign.readings[row]).collect();
    found.extend(repeats::findings(campaign, &fitted));
    let wrench = loads::wrenches(campaign, &fitted);
    match doctor {
        Some(doctor) if doctor.agrees => {
            found.extend(of_the_model(campaign, &usable, &doctor.frames, wrench));
        }
        doctor => {
            found.extend(doctor.into_iter().flat_map(|doctor| doctor.findings));
            found.extend(wrench);
        }
    }
    found.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    found
}

/// What only the usual model can see: rows and poses far off, springs, and signs of the wrench.
fn of_the_model(
    campaign: &Campaign,
    rows: &[usize],
    frames: &FramesAlone,
    wrench: Option<Finding>,
) -> Vec<Finding> {
    let readings: Vec<&Reading> = rows.iter().map(|&row| &campaign.readings[row]).collect();
    let sizes = frames.sizes_of(&campaign.robot, &Table::of(campaign, rows));
    let middle = table::quantile(&sizes, 0.5);
    let weights: Vec<f64> = sizes
        .iter()
        .map(|size| 1.0 / (1.0 + (size / (2.0 * middle)).powi(2)))
        .collect();
    let start = frames.start_on_links(campaign);
    let Some(mut fit) = LinearFit::of(campaign, &readings, weights.clone(), &start) else {
        return wrench.into_iter().collect();
    };
    let mut found = strays::of(campaign, &readings, &mut fit).findings(&readings);
    if let Some(wrench) = wrench {
        let reversed: Vec<Reading> = readings.iter().map(|r| loads::reversed(r)).collect();
        let reversed: Vec<&Reading> = reversed.iter().collect();
        let other = LinearFit::of(campaign, &reversed, weights, &start);
        let noise = other.map_or(f64::INFINITY, |other| other.position_noise());
        found.push(loads::confirmed(wrench, noise / fit.position_noise()));
    }
    let by_wrench = readings.iter().any(|r| r.wrench.is_some());
    if fit.dof() >= strays::MIN_DOF {
        let springs = fit.springs();
        found.extend(springs.and_then(|springs| loads::springs(&springs, by_wrench)));
        let positions: Vec<_> = readings.iter().map(|r| r.position).collect();
        let spread = table::spread(&positions);
        found.extend(sizes::too_good(fit.position_noise(), spread));
    }
    found
}

/// Lines of the rows and poses that the others contradict or that hold no position, rising: what no fit is to follow.
pub fn strays(findings: &[Finding]) -> Vec<usize> {
    let strays = findings.iter().filter(|finding| {
        strays::KINDS.contains(&finding.kind) || finding.kind == rows::ZERO_POSITION
    });
    let lines: BTreeSet<usize> = strays
        .flat_map(|finding| finding.lines.iter().copied())
        .collect();
    lines.into_iter().collect()
}

/// Findings that only a fit can make: corrections beyond what robots have.
pub fn of_a_fit(campaign: &Campaign, fit: &Fit) -> Vec<Finding> {
    sizes::findings(campaign, fit)
}

/// What the reader of the files had to say.
fn from_reading(campaign: &Campaign) -> Vec<Finding> {
    let of = |texts: &[String], severity| {
        let each = texts.iter();
        each.map(|text| Finding::new("reading", severity, text.clone()))
            .collect::<Vec<_>>()
    };
    let mut found = of(&campaign.warnings, Severity::Warning);
    found.extend(of(&campaign.notes, Severity::Note));
    found
}
