//! `[columns]` of a campaign file: the user's own header words, their units and conventions.

use super::Target;
use super::columns::{Columns, Place, Role, distance, plain_words};
use super::error::{CampaignError, quoted};
use super::keys::Keys;
use super::layout::Layout;
use super::orientation::{self, Convention};
use super::units::{self, Dimension, Unit};
use crate::robot::Robot;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use toml::{Table, Value};

/// What the campaign file says that a table is read with.
pub(super) struct Context<'a> {
    /// Name of the table for messages.
    pub(super) file: &'a str,
    pub(super) robot: &'a Robot,
    pub(super) targets: &'a [Target],
    /// Column that holds `fit` and `heldout`.
    pub(super) split_column: Option<&'a str>,
    /// Must a column say where some joint is? Not of tasks, whose joints are still to be found.
    pub(super) with_joints: bool,
    pub(super) layout: &'a Layout,
    /// The user's own header words.
    pub(super) mapping: Option<&'a Mapping>,
}

/// What `[columns]` says, in the order of its keys.
#[derive(Debug, Clone)]
pub struct Mapping {
    entries: Vec<Entry>,
}

/// One quantity with the columns that hold it.
#[derive(Debug, Clone)]
struct Entry {
    key: String,
    roles: Vec<Role>,
    columns: Vec<Word>,
    unit: Option<&'static Unit>,
    convention: Option<Convention>,
    sign: f64,
    offset: f64,
    /// Of position and orientation columns: whose they are.
    target: Option<usize>,
}

/// A column by its header word, or by its number from 1 on.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
enum Word {
    Number(usize),
    Name(String),
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    column: Option<Word>,
    columns: Option<Vec<Word>>,
    unit: Option<String>,
    convention: Option<String>,
    sign: Option<f64>,
    offset: Option<f64>,
}

const WRITTEN: &str = "a header word, or a table with `column` or `columns`, and `unit`, `convention`, `sign`, `offset` where they apply";

impl Written {
    fn of(keys: &Keys<'_>, key: &str, value: &Value) -> Result<Self, CampaignError> {
        if let Value::String(word) = value {
            return Ok(Self {
                column: Some(Word::Name(word.clone())),
                ..Self::default()
            });
        }
        value.clone().try_into().or_else(|error: toml::de::Error| {
            let message = error.message().lines().next().unwrap_or_default();
            keys.refuse(key, message.to_owned(), WRITTEN)
        })
    }
}

impl Mapping {
    /// Gives the written keys their meaning on this robot.
    pub fn settle(
        keys: &Keys<'_>,
        table: &Table,
        robot: &Robot,
        targets: &[Target],
    ) -> Result<Self, CampaignError> {
        let mut entries = Vec::new();
        for (name, value) in table {
            let key = format!("columns.{name}");
            let per_target = ["position", "orientation"].contains(&name.as_str());
            match value {
                Value::Table(table)
                    if per_target && !table.contains_key("columns") && !table.is_empty() =>
                {
                    for (target, value) in table {
                        let key = format!("{key}.{target}");
                        let Some(index) = targets.iter().position(|t| t.name == *target) else {
                            let names: Vec<&str> =
                                targets.iter().map(|t| t.name.as_str()).collect();
                            let accepted =
                                format!("`columns`, or names of targets: {}", names.join(", "));
                            return keys.refuse(&key, quoted(target), &accepted);
                        };
                        entries.push(entry(keys, key, name, value, robot, Some(index))?);
                    }
                }
                _ => entries.push(entry(keys, key, name, value, robot, None)?),
            }
        }
        let mapping = Self { entries };
        mapping.check(keys, targets)?;
        Ok(mapping)
    }

    /// Refuses positions of some targets and not of others, or beside a column of targets.
    fn check(&self, keys: &Keys<'_>, targets: &[Target]) -> Result<(), CampaignError> {
        let of = |role: Role| self.entries.iter().filter(move |e| e.roles.contains(&role));
        let positions: BTreeSet<_> = of(Role::Position(0)).filter_map(|e| e.target).collect();
        if positions.is_empty() {
            return match of(Role::Orientation(0)).find(|e| e.target.is_some()) {
                Some(entry) => keys.refuse(
                    &entry.key,
                    "orientations by target, but no positions by target".into(),
                    "both by target, or both with the column `target`",
                ),
                None => Ok(()),
            };
        }
        if of(Role::Target).next().is_some() {
            return keys.refuse(
                "columns.target",
                "a column of targets beside positions by target".into(),
                "one of the two: a row is one reading, or one of each target",
            );
        }
        let other =
            of(Role::Orientation(0)).find(|e| e.target.is_none_or(|t| !positions.contains(&t)));
        if let Some(entry) = other {
            return keys.refuse(
                &entry.key,
                "the orientation of a target without a position".into(),
                "orientations of the targets that have positions here",
            );
        }
        if positions.len() < targets.len() {
            let missing = (0..targets.len()).find(|t| !positions.contains(t));
            let name = missing.map_or("", |t| targets[t].name.as_str());
            return keys.refuse(
                "columns.position",
                format!("no position of target {}", quoted(name)),
                "one for each [[target]]",
            );
        }
        Ok(())
    }

