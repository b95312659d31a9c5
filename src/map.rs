//! Maps of the workspace: how far a robot's target is off where it would be, over a slice or a volume.
//!
//! Each point is reached by the nominal robot, in the posture that is nearest to one of reference. There the arm is loaded:
//! by the model here, by the plant in `scenario/mapped.rs`. A redundant arm reaches a point in many postures, and gives way
//! in each differently: a map is of its reference.

use crate::campaign::{Payload, Reading};
use crate::compensation::{End, Reach, Robot, solve};
use crate::model::Workspace;
use crate::plan::space::Space;
use crate::setup::Setup;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Points of a map at most.
const MOST_POINTS: usize = 1_000_000;
/// Points if nothing says how many.
const POINTS: usize = 10_000;

/// `[map]` of a scenario, and what the command line says besides.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Targets; all if left out.
    pub targets: Option<Vec<String>>,
    /// Axes of the base frame, two for a slice or three for a volume: `xz` if left out.
    pub plane: Option<String>,
    /// Where a slice lies on the third axis, m; through the posture of reference if left out.
    pub at_m: Option<f64>,
    /// Least and greatest along each axis, m; all that the arm can reach if left out.
    pub range_m: Option<Vec<[f64; 2]>>,
    /// Points, about.
    pub points: Option<usize>,
    /// Who tells: model, plant, or both.
    pub by: Option<Vec<By>>,
    /// Model, as for `[compensate]`.
    pub model: Option<String>,
    /// Which error.
    #[serde(default)]
    pub error: Which,
    /// Hold the orientation that the posture of reference has? Else any will do.
    #[serde(default)]
    pub hold_orientation: bool,
    /// Posture of reference: rad (m) by joint; joints left out stand in the middle of their ranges.
    #[serde(default)]
    pub posture_rad: BTreeMap<String, f64>,
}

/// Who tells how far the arm is off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// The model.
    Model,
    /// MuJoCo.
    Plant,
}

/// Which error is mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// What the load does: loaded against not loaded.
    #[default]
    Load,
    /// All: loaded against the nominal robot.
    Total,
}

impl By {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            By::Model => "the model",
            By::Plant => "MuJoCo",
        }
    }
}

impl Which {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            Which::Load => "deflection",
            Which::Total => "error",
        }
    }
}

/// Points in the base frame, m.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Axes that vary, the first one fastest.
    pub axes: Vec<usize>,
    /// The coordinates that do not.
    pub at: Vector3<f64>,
    /// Least and greatest along each of the axes.
    pub ranges: Vec<(f64, f64)>,
    /// Points along each.
    pub counts: Vec<usize>,
}

impl Grid {
    /// Number of points.
    pub fn len(&self) -> usize {
        self.counts.iter().product()
    }

    /// Is there no point?
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Coordinates of the points along one of the axes, m.
    pub fn along(&self, axis: usize) -> Vec<f64> {
        let (least, most) = self.ranges[axis];
        let count = self.counts[axis];
        let step = (most - least) / count as f64;
        // points are the middles of cells
        (0..count)
            .map(|k| least + (k as f64 + 0.5) * step)
            .collect()
    }

    /// Indices of the points beside one.
    fn beside(&self, index: usize) -> impl Iterator<Item = usize> + '_ {
        let mut stride = 1;
        let strides = self.counts.iter().map(move |&count| {
            let own = stride;
            stride *= count;
            (own, count)
        });
        strides.flat_map(move |(stride, count)| {
            let place = index / stride % count;
            let before = (place > 0).then(|| index - stride);
            let after = (place + 1 < count).then_some(index + stride);
            before.into_iter().chain(after)
        })
    }

    /// A point by its index.
    pub fn point(&self, mut index: usize) -> Vector3<f64> {
        let mut point = self.at;
        for (k, &axis) in self.axes.iter().enumerate() {
            let (least, most) = self.ranges[k];
            let count = self.counts[k];
            let step = (most - least) / count as f64;
            point[axis] = least + ((index % count) as f64 + 0.5) * step;
            index /= count;
        }
        point
    }
}

/// Letters of the axes.
pub const AXES: [&str; 3] = ["x", "y", "z"];

