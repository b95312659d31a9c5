//! What pulls at the arms: measured wrenches, and the weight of payloads, in the frame of the target's link.

use crate::Scene;
use crate::log::{Logged, at, first_step, fixed, moving, path, xyz};
use crate::readings::colour_of;
use crate::scene::{quantile, round};
use misfit_campaign::Reading;
use nalgebra::Vector3;
use rerun::{Arrows3D, Radius, RecordingStream};

/// Colour of forces.
pub const FORCE: [u8; 3] = [213, 94, 0];
/// Colour of torques.
pub const TORQUE: [u8; 3] = [204, 121, 167];
/// Colour of weights.
pub const WEIGHT: [u8; 3] = [240, 228, 66];

/// m of arrow for each N and each N·m; `None` where nothing pulls.
#[derive(Debug, Clone, Copy, Default)]
pub struct Lengths {
    /// m/N.
    pub force: Option<f64>,
    /// m/(N·m).
    pub torque: Option<f64>,
}

impl Lengths {
    /// The largest force and torque of the recording are a third of the scene's radius long, or a little less.
    pub fn of(scene: &Scene) -> Self {
        let campaign = &scene.recording.campaign;
        let readings = || campaign.readings.iter();
        let forces = readings()
            .filter_map(|reading| Some(reading.wrench?.force.norm()))
            .chain(readings().filter_map(|r| Some(r.payload?.mass * campaign.gravity.norm())));
        let torques = readings().filter_map(|reading| Some(reading.wrench?.torque.norm()));
        let length = |values: Vec<f64>| {
            let largest = quantile(values, 0.995);
            (largest > 1e-9).then(|| round(0.35 * scene.reach / largest))
        };
        Self {
            force: length(forces.collect()),
            torque: length(torques.collect()),
        }
    }
}

/// Sends arrows at the targets' links.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    let lengths = Lengths::of(scene);
    for (target, name, link) in scene.targets() {
        let pulls = Pulls::of(scene, target, link);
        if pulls.is_empty() {
            continue;
        }
        let entity = path(["cell", "loads", name]);
        moving(
            stream,
            scene,
            &entity,
            scene.nominal.iter().map(|links| links[link]),
        )?;
        let kinds = [
            ("force_N", FORCE, lengths.force, &pulls.forces, "N"),
            ("torque_Nm", TORQUE, lengths.torque, &pulls.torques, "N·m"),
            ("weight_N", WEIGHT, lengths.force, &pulls.weights, "N"),
        ];
        for (kind, colour, length, rows, unit) in kinds {
            let (Some(length), false) = (length, rows.is_empty()) else {
                continue;
            };
            let entity = path(["cell", "loads", name, kind]);
            let look = Arrows3D::update_fields()
                .with_radii([Radius::new_ui_points(3.0)])
                .with_colors([colour_of(colour)]);
            fixed(stream, entity.clone(), &look)?;
            let arrows = |rows: &[Row]| {
                Arrows3D::update_fields()
                    .with_origins(rows.iter().map(|row| xyz(&row.at)))
                    .with_vectors(rows.iter().map(|row| xyz(&(row.pull * length))))
                    .with_labels(rows.iter().map(|row| label(row.pull.norm(), unit)))
                    .columns_of_unit_batches()
            };
            let indices: Vec<usize> = rows.iter().map(|row| row.index).collect();
            stream.send_columns(entity.clone(), at(scene, &indices), arrows(rows)?)?;
            if !scene.steps.is_empty() && rows[0].index == 0 {
                stream.send_columns(entity, first_step(), arrows(&rows[..1])?)?;
            }
        }
    }
    Ok(())
}

fn label(size: f64, unit: &str) -> String {
    match size {
        0.0 => String::new(),
        size if size < 10.0 => format!("{size:.2} {unit}"),
        size => format!("{size:.1} {unit}"),
    }
}

/// One arrow of one reading.
struct Row {
    index: usize,
    /// m, link frame.
    at: Vector3<f64>,
    /// N (N·m), link frame.
    pull: Vector3<f64>,
}

/// What pulls at one target, reading by reading.
struct Pulls {
    forces: Vec<Row>,
    torques: Vec<Row>,
    weights: Vec<Row>,
}

impl Pulls {
    /// A pull stays while others are read in the same posture, as two wrists are in turn; then it is not known any more.
    fn of(scene: &Scene, target: usize, link: usize) -> Self {
        let campaign = &scene.recording.campaign;
        let mut pulls = Self {
            forces: Vec::new(),
            torques: Vec::new(),
            weights: Vec::new(),
        };
        let mut last: Option<&[f64]> = None;
        let all = &campaign.readings;
        for (index, reading) in all.iter().enumerate() {
            // the first reading of another target is this one's, too, if it was taken there
            let first = || {
                all.iter()
                    .find(|r| r.target == target)
                    .filter(|_| index == 0)
            };
            let here = |first: &&Reading| same(&first.joints, &reading.joints);
            let own = (reading.target == target).then_some(reading);
            if let Some(reading) = own.or_else(|| first().filter(here)) {
                last = Some(&reading.joints);
                let none = Vector3::zeros();
                let wrench = reading.wrench;
                let row = |at, pull| Row { index, at, pull };
                pulls
                    .forces
                    .push(row(none, wrench.map_or(none, |w| w.force)));
                pulls
                    .torques
                    .push(row(none, wrench.map_or(none, |w| w.torque)));
                let weight = reading.payload.map(|payload| {
                    let down = scene.nominal[index][link].rotation.inverse() * campaign.gravity;
                    (payload.com, down * payload.mass)
                });
                let (at, pull) = weight.unwrap_or((none, none));
                pulls.weights.push(row(at, pull));
            } else if last.is_none_or(|joints| !same(joints, &reading.joints)) {
                last = Some(&reading.joints);
                for rows in [&mut pulls.forces, &mut pulls.torques, &mut pulls.weights] {
                    rows.push(Row {
                        index,
                        at: Vector3::zeros(),
                        pull: Vector3::zeros(),
                    });
                }
            }
        }
        for rows in [&mut pulls.forces, &mut pulls.torques, &mut pulls.weights] {
            if rows.iter().all(|row| row.pull == Vector3::zeros()) {
                rows.clear();
            }
        }
        pulls
    }

    fn is_empty(&self) -> bool {
        self.forces.is_empty() && self.torques.is_empty() && self.weights.is_empty()
    }
}

fn same(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).all(|(a, b)| (a - b).abs() < 1e-3)
}
