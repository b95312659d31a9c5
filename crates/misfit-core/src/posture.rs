//! One reading's posture: open to the effects, then composed once.
//!
//! An effect reads what the reading was taken under and the local wrenches, and adds to *deviations*, all zero
//! for a robot, load and instruments that are exactly nominal:
//!
//! * each joint's angle, on top of the encoder's;
//! * a small motion of each *node*: node 0 is the pedestal, node `j + 1` sits right behind joint `j`. It moves
//!   what the joint carries by a translation (m) and then a rotation vector (rad), in the frame that the
//!   joint moves (virtual joint method; Klimchik et al., ICINCO 2014, "Complete Stiffness Model for a Serial
//!   Robot");
//! * masses and their centres, payload, the direction of gravity, torques beside the load's;
//! * what wrist sensor and tracker make of the truth.
//!
//! The frames of tracker and target are not small; effects compose them.

use crate::campaign::Reading;
use crate::dual_quaternion::{DualQuaternion, Scalar, constant};
use crate::setup::Setup;
use nalgebra::{Vector3, Vector6};
use std::ops::Range;

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
    /// What the wrist sensor should read, `[f; m]`, link frame, N and N·m; zero but for effects on the sensor.
    pub sensed: Vector6<S>,
    /// Deviations by [`Slots`].
    deviations: &'a mut [S],
    /// Deviations that were added to lie in here.
    touched: Range<usize>,
    /// Pose of the tracker in the robot's base frame.
    pub base_from_tracker: DualQuaternion<S>,
    /// Pose of this reading's target in its link.
    pub link_from_target: DualQuaternion<S>,
}

impl<'a, S: Scalar> Posture<'a, S> {
    /// A posture to which nothing has been added yet, but for what `deviations` hold; frames are the identity.
    pub fn new(
        setup: &'a Setup,
        reading: &'a Reading,
        wrenches: &'a [Vector6<S>],
        sensed: Vector6<S>,
        deviations: &'a mut [S],
    ) -> Self {
        Self {
            setup,
            reading,
            wrenches,
            sensed,
            touched: deviations.len()..0,
            deviations,
            base_from_tracker: DualQuaternion::identity(),
            link_from_target: DualQuaternion::identity(),
        }
    }

    /// Deviations that were added to lie in here: others are what they were.
    pub fn touched(&self) -> Range<usize> {
        let Range { start, end } = self.touched;
        start.min(end)..end
    }

    fn add(&mut self, slot: usize, by: S) {
        self.deviations[slot] += by;
        self.touched.start = self.touched.start.min(slot);
        self.touched.end = self.touched.end.max(slot + 1);
    }

    /// Encoder angle of a joint, rad (m).
    pub fn q(&self, joint: usize) -> S {
        constant(self.reading.joints[joint])
    }

    /// Direction of a joint's last motion; 0 where the campaign does not say.
    pub fn approach(&self, joint: usize) -> S {
        let approach = self.reading.approach.as_ref();
        constant(approach.map_or(0.0, |all| all[joint]))
    }

    /// Time from the middle of the campaign, s; 0 where the campaign does not say.
    pub fn time(&self) -> S {
        let time = self.reading.time.map(|time| time - self.setup.time_zero);
        constant(time.unwrap_or(0.0))
    }

    /// Temperature of a body above the campaign's mean, K; that of the whole robot where none is given for a
    /// link of it, 0 where the campaign does not say.
    pub fn temperature(&self, body: usize) -> S {
        let links = &self.setup.robot.links;
        let own = self.reading.link_temperatures.iter();
        let mut own = own.filter(|(link, _)| links[*link].body == body);
        let found = own.next().map(|(_, t)| *t).or(self.reading.temperature);
        constant(found.map_or(0.0, |t| t - self.setup.temperature_zero))
    }

    /// Adds to a joint's angle, rad (m for a prismatic one).
    pub fn move_joint(&mut self, joint: usize, by: S) {
        self.add(joint, by);
    }

    /// Adds to one number of a node's motion: 0 to 2 translation (m), 3 to 5 rotation (rad).
    pub fn move_node(&mut self, node: usize, component: usize, by: S) {
        let slot = Slots::of(self.setup).node(node) + component;
        self.add(slot, by);
    }

    /// Adds to a body's mass at its nominal centre, kg.
    pub fn add_mass(&mut self, body: usize, by: S) {
        let slot = Slots::of(self.setup).mass + body;
        self.add(slot, by);
    }

    /// Moves a body's centre of mass, body's frame, m.
    pub fn move_com(&mut self, body: usize, by: [S; 3]) {
        let first = Slots::of(self.setup).com + 3 * body;
        for (k, by) in by.into_iter().enumerate() {
            self.add(first + k, by);
        }
    }

