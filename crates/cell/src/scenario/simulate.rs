//! From a scenario to a campaign: the plant is built, visited in every state of the design, and read.
//!
//! The truth goes into the plant and into a file of its own; the campaign holds readings only.

use super::design::{Visit, stream, visits};
use super::disturbance::Disturbed;
use super::{Scenario, ScenarioError, Truth};
use crate::campaign::{Campaign, Noise, Payload, Reading, Split};
use crate::plant::instruments::{Draws, read};
use crate::plant::{Command, Plant, PlantError, PlantSpec};
use crate::space::generator;
use nalgebra::Vector3;

/// Time between two readings, s: moving there and settling.
pub(crate) const PACE: f64 = 20.0;

/// Builds the truth: nominal robot and hidden effects.
///
/// # Errors
/// If the plant cannot realise an effect's values.
pub fn plant_spec(scenario: &Scenario) -> Result<PlantSpec, PlantError> {
    let setup = &scenario.setup;
    let links = setup.targets.iter().map(|target| target.link).collect();
    let mut spec = PlantSpec::new(&setup.robot, links, setup.gravity);
    // a frame that the campaign knows is where the campaign says
    if let crate::campaign::Frame::Known(pose) = scenario.base_from_tracker {
        spec.base_from_tracker = pose;
    }
    for (target, frame) in spec.targets.iter_mut().zip(&scenario.link_from_target) {
        if let crate::campaign::Frame::Known(pose) = frame {
            target.1 = *pose;
        }
    }
    for truth in &scenario.truth {
        let values: Vec<f64> = truth.values.iter().map(|(_, value)| *value).collect();
        truth.effect.install(&values, setup, &mut spec)?;
    }
    Ok(spec)
}

/// Simulates the campaign; `on_reading` is told of every reading taken.
///
/// # Errors
/// If the plant cannot be built, or collapses under a load.
pub fn simulate(
    scenario: &Scenario,
    on_reading: impl Fn() + Sync,
) -> Result<Campaign, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let spec = plant_spec(scenario).map_err(of_plant)?;
    measure(scenario, &spec, &scenario.noise, on_reading)
}

/// The same from a truth and with a noise that need not be the scenario's: its design is visited, its noise is what
/// the campaign states.
///
/// # Errors
/// As [`simulate`].
pub fn measure(
    scenario: &Scenario,
    spec: &PlantSpec,
    noise: &Noise,
    on_reading: impl Fn() + Sync,
) -> Result<Campaign, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let original = Plant::build(spec).map_err(of_plant)?;
    let visits = visits(scenario)?;
    let mut random = generator(scenario.seed, stream::NOISE);
    let joints = scenario.setup.robot.joints.len();
    let mut draws: Vec<Draws> = visits
        .iter()
        .map(|_| Draws::new(joints, &mut random))
        .collect();
    let disturbance = &scenario.disturbance;
    let disturbed = disturbance.prepare(scenario.seed, spec, &visits, &mut draws);
    let jobs: Vec<(usize, &Visit, &Draws)> = visits
        .iter()
        .zip(&draws)
        .enumerate()
        .map(|(index, (visit, draws))| (index, visit, draws))
        .collect();
    let middle = PACE * visits.len().saturating_sub(1) as f64 / 2.0;
    let warm_up = scenario.design.temperature;
    let temperature = |index: usize| warm_up.map(|warm_up| warm_up.at(index as f64 * PACE));
    let all = (0..visits.len()).filter_map(temperature).sum::<f64>();
    let mean = all / visits.len().max(1) as f64;
    let moment = |index: usize| Moment {
        time: index as f64 * PACE,
        from_middle: index as f64 * PACE - middle,
        temperature: temperature(index),
        above_mean: temperature(index).map_or(0.0, |t| t - mean),
    };
    let readings = original
        .visit_all(&jobs, |plant, &(index, visit, draws)| {
            let moment = moment(index);
            let reading = take(
                (scenario, spec, noise),
                plant,
                &disturbed,
                (index, &moment),
                visit,
                draws,
            );
            on_reading();
            reading
        })
        .map_err(of_plant)?;
    Ok(campaign(scenario, readings))
}

