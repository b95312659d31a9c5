//! Which poses to measure: so that the parameters become precise, or so that two effects can be told apart.
//!
//! Many random postures are candidates; each has an information matrix, `JᵀJ` of the whitened Jacobian of all its
//! readings. A design is a sum of some of them and of what is measured already; [`exchange`] finds the best by a
//! [`criterion`]. Random designs from the same candidates stand beside it.

pub mod criterion;
pub mod exchange;
pub mod observability;
mod precision;
mod protocol;
mod read;
mod separation;

pub use precision::{Aim, Figures, Precision, Step, precise};
pub use protocol::Protocol;
pub use read::{Limits, LimitsError};
pub use separation::{DECISIVE, Outlook, Separation, Way, separate};

use crate::campaign::{Noise, Reading, Wrench};
use crate::fit::{CampaignProblem, Fit, noise};
use crate::model::{Model, Workspace};
use crate::space::{Space, generator};
use criterion::Criterion;
use nalgebra::DMatrix;
use rayon::prelude::*;
use std::collections::BTreeSet;

/// Random designs that the proposed one is compared with.
const RANDOM_DESIGNS: usize = 20;

/// Purposes of random numbers.
mod stream {
    pub const CANDIDATES: u128 = 101;
    pub const DESIGNS: u128 = 102;
    pub const TESTS: u128 = 103;
}

/// What is to be planned.
#[derive(Debug, Clone)]
pub struct Task<'a> {
    /// The model whose parameters are to be found, or the base model of two effects.
    pub model: &'a Model,
    /// Its parameters, SI: readings are linearised about them.
    pub values: &'a [f64],
    /// Noise of a reading.
    pub noise: Noise,
    /// Readings that count as measured already.
    pub measured: &'a [&'a Reading],
    /// How each new pose is measured.
    pub protocol: Protocol,
    /// Where new poses may be.
    pub space: Space,
    /// New poses.
    pub poses: usize,
    /// Random postures to choose from.
    pub candidates: usize,
    /// Every random number follows from it.
    pub seed: u64,
}

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlanError {
    /// The space is empty.
    #[error(
        "no posture to measure: none of {} random ones within the limits has its targets {least_height} m above the \
         base and is not forbidden; accepted: limits that leave some",
        crate::space::TRIES
    )]
    NoPosture {
        /// Least height asked for, m.
        least_height: f64,
    },
    /// All postures are the same.
    #[error(
        "no posture to choose: limits and fixed joints leave none of the joints {joints} any range; accepted: a range \
         for one of them at least"
    )]
    NoFreedom {
        /// Joints that the targets depend on.
        joints: String,
    },
    /// Too few of the candidates can be measured.
    #[error(
        "only {held} of {candidates} random postures have a loaded equilibrium: the arm collapses under its load in \
         the others; accepted: loads that it carries in {needed} of them"
    )]
    Collapses {
        /// Postures that hold.
        held: usize,
        /// All of them.
        candidates: usize,
        /// Poses to be chosen, and one more.
        needed: usize,
    },
    /// The readings there are have no derivatives.
    #[error(
        "the readings that are measured already have no loaded equilibrium at the model's parameters: check payload, \
         wrench and link masses"
    )]
    Measured,
    /// An effect without free parameters.
    #[error(
        "{effect}: none of its parameters is free on this robot and model; accepted: an effect with parameters to be estimated"
    )]
    Nothing {
        /// The effect.
        effect: String,
    },
}

