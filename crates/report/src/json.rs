//! Results as JSON: the contract with users' scripts.

use misfit_core::fit::{Errors, Fit, HeldoutBy, Status, Unobservable};
use serde::Serialize;

/// `misfit.fit/1`.
#[derive(Debug, Serialize)]
pub struct FitDocument {
    schema: &'static str,
    effects: Vec<String>,
    readings: Readings,
    fit: Errors,
    heldout: Option<Errors>,
    heldout_by: Option<HeldoutBy>,
    frames_only: Option<Baseline>,
    noise: NoiseDocument,
    parameters: Vec<ParameterRow>,
    unobservable: Vec<Unobservable>,
    correlations: Vec<Correlation>,
    rank: usize,
    converged: bool,
    iterations: usize,
}

#[derive(Debug, Serialize)]
struct Readings {
    fit: usize,
    heldout: usize,
    rejected: usize,
}

#[derive(Debug, Serialize)]
struct Baseline {
    fit: Errors,
    heldout: Option<Errors>,
}

#[derive(Debug, Serialize)]
struct Correlation {
    a: String,
    b: String,
    value: f64,
}

/// Correlations from this size on are listed.
const STRONG: f64 = 0.9;

fn correlations(fit: &Fit) -> Vec<Correlation> {
    let names: Vec<String> = fit
        .model
        .parameters()
        .map(|(effect, parameter)| format!("{effect}.{}", parameter.name))
        .collect();
    let pairs = fit.correlations(STRONG).into_iter();
    pairs
        .map(|(a, b, value)| Correlation {
            a: names[a].clone(),
            b: names[b].clone(),
            value,
        })
        .collect()
}

/// What the noise was taken to be.
#[derive(Debug, Serialize)]
pub struct NoiseDocument {
    source: misfit_core::fit::noise::Source,
    position_sigma_m: f64,
    orientation_sigma_rad: Option<f64>,
}

#[derive(Debug, Serialize)]
struct ParameterRow {
    effect: String,
    name: String,
    unit: String,
    value: f64,
    std: Option<f64>,
    status: Status,
}

impl FitDocument {
    /// The same of a fit before which so many readings were rejected.
    pub fn with_rejected(mut self, count: usize) -> Self {
        self.readings.rejected = count;
        self
    }
}

/// The document of a fit; `baseline` is the fit of the frames alone.
pub fn fit(fit: &Fit, baseline: Option<&Fit>) -> FitDocument {
    FitDocument {
        schema: "misfit.fit/1",
        effects: fit
            .model
            .terms
            .iter()
            .map(|t| t.effect.id().to_owned())
            .collect(),
        readings: Readings {
            fit: fit.readings.0,
            heldout: fit.readings.1,
            rejected: 0,
        },
        fit: fit.fit,
        heldout: fit.heldout,
        heldout_by: fit.heldout_by,
        frames_only: baseline.map(|b| Baseline {
            fit: b.fit,
            heldout: b.heldout,
        }),
        noise: NoiseDocument::of(fit),
        parameters: fit
            .model
            .parameters()
            .enumerate()
            .map(|(k, (effect, parameter))| ParameterRow {
                effect: effect.to_owned(),
                name: parameter.name.clone(),
                unit: parameter.unit.clone(),
                value: fit.values[k],
                std: fit.std[k].filter(|_| fit.converged),
                status: fit.status[k],
            })
            .collect(),
        unobservable: fit.unobservable.clone(),
        correlations: correlations(fit),
        rank: fit.rank,
        converged: fit.converged,
        iterations: fit.iterations,
    }
}

impl FitDocument {
    /// Did the fit converge?
    pub fn converged(&self) -> bool {
        self.converged
    }
}

impl NoiseDocument {
    /// Of a fit.
    pub fn of(fit: &Fit) -> Self {
        Self {
            source: fit.noise.source,
            position_sigma_m: fit.noise.position_sigma,
            orientation_sigma_rad: fit.noise.orientation_sigma,
        }
    }
}
