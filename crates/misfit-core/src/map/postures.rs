//! Postures for the points of a map: each from its neighbour's, from that of reference outwards.

use super::grid::{Grid, ball};
use crate::campaign::Reading;
use crate::compensation::{End, Reach, Robot, solve};
use crate::model::Workspace;
use rayon::prelude::*;

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
