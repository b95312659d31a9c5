//! Which effects a model holds: the default, a list, or a model file.

use crate::campaign::{Campaign, Frame, write_atomically};
use crate::effects::table::{Choice, TableError, check_count, unique};
use crate::effects::{AnyEffect, Base, CATALOGUE, EffectList, Role};
use crate::input::{self, InputError, LARGEST_TOML};
use crate::model::Model;
use crate::setup::Setup;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Why there is no model.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// Model file.
        file: String,
        /// Reason.
        source: InputError,
    },
    /// The file cannot be written.
    #[error("{file}: {source}")]
    Write {
        /// Model file.
        file: String,
        /// Reason.
        source: std::io::Error,
    },
    /// A model of another robot.
    #[error(
        "{file}: robot = \"{found}\", but the robot of {campaign} is \"{robot}\" ({robot_file}); accepted: a model \
         of that robot, or, if these numbers are meant for it, the file without the line"
    )]
    OtherRobot {
        /// Model file.
        file: String,
        /// The robot that it names.
        found: String,
        /// The campaign.
        campaign: String,
        /// The campaign's robot.
        robot: String,
        /// File of that.
        robot_file: String,
    },
    /// What it says is no model.
    #[error(transparent)]
    Table(#[from] TableError),
}

/// Named in errors about effects of the list.
const ORIGIN: &str = "--effects";

/// Builds the model for a campaign: the effects listed, beside those of a model file if there is one.
///
/// Frames that the campaign does not know are always in the model; those it knows are held.
///
/// # Errors
/// For effects or parameters that do not fit, and for files that cannot be read.
pub fn model(
    campaign: &Campaign,
    effects: &EffectList,
    file: Option<&Path>,
) -> Result<Model, ModelError> {
    let setup = Setup::of(campaign);
    let mut choices = match file {
        Some(file) => read(file, campaign)?,
        None => Vec::new(),
    };
    let mut wanted: Vec<&str> = Vec::new();
    if effects.base == Base::Default && file.is_none() {
        wanted.extend(default_effects(campaign, &setup).map(Role::id));
    }
    wanted.extend(effects.effects.iter().map(|entry| entry.id));
    for frame in frames(campaign).map(Role::id) {
        let chosen = choices.iter().any(|choice| choice.effect.id() == frame);
        if !chosen && !wanted.contains(&frame) {
            wanted.push(frame);
        }
    }
    for name in wanted {
        if choices.iter().any(|choice| choice.effect.id() == name) {
            return Err(ModelError::Table(TableError::Twice {
                file: ORIGIN.to_owned(),
                found: name.to_owned(),
            }));
        }
        choices.push(Choice::named(ORIGIN, name)?);
    }
    let source = file.map_or_else(|| ORIGIN.to_owned(), |file| file.display().to_string());
    unique(&source, &choices)?;
    // the catalogue's order, whatever the order of the words
    choices.sort_by_key(|choice| {
        let kind = choice.effect.kind();
        CATALOGUE.iter().position(|entry| entry.id == kind)
    });
    let effects: Vec<_> = choices.iter().map(|choice| choice.effect.clone()).collect();
    let mut model = Model::new(setup, &effects);
    model.hold_known_frames(campaign);
    for (term, choice) in model.terms.iter_mut().zip(&choices) {
        choice.apply(&source, &model.setup, &mut term.parameters)?;
    }
    Ok(model)
}

/// The frames alone: what every error is compared with.
///
/// # Errors
/// Never for a campaign that was read; the type is that of [`model`].
pub fn frames_only(campaign: &Campaign) -> Result<Model, ModelError> {
    model(campaign, &EffectList::FRAMES, None)
}

/// Frames that the campaign needs: to estimate what it does not know, to hold what it does.
fn frames(campaign: &Campaign) -> impl Iterator<Item = Role> {
    let identity = nalgebra::Isometry3::identity();
    let neutral = |frame: &Frame| matches!(frame, Frame::Known(pose) if *pose == identity);
    let tracker = !neutral(&campaign.base_from_tracker);
    let targets = !campaign.link_from_target.iter().all(neutral);
    let frames = [
        tracker.then_some(Role::TrackerFrame),
        targets.then_some(Role::TargetFrame),
    ];
    frames.into_iter().flatten()
}

