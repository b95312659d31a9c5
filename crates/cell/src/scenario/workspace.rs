//! How far the plant gives way over its workspace: what a load does to the target's pose, by MuJoCo.

use super::design::{DesignLoad, from_below, random_posture, stream};
use super::{Scenario, ScenarioError, Truth, presets, simulate};
use crate::effects::Role;
use crate::plant::{Plant, PlantError, PlantSpec};
use crate::space::generator;
use serde::{Deserialize, Serialize};

/// What to survey.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Workspace {
    /// Random postures.
    pub postures: usize,
    /// Exponents of the paper's stiffness tables to survey instead of the truth's own.
    #[serde(default)]
    pub exponents: Vec<i32>,
}

/// What the scenario's last load does to one target.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Survey {
    /// Target.
    pub target: String,
    /// Exponent of the paper's tables, if one was asked for.
    pub exponent: Option<i32>,
    /// Largest change of position, m.
    pub position_max_m: f64,
    /// Median change of position, m.
    pub position_median_m: f64,
    /// Largest change of orientation, rad.
    pub orientation_max_rad: f64,
    /// Postures that do not hold their own weight or the load.
    pub collapsed: usize,
    /// Postures.
    pub postures: usize,
}

/// Surveys the plant under the scenario's last load, against no load.
///
/// # Errors
/// If the plant cannot be built.
pub fn survey(
    scenario: &Scenario,
    workspace: &Workspace,
    on_posture: impl Fn() + Sync,
) -> Result<Vec<Survey>, ScenarioError> {
    let mut rows = Vec::new();
    let exponents: Vec<Option<i32>> = match &workspace.exponents[..] {
        [] => vec![None],
        some => some.iter().copied().map(Some).collect(),
    };
    for exponent in exponents {
        let mut one = scenario.clone();
        if let Some(exponent) = exponent {
            soften(&mut one, exponent)?;
        }
        let spec = simulate::plant_spec(&one).map_err(|error| scenario.plant_error(error))?;
        for target in 0..scenario.setup.targets.len() {
            rows.push(survey_target(
                &one,
                &spec,
                target,
                exponent,
                workspace,
                &on_posture,
            )?);
        }
    }
    Ok(rows)
}

/// Gives the truth's springs the paper's values with another exponent.
fn soften(scenario: &mut Scenario, exponent: i32) -> Result<(), ScenarioError> {
    let stiffness = presets::stiffness("paper", Some(exponent), &scenario.setup);
    let stiffness = stiffness.map_err(|message| scenario.form_error(message))?;
    let springs = scenario.truth.iter_mut();
    for Truth { values, .. } in springs.filter(|t| t.effect.role() == Some(Role::Spring)) {
        for (joint, stiffness) in &stiffness {
            let name = &scenario.setup.robot.joints[*joint].name;
            if let Some((_, value)) = values.iter_mut().find(|(known, _)| known == name) {
                *value = 1.0 / stiffness;
            }
        }
    }
    Ok(())
}

fn survey_target(
    scenario: &Scenario,
    spec: &PlantSpec,
    target: usize,
    exponent: Option<i32>,
    workspace: &Workspace,
    on_posture: &(impl Fn() + Sync),
) -> Result<Survey, ScenarioError> {
    let mut random = generator(scenario.seed, stream::WORKSPACE);
    let postures: Vec<Vec<f64>> = (0..workspace.postures)
        .map(|_| random_posture(scenario, &mut random))
        .collect::<Result<_, _>>()?;
    let original = Plant::build(spec).map_err(|error| scenario.plant_error(error))?;
    let load = scenario.design.loads.last();
    let all = original
        .visit_all(&postures, |plant, joints| {
            on_posture();
            let bare = held(plant, spec, joints, target, None)?;
            let loaded = held(plant, spec, joints, target, load)?;
            Ok(bare.zip(loaded).map(|((bare, _), (loaded, _))| {
                let moved = loaded.translation.vector - bare.translation.vector;
                (moved.norm(), loaded.rotation.angle_to(&bare.rotation))
            }))
        })
        .map_err(|error| scenario.plant_error(error))?;
    let mut held: Vec<(f64, f64)> = all.iter().copied().flatten().collect();
    held.sort_by(|a, b| a.0.total_cmp(&b.0));
    Ok(Survey {
        target: scenario.setup.targets[target].name.clone(),
        exponent,
        position_max_m: held.last().map_or(0.0, |last| last.0),
        position_median_m: held.get(held.len() / 2).map_or(0.0, |middle| middle.0),
        orientation_max_rad: held.iter().map(|h| h.1).fold(0.0, f64::max),
        collapsed: all.len() - held.len(),
        postures: all.len(),
    })
}

/// Pose of a target, and the torque on each joint, N·m (N).
pub(super) type Held = (nalgebra::Isometry3<f64>, Vec<f64>);

/// Pose of the target at rest under a load, and what each joint bears; none where the arm does not hold.
pub(super) fn held(
    plant: &mut Plant,
    spec: &PlantSpec,
    joints: &[f64],
    target: usize,
    load: Option<&DesignLoad>,
) -> Result<Option<Held>, PlantError> {
    let loads = load.map(|load| load.on(target)).into_iter().collect();
    match plant.state(&from_below(joints.to_vec(), loads)) {
        Ok(state) => {
            let pose = state.base_from_link[target] * spec.targets[target].1;
            Ok(Some((pose, state.joint_torques)))
        }
        Err(
            PlantError::GivesWay { .. }
            | PlantError::Unstable { .. }
            | PlantError::NoEquilibrium { .. },
        ) => Ok(None),
        Err(other) => Err(other),
    }
}
