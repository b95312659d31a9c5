//! Reading a scenario file.
//!
//! `robot`, `base`, `gravity`, `[[target]]`, `[frames]` and `[noise]` are written and checked as in a campaign
//! file; the rest is described in `scenarios/README.md`.

mod design;
mod layers;
mod truth;

pub(super) use truth::truths;

use super::design::Design;
use super::disturbance::Disturbance;
use super::expect::Expect;
use super::workspace::Workspace;
use super::{Job, Scenario, ScenarioError};
use crate::campaign::{Document, Noise, RobotFile};
use crate::effects::EffectList;
use crate::input::{self, LARGEST_TOML, MOST_READINGS};
use crate::robot::{Robot, RobotError};
use crate::scenario::blind::Blind;
use crate::setup::Setup;
use design::DesignEntry;
use layers::layered;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// What a scenario has beside the keys of a campaign file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct OwnKeys {
    #[serde(default)]
    title: String,
    note: Option<String>,
    seed: u64,
    #[serde(default)]
    truth: Vec<toml::Table>,
    design: DesignEntry,
    #[serde(default)]
    instruments: InstrumentsEntry,
    #[serde(default)]
    disturbance: Disturbance,
    effects: Option<Vec<String>>,
    model: Option<PathBuf>,
    campaigns: Option<usize>,
    #[serde(default)]
    compare_paper: bool,
    workspace: Option<Workspace>,
    compensate: Option<super::compensated::Compensate>,
    #[serde(rename = "loop")]
    control_loop: Option<super::control_loop::ControlLoop>,
    map: Option<crate::map::Request>,
    drill: Option<super::drill::Drilling>,
    #[serde(default)]
    instead: Vec<InsteadEntry>,
    #[serde(default)]
    expect: Expect,
    blind: Option<Blind>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct InsteadEntry {
    title: String,
    design: DesignEntry,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct InstrumentsEntry {
    /// Wrist wrenches among the readings.
    wrench: bool,
    /// The campaign file does not tell the noise.
    noise_unknown: bool,
    /// Orientations among the readings.
    orientation: bool,
}

impl Default for InstrumentsEntry {
    fn default() -> Self {
        Self {
            wrench: false,
            noise_unknown: false,
            orientation: true,
        }
    }
}

impl Scenario {
    /// Reads a scenario file; paths in it are relative to it.
    ///
    /// # Errors
    /// Whatever does not fit the format, with file and key, what was found and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ScenarioError> {
        let file = path.display().to_string();
        let form = |message: String| ScenarioError::form(&file, message);
        let Written {
            text,
            without_truth,
            document,
            mut own,
        } = Written::read(path, &file)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let robot_path = folder.join(&document.robot);
        let robot_name = robot_path.display().to_string();
        let loaded = Robot::load_with_text(&robot_path, document.base.as_deref());
        let (robot, robot_text) = loaded.map_err(|error: RobotError| {
            ScenarioError::Campaign(crate::campaign::CampaignError::from(error))
        })?;
        let settings = document.settle(&file, &robot)?;
        let setup = Setup::new(robot, settings.targets, settings.gravity);
        let (design, instead) = designs(&own, &setup).map_err(form)?;
        let effects = match &own.effects {
            Some(words) => EffectList::parse(&file, &words.join(","))?,
            None => EffectList::DEFAULT,
        };
        let truth = truths(&file, own.truth.clone(), &setup, own.seed)?;
        own.disturbance.check().map_err(form)?;
        if let Some(blind) = &own.blind {
            blind.check().map_err(form)?;
        }
        let job = job(&mut own).map_err(form)?;
        check_beside(&own, &job).map_err(form)?;
        job.check(&setup).map_err(form)?;
        own.expect.check(&job, &setup).map_err(form)?;
        Ok(Self {
            name: path
                .file_stem()
                .map_or_else(|| file.clone(), |stem| stem.to_string_lossy().into_owned()),
            file,
            title: own.title,
            note: own.note,
            text,
            without_truth,
            robot_file: RobotFile {
                name: robot_path
                    .file_name()
                    .map_or(robot_name, |name| name.to_string_lossy().into_owned()),
                text: robot_text,
                base: document.base.clone(),
            },
            seed: own.seed,
            truth,
            noise: settings.noise.unwrap_or_default(),
            state_noise: !own.instruments.noise_unknown && settings.noise.is_some_and(is_noisy),
            wrench: own.instruments.wrench,
            orientation: own.instruments.orientation,
            disturbance: own.disturbance,
            base_from_tracker: settings.base_from_tracker,
            link_from_target: settings.link_from_target,
            design,
            effects,
            model: own.model.map(|model| folder.join(model)),
            job,
            compare_paper: own.compare_paper,
            workspace: own.workspace,
            instead,
            expect: own.expect,
            blind: own.blind,
            truth_tables: own.truth,
            setup,
        })
    }
}

