//! Which effects a model holds: the default, a list of names, or a model file.

use crate::campaign::{Campaign, Frame};
use crate::effects::{self, AnyEffect};
use crate::model::Model;
use crate::setup::Setup;
use std::path::Path;
use std::sync::Arc;

/// Why there is no model.
#[derive(Debug, thiserror::Error)]
pub enum ModelError {
    /// The file cannot be read.
    #[error("{file}: {source}")]
    Read {
        /// Model file.
        file: String,
        /// Reason.
        source: std::io::Error,
    },
    /// Not TOML, or not of this form.
    #[error("{file}: {message}")]
    Form {
        /// Model file.
        file: String,
        /// What is wrong, and where.
        message: String,
    },
    /// No such effect.
    #[error("{origin}: no effect is called \"{found}\"; known: {known}")]
    UnknownEffect {
        /// File or option.
        origin: String,
        /// The word found.
        found: String,
        /// All ids.
        known: String,
    },
    /// The same effect twice.
    #[error("{origin}: the effect \"{found}\" is named twice")]
    Twice {
        /// File or option.
        origin: String,
        /// The effect.
        found: String,
    },
    /// No such parameter.
    #[error("{file}: {effect} has no parameter \"{found}\" on this robot; it has: {known}")]
    UnknownParameter {
        /// Model file.
        file: String,
        /// The effect.
        effect: String,
        /// The word found.
        found: String,
        /// Its parameters.
        known: String,
    },
}

/// An effect as chosen, with the values given for its parameters.
struct Choice {
    effect: Arc<dyn AnyEffect>,
    hold: Hold,
    values: Vec<(String, f64)>,
}

enum Hold {
    Nothing,
    Everything,
    Names(Vec<String>),
}

/// Builds the model for a campaign.
///
/// `names` is the word list of `--effects` (a leading `+` adds to the default), `file` that of `--model`.
/// Frames that the campaign does not know are always in the model; those it knows are held.
///
/// # Errors
/// For unknown effects or parameters and for files that cannot be read.
pub fn model(
    campaign: &Campaign,
    names: Option<&str>,
    file: Option<&Path>,
) -> Result<Model, ModelError> {
    let setup = Setup::of(campaign);
    let mut choices = match file {
        Some(file) => read(file)?,
        None => Vec::new(),
    };
    let origin = "--effects";
    let mut wanted: Vec<String> = match (names, file) {
        (None, None) => default_effects(campaign, &setup),
        (None, Some(_)) => Vec::new(),
        (Some(names), _) => {
            let (add, names) = match names.strip_prefix('+') {
                Some(rest) => (true, rest),
                None => (false, names),
            };
            let listed = names.split(',').map(str::trim).filter(|name| !name.is_empty());
            let listed = listed.map(|name| name.trim_start_matches('+').to_owned());
            if add && file.is_none() {
                let mut all = default_effects(campaign, &setup);
                all.extend(listed);
                all
            } else {
                listed.collect()
            }
        }
    };
    for frame in frames(campaign) {
        let named = wanted.iter().any(|name| name == frame);
        if !named && !choices.iter().any(|c| c.effect.id() == frame) {
            wanted.push(frame.to_owned());
        }
    }
    for name in wanted {
        let entry = effects::find(&name).ok_or_else(|| ModelError::UnknownEffect {
            origin: origin.to_owned(),
            found: name.clone(),
            known: effects::ids(),
        })?;
        if choices.iter().any(|choice| choice.effect.id() == name) {
            return Err(ModelError::Twice {
                origin: origin.to_owned(),
                found: name,
            });
        }
        let effect = entry
            .make(toml::Table::new())
            .map_err(|error| ModelError::Form {
                file: origin.to_owned(),
                message: format!("{name}: {}", error.message()),
            })?;
        choices.push(Choice {
            effect,
            hold: Hold::Nothing,
            values: Vec::new(),
        });
    }
    // the catalogue's order, whatever the order of the words
    choices.sort_by_key(|choice| {
        effects::CATALOGUE
            .iter()
            .position(|entry| entry.id == choice.effect.id())
    });
    let list: Vec<_> = choices.iter().map(|choice| choice.effect.clone()).collect();
    let mut model = Model::new(setup, &list);
    model.hold_known_frames(campaign);
    let source = file.map_or_else(|| origin.to_owned(), |file| file.display().to_string());
    for (term, choice) in model.terms.iter_mut().zip(&choices) {
        apply(&source, choice, &mut term.parameters)?;
    }
    Ok(model)
}

/// The frames alone: what every error is compared with.
///
/// # Errors
/// Never for a campaign that was read; the type is that of [`model`].
pub fn frames_only(campaign: &Campaign) -> Result<Model, ModelError> {
    model(campaign, Some(""), None)
}

