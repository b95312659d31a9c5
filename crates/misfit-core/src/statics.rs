//! The loaded arm: kinematics from deviations, wrenches from loads, and how both change with every
//! deviation, in closed form.
//!
//! Frames: for each joint the *joint frame* turns with the joint; the node's displacement sits behind it, and
//! the body (its links, its mass, further joints) behind that. All quantities here are in the base frame
//! unless their name says `local`.

use crate::campaign::{Reading, Wrench};
use crate::dual_quaternion::DualQuaternion;
use crate::posture::{Kind, NODE, Slots};
use crate::robot::JointKind;
use crate::setup::Setup;
use nalgebra::{Isometry3, Matrix3, Vector3, Vector6};

/// What a robot carries in one reading.
#[derive(Debug, Clone, Copy)]
pub struct Load {
    /// Body of the target.
    pub body: usize,
    /// Pose of the target's link in it.
    pub body_from_link: Isometry3<f64>,
    /// Dead weight, kg, and its centre in the link's frame, m.
    pub payload: Option<(f64, Vector3<f64>)>,
    /// Wrench that turns with the link, at its origin, in its frame.
    pub follower: Option<Wrench>,
}

impl Load {
    /// The load that a reading was taken under: its payload if it has one, else its measured wrench.
    ///
    /// A known weight is better than a sensor: at 1.5 N of load a sensor noise of 0.2 N biases stiffness
    /// by up to 31 %.
    pub fn of(setup: &Setup, reading: &Reading) -> Self {
        let link = &setup.robot.links[setup.targets[reading.target].link];
        Self {
            body: link.body,
            body_from_link: link.body_from_link,
            payload: reading.payload.map(|payload| (payload.mass, payload.com)),
            follower: match reading.payload {
                Some(_) => reading.process,
                None => reading.wrench,
            },
        }
    }
}

/// Velocity field of an infinitesimal motion: `v(x) = linear + angular × x`.
#[derive(Debug, Clone, Copy)]
pub struct Screw {
    /// Velocity of the point at the base origin: m per unit of what moves (rad, m, or one).
    pub linear: Vector3<f64>,
    /// Angular velocity, rad per unit of the same.
    pub angular: Vector3<f64>,
}

impl Screw {
    /// Velocity at a point.
    pub fn at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(point)
    }
}

/// Composed posture of all bodies with their loads; a buffer to be used again and again.
#[derive(Debug, Clone)]
pub struct Statics {
    /// By node: rotation matrix of the joint frame.
    rotation: Vec<Matrix3<f64>>,
    /// By node: origin of the joint frame.
    origin: Vec<Vector3<f64>>,
    /// By body: pose, behind the node's displacement.
    pub body: Vec<DualQuaternion<f64>>,
    /// By body: its own mass, kg, and centre, m.
    own: Vec<(f64, Vector3<f64>)>,
    /// By node: mass of it and all it carries, kg.
    mass: Vec<f64>,
    /// By node: Σ m r of the same about the base origin, kg·m.
    moment: Vec<Vector3<f64>>,
    /// By node: `[f; m]` about the joint frame's origin, in the joint frame.
    pub local_wrench: Vec<Vector6<f64>>,
    /// Nodes from the base to the loaded body, base first.
    loaded: Vec<usize>,
    /// The follower wrench and its point.
    follower: Option<(Wrench, Vector3<f64>)>,
    /// Rotation of the loaded link.
    link_rotation: Matrix3<f64>,
    /// Body of the load, payload's mass and centre.
    payload: (usize, f64, Vector3<f64>),
    gravity: Vector3<f64>,
    /// By pair of nodes: does the first carry the second?
    carries: Vec<bool>,
    constants: Vec<DualQuaternion<f64>>,
    /// Encoder angles and deviations of the posture that stands; empty before the first.
    placed: (Vec<f64>, Vec<f64>),
    /// By body: does it move to where it has to stand now?
    moved: Vec<bool>,
}

impl Statics {
    /// Buffers for a robot.
    pub fn new(setup: &Setup) -> Self {
        let nodes = setup.robot.bodies.len();
        let mut carries = vec![false; nodes * nodes];
        for node in 0..nodes {
            let mut above = node;
            loop {
                carries[above * nodes + node] = true;
                if above == 0 {
                    break;
                }
                above = setup.robot.joints[above - 1].parent;
            }
        }
        Self {
            rotation: vec![Matrix3::identity(); nodes],
            origin: vec![Vector3::zeros(); nodes],
            body: vec![DualQuaternion::identity(); nodes],
            own: vec![(0.0, Vector3::zeros()); nodes],
            placed: (Vec::new(), Vec::new()),
            moved: vec![true; nodes],
            mass: vec![0.0; nodes],
            moment: vec![Vector3::zeros(); nodes],
            local_wrench: vec![Vector6::zeros(); nodes],
            loaded: Vec::new(),
            follower: None,
            link_rotation: Matrix3::identity(),
            payload: (0, 0.0, Vector3::zeros()),
            gravity: setup.gravity,
            carries,
            constants: setup
                .robot
                .joints
                .iter()
                .map(|joint| DualQuaternion::from_isometry(&joint.parent_from_joint))
                .collect(),
        }
    }

