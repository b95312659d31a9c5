//! Maps of the workspace: how far a robot's target is off where it would be, over a slice or a volume.
//!
//! Each point is reached by the nominal robot, in the posture that is nearest to one of reference. There the arm is loaded:
//! by the model here, by the plant in `scenario/mapped.rs`. A redundant arm reaches a point in many postures, and gives way
//! in each differently: a map is of its reference.

mod grid;
mod postures;
mod request;

use crate::campaign::{Payload, Reading};
use crate::compensation::Robot;
use crate::model::Workspace;
use crate::setup::Setup;
use rayon::prelude::*;
use serde::Serialize;

pub use grid::{AXES, Grid};
pub use postures::postures;
pub use request::{By, Request, Which};

/// How far a target is off.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Off {
    /// m.
    pub position: f64,
    /// rad.
    pub orientation: f64,
    /// Does a joint bear more than it is rated for?
    pub overloaded: bool,
}

/// How far the model is off at postures under a load; none where there is no posture, or the arm does not hold.
pub fn by_model(
    robot: &Robot<'_>,
    target: usize,
    postures: &[Option<Vec<f64>>],
    load: &Payload,
    which: Which,
) -> Vec<Option<Off>> {
    /// Postures of one job.
    const RUN: usize = 64;
    let runs: Vec<Vec<Option<Off>>> = postures
        .par_chunks(RUN)
        .map(|run| {
            let mut workspace = Workspace::new(&robot.model.setup);
            let mut off = |joints: &Vec<f64>| {
                let mut reading = Reading {
                    payload: Some(*load),
                    ..Reading::to_be(target, joints.clone())
                };
                let loaded = workspace.predict(robot.model, &robot.values, &reading);
                let torques = workspace.torques(robot.model, &reading);
                let against = match which {
                    Which::Load => {
                        reading.payload = Some(Payload { mass: 0.0, ..*load });
                        workspace.predict(robot.model, &robot.values, &reading)
                    }
                    Which::Total => workspace.predict(robot.model, &robot.nominal, &reading),
                };
                let settled = loaded.settled && against.settled;
                settled.then(|| Off {
                    position: (loaded.position - against.position).norm(),
                    orientation: loaded.orientation.angle_to(&against.orientation),
                    overloaded: !robot.model.setup.robot.overloaded(&torques).is_empty(),
                })
            };
            run.iter().map(|joints| off(joints.as_ref()?)).collect()
        })
        .collect();
    runs.into_iter().flatten().collect()
}

/// A map of one target.
#[derive(Debug, Clone, PartialEq)]
pub struct Map {
    /// Index of the target.
    pub target: usize,
    /// Its points.
    pub grid: Grid,
    /// Postures by point.
    pub postures: Vec<Option<Vec<f64>>>,
    /// Who tells.
    pub by: By,
    /// By point.
    pub off: Vec<Option<Off>>,
}

/// A map in a few numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct MapSummary {
    /// Target.
    pub target: String,
    /// Who tells.
    pub by: By,
    /// Points of the grid.
    pub points: usize,
    /// Of them in reach.
    pub reached: usize,
    /// Of these, points where the arm does not hold the load.
    pub collapsed: usize,
    /// Of the others, points where a joint bears more than it is rated for.
    pub overloaded: usize,
    /// Median, m; this and the following are not numbers where no point is left.
    pub position_median_m: f64,
    /// Largest, m.
    pub position_max_m: f64,
    /// Where it is largest, base frame, m.
    pub position_max_at_m: [f64; 3],
    /// Median, rad.
    pub orientation_median_rad: f64,
    /// Largest, rad.
    pub orientation_max_rad: f64,
}

impl Map {
    /// Sums it up.
    pub fn summary(&self, setup: &Setup) -> MapSummary {
        let off: Vec<Off> = self.off.iter().copied().flatten().collect();
        let sorted = |of: fn(&Off) -> f64| {
            let mut all: Vec<f64> = off.iter().map(of).collect();
            all.sort_by(f64::total_cmp);
            all
        };
        let positions = sorted(|o| o.position);
        let orientations = sorted(|o| o.orientation);
        let middle = |all: &[f64]| all.get(all.len() / 2).copied().unwrap_or(f64::NAN);
        let last = |all: &[f64]| all.last().copied().unwrap_or(f64::NAN);
        let told = (0..self.off.len()).filter(|&k| self.off[k].is_some());
        let worst = told.max_by(|&a, &b| {
            let size = |k: usize| self.off[k].map_or(-1.0, |o| o.position);
            size(a).total_cmp(&size(b))
        });
        let reached = self.postures.iter().flatten().count();
        MapSummary {
            target: setup.targets[self.target].name.clone(),
            by: self.by,
            points: self.grid.len(),
            reached,
            collapsed: reached - off.len(),
            overloaded: off.iter().filter(|o| o.overloaded).count(),
            position_median_m: middle(&positions),
            position_max_m: last(&positions),
            position_max_at_m: worst.map_or([f64::NAN; 3], |k| self.grid.point(k).into()),
            orientation_median_rad: middle(&orientations),
            orientation_max_rad: last(&orientations),
        }
    }
}
