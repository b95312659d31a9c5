//! What the campaign cannot see, and what it would need.

use super::Results;
use crate::format::count;
use misfit_campaign::Campaign;

/// What the section shows.
pub(super) struct Section {
    /// The design, and how far it reaches.
    pub design: String,
    /// What would help.
    pub lacks: Vec<String>,
    /// Effects, and why they cannot be seen.
    pub effects: Vec<(String, String)>,
    /// Parameters of the model that the readings do not fix, and why.
    pub parameters: Vec<(String, String)>,
    /// What the reader of the campaign had to say.
    pub warnings: Vec<String>,
    /// Lines left out as outliers.
    pub rejected: String,
}

/// Lines of rejected readings named one by one.
const LINES: usize = 20;

pub(super) fn section(campaign: &Campaign, results: &Results<'_>) -> Section {
    let mut section = Section {
        design: String::new(),
        lacks: Vec::new(),
        effects: Vec::new(),
        parameters: results
            .fit()
            .unobservable
            .iter()
            .map(|row| (row.what.clone(), row.why.clone()))
            .collect(),
        warnings: campaign.warnings.clone(),
        rejected: String::new(),
    };
    let Some(diagnosis) = results.diagnosis() else {
        return section;
    };
    let power = &diagnosis.power;
    section.design = format!(
        "The design has {} × {} × {} × {}. Of the effects that are not in the model it could see {}, and tell {} of \
         them from every other.",
        count(power.poses, "pose"),
        count(power.loads, "load"),
        count(power.directions, "direction"),
        count(power.repeats, "repeat"),
        power.visible,
        power.apart
    );
    section.lacks = power.lacks();
    let blind = diagnosis.cannot_see.iter();
    section.effects = blind
        .map(|row| (row.effect.clone(), row.why.clone()))
        .collect();
    if !diagnosis.rejected.is_empty() {
        let lines = diagnosis.rejected.iter().take(LINES);
        let lines: Vec<String> = lines.map(usize::to_string).collect();
        let more = if diagnosis.rejected.len() > LINES {
            ", …"
        } else {
            ""
        };
        section.rejected = format!(
            "{} rejected as outliers: table lines {}{more}.",
            count(diagnosis.rejected.len(), "reading"),
            lines.join(", ")
        );
    }
    section
}
