//! Writing maps of the workspace as a recording: points with their errors, and the robot in its posture of reference.

use super::colour::colour;
use super::error::RecordingError;
use super::messages::{PointCloud, PointField, Text, Transforms};
use super::recorder::{Recorder, channel, header, stamp, writer};
use super::transforms::{links, moving};
use super::{ROBOT_DESCRIPTION, RUN_RECORD, TF, TF_STATIC, description};
use crate::campaign::{RobotFile, write_atomically};
use crate::robot::Robot;
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::io::{self, Seek, Write};
use std::path::Path;

/// Points of one map.
#[derive(Debug, Clone, PartialEq)]
pub struct Cloud {
    /// Last part of its topic, `/map/<name>`.
    pub name: String,
    /// In the base frame, m, with the errors of position (m) and orientation (rad).
    pub points: Vec<(Vector3<f64>, f64, f64)>,
}

/// Names, offsets and datatypes (7: 32-bit float, 6: 32-bit unsigned) of a point's fields.
const FIELDS: [(&str, u32, u8); 6] = [
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("position_error_mm", 12, 7),
    ("orientation_error_mrad", 16, 7),
    ("rgb", 20, 6),
];
const POINT_STEP: usize = 24;

/// Writes clouds as an MCAP file of the `ros2` profile, coloured by the position's error; `joints` is the posture in which
/// the robot is shown, rad (m), `metadata` becomes the record `run`. The same arguments give the same bytes.
///
/// # Errors
/// What the file system says.
pub fn write_clouds(
    (robot, file): (&Robot, &RobotFile),
    joints: &[f64],
    clouds: &[Cloud],
    path: &Path,
    metadata: &BTreeMap<String, String>,
) -> Result<(), RecordingError> {
    write_atomically(path, |out| {
        fill((robot, file), joints, clouds, out, metadata)
    })
    .map_err(|source| RecordingError::Write {
        file: path.display().to_string(),
        source,
    })
}

fn fill(
    (robot, file): (&Robot, &RobotFile),
    joints: &[f64],
    clouds: &[Cloud],
    out: impl Write + Seek,
    metadata: &BTreeMap<String, String>,
) -> io::Result<()> {
    let mut recorder = Recorder {
        writer: writer(out)?,
    };
    recorder.metadata(RUN_RECORD, metadata.clone())?;
    recorder.attach(&file.name, file.text.as_bytes())?;
    let base = robot.bodies.first().map_or("base", |body| &body.name);
    let topic = channel::<Text, _>(&mut recorder.writer, ROBOT_DESCRIPTION, true)?;
    let data = description::urdf(robot, file);
    recorder.message(topic, 0, 0, &Text { data })?;
    let topic = channel::<Transforms, _>(&mut recorder.writer, TF_STATIC, true)?;
    let transforms = links(robot, "", stamp(0));
    recorder.message(topic, 0, 0, &Transforms { transforms })?;
    let topic = channel::<Transforms, _>(&mut recorder.writer, TF, false)?;
    let transforms = moving(robot, joints, stamp(0), |_| true);
    recorder.message(topic, 0, 0, &Transforms { transforms })?;
    for cloud in clouds {
        let topic = format!("/map/{}", cloud.name);
        let topic = channel::<PointCloud, _>(&mut recorder.writer, &topic, true)?;
        recorder.message(topic, 0, 0, &message(cloud, base)?)?;
    }
    recorder.writer.finish().map_err(io::Error::other)?;
    Ok(())
}

fn message<'a>(cloud: &Cloud, base: &'a str) -> io::Result<PointCloud<'a>> {
    let most = cloud.points.iter().map(|p| p.1).fold(0.0, f64::max);
    let mut data = Vec::with_capacity(cloud.points.len() * POINT_STEP);
    for (point, position, orientation) in &cloud.points {
        let numbers = [point.x, point.y, point.z, position * 1e3, orientation * 1e3];
        for number in numbers {
            data.extend((number as f32).to_le_bytes());
        }
        let [r, g, b] = colour(if most > 0.0 { position / most } else { 0.0 });
        data.extend([b, g, r, 0]);
    }
    let fields = FIELDS.iter().map(|&(name, offset, datatype)| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    });
    PointCloud::of(header(0, base), fields.collect(), POINT_STEP, data)
}
