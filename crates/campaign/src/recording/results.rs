//! What a fit or a ladder found, reading by reading: written beside the campaign, read back for a replay.

use super::colour::colour;
use super::messages::{
    FitProgress, Float64MultiArray, MultiArrayDimension, PointCloud, PointField, PoseStamped, Rung,
    Text, TransformStamped, Transforms, Vector3Stamped,
};
use super::recorder::{Encoded, Recorder, channel, header, stamp};
use super::transforms::{pose, stamped, xyz, xyzw};
use crate::campaign::{Campaign, Reading};
use crate::robot::{Body, Robot};
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::{self, Seek, Write};

/// What models say of each reading of a campaign.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Results {
    /// The frames alone first, the final model last.
    pub steps: Vec<Step>,
    /// Links of the robot of the final model under load: by reading, then by link of the robot; base frame.
    pub links: Vec<Vec<Isometry3<f64>>>,
    /// Torque of the load about each joint's axis by the final model, N·m (N along a slide): by reading, then by joint.
    pub torques: Vec<Vec<f64>>,
    /// Steps of the solver.
    pub progress: Vec<Progress>,
    /// The verdict, Markdown; may be empty.
    pub verdict: String,
}

/// One step of a ladder, or one model of a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// `nominal` (frames alone), the effect added, or `fitted`.
    pub added: String,
    /// Position error of the fitted readings, rms, m.
    pub fitted_rms_m: f64,
    /// Of readings not fitted.
    pub heldout_rms_m: Option<f64>,
    /// Where this model has the tracker.
    pub base_from_tracker: Isometry3<f64>,
    /// Where it sees the target of each reading: tracker's frame.
    pub predicted: Vec<Isometry3<f64>>,
}

/// One step of the solver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Index of the step whose fit it is.
    pub step: usize,
    /// From 1.
    pub iteration: u32,
    /// Sum of squares of the whitened misfit, prior included.
    pub cost: f64,
}

pub(super) const NOMINAL_POSE: &str = "/prediction/nominal/pose";
pub(super) const FITTED_POSE: &str = "/prediction/fitted/pose";
const NOMINAL_RESIDUAL: &str = "/residual/nominal/position";
const FITTED_RESIDUAL: &str = "/residual/fitted/position";
const POSITION_NORMS: &str = "/residual/position_mm";
const ORIENTATION_NORMS: &str = "/residual/orientation_mrad";
pub(super) const LADDER_CLOUD: &str = "/ladder/cloud";
pub(super) const LADDER_RUNG: &str = "/ladder/rung";
const LADDER_ERROR: &str = "/ladder/error_mm";
pub(super) const FIT_PROGRESS: &str = "/fit/progress";
pub(super) const VERDICT: &str = "/verdict";
/// Before a link's name: the frame of that link of the fitted robot.
pub(super) const FITTED: &str = "fitted/";

/// Names, offsets and datatypes (7: 32-bit float, 6: 32-bit unsigned, 8: 64-bit float) of the fields of a rung's points:
/// where the tracker saw the target, its error, its colour, and the predicted pose in full precision.
const FIELDS: [(&str, u32, u8); 12] = [
    ("x", 0, 7),
    ("y", 4, 7),
    ("z", 8, 7),
    ("position_error_mm", 12, 7),
    ("rgb", 16, 6),
    ("predicted_x", 24, 8),
    ("predicted_y", 32, 8),
    ("predicted_z", 40, 8),
    ("predicted_qx", 48, 8),
    ("predicted_qy", 56, 8),
    ("predicted_qz", 64, 8),
    ("predicted_qw", 72, 8),
];
const FIRST_PREDICTED: usize = 24;
const POINT_STEP: usize = 80;

/// Ids of the channels.
pub(super) struct ResultChannels {
    nominal_pose: u16,
    fitted_pose: u16,
    nominal_residual: u16,
    fitted_residual: u16,
    position_norms: u16,
    orientation_norms: u16,
    cloud: u16,
    rung: u16,
    error: u16,
    progress: u16,
    verdict: u16,
}

