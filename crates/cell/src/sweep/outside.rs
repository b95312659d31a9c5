//! What no catalogue holds: laws for the plant alone, to see whether a diagnosis says that it does not know.

use crate::plant::PlantSpec;
use crate::robot::Robot;
use crate::setup::Setup;
use nalgebra::{Point3, Vector3};
use rand::{Rng, RngExt};
use std::sync::Arc;

/// A law that the catalogue lacks, its places and phases drawn.
#[derive(Debug, Clone)]
pub enum Outside {
    /// A hose from the base to a body: its tension (20 N, growing by 100 N a metre) pulls at the joints between.
    CablePull {
        /// Where it is fixed, base frame, m.
        anchor: Point3<f64>,
        /// The body it pulls at, its frame's origin.
        body: usize,
    },
    /// A damaged tooth: one joint is off near one angle, Gaussian, `width` rad; 0.1 mrad high.
    LocalBump {
        /// The joint.
        joint: usize,
        /// Where, rad.
        at: f64,
        /// One standard deviation, rad.
        width: f64,
    },
    /// 0.1 mrad at one joint, periodic in the angles of two: `sin(m q_a + n q_b)`.
    TwoJointWave {
        /// The joint that is off.
        joint: usize,
        /// The two joints, with their cycles.
        of: [(usize, f64); 2],
    },
    /// The torque of one joint turns another one, 1e-5 rad/(N·m).
    CrossCompliance {
        /// The joint whose torque it is.
        torque: usize,
        /// The joint that gives.
        joint: usize,
    },
    /// An encoder coupling slips: one joint drifts away over time, 0.1 mrad an hour.
    JointSlip {
        /// The joint.
        joint: usize,
    },
}

/// Names of all, in the order of drawing.
pub const NAMES: [&str; 5] = [
    "cable_pull",
    "local_bump",
    "two_joint_wave",
    "cross_compliance",
    "joint_slip",
];

impl Outside {
    /// Draws the law of this number in [`NAMES`]; `postures` are those that will be measured.
    pub fn draw(
        number: usize,
        setup: &Setup,
        postures: &[Vec<f64>],
        random: &mut impl Rng,
    ) -> Self {
        let joints = &setup.observed;
        let pick = |random: &mut _, from: usize| -> usize {
            let random: &mut dyn Rng = random;
            joints[random.random_range(from.min(joints.len() - 1)..joints.len())]
        };
        match number % NAMES.len() {
            0 => Self::CablePull {
                anchor: Point3::new(
                    random.random_range(-0.4..0.4),
                    random.random_range(-0.4..0.4),
                    random.random_range(0.8..1.4),
                ),
                // between the middle of the chain and the wrist
                body: joints[joints.len() / 2] + 1,
            },
            1 => {
                let joint = pick(random, 1);
                let posture = random.random_range(0..postures.len().max(1));
                Self::LocalBump {
                    joint,
                    at: postures.get(posture).map_or(0.0, |q| q[joint]),
                    width: random.random_range(0.1..0.25),
                }
            }
            2 => {
                let first = pick(random, 0);
                let mut second = pick(random, 0);
                while second == first && joints.len() > 1 {
                    second = pick(random, 0);
                }
                let mut cycles = || f64::from(random.random_range(1..4u8));
                let of = [(first, cycles()), (second, cycles())];
                Self::TwoJointWave {
                    joint: pick(random, 1),
                    of,
                }
            }
            3 => {
                let torque = pick(random, 1);
                let mut joint = pick(random, 1);
                while joint == torque && joints.len() > 2 {
                    joint = pick(random, 1);
                }
                Self::CrossCompliance { torque, joint }
            }
            // the first joint's drift would be the tracker's, exactly
            _ => Self::JointSlip {
                joint: pick(random, 2),
            },
        }
    }

    /// Its name.
    pub fn name(&self) -> &'static str {
        let number = match self {
            Self::CablePull { .. } => 0,
            Self::LocalBump { .. } => 1,
            Self::TwoJointWave { .. } => 2,
            Self::CrossCompliance { .. } => 3,
            Self::JointSlip { .. } => 4,
        };
        NAMES[number]
    }

    /// The contrast in which it shows.
    pub fn contrast(&self) -> &'static str {
        match self {
            Self::CablePull { .. } | Self::LocalBump { .. } | Self::TwoJointWave { .. } => "pose",
            Self::CrossCompliance { .. } => "load",
            Self::JointSlip { .. } => "time",
        }
    }

    /// Hangs it into the plant, so many times its size.
    pub fn install(&self, size: f64, robot: &Robot, plant: &mut PlantSpec) {
        match *self {
            Self::CablePull { anchor, body } => {
                let robot = robot.clone();
                let chain = robot.chain(body);
                plant.torque_laws.push(Arc::new(move |_, angles, torques| {
                    let poses = robot.body_poses(angles);
                    let end = Point3::from(poses[body].translation.vector);
                    let hose = anchor - end;
                    let length = hose.norm();
                    let Some(along) = hose.try_normalize(1e-9) else {
                        return;
                    };
                    let force = along * (size * (20.0 + 100.0 * length));
                    for &joint in &chain {
                        let pose = poses[joint + 1];
                        let axis = pose.rotation * *robot.joints[joint].axis;
                        let lever: Vector3<f64> = end - Point3::from(pose.translation.vector);
                        torques[joint] += axis.dot(&lever.cross(&force));
                    }
                }));
            }
            Self::LocalBump { joint, at, width } => {
                plant.command_laws.push(Arc::new(move |command, angles| {
                    let off = (command.joints[joint] - at) / width;
                    angles[joint] += 1e-4 * size * (-0.5 * off * off).exp();
                }));
            }
            Self::TwoJointWave { joint, of } => {
                plant.command_laws.push(Arc::new(move |command, angles| {
                    let phase: f64 = of.iter().map(|&(k, n)| n * command.joints[k]).sum();
                    angles[joint] += 1e-4 * size * phase.sin();
                }));
            }
            Self::CrossCompliance { torque, joint } => {
                plant.windup_laws.push(Arc::new(move |_, torques, angles| {
                    angles[joint] += 1e-5 * size * torques[torque];
                }));
            }
            Self::JointSlip { joint } => {
                plant.command_laws.push(Arc::new(move |command, angles| {
                    angles[joint] += 1e-4 * size * command.time / 3600.0;
                }));
            }
        }
    }
}
