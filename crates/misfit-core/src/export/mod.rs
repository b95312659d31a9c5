//! What was identified, in forms that others read: what of it is the same in every posture makes a rigid robot.
//!
//! An effect is part of the rigid robot if it pushes the same way whatever the reading: offsets of joints, motions behind
//! them, masses, the frames of tracker and targets; a law of the user's own too, if it is a constant. What bends, slips or
//! winds is left out, and said with its size. Errors of the measurement alone are no part of a robot.

pub mod dh;
pub mod urdf;

use crate::campaign::{Campaign, Payload, Reading, Wrench};
use crate::compensation;
use crate::dual_quaternion::DualQuaternion;
use crate::effects::Stage;
use crate::fit::Fit;
use crate::model::{Model, Term, Workspace};
use crate::posture::{Kind, NODE, Posture, Slots};
use crate::robot::{Robot, RobotError};
use crate::setup::Setup;
use crate::space::{Space, generator};
use nalgebra::{Isometry3, Vector3, Vector6};
use rand::RngExt;
use std::f64::consts::PI;

/// Postures at which a file is compared with the robot that it was made from.
pub const POSTURES: usize = 100;
/// How far it may be off, m and rad: rounding of long chains is 1e-13.
pub const TOLERANCE: f64 = 1e-9;

/// Why there is no file.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The robot's own text lacks what was read from it.
    #[error("{file}: {what} is not where it should be; give the campaign the robot file again")]
    Lost {
        /// Robot file.
        file: String,
        /// What was looked for.
        what: String,
    },
    /// The file that was made is not accepted.
    #[error("{source}; {advice}")]
    Unfit {
        /// Reason.
        source: RobotError,
        /// What would be.
        advice: &'static str,
    },
    /// The file that was made is another robot.
    #[error(
        "{file}: read back it is off by {position:e} m, {angle:e} rad, more than {TOLERANCE:e}; {advice}"
    )]
    Off {
        /// The file.
        file: String,
        /// m.
        position: f64,
        /// rad.
        angle: f64,
        /// What would be exact.
        advice: &'static str,
    },
    /// Axes whose common normal is out of sight.
    #[error(
        "joint {joint}: its axis is so nearly parallel to the one before or after that four numbers a row would need an \
         offset of {offset:.0} m; leave --four-numbers out (the row then has a fifth, beta), or write a .urdf file"
    )]
    Parallel {
        /// The row.
        joint: String,
        /// Its offset, m.
        offset: f64,
    },
    /// A table needs a joint.
    #[error(
        "target {target}: no joint moves it, so there is no DH table; write a .urdf or a .json file"
    )]
    Still {
        /// The target.
        target: String,
    },
}

/// The rigid robot that a fitted model contains.
#[derive(Debug, Clone)]
pub struct Calibrated {
    /// The nominal robot and its targets.
    pub setup: Setup,
    /// Effects that are in it.
    pub held: Vec<String>,
    /// Effects that are not, with what they do.
    pub left_out: Vec<LeftOut>,
    /// Effects that are no robot's but the measurement's.
    pub of_measurement: Vec<String>,
    /// By joint: what its angle is more than its encoder says, rad (m).
    pub offsets: Vec<f64>,
    /// By body: motion of all it carries, in the frame that its joint moves; that of the base is none.
    pub motions: Vec<Isometry3<f64>>,
    /// By body: what it weighs more, kg.
    pub masses: Vec<f64>,
    /// Where the tracker stands, if the model has it.
    pub base_from_tracker: Option<Isometry3<f64>>,
    /// By target: its place on its link, if the model has it.
    pub link_from_target: Vec<Option<Isometry3<f64>>>,
    /// The model's parameters with those left out at zero, SI.
    pub values: Vec<f64>,
}

/// An effect that no rigid robot has.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The effect.
    pub effect: String,
    /// How far it moves the campaign's targets, root mean square, m.
    pub rms: f64,
    /// The same, at most, m.
    pub most: f64,
}

/// What one effect does to a reading.
#[derive(Clone, PartialEq)]
struct Push {
    deviations: Vec<f64>,
    base_from_tracker: DualQuaternion<f64>,
    link_from_target: DualQuaternion<f64>,
}

