//! Maps of a scenario: by the plant, by a model fitted to its campaign, or by both.

use super::compensated::learn;
use super::design::DesignLoad;
use super::workspace::held;
use super::{Scenario, ScenarioError, simulate};
use crate::campaign::Payload;
use crate::compensation::{Reach, Robot};
use crate::map::{By, Map, Off, Request, Which, by_model, postures};
use crate::plant::{Plant, PlantError, PlantSpec};
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Serialize;

/// Maps of one request, and the springs that stand behind them.
#[derive(Debug, Clone)]
pub struct Maps {
    /// By target, then by who tells.
    pub maps: Vec<Map>,
    /// Stiffness of every joint, N·m/rad (N/m), by who tells; none is rigid, or not known.
    pub stiffness: Vec<(By, Vec<Option<f64>>)>,
    /// The load.
    pub load: Payload,
}

/// The load that a scenario's maps are of: its design's last.
///
/// # Errors
/// If that load has a pull: maps know dead weights alone.
pub fn last_load(scenario: &Scenario) -> Result<Payload, ScenarioError> {
    let load = scenario.design.loads.last().copied().unwrap_or_default();
    if load.pull != Vector3::zeros() {
        return Err(scenario.form_error(
            "[design] loads: the last one has pull_N, and a map knows dead weights alone; accepted: a last load without \
             pull_N",
        ));
    }
    Ok(load.payload())
}

/// Maps a load.
///
/// # Errors
/// If plant or model cannot be built, or the request does not fit the robot.
pub fn map(
    scenario: &Scenario,
    wanted: &Request,
    load: Payload,
    on_posture: impl Fn() + Sync,
) -> Result<Maps, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let form = |message: String| scenario.form_error(message);
    wanted.check(&scenario.setup).map_err(form)?;
    let setup = &scenario.setup;
    let by = wanted.tellers();
    wanted.check_load(&load).map_err(form)?;
    // a map by the plant alone needs no readings: the frames come from the scenario
    let campaign = match by.contains(&By::Model) {
        true => simulate::simulate(scenario, || {})?,
        false => simulate::campaign(scenario, Vec::new()),
    };
    let name = match by.contains(&By::Model) {
        true => wanted.model.as_deref().unwrap_or("default"),
        false => "true",
    };
    let (model, values, _) = learn(scenario, &campaign, "[map] model", name)?;
    let robot = Robot::new(&model, &values);
    let spec = simulate::plant_spec(scenario).map_err(of_plant)?;
    let space = &scenario.design.space;
    let posture = wanted.posture(setup, space);
    let mut maps = Vec::new();
    for target in wanted.targets(setup).map_err(form)? {
        let chain = setup.robot.chain(setup.target_body(target));
        let reach = Reach {
            moving: chain
                .into_iter()
                .filter(|&joint| space.ranges[joint].0 < space.ranges[joint].1)
                .collect(),
            ranges: space.ranges.clone(),
        };
        let grid = wanted.grid(setup, target, &posture, &reach).map_err(form)?;
        let hold = (&reach, wanted.hold_orientation);
        let found = postures(&robot, target, &grid, &posture, hold);
        for &by in &by {
            let off = match by {
                By::Model => by_model(&robot, target, &found, &load, wanted.error),
                By::Plant => by_plant(
                    (&spec, setup),
                    target,
                    &found,
                    &load,
                    wanted.error,
                    &on_posture,
                )
                .map_err(of_plant)?,
            };
            maps.push(Map {
                target,
                grid: grid.clone(),
                postures: found.clone(),
                by,
                off,
            });
        }
    }
    let stiffness = by.iter().map(|&by| {
        let springs = match by {
            By::Plant => spec.stiffness.clone(),
            By::Model => robot.stiffness(),
        };
        (by, springs)
    });
    Ok(Maps {
        stiffness: stiffness.collect(),
        maps,
        load,
    })
}

/// How far the plant is off at each posture, where the arm holds.
fn by_plant(
    (spec, setup): (&PlantSpec, &Setup),
    target: usize,
    found: &[Option<Vec<f64>>],
    load: &Payload,
    error: Which,
    on_posture: impl Fn() + Sync,
) -> Result<Vec<Option<Off>>, PlantError> {
    let hanging = DesignLoad {
        mass: load.mass,
        com: load.com,
        pull: Vector3::zeros(),
    };
    let link = &setup.robot.links[setup.targets[target].link];
    let nominal = |joints: &[f64]| {
        let base_from_link = setup.robot.body_poses(joints)[link.body] * link.body_from_link;
        base_from_link * spec.targets[target].1
    };
    Plant::build(spec)?.visit_all(found, |plant, joints| {
        on_posture();
        let Some(joints) = joints else {
            return Ok(None);
        };
        let loaded = held(plant, spec, joints, target, Some(&hanging))?;
        let reference = match error {
            Which::Load => held(plant, spec, joints, target, None)?.map(|(pose, _)| pose),
            Which::Total => Some(nominal(joints)),
        };
        Ok(loaded
            .zip(reference)
            .map(|((pose, torques), reference)| Off {
                position: (pose.translation.vector - reference.translation.vector).norm(),
                orientation: pose.rotation.angle_to(&reference.rotation),
                overloaded: !setup.robot.overloaded(&torques).is_empty(),
            }))
    })
}

/// How far model and plant are apart over one map.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Agreement {
    /// Target.
    pub target: String,
    /// Largest difference of the position's error, m.
    pub position_max_m: f64,
    /// The same over the largest error itself.
    pub relative: f64,
}

/// Compares the maps of the same target by model and by plant.
pub fn agreement(setup: &Setup, maps: &Maps) -> Vec<Agreement> {
    let of = |target: usize, by: By| {
        maps.maps
            .iter()
            .find(|map| map.target == target && map.by == by)
    };
    let plants = maps.maps.iter().filter(|map| map.by == By::Plant);
    let pairs = plants.filter_map(|plant| Some((plant, of(plant.target, By::Model)?)));
    pairs
        .map(|(plant, model)| {
            let both = plant.off.iter().zip(&model.off);
            let both = both.filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
            let (mut apart, mut most) = (0.0_f64, 0.0_f64);
            for (a, b) in both {
                apart = apart.max((a.position - b.position).abs());
                most = most.max(a.position);
            }
            Agreement {
                target: setup.targets[plant.target].name.clone(),
                position_max_m: apart,
                relative: if most > 0.0 { apart / most } else { 0.0 },
            }
        })
        .collect()
}