    /// The column that holds `fit` and `heldout` by a word of `[columns]`.
    pub fn has_split(&self) -> bool {
        self.entries.iter().any(|e| e.roles == [Role::Split])
    }

    /// The columns of a table with this header: one set, or one for each target that a row has; and notes of what is
    /// ignored.
    pub(super) fn columns(
        &self,
        context: &Context<'_>,
        headers: Vec<String>,
        units: &[String],
    ) -> Result<(Vec<Columns>, Vec<String>), CampaignError> {
        let header = Header {
            file: context.file,
            words: &headers,
            units,
        };
        let mut shared = Columns::empty(headers.clone());
        (shared.decimal, shared.mapped) = (context.layout.decimal, true);
        let mut by_target: BTreeMap<usize, Columns> = BTreeMap::new();
        let mut used: BTreeMap<usize, &str> = BTreeMap::new();
        let (of_targets, of_all): (Vec<&Entry>, Vec<&Entry>) = self
            .entries
            .iter()
            .partition(|entry| entry.target.is_some());
        for entry in of_all {
            put(&mut shared, entry, &header, &mut used, context.robot)?;
        }
        plain(&mut shared, context, &headers, &mut used, &of_targets)?;
        for entry in of_targets {
            let target = entry.target.unwrap_or_default();
            let columns = by_target
                .entry(target)
                .or_insert_with(|| shared.of_target(target));
            put(columns, entry, &header, &mut used, context.robot)?;
        }
        let ignored: Vec<String> = headers
            .iter()
            .enumerate()
            .filter(|(index, _)| !used.contains_key(index))
            .map(|(index, word)| match word.is_empty() {
                true => format!("number {}", index + 1),
                false => quoted(word),
            })
            .collect();
        let notes = match ignored.len() {
            0 => Vec::new(),
            1 => vec![format!(
                "column ignored, not named under [columns]: {}",
                ignored[0]
            )],
            _ => vec![format!(
                "columns ignored, not named under [columns]: {}",
                ignored.join(", ")
            )],
        };
        let all = match by_target.is_empty() {
            true => vec![shared],
            false => by_target.into_values().collect(),
        };
        Ok((all, notes))
    }
}

/// The header of a table.
struct Header<'a> {
    file: &'a str,
    words: &'a [String],
    units: &'a [String],
}

impl Header<'_> {
    /// Index of the column that a word names.
    fn find(&self, key: &str, word: &Word) -> Result<usize, CampaignError> {
        let refuse = |column: String, found: String, accepted: String| {
            Err(CampaignError::Column {
                file: self.file.into(),
                line: 1,
                column,
                found,
                accepted,
            })
        };
        let name = match word {
            Word::Number(number) => {
                return match number.checked_sub(1).filter(|i| *i < self.words.len()) {
                    Some(index) => Ok(index),
                    None => refuse(
                        format!("number {number}"),
                        format!("no such column, but `{key}` names it"),
                        format!("numbers from 1 to {}", self.words.len()),
                    ),
                };
            }
            Word::Name(name) => name.trim(),
        };
        let mut places = (0..self.words.len()).filter(|i| self.words[*i] == name);
        match (places.next(), places.next()) {
            (Some(index), None) => Ok(index),
            (Some(first), Some(second)) => refuse(
                name.into(),
                format!(
                    "the word twice, in columns {} and {}",
                    first + 1,
                    second + 1
                ),
                format!("the number of the column in `{key}`, as {}", first + 1),
            ),
            (None, _) => {
                let mut near: Vec<&String> = self.words.iter().filter(|w| !w.is_empty()).collect();
                near.sort_by_key(|word| distance(name, word));
                let near: Vec<String> = near.iter().take(6).map(|w| quoted(w)).collect();
                refuse(
                    name.chars().take(80).collect(),
                    format!("no such column, but `{key}` names it"),
                    format!("one of the table's columns: {} …", near.join(", ")),
                )
            }
        }
    }
}

