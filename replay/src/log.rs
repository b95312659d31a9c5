//! Shorter ways to log: the timelines, entity names, and numbers as Rerun has them.

use crate::Scene;
use nalgebra::{Isometry3, Vector3};
use rerun::{
    AsComponents, EntityPath, EntityPathPart, RecordingStream, RecordingStreamResult,
    SerializedComponentColumn, TimeColumn, Transform3D,
};

/// Timeline: number of the reading, from 0.
pub const READING: &str = "reading";
/// Timeline: s.
pub const TIME: &str = "time";
/// Timeline: step of the ladder, from 0.
pub const STEP: &str = "step";

pub type Logged = RecordingStreamResult<()>;

/// An entity's name of parts that may hold any character.
pub fn path<'a>(parts: impl IntoIterator<Item = &'a str>) -> EntityPath {
    parts.into_iter().map(EntityPathPart::new).collect()
}

/// The same as text, for the layout.
pub fn text<'a>(parts: impl IntoIterator<Item = &'a str>) -> String {
    path(parts).to_string()
}

/// Both timelines of the readings at these indices.
pub fn at(scene: &Scene, indices: &[usize]) -> [TimeColumn; 2] {
    [
        TimeColumn::new_sequence(READING, indices.iter().map(|i| *i as i64)),
        TimeColumn::new_duration_secs(TIME, indices.iter().map(|i| scene.times[*i])),
    ]
}

/// Both timelines at every reading.
pub fn everywhere(scene: &Scene) -> [TimeColumn; 2] {
    let all: Vec<usize> = (0..scene.times.len()).collect();
    at(scene, &all)
}

/// Both timelines of the readings where they begin: what is logged here alone stays all along.
pub fn beginning(scene: &Scene) -> [TimeColumn; 2] {
    let earliest = scene.times.iter().copied().fold(f64::INFINITY, f64::min);
    [
        TimeColumn::new_sequence(READING, [0]),
        TimeColumn::new_duration_secs(TIME, [if earliest.is_finite() { earliest } else { 0.0 }]),
    ]
}

/// The timeline of steps, from 0.
pub fn steps(count: usize) -> [TimeColumn; 1] {
    [TimeColumn::new_sequence(STEP, 0..count as i64)]
}

/// The first step alone: what stays there while steps go by.
pub fn first_step() -> [TimeColumn; 1] {
    steps(1)
}

/// Logs something that never changes.
pub fn fixed(
    stream: &RecordingStream,
    path: impl Into<EntityPath>,
    what: &dyn AsComponents,
) -> Logged {
    stream.log_static(path, what)
}

/// Poses of one entity, one a row.
pub fn poses(
    poses: impl Iterator<Item = Isometry3<f64>> + Clone,
) -> Result<Vec<SerializedComponentColumn>, rerun::SerializationError> {
    let columns = Transform3D::update_fields()
        .with_many_translation(poses.clone().map(|pose| xyz(&pose.translation.vector)))
        .with_many_quaternion(poses.map(|pose| quaternion(&pose)))
        .columns_of_unit_batches()?;
    Ok(columns.collect())
}

/// Poses of one entity at every reading, and the first of them on the timeline of steps.
pub fn moving(
    stream: &RecordingStream,
    scene: &Scene,
    path: &EntityPath,
    all: impl Iterator<Item = Isometry3<f64>> + Clone,
) -> Logged {
    stream.send_columns(path.clone(), everywhere(scene), poses(all.clone())?)?;
    if scene.steps.is_empty() {
        return Ok(());
    }
    stream.send_columns(path.clone(), first_step(), poses(all.take(1))?)
}

/// Three numbers in single precision: 0.1 µm at 1 m.
pub fn xyz(vector: &Vector3<f64>) -> [f32; 3] {
    [vector.x as f32, vector.y as f32, vector.z as f32]
}

/// x, y, z, w.
pub fn quaternion(pose: &Isometry3<f64>) -> rerun::Quaternion {
    let q = pose.rotation.coords;
    rerun::Quaternion::from_xyzw([q.x as f32, q.y as f32, q.z as f32, q.w as f32])
}
