//! After an alias verdict: the poses that would tell its effects apart.

use super::{Diagnosis, fitted};
use crate::campaign::Campaign;
use crate::effects::AnyEffect;
use crate::fit::{self, FitError};
use crate::plan::{self, PlanError, Separation, Task};
use std::sync::Arc;

/// Poses proposed after an alias verdict.
pub const POSES: usize = 15;

/// Why no poses are proposed.
#[derive(Debug, thiserror::Error)]
pub enum NextError {
    /// An effect cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// There is no plan.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// The poses to be measured besides, so that effects of an alias verdict can be told apart, at the sizes that the
/// campaign gives them; of several pairs the one that is hardest to tell. None for other verdicts.
///
/// # Errors
/// If there is no such plan.
pub fn next_poses(
    campaign: &Campaign,
    diagnosis: &Diagnosis,
    poses: usize,
) -> Result<Option<Separation>, NextError> {
    let campaign = &diagnosis.screened(campaign);
    let mut hardest: Option<Separation> = None;
    let least = |plan: &Separation| plan.ways[0].proposed.min(plan.ways[1].proposed);
    for (first, second) in &diagnosis.alike {
        let plan = apart(campaign, diagnosis, [first, second], poses)?;
        if hardest
            .as_ref()
            .is_none_or(|known| least(&plan) < least(known))
        {
            hardest = Some(plan);
        }
    }
    Ok(hardest)
}

fn apart(
    campaign: &Campaign,
    diagnosis: &Diagnosis,
    pair: [&Arc<dyn AnyEffect>; 2],
    poses: usize,
) -> Result<Separation, NextError> {
    // beside what is named otherwise
    let base = diagnosis.fit.model.without(pair[0].id());
    let size = |effect: &Arc<dyn AnyEffect>| -> Result<Vec<f64>, FitError> {
        let model = base.with(effect);
        let fit = fit::refit(campaign, &model, &diagnosis.fit)?;
        let term = model.term(effect.id());
        Ok(term.map_or_else(Vec::new, |term| term.of(&fit.values).to_vec()))
    };
    let sizes = [size(pair[0])?, size(pair[1])?];
    let readings = fitted(campaign);
    let bare = fit::refit(campaign, &base, &diagnosis.base)?;
    let task = Task::after(&bare, &readings, poses);
    let sizes = [Some(&sizes[0][..]), Some(&sizes[1][..])];
    Ok(plan::separate(&task, pair, sizes)?)
}