impl<'a> Task<'a> {
    /// What to measure next after a campaign: as it was measured, about its fit, its readings counted.
    ///
    /// New poses keep to the robot's limits (5 % of each range left free), and no lower than the campaign went, or
    /// than the base; joints that never moved, and those that no target hangs on, stay where they were.
    pub fn after(fit: &'a Fit, readings: &'a [&'a Reading], poses: usize) -> Self {
        let setup = &fit.model.setup;
        let mut space = Space::within_limits(&setup.robot, 0.05);
        let protocol = Protocol::of(setup, readings);
        let first = readings.first().map(|reading| &reading.joints[..]);
        space.park(setup, &protocol.targets, first);
        let several = readings.iter().any(|r| Some(&r.joints[..]) != first);
        for (joint, range) in space.ranges.iter_mut().enumerate() {
            let at = first.map_or(0.0, |joints| joints[joint]);
            if several && readings.iter().all(|r| r.joints[joint] == at) {
                *range = (at, at);
            }
        }
        let heights = readings
            .iter()
            .flat_map(|reading| crate::space::heights(setup, &reading.joints));
        space.least_height = heights.fold(0.0, f64::min);
        Self {
            model: &fit.model,
            values: &fit.values,
            noise: fit.noise.shape.times(fit.noise.factor.sqrt()),
            measured: readings,
            protocol,
            space,
            poses,
            candidates: 200,
            seed: 1,
        }
    }

    /// Indices of the parameters that are estimated.
    fn free(&self) -> Vec<usize> {
        let parameters = self.model.parameters().enumerate();
        parameters
            .filter(|(_, (_, parameter))| parameter.vary)
            .map(|(index, _)| index)
            .collect()
    }
}

/// Whitened Jacobians of what is measured and of the candidates, reduced to information matrices.
struct Information {
    measured: DMatrix<f64>,
    postures: Vec<Vec<f64>>,
    candidates: Vec<DMatrix<f64>>,
    /// Rows of one candidate, with its repeats, and of the readings measured.
    rows: (usize, usize),
}

impl Information {
    /// For the parameters `free` of a model at `values`.
    fn gather(
        task: &Task<'_>,
        model: &Model,
        values: &[f64],
        free: &[usize],
    ) -> Result<Self, PlanError> {
        let (measured, measured_rows) =
            of_readings(model, values, free, &task.noise, task.measured);
        if measured.iter().any(|x| !x.is_finite()) {
            return Err(PlanError::Measured);
        }
        let repeats = task.protocol.repeats;
        let drawn = postures(task, task.candidates, stream::CANDIDATES)?;
        let all: Vec<Option<(DMatrix<f64>, usize)>> = drawn
            .par_iter()
            .map(|joints| {
                let readings = foreseen(model, values, task.protocol.readings(joints))?;
                let readings: Vec<&Reading> = readings.iter().collect();
                let (one, rows) = of_readings(model, values, free, &task.noise, &readings);
                let finite = one.iter().all(|x| x.is_finite());
                finite.then(|| (one * repeats as f64, rows * repeats))
            })
            .collect();
        let mut found = Self {
            measured,
            postures: Vec::new(),
            candidates: Vec::new(),
            rows: (0, measured_rows),
        };
        let count = drawn.len();
        for (joints, one) in drawn.into_iter().zip(all) {
            if let Some((one, rows)) = one {
                found.postures.push(joints);
                found.candidates.push(one);
                found.rows.0 = rows;
            }
        }
        if found.candidates.len() <= task.poses {
            return Err(PlanError::Collapses {
                held: found.candidates.len(),
                candidates: count,
                needed: task.poses + 1,
            });
        }
        Ok(found)
    }

    /// Information of a design.
    fn of(&self, taken: &[usize]) -> DMatrix<f64> {
        exchange::information(&self.measured, &self.candidates, taken)
    }

    /// Random designs of so many poses, the best first.
    fn random_designs(
        &self,
        criterion: &dyn Criterion,
        poses: usize,
        seed: u64,
    ) -> Vec<Vec<usize>> {
        let mut random = generator(seed, stream::DESIGNS);
        let mut valued: Vec<(f64, Vec<usize>)> = (0..RANDOM_DESIGNS)
            .map(|_| exchange::draw(self.candidates.len(), poses, &mut random))
            .map(|design| (criterion.value(&self.of(&design)), design))
            .collect();
        valued.sort_by(|a, b| b.0.total_cmp(&a.0));
        valued.into_iter().map(|(_, design)| design).collect()
    }

