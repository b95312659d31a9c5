//! Poses that tell two effects apart: T-optimal, both ways round.
//!
//! λ is the signal of one effect that the base model and the other effect cannot take up; a diagnosis names the right
//! one of two where λ is some tens.

use super::criterion::Apart;
use super::{Information, PlanError, Task, median};
use crate::effects::AnyEffect;
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use std::ops::Range;
use std::sync::Arc;

/// From this λ on the right effect is named in more than nine of ten cases (3225 simulated ones, λ of 60 to 100).
pub const DECISIVE: f64 = 60.0;
/// Below this λ an effect is not seen at all.
const SEEN: f64 = 9.0;
/// Less than this share of an effect's signal is rounding and linearisation: the other takes up all of it.
const ALL: f64 = 1e-3;

/// One way round: the effect is there, the other is put in its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Way {
    /// The effect that is there.
    pub effect: String,
    /// The one that is put in its place.
    pub other: String,
    /// λ of the readings measured already.
    pub measured: f64,
    /// λ with random poses besides, the median design.
    pub random: f64,
    /// λ with the proposed poses besides.
    pub proposed: f64,
    /// λ with the proposed poses if the other effect is left out: what there is to be told apart.
    pub alone: f64,
}

/// What a λ is good for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outlook {
    /// The proposed poses will tell.
    Decisive,
    /// They will not; so many times as many readings would.
    Weak,
    /// The effect does not show in such readings.
    Unseen,
    /// No poses will tell: whatever the effect does, the other does too.
    Never,
}

impl Way {
    /// What the proposed poses are good for.
    pub fn outlook(&self) -> Outlook {
        if self.proposed >= DECISIVE {
            Outlook::Decisive
        } else if self.alone < SEEN {
            Outlook::Unseen
        } else if self.proposed < ALL * self.alone {
            Outlook::Never
        } else {
            Outlook::Weak
        }
    }

    /// Share of the effect's signal that the other takes up.
    pub fn taken_up(&self) -> f64 {
        if self.alone > 0.0 {
            (1.0 - self.proposed / self.alone).max(0.0)
        } else {
            1.0
        }
    }
}

/// Poses that tell two effects apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Separation {
    /// Joint angles of the proposed poses, rad or m.
    pub poses: Vec<Vec<f64>>,
    /// Both ways round.
    pub ways: [Way; 2],
}

/// Chooses the poses of a task that best tell two effects apart.
///
/// The base model is the task's without them; an effect that it holds is taken at its values there, others at zero.
/// `sizes` are values of each effect's parameters that λ is meant for, as fitted; without them λ is that of typical
/// sizes, summed over the parameters.
///
/// # Errors
/// If there are no postures to choose from, or an effect has no free parameters.
pub fn separate(
    task: &Task<'_>,
    effects: [&Arc<dyn AnyEffect>; 2],
    sizes: [Option<&[f64]>; 2],
) -> Result<Separation, PlanError> {
    let mut model = task.model.clone();
    let mut values = task.values.to_vec();
    for effect in effects {
        if !model.has(effect.id()) {
            model = model.with(effect);
            values.resize(model.start().len(), 0.0);
        }
    }
    let (free, criterion) = columns(&model, effects, sizes)?;
    let information = Information::gather(task, &model, &values, &free)?;
    let none = || PlanError::Measured;
    let designs = information.random_designs(&criterion, task.poses, task.seed);
    let mut random = [Vec::new(), Vec::new()];
    for design in &designs {
        let lambdas = criterion
            .lambdas(&information.of(design))
            .ok_or_else(none)?;
        random[0].push(lambdas[0]);
        random[1].push(lambdas[1]);
    }
    let taken = information.best(&criterion, &designs[..1]);
    let measured = criterion.lambdas(&information.measured).ok_or_else(none)?;
    let best = information.of(&taken);
    let proposed = criterion.lambdas(&best).ok_or_else(none)?;
    let alone = criterion.alone(&best).ok_or_else(none)?;
    let random = random.map(median);
    let way = |own: usize| Way {
        effect: effects[own].id().to_owned(),
        other: effects[1 - own].id().to_owned(),
        measured: measured[own],
        random: random[own],
        proposed: proposed[own],
        alone: alone[own],
    };
    Ok(Separation {
        poses: taken
            .into_iter()
            .map(|k| information.postures[k].clone())
            .collect(),
        ways: [way(0), way(1)],
    })
}

/// Free parameters, those of the two effects last, and the criterion over them.
fn columns(
    model: &Model,
    effects: [&Arc<dyn AnyEffect>; 2],
    sizes: [Option<&[f64]>; 2],
) -> Result<(Vec<usize>, Apart), PlanError> {
    let of = |id: &str| -> Vec<usize> {
        let Some(term) = model.term(id) else {
            return Vec::new();
        };
        let parameters = term.parameters.iter().enumerate();
        parameters
            .filter(|(_, parameter)| parameter.vary)
            .map(|(k, _)| term.first + k)
            .collect()
    };
    let others = model
        .terms
        .iter()
        .map(|term| term.effect.id())
        .filter(|id| effects.iter().all(|effect| effect.id() != *id));
    let mut free: Vec<usize> = others.flat_map(of).collect();
    let base = free.len();
    let typical: Vec<f64> = model.parameters().map(|(_, p)| p.typical).collect();
    let mut ranges: Vec<Range<usize>> = Vec::new();
    let mut weights: Vec<DMatrix<f64>> = Vec::new();
    for (effect, size) in effects.into_iter().zip(sizes) {
        let own = of(effect.id());
        if own.is_empty() {
            return Err(PlanError::Nothing {
                effect: effect.id().to_owned(),
            });
        }
        let first = model.term(effect.id()).map_or(0, |term| term.first);
        let count = own.len();
        weights.push(match size {
            None => DMatrix::identity(count, count),
            Some(size) => {
                let theta = own
                    .iter()
                    .map(|&k| size.get(k - first).copied().unwrap_or(0.0) / typical[k]);
                let theta = DVector::from_iterator(count, theta);
                &theta * theta.transpose()
            }
        });
        ranges.push(free.len()..free.len() + count);
        free.extend(own);
    }
    let [first, second] = [ranges[0].clone(), ranges[1].clone()];
    let sizes = [weights[0].clone(), weights[1].clone()];
    Ok((
        free,
        Apart {
            base,
            effects: [first, second],
            sizes,
        },
    ))
}
