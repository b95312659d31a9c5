//! Compensation: from a fitted model to commands that arrive.
//!
//! A task is a reading still to be: `position` and `orientation` are the pose wanted, in the tracker's frame, `joints` the
//! posture to stay near, and the load is the one to be carried. Everything fitted is compensated but what is wrong with the
//! measurement alone; the error before is that of the commands that the nominal robot, standing where the fit says, would
//! be given.

pub mod controller;
pub mod filter;
mod inverse;

pub use inverse::{End, Found, Reach, error, solve};

use crate::campaign::Reading;
use crate::effects::Role;
use crate::fit::{Fit, Status};
use crate::model::{Model, Rows, Workspace};
use crate::space::Space;
use nalgebra::{Isometry3, Matrix6, Vector3, Vector6};
use rand::Rng;

/// A model with its numbers, ready to command.
#[derive(Debug, Clone)]
pub struct Robot<'a> {
    /// The model.
    pub model: &'a Model,
    /// Its parameters with the errors of the measurement left out, SI.
    pub values: Vec<f64>,
    /// The same of the nominal robot: frames alone.
    pub nominal: Vec<f64>,
}

impl<'a> Robot<'a> {
    /// From a model and all its parameters, SI.
    pub fn new(model: &'a Model, values: &[f64]) -> Self {
        let mut own = values.to_vec();
        let mut nominal = values.to_vec();
        for term in &model.terms {
            let range = term.first..term.first + term.parameters.len();
            if term.effect.is_of_measurement() {
                own[range.clone()].fill(0.0);
            }
            if !term.effect.role().is_some_and(Role::is_frame) {
                nominal[range].fill(0.0);
            }
        }
        Self {
            model,
            values: own,
            nominal,
        }
    }

    /// Stiffness of every joint as the model has it, N·m/rad (N/m); none where it knows of no spring.
    pub fn stiffness(&self) -> Vec<Option<f64>> {
        let term = self.model.term_of(Role::Spring);
        let compliance = |joint: usize| Some(self.values[term?.of_joint(joint)?]);
        let joints = 0..self.model.setup.robot.joints.len();
        joints
            .map(|joint| compliance(joint).filter(|c| *c > 0.0).map(|c| 1.0 / c))
            .collect()
    }

    /// Where the tracker stands in the base frame.
    pub fn base_from_tracker(&self) -> Isometry3<f64> {
        self.pose(Role::TrackerFrame, 0)
    }

    /// Where a target sits in its link.
    pub fn link_from_target(&self, target: usize) -> Isometry3<f64> {
        self.pose(Role::TargetFrame, target)
    }

    /// A pose among an effect's parameters; the identity if the model does not have it.
    fn pose(&self, role: Role, index: usize) -> Isometry3<f64> {
        let numbers = self.model.term_of(role).map(|term| term.of(&self.values));
        match numbers.and_then(|numbers| numbers.get(6 * index..6 * index + 6)) {
            Some(&[x, y, z, rx, ry, rz]) => {
                Isometry3::new(Vector3::new(x, y, z), Vector3::new(rx, ry, rz))
            }
            _ => Isometry3::identity(),
        }
    }
}

/// A command, and what it is worth.
#[derive(Debug, Clone)]
pub struct Corrected {
    /// The command.
    pub command: Found,
    /// The command that the nominal robot would be given.
    pub nominal: Found,
    /// What the model says that one misses the pose by: `[v; ω]`, tracker's frame, m and rad.
    pub before: Vector6<f64>,
    /// Covariance of the pose reached, from that of the parameters: `[v; ω]`, m and rad; none without a fit.
    pub covariance: Option<Matrix6<f64>>,
    /// What of it most is from: a parameter that the campaign did not see, and what a typical size of it would do, m.
    pub unseen: Option<(String, f64)>,
    /// Joints loaded beyond their rating: index, torque and rating, N·m (N).
    pub overloaded: Vec<(usize, f64, f64)>,
}

impl Corrected {
    /// One standard deviation of the position reached (root of the sum of the three variances, m) and of the orientation
    /// (rad).
    pub fn deviation(&self) -> Option<(f64, f64)> {
        let covariance = self.covariance?;
        let of = |first: usize| {
            let parts = (first..first + 3).map(|k| covariance[(k, k)].max(0.0));
            parts.sum::<f64>().sqrt()
        };
        Some((of(0), of(3)))
    }