impl Calibrated {
    /// From a model and all its parameters, SI; `readings` say how large is what is left out.
    pub fn new(model: &Model, values: &[f64], readings: &[Reading]) -> Self {
        let setup = &model.setup;
        let slots = Slots::of(setup);
        let own = compensation::Robot::new(model, values).values;
        let mut rigid = own.clone();
        let of_measurement = model.terms.iter().filter(|term| {
            term.effect.is_of_measurement() && term.of(values).iter().any(|x| *x != 0.0)
        });
        let of_measurement = of_measurement.map(|t| t.effect.id().to_owned()).collect();
        let mut total = vec![0.0; slots.count];
        let mut base_from_tracker = None;
        let mut link_from_target = vec![None; setup.targets.len()];
        let (mut held, mut left_out) = (Vec::new(), Vec::new());
        for term in &model.terms {
            let range = term.first..term.first + term.parameters.len();
            if own[range.clone()].iter().all(|&x| x == 0.0) {
                continue;
            }
            let id = term.effect.id().to_owned();
            let Some(pushes) = constant(setup, term, term.of(&own)) else {
                rigid[range.clone()].fill(0.0);
                left_out.push(size(model, &own, range, id, readings));
                continue;
            };
            held.push(id);
            for (target, push) in pushes.iter().enumerate() {
                if target == 0 {
                    let deviations = push.deviations.iter();
                    total
                        .iter_mut()
                        .zip(deviations)
                        .for_each(|(sum, x)| *sum += x);
                    chain(&mut base_from_tracker, &push.base_from_tracker, true);
                }
                chain(&mut link_from_target[target], &push.link_from_target, false);
            }
        }
        let motion = |body: usize| {
            let d = &total[slots.node(body)..slots.node(body) + NODE];
            Isometry3::new(
                Vector3::new(d[0], d[1], d[2]),
                Vector3::new(d[3], d[4], d[5]),
            )
        };
        let bodies = setup.robot.bodies.len();
        Self {
            setup: setup.clone(),
            held,
            left_out,
            of_measurement,
            offsets: total[..slots.joints].to_vec(),
            motions: (0..bodies).map(motion).collect(),
            masses: total[slots.mass..slots.mass + bodies].to_vec(),
            base_from_tracker,
            link_from_target,
            values: rigid,
        }
    }

    /// From a fit.
    pub fn of(fit: &Fit, campaign: &Campaign) -> Self {
        Self::new(&fit.model, &fit.values, &campaign.readings)
    }

    /// The robot as it is: every link stands where the model has it, without load, whatever the encoders say.
    pub fn robot(&self) -> Robot {
        let mut robot = self.setup.robot.clone();
        for (index, joint) in robot.joints.iter_mut().enumerate() {
            let offset = joint.motion(self.offsets[index]);
            joint.parent_from_joint = self.motions[joint.parent] * joint.parent_from_joint * offset;
        }
        for link in &mut robot.links {
            link.body_from_link = self.motions[link.body] * link.body_from_link;
        }
        for (index, body) in robot.bodies.iter_mut().enumerate() {
            body.mass += self.masses[index];
            body.com = (self.motions[index] * nalgebra::Point3::from(body.com)).coords;
        }
        robot
    }
}

/// Goes on from a frame by another: from outside for the tracker, from inside for a target.
fn chain(frame: &mut Option<Isometry3<f64>>, by: &DualQuaternion<f64>, outside: bool) {
    let by = by.to_isometry();
    if by != Isometry3::identity() {
        let before = frame.unwrap_or_else(Isometry3::identity);
        *frame = Some(if outside { by * before } else { before * by });
    }
}

/// What an effect does for each target, if that is the same in every reading and a rigid robot has it.
fn constant(setup: &Setup, term: &Term, p: &[f64]) -> Option<Vec<Push>> {
    /// Readings that have nothing in common but the target, beside the uniform ones.
    const PROBES: usize = 60;
    if term.effect.stage() == Stage::Elastic {
        return None;
    }
    let slots = Slots::of(setup);
    let mut random = generator(1, 0);
    let mut first: Vec<Push> = Vec::new();
    for target in 0..setup.targets.len() {
        for probe in 0..PROBES {
            let push = push(setup, term, p, &reading(setup, target, probe, &mut random));
            match first.get(target) {
                None => first.push(push),
                Some(seen) if *seen == push => {}
                Some(_) => return None,
            }
        }
    }
    let all = first.first()?;
    let same = first.iter().all(|push| {
        push.deviations == all.deviations && push.base_from_tracker == all.base_from_tracker
    });
    let fits = all.deviations.iter().enumerate().all(|(slot, x)| {
        *x == 0.0
            || match slots.kind(slot) {
                Kind::Joint(_) | Kind::Mass(_) => true,
                Kind::Node(node, _) => node > 0,
                _ => false,
            }
    });
    (same && fits).then_some(first)
}

fn push(setup: &Setup, term: &Term, p: &[f64], reading: &Reading) -> Push {
    let nodes = setup.robot.bodies.len();
    let mut deviations = vec![0.0; Slots::of(setup).count];
    let still = vec![Vector6::zeros(); nodes];
    let sensed = Vector6::zeros();
    let mut posture = Posture::new(setup, reading, &still, sensed, &mut deviations);
    term.effect.perturb(p, &mut posture);
    Push {
        base_from_tracker: posture.base_from_tracker,
        link_from_target: posture.link_from_target,
        deviations,
    }
}

