//! After an alias verdict: the poses that would tell its effects apart.

use super::{Diagnosis, Verdict, fitted};
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

/// The poses to be measured besides, so that the first two effects of an alias verdict that cannot be told apart can
/// be, both at the sizes that the campaign gives them; none for other verdicts.
///
/// # Errors
/// If there is no such plan.
pub fn next_poses(
    campaign: &Campaign,
    diagnosis: &Diagnosis,
    poses: usize,
) -> Result<Option<Separation>, NextError> {
    let (Verdict::Alias, Some((first, second))) = (diagnosis.verdict, &diagnosis.alike) else {
        return Ok(None);
    };
    // beside what is named otherwise
    let base = diagnosis.fit.model.without(first.id());
    let size = |effect: &Arc<dyn AnyEffect>| -> Result<Vec<f64>, FitError> {
        let model = base.with(effect);
        let fit = fit::refit(campaign, &model, &diagnosis.fit)?;
        let term = model.term(effect.id());
        Ok(term.map_or_else(Vec::new, |term| term.of(&fit.values).to_vec()))
    };
    let sizes = [size(first)?, size(second)?];
    let readings = fitted(campaign);
    let bare = fit::refit(campaign, &base, &diagnosis.base)?;
    let task = Task::after(&bare, &readings, poses);
    let sizes = [Some(&sizes[0][..]), Some(&sizes[1][..])];
    Ok(Some(plan::separate(&task, [first, second], sizes)?))
}