/// Gives the quantities of an entry their places.
fn put<'a>(
    columns: &mut Columns,
    entry: &'a Entry,
    header: &Header<'_>,
    used: &mut BTreeMap<usize, &'a str>,
    robot: &Robot,
) -> Result<(), CampaignError> {
    for (role, word) in entry.roles.iter().zip(&entry.columns) {
        let index = header.find(&entry.key, word)?;
        let refuse = |found: String, accepted: &str| {
            Err(CampaignError::Column {
                file: header.file.into(),
                line: 1,
                column: match header.words[index].is_empty() {
                    true => format!("number {}", index + 1),
                    false => header.words[index].clone(),
                },
                found,
                accepted: accepted.into(),
            })
        };
        if let Some(other) = used.insert(index, &entry.key) {
            return refuse(
                format!(
                    "one column for two quantities, `{other}` and `{}`",
                    entry.key
                ),
                "a column of its own for each quantity",
            );
        }
        let dimension = match (entry.convention, role) {
            (Some(convention), Role::Orientation(_)) => {
                convention.has_unit().then_some(Dimension::Angle)
            }
            _ => role.dimension(robot),
        };
        let unit = match (dimension, entry.unit) {
            (Some(_), Some(unit)) => Some(unit),
            (Some(dimension), None) => {
                let word = header.units.get(index).map_or("", String::as_str);
                match units::spoken(word, dimension) {
                    Some(unit) => Some(unit),
                    None => {
                        let found = match word {
                            "" => format!(
                                "no unit: `{}` says none, nor does a row of units",
                                entry.key
                            ),
                            _ => format!("the unit {} in the row of units", quoted(word)),
                        };
                        return refuse(
                            found,
                            &format!("`unit = …`, one of {}", units::names(Some(dimension))),
                        );
                    }
                }
            }
            (None, _) => None,
        };
        columns.put(
            *role,
            Place {
                index,
                unit,
                sign: entry.sign,
                offset: entry.offset,
            },
        );
    }
    if entry.convention.is_some() {
        columns.convention = entry.convention;
    }
    Ok(())
}

/// Words of the plain format that are not named keep their meaning, unless their quantity has other columns.
fn plain(
    columns: &mut Columns,
    context: &Context<'_>,
    headers: &[String],
    used: &mut BTreeMap<usize, &str>,
    of_targets: &[&Entry],
) -> Result<(), CampaignError> {
    let words = plain_words(context.robot);
    let taken: BTreeSet<Role> = columns
        .roles()
        .chain(of_targets.iter().flat_map(|e| e.roles.iter().copied()))
        .collect();
    let has = |group: &[Role]| group.iter().any(|role| taken.contains(role));
    for (index, header) in headers.iter().enumerate() {
        let split = context.split_column == Some(header.as_str()) && !taken.contains(&Role::Split);
        let (role, unit) = match words.get(header) {
            _ if split => (Role::Split, None),
            Some(known) => *known,
            None => continue,
        };
        let other = match role {
            Role::Position(_) => has(&Role::POSITION),
            Role::Orientation(_) => has(&Role::ORIENTATION),
            Role::Wrench(_) => has(&Role::WRENCH),
            Role::PayloadCentre(_) => has(&Role::PAYLOAD_CENTRE),
            // a label of another kind, where there is one target to choose from
            Role::Target => context.targets.len() == 1 || !of_targets.is_empty(),
            Role::Split => !split,
            _ => taken.contains(&role),
        };
        if other || used.contains_key(&index) {
            continue;
        }
        if columns.put(role, Place::plain(index, unit)).is_some() {
            return Err(CampaignError::Column {
                file: context.file.into(),
                line: 1,
                column: header.clone(),
                found: "a quantity that another column has too".into(),
                accepted: "one column for each quantity; name the right one under [columns]".into(),
            });
        }
        used.insert(index, "the header");
    }
    if context.split_column.is_some() && !columns.has(Role::Split) {
        return Err(CampaignError::Column {
            file: context.file.into(),
            line: 1,
            column: context.split_column.unwrap_or_default().into(),
            found: "no such column, but `[split] column` names it".into(),
            accepted: "one of the table's columns".into(),
        });
    }
    Ok(())
}

