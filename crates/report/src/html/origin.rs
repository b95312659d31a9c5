//! How the report was made: all that is needed to make it again.

use super::Results;
use crate::format::{angle, count, length, number};
use misfit_campaign::Campaign;
use misfit_core::findings::Finding;
use misfit_core::fit::noise::Source;

/// What only the caller knows.
#[derive(Debug, Clone, PartialEq)]
pub struct Origin {
    /// The command line, without where the report goes.
    pub command: String,
    /// What to go on with.
    pub next: Vec<Step>,
    /// Seed of a simulation.
    pub seed: Option<u64>,
    /// What was found in the data before anything was fitted.
    pub findings: Vec<Finding>,
}

/// Something to do, and the command that does it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Step {
    /// In words, without a full stop.
    pub what: String,
    /// The command line.
    pub command: String,
}

impl Step {
    /// Both.
    pub fn new(what: impl Into<String>, command: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            command: command.into(),
        }
    }
}

/// What the section shows: a name and what it is.
pub(super) struct Section {
    pub rows: Vec<(&'static str, String)>,
}

pub(super) fn section(campaign: &Campaign, results: &Results<'_>, origin: &Origin) -> Section {
    let fit = results.fit();
    let ids: Vec<&str> = fit.model.terms.iter().map(|t| t.effect.id()).collect();
    let noise = &fit.noise;
    let mut sizes = length(noise.position_sigma);
    if let Some(sigma) = noise.orientation_sigma {
        sizes += &format!(", {}", angle(sigma));
    }
    let source = match (noise.source, noise.replicates) {
        (Source::Replicates, Some(pure)) => format!(
            "from {} of repeats, {} degrees of freedom{}",
            count(pure.groups, "group"),
            pure.dof,
            match campaign.noise {
                Some(_) => format!(
                    "; {} × what the campaign file says",
                    number(noise.factor.sqrt())
                ),
                None => String::new(),
            }
        ),
        (Source::Campaign, _) => "as the campaign file says; no repeats to check it".to_owned(),
        _ => "from what the fit leaves: errors of the model count as noise".to_owned(),
    };
    let rejected = results.diagnosis().map_or(0, |d| d.rejected.len());
    let targets: Vec<&str> = campaign.targets.iter().map(|t| t.name.as_str()).collect();
    let mut rows = vec![
        ("version", format!("misfit {}", env!("CARGO_PKG_VERSION"))),
        ("command", origin.command.clone()),
        ("campaign", campaign.name.clone()),
        (
            "robot",
            format!("{} ({})", campaign.robot.name, campaign.robot_file.name),
        ),
        ("targets", targets.join(", ")),
        (
            "readings",
            format!(
                "{} fitted, {} held out, {rejected} rejected",
                fit.readings.0, fit.readings.1
            ),
        ),
        ("model", ids.join(" + ")),
        ("noise", format!("{sizes} a coordinate (1 σ), {source}")),
    ];
    if let Some(seed) = origin.seed {
        rows.push(("seed", seed.to_string()));
    }
    Section { rows }
}