impl Request {
    /// Refuses what makes no sense for a robot.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, setup: &Setup) -> Result<(), String> {
        self.targets(setup)?;
        let axes = self.axes()?;
        let wrong = |what: String| Err(format!("[map] {what}"));
        if let Some(at) = self.at_m {
            if axes.len() == 3 {
                return wrong(
                    "at_m is of a slice, but plane names all three axes; leave it out".to_owned(),
                );
            }
            if !(-100.0..=100.0).contains(&at) {
                return wrong(format!("at_m is {at}; accepted: -100 to 100"));
            }
        }
        if let Some(ranges) = &self.range_m {
            let good = |range: &[f64; 2]| {
                range.iter().all(|x| x.abs() <= 100.0) && range[1] - range[0] >= 1e-3
            };
            if ranges.len() != axes.len() || !ranges.iter().all(good) {
                return wrong(format!(
                    "range_m is {ranges:?}; accepted: {} pairs [least, greatest] in m, -100 to 100, at least 1 mm apart",
                    axes.len()
                ));
            }
        }
        if let Some(points) = self.points
            && !(4..=MOST_POINTS).contains(&points)
        {
            return wrong(format!("points is {points}; accepted: 4 to {MOST_POINTS}"));
        }
        let by = self.tellers();
        if by.is_empty() || (by.len() > 1 && by[1..].contains(&by[0])) || by.len() > 2 {
            return wrong("by: accepted are \"model\", \"plant\", each once".to_owned());
        }
        for (name, angle) in &self.posture_rad {
            if setup.robot.joint(name).is_none() {
                let known: Vec<&str> = setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
                return wrong(format!(
                    "posture_rad: no joint is called \"{name}\"; known: {}",
                    known.join(", ")
                ));
            }
            let joint = setup.robot.joints.iter().find(|joint| joint.name == *name);
            let (least, most) = joint.and_then(|j| j.limits).unwrap_or((-1e3, 1e3));
            if !(least..=most).contains(angle) {
                return wrong(format!(
                    "posture_rad: {name} is {angle}; accepted: {least} to {most}"
                ));
            }
        }
        Ok(())
    }

    /// Refuses a load that does nothing where what it does is wanted.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_load(&self, load: &Payload) -> Result<(), String> {
        if load.mass == 0.0 && self.error == Which::Load {
            return Err(
                "[map] the load is 0 kg: there is no deflection; accepted: a load, or error = \"total\"".to_owned(),
            );
        }
        Ok(())
    }

    /// Targets by index.
    ///
    /// # Errors
    /// For a name that no target has, and one that stands there twice.
    pub fn targets(&self, setup: &Setup) -> Result<Vec<usize>, String> {
        let Some(names) = &self.targets else {
            return Ok((0..setup.targets.len()).collect());
        };
        let known = || {
            let names: Vec<&str> = setup.targets.iter().map(|t| t.name.as_str()).collect();
            names.join(", ")
        };
        if names.is_empty() {
            return Err(format!("[map] targets is empty; accepted: {}", known()));
        }
        let find = |name: &String| {
            let found = setup.targets.iter().position(|t| t.name == *name);
            found.ok_or_else(|| format!("[map] no target is called \"{name}\"; known: {}", known()))
        };
        let found: Vec<usize> = names.iter().map(find).collect::<Result<_, _>>()?;
        match (1..found.len()).find(|&k| found[..k].contains(&found[k])) {
            Some(k) => Err(format!(
                "[map] targets has \"{}\" twice; accepted: each once",
                names[k]
            )),
            None => Ok(found),
        }
    }

    /// Who tells; the plant if nothing is said.
    pub fn tellers(&self) -> Vec<By> {
        self.by.clone().unwrap_or_else(|| vec![By::Plant])
    }

    /// Axes by index.
    fn axes(&self) -> Result<Vec<usize>, String> {
        let plane = self.plane.as_deref().unwrap_or("xz");
        let found: Option<Vec<usize>> = plane.chars().map(|c| "xyz".find(c)).collect();
        let distinct = |axes: &[usize]| (1..axes.len()).all(|k| !axes[..k].contains(&axes[k]));
        match found {
            Some(axes) if matches!(axes.len(), 2 | 3) && distinct(&axes) => Ok(axes),
            _ => Err(format!(
                "[map] plane is \"{plane}\"; accepted: two axes of the base frame for a slice, such as xz, or xyz for a volume"
            )),
        }
    }

    /// The posture of reference, by joint of the robot, rad (m).
    pub fn posture(&self, setup: &Setup, space: &Space) -> Vec<f64> {
        let joints = setup.robot.joints.iter().zip(&space.ranges);
        joints
            .map(|(joint, (least, most))| {
                let told = self.posture_rad.get(&joint.name).copied();
                told.unwrap_or((least + most) / 2.0)
            })
            .collect()
    }

    /// The points for a target whose arm stands in a posture of reference.
    ///
    /// # Errors
    /// For axes that are none.
    pub fn grid(
        &self,
        setup: &Setup,
        target: usize,
        posture: &[f64],
        reach: &Reach,
    ) -> Result<Grid, String> {
        let axes = self.axes()?;
        let link = &setup.robot.links[setup.targets[target].link];
        let poses = setup.robot.body_poses(posture);
        let mut at = (poses[link.body] * link.body_from_link).translation.vector;
        if let Some(told) = self.at_m
            && let Some(third) = (0..3).find(|axis| !axes.contains(axis))
        {
            at[third] = told;
        }
        let (centre, radius) = ball(setup, target, &poses, &reach.moving);
        let ranges: Vec<(f64, f64)> = match &self.range_m {
            Some(ranges) => ranges.iter().map(|r| (r[0], r[1])).collect(),
            None => axes
                .iter()
                .map(|&axis| (centre[axis] - radius, centre[axis] + radius))
                .collect(),
        };
        // cells as square as can be
        let points = self.points.unwrap_or(POINTS) as f64;
        let whole: f64 = ranges.iter().map(|(a, b)| b - a).product();
        let step = (whole / points).powf(1.0 / axes.len() as f64);
        let counts = ranges
            .iter()
            .map(|(a, b)| (((b - a) / step).round() as usize).max(1))
            .collect();
        Ok(Grid {
            axes,
            at,
            ranges,
            counts,
        })
    }
}

