//! The falling error: from frames alone, rung by rung, until nothing more is detectable.
//!
//! The first rungs are what every robot has: joint offsets, full geometry, joint compliance where something loads
//! the joints. From there on each rung is what the diagnosis names.

use crate::campaign::Campaign;
use crate::diagnosis::{self, Diagnosis};
use crate::fit::{self, Errors, Fit, FitError, Options};
use crate::model_file::{self, ModelError};

/// One rung.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Rung {
    /// `nominal` (the frames alone) or the effect added.
    pub added: String,
    /// Errors of the fitted readings.
    pub fit: Errors,
    /// Errors of readings not fitted.
    pub heldout: Option<Errors>,
}

/// A climbed ladder.
#[derive(Debug, Clone)]
pub struct Ladder {
    /// Rungs from the frames on.
    pub rungs: Vec<Rung>,
    /// The diagnosis at which it ended.
    pub last: Diagnosis,
}

/// Why there is no ladder.
#[derive(Debug, thiserror::Error)]
pub enum LadderError {
    /// A model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A fit.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// Climbs the ladder of a campaign.
///
/// # Errors
/// If a model or a fit cannot be made.
pub fn climb(
    campaign: &Campaign,
    options: &Options,
    mut on_step: impl FnMut(&str),
) -> Result<Ladder, LadderError> {
    let rung = |added: &str, fit: &Fit| Rung {
        added: added.to_owned(),
        fit: fit.fit,
        heldout: fit.heldout,
    };
    let mut rungs = Vec::new();
    let frames = model_file::frames_only(campaign)?;
    on_step("frames");
    rungs.push(rung(
        "nominal",
        &fit::fit(campaign, &frames, options, |_| {})?,
    ));
    let default = model_file::model(campaign, None, None)?;
    // joint_offset is part of geometry: a rung of its own, then replaced
    for names in ["joint_offset", "geometry"] {
        on_step(names);
        let model = model_file::model(campaign, Some(names), None)?;
        rungs.push(rung(names, &fit::fit(campaign, &model, options, |_| {})?));
    }
    if default.has("joint_compliance") {
        on_step("joint_compliance");
        let fit = fit::fit(campaign, &default, options, |_| {})?;
        rungs.push(rung("joint_compliance", &fit));
    }
    let last = diagnosis::diagnose(campaign, &default, options, &mut on_step)?;
    // the diagnosis may name several: one rung each
    let mut model = default;
    for (place, &effect) in last.named.iter().enumerate() {
        let Some(term) = last.fit.model.term(effect) else {
            continue;
        };
        model = model.with(&term.effect);
        on_step(effect);
        let fit = if place + 1 == last.named.len() {
            last.fit.clone()
        } else {
            fit::fit(campaign, &model, options, |_| {})?
        };
        rungs.push(rung(effect, &fit));
    }
    Ok(Ladder { rungs, last })
}
