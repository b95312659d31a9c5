//! The instruments: what tracker and wrist sensor make of a state of the robot.
//!
//! Frames by nalgebra's isometries; the model has its own algebra.

use super::{Command, PlantSpec, State};
use misfit_campaign::{Noise, Wrench};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// Standard normal numbers for one reading, drawn before anything is computed so that readings may be
/// computed in any order.
#[derive(Debug, Clone, PartialEq)]
pub struct Draws {
    /// One a joint, to be multiplied by its noise in rad (m).
    pub joints: Vec<f64>,
    /// Of the tracker's position, to be multiplied by its noise.
    pub position: Vector3<f64>,
    /// Of the probe's orientation, to be multiplied by its noise.
    pub orientation: Vector3<f64>,
    force: Vector3<f64>,
    torque: Vector3<f64>,
}

impl Draws {
    /// Draws for a robot of so many joints.
    pub fn new(joints: usize, random: &mut impl Rng) -> Self {
        let mut normal = || -> f64 { random.sample(StandardNormal) };
        let joints = (0..joints).map(|_| normal()).collect();
        let mut vector = || Vector3::from_fn(|_, _| normal());
        Self {
            joints,
            position: vector(),
            orientation: vector(),
            force: vector(),
            torque: vector(),
        }
    }
}

/// What the instruments say of one target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seen {
    /// Target position in the tracker's frame, m.
    pub position: Vector3<f64>,
    /// tracker_from_target rotation.
    pub orientation: UnitQuaternion<f64>,
    /// Wrench of the load on the arm, in the target link's frame at its origin.
    pub wrench: Wrench,
}

/// Reads the instruments: an anisotropic tracker (across the beam, along it, growing with distance), an
/// orientation probe and a wrist sensor.
///
/// Sources: Leica AT500 manual p. 39 and ISO 10360-10:2021 (form of the position errors).
pub fn read(
    spec: &PlantSpec,
    command: &Command,
    state: &State,
    target: usize,
    noise: &Noise,
    draws: &Draws,
) -> Seen {
    let (_, link_from_target) = &spec.targets[target];
    let mut base_from_tracker = spec.base_from_tracker;
    for law in &spec.tracker_laws {
        law(command, &mut base_from_tracker);
    }
    let seen: Isometry3<f64> =
        base_from_tracker.inverse() * state.base_from_link[target] * link_from_target;
    let position = seen.translation.vector * (1.0 + spec.tracker_scale);
    let distance = position.norm();
    let across = noise.position + noise.position_per_metre * distance;
    let along = noise.radial + noise.radial_per_metre * distance;
    let beam = position.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let error = draws.position * across + beam * (beam.dot(&draws.position) * (along - across));
    let turn = UnitQuaternion::from_scaled_axis(draws.orientation * noise.orientation);
    let mut wrench = state.wrenches[target];
    for law in &spec.sensor_laws {
        law(&mut wrench);
    }
    Seen {
        position: position + error,
        orientation: turn * seen.rotation,
        wrench: Wrench {
            force: wrench.force + draws.force * noise.force,
            torque: wrench.torque + draws.torque * noise.torque,
        },
    }
}
