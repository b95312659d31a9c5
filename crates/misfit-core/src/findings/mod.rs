//! What is wrong with a campaign's data, before any effect is asked for.
//!
//! Computed once where a campaign is read. Every decision is a function of plain numbers.

mod doctor;
mod finding;
mod repairs;
mod table;

pub use finding::{Finding, Severity, lines_in_words, worst};

use crate::campaign::Campaign;

/// All findings of a campaign, the worst first.
pub fn findings(campaign: &Campaign) -> Vec<Finding> {
    let mut found = from_reading(campaign);
    let rows: Vec<usize> = (0..campaign.readings.len()).collect();
    if let Some(doctor) = doctor::diagnose(campaign, &rows) {
        found.extend(doctor.findings);
    }
    found.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    found
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