/// A reading in which everything that an effect may look at is arbitrary; by turns with joints at either limit, all
/// approached from one side, from none, and with light loads, heavy ones or none, so that no step of a law is missed.
fn reading(setup: &Setup, target: usize, probe: usize, random: &mut impl rand::Rng) -> Reading {
    let joints = setup.robot.joints.len();
    let mut number = |size: f64| size * (2.0 * random.random::<f64>() - 1.0);
    let mut vector = |size: f64| Vector3::from_fn(|_, _| number(size));
    let mass = vector([0.05, 5.0, 50.0][probe % 3]).norm();
    let angle = |joint: usize, share: f64| {
        let (least, most) = setup.robot.joints[joint].limits.unwrap_or((-PI, PI));
        match probe % 5 {
            0 => least,
            1 => most,
            _ => least + (most - least) * share,
        }
    };
    Reading {
        wrench: Some(Wrench {
            force: vector(50.0),
            torque: vector(5.0),
        }),
        payload: (!probe.is_multiple_of(7)).then_some(Payload {
            mass,
            com: vector(0.1),
        }),
        position: vector(1.0),
        time: Some(setup.time_zero + number(1e3)),
        temperature: Some(setup.temperature_zero + number(10.0)),
        approach: (probe % 4 != 3).then(|| {
            let side = |x: f64| match probe % 4 {
                0 => 1.0,
                1 => -1.0,
                _ => x.signum(),
            };
            (0..joints).map(|_| side(number(1.0))).collect()
        }),
        ..Reading::to_be(
            target,
            (0..joints)
                .map(|joint| angle(joint, (1.0 + number(1.0)) / 2.0))
                .collect(),
        )
    }
}

/// How far an effect moves the targets of these readings.
fn size(
    model: &Model,
    own: &[f64],
    range: std::ops::Range<usize>,
    effect: String,
    readings: &[Reading],
) -> LeftOut {
    let mut workspace = Workspace::new(&model.setup);
    let mut without = own.to_vec();
    without[range].fill(0.0);
    let mut moved = Vec::new();
    for reading in readings {
        let with = workspace.predict(model, own, reading);
        let less = workspace.predict(model, &without, reading);
        if with.settled && less.settled {
            moved.push((with.position - less.position).norm());
        }
    }
    LeftOut {
        effect,
        rms: root_mean_square(&moved),
        most: moved.iter().copied().fold(0.0, f64::max),
    }
}

/// Root mean square error of predicted positions, m; readings at which the arm collapses are not counted.
pub fn position_error(model: &Model, values: &[f64], readings: &[Reading]) -> f64 {
    let mut workspace = Workspace::new(&model.setup);
    let mut errors = Vec::new();
    for reading in readings {
        let predicted = workspace.predict(model, values, reading);
        if predicted.settled {
            errors.push((predicted.position - reading.position).norm());
        }
    }
    root_mean_square(&errors)
}

fn root_mean_square(values: &[f64]) -> f64 {
    let sum: f64 = values.iter().map(|x| x * x).sum();
    (sum / values.len().max(1) as f64).sqrt()
}

/// How far links of a file read back are from those of the robot that it was made from, m and rad, over
/// [`POSTURES`] postures; `links` names them in both.
///
/// # Errors
/// If it is more than [`TOLERANCE`].
pub fn compare(
    file: &str,
    read: &Robot,
    made: &Robot,
    links: &[(usize, usize)],
    advice: &'static str,
) -> Result<(f64, f64), ExportError> {
    let ranges = Space::within_limits(made, 0.0).ranges;
    let mut random = generator(1, 1);
    let (mut position, mut angle) = (0.0_f64, 0.0_f64);
    for _ in 0..POSTURES {
        let joints: Vec<f64> = ranges
            .iter()
            .map(|&(lower, upper)| lower + (upper - lower) * random.random::<f64>())
            .collect();
        let own = read.joints.iter().map(|joint| {
            let found = made.joint(&joint.name);
            found.map_or(f64::NAN, |index| joints[index])
        });
        let there = read.body_poses(&own.collect::<Vec<f64>>());
        let here = made.body_poses(&joints);
        for &(a, b) in links {
            let pose = |robot: &Robot, poses: &[Isometry3<f64>], link: usize| {
                let link = &robot.links[link];
                poses[link.body] * link.body_from_link
            };
            let (a, b) = (pose(read, &there, a), pose(made, &here, b));
            let gap = (a.translation.vector - b.translation.vector).norm();
            // the sine of half the angle: exact where it is small, not a number where one of them is none
            let turn = 2.0 * (a.rotation.inverse() * b.rotation).imag().norm();
            position = if gap <= position { position } else { gap };
            angle = if turn <= angle { angle } else { turn };
        }
    }
    if position <= TOLERANCE && angle <= TOLERANCE {
        return Ok((position, angle));
    }
    Err(ExportError::Off {
        file: file.to_owned(),
        position,
        angle,
        advice,
    })
}