/// The quantities of a key.
fn roles(name: &str, robot: &Robot) -> Option<Vec<Role>> {
    let one = |role: Role| Some(vec![role]);
    match name {
        "pose" => one(Role::Pose),
        "repeat" => one(Role::Repeat),
        "target" => one(Role::Target),
        "split" => one(Role::Split),
        "time" => one(Role::Time),
        "temperature" => one(Role::Temperature),
        "position" => Some(Role::POSITION.to_vec()),
        "orientation" => Some(Role::ORIENTATION.to_vec()),
        "force" => Some(Role::WRENCH[..3].to_vec()),
        "torque" => Some(Role::WRENCH[3..].to_vec()),
        "payload" => one(Role::PayloadMass),
        "payload_centre" => Some(Role::PAYLOAD_CENTRE.to_vec()),
        _ => {
            if let Some(joint) = robot.joint(name) {
                return one(Role::Joint(joint));
            }
            if let Some(joint) = name.strip_prefix("approach_").and_then(|n| robot.joint(n)) {
                return one(Role::Approach(joint));
            }
            let link = name
                .strip_prefix("temperature_")
                .and_then(|n| robot.link(n));
            link.map(|link| vec![Role::LinkTemperature(link)])
        }
    }
}

/// What a key of `[columns]` says.
fn entry(
    keys: &Keys<'_>,
    key: String,
    name: &str,
    value: &Value,
    robot: &Robot,
    target: Option<usize>,
) -> Result<Entry, CampaignError> {
    let Some(mut roles) = roles(name, robot) else {
        return unknown_quantity(keys, &key, robot);
    };
    let written = Written::of(keys, &key, value)?;
    let columns = match (written.column, written.columns) {
        (Some(word), None) => vec![word],
        (None, Some(words)) => words,
        _ => return keys.refuse(&key, "not one of `column` and `columns`".into(), WRITTEN),
    };
    let convention = match (name, written.convention) {
        ("orientation", word) => Some(convention(keys, &key, word.as_deref())?),
        (_, None) => None,
        (_, Some(word)) => {
            let accepted = "conventions for `orientation` alone";
            return keys.refuse(&format!("{key}.convention"), quoted(&word), accepted);
        }
    };
    if let Some(convention) = convention {
        roles.truncate(convention.count());
    }
    if columns.len() != roles.len() {
        return keys.refuse(
            &key,
            format!("{} columns", columns.len()),
            &format!("{} header words or numbers of columns", roles.len()),
        );
    }
    let dimension = match convention {
        Some(convention) => convention.has_unit().then_some(Dimension::Angle),
        None => roles[0].dimension(robot),
    };
    let unit = unit(keys, &key, written.unit.as_deref(), dimension)?;
    let (sign, offset) = (written.sign.unwrap_or(1.0), written.offset.unwrap_or(0.0));
    let turned = written_turn(&roles, sign, offset);
    if !turned {
        return keys.refuse(
            &key,
            format!("sign = {sign}, offset = {offset}"),
            "`sign` 1 or -1 and a finite `offset` in the column's unit, of a joint alone",
        );
    }
    Ok(Entry {
        key,
        roles,
        columns,
        unit,
        convention,
        sign,
        offset,
        target,
    })
}

fn unknown_quantity<T>(keys: &Keys<'_>, key: &str, robot: &Robot) -> Result<T, CampaignError> {
    let joints = robot.joints.iter().take(30);
    let joints: Vec<&str> = joints.map(|j| j.name.as_str()).collect();
    let accepted = format!(
        "joints of the robot ({}), position, orientation, pose, repeat, target, split, time, temperature, \
         force, torque, payload, payload_centre, approach_<joint>, temperature_<link>",
        joints.join(", ")
    );
    keys.refuse(key, "an unknown quantity".into(), &accepted)
}

fn unit(
    keys: &Keys<'_>,
    key: &str,
    word: Option<&str>,
    dimension: Option<Dimension>,
) -> Result<Option<&'static Unit>, CampaignError> {
    let Some(word) = word else {
        return Ok(None);
    };
    let accepted = match dimension {
        Some(dimension) => match units::spoken(word, dimension) {
            Some(unit) => return Ok(Some(unit)),
            None => units::names(Some(dimension)),
        },
        None => "no unit: it has none".to_owned(),
    };
    keys.refuse(&format!("{key}.unit"), quoted(word), &accepted)
}

/// Do sign and offset belong to a joint, or are there none?
fn written_turn(roles: &[Role], sign: f64, offset: f64) -> bool {
    let of_joint = matches!(roles, [Role::Joint(_)]);
    (sign == 1.0 && offset == 0.0) || (of_joint && sign.abs() == 1.0 && offset.is_finite())
}

fn convention(keys: &Keys<'_>, key: &str, word: Option<&str>) -> Result<Convention, CampaignError> {
    let key = format!("{key}.convention");
    let Some(word) = word else {
        return keys.refuse(&key, "none".into(), orientation::ACCEPTED);
    };
    match Convention::named(word) {
        Some(convention) => Ok(convention),
        None => keys.refuse(&key, quoted(word), orientation::ACCEPTED),
    }
}
