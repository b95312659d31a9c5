//! Runs of one pose: by commands for the tool alone, for the load of the moment, and by a filter.

use super::super::compensated::{reached, task};
use super::super::design::{from_below, random_posture, stream};
use super::super::{Scenario, ScenarioError};
use super::{ControlLoop, Moment};
use crate::campaign::{Noise, Reading, Wrench};
use crate::compensation::controller::Controller;
use crate::compensation::filter::Law;
use crate::compensation::{End, Reach, Robot, correct, error, solve};
use crate::fit::Fit;
use crate::model::Workspace;
use crate::plant::instruments::{Draws, read};
use crate::plant::{Command, Load, Plant, PlantError, PlantSpec, State};
use crate::space::generator;
use nalgebra::{Vector3, Vector6};

/// Corrections for a load that turns with the hand, until the command for it stands: each gains three digits.
const SETTLING_STEPS: usize = 4;

/// A pose to be held.
pub(super) struct Held {
    pub(super) task: Reading,
    pub(super) nominal: Vec<f64>,
    /// Corrected for the tool alone.
    pub(super) start: Vec<f64>,
    pub(super) draws: Vec<Draws>,
}

/// All that the runs of one model share.
pub(super) struct Cell<'a> {
    pub(super) wanted: &'a ControlLoop,
    pub(super) spec: &'a PlantSpec,
    pub(super) robot: &'a Robot<'a>,
    /// The model's parameters, those of the measurement too.
    pub(super) values: &'a [f64],
    pub(super) reach: &'a Reach,
    pub(super) noise: Noise,
}

/// Errors by tick, beside what a filter's run is compared with.
pub(super) struct Base {
    pub(super) nominal: Vec<Vector6<f64>>,
    pub(super) tool_alone: Vec<Vector6<f64>>,
    pub(super) at_once: Vec<Vector6<f64>>,
}

pub(super) enum Outcome {
    Base(Base),
    Run {
        moments: Vec<Moment>,
        unreached: usize,
    },
}

/// What is to be run at a pose.
#[derive(Clone, Copy)]
pub(super) enum Job {
    Base,
    /// Index of the filter; with noise?
    Run(usize, bool),
}

/// The poses that commands reach under the tool, and how many were asked for.
pub(super) fn poses(
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
        let task = task(scenario, spec, target, joints, name, &wanted.payload.load());
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
        let mut loads = vec![self.wanted.payload.load().on(target)];
        for pull in &self.wanted.pulls {
            loads.push(Load {
                target,
                mass: 0.0,
                com: Vector3::from(pull.at_m),
                pull: pull.at(time),
                moment: Vector3::zeros(),
            });
        }
        let command = from_below(joints.to_vec(), loads);
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
    pub(super) fn unseen(
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

    pub(super) fn base(&self, plant: &mut Plant, held: &Held) -> Result<Base, PlantError> {
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
            for _ in 0..SETTLING_STEPS {
                command = knowing
                    .tick(&self.sense(&state, held, tick, &quiet))
                    .command;
                state = self.state(plant, held, tick, &command)?;
            }
            base.at_once.push(self.missed(&state, held));
        }
        Ok(base)
    }

    pub(super) fn run(
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
