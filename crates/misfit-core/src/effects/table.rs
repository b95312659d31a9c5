//! `[[effect]]` and `[[truth]]` tables: which effect, its options, values for its parameters, what is held.

use super::{AnyEffect, Parameter, find, ids};
use crate::setup::Setup;
use std::sync::Arc;

/// Why a table says nothing useful.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TableError {
    /// Not of this form.
    #[error("{file}: {message}")]
    Form {
        /// File (or option) it stands in.
        file: String,
        /// What is wrong, and what is accepted.
        message: String,
    },
    /// No such effect.
    #[error("{file}: no effect is called \"{found}\"; known: {known}")]
    UnknownEffect {
        /// File or option.
        file: String,
        /// The word found.
        found: String,
        /// All ids.
        known: String,
    },
    /// The same effect twice.
    #[error("{file}: the effect \"{found}\" is named twice")]
    Twice {
        /// File or option.
        file: String,
        /// The effect.
        found: String,
    },
    /// No such parameter.
    #[error("{file}: {effect} has no parameter \"{found}\" on this robot; it has: {known}")]
    UnknownParameter {
        /// File.
        file: String,
        /// The effect.
        effect: String,
        /// The word found.
        found: String,
        /// Its parameters.
        known: String,
    },
}

/// Most effects of a model or a truth: each is compared with each.
pub const MOST_EFFECTS: usize = 1000;

/// An effect as chosen, with what is said about its parameters.
#[derive(Debug, Clone)]
pub struct Choice {
    /// The effect.
    pub effect: Arc<dyn AnyEffect>,
    /// Parameters held at their values.
    pub hold: Hold,
    /// Values by parameter name, SI.
    pub values: Vec<(String, f64)>,
}

/// Which parameters are held.
#[derive(Debug, Clone, PartialEq)]
pub enum Hold {
    /// None.
    Nothing,
    /// All.
    Everything,
    /// Those named.
    Names(Vec<String>),
}

impl Choice {
    /// An effect without options, by its id; `origin` is named in errors.
    ///
    /// # Errors
    /// If there is no such effect, or it needs options.
    pub fn named(origin: &str, id: &str) -> Result<Self, TableError> {
        let mut table = toml::Table::new();
        table.insert("kind".to_owned(), id.into());
        Self::parse(origin, "effect", table)
    }

    /// From a table with `kind`, `hold`, `values` and the effect's own options.
    ///
    /// # Errors
    /// For an unknown effect, and options or values that it does not take.
    pub fn parse(file: &str, place: &str, mut table: toml::Table) -> Result<Self, TableError> {
        let form = |message: String| TableError::Form {
            file: file.to_owned(),
            message,
        };
        let Some(toml::Value::String(kind)) = table.remove("kind") else {
            return Err(form(format!("{place} has no kind = \"<effect>\"")));
        };
        let entry = find(&kind).ok_or_else(|| TableError::UnknownEffect {
            file: file.to_owned(),
            found: kind.clone(),
            known: ids(),
        })?;
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
        Ok(Self {
            effect,
            hold,
            values,
        })
    }

    /// Gives parameters their values, and holds those to be held.
    ///
    /// # Errors
    /// For options that do not fit this robot, and names that the effect does not have on this robot.
    pub fn apply(
        &self,
        file: &str,
        setup: &Setup,
        parameters: &mut [Parameter],
    ) -> Result<(), TableError> {
        self.effect
            .check(setup)
            .map_err(|message| TableError::Form {
                file: file.to_owned(),
                message: format!("{}: {message}", self.effect.id()),
            })?;
        let find = |name: &str, parameters: &[Parameter]| {
            let index = parameters.iter().position(|p| p.name == name);
            index.ok_or_else(|| TableError::UnknownParameter {
                file: file.to_owned(),
                effect: self.effect.id().to_owned(),
                found: name.to_owned(),
                known: {
                    let names: Vec<&str> = parameters.iter().map(|p| p.name.as_str()).collect();
                    names.join(", ")
                },
            })
        };
        for (name, value) in &self.values {
            let index = find(name, parameters)?;
            let (lower, upper) = (parameters[index].lower, parameters[index].upper);
            if !(lower..=upper).contains(value) {
                return Err(TableError::Form {
                    file: file.to_owned(),
                    message: format!(
                        "{}: value of {name} is {value}; accepted: {lower} to {upper} {}",
                        self.effect.id(),
                        parameters[index].unit
                    ),
                });
            }
            parameters[index].value = *value;
        }
        match &self.hold {
            Hold::Nothing => {}
            Hold::Everything => parameters.iter_mut().for_each(|p| p.vary = false),
            Hold::Names(names) => {
                for name in names {
                    let index = find(name, parameters)?;
                    parameters[index].vary = false;
                }
            }
        }
        Ok(())
    }
}

/// Refuses more tables of effects than [`MOST_EFFECTS`].
///
/// # Errors
/// If there are.
pub fn check_count(file: &str, tables: usize) -> Result<(), TableError> {
    if tables <= MOST_EFFECTS {
        return Ok(());
    }
    Err(TableError::Form {
        file: file.to_owned(),
        message: format!("found {tables} effects; accepted: at most {MOST_EFFECTS}"),
    })
}

/// Refuses the same effect twice.
///
/// # Errors
/// If one is.
pub fn unique(file: &str, choices: &[Choice]) -> Result<(), TableError> {
    for (index, choice) in choices.iter().enumerate() {
        let id = choice.effect.id();
        if choices[..index].iter().any(|other| other.effect.id() == id) {
            return Err(TableError::Twice {
                file: file.to_owned(),
                found: id.to_owned(),
            });
        }
    }
    Ok(())
}
