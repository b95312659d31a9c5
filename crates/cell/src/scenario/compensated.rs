//! Do corrected commands arrive? Random poses are asked of the robot in MuJoCo, under load, by the nominal robot's commands
//! and by those that a model corrects.
//!
//! The plant knows nothing of any model. A pose asked for is that of the nominal robot at a random posture, standing and
//! measured where the plant stands and is measured.

use super::design::{DesignLoad, from_below, random_posture, stream};
use super::{Scenario, ScenarioError, efficiency::true_values, simulate};
use crate::campaign::{Campaign, Reading};
use crate::compensation::{End, Reach, Robot, correct, error};
use crate::effects::EffectList;
use crate::fit::{Fit, Options, fit};
use crate::model::{Model, Prediction, Workspace};
use crate::model_file;
use crate::plant::{Plant, PlantError, PlantSpec, State};
use crate::space::{Space, generator};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// `[compensate]` of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Compensate {
    /// Random poses per target.
    pub poses: usize,
    /// Models that correct, one after the other: `true` is the plant's own truth in the model's laws, any other word is
    /// what `--effects` takes; `default` is the default model.
    #[serde(default = "default_models")]
    pub models: Vec<String>,
    /// Campaigns, each with its own noise and poses, whose fits correct.
    #[serde(default = "one")]
    pub campaigns: usize,
    /// List every pose?
    #[serde(default)]
    pub list: bool,
}

/// Poses, and campaigns, that one scenario may ask for: a typing error must not cost a day.
const MAX_COUNT: usize = 100_000;

fn default_models() -> Vec<String> {
    vec!["default".to_owned()]
}

fn one() -> usize {
    1
}

impl Compensate {
    /// Refuses numbers that make no sense.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self) -> Result<(), String> {
        if self.models.is_empty() {
            return Err("[compensate] models is empty; accepted: \"default\", \"true\", words as for --effects".to_owned());
        }
        for (key, value) in [("poses", self.poses), ("campaigns", self.campaigns)] {
            if !(1..=MAX_COUNT).contains(&value) {
                return Err(format!(
                    "[compensate] {key} is {value}; accepted: 1 to {MAX_COUNT}"
                ));
            }
        }
        Ok(())
    }
}

/// Distance and angle between a pose asked for and one reached.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Miss {
    /// m.
    pub position_m: f64,
    /// rad.
    pub orientation_rad: f64,
}

impl Miss {
    pub(super) fn of(twist: &Vector6<f64>) -> Self {
        Self {
            position_m: twist.fixed_rows::<3>(0).norm(),
            orientation_rad: twist.fixed_rows::<3>(3).norm(),
        }
    }
}

/// One pose of one target.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Arrival {
    /// Target.
    pub target: String,
    /// By the nominal robot's command.
    pub before: Miss,
    /// By the corrected one.
    pub after: Miss,
    /// One standard deviation of what is left, as the fit has it; none for a model that was not fitted.
    pub predicted: Option<Miss>,
    /// Of six coordinates, how many are inside their 95 % intervals.
    pub inside: Option<usize>,
    /// Sum of the six coordinates' squares in their deviations.
    pub squares: Option<f64>,
}

/// What a model's corrections are worth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Corrections {
    /// The model, as the scenario names it.
    pub model: String,
    /// Poses asked for, by campaign and target.
    pub arrivals: Vec<Arrival>,
    /// Poses that no command reaches within the limits.
    pub unreached: usize,
}

impl Corrections {
    fn root_mean_square(&self, of: impl Fn(&Arrival) -> f64) -> f64 {
        let sum: f64 = self.arrivals.iter().map(|a| of(a).powi(2)).sum();
        (sum / self.arrivals.len().max(1) as f64).sqrt()
    }

    /// Root mean square misses before and after.
    pub fn rms(&self) -> (Miss, Miss) {
        let of = |which: fn(&Arrival) -> &Miss| Miss {
            position_m: self.root_mean_square(|a| which(a).position_m),
            orientation_rad: self.root_mean_square(|a| which(a).orientation_rad),
        };
        (of(|a| &a.before), of(|a| &a.after))
    }

    /// Largest misses after.
    pub fn most(&self) -> Miss {
        let most = |of: fn(&Miss) -> f64| {
            let all = self.arrivals.iter().map(|a| of(&a.after));
            all.fold(0.0, f64::max)
        };
        Miss {
            position_m: most(|m| m.position_m),
            orientation_rad: most(|m| m.orientation_rad),
        }
    }