impl ResultChannels {
    pub(super) fn add<W: Write + Seek>(writer: &mut mcap::Writer<W>) -> io::Result<Self> {
        Ok(Self {
            nominal_pose: channel::<PoseStamped, W>(writer, NOMINAL_POSE, false)?,
            fitted_pose: channel::<PoseStamped, W>(writer, FITTED_POSE, false)?,
            nominal_residual: channel::<Vector3Stamped, W>(writer, NOMINAL_RESIDUAL, false)?,
            fitted_residual: channel::<Vector3Stamped, W>(writer, FITTED_RESIDUAL, false)?,
            position_norms: channel::<Float64MultiArray, W>(writer, POSITION_NORMS, false)?,
            orientation_norms: channel::<Float64MultiArray, W>(writer, ORIENTATION_NORMS, false)?,
            cloud: channel::<PointCloud, W>(writer, LADDER_CLOUD, false)?,
            rung: channel::<Rung, W>(writer, LADDER_RUNG, false)?,
            error: channel::<Float64MultiArray, W>(writer, LADDER_ERROR, false)?,
            progress: channel::<FitProgress, W>(writer, FIT_PROGRESS, false)?,
            verdict: channel::<Text, W>(writer, VERDICT, true)?,
        })
    }
}

/// Do they fit the campaign?
pub(super) fn check(results: &Results, campaign: &Campaign) -> Result<(), String> {
    let readings = campaign.readings.len();
    let robot = &campaign.robot;
    if results.steps.is_empty() {
        return Err("results without a step".to_owned());
    }
    let by_reading = results.steps.iter().map(|step| step.predicted.len());
    let mut by_reading = by_reading.chain([results.links.len(), results.torques.len()]);
    if let Some(other) = by_reading.find(|count| *count != readings) {
        return Err(format!("results of {other} readings where {readings} are"));
    }
    let links = results.links.iter().any(|x| x.len() != robot.links.len());
    let torques = results
        .torques
        .iter()
        .any(|x| x.len() != robot.joints.len());
    if links || torques {
        return Err("results of another robot".to_owned());
    }
    match results
        .progress
        .iter()
        .any(|p| p.step >= results.steps.len())
    {
        true => Err("progress of a step that is not there".to_owned()),
        false => Ok(()),
    }
}

/// Frames of the bodies of the fitted robot that its links stand in, each in that of the body before it; the first body's
/// in the nominal one.
pub(super) fn fitted_bodies(robot: &Robot, links: &[Isometry3<f64>]) -> Vec<Isometry3<f64>> {
    let of = |body: usize| {
        let mut own = robot.links.iter().zip(links);
        let own = own.find(|(link, _)| link.body == body);
        own.map_or_else(Isometry3::identity, |(link, pose)| {
            pose * link.body_from_link.inverse() * robot.body_from_frame(body)
        })
    };
    let frames: Vec<Isometry3<f64>> = (0..robot.bodies.len()).map(of).collect();
    let before = |body: usize| match body {
        0 => robot.body_from_frame(0),
        _ => frames[robot.joints[body - 1].parent],
    };
    let each = frames.iter().enumerate();
    each.map(|(body, frame)| before(body).inverse() * frame)
        .collect()
}

/// Some of these frames; `names` are those of [`fitted_names`].
pub(super) fn fitted_frames<'a>(
    robot: &'a Robot,
    names: &'a [String],
    bodies: &[Isometry3<f64>],
    time: u64,
    wanted: impl Fn(usize) -> bool,
) -> Vec<TransformStamped<'a>> {
    let wanted = (0..bodies.len()).filter(|body| wanted(*body));
    let frame = |body: usize| {
        let parent = match body {
            0 => &robot.bodies[0].name,
            _ => &names[robot.joints[body - 1].parent],
        };
        stamped(stamp(time), parent, &names[body], &bodies[body])
    };
    wanted.map(frame).collect()
}

/// Names of the frames of the fitted robot's bodies.
pub(super) fn fitted_names(robot: &Robot) -> Vec<String> {
    let name = |body: &Body| format!("{FITTED}{}", body.name);
    robot.bodies.iter().map(name).collect()
}

