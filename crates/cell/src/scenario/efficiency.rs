//! How good is the estimator? Many campaigns of one scenario, each with its own poses and noise, against
//! the Cramér-Rao bound.
//!
//! For every compliance that a campaign can see, `z = (estimate - truth) / σ_CRB`, the bound taken at the truth
//! with the true noise. The pooled variance efficiency is `1 / mean(z²)`; its own standard deviation from N
//! independent z is `efficiency · √(2/N)`.

use super::{Scenario, ScenarioError, simulate};
use crate::campaign::{Campaign, Split};
use crate::effects::{Parameter, Role};
use crate::fit::solve::Problem;
use crate::fit::{CampaignProblem, Options, Status, fit, noise, paper, solve::Spectrum};
use crate::model::Model;
use crate::model_file;
use rayon::prelude::*;
use serde::Serialize;

/// Sums over campaigns.
#[derive(Debug, Clone, Default)]
pub struct Study {
    /// Campaigns simulated.
    pub campaigns: usize,
    /// Campaigns whose fit did not converge; they count like all others.
    pub not_converged: usize,
    /// One row a compliance that every campaign could see.
    pub joints: Vec<JointStudy>,
}

/// What became of one compliance over all campaigns.
#[derive(Debug, Clone, Default)]
pub struct JointStudy {
    /// Joint.
    pub name: String,
    /// Truth, rad/(N·m).
    pub truth: f64,
    /// Mean Cramér-Rao standard deviation over the truth.
    pub relative_bound: f64,
    /// Sum of z² of the weighted fit.
    pub squares: f64,
    /// Sum of z (its mean is the bias in σ_CRB).
    pub sum: f64,
    /// 95 % intervals that hold the truth.
    pub covered: usize,
    /// Campaigns in which it was estimated.
    pub count: usize,
    /// Sum of z² of the paper's estimator.
    pub paper_squares: f64,
    /// Campaigns in which the paper's estimator gave a value.
    pub paper_count: usize,
}

impl JointStudy {
    /// Variance efficiency of the weighted fit.
    pub fn efficiency(&self) -> f64 {
        self.count as f64 / self.squares
    }

    /// The same of the paper's estimator.
    pub fn paper_efficiency(&self) -> f64 {
        self.paper_count as f64 / self.paper_squares
    }

    /// Share of 95 % intervals that hold the truth.
    pub fn coverage(&self) -> f64 {
        self.covered as f64 / self.count as f64
    }
}

impl Study {
    fn pooled(&self, part: impl Fn(&JointStudy) -> f64) -> f64 {
        self.joints.iter().map(part).sum()
    }

    /// Pooled variance efficiency.
    pub fn efficiency(&self) -> f64 {
        self.pooled(|j| j.count as f64) / self.pooled(|j| j.squares)
    }

    /// Its standard deviation from the number of campaigns, all z taken as independent.
    pub fn efficiency_std(&self) -> f64 {
        self.efficiency() * (2.0 / self.pooled(|j| j.count as f64)).sqrt()
    }

    /// Pooled coverage of 95 % intervals.
    pub fn coverage(&self) -> f64 {
        self.pooled(|j| j.covered as f64) / self.pooled(|j| j.count as f64)
    }

    /// Pooled variance efficiency of the paper's estimator.
    pub fn paper_efficiency(&self) -> f64 {
        self.pooled(|j| j.paper_count as f64) / self.pooled(|j| j.paper_squares)
    }
}

/// One campaign's outcome for one joint.
struct Outcome {
    name: String,
    truth: f64,
    bound: f64,
    z: f64,
    covered: bool,
    paper: Option<f64>,
}

