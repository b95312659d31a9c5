//! How each pose is measured: on which targets, under which loads, from which directions, how often, with what.

use crate::campaign::pose_key;
use crate::campaign::wrench_is_measured;
use crate::campaign::{Payload, Reading};
use crate::setup::Setup;
use nalgebra::Vector3;
use std::collections::BTreeSet;

/// Loads of a campaign that are taken over at most; of more, the lightest and the heaviest.
const MOST_LOADS: usize = 4;
/// Loads known by their wrench alone are the same within this share of the heavier.
const SAME: f64 = 0.05;

/// A factorial protocol: every pose on every target, under every load, from every direction, so often.
#[derive(Debug, Clone, PartialEq)]
pub struct Protocol {
    /// Indices of the targets.
    pub targets: Vec<usize>,
    /// Dead weights on the target's link; none where nothing is said of a payload.
    pub loads: Vec<Option<Payload>>,
    /// Sign of the last motion of all joints; none where it is not noted.
    pub directions: Vec<Option<f64>>,
    /// Readings of the same kind.
    pub repeats: usize,
    /// Is the target's orientation measured?
    pub orientation: bool,
    /// Is the wrist wrench measured beside a known payload?
    pub wrench: bool,
}

impl Protocol {
    /// As a campaign was measured.
    ///
    /// Its loads are the distinct payloads; a wrench without a payload counts as the dead weight that makes it.
    pub fn of(setup: &Setup, readings: &[&Reading]) -> Self {
        let targets: BTreeSet<usize> = readings.iter().map(|r| r.target).collect();
        let loads = loads(setup, readings);
        let from = |side: f64| {
            let mut approach = readings.iter().filter_map(|r| r.approach.as_ref());
            approach.any(|signs| signs.iter().any(|sign| sign * side > 0.0))
        };
        let mut directions: Vec<Option<f64>> = [-1.0, 1.0]
            .into_iter()
            .filter(|&side| from(side))
            .map(Some)
            .collect();
        if directions.is_empty() {
            directions.push(None);
        }
        let poses: BTreeSet<_> = readings.iter().map(|r| pose_key(r)).collect();
        let once = poses.len() * targets.len() * loads.len() * directions.len();
        Self {
            targets: targets.into_iter().collect(),
            repeats: (readings.len() as f64 / once.max(1) as f64)
                .round()
                .max(1.0) as usize,
            loads,
            directions,
            orientation: readings.iter().any(|r| r.orientation.is_some()),
            wrench: readings.iter().any(|r| wrench_is_measured(r)),
        }
    }

    /// Readings of one pose: all targets, loads and directions, each once. Their measured parts are empty but for
    /// marks of what will be measured.
    pub fn readings(&self, joints: &[f64]) -> Vec<Reading> {
        let mut readings = Vec::new();
        for load in &self.loads {
            for &target in &self.targets {
                for direction in &self.directions {
                    readings.push(Reading {
                        approach: direction.map(|sign| vec![sign; joints.len()]),
                        orientation: self.orientation.then(nalgebra::UnitQuaternion::identity),
                        wrench: (self.wrench && load.is_some()).then_some(
                            crate::campaign::Wrench {
                                force: Vector3::zeros(),
                                torque: Vector3::zeros(),
                            },
                        ),
                        payload: *load,
                        ..Reading::to_be(target, joints.to_vec())
                    });
                }
            }
        }
        readings
    }

    /// Readings of one pose with all repeats.
    pub fn readings_a_pose(&self) -> usize {
        self.targets.len() * self.loads.len() * self.directions.len() * self.repeats
    }
}

/// The distinct loads of a campaign, the lightest first.
fn loads(setup: &Setup, readings: &[&Reading]) -> Vec<Option<Payload>> {
    let mut loads: Vec<Option<Payload>> = Vec::new();
    for reading in readings {
        let load = reading.payload.or_else(|| hanging(setup, reading));
        let known = loads.iter().any(|other| match (other, &load) {
            (Some(a), Some(b)) if reading.payload.is_none() => {
                (a.mass - b.mass).abs() <= SAME * a.mass.max(b.mass)
            }
            (a, b) => a == b,
        });
        if !known {
            loads.push(load);
        }
    }
    let mass = |load: &Option<Payload>| load.map_or(0.0, |payload| payload.mass);
    loads.sort_by(|a, b| mass(a).total_cmp(&mass(b)));
    if loads.len() > MOST_LOADS {
        loads = vec![loads[0], loads[loads.len() - 1]];
    }
    if loads.is_empty() {
        loads.push(None);
    }
    loads
}

/// The dead weight that makes a wrench: its weight, and the centre nearest to the link's origin.
fn hanging(setup: &Setup, reading: &Reading) -> Option<Payload> {
    let wrench = reading.wrench?;
    let (force, gravity) = (wrench.force.norm(), setup.gravity.norm());
    (gravity > 0.0 && force > 0.0).then(|| Payload {
        mass: force / gravity,
        com: wrench.force.cross(&wrench.torque) / (force * force),
    })
}
