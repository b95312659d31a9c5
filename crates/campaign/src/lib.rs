//! What was measured: readings of targets on a robot's links, and what is known of how they were taken.
//!
//! A campaign holds readings only; the truth of a simulated one never enters it.

#[cfg(feature = "mcap")]
pub mod bag;
mod check;
mod columns;
mod condition;
mod decimal;
mod delimited;
mod document;
mod encoding;
mod error;
mod files;
mod keys;
mod layout;
mod mapping;
pub mod numbers;
mod open;
mod orientation;
mod read;
#[cfg(feature = "mcap")]
pub mod recording;
mod render;
mod row;
mod rows;
pub mod setup;
pub mod space;
mod split;
mod table;
mod units;
#[cfg(feature = "xlsx")]
mod workbook;
mod write;

pub use condition::{Condition, conditions, pose_key, repeats};
pub use document::Settings;
pub use error::CampaignError;
pub use read::{Tasks, read_tasks};

pub use check::plain_file_name;
pub use document::{Document, render as render_document};
pub use files::folder_of;
pub use files::write_atomically;
pub use keys::Keys;
pub use orientation::unit_quaternion;
pub use read::read_toml;
pub use render::render_commands;
pub use units::to_inner;

pub use open::LoadError;

use crate as campaign;
use misfit_arm::{input, robot};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use robot::Robot;

/// A set of readings with the robot they were taken on. SI units, radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Campaign {
    /// File name, for titles and messages.
    pub name: String,
    /// The nominal robot.
    pub robot: Robot,
    /// The robot file as read, to be carried along in recordings.
    pub robot_file: RobotFile,
    /// Gravity in the base frame, m/s².
    pub gravity: Vector3<f64>,
    /// What the tracker sees.
    pub targets: Vec<Target>,
    /// Where the tracker stands in the robot's base frame.
    pub base_from_tracker: Frame,
    /// Where each target sits on its link, by index of `targets`.
    pub link_from_target: Vec<Frame>,
    /// What the campaign file says of the noise.
    pub noise: Option<Noise>,
    /// The readings in the order of the table.
    pub readings: Vec<Reading>,
    /// What the reader has to tell its user: joints without a column, and the like.
    pub warnings: Vec<String>,
    /// What the reader left out as the campaign file says: columns that are not named, and the like.
    pub notes: Vec<String>,
}

/// The robot file's own text.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotFile {
    /// File name without folders; the ending tells URDF from TOML.
    pub name: String,
    /// Its whole text.
    pub text: String,
    /// The base link named by the campaign, if not the file's root.
    pub base: Option<String>,
}

/// What the tracker sees: a reflector or 6D probe on a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// Name as in the column `target`.
    pub name: String,
    /// Index into `robot.links`.
    pub link: usize,
}

/// A frame that is known, or to be estimated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Frame {
    /// Part of the model, found by the fit.
    Estimate,
    /// Held at this pose.
    Known(Isometry3<f64>),
}

/// One standard deviation of each source of noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Noise {
    /// Tracker, each axis (across the beam if `radial_*` is given), m.
    pub position: f64,
    /// Grows with the distance to the tracker, m per m.
    pub position_per_metre: f64,
    /// Along the beam, m; the same as `position` if the file does not say.
    pub radial: f64,
    /// Along the beam, m per m; the same as `position_per_metre` if the file does not say.
    pub radial_per_metre: f64,
    /// Target orientation, each axis, rad.
    pub orientation: f64,
    /// Repeatability of each joint, rad (m for a prismatic one); adds sigma² J Jᵀ.
    pub joint: f64,
    /// Force columns, N.
    pub force: f64,
    /// Torque columns, N·m.
    pub torque: f64,
}

impl Noise {
    /// The same, so many times as large.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            position: self.position * factor,
            position_per_metre: self.position_per_metre * factor,
            radial: self.radial * factor,
            radial_per_metre: self.radial_per_metre * factor,
            orientation: self.orientation * factor,
            joint: self.joint * factor,
            force: self.force * factor,
            torque: self.torque * factor,
        }
    }
}

/// To fit with, or only to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Split {
    /// Used to fit.
    #[default]
    Fit,
    /// Never used to fit, to choose or to stop.
    Heldout,
}

/// One reading of one target.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    /// Line in the table (the header is line 1), for messages.
    pub line: usize,
    /// Label: readings with the same label were commanded to the same joints.
    pub pose: Option<String>,
    /// Label of the repeat.
    pub repeat: Option<String>,
    /// Index into `targets`.
    pub target: usize,
    /// Fitted or held out.
    pub split: Split,
    /// s.
    pub time: Option<f64>,
    /// Of the whole robot, °C.
    pub temperature: Option<f64>,
    /// Of single links: (index into `robot.links`, °C).
    pub link_temperatures: Vec<(usize, f64)>,
    /// Encoder angles of all moving joints, in the order of `robot.joints`, rad or m.
    pub joints: Vec<f64>,
    /// Direction of each joint's last motion: -1, 0, +1.
    pub approach: Option<Vec<f64>>,
    /// Target position in the tracker's frame, m.
    pub position: Vector3<f64>,
    /// tracker_from_target rotation.
    pub orientation: Option<UnitQuaternion<f64>>,
    /// Wrench of the load on the arm at the target link's origin, in that link's frame.
    pub wrench: Option<Wrench>,
    /// Known dead weight on the target link.
    pub payload: Option<Payload>,
    /// What pulls at the arm beside the payload's weight (a cutting force), as `wrench`: no column has it, tasks do.
    pub process: Option<Wrench>,
}

impl Reading {
    /// One still to be taken, with a target at joint angles, rad (m): nothing hangs there, nothing is measured.
    pub fn to_be(target: usize, joints: Vec<f64>) -> Self {
        Self {
            line: 0,
            pose: None,
            repeat: None,
            target,
            split: Split::Fit,
            time: None,
            temperature: None,
            link_temperatures: Vec::new(),
            joints,
            approach: None,
            position: Vector3::zeros(),
            orientation: None,
            wrench: None,
            payload: None,
            process: None,
        }
    }
}

/// Force in N and torque in N·m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench {
    /// N.
    pub force: Vector3<f64>,
    /// N·m.
    pub torque: Vector3<f64>,
}

/// A dead weight fixed to the target's link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// kg.
    pub mass: f64,
    /// Centre of mass in the target link's frame, m.
    pub com: Vector3<f64>,
}

/// Repeats are believed from this many degrees of freedom on.
pub const MIN_REPEAT_DOF: usize = 12;

/// Is the wrench of a reading measured beside a known load?
pub fn wrench_is_measured(reading: &Reading) -> bool {
    reading.payload.is_some() && reading.wrench.is_some()
}
