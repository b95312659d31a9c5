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
    let usable: Vec<usize> = (0..campaign.readings.len())
        .filter(|row| unusable.binary_search(row).is_err())
        .collect();
    let doctor = doctor::diagnose(campaign, &usable);
    let fitted: Vec<&Reading> = usable
        .iter()
        .map(|&row| &campaign.readings[row])
        .filter(|reading| reading.split == Split::Fit)
        .collect();
    found.extend(repeats::findings(campaign, &fitted));
    found.extend(loads::wrenches(campaign, &fitted));
    if let Some(doctor) = doctor {
        found.extend(doctor.findings);
        if doctor.agrees {
            found.extend(of_the_model(campaign, &usable));
        }
    }
    found.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    found
}

/// What only the usual model can see: rows and poses far off.
fn of_the_model(campaign: &Campaign, usable: &[usize]) -> Vec<Finding> {
    let readings: Vec<&Reading> = usable
        .iter()
        .map(|&row| &campaign.readings[row])
        .filter(|reading| reading.split == Split::Fit)
        .collect();
    let table = Table::of(campaign, usable);
    let sizes = FramesAlone::fit(&campaign.robot, &table, 6).sizes();
    let middle = table::quantile(&sizes, 0.5);
    let all = usable.iter().zip(&sizes);
    let weights = all
        .filter(|(row, _)| campaign.readings[**row].split == Split::Fit)
        .map(|(_, size)| 1.0 / (1.0 + (size / (2.0 * middle)).powi(2)))
        .collect();
    let Some(mut fit) = LinearFit::of(campaign, &readings, weights) else {
        return Vec::new();
    };
    let strays = strays::of(campaign, &readings, &mut fit);
    let mut found = strays.findings(&readings);
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