/// The default: frames, geometry, and joint compliance where something loads the joints.
fn default_effects(campaign: &Campaign, setup: &Setup) -> impl Iterator<Item = Role> {
    let heavy = setup
        .robot
        .bodies
        .iter()
        .skip(1)
        .any(|body| body.mass > 0.0);
    let loaded = campaign.readings.iter().any(|reading| {
        reading.payload.is_some_and(|payload| payload.mass > 0.0) || reading.wrench.is_some()
    });
    let springs = (heavy || loaded).then_some(Role::Spring);
    frames(campaign).chain([Role::Geometry]).chain(springs)
}

/// Effects of a model file to be tried beside the catalogue. What it holds and its values are of no account.
///
/// # Errors
/// As [`read`], and for effects that do not fit the robot.
pub fn candidates(campaign: &Campaign, file: &Path) -> Result<Vec<Arc<dyn AnyEffect>>, ModelError> {
    let setup = Setup::of(campaign);
    let choices = read(file, campaign)?;
    let source = file.display().to_string();
    unique(&source, &choices)?;
    for choice in &choices {
        choice.apply(&source, &setup, &mut choice.effect.parameters(&setup))?;
    }
    Ok(choices.into_iter().map(|choice| choice.effect).collect())
}

/// A model as the text of a file that [`model`] reads: its robot, effects with their options, what is held, and values
/// that it starts from or holds.
///
/// # Errors
/// If an option has no place in TOML.
pub fn text(model: &Model) -> Result<String, toml::ser::Error> {
    let tables = model.terms.iter().map(|term| {
        let mut table = toml::Table::new();
        table.insert("kind".to_owned(), term.effect.kind().into());
        table.extend(term.effect.options().clone());
        let held = term.parameters.iter().filter(|p| !p.vary);
        let held: Vec<toml::Value> = held.map(|p| p.name.clone().into()).collect();
        if !held.is_empty() {
            table.insert("hold".to_owned(), held.into());
        }
        let told = term.parameters.iter().filter(|p| p.value != 0.0);
        let values: toml::Table = told.map(|p| (p.name.clone(), p.value.into())).collect();
        if !values.is_empty() {
            table.insert("values".to_owned(), values.into());
        }
        table
    });
    let document = ModelDocument {
        robot: Some(model.setup.robot.name.clone()),
        effect: tables.collect(),
    };
    toml::to_string(&document)
}

/// Writes [`text`].
///
/// # Errors
/// What the file system says.
pub fn write(path: &Path, model: &Model) -> Result<(), ModelError> {
    let refuse = |source| ModelError::Write {
        file: path.display().to_string(),
        source,
    };
    let text = text(model).map_err(|error| refuse(std::io::Error::other(error)))?;
    write_atomically(path, |file| file.write_all(text.as_bytes())).map_err(refuse)
}

/// Reads the `[[effect]]` tables of a model file: effects with their options, what is held, and values. They are not
/// yet checked against the campaign's robot but for its name: [`Choice::apply`] does that.
///
/// # Errors
/// If the file cannot be read, is no model file, names another robot, or a table is wrong.
pub fn read(path: &Path, campaign: &Campaign) -> Result<Vec<Choice>, ModelError> {
    let file = path.display().to_string();
    let text = input::text(path, LARGEST_TOML).map_err(|source| ModelError::Read {
        file: file.clone(),
        source,
    })?;
    let form = |message: String| TableError::Form {
        file: file.clone(),
        message,
    };
    let document: ModelDocument = input::toml(&text).map_err(form)?;
    if let Some(found) = document.robot.filter(|name| *name != campaign.robot.name) {
        return Err(ModelError::OtherRobot {
            file,
            found,
            campaign: campaign.name.clone(),
            robot: campaign.robot.name.clone(),
            robot_file: campaign.robot_file.name.clone(),
        });
    }
    check_count(&file, document.effect.len())?;
    let tables = document.effect.into_iter().enumerate();
    let choices = tables
        .map(|(index, table)| {
            Choice::parse(&file, &format!("[[effect]] number {}", index + 1), table)
        })
        .collect::<Result<_, _>>()?;
    Ok(choices)
}

#[derive(serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelDocument {
    /// Name of the robot that it is a model of; not said in files by hand.
    robot: Option<String>,
    #[serde(default)]
    effect: Vec<toml::Table>,
}