    /// Share by which the position error falls, rms.
    pub fn reduction(&self) -> f64 {
        let (before, after) = self.rms();
        1.0 - after.position_m / before.position_m
    }

    /// Share of coordinates inside their predicted 95 % intervals; none without a fit.
    pub fn coverage(&self) -> Option<f64> {
        let inside: Vec<usize> = self.arrivals.iter().filter_map(|a| a.inside).collect();
        let all = 6 * inside.len();
        (all > 0).then(|| inside.iter().sum::<usize>() as f64 / all as f64)
    }

    /// Mean square of the coordinates in their predicted deviations: 1 if they are right; none without a fit.
    pub fn mean_square(&self) -> Option<f64> {
        let squares: Vec<f64> = self.arrivals.iter().filter_map(|a| a.squares).collect();
        let all = 6 * squares.len();
        (all > 0).then(|| squares.iter().sum::<f64>() / all as f64)
    }
}

/// Corrects and visits, model by model.
///
/// # Errors
/// If plant or model cannot be built, or the plant collapses.
pub fn compensate(
    scenario: &Scenario,
    wanted: &Compensate,
    on_campaign: impl Fn() + Sync,
) -> Result<Vec<Corrections>, ScenarioError> {
    let campaigns: Vec<Vec<Corrections>> = (0..wanted.campaigns)
        .into_par_iter()
        .map(|index| {
            let mut one = scenario.clone();
            // a golden-ratio step keeps the seeds of neighbouring scenarios apart
            one.seed = scenario
                .seed
                .wrapping_add((index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            let found = once(&one, wanted);
            on_campaign();
            found
        })
        .collect::<Result<_, _>>()?;
    let mut all = Vec::new();
    for (index, model) in wanted.models.iter().enumerate() {
        let of_model = || campaigns.iter().map(|campaign| &campaign[index]);
        all.push(Corrections {
            model: model.clone(),
            arrivals: of_model().flat_map(|c| c.arrivals.clone()).collect(),
            unreached: of_model().map(|c| c.unreached).sum(),
        });
    }
    Ok(all)
}

/// One campaign.
fn once(scenario: &Scenario, wanted: &Compensate) -> Result<Vec<Corrections>, ScenarioError> {
    let campaign = simulate::simulate(scenario, || {})?;
    let models = wanted.models.iter();
    models
        .map(|name| correct_by(scenario, wanted, &campaign, name))
        .collect()
}

fn correct_by(
    scenario: &Scenario,
    wanted: &Compensate,
    campaign: &Campaign,
    name: &str,
) -> Result<Corrections, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let (model, values, found) = learn(scenario, campaign, "[compensate] models", name)?;
    let spec = simulate::plant_spec(scenario).map_err(of_plant)?;
    let tasks = tasks(scenario, wanted, &spec)?;
    let robot = Robot::new(&model, &values);
    let plant = Plant::build(&spec).map_err(of_plant)?;
    let arrivals = plant
        .visit_all(&tasks, |plant, task| {
            arrive(&model, &robot, found.as_ref(), plant, &spec, task)
        })
        .map_err(of_plant)?;
    let unreached = arrivals.iter().filter(|a| a.is_none()).count();
    Ok(Corrections {
        model: name.to_owned(),
        arrivals: arrivals.into_iter().flatten().collect(),
        unreached,
    })
}

/// A model by the word that a scenario's `key` has for it, its numbers, and the fit that they are from, if it was fitted.
pub(super) fn learn(
    scenario: &Scenario,
    campaign: &Campaign,
    key: &str,
    name: &str,
) -> Result<(Model, Vec<f64>, Option<Fit>), ScenarioError> {
    let form = |message: String| scenario.form_error(format!("{key}: {name}: {message}"));
    let list = match name {
        "default" => Ok(EffectList::DEFAULT),
        "true" => EffectList::parse("--effects", &truth_words(scenario)),
        words => EffectList::parse("--effects", words),
    };
    let list = list.map_err(|error| form(error.to_string()))?;
    let model = model_file::model(campaign, &list, None);
    let model = model.map_err(|error| form(error.to_string()))?;
    if name == "true" {
        let values = true_values(scenario, &model);
        return Ok((model, values, None));
    }
    let options = Options {
        cross_validate: false,
    };
    let found = fit(campaign, &model, &options, |_| {}).map_err(|e| form(e.to_string()))?;
    Ok((model, found.values.clone(), Some(found)))
}

/// The effects that the plant has, as for `--effects`.
fn truth_words(scenario: &Scenario) -> String {
    let ids: Vec<&str> = scenario.truth.iter().map(|t| t.effect.id()).collect();
    ids.join(",")
}

/// A pose asked for, and the load that hangs there.
struct Asked {
    task: Reading,
    load: DesignLoad,
    name: String,
}

/// Random poses of every target, under the design's last load.
fn tasks(
    scenario: &Scenario,
    wanted: &Compensate,
    spec: &PlantSpec,
) -> Result<Vec<Asked>, ScenarioError> {
    let setup = &scenario.setup;
    let mut random = generator(scenario.seed, stream::COMPENSATION);
    let load = scenario.design.loads.last().copied().unwrap_or_default();
    let mut all = Vec::new();
    for target in 0..setup.targets.len() {
        for pose in 0..wanted.poses {
            let joints = random_posture(scenario, &mut random)?;
            all.push(Asked {
                task: task(
                    scenario,
                    spec,
                    target,
                    joints,
                    format!("{}", pose + 1),
                    &load,
                ),
                load,
                name: setup.targets[target].name.clone(),
            });
        }
    }
    Ok(all)
}

/// The pose of the nominal robot at a posture, standing and measured where the plant stands and is measured, to be held
/// under a weight.
pub(super) fn task(
    scenario: &Scenario,
    spec: &PlantSpec,
    target: usize,
    joints: Vec<f64>,
    pose: String,
    load: &DesignLoad,
) -> Reading {
    let setup = &scenario.setup;
    let link = &setup.robot.links[setup.targets[target].link];
    let base_from_link = setup.robot.body_poses(&joints)[link.body] * link.body_from_link;
    let seen = spec.base_from_tracker.inverse() * base_from_link * spec.targets[target].1;
    Reading {
        pose: Some(pose),
        approach: (scenario.design.directions > 1).then(|| vec![1.0; joints.len()]),
        position: seen.translation.vector,
        orientation: Some(seen.rotation),
        payload: Some(load.payload()),
        ..Reading::to_be(target, joints)
    }
}

/// Where a state of the plant has a target, in the tracker's frame.
pub(super) fn reached(spec: &PlantSpec, state: &State, target: usize) -> Prediction {
    let reached =
        spec.base_from_tracker.inverse() * state.base_from_link[target] * spec.targets[target].1;
    Prediction {
        position: reached.translation.vector,
        orientation: reached.rotation,
        wrench: Vector6::zeros(),
        settled: true,
    }
}

/// Commands the plant to a pose, before and after; none where the corrected command does not reach it.
fn arrive(
    model: &Model,
    robot: &Robot<'_>,
    fit: Option<&Fit>,
    plant: &mut Plant,
    spec: &PlantSpec,
    asked: &Asked,
) -> Result<Option<Arrival>, PlantError> {
    let setup = &model.setup;
    let task = &asked.task;
    let chain = setup.robot.chain(setup.target_body(task.target));
    let reach = Reach {
        moving: chain,
        ranges: Space::within_limits(&setup.robot, 0.0).ranges,
    };
    let mut workspace = Workspace::new(setup);
    let corrected = correct(&mut workspace, robot, fit, task, &reach);
    if corrected.command.end != End::Reached || corrected.nominal.end != End::Reached {
        return Ok(None);
    }
    let mut missed = |joints: &[f64]| -> Result<Vector6<f64>, PlantError> {
        let loads = vec![asked.load.on(task.target)];
        let state = plant.state(&from_below(joints.to_vec(), loads))?;
        Ok(error(&reached(spec, &state, task.target), task))
    };
    let before = missed(&corrected.nominal.joints)?;
    let after = missed(&corrected.command.joints)?;
    let spread = |covariance: &Matrix6<f64>| covariance.diagonal().map(|x| x.max(0.0).sqrt());
    let deviations = corrected.covariance.as_ref().map(spread);
    let quantile = fit.map_or(0.0, Fit::quantile);
    Ok(Some(Arrival {
        target: asked.name.clone(),
        before: Miss::of(&before),
        after: Miss::of(&after),
        predicted: deviations.as_ref().map(Miss::of),
        inside: deviations.map(|deviation| {
            let both = after.iter().zip(deviation.iter());
            both.filter(|(x, s)| x.abs() <= quantile * **s).count()
        }),
        squares: deviations.map(|deviation| {
            let both = after.iter().zip(deviation.iter());
            both.map(|(x, s)| (x / s).powi(2)).sum()
        }),
    }))
}