    /// The best design that exchanges reach from these.
    fn best(&self, criterion: &dyn Criterion, starts: &[Vec<usize>]) -> Vec<usize> {
        let mut best = (f64::NEG_INFINITY, Vec::new());
        for start in starts {
            let taken =
                exchange::exchange(criterion, &self.measured, &self.candidates, start.clone());
            let value = criterion.value(&self.of(&taken));
            if value > best.0 {
                best = (value, taken);
            }
        }
        best.1
    }
}

/// Proposed poses as readings still to be taken, in an order that changes the load as seldom as can be. Poses are
/// labelled `plan001`, … and go on where the labels of what is measured end; what instruments will read is as the
/// model foresees it.
pub fn visits(task: &Task<'_>, poses: &[Vec<f64>]) -> Vec<Reading> {
    let number = |reading: &&Reading| reading.pose.as_ref()?.strip_prefix("plan")?.parse().ok();
    let labelled: usize = task.measured.iter().filter_map(number).max().unwrap_or(0);
    let mut visits = Vec::new();
    for load in &task.protocol.loads {
        let one = Protocol {
            loads: vec![*load],
            ..task.protocol.clone()
        };
        for (pose, joints) in poses.iter().enumerate() {
            let readings = foreseen(task.model, task.values, one.readings(joints));
            for reading in readings.unwrap_or_default() {
                for repeat in 0..one.repeats {
                    visits.push(Reading {
                        pose: Some(format!("plan{:03}", labelled + pose + 1)),
                        repeat: Some(format!("{}", repeat + 1)),
                        ..reading.clone()
                    });
                }
            }
        }
    }
    visits
}

/// Random postures of the task's space.
fn postures(task: &Task<'_>, count: usize, stream: u128) -> Result<Vec<Vec<f64>>, PlanError> {
    let setup = &task.model.setup;
    let observed: BTreeSet<usize> = task
        .protocol
        .targets
        .iter()
        .flat_map(|&target| setup.robot.chain(setup.target_body(target)))
        .collect();
    let free = |&&joint: &&usize| task.space.ranges[joint].0 < task.space.ranges[joint].1;
    if !observed.iter().any(|joint| free(&joint)) {
        let names = observed
            .iter()
            .map(|&j| setup.robot.joints[j].name.as_str());
        return Err(PlanError::NoFreedom {
            joints: names.collect::<Vec<_>>().join(", "),
        });
    }
    let mut random = generator(task.seed, stream);
    (0..count)
        .map(|_| {
            let posture = task.space.random_posture(setup, &mut random);
            posture.ok_or(PlanError::NoPosture {
                least_height: task.space.least_height,
            })
        })
        .collect()
}

/// Readings as the model foresees them; none if one of them has no equilibrium.
fn foreseen(model: &Model, values: &[f64], mut readings: Vec<Reading>) -> Option<Vec<Reading>> {
    let mut workspace = Workspace::new(&model.setup);
    for reading in &mut readings {
        let seen = workspace.predict(model, values, reading);
        if !seen.settled {
            return None;
        }
        reading.position = seen.position;
        reading.orientation = reading.orientation.map(|_| seen.orientation);
        reading.wrench = reading.wrench.map(|_| Wrench {
            force: seen.wrench.fixed_rows::<3>(0).into_owned(),
            torque: seen.wrench.fixed_rows::<3>(3).into_owned(),
        });
    }
    Some(readings)
}

/// `JᵀJ` of readings in typical sizes, and their rows.
fn of_readings(
    model: &Model,
    values: &[f64],
    free: &[usize],
    noise: &Noise,
    readings: &[&Reading],
) -> (DMatrix<f64>, usize) {
    let whiteners = noise::whiteners(model, values, readings, noise);
    let problem = CampaignProblem::new(model, readings, &whiteners, free, values);
    let at: Vec<f64> = free.iter().map(|&k| values[k]).collect();
    let n = free.len();
    let mut sum = DMatrix::zeros(n, n);
    let mut rows = 0;
    for block in problem.blocks(&at) {
        let jacobian = block.columns(0, n);
        sum += jacobian.transpose() * jacobian;
        rows += block.nrows();
    }
    (sum, rows)
}

/// The middle one of some numbers by size; zero of none.
fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}