/// A scenario file, taken apart.
struct Written {
    text: String,
    without_truth: String,
    /// What it shares with campaign files.
    document: Document,
    own: OwnKeys,
}

impl Written {
    fn read(path: &Path, file: &str) -> Result<Self, ScenarioError> {
        let form = |message: String| ScenarioError::form(file, message);
        let text = read_text(path)?;
        let all: toml::Table = input::toml(&text).map_err(form)?;
        let (all, text) = layered(path, all, text)?;
        let without_truth = public(&all).map_err(|error| form(error.to_string()))?;
        let shared = ["robot", "base", "gravity", "target", "frames", "noise"];
        let (shared, own): (toml::Table, toml::Table) = all
            .into_iter()
            .partition(|(key, _)| shared.contains(&key.as_str()));
        let document = Document::from_table(file, shared)?;
        let own = own.try_into();
        let own = own.map_err(|error: toml::de::Error| form(plain(&error)))?;
        Ok(Self {
            text,
            without_truth,
            document,
            own,
        })
    }
}

/// The design, and those that the scenario is compared with.
fn designs(own: &OwnKeys, setup: &Setup) -> Result<(Design, Vec<(String, Design)>), String> {
    let checked = |entry: &DesignEntry| {
        let design = entry.design(setup)?;
        let readings = design.readings(setup.targets.len());
        match readings > MOST_READINGS {
            true => Err(format!(
                "the design asks for {readings} readings; accepted: at most {MOST_READINGS}"
            )),
            false => Ok(design),
        }
    };
    let instead = own.instead.iter();
    let instead = instead.map(|entry| Ok((entry.title.clone(), checked(&entry.design)?)));
    Ok((
        checked(&own.design)?,
        instead.collect::<Result<_, String>>()?,
    ))
}

/// Refuses what only a scenario that fits one campaign can do beside.
fn check_beside(own: &OwnKeys, job: &Job) -> Result<(), String> {
    let beside = [
        ("compare_paper", own.compare_paper),
        ("[workspace]", own.workspace.is_some()),
        ("[[instead]]", !own.instead.is_empty()),
    ];
    match beside.iter().find(|(_, given)| *given) {
        Some((key, _)) if !matches!(job, Job::Fit) => Err(format!(
            "{key} stands beside {}; accepted: in a scenario that fits one campaign",
            job.key()
        )),
        _ => Ok(()),
    }
}

/// What the scenario asks for, if not for a fit.
fn job(own: &mut OwnKeys) -> Result<Job, String> {
    let jobs = [
        own.campaigns.map(|campaigns| Job::Study { campaigns }),
        own.compensate.take().map(Job::Compensate),
        own.control_loop.take().map(Job::Loop),
        own.map.take().map(Job::Map),
        own.drill.take().map(Job::Drill),
    ];
    let mut jobs = jobs.into_iter().flatten();
    let Some(first) = jobs.next() else {
        return Ok(Job::Fit);
    };
    match jobs.next() {
        None => Ok(first),
        Some(second) => Err(format!(
            "{} stands beside {}; accepted: one of them in a scenario",
            second.key(),
            first.key()
        )),
    }
}

fn read_text(path: &Path) -> Result<String, ScenarioError> {
    input::text(path, LARGEST_TOML).map_err(|source| ScenarioError::Read {
        file: path.display().to_string(),
        source,
    })
}

/// The scenario without what scoring alone may read.
fn public(all: &toml::Table) -> Result<String, toml::ser::Error> {
    let kept = all.iter();
    let kept = kept
        .filter(|(key, _)| !["truth", "disturbance", "blind", "expect"].contains(&key.as_str()));
    let kept: toml::Table = kept.map(|(k, v)| (k.clone(), v.clone())).collect();
    toml::to_string(&kept)
}

/// A TOML error in a user's words.
fn plain(error: &toml::de::Error) -> String {
    input::toml_message(error, "").replace("expected usize", "expected a whole number, 0 or more")
}

/// A campaign that says "no noise at all" would be believed; one of a perfect plant says nothing.
fn is_noisy(noise: Noise) -> bool {
    noise.position > 0.0
}
