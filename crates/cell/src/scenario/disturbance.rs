//! What goes wrong while a campaign is measured: noise that is not white, poses that are bad, a robot that does not
//! repeat as its encoders say, columns that state something else than what was there.
//!
//! All of it acts on draws, on what the instruments say, and on the columns of the table: the plant's physics knows
//! nothing of it. Each kind has its own stream of random numbers, so that none changes another.

use super::design::{Visit, stream};
use crate::campaign::{Noise, Reading};
use crate::plant::PlantSpec;
use crate::plant::instruments::Draws;
use crate::space::generator;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt};
use rand_distr::{ChiSquared, Distribution, StandardNormal};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// `[disturbance]` of a scenario. What is not named does not happen.
#[derive(Debug, Clone, PartialEq, Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
pub struct Disturbance {
    /// Correlation of the tracker's noise from one reading to the next, of the same σ: AR(1).
    tracker_correlation: f64,
    /// Root mean square of a random walk of the tracker over the campaign, beside its noise, m.
    tracker_walk_m: f64,
    /// Student's t of so many degrees of freedom instead of normal noise of the tracker, of the same σ; above 2.
    tails_dof: Option<f64>,
    /// Root mean square of a smooth error over the joint space, m: the same for every reading of a pose.
    smooth_m: f64,
    /// Over which change of the sines and cosines of the joints it changes.
    smooth_length: Option<f64>,
    /// The joints are where they are for all repeats of one pose, load and direction: nothing is moved between them.
    static_repeats: bool,
    /// Whole poses, all readings of each shifted alike.
    bad_poses: Option<Blunder>,
    /// Single readings, each shifted by itself.
    bad_readings: Option<Blunder>,
    /// Encoders count in steps of this, rad (m for a slide).
    encoder_step_rad: f64,
    /// The payload columns say this many times the mass.
    payload_stated: Option<f64>,
    /// There are no payload columns.
    payload_unstated: bool,
    /// The campaign file states so many times the noise.
    noise_stated: Option<f64>,
    /// Something slips once.
    step: Option<Step>,
}

/// Readings that are off.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blunder {
    /// Share of all.
    share: f64,
    /// Standard deviation of each coordinate, m.
    coordinate_m: f64,
}

/// A step, from one reading on.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// What moves.
    what: Moved,
    /// Share of the readings before it.
    at: f64,
    /// How far, in standard sizes: base 40 µm and 50 µrad a coordinate, tracker 30 µm and 100 µrad, tool 100 µm and
    /// 100 µrad, one joint's zero 100 µrad.
    size: f64,
}

/// What a step moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Moved {
    /// The robot on its floor.
    Base,
    /// The tracker on its stand.
    Tracker,
    /// The target on its link.
    Tool,
    /// The zero of one joint.
    Zero,
}

/// The disturbances of every reading of one campaign.
pub(super) struct Disturbed {
    /// By reading: what is added to the position that the tracker says, m.
    shifts: Vec<Vector3<f64>>,
    /// The plant after the step, and the first reading that it is of.
    after: Option<(usize, PlantSpec)>,
    /// The joint whose zero jumps then, and by how much, rad (m).
    zero: Option<(usize, f64)>,
}

/// Purposes of random numbers within the stream of disturbances.
mod purpose {
    pub const WALK: u64 = 1;
    pub const TAILS: u64 = 2;
    pub const SMOOTH: u64 = 3;
    pub const POSES: u64 = 4;
    pub const READINGS: u64 = 5;
    pub const STEP: u64 = 6;
}

impl Disturbance {
    /// Refuses what cannot be.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is accepted.
    pub fn check(&self) -> Result<(), String> {
        let share = |x: f64| (0.0..=1.0).contains(&x);
        let size = |x: f64| x.is_finite() && x >= 0.0;
        let blunder =
            |of: Option<Blunder>| of.is_none_or(|b| share(b.share) && size(b.coordinate_m));
        let table = [
            (
                "tracker_correlation",
                (0.0..1.0).contains(&self.tracker_correlation),
                "0 or more, below 1",
            ),
            ("tracker_walk_m", size(self.tracker_walk_m), "zero or more"),
            (
                "tails_dof",
                self.tails_dof
                    .is_none_or(|dof| dof > 2.0 && dof.is_finite()),
                "above 2, where a σ exists",
            ),
            ("smooth_m", size(self.smooth_m), "zero or more"),
            (
                "smooth_length",
                self.smooth_length.is_none_or(|l| l > 0.0 && l.is_finite()),
                "above zero",
            ),
            (
                "bad_poses",
                blunder(self.bad_poses),
                "a share of 0 to 1, a coordinate of zero or more",
            ),
            (
                "bad_readings",
                blunder(self.bad_readings),
                "a share of 0 to 1, a coordinate of zero or more",
            ),
            (
                "encoder_step_rad",
                size(self.encoder_step_rad),
                "zero or more",
            ),
            (
                "payload_stated",
                self.payload_stated.is_none_or(size),
                "zero or more",
            ),
            (
                "noise_stated",
                self.noise_stated.is_none_or(|f| f > 0.0 && f.is_finite()),
                "above zero",
            ),
            (
                "step",
                self.step.is_none_or(|s| share(s.at) && s.size.is_finite()),
                "a share of 0 to 1, a finite size",
            ),
        ];
        match table.iter().find(|(_, good, _)| !good) {
            Some((key, _, accepted)) => Err(format!("disturbance.{key}; accepted: {accepted}")),
            None => Ok(()),
        }
    }