/// Where a target can be at most: around the first joint that moves, by the sum of what lies behind it.
fn ball(
    setup: &Setup,
    target: usize,
    poses: &[nalgebra::Isometry3<f64>],
    moving: &[usize],
) -> (Vector3<f64>, f64) {
    let robot = &setup.robot;
    let link = &robot.links[setup.targets[target].link];
    let home = (poses[link.body] * link.body_from_link).translation.vector;
    let chain = robot.chain(link.body);
    let Some(from) = chain.iter().position(|joint| moving.contains(joint)) else {
        return (home, 0.0);
    };
    let first = &robot.joints[chain[from]];
    let centre = (poses[first.parent] * first.parent_from_joint)
        .translation
        .vector;
    let slides = |joint: &crate::robot::Joint| match joint.load_row() {
        0 => joint.limits.map_or(0.0, |(a, b)| a.abs().max(b.abs())),
        _ => 0.0,
    };
    let behind = chain[from + 1..].iter().map(|&joint| &robot.joints[joint]);
    let lengths = behind.map(|j| j.parent_from_joint.translation.vector.norm() + slides(j));
    let last = link.body_from_link.translation.vector.norm();
    (centre, last + slides(first) + lengths.sum::<f64>())
}

/// Postures in which the nominal robot has its target at the points of a grid, by joint of the robot, rad (m); none where
/// it does not reach.
///
/// Each point is sought from its neighbour's posture, and from that of reference if this fails: first along a line through
/// the point nearest to the reference, layer by layer and row by row, then along the rows, in parallel and with the same
/// result for any number of threads.
pub fn postures(
    robot: &Robot<'_>,
    target: usize,
    grid: &Grid,
    posture: &[f64],
    (reach, hold_orientation): (&Reach, bool),
) -> Vec<Option<Vec<f64>>> {
    let setup = &robot.model.setup;
    let poses = setup.robot.body_poses(posture);
    let (centre, radius) = ball(setup, target, &poses, &reach.moving);
    let link = &setup.robot.links[setup.targets[target].link];
    let link_from_target = robot.link_from_target(target);
    let home = poses[link.body] * link.body_from_link * link_from_target;
    let tracker_from_base = robot.base_from_tracker().inverse();
    // a target that lies off its link reaches a little further
    let offset = link_from_target.translation.vector.norm();
    let seek = |workspace: &mut Workspace, index: usize, from: &[&[f64]]| -> Option<Vec<f64>> {
        let point = grid.point(index);
        if (point - centre).norm() > radius + offset {
            return None;
        }
        let mut task = Reading::to_be(target, posture.to_vec());
        task.position = (tracker_from_base * nalgebra::Point3::from(point)).coords;
        task.orientation = hold_orientation.then(|| tracker_from_base.rotation * home.rotation);
        from.iter().find_map(|start| {
            let (p, from) = (&robot.nominal, (*start, posture));
            let found = solve(workspace, robot.model, p, &task, from, reach);
            (found.end == End::Reached).then_some(found.joints)
        })
    };
    let nearest = |axis: usize| {
        let coordinates = grid.along(axis);
        let off = |k: usize| (coordinates[k] - home.translation.vector[grid.axes[axis]]).abs();
        (0..coordinates.len())
            .min_by(|&a, &b| off(a).total_cmp(&off(b)))
            .unwrap_or(0)
    };
    let (width, start) = (grid.counts[0], nearest(0));
    let (height, row) = (grid.counts[1], nearest(1));
    let layers = grid.counts.get(2).copied().unwrap_or(1);
    let layer = if layers > 1 { nearest(2) } else { 0 };
    // the line: from the middle outwards, along the layers and then the rows
    let mut workspace = Workspace::new(setup);
    let mut line: Vec<Option<Vec<f64>>> = vec![None; layers * height];
    let mut at = |place: usize, from: Option<usize>, line: &mut Vec<Option<Vec<f64>>>| {
        let near = from.and_then(|from| line[from].clone());
        let near = near.unwrap_or_else(|| posture.to_vec());
        line[place] = seek(&mut workspace, place * width + start, &[&near, posture]);
    };
    at(layer * height + row, None, &mut line);
    for k in outwards(layer, layers) {
        let (place, from) = (k.0 * height + row, k.1 * height + row);
        at(place, Some(from), &mut line);
    }
    for k in 0..layers {
        for (next, from) in outwards(row, height) {
            at(k * height + next, Some(k * height + from), &mut line);
        }
    }
    let rows: Vec<Vec<Option<Vec<f64>>>> = line
        .into_par_iter()
        .enumerate()
        .map(|(row, first)| {
            let mut workspace = Workspace::new(setup);
            let mut found: Vec<Option<Vec<f64>>> = vec![None; width];
            found[start] = first;
            for (column, from) in outwards(start, width) {
                let near = found[from].clone().unwrap_or_else(|| posture.to_vec());
                found[column] = seek(&mut workspace, row * width + column, &[&near, posture]);
            }
            found
        })
        .collect();
    let mut all: Vec<Option<Vec<f64>>> = rows.into_iter().flatten().collect();
    settle(&mut all, grid, posture, |index, near| {
        let mut workspace = Workspace::new(setup);
        seek(&mut workspace, index, &[near])
    });
    all
}