/// What the first and the last model say of one reading, in the frame called `tracker`.
pub(super) fn predictions(
    channels: &ResultChannels,
    results: &Results,
    (index, reading): (usize, &Reading),
    time: u64,
    tracker: &str,
    out: &mut Encoded,
) -> io::Result<()> {
    let (Some(first), Some(last)) = (results.steps.first(), results.steps.last()) else {
        return Ok(());
    };
    let models = [
        (first, channels.nominal_pose, channels.nominal_residual),
        (last, channels.fitted_pose, channels.fitted_residual),
    ];
    let mut positions = Vec::with_capacity(models.len());
    let mut orientations = Vec::with_capacity(models.len());
    for (step, pose_channel, residual_channel) in models {
        let predicted = &step.predicted[index];
        let message = PoseStamped {
            header: header(time, tracker),
            position: xyz(&predicted.translation.vector),
            orientation: xyzw(&predicted.rotation),
        };
        out.add(pose_channel, &message)?;
        let residual = reading.position - predicted.translation.vector;
        let message = Vector3Stamped {
            header: header(time, tracker),
            vector: xyz(&residual),
        };
        out.add(residual_channel, &message)?;
        positions.push(1e3 * residual.norm());
        if let Some(measured) = reading.orientation {
            orientations.push(1e3 * measured.angle_to(&predicted.rotation));
        }
    }
    let labels = ["nominal", "fitted"];
    let message = array(&labels, positions);
    out.add(channels.position_norms, &message)?;
    if !orientations.is_empty() {
        let message = array(&labels, orientations);
        out.add(channels.orientation_norms, &message)?;
    }
    Ok(())
}

impl<W: Write + Seek> Recorder<W> {
    /// The steps: the first at `start`, so that a viewer has it from the beginning, the others a second each after `end`;
    /// then the verdict.
    pub(super) fn steps(
        &mut self,
        channels: &ResultChannels,
        campaign: &Campaign,
        results: &Results,
        (start, end): (u64, u64),
        tracker: &str,
    ) -> io::Result<()> {
        let base = &campaign.robot.bodies.first().map_or("base", |b| &b.name);
        let from_base = campaign.robot.body_from_frame(0).inverse();
        let most = results.steps.first().map_or(0.0, |first| {
            let errors = errors(campaign, first);
            errors.fold(0.0, f64::max)
        });
        let mut sequence = 0;
        for (index, step) in results.steps.iter().enumerate() {
            const SECOND: u64 = 1_000_000_000;
            let number = u32::try_from(index).map_err(io::Error::other)?;
            let time = match index {
                0 => start,
                later => end + later as u64 * SECOND,
            };
            let frame = from_base * step.base_from_tracker;
            let rung = Rung {
                header: header(time, base),
                added: Cow::Borrowed(&step.added),
                fitted_rms_m: step.fitted_rms_m,
                heldout_rms_m: step.heldout_rms_m.into_iter().collect(),
                position: xyz(&frame.translation.vector),
                orientation: xyzw(&frame.rotation),
            };
            self.message(channels.rung, number, time, &rung)?;
            let rms: Vec<f64> = std::iter::once(step.fitted_rms_m)
                .chain(step.heldout_rms_m)
                .map(|rms| 1e3 * rms)
                .collect();
            let error = array(&["fitted", "not fitted"][..rms.len()], rms);
            self.message(channels.error, number, time, &error)?;
            let cloud = cloud(campaign, step, most, time, tracker)?;
            self.message(channels.cloud, number, time, &cloud)?;
            let own = results.progress.iter().filter(|p| p.step == index);
            for (place, progress) in own.enumerate() {
                // a millisecond apart: many steps fit between two rungs
                let time = time + place as u64 * 1_000_000;
                let progress = FitProgress {
                    header: header(time, base),
                    rung: number,
                    iteration: progress.iteration,
                    cost: progress.cost,
                };
                self.message(channels.progress, sequence, time, &progress)?;
                sequence += 1;
            }
        }
        let verdict = Text {
            data: results.verdict.clone(),
        };
        self.message(channels.verdict, 0, start, &verdict)
    }
}

fn errors<'a>(campaign: &'a Campaign, step: &'a Step) -> impl Iterator<Item = f64> + 'a {
    let pairs = campaign.readings.iter().zip(&step.predicted);
    pairs.map(|(reading, predicted)| (reading.position - predicted.translation.vector).norm())
}

