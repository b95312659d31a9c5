//! What is fixed for a whole campaign: the nominal robot, the targets on it, gravity.

use crate::campaign::{Campaign, Target};
use crate::robot::Robot;
use nalgebra::Vector3;

/// The nominal robot and what is mounted on it.
#[derive(Debug, Clone, PartialEq)]
pub struct Setup {
    /// Nominal robot.
    pub robot: Robot,
    /// What the tracker sees.
    pub targets: Vec<Target>,
    /// Gravity in the base frame, m/s².
    pub gravity: Vector3<f64>,
    /// Joints between the base and any target, parents first: those that a reading can depend on.
    pub observed: Vec<usize>,
    /// Middle of the campaign, s: drifts are counted from here.
    pub time_zero: f64,
    /// Mean temperature of the campaign, °C: expansions are counted from here.
    pub temperature_zero: f64,
}

impl Setup {
    /// Collects what is fixed and finds the joints that readings can depend on.
    pub fn new(robot: Robot, targets: Vec<Target>, gravity: Vector3<f64>) -> Self {
        let mut seen = vec![false; robot.joints.len()];
        for target in &targets {
            for joint in robot.chain(robot.links[target.link].body) {
                seen[joint] = true;
            }
        }
        let observed = (0..seen.len()).filter(|&j| seen[j]).collect();
        Self {
            robot,
            targets,
            gravity,
            observed,
            time_zero: 0.0,
            temperature_zero: 0.0,
        }
    }

    /// What is fixed in a campaign.
    pub fn of(campaign: &Campaign) -> Self {
        let mut setup = Self::new(
            campaign.robot.clone(),
            campaign.targets.clone(),
            campaign.gravity,
        );
        let times = campaign.readings.iter().filter_map(|r| r.time);
        let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
            (a.min(t), b.max(t))
        });
        if first.is_finite() {
            setup.time_zero = (first + last) / 2.0;
        }
        let temperatures = campaign.readings.iter();
        let temperatures: Vec<f64> = temperatures
            .flat_map(|r| {
                r.temperature
                    .into_iter()
                    .chain(r.link_temperatures.iter().map(|t| t.1))
            })
            .collect();
        if !temperatures.is_empty() {
            setup.temperature_zero = temperatures.iter().sum::<f64>() / temperatures.len() as f64;
        }
        setup
    }

    /// Index of the body that a target is fixed to.
    pub fn target_body(&self, target: usize) -> usize {
        self.robot.links[self.targets[target].link].body
    }
}
