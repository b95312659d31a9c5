//! Reading a scenario file.
//!
//! `robot`, `base`, `gravity`, `[[target]]`, `[frames]` and `[noise]` are written and checked as in a campaign
//! file; the rest is described in `scenarios/README.md`.

use super::design::{Design, DesignLoad, WarmUp, stream};
use super::expect::Expect;
use super::workspace::Workspace;
use super::{Job, Scenario, ScenarioError, Truth, presets};
use crate::campaign::{Document, Noise, RobotFile};
use crate::effects::table::{Choice, TableError, check_count, unique};
use crate::effects::{EffectList, Role};
use crate::input::{self, LARGEST_TOML, MOST_READINGS};
use crate::robot::{Robot, RobotError};
use crate::scenario::blind::Blind;
use crate::setup::Setup;
use crate::space::{Space, generator};
use nalgebra::Vector3;
use rand::RngExt;
use rand_distr::StandardNormal;
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
    disturbance: super::disturbance::Disturbance,
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
struct DesignEntry {
    poses: usize,
    #[serde(default)]
    heldout_poses: usize,
    #[serde(default)]
    loads: Vec<LoadEntry>,
    #[serde(default = "one")]
    directions: usize,
    #[serde(default = "one")]
    repeats: usize,
    #[serde(default)]
    order: Order,
    #[serde(default = "tenth")]
    margin: f64,
    #[serde(default)]
    least_height_m: f64,
    #[serde(default)]
    fixed_rad: toml::map::Map<String, toml::Value>,
    temperature: Option<WarmUpEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
struct WarmUpEntry {
    #[serde(default = "twenty")]
    start_degC: f64,
    warm_up_K: f64,
    warm_up_s: f64,
}

#[derive(Debug, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
enum Order {
    #[default]
    Random,
    PoseByPose,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
struct LoadEntry {
    #[serde(default)]
    mass_kg: f64,
    #[serde(default)]
    com_m: [f64; 3],
    #[serde(default)]
    pull_N: [f64; 3],
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

fn one() -> usize {
    1
}

fn twenty() -> f64 {
    20.0
}

fn tenth() -> f64 {
    0.1
}

impl Scenario {
    /// Reads a scenario file; paths in it are relative to it.
    ///
    /// # Errors
    /// Whatever does not fit the format, with file and key, what was found and what is accepted.
    pub fn load(path: &Path) -> Result<Self, ScenarioError> {
        let file = path.display().to_string();
        let form = |message: String| ScenarioError::Form {
            file: file.clone(),
            message,
        };
        let text = read_text(path)?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let all: toml::Table = input::toml(&text).map_err(&form)?;
        let (all, text) = layered(&file, folder, all, text)?;
        let without_truth = public(&all).map_err(|error| form(error.to_string()))?;
        let shared = ["robot", "base", "gravity", "target", "frames", "noise"];
        let (shared, own): (toml::Table, toml::Table) = all
            .into_iter()
            .partition(|(key, _)| shared.contains(&key.as_str()));
        let document = Document::from_table(&file, shared)?;
        let mut own: OwnKeys = own
            .try_into()
            .map_err(|error: toml::de::Error| form(plain(&error)))?;
        let robot_path = folder.join(&document.robot);
        let robot_name = robot_path.display().to_string();
        let loaded = Robot::load_with_text(&robot_path, document.base.as_deref());
        let (robot, robot_text) = loaded.map_err(|error: RobotError| {
            ScenarioError::Campaign(crate::campaign::CampaignError::from(error))
        })?;
        let settings = document.settle(&file, &robot)?;
        let setup = Setup::new(robot, settings.targets, settings.gravity);
        let design = design(&own.design, &setup).map_err(&form)?;
        let instead = own.instead.iter();
        let instead = instead
            .map(|entry| {
                let design = self::design(&entry.design, &setup);
                Ok((entry.title.clone(), design?))
            })
            .collect::<Result<Vec<_>, String>>()
            .map_err(&form)?;
        for design in instead.iter().map(|(_, design)| design).chain([&design]) {
            let readings = design.readings(setup.targets.len());
            if readings > MOST_READINGS {
                return Err(form(format!(
                    "the design asks for {readings} readings; accepted: at most {MOST_READINGS}"
                )));
            }
        }
        let truth = truths(&file, own.truth.clone(), &setup, own.seed)?;
        own.disturbance.check().map_err(&form)?;
        if let Some(blind) = &own.blind {
            blind.check().map_err(&form)?;
        }
        let job = job(&mut own).map_err(&form)?;
        let beside = [
            ("compare_paper", own.compare_paper),
            ("[workspace]", own.workspace.is_some()),
            ("[[instead]]", !own.instead.is_empty()),
        ];
        let mut beside = beside.iter().filter(|(_, given)| *given);
        if let (false, Some((key, _))) = (matches!(job, Job::Fit), beside.next()) {
            return Err(form(format!(
                "{key} stands beside {}; accepted: in a scenario that fits one campaign",
                job.key()
            )));
        }
        job.check(&setup).map_err(&form)?;
        own.expect.check(&job, &setup).map_err(&form)?;
        Ok(Self {
            file: file.clone(),
            name: path
                .file_stem()
                .map_or_else(|| file.clone(), |stem| stem.to_string_lossy().into_owned()),
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
            effects: match own.effects {
                Some(words) => EffectList::parse(&file, &words.join(","))?,
                None => EffectList::DEFAULT,
            },
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

/// A scenario with `like = "other.toml"` is the other one but for what it says itself: keys of its tables replace those
/// of the same table there. Both texts make its text.
fn layered(
    file: &str,
    folder: &Path,
    mut own: toml::Table,
    text: String,
) -> Result<(toml::Table, String), ScenarioError> {
    let form = |message: String| ScenarioError::Form {
        file: file.to_owned(),
        message,
    };
    let like = match own.remove("like") {
        None => return Ok((own, text)),
        Some(toml::Value::String(like)) => like,
        Some(other) => {
            return Err(form(format!(
                "like is {other}; accepted: the name of another scenario in the same folder"
            )));
        }
    };
    if Path::new(&like).components().count() != 1 {
        return Err(form(format!(
            "like = \"{like}\"; accepted: the name of another scenario in the same folder"
        )));
    }
    let path = folder.join(&like);
    let below = read_text(&path)?;
    let mut all: toml::Table = input::toml(&below).map_err(|message| ScenarioError::Form {
        file: path.display().to_string(),
        message,
    })?;
    if all.contains_key("like") {
        return Err(form(format!(
            "like = \"{like}\", which is like another one itself; accepted: one that is not"
        )));
    }
    for (key, value) in own {
        match (all.get_mut(&key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) => below.extend(above),
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
    Ok((all, format!("{below}\n# but for:\n{text}")))
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

fn design(entry: &DesignEntry, setup: &Setup) -> Result<Design, String> {
    let check = |good: bool, message: &str| {
        if good {
            Ok(())
        } else {
            Err(format!("[design] {message}"))
        }
    };
    check(entry.poses >= 1, "poses is 0; accepted: 1 or more")?;
    check(
        entry.heldout_poses < entry.poses,
        "heldout_poses leaves nothing to fit; accepted: fewer than poses",
    )?;
    check(
        matches!(entry.directions, 1 | 2),
        "directions: accepted are 1 and 2",
    )?;
    check(entry.repeats >= 1, "repeats is 0; accepted: 1 or more")?;
    check(
        (0.0..0.5).contains(&entry.margin),
        "margin: accepted are shares of a joint's range from 0 to below 0.5",
    )?;
    check(
        entry.least_height_m.is_finite(),
        "least_height_m: accepted are finite numbers",
    )?;
    let mut loads: Vec<DesignLoad> = Vec::new();
    for load in &entry.loads {
        let numbers = load.com_m.iter().chain(&load.pull_N).chain([&load.mass_kg]);
        check(
            numbers.clone().all(|x| x.is_finite()) && load.mass_kg >= 0.0,
            "loads: accepted are finite numbers and masses of 0 or more",
        )?;
        loads.push(DesignLoad {
            mass: load.mass_kg,
            com: Vector3::from(load.com_m),
            pull: Vector3::from(load.pull_N),
        });
    }
    if loads.is_empty() {
        loads.push(DesignLoad {
            mass: 0.0,
            com: Vector3::zeros(),
            pull: Vector3::zeros(),
        });
    }
    let temperature = entry.temperature.as_ref().map(|entry| WarmUp {
        start: entry.start_degC,
        rise: entry.warm_up_K,
        time: entry.warm_up_s,
    });
    if let Some(WarmUp { start, rise, time }) = temperature {
        check(
            start.is_finite() && rise.is_finite() && time.is_finite() && time > 0.0,
            "temperature: accepted are finite start_degC and warm_up_K, and warm_up_s above 0",
        )?;
    }
    let mut space = Space::within_limits(&setup.robot, entry.margin);
    space.least_height = entry.least_height_m;
    for (name, value) in &entry.fixed_rad {
        let Some(joint) = setup.robot.joint(name) else {
            let known: Vec<&str> = setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
            return Err(format!(
                "[design.fixed_rad] no joint is called \"{name}\"; known: {}",
                known.join(", ")
            ));
        };
        let angle = value.as_float().or(value.as_integer().map(|i| i as f64));
        match angle.filter(|x| x.is_finite()) {
            Some(angle) => space.ranges[joint] = (angle, angle),
            None => {
                return Err(format!(
                    "[design.fixed_rad] {name} is {value}; accepted: a finite number"
                ));
            }
        }
    }
    Ok(Design {
        poses: entry.poses,
        heldout: entry.heldout_poses,
        more: Vec::new(),
        loads,
        directions: entry.directions,
        repeats: entry.repeats,
        random_order: matches!(entry.order, Order::Random),
        space,
        temperature,
    })
}

/// The hidden effects with all their parameters: values given, presets, random draws on top.
pub(super) fn truths(
    file: &str,
    tables: Vec<toml::Table>,
    setup: &Setup,
    seed: u64,
) -> Result<Vec<Truth>, ScenarioError> {
    let form = |message: String| ScenarioError::Form {
        file: file.to_owned(),
        message,
    };
    check_count(file, tables.len())?;
    let mut random = generator(seed, stream::TRUTH);
    let mut choices = Vec::new();
    let mut truths = Vec::new();
    for (index, mut table) in tables.into_iter().enumerate() {
        let place = format!("[[truth]] number {}", index + 1);
        let preset = match table.remove("preset") {
            None => None,
            Some(toml::Value::String(name)) => Some(name),
            Some(other) => {
                return Err(form(format!(
                    "{place}: preset is {other}; accepted: {}",
                    presets::NAMES
                )));
            }
        };
        let exponent = match table.remove("exponent") {
            None => None,
            Some(value) => Some(
                value
                    .as_integer()
                    .and_then(|x| i32::try_from(x).ok())
                    .filter(|x| (0..=9).contains(x))
                    .ok_or_else(|| {
                        form(format!("{place}: exponent is {value}; accepted: 0 to 9"))
                    })?,
            ),
        };
        let spread = match table.remove("random") {
            None => 0.0,
            Some(value) => value
                .as_float()
                .or(value.as_integer().map(|i| i as f64))
                .filter(|x| x.is_finite() && *x >= 0.0)
                .ok_or_else(|| {
                    form(format!(
                        "{place}: random is {value}; accepted: a standard deviation in typical \
                         sizes, 0 or more"
                    ))
                })?,
        };
        if table.contains_key("hold") {
            return Err(form(format!(
                "{place}: a truth is not held; leave hold out"
            )));
        }
        let choice = Choice::parse(file, &place, table)?;
        let mut parameters = choice.effect.parameters(setup);
        if let Some(name) = &preset {
            if choice.effect.role() != Some(Role::Spring) {
                return Err(form(format!(
                    "{place}: presets are for {}, not {}",
                    Role::Spring.id(),
                    choice.effect.id()
                )));
            }
            let stiffness = presets::stiffness(name, exponent, setup)
                .map_err(|e| form(format!("{place}: {e}")))?;
            for (joint, stiffness) in stiffness {
                let mut parameters = parameters.iter_mut();
                if let Some(parameter) = parameters.find(|p| p.joint() == Some(joint)) {
                    parameter.value = 1.0 / stiffness;
                }
            }
        } else if exponent.is_some() {
            return Err(form(format!(
                "{place}: exponent goes with preset = \"paper\""
            )));
        }
        choice.apply(file, setup, &mut parameters)?;
        for parameter in &mut parameters {
            // drawn for every parameter, so that a value given for one does not move the others
            let draw: f64 = random.sample(StandardNormal);
            if !choice
                .values
                .iter()
                .any(|(name, _)| *name == parameter.name)
            {
                parameter.value += spread * parameter.typical * draw;
            }
        }
        truths.push(truth(&choice, parameters));
        choices.push(choice);
    }
    unique(file, &choices).map_err(|error: TableError| ScenarioError::Table(error))?;
    Ok(truths)
}

fn truth(choice: &Choice, parameters: Vec<crate::effects::Parameter>) -> Truth {
    Truth {
        effect: choice.effect.clone(),
        values: parameters
            .into_iter()
            .map(|parameter| (parameter.name, parameter.value))
            .collect(),
    }
}
