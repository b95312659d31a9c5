//! Where and how the plant is measured: random poses, loads, approach directions, repeats, order.

use super::{Scenario, ScenarioError};
use crate::campaign::Payload;
use crate::plant::{Command, Load};
use crate::space::{Space, TRIES, generator};
use nalgebra::Vector3;
use rand::Rng;
use rand::seq::SliceRandom;

/// A factorial design: every pose under every load from every direction, so often.
#[derive(Debug, Clone, PartialEq)]
pub struct Design {
    /// Random poses, the same ones for each target.
    pub poses: usize,
    /// How many of them are held out.
    pub heldout: usize,
    /// Postures fitted besides, by all joints, rad (m).
    pub more: Vec<Vec<f64>>,
    /// Loads on the target's link.
    pub loads: Vec<DesignLoad>,
    /// 1 or 2: approach each pose from below only, or from both sides.
    pub directions: usize,
    /// Repeats of each combination.
    pub repeats: usize,
    /// Random order of the readings, or pose by pose.
    pub random_order: bool,
    /// Where the poses may be.
    pub space: Space,
    /// The robot's temperature, if it is measured.
    pub temperature: Option<WarmUp>,
}

/// A robot that warms up from its start: `start + rise (1 - exp(-t / time))`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WarmUp {
    /// Temperature at the first reading, °C.
    pub start: f64,
    /// How much warmer it gets in the end, K.
    pub rise: f64,
    /// Time constant, s.
    pub time: f64,
}

impl WarmUp {
    /// Temperature at a time from the first reading (s), °C.
    pub fn at(&self, time: f64) -> f64 {
        self.start - self.rise * (-time / self.time).exp_m1()
    }
}

impl Design {
    /// Number of readings for so many targets.
    pub fn readings(&self, targets: usize) -> usize {
        [self.loads.len(), self.directions, self.repeats, targets]
            .into_iter()
            .fold(self.poses, usize::saturating_mul)
    }
}

/// A load of a design; nothing by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DesignLoad {
    /// kg.
    pub mass: f64,
    /// Centre in the target link's frame, m.
    pub com: Vector3<f64>,
    /// Force at the centre in the base frame, N.
    pub pull: Vector3<f64>,
}

impl DesignLoad {
    /// The load on a target of the plant.
    pub fn on(&self, target: usize) -> Load {
        Load {
            target,
            mass: self.mass,
            com: self.com,
            pull: self.pull,
            moment: Vector3::zeros(),
        }
    }

    /// The same as a payload, without its pull.
    pub fn payload(&self) -> Payload {
        Payload {
            mass: self.mass,
            com: self.com,
        }
    }
}

/// The command of a posture approached from below under loads, at the middle of the campaign and its mean temperature.
pub(super) fn from_below(joints: Vec<f64>, loads: Vec<Load>) -> Command {
    Command {
        approach: vec![1.0; joints.len()],
        joints,
        loads,
        time: 0.0,
        temperature: 0.0,
    }
}

/// One reading to be taken.
#[derive(Debug, Clone, PartialEq)]
pub struct Visit {
    /// Index of the pose.
    pub pose: usize,
    /// Index of the target measured.
    pub target: usize,
    /// Index of the load.
    pub load: usize,
    /// -1 or +1.
    pub direction: f64,
    /// Index of the repeat.
    pub repeat: usize,
    /// Joint angles, rad or m.
    pub joints: Vec<f64>,
}

impl Visit {
    /// The command of this reading under its load, at the middle of the campaign and its mean temperature.
    pub fn command(&self, load: &DesignLoad) -> Command {
        Command {
            joints: self.joints.clone(),
            approach: vec![self.direction; self.joints.len()],
            loads: vec![load.on(self.target)],
            time: 0.0,
            temperature: 0.0,
        }
    }
}

/// Purposes of random numbers: each has its own stream, so that none depends on how many another draws.
pub(crate) mod stream {
    pub const POSES: u128 = 1;
    pub const ORDER: u128 = 2;
    pub const NOISE: u128 = 3;
    pub const TRUTH: u128 = 4;
    pub const WORKSPACE: u128 = 5;
    pub const SWEEP: u128 = 6;
    pub const OUTLIERS: u128 = 7;
    pub const COMPENSATION: u128 = 8;
    pub const CONTROL_LOOP: u128 = 9;
    pub const DRILL: u128 = 10;
    pub const DISTURBANCE: u128 = 11;
}

/// All readings of a scenario, in the order in which they are taken.
///
/// # Errors
/// If no posture reaches the least height.
pub fn visits(scenario: &Scenario) -> Result<Vec<Visit>, ScenarioError> {
    let design = &scenario.design;
    let poses = poses(scenario)?;
    let mut visits = Vec::new();
    for target in 0..scenario.setup.targets.len() {
        for (pose, joints) in poses.iter().enumerate() {
            for load in 0..design.loads.len() {
                for direction in [-1.0, 1.0].into_iter().take(design.directions) {
                    for repeat in 0..design.repeats {
                        visits.push(Visit {
                            pose,
                            target,
                            load,
                            direction,
                            repeat,
                            joints: joints.clone(),
                        });
                    }
                }
            }
        }
    }
    if design.random_order {
        visits.shuffle(&mut generator(scenario.seed, stream::ORDER));
    }
    Ok(visits)
}

/// Random postures within the limits, all target links above the least height.
fn poses(scenario: &Scenario) -> Result<Vec<Vec<f64>>, ScenarioError> {
    let mut random = generator(scenario.seed, stream::POSES);
    let random = (0..scenario.design.poses).map(|_| random_posture(scenario, &mut random));
    let more = scenario.design.more.iter().cloned().map(Ok);
    random.chain(more).collect()
}

/// One of them.
pub(super) fn random_posture(
    scenario: &Scenario,
    random: &mut impl Rng,
) -> Result<Vec<f64>, ScenarioError> {
    let space = &scenario.design.space;
    let found = space.random_posture(&scenario.setup, random);
    found.ok_or_else(|| {
        scenario.form_error(format!(
            "[design] least_height_m = {}: none of {TRIES} random postures has its targets so high; \
             accepted: a height that the arm reaches more often",
            space.least_height
        ))
    })
}
