//! Where in the workspace the errors are, before and after.

use super::{Picture, ReportError, Results, panel, picture, rms, thinned};
use crate::format::length;
use crate::plot::{Cloud, Content};
use misfit_campaign::pose_key;
use misfit_campaign::{Campaign, Reading};
use misfit_core::fit::{Fit, residuals};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// What the section shows.
pub(super) struct Section {
    pub pictures: Vec<Picture>,
    /// The poses with the largest errors of the last model.
    pub worst: Vec<Row>,
    /// Is there anything to compare with?
    pub compared: bool,
    /// What a point is.
    pub note: String,
}

/// A pose.
pub(super) struct Row {
    pub line: usize,
    pub place: String,
    pub before: String,
    pub after: String,
}

/// Points drawn.
const MAX_POINTS: usize = 800;
/// Poses listed.
const MAX_LISTED: usize = 5;

/// One pose with the errors of its readings.
struct Pose {
    line: usize,
    place: Vector3<f64>,
    before: f64,
    after: f64,
}

pub(super) fn section(
    campaign: &Campaign,
    results: &Results<'_>,
) -> Result<Option<Section>, ReportError> {
    let poses = poses(campaign, results);
    if poses.len() < 2 {
        return Ok(None);
    }
    let compared = results.before().is_some();
    let shown: Vec<&Pose> = thinned(poses.len(), MAX_POINTS)
        .into_iter()
        .map(|k| &poses[k])
        .collect();
    let top = colour_end(&shown, compared);
    let pictures = pictures(&poses, &shown, top, compared)?;
    let mut order: Vec<&Pose> = poses.iter().collect();
    order.sort_by(|a, b| b.after.total_cmp(&a.after).then(a.line.cmp(&b.line)));
    let row = |pose: &&Pose| Row {
        line: pose.line,
        place: format!(
            "{:.3}, {:.3}, {:.3}",
            pose.place.x, pose.place.y, pose.place.z
        ),
        before: length(pose.before),
        after: length(pose.after),
    };
    let few = match shown.len() < poses.len() {
        true => format!(" {} of {} poses are drawn.", shown.len(), poses.len()),
        false => String::new(),
    };
    let beyond = |pose: &&Pose| pose.after > top || (compared && pose.before > top);
    let ends = match shown.iter().any(beyond) {
        false => String::new(),
        true => format!(" Errors above {} have the last colour.", length(top)),
    };
    Ok(Some(Section {
        worst: order.iter().take(MAX_LISTED).map(row).collect(),
        pictures,
        compared,
        note: format!(
            "Each point is a pose: where its target's link is in the base frame of the nominal robot, coloured by the \
             position error of its readings, rms, fitted or not.{}{few}{ends}",
            models(results)
        ),
    }))
}

/// The error at the end of the colours, m.
fn colour_end(shown: &[&Pose], compared: bool) -> f64 {
    let mut sizes: Vec<f64> = shown.iter().map(|pose| pose.after).collect();
    if compared {
        sizes.extend(shown.iter().map(|pose| pose.before));
    }
    sizes.sort_by(f64::total_cmp);
    // one pose far off must not make all others look alike
    sizes[(sizes.len() - 1) * 98 / 100]
}

/// Maps from above and from the side, before and after.
fn pictures(
    poses: &[Pose],
    shown: &[&Pose],
    top: f64,
    compared: bool,
) -> Result<Vec<Picture>, ReportError> {
    let (unit, scale) = if top < 2e-4 {
        ("µm", 1e6)
    } else {
        ("mm", 1e3)
    };
    // from the side on which the poses spread more
    let spread = |axis: usize| {
        let values = || shown.iter().map(|pose| pose.place[axis]);
        let (least, most) = values().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(x), b.max(x))
        });
        most - least
    };
    let side = if spread(0) >= spread(1) { 0 } else { 1 };
    let mut pictures = Vec::new();
    let mut draw = |when: &str, of: fn(&Pose) -> f64| -> Result<(), ReportError> {
        for (view, across, up) in [("from above", 0, 1), ("from the side", side, 2)] {
            let point = |pose: &&Pose| (pose.place[across], pose.place[up], of(pose) * scale);
            let cloud = Cloud {
                points: shown.iter().map(point).collect(),
                top: top * scale,
                unit: unit.to_owned(),
            };
            let axis = |axis: usize| format!("{}, m", ["x", "y", "z"][axis]);
            let title = format!("{when}, {view}");
            let alt = format!(
                "Map of the position errors, {title}: rms of all poses {}, largest {}.",
                length(rms(poses.iter().map(of))),
                length(poses.iter().map(of).fold(0.0, f64::max))
            );
            let caption = format!("{title}: {} rms", length(rms(poses.iter().map(of))));
            let panel = panel(&title, &axis(across), &axis(up), Content::Cloud(cloud));
            pictures.push(picture(panel, 380, alt, caption)?);
        }
        Ok(())
    };
    if compared {
        draw("before", |pose| pose.before)?;
        draw("after", |pose| pose.after)?;
    } else {
        draw("position error", |pose| pose.after)?;
    }
    Ok(pictures)
}

/// Which models before and after are.
fn models(results: &Results<'_>) -> String {
    let Some(before) = results.before() else {
        return String::new();
    };
    let ids = results.fit().model.terms.iter().map(|t| t.effect.id());
    let new: Vec<&str> = ids.filter(|id| !before.model.has(id)).collect();
    match new.is_empty() {
        true => String::new(),
        false => format!(
            " Before: the model without {}; after: with {}.",
            new.join(", "),
            if new.len() == 1 { "it" } else { "them" }
        ),
    }
}

/// Readings by target and pose.
fn poses(campaign: &Campaign, results: &Results<'_>) -> Vec<Pose> {
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    let errors = |fit: &Fit| -> Vec<f64> {
        let rows = residuals(&fit.model, &fit.values, &readings);
        let norm = |row: &misfit_core::model::Row| row.fixed_rows::<3>(0).norm();
        rows.iter().map(norm).collect()
    };
    let after = errors(results.fit());
    let before = results.before().map(errors);
    let before = before.as_ref().unwrap_or(&after);
    let mut place = BTreeMap::new();
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, reading) in readings.iter().enumerate() {
        let next = groups.len();
        let key = (reading.target, pose_key(reading));
        let own = *place.entry(key).or_insert(next);
        if own == next {
            groups.push(Vec::new());
        }
        groups[own].push(index);
    }
    let pose = |group: &Vec<usize>| {
        let first = readings[group[0]];
        let link = &campaign.robot.links[campaign.targets[first.target].link];
        let body = campaign.robot.body_poses(&first.joints)[link.body];
        Pose {
            line: first.line,
            place: (body * link.body_from_link).translation.vector,
            before: rms(group.iter().map(|&k| before[k])),
            after: rms(group.iter().map(|&k| after[k])),
        }
    };
    let poses = groups.iter().map(pose);
    poses
        .filter(|pose| pose.before.is_finite() && pose.after.is_finite())
        .collect()
}