    /// Adds to gravity, base frame, m/s².
    pub fn add_gravity(&mut self, by: [S; 3]) {
        let first = Slots::of(self.setup).gravity;
        for (k, by) in by.into_iter().enumerate() {
            self.add(first + k, by);
        }
    }

    /// Adds to the payload's mass, kg; without a payload nothing happens.
    pub fn add_payload_mass(&mut self, by: S) {
        let slot = Slots::of(self.setup).payload_mass;
        self.add(slot, by);
    }

    /// Moves the payload's centre, target link's frame, m.
    pub fn move_payload(&mut self, by: [S; 3]) {
        let first = Slots::of(self.setup).payload_com;
        for (k, by) in by.into_iter().enumerate() {
            self.add(first + k, by);
        }
    }

    /// Adds to the torque that a joint's gear carries, N·m (N).
    pub fn add_torque(&mut self, joint: usize, by: S) {
        let slot = Slots::of(self.setup).torque + joint;
        self.add(slot, by);
    }

    /// Adds to what the wrist sensor reads: components of `[f; m]`, N and N·m.
    pub fn add_sensed(&mut self, component: usize, by: S) {
        let slot = Slots::of(self.setup).sensed + component;
        self.add(slot, by);
    }

    /// Lengthens the tracker's distances by a share.
    pub fn scale_tracker(&mut self, by: S) {
        let slot = Slots::of(self.setup).tracker_scale;
        self.add(slot, by);
    }

    /// Torque of the load about a joint's axis, N·m (force along it for a prismatic one, N).
    pub fn torque(&self, joint: usize) -> S {
        let wrench = &self.wrenches[joint + 1];
        let start = self.setup.robot.joints[joint].load_row();
        let axis: Vector3<f64> = *self.setup.robot.joints[joint].axis;
        (0..3)
            .map(|k| wrench[start + k] * constant(axis[k]))
            .fold(S::zero(), |sum, x| sum + x)
    }
}

/// Where each deviation stands in the vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slots {
    /// Joints; their angles come first.
    pub joints: usize,
    /// Masses by body.
    pub mass: usize,
    /// Centres of mass by body, 3 each.
    pub com: usize,
    /// Gravity, 3.
    pub gravity: usize,
    /// Payload mass.
    pub payload_mass: usize,
    /// Payload centre, 3.
    pub payload_com: usize,
    /// Torques by joint.
    pub torque: usize,
    /// Wrist sensor, 6.
    pub sensed: usize,
    /// Tracker scale.
    pub tracker_scale: usize,
    /// Number of all.
    pub count: usize,
}

impl Slots {
    /// The layout for a robot.
    pub fn of(setup: &Setup) -> Self {
        let joints = setup.robot.joints.len();
        let nodes = joints + 1;
        let mass = joints + NODE * nodes;
        let com = mass + nodes;
        let gravity = com + 3 * nodes;
        let payload_mass = gravity + 3;
        let payload_com = payload_mass + 1;
        let torque = payload_com + 3;
        let sensed = torque + joints;
        let tracker_scale = sensed + 6;
        Self {
            joints,
            mass,
            com,
            gravity,
            payload_mass,
            payload_com,
            torque,
            sensed,
            tracker_scale,
            count: tracker_scale + 1,
        }
    }

    /// First of a node's numbers.
    pub fn node(&self, node: usize) -> usize {
        self.joints + NODE * node
    }

    /// What a deviation deviates.
    pub fn kind(&self, slot: usize) -> Kind {
        let s = self;
        if slot < s.joints {
            Kind::Joint(slot)
        } else if slot < s.mass {
            let at = slot - s.joints;
            Kind::Node(at / NODE, at % NODE)
        } else if slot < s.com {
            Kind::Mass(slot - s.mass)
        } else if slot < s.gravity {
            let at = slot - s.com;
            Kind::Com(at / 3, at % 3)
        } else if slot < s.payload_mass {
            Kind::Gravity(slot - s.gravity)
        } else if slot < s.payload_com {
            Kind::PayloadMass
        } else if slot < s.torque {
            Kind::PayloadCom(slot - s.payload_com)
        } else if slot < s.sensed {
            Kind::Torque(slot - s.torque)
        } else if slot < s.tracker_scale {
            Kind::Sensed(slot - s.sensed)
        } else {
            Kind::TrackerScale
        }
    }
}

/// What a deviation deviates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Angle of a joint.
    Joint(usize),
    /// Component of a node's motion.
    Node(usize, usize),
    /// Mass of a body.
    Mass(usize),
    /// Component of a body's centre of mass.
    Com(usize, usize),
    /// Component of gravity.
    Gravity(usize),
    /// Mass of the payload.
    PayloadMass,
    /// Component of the payload's centre.
    PayloadCom(usize),
    /// Torque on a joint.
    Torque(usize),
    /// Component of the sensor's wrench.
    Sensed(usize),
    /// Scale of the tracker.
    TrackerScale,
}
