//! Compensation in the loop: a robot holds poses while a process pulls, and corrects its command from what its wrist
//! sensor says.
//!
//! Each tick the plant is at rest under the command and load of that moment: MuJoCo's static state, no inertia, no
//! vibration, no drives that need time. The sensor reads the wrench with its noise; filter and model make a command of it,
//! which acts from the next tick on. What is left is parted exactly, by running the loop again: without noise, and with a
//! load known at once. The sensor's noise is the same for every filter.
//!
//! Source: Appl. Sci. 2019, 9, 65, Fig. 2.

mod filter;
mod run;
mod spec;
mod summary;

pub use filter::{FilterEntry, FilterKind};
pub use spec::ControlLoop;

use super::compensated::{Miss, learn};
use super::{Scenario, ScenarioError, simulate};
use crate::campaign::{Campaign, Noise, Reading, Wrench};
use crate::compensation::filter::Law;
use crate::compensation::{Reach, Robot};
use crate::plant::{Plant, PlantError};
use crate::space::Space;
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;
use run::{Cell, Held, Job, Outcome, poses};
use serde::Serialize;
use std::sync::{Mutex, PoisonError};
use summary::summed_up;

/// One tick of one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// From the start of its run, s.
    pub time: f64,
    /// What the sensor says, link frame, N and N·m.
    pub measured: Wrench,
    /// The same, filtered.
    pub filtered: Wrench,
    /// What the next command is corrected for.
    pub foreseen: Wrench,
    /// The command in force, by joint of the robot, rad (m).
    pub command: Vec<f64>,
    /// Where the target is, tracker's frame, m.
    pub position: Vector3<f64>,
    /// tracker_from_target rotation.
    pub orientation: UnitQuaternion<f64>,
    /// What the command corrected for the tool alone would miss the pose by at this moment: `[v; ω]`, tracker's frame,
    /// m and rad.
    pub before: Vector6<f64>,
    /// What the command in force misses it by, m and rad alike.
    pub after: Vector6<f64>,
}

/// One pose held with one filter.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// Index of the pose.
    pub pose: usize,
    /// Index of the filter.
    pub filter: usize,
    /// Tick by tick.
    pub moments: Vec<Moment>,
}

/// Errors of a way to correct, over all poses and ticks; not numbers if no pose was held.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Errors {
    /// Root mean square.
    pub rms: Miss,
    /// Largest.
    pub most: Miss,
}

/// What one filter is worth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Filtered {
    /// Its name.
    pub filter: String,
    /// Delay of its own at frequency zero, s.
    pub filter_delay_s: f64,
    /// The same and the tick until a command acts, s.
    pub delay_s: f64,
    /// How much of it is foreseen, s.
    pub foreseen_s: f64,
    /// Deviation of the wrench corrected for over that of the sensor's noise.
    pub noise_gain: f64,
    /// Errors of the pose.
    pub errors: Errors,
    /// Part of it from noise: what the loop does otherwise without any, rms.
    pub noise: Miss,
    /// Part of it from delay: what the loop without noise does otherwise than one that knows its load at once, rms.
    pub lag: Miss,
    /// Ticks without a command that reaches the pose: the one before stood.
    pub unreached: usize,
}

/// A model's corrections in the loop.
#[derive(Debug, Clone, PartialEq)]
pub struct Looped {
    /// The model, as the scenario names it.
    pub model: String,
    /// Poses held.
    pub poses: usize,
    /// Poses left out: no command reaches them under the tool.
    pub left_out: usize,
    /// The parameter that the campaign did not see and that matters most where the pull is largest, and by what a typical
    /// size of it would move a pose held, m.
    pub unseen: Option<(String, f64)>,
    /// By the nominal robot's commands.
    pub nominal: Errors,
    /// By commands that the model corrects for the tool alone, once.
    pub tool_alone: Errors,
    /// By commands for the load of the moment: what the model leaves.
    pub at_once: Errors,
    /// Filter by filter.
    pub filters: Vec<Filtered>,
    /// Pose by pose, filter by filter.
    pub traces: Vec<Trace>,
}

impl Looped {
    /// Share by which a filter's loop lowers the position error, rms, against commands corrected for the tool alone.
    pub fn reduction(&self, filter: &Filtered) -> f64 {
        1.0 - filter.errors.rms.position_m / self.tool_alone.rms.position_m
    }
}

