//! What a case hides.

use super::outside::Outside;
use crate::effects::AnyEffect;
use crate::model_file::ModelError;
use crate::plant::PlantSpec;
use crate::scenario::{ScenarioError, Truth};
use std::sync::Arc;

/// Why a case cannot be drawn.
#[derive(Debug, thiserror::Error)]
pub enum CaseError {
    /// Its scenario or plant.
    #[error(transparent)]
    Scenario(#[from] ScenarioError),
    /// The base model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// Its diagnosis.
    #[error(transparent)]
    Fit(#[from] crate::fit::FitError),
    /// The poses after an alias verdict.
    #[error(transparent)]
    Next(#[from] crate::diagnosis::NextError),
    /// Its scenario has no `[blind]`.
    #[error("{file}: has no [blind] table: it is no sweep. `misfit run {file}` runs it once")]
    NotBlind {
        /// Scenario file.
        file: String,
    },
}

/// Something hidden, in units of what was drawn for it.
#[derive(Debug, Clone)]
pub(super) enum Hidden {
    Effect {
        effect: Arc<dyn AnyEffect>,
        /// Parameters at size one.
        values: Vec<(String, f64)>,
        /// Largest of them, typical sizes.
        largest: f64,
        /// What the plant has beside the catalogue's law.
        twist: Option<Twist>,
    },
    Outside(Outside),
}

/// A law a little different from the catalogue's.
#[derive(Debug, Clone)]
pub(super) enum Twist {
    /// A third harmonic of this size on each joint, by joint.
    ThirdHarmonic(Vec<(usize, f64)>),
    /// A drift that slows down: the time `u` from the first reading, at `start` (s from the middle), counts as
    /// `T (1 - exp(-u/T))`.
    SlowsDown { start: f64, constant: f64 },
    /// An expansion of this curvature, 1/K: a temperature `ΔT` above the mean counts as `ΔT (1 + b ΔT)`.
    Bent(f64),
}

impl Twist {
    pub(super) fn install(&self, size: f64, plant: &mut PlantSpec) {
        match self {
            Self::ThirdHarmonic(of) => {
                let of = of.clone();
                plant.command_laws.push(Arc::new(move |command, angles| {
                    for &(joint, share) in &of {
                        angles[joint] += size * share * (3.0 * command.joints[joint] + 0.7).sin();
                    }
                }));
            }
            Self::SlowsDown { start, constant } => {
                let (start, constant) = (*start, *constant);
                for law in &mut plant.tracker_laws {
                    let straight = law.clone();
                    *law = Arc::new(move |command, pose| {
                        let mut slowed = command.clone();
                        slowed.time = -constant * (-(command.time - start) / constant).exp_m1();
                        straight(&slowed, pose);
                    });
                }
            }
            Self::Bent(curvature) => plant.expansion_curvature = *curvature,
        }
    }
}

/// The truths as the catalogue can say them.
pub(super) fn truths(hidden: &[Hidden], sizes: &[f64]) -> Vec<Truth> {
    let of = |(hidden, &size): (&Hidden, &f64)| match hidden {
        Hidden::Effect { effect, values, .. } => Some(Truth {
            effect: effect.clone(),
            values: values
                .iter()
                .map(|(name, value)| (name.clone(), value * size))
                .collect(),
        }),
        Hidden::Outside(_) => None,
    };
    hidden.iter().zip(sizes).filter_map(of).collect()
}
