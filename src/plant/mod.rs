//! The truth: a robot with springs, displaced bodies and instruments, realised in MuJoCo.
//!
//! The plant shares the nominal [`Robot`](crate::robot::Robot) with the model, as data, and nothing else:
//! kinematics, statics and wrist wrenches are MuJoCo's, the instruments' geometry is nalgebra's.

use crate::robot::Robot;
use nalgebra::{Isometry3, Vector3};

/// The truth under construction; effects add themselves to it, then [`Plant::build`] makes it.
pub struct PlantSpec {
    /// The robot as MuJoCo will have it: starts nominal, effects move joints and masses.
    pub robot: Robot,
    /// By body: where what the body carries (links, mass, further joints) really sits, in the frame that
    /// its joint moves.
    pub body_from_displaced: Vec<Isometry3<f64>>,
    /// By joint: torsional spring, N·m/rad (N/m for a slide); `None` is rigid.
    pub stiffness: Vec<Option<f64>>,
    /// By joint: added to the commanded angle before the spring's rest position is set, rad (m).
    pub command_laws: Vec<CommandLaw>,
    /// Gravity in the base frame, m/s².
    pub gravity: Vector3<f64>,
    /// By target: link index and the target's pose in it.
    pub targets: Vec<(usize, Isometry3<f64>)>,
    /// Where the tracker stands.
    pub base_from_tracker: Isometry3<f64>,
}

/// What the robot was told to do and carries: all that a plant's state depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Commanded angle of every moving joint, rad or m.
    pub joints: Vec<f64>,
    /// Direction of each joint's last motion: -1, 0, +1.
    pub approach: Vec<f64>,
    /// What hangs on the targets' links.
    pub loads: Vec<Load>,
}

/// A dead weight on a target's link, and a pull in the base frame at its centre.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Index into the plant's targets.
    pub target: usize,
    /// kg.
    pub mass: f64,
    /// Centre in the target link's frame, m.
    pub com: Vector3<f64>,
    /// Force at that centre, in the base frame, N (a rope over a pulley).
    pub pull: Vector3<f64>,
}

/// Adds to the joint angles that a command asks for: `law(command, angles)`.
pub type CommandLaw = Box<dyn Fn(&Command, &mut [f64]) + Send + Sync>;

/// Why there is no plant, or no state of it.
#[derive(Debug, thiserror::Error)]
pub enum PlantError {
    /// A value the plant cannot realise.
    #[error("{effect}.{parameter}: the plant cannot realise {found}; accepted: {accepted}")]
    Value {
        /// Effect.
        effect: &'static str,
        /// Parameter.
        parameter: String,
        /// The value.
        found: f64,
        /// What would do.
        accepted: &'static str,
    },
}
