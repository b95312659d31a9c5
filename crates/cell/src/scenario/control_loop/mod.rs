//! Compensation in the loop: a robot holds poses while a process pulls, and corrects its command from what its wrist
//! sensor says.
//!
//! Each tick the plant is at rest under the command and load of that moment: MuJoCo's static state, no inertia, no
//! vibration, no drives that need time. The sensor reads the wrench with its noise; filter and model make a command of it,
//! which acts from the next tick on. What is left is parted exactly, by running the loop again: without noise, and with a
//! load known at once. The sensor's noise is the same for every filter.
//!
//! Source: Appl. Sci. 2019, 9, 65, Fig. 2.

mod spec;

use super::compensated::{Miss, learn, reached, task};
use super::design::{random_posture, stream};
use super::{Scenario, ScenarioError, simulate};
use crate::campaign::{Campaign, Noise, Reading, Wrench};
use crate::compensation::controller::Controller;
use crate::compensation::filter::Law;
use crate::compensation::{End, Reach, Robot, correct, error, solve};
use crate::fit::Fit;
use crate::model::Workspace;
use crate::plant::instruments::{Draws, read};
use crate::plant::{Command, Load, Plant, PlantError, PlantSpec, State};
use crate::space::{Space, generator};
use nalgebra::{UnitQuaternion, Vector3, Vector6};
use rayon::prelude::*;
use serde::Serialize;
pub use spec::{ControlLoop, FilterEntry, FilterKind, Tool};
use std::sync::{Mutex, PoisonError};

/// Looks at a load that turns with the hand, until the command for it stands: each gains three digits.
const LOOKS: usize = 4;

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

/// A pose to be held.
struct Held {
    task: Reading,
    nominal: Vec<f64>,
    /// Corrected for the tool alone.
    start: Vec<f64>,
    draws: Vec<Draws>,
}

/// All that the runs of one model share.
struct Cell<'a> {
    wanted: &'a ControlLoop,
    spec: &'a PlantSpec,
    robot: &'a Robot<'a>,
    /// The model's parameters, those of the measurement too.
    values: &'a [f64],
    reach: &'a Reach,
    noise: Noise,
}

/// Errors by tick, beside what a filter's run is compared with.
struct Base {
    nominal: Vec<Vector6<f64>>,
    tool_alone: Vec<Vector6<f64>>,
    at_once: Vec<Vector6<f64>>,
}

enum Outcome {
    Base(Base),
    Run {
        moments: Vec<Moment>,
        unreached: usize,
    },
}

/// What is to be run at a pose.
#[derive(Clone, Copy)]
enum Job {
    Base,
    /// Index of the filter; with noise?
    Run(usize, bool),
}