    /// Places every body: encoder angles plus deviations. What stands where it last stood, as the other arm does while
    /// one bends under its load, is left there.
    pub fn place(&mut self, setup: &Setup, joints: &[f64], deviations: &[f64]) {
        let first = Slots::of(setup).node(0);
        let changed = |before: &[f64], now: &[f64]| before != now;
        let known = self.placed.0.len() == joints.len() && self.placed.1.len() == deviations.len();
        let displaces = |node: usize| {
            let own = first + NODE * node..first + NODE * (node + 1);
            !known || changed(&self.placed.1[own.clone()], &deviations[own])
        };
        self.moved[0] = displaces(0);
        for (j, joint) in setup.robot.joints.iter().enumerate() {
            let turns = !known
                || changed(&self.placed.0[j..=j], &joints[j..=j])
                || changed(&self.placed.1[j..=j], &deviations[j..=j]);
            self.moved[j + 1] = self.moved[joint.parent] || turns || displaces(j + 1);
        }
        if self.moved[0] {
            self.body[0] = displaced(DualQuaternion::identity(), setup, 0, deviations);
        }
        for (j, joint) in setup.robot.joints.iter().enumerate() {
            if !self.moved[j + 1] {
                continue;
            }
            let q = joints[j] + deviations[j];
            let motion = match joint.kind {
                JointKind::Prismatic => DualQuaternion::from_translation(*joint.axis * q),
                _ => DualQuaternion::from_axis_angle(*joint.axis, q),
            };
            let frame = self.body[joint.parent] * self.constants[j] * motion;
            self.rotation[j + 1] = frame.rotation().to_rotation_matrix().into_inner();
            self.origin[j + 1] = frame.translation();
            self.body[j + 1] = displaced(frame, setup, j + 1, deviations);
        }
        self.placed.0.clear();
        self.placed.0.extend_from_slice(joints);
        self.placed.1.clear();
        self.placed.1.extend_from_slice(deviations);
    }

    /// Sums weights and loads from the tips to the base; needs [`Statics::place`] first.
    pub fn load(&mut self, setup: &Setup, load: &Load, deviations: &[f64]) {
        let slots = Slots::of(setup);
        let at = |first: usize| Vector3::from_column_slice(&deviations[first..first + 3]);
        self.gravity = setup.gravity + at(slots.gravity);
        for (node, body) in setup.robot.bodies.iter().enumerate() {
            let mass = body.mass + deviations[slots.mass + node];
            let com = body.com + at(slots.com + 3 * node);
            let com = self.body[node].transform_point(&com);
            self.own[node] = (mass, com);
            self.mass[node] = mass;
            self.moment[node] = com * mass;
        }
        let body = self.body[load.body];
        let link = body * DualQuaternion::from_isometry(&load.body_from_link);
        self.link_rotation = link.rotation().to_rotation_matrix().into_inner();
        self.payload = (load.body, 0.0, link.translation());
        if let Some((mass, com)) = load.payload {
            let mass = mass + deviations[slots.payload_mass];
            let com = link.transform_point(&(com + at(slots.payload_com)));
            self.payload = (load.body, mass, com);
            self.mass[load.body] += mass;
            self.moment[load.body] += com * mass;
        }
        for node in (1..self.mass.len()).rev() {
            let parent = setup.robot.joints[node - 1].parent;
            self.mass[parent] += self.mass[node];
            let moment = self.moment[node];
            self.moment[parent] += moment;
        }
        self.loaded.clear();
        self.follower = load.follower.map(|wrench| {
            let mut node = load.body;
            while node > 0 {
                self.loaded.push(node);
                node = setup.robot.joints[node - 1].parent;
            }
            self.loaded.push(0);
            // the sensor reads truth and error: what is left is the truth
            let turned = Wrench {
                force: self.link_rotation * (wrench.force - at(slots.sensed)),
                torque: self.link_rotation * (wrench.torque - at(slots.sensed + 3)),
            };
            (turned, link.translation())
        });
        for node in 0..self.mass.len() {
            let mut force = self.gravity * self.mass[node];
            let mut torque = self.lever(node).cross(&self.gravity);
            if let Some((wrench, point)) = &self.follower
                && self.loaded.contains(&node)
            {
                force += wrench.force;
                torque += wrench.torque + (point - self.origin[node]).cross(&wrench.force);
            }
            let back = self.rotation[node].transpose();
            let (force, torque) = (back * force, back * torque);
            let mut local = Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
            if node > 0 {
                let joint = &setup.robot.joints[node - 1];
                let by = *joint.axis * deviations[slots.torque + node - 1];
                let mut rows = local.fixed_rows_mut::<3>(joint.load_row());
                rows += by;
            }
            self.local_wrench[node] = local;
        }
    }