/// Colours by the error, all steps on the scale of the first: `most`, m, is its last colour.
fn cloud<'a>(
    campaign: &Campaign,
    step: &Step,
    most: f64,
    time: u64,
    tracker: &'a str,
) -> io::Result<PointCloud<'a>> {
    let mut data = Vec::with_capacity(campaign.readings.len() * POINT_STEP);
    let pairs = campaign.readings.iter().zip(&step.predicted);
    for ((reading, predicted), error) in pairs.zip(errors(campaign, step)) {
        let seen = &reading.position;
        for number in [seen.x, seen.y, seen.z, 1e3 * error] {
            data.extend((number as f32).to_le_bytes());
        }
        let [r, g, b] = colour(if most > 0.0 { error / most } else { 0.0 });
        data.extend([b, g, r, 0, 0, 0, 0, 0]);
        let (t, q) = (&predicted.translation.vector, &predicted.rotation);
        for number in [t.x, t.y, t.z, q.i, q.j, q.k, q.w] {
            data.extend(number.to_le_bytes());
        }
    }
    let fields = FIELDS.iter().map(|&(name, offset, datatype)| PointField {
        name: name.to_owned(),
        offset,
        datatype,
        count: 1,
    });
    PointCloud::of(header(time, tracker), fields.collect(), POINT_STEP, data)
}

/// The predicted poses of a rung's points.
pub(super) fn predicted(cloud: &PointCloud<'_>) -> Result<Vec<Isometry3<f64>>, String> {
    let fields = cloud.fields.iter();
    let fields = fields.map(|field| (field.name.as_str(), field.offset, field.datatype));
    let known = fields.eq(FIELDS) && !cloud.is_bigendian && cloud.point_step as usize == POINT_STEP;
    let count = cloud.width as usize * cloud.height as usize;
    if !known || cloud.data.len() != count.saturating_mul(POINT_STEP) {
        return Err("points of another layout; accepted: as misfit writes them".to_owned());
    }
    let mut poses = Vec::with_capacity(count);
    for point in cloud.data.chunks_exact(POINT_STEP) {
        let numbers = point[FIRST_PREDICTED..].as_chunks::<8>().0;
        let mut n = numbers.iter().map(|bytes| f64::from_le_bytes(*bytes));
        let mut next = || n.next().unwrap_or(f64::NAN);
        let translation = Translation3::new(next(), next(), next());
        let (x, y, z, w) = (next(), next(), next(), next());
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z));
        poses.push(Isometry3::from_parts(translation, rotation));
    }
    Ok(poses)
}

/// A step from its two messages.
pub(super) fn step(rung: Rung<'_>, cloud: &PointCloud<'_>, robot: &Robot) -> Result<Step, String> {
    let frame = pose(&rung.position, &rung.orientation)?;
    Ok(Step {
        base_from_tracker: robot.body_from_frame(0) * frame,
        predicted: predicted(cloud)?,
        added: rung.added.into_owned(),
        fitted_rms_m: rung.fitted_rms_m,
        heldout_rms_m: rung.heldout_rms_m.first().copied(),
    })
}

/// The frames of the fitted robot's links, by link of the robot, in the base frame: from those of its bodies, which stand
/// in a message on /tf, or in one on /tf_static if they do not move.
pub(super) fn links(
    robot: &Robot,
    moving: &Transforms<'_>,
    fixed: &BTreeMap<String, TransformStamped<'_>>,
) -> Result<Vec<Isometry3<f64>>, String> {
    let mut frames: Vec<Isometry3<f64>> = Vec::with_capacity(robot.bodies.len());
    for (index, name) in fitted_names(robot).iter().enumerate() {
        let mut moving = moving.transforms.iter();
        let found = moving.find(|t| t.child_frame_id == *name);
        let found = found.or_else(|| fixed.get(name));
        let found = found.ok_or_else(|| format!("no frame {name:?} on /tf or /tf_static"))?;
        // in that of the body before it, or in the base
        let before = match (index, found.header.frame_id.starts_with(FITTED)) {
            (1.., true) => frames[robot.joints[index - 1].parent],
            _ => robot.body_from_frame(0),
        };
        frames.push(before * pose(&found.translation, &found.rotation)?);
    }
    let back =
        |(body, frame): (usize, &Isometry3<f64>)| frame * robot.body_from_frame(body).inverse();
    let bodies: Vec<Isometry3<f64>> = frames.iter().enumerate().map(back).collect();
    let links = robot.links.iter();
    Ok(links.map(|l| bodies[l.body] * l.body_from_link).collect())
}

fn array(labels: &[&str], data: Vec<f64>) -> Float64MultiArray {
    Float64MultiArray {
        dim: vec![MultiArrayDimension {
            label: labels.join(", "),
            size: data.len() as u32,
            stride: data.len() as u32,
        }],
        data_offset: 0,
        data,
    }
}