    /// Is the pose reached so uncertain that the correction may make it worse? So if its deviation is above half of the
    /// error before.
    pub fn is_uncertain(&self) -> bool {
        let before = self.before.fixed_rows::<3>(0).norm();
        self.deviation()
            .is_some_and(|(position, _)| position > 0.5 * before.max(1e-9))
    }
}

/// Corrects the command of a task near its own posture.
pub fn correct(
    workspace: &mut Workspace,
    robot: &Robot<'_>,
    fit: Option<&Fit>,
    task: &Reading,
    reach: &Reach,
) -> Corrected {
    let model = robot.model;
    let near = (&task.joints[..], &task.joints[..]);
    let nominal = solve(workspace, model, &robot.nominal, task, near, reach);
    let near = (&nominal.joints[..], &nominal.joints[..]);
    let command = solve(workspace, model, &robot.values, task, near, reach);
    let at = |joints: &[f64]| Reading {
        joints: joints.to_vec(),
        ..task.clone()
    };
    let before = workspace.predict(model, &robot.values, &at(&nominal.joints));
    let before = error(&before, task);
    let there = at(&command.joints);
    let torques = workspace.joint_torques(model, &robot.values, &there);
    let overloaded = model.setup.robot.overloaded(&torques);
    let (covariance, unseen) = match fit {
        Some(fit) => {
            let (covariance, unseen) = certainty(workspace, robot, fit, &there);
            (Some(covariance), unseen)
        }
        None => (None, None),
    };
    Corrected {
        command,
        nominal,
        before,
        covariance,
        unseen,
        overloaded,
    }
}

/// Covariance of a pose from that of the parameters, and the parameter unseen by the campaign that matters most there.
fn certainty(
    workspace: &mut Workspace,
    robot: &Robot<'_>,
    fit: &Fit,
    reading: &Reading,
) -> (Matrix6<f64>, Option<(String, f64)>) {
    let count = robot.values.len();
    let mut wanted = vec![false; count];
    for term in &robot.model.terms {
        let own = term.first..term.first + term.parameters.len();
        for &k in fit.free.iter().filter(|k| own.contains(k)) {
            wanted[k] = !term.effect.is_of_measurement();
        }
    }
    let mut jacobian = Rows::zeros(count);
    workspace.sensitivity(robot.model, &robot.values, &wanted, reading, &mut jacobian);
    let of_free = jacobian.select_columns(&fit.free);
    let pose = of_free.rows(0, 6);
    let covariance = pose * &fit.covariance * pose.transpose();
    let covariance = Matrix6::from_fn(|i, j| covariance[(i, j)]);
    let mut unseen: Option<(String, f64)> = None;
    for (k, (effect, parameter)) in robot.model.parameters().enumerate() {
        // geometry is redundant by nature: what one parameter leaves open another holds
        let alone = parameter.role != Some(Role::Geometry) && fit.status[k] == Status::Unobservable;
        if alone && wanted[k] {
            let moved = jacobian.column(k).fixed_rows::<3>(0).norm() * parameter.typical;
            if moved > 1e-6 && unseen.as_ref().is_none_or(|(_, most)| moved > *most) {
                unseen = Some((format!("{effect}.{}", parameter.name), moved));
            }
        }
    }
    (covariance, unseen)
}

/// A posture from which a nominal robot reaches a task that names none: the first of so many random ones; else the last
/// tried.
pub fn posture(
    workspace: &mut Workspace,
    robot: &Robot<'_>,
    task: &Reading,
    (space, reach): (&Space, &Reach),
    random: &mut impl Rng,
) -> Vec<f64> {
    const STARTS: usize = 40;
    let setup = &robot.model.setup;
    let middle: Vec<f64> = reach.ranges.iter().map(|(a, b)| (a + b) / 2.0).collect();
    let mut last = middle.clone();
    for start in 0..STARTS {
        let from = match start {
            0 => middle.clone(),
            _ => match space.random_posture(setup, random) {
                Some(posture) => posture,
                None => continue,
            },
        };
        let from: Vec<f64> = (0..from.len())
            .map(|joint| match reach.moving.contains(&joint) {
                true => from[joint],
                false => task.joints[joint],
            })
            .collect();
        let near = (&from[..], &from[..]);
        let found = solve(workspace, robot.model, &robot.nominal, task, near, reach);
        last = found.joints;
        if found.end == End::Reached {
            break;
        }
    }
    last
}
