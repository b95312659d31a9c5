//! One reading's posture: open to the effects, then composed once.
//!
//! An effect reads what the reading was taken under and the local wrenches, and adds to *displacements*, all
//! zero for a robot that is exactly nominal:
//!
//! * each joint's angle, on top of the encoder's;
//! * a small motion of each *node*: node 0 is the pedestal, node `j + 1` sits right behind joint `j`. It moves
//!   what the joint carries by a translation (m) and then a rotation vector (rad), in the frame that the
//!   joint moves (virtual joint method; Klimchik et al., ICINCO 2014, "Complete Stiffness Model for a Serial
//!   Robot");
//! * the frames of the tracker and of the target.

use crate::campaign::Reading;
use crate::dual_quaternion::{DualQuaternion, Scalar};
use crate::setup::Setup;
use nalgebra::{Vector3, Vector6};

/// Numbers of one node: translation x y z, rotation x y z.
pub const NODE: usize = 6;

/// What effects see of one reading, and what they add to.
pub struct Posture<'a, S: Scalar> {
    /// The nominal robot and its targets.
    pub setup: &'a Setup,
    /// Encoder angles, approach, temperature, time, load of this reading.
    pub reading: &'a Reading,
    /// Load on each node: `[f; m]` that everything carried by it exerts, about the joint frame's origin and
    /// in the joint frame, N and N·m. Zero for effects that act before the load.
    pub wrenches: &'a [Vector6<S>],
    /// Joints first (rad or m), then [`NODE`] numbers a node.
    pub displacements: &'a mut [S],
    /// Pose of the tracker in the robot's base frame.
    pub base_from_tracker: DualQuaternion<S>,
    /// Pose of this reading's target in its link.
    pub link_from_target: DualQuaternion<S>,
}

impl<S: Scalar> Posture<'_, S> {
    /// Adds to a joint's angle, rad (m for a prismatic one).
    pub fn move_joint(&mut self, joint: usize, by: S) {
        self.displacements[joint] += by;
    }

    /// Adds to one number of a node's motion: 0 to 2 translation (m), 3 to 5 rotation (rad).
    pub fn move_node(&mut self, node: usize, component: usize, by: S) {
        self.displacements[node_slot(self.setup, node) + component] += by;
    }

    /// Torque of the load about a joint's axis, N·m (force along it for a prismatic one, N).
    pub fn torque(&self, joint: usize) -> S {
        let wrench = &self.wrenches[joint + 1];
        let start = self.setup.robot.joints[joint].load_row();
        let axis: Vector3<f64> = *self.setup.robot.joints[joint].axis;
        (0..3)
            .map(|k| wrench[start + k] * crate::dual_quaternion::constant(axis[k]))
            .fold(S::zero(), |sum, x| sum + x)
    }
}

/// Number of displacements of a robot.
pub fn displacement_count(setup: &Setup) -> usize {
    node_slot(setup, setup.robot.bodies.len())
}

/// Index of a node's first displacement.
pub fn node_slot(setup: &Setup, node: usize) -> usize {
    setup.robot.joints.len() + NODE * node
}