    /// The noise that the campaign file states.
    pub(super) fn stated(&self, noise: &Noise) -> Noise {
        noise.times(self.noise_stated.unwrap_or(1.0))
    }

    /// Changes the draws, and draws what is added to the readings.
    pub(super) fn prepare(
        &self,
        seed: u64,
        spec: &PlantSpec,
        visits: &[Visit],
        draws: &mut [Draws],
    ) -> Disturbed {
        let random =
            |purpose: u64| generator(seed.wrapping_add(purpose << 40), stream::DISTURBANCE);
        if let Some(dof) = self.tails_dof {
            fatten(draws, dof, &mut random(purpose::TAILS));
        }
        if self.tracker_correlation > 0.0 {
            correlate(draws, self.tracker_correlation);
        }
        if self.static_repeats {
            hold_still(visits, draws);
        }
        let mut shifts = walk(
            visits.len(),
            self.tracker_walk_m,
            &mut random(purpose::WALK),
        );
        let mut add = |all: Vec<Vector3<f64>>| {
            shifts
                .iter_mut()
                .zip(all)
                .for_each(|(sum, own)| *sum += own);
        };
        if self.smooth_m > 0.0 {
            let length = self.smooth_length.unwrap_or(1.0);
            add(smooth(
                visits,
                self.smooth_m,
                length,
                &mut random(purpose::SMOOTH),
            ));
        }
        if let Some(bad) = self.bad_poses {
            let poses: Vec<usize> = visits.iter().map(|visit| visit.pose).collect();
            add(blunders(&poses, bad, &mut random(purpose::POSES)));
        }
        if let Some(bad) = self.bad_readings {
            let each: Vec<usize> = (0..visits.len()).collect();
            add(blunders(&each, bad, &mut random(purpose::READINGS)));
        }
        let mut disturbed = Disturbed {
            shifts,
            after: None,
            zero: None,
        };
        if let Some(step) = self.step {
            disturbed.add_step(step, spec, &mut random(purpose::STEP));
        }
        disturbed
    }

    /// What the table says instead of what was there.
    pub(super) fn state(&self, reading: &mut Reading) {
        if self.encoder_step_rad > 0.0 {
            let step = self.encoder_step_rad;
            reading
                .joints
                .iter_mut()
                .for_each(|q| *q = (*q / step).round() * step);
        }
        if let (Some(factor), Some(payload)) = (self.payload_stated, &mut reading.payload) {
            payload.mass *= factor;
        }
        if self.payload_unstated {
            reading.payload = None;
        }
    }
}

impl Disturbed {
    /// The plant at a reading, and the joint whose zero has jumped then.
    pub(super) fn at<'a>(
        &'a self,
        reading: usize,
        before: &'a PlantSpec,
    ) -> (&'a PlantSpec, Option<(usize, f64)>) {
        match &self.after {
            Some((first, after)) if reading >= *first => (after, self.zero),
            _ => (before, None),
        }
    }

    /// What is added to the position of a reading, m.
    pub(super) fn shift(&self, reading: usize) -> Vector3<f64> {
        self.shifts[reading]
    }

    fn add_step(&mut self, step: Step, spec: &PlantSpec, random: &mut impl Rng) {
        let mut normal = || -> f64 { random.sample(StandardNormal) };
        let mut motion = |metres: f64, radians: f64| {
            let mut vector = |size: f64| Vector3::from_fn(|_, _| step.size * size * normal());
            let (shift, turn) = (vector(metres), vector(radians));
            Isometry3::from_parts(
                Translation3::from(shift),
                UnitQuaternion::from_scaled_axis(turn),
            )
        };
        let mut after = spec.clone();
        match step.what {
            // the robot's base moves one way: seen from it the tracker moves the other way
            Moved::Base => {
                after.base_from_tracker = motion(40e-6, 50e-6).inverse() * spec.base_from_tracker
            }
            Moved::Tracker => {
                after.base_from_tracker = spec.base_from_tracker * motion(30e-6, 100e-6)
            }
            Moved::Tool => {
                for (_, link_from_target) in &mut after.targets {
                    *link_from_target *= motion(100e-6, 100e-6);
                }
            }
            Moved::Zero => {
                let joint = random.random_range(0..spec.robot.joints.len().max(1));
                self.zero = Some((joint, 100e-6 * step.size));
            }
        }
        let first = (step.at * self.shifts.len() as f64).round() as usize;
        self.after = Some((first, after));
    }
}