/// Holds the poses, model by model.
///
/// # Errors
/// If plant or model cannot be built, a posture is not found, or the plant collapses.
pub fn hold(
    scenario: &Scenario,
    wanted: &ControlLoop,
    on_run: impl Fn() + Sync,
) -> Result<Vec<Looped>, ScenarioError> {
    let campaign = simulate::simulate(scenario, || {})?;
    let models = wanted.models.iter();
    models
        .map(|name| hold_by(scenario, wanted, &campaign, name, &on_run))
        .collect()
}

/// Runs that [`hold`] tells of, for a progress bar.
pub fn runs(wanted: &ControlLoop) -> usize {
    wanted.models.len() * wanted.poses.unwrap_or(1) * (1 + 2 * wanted.filters.len())
}

fn hold_by(
    scenario: &Scenario,
    wanted: &ControlLoop,
    campaign: &Campaign,
    name: &str,
    on_run: &(impl Fn() + Sync),
) -> Result<Looped, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let (model, values, found) = learn(scenario, campaign, "[loop] models", name)?;
    let setup = &scenario.setup;
    let spec = simulate::plant_spec(scenario).map_err(of_plant)?;
    let robot = Robot::new(&model, &values);
    let reach = Reach {
        moving: setup.robot.chain(setup.target_body(wanted.target(setup))),
        ranges: Space::within_limits(&setup.robot, 0.0).ranges,
    };
    let (poses, asked) = poses(scenario, wanted, &spec, &robot, &reach)?;
    let filters = &wanted.filters;
    let laws: Vec<Law> = filters
        .iter()
        .map(|filter| filter.law("[[loop.filter]]", wanted.rate_hz))
        .collect::<Result<_, _>>()
        .map_err(|message| scenario.form_error(message))?;
    let cell = Cell {
        wanted,
        spec: &spec,
        robot: &robot,
        values: &values,
        reach: &reach,
        noise: Noise {
            force: scenario.noise.force,
            torque: scenario.noise.torque,
            ..Noise::default()
        },
    };
    let each = (0..filters.len()).flat_map(|f| [Job::Run(f, true), Job::Run(f, false)]);
    let each: Vec<Job> = std::iter::once(Job::Base).chain(each).collect();
    let jobs: Vec<(&Held, Job)> = poses
        .iter()
        .flat_map(|pose| each.iter().map(move |job| (pose, *job)))
        .collect();
    let mut plant = Plant::build(&spec).map_err(of_plant)?;
    let unseen = match &found {
        Some(found) => cell.unseen(&mut plant, &poses, found).map_err(of_plant)?,
        None => None,
    };
    let original = Mutex::new(plant);
    let outcomes: Vec<Outcome> = jobs
        .par_iter()
        .map(|&(held, job)| {
            // states depend on no state before: any fork gives the same
            let fork = original
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
                .fork();
            let mut plant = fork?;
            let outcome = match job {
                Job::Base => Outcome::Base(cell.base(&mut plant, held)?),
                Job::Run(filter, noisy) => cell.run(&mut plant, held, &laws[filter], noisy)?,
            };
            on_run();
            Ok(outcome)
        })
        .collect::<Result<_, PlantError>>()
        .map_err(of_plant)?;
    Ok(Looped {
        left_out: asked - poses.len(),
        unseen,
        ..summed_up(wanted, name, &laws, outcomes.chunks(each.len()))
    })
}

/// The runs of one filter as a campaign, one reading a tick, pose after pose: to be recorded and replayed. Positions are
/// where the target is, without any tracker's noise.
pub fn recorded(
    scenario: &Scenario,
    wanted: &ControlLoop,
    looped: &Looped,
    filter: usize,
) -> Campaign {
    let traces = looped.traces.iter().filter(|t| t.filter == filter);
    let readings = traces.enumerate().flat_map(|(index, trace)| {
        let start = index as f64 * wanted.duration_s;
        let moments = trace.moments.iter().enumerate();
        moments.map(move |(tick, moment)| Reading {
            // no two ticks have the same command
            pose: Some(format!("{}.{}", trace.pose + 1, tick + 1)),
            time: Some(start + moment.time),
            position: moment.position,
            orientation: Some(moment.orientation),
            wrench: Some(moment.measured),
            ..Reading::to_be(wanted.target(&scenario.setup), moment.command.clone())
        })
    });
    let mut readings: Vec<Reading> = readings.collect();
    for (index, reading) in readings.iter_mut().enumerate() {
        // the header of the table is line 1
        reading.line = index + 2;
    }
    Campaign {
        noise: None,
        ..simulate::campaign(scenario, readings)
    }
}
