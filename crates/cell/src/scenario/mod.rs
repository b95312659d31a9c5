//! Scenarios: a robot, its hidden truth, a measurement campaign, the model to fit, and what is expected.

pub mod blind;
pub mod compensated;
pub mod control_loop;
pub mod design;
pub mod disturbance;
pub mod drill;
pub mod efficiency;
pub mod expect;
pub mod mapped;
mod planned;
mod presets;
pub mod pull;
mod read;
pub mod simulate;
mod tool;
pub mod workspace;

pub use planned::planned;
pub use tool::Tool;

use crate::campaign::{Frame, Noise, RobotFile};
use crate::effects::{AnyEffect, EffectList};
use crate::plant::PlantError;
use crate::scenario::blind::Blind;
use crate::setup::Setup;
use design::Design;
use expect::Expect;
use std::path::PathBuf;
use std::sync::Arc;

/// A scenario as read.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// Path as the user wrote it, for messages.
    pub file: String,
    /// File stem.
    pub name: String,
    /// One line for its reader.
    pub title: String,
    /// A remark to be printed with the survey of the workspace.
    pub note: Option<String>,
    /// The scenario file's own text; in layers, both.
    pub text: String,
    /// The same without truth and expectations, to be carried along in recordings.
    pub without_truth: String,
    /// Robot, targets, gravity.
    pub setup: Setup,
    /// The robot file's own text.
    pub robot_file: RobotFile,
    /// Every random number follows from this.
    pub seed: u64,
    /// What the plant has and the fit never sees.
    pub truth: Vec<Truth>,
    /// Noise of the instruments and joints.
    pub noise: Noise,
    /// Does the campaign file tell the noise?
    pub state_noise: bool,
    /// Are wrist wrenches among the readings?
    pub wrench: bool,
    /// Are orientations? A single reflector gives none.
    pub orientation: bool,
    /// What goes wrong while it is measured.
    pub disturbance: disturbance::Disturbance,
    /// What the campaign file says of the frames.
    pub base_from_tracker: Frame,
    /// The same, by target.
    pub link_from_target: Vec<Frame>,
    /// Poses, loads, directions, repeats.
    pub design: Design,
    /// Effects of the model.
    pub effects: EffectList,
    /// Model file as for `--model`, if one is named.
    pub model: Option<PathBuf>,
    /// What it does beside simulating.
    pub job: Job,
    /// Also estimate by the paper's method, to compare?
    pub compare_paper: bool,
    /// Survey of the plant's deflection over its workspace, if wanted.
    pub workspace: Option<workspace::Workspace>,
    /// Other designs, to say what they could do instead: title and design.
    pub instead: Vec<(String, Design)>,
    /// What must come out.
    pub expect: Expect,
    /// Blind cases to draw from it, if it is a sweep.
    pub blind: Option<Blind>,
    /// The `[[truth]]` tables, to be drawn anew.
    truth_tables: Vec<toml::Table>,
}

impl Scenario {
    /// The same scenario with another seed: other poses, noise and random truths.
    ///
    /// # Errors
    /// Never for a scenario that was read; the type is that of reading it.
    pub fn redrawn(&self, seed: u64) -> Result<Self, ScenarioError> {
        let mut other = self.clone();
        other.seed = seed;
        other.truth = read::truths(&self.file, self.truth_tables.clone(), &self.setup, seed)?;
        Ok(other)
    }

    /// What its file says does not do.
    fn form_error(&self, message: impl Into<String>) -> ScenarioError {
        ScenarioError::form(&self.file, message)
    }

    /// Its plant cannot be built, or collapses.
    pub(crate) fn plant_error(&self, source: PlantError) -> ScenarioError {
        ScenarioError::Plant {
            file: self.file.clone(),
            source,
        }
    }
}

/// What a scenario does: one thing.
#[expect(clippy::large_enum_variant, reason = "one per scenario")]
#[derive(Debug, Clone)]
pub enum Job {
    /// Fits one campaign.
    Fit,
    /// Fits many campaigns, to compare their spread with the Cramér-Rao bound.
    Study {
        /// How many.
        campaigns: usize,
    },
    /// Commands poses with and without correction.
    Compensate(compensated::Compensate),
    /// Holds poses in a control loop.
    Loop(control_loop::ControlLoop),
    /// Maps the workspace.
    Map(crate::map::Request),
    /// Drills a board with two arms.
    Drill(drill::Drilling),
}

impl Job {
    /// The key by which a scenario asks for it.
    pub fn key(&self) -> &'static str {
        match self {
            Job::Fit => "effects",
            Job::Study { .. } => "campaigns",
            Job::Compensate(_) => "[compensate]",
            Job::Loop(_) => "[loop]",
            Job::Map(_) => "[map]",
            Job::Drill(_) => "[drill]",
        }
    }

    /// Refuses what cannot be done.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is accepted.
    fn check(&self, setup: &Setup) -> Result<(), String> {
        /// Of an efficiency study.
        const MAX_CAMPAIGNS: usize = 1_000_000;
        match self {
            Job::Fit => Ok(()),
            Job::Study { campaigns } if (1..=MAX_CAMPAIGNS).contains(campaigns) => Ok(()),
            Job::Study { .. } => Err(format!("campaigns: accepted are 1 to {MAX_CAMPAIGNS}")),
            Job::Compensate(wanted) => wanted.check(),
            Job::Loop(wanted) => wanted.check(setup),
            Job::Map(wanted) => wanted.check(setup),
            Job::Drill(wanted) => wanted.check(setup),
        }
    }
}

/// A hidden effect: its parameters in the plant.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The effect.
    pub effect: Arc<dyn AnyEffect>,
    /// Names and values of its parameters, SI.
    pub values: Vec<(String, f64)>,
}

/// Why there is no scenario, or nothing came of it.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// A file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// The file.
        file: String,
        /// Reason.
        source: crate::input::InputError,
    },
    /// Not TOML of this form.
    #[error("{file}: {message}")]
    Form {
        /// The file.
        file: String,
        /// What is wrong, where, and what is accepted.
        message: String,
    },
    /// What it shares with campaign files: robot, targets, frames, noise.
    #[error(transparent)]
    Campaign(#[from] crate::campaign::CampaignError),
    /// Its truth.
    #[error(transparent)]
    Table(#[from] crate::effects::table::TableError),
    /// The plant.
    #[error("{file}: {source}")]
    Plant {
        /// Scenario file.
        file: String,
        /// Reason.
        source: PlantError,
    },
}

impl ScenarioError {
    fn form(file: &str, message: impl Into<String>) -> Self {
        let (file, message) = (file.to_owned(), message.into());
        Self::Form { file, message }
    }
}