/// Readings with what a scenario says of how they were taken.
pub(super) fn campaign(scenario: &Scenario, readings: Vec<Reading>) -> Campaign {
    Campaign {
        name: scenario.name.clone(),
        robot: scenario.setup.robot.clone(),
        robot_file: scenario.robot_file.clone(),
        gravity: scenario.setup.gravity,
        targets: scenario.setup.targets.clone(),
        base_from_tracker: scenario.base_from_tracker,
        link_from_target: scenario.link_from_target.clone(),
        noise: scenario
            .state_noise
            .then(|| scenario.disturbance.stated(&scenario.noise)),
        readings,
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}

/// When a reading is taken.
struct Moment {
    /// From the first reading, s.
    time: f64,
    /// From the middle of the campaign, s.
    from_middle: f64,
    /// °C, where it is measured.
    temperature: Option<f64>,
    /// K.
    above_mean: f64,
}

/// Takes one reading.
fn take(
    (scenario, spec, noise): (&Scenario, &PlantSpec, &Noise),
    plant: &mut Plant,
    disturbed: &Disturbed,
    (index, moment): (usize, &Moment),
    visit: &Visit,
    draws: &Draws,
) -> Result<Reading, PlantError> {
    let load = scenario.design.loads[visit.load];
    let (spec, zero) = disturbed.at(index, spec);
    let joints = visit.joints.iter().zip(&draws.joints);
    // the encoder reads the command; the joint repeats it only so well
    let mut joints: Vec<f64> = joints.map(|(q, draw)| q + draw * noise.joint).collect();
    if let Some((joint, jump)) = zero {
        joints[joint] += jump;
    }
    let command = Command {
        joints,
        time: moment.from_middle,
        temperature: moment.above_mean,
        ..visit.command(&load)
    };
    let state = plant.state(&command)?;
    let seen = read(spec, &command, &state, visit.target, noise, draws);
    let design = &scenario.design;
    let pulled = design
        .loads
        .iter()
        .any(|load| load.pull != Vector3::zeros());
    let mut reading = Reading {
        // the header of the table is line 1
        line: index + 2,
        pose: Some(format!("p{:03}", visit.pose + 1)),
        repeat: Some(format!("{}", visit.repeat + 1)),
        target: visit.target,
        split: if (design.poses - design.heldout..design.poses).contains(&visit.pose) {
            Split::Heldout
        } else {
            Split::Fit
        },
        time: Some(moment.time),
        temperature: moment.temperature,
        link_temperatures: Vec::new(),
        joints: visit.joints.clone(),
        approach: (design.directions > 1).then(|| vec![visit.direction; visit.joints.len()]),
        position: seen.position + disturbed.shift(index),
        orientation: scenario.orientation.then_some(seen.orientation),
        wrench: (scenario.wrench || pulled).then_some(seen.wrench),
        // a pull is no dead weight: then only the sensor knows the load
        payload: (!pulled).then_some(Payload {
            mass: load.mass,
            com: load.com,
        }),
        process: None,
    };
    scenario.disturbance.state(&mut reading);
    Ok(reading)
}

/// The truth as a model file, which only scoring reads.
pub fn truth_text(scenario: &Scenario) -> String {
    let mut text = format!(
        "# What the plant of scenario {} had, seed {}. Scoring reads this; a fit never does.\n",
        scenario.name, scenario.seed
    );
    for Truth { effect, values } in &scenario.truth {
        text += &format!("\n[[effect]]\nkind = \"{}\"\n", effect.kind());
        for (key, value) in effect.options() {
            text += &format!("{key} = {value}\n");
        }
        text += "[effect.values]\n";
        for (name, value) in values {
            text += &format!("{} = {value:?}\n", toml::Value::from(name.as_str()));
        }
    }
    text
}