/// Simulates and fits `campaigns` campaigns.
///
/// # Errors
/// If the plant or a model cannot be built.
pub fn study(
    scenario: &Scenario,
    campaigns: usize,
    on_campaign: impl Fn() + Sync,
) -> Result<Study, ScenarioError> {
    let outcomes: Vec<(bool, Vec<Outcome>)> = (0..campaigns)
        .into_par_iter()
        .map(|index| {
            let mut one = scenario.clone();
            // a golden-ratio step keeps the seeds of neighbouring scenarios apart
            one.seed = scenario
                .seed
                .wrapping_add((index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let outcome = run(&one);
            on_campaign();
            outcome
        })
        .collect::<Result<_, _>>()?;
    let mut study = Study {
        campaigns,
        ..Study::default()
    };
    for (converged, rows) in outcomes {
        study.not_converged += usize::from(!converged);
        for row in rows {
            let joint = match study.joints.iter_mut().find(|j| j.name == row.name) {
                Some(joint) => joint,
                None => {
                    study.joints.push(JointStudy {
                        name: row.name,
                        truth: row.truth,
                        ..JointStudy::default()
                    });
                    let last = study.joints.len() - 1;
                    &mut study.joints[last]
                }
            };
            joint.relative_bound += row.bound / row.truth / campaigns as f64;
            joint.squares += row.z * row.z;
            joint.sum += row.z;
            joint.covered += usize::from(row.covered);
            joint.count += 1;
            if let Some(z) = row.paper {
                joint.paper_squares += z * z;
                joint.paper_count += 1;
            }
        }
    }
    Ok(study)
}

/// Simulates one campaign and sets its estimates against truth and bound.
fn run(scenario: &Scenario) -> Result<(bool, Vec<Outcome>), ScenarioError> {
    let campaign = simulate::simulate(scenario, || {})?;
    let model = model_file::model(&campaign, &scenario.effects, scenario.model.as_deref())
        .map_err(|error| scenario.form_error(error.to_string()))?;
    let options = Options {
        cross_validate: false,
    };
    let found =
        fit(&campaign, &model, &options, |_| {}).map_err(|e| scenario.form_error(e.to_string()))?;
    let paper = paper::fit(&campaign).ok();
    let truth = true_values(scenario, &model);
    let spectrum = information(scenario, &campaign, &model, &found.free);
    let quantile = found.quantile();
    let parameters: Vec<&Parameter> = model.parameters().map(|(_, p)| p).collect();
    let mut rows = Vec::new();
    for (column, &index) in found.free.iter().enumerate() {
        let parameter = parameters[index];
        if parameter.role != Some(Role::Spring) || found.status[index] == Status::Unobservable {
            continue;
        }
        let bound = spectrum.deviation(column) * parameter.typical;
        let error = found.values[index] - truth[index];
        let by_paper = paper.as_ref().and_then(|paper| {
            let joint = paper
                .joints
                .iter()
                .find(|j| Some(j.joint) == parameter.joint())?;
            Some((joint.compliance? - truth[index]) / bound)
        });
        rows.push(Outcome {
            name: parameter.name.clone(),
            truth: truth[index],
            bound,
            z: error / bound,
            covered: found.std[index].is_some_and(|std| error.abs() <= quantile * std),
            paper: by_paper,
        });
    }
    Ok((found.converged, rows))
}

/// Whitened, scaled Jacobian at the truth, with the true noise.
fn information(
    scenario: &Scenario,
    campaign: &Campaign,
    model: &Model,
    free: &[usize],
) -> Spectrum {
    let truth = true_values(scenario, model);
    let fitted = campaign.readings.iter();
    let readings: Vec<_> = fitted.filter(|r| r.split == Split::Fit).collect();
    let whiteners = noise::whiteners(model, &truth, &readings, &scenario.noise);
    let problem = CampaignProblem::new(model, &readings, &whiteners, free, &truth);
    let at: Vec<f64> = free.iter().map(|&k| truth[k]).collect();
    Spectrum::of(problem.linearise(&at).factor)
}

/// What a campaign can say at best of one compliance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Bound {
    /// Joint.
    pub name: String,
    /// Cramér-Rao standard deviation over the true value; none where the readings say nothing.
    pub relative: Option<f64>,
}

/// The Cramér-Rao bounds of a scenario's compliances, with its poses, loads and noise, without fitting.
///
/// # Errors
/// If the plant or the model cannot be built.
pub fn bounds(scenario: &Scenario) -> Result<Vec<Bound>, ScenarioError> {
    let campaign = simulate::simulate(scenario, || {})?;
    let model = model_file::model(&campaign, &scenario.effects, scenario.model.as_deref())
        .map_err(|error| scenario.form_error(error.to_string()))?;
    let truth = true_values(scenario, &model);
    let parameters: Vec<_> = model.parameters().collect();
    let free: Vec<usize> = (0..parameters.len())
        .filter(|&k| parameters[k].1.vary)
        .collect();
    let spectrum = information(scenario, &campaign, &model, &free);
    let columns = free.iter().enumerate();
    let compliances = columns.filter(|(_, k)| parameters[**k].1.role == Some(Role::Spring));
    Ok(compliances
        .map(|(column, &k)| Bound {
            name: parameters[k].1.name.clone(),
            relative: (spectrum.lost(column) <= crate::fit::LOST && truth[k] > 0.0)
                .then(|| spectrum.deviation(column) * parameters[k].1.typical / truth[k]),
        })
        .collect())
}

/// The model's parameters at the truth of the plant; those that the plant does not have at zero.
pub fn true_values(scenario: &Scenario, model: &Model) -> Vec<f64> {
    let mut values = model.start();
    for truth in &scenario.truth {
        if let Some(term) = model.term(truth.effect.id()) {
            for (offset, parameter) in term.parameters.iter().enumerate() {
                if let Some((_, value)) = truth.values.iter().find(|(n, _)| *n == parameter.name) {
                    values[term.first + offset] = *value;
                }
            }
        }
    }
    values
}