/// Where neighbours stand in different postures, or one is missed, each may know a better one for the other: nearer to the
/// reference. Asks until none does, all points at once and so with the same result for any number of threads.
fn settle(
    all: &mut [Option<Vec<f64>>],
    grid: &Grid,
    posture: &[f64],
    seek: impl Fn(usize, &[f64]) -> Option<Vec<f64>> + Sync,
) {
    /// Postures further apart than this are different, rad (m).
    const APART: f64 = 0.3;
    const ROUNDS: usize = 200;
    let far = |joints: &[f64]| -> f64 {
        let both = joints.iter().zip(posture);
        both.map(|(a, b)| (a - b) * (a - b)).sum()
    };
    let differ = |a: &[f64], b: &[f64]| a.iter().zip(b).any(|(a, b)| (a - b).abs() > APART);
    let mut changed = vec![true; all.len()];
    for _ in 0..ROUNDS {
        let better: Vec<(usize, Vec<f64>)> = (0..all.len())
            .into_par_iter()
            .filter_map(|index| {
                let own = all[index].as_deref();
                let news = grid.beside(index).filter(|&k| changed[k] || changed[index]);
                let others = news.filter_map(|k| all[k].as_deref());
                let others = others.filter(|other| own.is_none_or(|own| differ(own, other)));
                let found = others.filter_map(|near| seek(index, near));
                let best = found.min_by(|a, b| far(a).total_cmp(&far(b)))?;
                let gain = own.is_none_or(|own| far(&best) < far(own) - 1e-6);
                gain.then_some((index, best))
            })
            .collect();
        if better.is_empty() {
            break;
        }
        changed.fill(false);
        for (index, joints) in better {
            changed[index] = true;
            all[index] = Some(joints);
        }
    }
}

/// From a place to both ends of so many: each place with the one before it.
fn outwards(start: usize, count: usize) -> impl Iterator<Item = (usize, usize)> {
    let up = (start + 1..count).map(|k| (k, k - 1));
    up.chain((0..start).rev().map(|k| (k, k + 1)))
}

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
