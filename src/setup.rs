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
        }
    }

    /// What is fixed in a campaign.
    pub fn of(campaign: &Campaign) -> Self {
        Self::new(
            campaign.robot.clone(),
            campaign.targets.clone(),
            campaign.gravity,
        )
    }

    /// Index of the body that a target is fixed to.
    pub fn target_body(&self, target: usize) -> usize {
        self.robot.links[self.targets[target].link].body
    }
}