    /// Weight of the payload as a wrist sensor at the target link's origin sees it: `[f; m]` on the arm, in the
    /// link's frame, N and N·m.
    pub fn payload_wrench(&self, link_origin: &Vector3<f64>) -> Vector6<f64> {
        let (_, mass, com) = self.payload;
        let back = self.link_rotation.transpose();
        let force = back * self.gravity * mass;
        let torque = back * (com - link_origin).cross(&(self.gravity * mass));
        Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
    }

    /// Change of [`Statics::payload_wrench`] with the link's turn (base frame) and with a load's deviation.
    pub fn payload_wrench_rate(
        &self,
        link_origin: &Vector3<f64>,
        turn: &Vector3<f64>,
        kind: Kind,
    ) -> Vector6<f64> {
        let (_, mass, com) = self.payload;
        let arm = com - link_origin;
        // seen from the turned link, the weight turns back; the arm turns with it
        let weight = self.gravity * mass;
        let mut force = weight.cross(turn);
        let mut torque = arm.cross(&force);
        match kind {
            Kind::Gravity(k) => {
                let by = Vector3::ith(k, mass);
                force += by;
                torque += arm.cross(&by);
            }
            Kind::PayloadMass => {
                force += self.gravity;
                torque += arm.cross(&self.gravity);
            }
            Kind::PayloadCom(k) => {
                torque += self.link_rotation.column(k).cross(&weight);
            }
            _ => {}
        }
        let back = self.link_rotation.transpose();
        let (force, torque) = (back * force, back * torque);
        Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z)
    }

    /// Change of `row · local_wrench[node]` with a unit of a load's deviation; `row` as for
    /// [`Statics::wrench_rates`].
    pub fn load_rate(
        &self,
        setup: &Setup,
        (row_force, row_torque): (&Vector3<f64>, &Vector3<f64>),
        node: usize,
        kind: Kind,
    ) -> f64 {
        let both = |force: &Vector3<f64>, torque: &Vector3<f64>| {
            row_force.dot(force) + row_torque.dot(torque)
        };
        let (payload_body, payload_mass, payload_com) = self.payload;
        match kind {
            Kind::Mass(body) if self.carries(node, body) => {
                let arm = self.own[body].1 - self.origin[node];
                both(&self.gravity, &arm.cross(&self.gravity))
            }
            Kind::Com(body, k) if self.carries(node, body) => {
                let moved = self.body[body].transform_vector(&Vector3::ith(k, self.own[body].0));
                row_torque.dot(&moved.cross(&self.gravity))
            }
            Kind::Gravity(k) => {
                let by = Vector3::ith(k, 1.0);
                both(&(by * self.mass[node]), &self.lever(node).cross(&by))
            }
            Kind::PayloadMass if self.carries(node, payload_body) => {
                let arm = payload_com - self.origin[node];
                both(&self.gravity, &arm.cross(&self.gravity))
            }
            Kind::PayloadCom(k) if self.carries(node, payload_body) => {
                let moved = self.link_rotation.column(k) * payload_mass;
                row_torque.dot(&moved.cross(&self.gravity))
            }
            Kind::Torque(joint) if node == joint + 1 => {
                let axis = self.rotation[node] * *setup.robot.joints[joint].axis;
                match setup.robot.joints[joint].kind {
                    JointKind::Prismatic => row_force.dot(&axis),
                    _ => row_torque.dot(&axis),
                }
            }
            Kind::Sensed(k) => match &self.follower {
                Some((_, point)) if self.loaded.contains(&node) => {
                    let by = -self.link_rotation.column(k % 3);
                    if k < 3 {
                        both(&by, &(point - self.origin[node]).cross(&by))
                    } else {
                        row_torque.dot(&by)
                    }
                }
                _ => 0.0,
            },
            _ => 0.0,
        }
    }

    /// Σ m (r - o) of what a node carries about its joint frame's origin.
    fn lever(&self, node: usize) -> Vector3<f64> {
        self.moment[node] - self.origin[node] * self.mass[node]
    }

    /// Motion of everything behind a joint or node, per unit of its deviation; none for other deviations.
    pub fn screw(&self, setup: &Setup, kind: Kind, deviations: &[f64]) -> Option<Screw> {
        match kind {
            Kind::Joint(joint) => {
                let node = joint + 1;
                let axis = self.rotation[node] * *setup.robot.joints[joint].axis;
                Some(match setup.robot.joints[joint].kind {
                    JointKind::Prismatic => Screw {
                        linear: axis,
                        angular: Vector3::zeros(),
                    },
                    _ => Screw {
                        linear: self.origin[node].cross(&axis),
                        angular: axis,
                    },
                })
            }
            Kind::Node(node, component) if component < 3 => Some(Screw {
                linear: self.rotation[node].column(component).into_owned(),
                angular: Vector3::zeros(),
            }),
            Kind::Node(node, component) => {
                let first = Slots::of(setup).node(node);
                let vector = Vector3::from_column_slice(&deviations[first + 3..first + 6]);
                let angular = self.rotation[node] * left_jacobian(&vector).column(component - 3);
                Some(Screw {
                    linear: self.body[node].translation().cross(&angular),
                    angular,
                })
            }
            _ => None,
        }
    }

    /// Node behind which a joint's or node's deviation sits, and whether it turns that node's joint frame.
    pub fn node_of(kind: Kind) -> (usize, bool) {
        match kind {
            Kind::Joint(joint) => (joint + 1, true),
            Kind::Node(node, _) => (node, false),
            _ => (0, false),
        }
    }

    /// Does `node` carry the body `other` (itself included)?
    pub fn carries(&self, node: usize, other: usize) -> bool {
        self.carries[node * self.mass.len() + other]
    }

    /// A row over local wrenches of a node, turned into the base frame: (over forces, over moments).
    pub fn world_row(&self, node: usize, row: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let force = row.fixed_rows::<3>(0).into_owned();
        let torque = row.fixed_rows::<3>(3).into_owned();
        (self.rotation[node] * force, self.rotation[node] * torque)
    }

    /// How `row · local_wrench[node]` changes with the screw by which a deviation moves what it carries, a product with
    /// each of the screw's vectors (m, rad): the geometric stiffness of the loads, in the row's unit per m and per rad.
    ///
    /// `row` in the base frame, from [`Statics::world_row`]. Triple products turned over: `a · (w × b) = w · (b × a)`.
    pub fn wrench_rates(
        &self,
        (row_force, row_torque): (&Vector3<f64>, &Vector3<f64>),
        node: usize,
        (moved, turns_joint_frame): (usize, bool),
    ) -> Screw {
        let frame_moves = self.carries(moved, node) && (moved != node || turns_joint_frame);
        if frame_moves {
            // the node and all it carries turn together; only the weights keep their direction
            let along = row_force * self.mass[node] + row_torque.cross(&self.lever(node));
            return Screw {
                linear: Vector3::zeros(),
                angular: along.cross(&self.gravity),
            };
        }
        if !self.carries(node, moved) {
            return Screw {
                linear: Vector3::zeros(),
                angular: Vector3::zeros(),
            };
        }
        // weights keep their direction, and are swept along
        let along = self.gravity.cross(row_torque);
        let mut rates = Screw {
            linear: along * self.mass[moved],
            angular: self.moment[moved].cross(&along),
        };
        if let Some((wrench, point)) = &self.follower
            && self.loaded.contains(&moved)
        {
            // a load that turns with what it is on
            let pulled = wrench.force.cross(row_torque);
            let arm = row_force + row_torque.cross(&(point - self.origin[node]));
            rates.linear += pulled;
            rates.angular +=
                point.cross(&pulled) + wrench.force.cross(&arm) + wrench.torque.cross(row_torque);
        }
        rates
    }
}