fn hold_by(
    scenario: &Scenario,
    wanted: &ControlLoop,
    campaign: &Campaign,
    name: &str,
    on_run: &(impl Fn() + Sync),
) -> Result<Looped, ScenarioError> {
    let of_plant = |source: PlantError| ScenarioError::Plant {
        file: scenario.file.clone(),
        source,
    };
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
        .map_err(|message| ScenarioError::Form {
            file: scenario.file.clone(),
            message,
        })?;
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

/// The poses that commands reach under the tool, and how many were asked for.
fn poses(
    scenario: &Scenario,
    wanted: &ControlLoop,
    spec: &PlantSpec,
    robot: &Robot<'_>,
    reach: &Reach,
) -> Result<(Vec<Held>, usize), ScenarioError> {
    let setup = &scenario.setup;
    let target = wanted.target(setup);
    let mut random = generator(scenario.seed, stream::CONTROL_LOOP);
    let postures: Vec<Vec<f64>> = match &wanted.posture_rad {
        Some(posture) => {
            let of = |joint: &crate::robot::Joint| posture.get(&joint.name).copied();
            let joints = setup.robot.joints.iter();
            vec![joints.map(|joint| of(joint).unwrap_or(0.0)).collect()]
        }
        None => (0..wanted.poses.unwrap_or(1))
            .map(|_| random_posture(scenario, &mut random))
            .collect::<Result<_, _>>()?,
    };
    let asked = postures.len();
    let mut workspace = Workspace::new(setup);
    let mut held = Vec::new();
    for (index, joints) in postures.into_iter().enumerate() {
        // drawn for every pose, so that one left out does not move the others
        let draws: Vec<Draws> = (0..wanted.ticks())
            .map(|_| Draws::new(joints.len(), &mut random))
            .collect();
        let name = format!("{}", index + 1);
        let task = task(scenario, spec, target, joints, name, &wanted.tool());
        let mut found = |p: &[f64], near: &[f64]| {
            let found = solve(&mut workspace, robot.model, p, &task, (near, near), reach);
            (found.end == End::Reached).then_some(found.joints)
        };
        let nominal = found(&robot.nominal, &task.joints);
        let Some(nominal) = nominal else { continue };
        let Some(start) = found(&robot.values, &nominal) else {
            continue;
        };
        held.push(Held {
            task,
            nominal,
            start,
            draws,
        });
    }
    Ok((held, asked))
}

impl Cell<'_> {
    /// The plant at a tick under a command.
    fn state(
        &self,
        plant: &mut Plant,
        held: &Held,
        tick: usize,
        joints: &[f64],
    ) -> Result<(Command, State), PlantError> {
        let target = held.task.target;
        let time = self.wanted.time(tick);
        let mut loads = vec![self.wanted.tool().on(target)];
        for pull in &self.wanted.pulls {
            loads.push(Load {
                target,
                mass: 0.0,
                com: Vector3::from(pull.at_m),
                pull: pull.at(time),
                moment: Vector3::zeros(),
            });
        }
        let command = Command {
            joints: joints.to_vec(),
            approach: vec![1.0; joints.len()],
            loads,
            time: 0.0,
            temperature: 0.0,
        };
        let state = plant.state(&command)?;
        Ok((command, state))
    }

    /// What the wrist sensor says of it.
    fn sense(
        &self,
        (command, state): &(Command, State),
        held: &Held,
        tick: usize,
        noise: &Noise,
    ) -> Wrench {
        let target = held.task.target;
        read(self.spec, command, state, target, noise, &held.draws[tick]).wrench
    }

    fn missed(&self, (_, state): &(Command, State), held: &Held) -> Vector6<f64> {
        error(&reached(self.spec, state, held.task.target), &held.task)
    }

    fn controller(&self, held: &Held, law: Law) -> Controller<'_> {
        Controller::new(
            self.robot.model,
            self.values,
            &held.task,
            (&held.start, &held.start),
            self.reach,
            law,
        )
    }

    /// See [`Looped::unseen`].
    fn unseen(
        &self,
        plant: &mut Plant,
        poses: &[Held],
        fit: &Fit,
    ) -> Result<Option<(String, f64)>, PlantError> {
        let pull = |tick: usize| -> f64 {
            let forces = self.wanted.pulls.iter();
            let all: Vector3<f64> = forces.map(|pull| pull.at(self.wanted.time(tick))).sum();
            all.norm()
        };
        let largest = (0..self.wanted.ticks()).max_by(|a, b| pull(*a).total_cmp(&pull(*b)));
        let tick = largest.unwrap_or(0);
        let mut workspace = Workspace::new(&self.robot.model.setup);
        let mut most: Option<(String, f64)> = None;
        for held in poses {
            let state = self.state(plant, held, tick, &held.start)?;
            let pulled = Reading {
                payload: None,
                wrench: Some(self.sense(&state, held, tick, &Noise::default())),
                ..held.task.clone()
            };
            let corrected = correct(&mut workspace, self.robot, Some(fit), &pulled, self.reach);
            if let Some((name, moved)) = corrected.unseen
                && most.as_ref().is_none_or(|(_, most)| moved > *most)
            {
                most = Some((name, moved));
            }
        }
        Ok(most)
    }

    fn base(&self, plant: &mut Plant, held: &Held) -> Result<Base, PlantError> {
        let quiet = Noise::default();
        let ticks = self.wanted.ticks();
        let mut base = Base {
            nominal: Vec::with_capacity(ticks),
            tool_alone: Vec::with_capacity(ticks),
            at_once: Vec::with_capacity(ticks),
        };
        let mut knowing = self.controller(held, Law::none());
        let mut command = held.start.clone();
        for tick in 0..ticks {
            let nominal = self.state(plant, held, tick, &held.nominal)?;
            base.nominal.push(self.missed(&nominal, held));
            let alone = self.state(plant, held, tick, &held.start)?;
            base.tool_alone.push(self.missed(&alone, held));
            let mut state = self.state(plant, held, tick, &command)?;
            for _ in 0..LOOKS {
                command = knowing
                    .tick(&self.sense(&state, held, tick, &quiet))
                    .command;
                state = self.state(plant, held, tick, &command)?;
            }
            base.at_once.push(self.missed(&state, held));
        }
        Ok(base)
    }

    fn run(
        &self,
        plant: &mut Plant,
        held: &Held,
        law: &Law,
        noisy: bool,
    ) -> Result<Outcome, PlantError> {
        let noise = match noisy {
            true => self.noise,
            false => Noise::default(),
        };
        let mut controller = self.controller(held, law.clone());
        let mut command = held.start.clone();
        let (mut moments, mut unreached) = (Vec::with_capacity(self.wanted.ticks()), 0);
        for tick in 0..self.wanted.ticks() {
            let state = self.state(plant, held, tick, &command)?;
            let measured = self.sense(&state, held, tick, &noise);
            let next = controller.tick(&measured);
            unreached += usize::from(!next.found);
            let at = reached(self.spec, &state.1, held.task.target);
            moments.push(Moment {
                time: self.wanted.time(tick),
                measured,
                filtered: next.filtered,
                foreseen: next.foreseen,
                command: std::mem::replace(&mut command, next.command),
                position: at.position,
                orientation: at.orientation,
                before: Vector6::zeros(),
                after: error(&at, &held.task),
            });
        }
        Ok(Outcome::Run { moments, unreached })
    }
}