/// Frame effects that the campaign needs: to estimate what it does not know, to hold what it does.
fn frames(campaign: &Campaign) -> Vec<&'static str> {
    let neutral = |frame: &Frame| matches!(frame, Frame::Known(pose) if *pose == nalgebra::Isometry3::identity());
    let mut frames = Vec::new();
    if !neutral(&campaign.base_from_tracker) {
        frames.push("tracker_frame");
    }
    if !campaign.link_from_target.iter().all(neutral) {
        frames.push("target_offset");
    }
    frames
}

/// The default: frames, geometry, and joint compliance where something loads the joints.
fn default_effects(campaign: &Campaign, setup: &Setup) -> Vec<String> {
    let heavy = setup.robot.bodies.iter().skip(1).any(|body| body.mass > 0.0);
    let loaded = campaign.readings.iter().any(|reading| {
        reading.payload.is_some_and(|payload| payload.mass > 0.0) || reading.wrench.is_some()
    });
    let mut list = frames(campaign);
    list.push("geometry");
    if heavy || loaded {
        list.push("joint_compliance");
    }
    list.into_iter().map(str::to_owned).collect()
}

/// Reads the `[[effect]]` tables of a model file.
fn read(path: &Path) -> Result<Vec<Choice>, ModelError> {
    let file = path.display().to_string();
    let text = std::fs::read_to_string(path).map_err(|source| ModelError::Read {
        file: file.clone(),
        source,
    })?;
    let form = |message: String| ModelError::Form {
        file: file.clone(),
        message,
    };
    let mut document: toml::Table =
        text.parse().map_err(|error: toml::de::Error| form(error.to_string()))?;
    let tables = match document.remove("effect") {
        Some(toml::Value::Array(tables)) => tables,
        None if document.is_empty() => Vec::new(),
        _ => return Err(form("accepted: a list of [[effect]] tables".to_owned())),
    };
    if let Some(key) = document.keys().next() {
        return Err(form(format!(
            "unknown key \"{key}\"; accepted: [[effect]] tables"
        )));
    }
    let mut choices: Vec<Choice> = Vec::new();
    for (index, table) in tables.into_iter().enumerate() {
        let place = format!("[[effect]] number {}", index + 1);
        let toml::Value::Table(mut table) = table else {
            return Err(form(format!("{place} is not a table")));
        };
        let Some(toml::Value::String(kind)) = table.remove("kind") else {
            return Err(form(format!("{place} has no kind = \"<effect>\"")));
        };
        let entry = effects::find(&kind).ok_or_else(|| ModelError::UnknownEffect {
            origin: file.clone(),
            found: kind.clone(),
            known: effects::ids(),
        })?;
        if choices.iter().any(|choice| choice.effect.id() == kind) {
            return Err(ModelError::Twice {
                origin: file.clone(),
                found: kind,
            });
        }
        let hold = match table.remove("hold") {
            None | Some(toml::Value::Boolean(false)) => Hold::Nothing,
            Some(toml::Value::Boolean(true)) => Hold::Everything,
            Some(value) => Hold::Names(value.try_into().map_err(|_| {
                form(format!(
                    "{kind}: hold takes true or a list of parameter names"
                ))
            })?),
        };
        let values: toml::Table = match table.remove("values") {
            None => toml::Table::new(),
            Some(value) => value
                .try_into()
                .map_err(|_| form(format!("{kind}: values takes a table of name = number")))?,
        };
        let values = values
            .into_iter()
            .map(|(name, value)| {
                let number = value.as_float().or(value.as_integer().map(|i| i as f64));
                match number.filter(|x| x.is_finite()) {
                    Some(number) => Ok((name, number)),
                    None => Err(form(format!(
                        "{kind}: value of {name} is {value}; accepted: a finite number, SI units"
                    ))),
                }
            })
            .collect::<Result<_, _>>()?;
        let effect = entry
            .make(table)
            .map_err(|error| form(format!("{kind}: {}", error.message())))?;
        choices.push(Choice {
            effect,
            hold,
            values,
        });
    }
    Ok(choices)
}

/// Gives parameters their values, and holds those to be held.
fn apply(
    file: &str,
    choice: &Choice,
    parameters: &mut [effects::Parameter],
) -> Result<(), ModelError> {
    let known = || -> String {
        let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
        names.join(", ")
    };
    let find = |name: &str| {
        let index = parameters.iter().position(|p| p.name == name);
        index.ok_or_else(|| ModelError::UnknownParameter {
            file: file.to_owned(),
            effect: choice.effect.id().to_owned(),
            found: name.to_owned(),
            known: known(),
        })
    };
    let values: Vec<(usize, f64)> = choice
        .values
        .iter()
        .map(|(name, value)| Ok((find(name)?, *value)))
        .collect::<Result<_, _>>()?;
    let held: Vec<usize> = match &choice.hold {
        Hold::Nothing => Vec::new(),
        Hold::Everything => (0..parameters.len()).collect(),
        Hold::Names(names) => names.iter().map(|name| find(name)).collect::<Result<_, _>>()?,
    };
    for (index, value) in values {
        parameters[index].value = value;
    }
    for index in held {
        parameters[index].vary = false;
    }
    Ok(())
}