/// The frame behind a node's displacement.
fn displaced(
    frame: DualQuaternion<f64>,
    setup: &Setup,
    node: usize,
    deviations: &[f64],
) -> DualQuaternion<f64> {
    let first = Slots::of(setup).node(node);
    let d = &deviations[first..first + NODE];
    if d.iter().all(|&x| x == 0.0) {
        return frame;
    }
    let rotation = crate::dual_quaternion::rotation_exp(&Vector3::new(d[3], d[4], d[5]));
    frame * DualQuaternion::from_parts(Vector3::new(d[0], d[1], d[2]), rotation)
}

/// Left Jacobian of SO(3): `d exp(φ) = [J dφ]× exp(φ)`.
///
/// Source: Barfoot 2017, *State Estimation for Robotics*, eq. 7.77.
pub fn left_jacobian(vector: &Vector3<f64>) -> Matrix3<f64> {
    let cross = vector.cross_matrix();
    let angle2 = vector.norm_squared();
    let (a, b) = if angle2 < 1e-8 {
        (0.5 - angle2 / 24.0, 1.0 / 6.0 - angle2 / 120.0)
    } else {
        let angle = angle2.sqrt();
        (
            (1.0 - angle.cos()) / angle2,
            (angle - angle.sin()) / (angle2 * angle),
        )
    };
    Matrix3::identity() + cross * a + cross * cross * b
}