/// Sums of squares and largest of misses.
#[derive(Default)]
struct Sum {
    squares: Miss,
    most: Miss,
    count: usize,
}

impl Sum {
    fn add(&mut self, twist: &Vector6<f64>) {
        let miss = Miss::of(twist);
        self.squares.position_m += miss.position_m.powi(2);
        self.squares.orientation_rad += miss.orientation_rad.powi(2);
        self.most.position_m = self.most.position_m.max(miss.position_m);
        self.most.orientation_rad = self.most.orientation_rad.max(miss.orientation_rad);
        self.count += 1;
    }

    /// Not numbers where nothing was added: no pose held is no pose held well.
    fn errors(&self) -> Errors {
        let mean = |sum: f64| (sum / self.count as f64).sqrt();
        let most = |most: f64| if self.count > 0 { most } else { f64::NAN };
        Errors {
            rms: Miss {
                position_m: mean(self.squares.position_m),
                orientation_rad: mean(self.squares.orientation_rad),
            },
            most: Miss {
                position_m: most(self.most.position_m),
                orientation_rad: most(self.most.orientation_rad),
            },
        }
    }
}

/// Outcomes come by pose: the base, then each filter with noise and without.
fn summed_up<'a>(
    wanted: &ControlLoop,
    name: &str,
    laws: &[Law],
    outcomes: impl Iterator<Item = &'a [Outcome]>,
) -> Looped {
    let (mut nominal, mut tool_alone, mut at_once) =
        (Sum::default(), Sum::default(), Sum::default());
    let mut sums: Vec<[Sum; 3]> = laws.iter().map(|_| Default::default()).collect();
    let mut unreached = vec![0; laws.len()];
    let mut traces = Vec::new();
    let mut poses = 0;
    for (pose, of_pose) in outcomes.enumerate() {
        let [Outcome::Base(base), runs @ ..] = of_pose else {
            continue;
        };
        poses += 1;
        base.nominal.iter().for_each(|e| nominal.add(e));
        base.tool_alone.iter().for_each(|e| tool_alone.add(e));
        base.at_once.iter().for_each(|e| at_once.add(e));
        for (filter, pair) in runs.chunks(2).enumerate() {
            let [
                Outcome::Run {
                    moments,
                    unreached: missing,
                },
                Outcome::Run { moments: quiet, .. },
            ] = pair
            else {
                continue;
            };
            unreached[filter] += missing;
            let [all, noise, lag] = &mut sums[filter];
            for (k, moment) in moments.iter().enumerate() {
                all.add(&moment.after);
                noise.add(&(moment.after - quiet[k].after));
                lag.add(&(quiet[k].after - base.at_once[k]));
            }
            let with_before = moments.iter().zip(&base.tool_alone);
            traces.push(Trace {
                pose,
                filter,
                moments: with_before
                    .map(|(moment, before)| Moment {
                        before: *before,
                        ..moment.clone()
                    })
                    .collect(),
            });
        }
    }
    let tick = 1.0 / wanted.rate_hz;
    let filters = wanted.filters.iter().zip(laws).zip(&sums).zip(unreached);
    Looped {
        model: name.to_owned(),
        poses,
        left_out: 0,
        unseen: None,
        nominal: nominal.errors(),
        tool_alone: tool_alone.errors(),
        at_once: at_once.errors(),
        filters: filters
            .map(|(((entry, law), [all, noise, lag]), unreached)| Filtered {
                filter: entry.name(),
                filter_delay_s: law.delay() * tick,
                delay_s: (law.delay() + 1.0) * tick,
                foreseen_s: law.ahead() * tick,
                noise_gain: law.noise_gain(),
                errors: all.errors(),
                noise: noise.errors().rms,
                lag: lag.errors().rms,
                unreached,
            })
            .collect(),
        traces,
    }
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