/// Divides the tracker's draws of each reading by the root of a χ² over its degrees of freedom: Student's t, with σ 1.
fn fatten(draws: &mut [Draws], dof: f64, random: &mut impl Rng) {
    // `check` has seen that dof is above 2
    let Ok(chi_squared) = ChiSquared::new(dof) else {
        return;
    };
    for draw in draws {
        let mut tail = || ((dof - 2.0) / chi_squared.sample(random)).sqrt();
        draw.position.apply(|x| *x *= tail());
        draw.orientation.apply(|x| *x *= tail());
    }
}

/// AR(1) over the order of the readings, stationary: σ stays 1.
fn correlate(draws: &mut [Draws], rho: f64) {
    let fresh = (1.0 - rho * rho).sqrt();
    for next in 1..draws.len() {
        let (position, orientation) = (draws[next - 1].position, draws[next - 1].orientation);
        let own = &mut draws[next];
        own.position = position * rho + own.position * fresh;
        own.orientation = orientation * rho + own.orientation * fresh;
    }
}

/// Gives all repeats of one pose, load and direction the joint draws of the first.
fn hold_still(visits: &[Visit], draws: &mut [Draws]) {
    let mut first: BTreeMap<(usize, usize, usize, bool), Vec<f64>> = BTreeMap::new();
    for (visit, draw) in visits.iter().zip(draws) {
        let key = (visit.target, visit.pose, visit.load, visit.direction > 0.0);
        let joints = first.entry(key).or_insert_with(|| draw.joints.clone());
        draw.joints.clone_from(joints);
    }
}

/// A random walk of so many readings about its mean, with this root mean square of each coordinate.
fn walk(count: usize, rms: f64, random: &mut impl Rng) -> Vec<Vector3<f64>> {
    let mut at = Vector3::zeros();
    let mut all: Vec<Vector3<f64>> = (0..count)
        .map(|_| {
            at += Vector3::from_fn(|_, _| random.sample::<f64, _>(StandardNormal));
            at
        })
        .collect();
    let mean = all.iter().sum::<Vector3<f64>>() / count.max(1) as f64;
    for coordinate in 0..3 {
        let squares: f64 = all
            .iter()
            .map(|x| (x[coordinate] - mean[coordinate]).powi(2))
            .sum();
        let size = (squares / count.max(1) as f64).sqrt();
        let factor = if size > 0.0 { rms / size } else { 0.0 };
        all.iter_mut()
            .for_each(|x| x[coordinate] = (x[coordinate] - mean[coordinate]) * factor);
    }
    all
}

/// A Gaussian process over (sin q, cos q) with squared-exponential covariance, for each of x, y, z.
///
/// Source: Rahimi and Recht 2007, *Random features for large-scale kernel machines*: a sum of random waves.
fn smooth(visits: &[Visit], rms: f64, length: f64, random: &mut impl Rng) -> Vec<Vector3<f64>> {
    const WAVES: usize = 300;
    let inputs = 2 * visits.first().map_or(0, |visit| visit.joints.len());
    let mut normal = || -> f64 { random.sample(StandardNormal) };
    let waves: Vec<Vec<f64>> = (0..WAVES)
        .map(|_| (0..inputs).map(|_| normal() / length).collect())
        .collect();
    let sizes: Vec<Vector3<f64>> = waves
        .iter()
        .map(|_| Vector3::from_fn(|_, _| normal()))
        .collect();
    let phases: Vec<f64> = waves
        .iter()
        .map(|_| random.random_range(0.0..TAU))
        .collect();
    // each coordinate has a third of the vector's square
    let size = rms / 3f64.sqrt() * (2.0 / WAVES as f64).sqrt();
    let at = |visit: &Visit| {
        let u: Vec<f64> = visit
            .joints
            .iter()
            .flat_map(|q| [q.sin(), q.cos()])
            .collect();
        let all = waves.iter().zip(&sizes).zip(&phases);
        all.map(|((wave, amplitude), phase)| {
            let along: f64 = wave.iter().zip(&u).map(|(w, u)| w * u).sum();
            amplitude * ((along + phase).cos() * size)
        })
        .sum()
    };
    visits.iter().map(at).collect()
}

/// Shifts of the readings of a share of all labels, alike for each label.
fn blunders(labels: &[usize], bad: Blunder, random: &mut impl Rng) -> Vec<Vector3<f64>> {
    let count = labels.iter().max().map_or(0, |most| most + 1);
    let by_label: Vec<Vector3<f64>> = (0..count)
        .map(|_| {
            let hit = random.random_range(0.0..1.0) < bad.share;
            let shift: Vector3<f64> =
                Vector3::from_fn(|_, _| random.sample::<f64, _>(StandardNormal));
            if hit {
                shift * bad.coordinate_m
            } else {
                Vector3::zeros()
            }
        })
        .collect();
    labels.iter().map(|&label| by_label[label]).collect()
}
