//! Compensation in the loop: each tick a measured wrench comes in and a corrected command goes out.
//!
//! Source: Appl. Sci. 2019, 9, 65, Fig. 2: force, filter, stiffness model, pose correction. The wrench is taken as the
//! whole load, a tool's weight with it, as the sensor feels it too.

use super::filter::{Filter, Law};
use super::inverse::{End, Reach, solve};
use crate::campaign::{Reading, Wrench};
use crate::effects::Stage;
use crate::model::{Model, Workspace};
use nalgebra::{Vector3, Vector6};

/// Holds one pose under a load that it learns from a wrist sensor.
pub struct Controller<'a> {
    model: &'a Model,
    values: Vec<f64>,
    task: Reading,
    /// Of all commands, the one nearest to this.
    reference: Vec<f64>,
    reach: &'a Reach,
    filter: Filter,
    workspace: Workspace,
    command: Vec<f64>,
}

/// What one tick gives.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// The wrench, filtered, link frame, N and N·m.
    pub filtered: Wrench,
    /// The wrench that the command is corrected for: foreseen, if the filter looks ahead.
    pub foreseen: Wrench,
    /// The next command, by joint of the robot, rad (m).
    pub command: Vec<f64>,
    /// Was it found? If not, the command before stands.
    pub found: bool,
}

impl<'a> Controller<'a> {
    /// Holds the pose of a task (`position`, `orientation`, tracker's frame) near its posture; its load is ignored.
    /// `values` are the model's, SI; `filter` is of the ticks.
    pub fn new(
        model: &'a Model,
        values: &[f64],
        task: &Reading,
        (start, reference): (&[f64], &[f64]),
        reach: &'a Reach,
        filter: Law,
    ) -> Self {
        Self {
            model,
            values: with_sensor(model, values),
            task: Reading {
                payload: None,
                process: None,
                ..task.clone()
            },
            reference: reference.to_vec(),
            reach,
            filter: Filter::new(filter),
            workspace: Workspace::new(&model.setup),
            command: start.to_vec(),
        }
    }

    /// Moves the pose to be held to a position, tracker's frame, m.
    pub fn aim(&mut self, position: Vector3<f64>) {
        self.task.position = position;
    }

    /// Takes a measured wrench (of the load on the arm at the target link's origin, in that link's frame) and corrects.
    pub fn tick(&mut self, measured: &Wrench) -> Tick {
        let (filtered, foreseen) = self.filter.push(&stacked(measured));
        let foreseen = parted(&foreseen);
        self.task.wrench = Some(foreseen);
        let near = (&self.command[..], &self.reference[..]);
        let found = solve(
            &mut self.workspace,
            self.model,
            &self.values,
            &self.task,
            near,
            self.reach,
        );
        let reached = found.end == End::Reached;
        if reached {
            self.command = found.joints;
        }
        Tick {
            filtered: parted(&filtered),
            foreseen,
            command: self.command.clone(),
            found: reached,
        }
    }
}

/// Parameters for a load that is measured: errors of the measurement left out, but for those of the wrist sensor, which
/// stand between the wrench measured and the load.
fn with_sensor(model: &Model, values: &[f64]) -> Vec<f64> {
    let mut own = values.to_vec();
    for term in &model.terms {
        if term.effect.is_of_measurement() && term.effect.stage() != Stage::Sensor {
            own[term.first..term.first + term.parameters.len()].fill(0.0);
        }
    }
    own
}

fn stacked(wrench: &Wrench) -> Vector6<f64> {
    crate::model::stacked(&wrench.force, &wrench.torque)
}

fn parted(all: &Vector6<f64>) -> Wrench {
    Wrench {
        force: Vector3::new(all[0], all[1], all[2]),
        torque: Vector3::new(all[3], all[4], all[5]),
    }
}
