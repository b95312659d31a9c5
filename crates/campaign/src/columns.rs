//! What each column of a table holds, found from its header word.

use super::error::{CampaignError, quoted};
use super::orientation::Convention;
use super::units::{self, Dimension, UNITS, Unit};
use crate::robot::{JointKind, Robot};
use std::collections::{BTreeMap, BTreeSet};

/// What a column holds. Indices are those of the robot's joints and links, or of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Role {
    Pose,
    Repeat,
    Target,
    Split,
    Time,
    Temperature,
    LinkTemperature(usize),
    Joint(usize),
    Approach(usize),
    Position(usize),
    Orientation(usize),
    Wrench(usize),
    PayloadMass,
    PayloadCentre(usize),
}

const POSITION: [&str; 3] = ["x", "y", "z"];
const ORIENTATION: [&str; 4] = ["qw", "qx", "qy", "qz"];
const WRENCH: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];
const PAYLOAD_CENTRE: [&str; 3] = ["payload_x", "payload_y", "payload_z"];

impl Role {
    /// Every role a table of this robot may have, in the order in which tables are written.
    pub(super) fn all(robot: &Robot) -> Vec<Self> {
        let mut all = vec![Self::Pose, Self::Repeat, Self::Target, Self::Split];
        all.extend([Self::Time, Self::Temperature]);
        all.extend((0..robot.links.len()).map(Self::LinkTemperature));
        all.extend((0..robot.joints.len()).map(Self::Joint));
        all.extend((0..robot.joints.len()).map(Self::Approach));
        all.extend(Self::POSITION);
        all.extend(Self::ORIENTATION);
        all.extend(Self::WRENCH);
        all.push(Self::PayloadMass);
        all.extend(Self::PAYLOAD_CENTRE);
        all
    }

    pub(super) const POSITION: [Self; 3] =
        [Self::Position(0), Self::Position(1), Self::Position(2)];
    pub(super) const ORIENTATION: [Self; 4] = [
        Self::Orientation(0),
        Self::Orientation(1),
        Self::Orientation(2),
        Self::Orientation(3),
    ];
    pub(super) const WRENCH: [Self; 6] = [
        Self::Wrench(0),
        Self::Wrench(1),
        Self::Wrench(2),
        Self::Wrench(3),
        Self::Wrench(4),
        Self::Wrench(5),
    ];
    pub(super) const PAYLOAD_CENTRE: [Self; 3] = [
        Self::PayloadCentre(0),
        Self::PayloadCentre(1),
        Self::PayloadCentre(2),
    ];

    /// The header word without its unit.
    fn quantity(self, robot: &Robot) -> String {
        match self {
            Self::Pose => "pose".into(),
            Self::Repeat => "repeat".into(),
            Self::Target => "target".into(),
            Self::Split => "split".into(),
            Self::Time => "time".into(),
            Self::Temperature => "temperature".into(),
            Self::LinkTemperature(link) => format!("temperature_{}", robot.links[link].name),
            Self::Joint(joint) => robot.joints[joint].name.clone(),
            Self::Approach(joint) => format!("approach_{}", robot.joints[joint].name),
            Self::Position(axis) => POSITION[axis].into(),
            Self::Orientation(axis) => ORIENTATION[axis].into(),
            Self::Wrench(axis) => WRENCH[axis].into(),
            Self::PayloadMass => "payload".into(),
            Self::PayloadCentre(axis) => PAYLOAD_CENTRE[axis].into(),
        }
    }

    /// `None` for labels and pure numbers, whose header word has no unit.
    pub(super) fn dimension(self, robot: &Robot) -> Option<Dimension> {
        match self {
            Self::Time => Some(Dimension::Time),
            Self::Temperature | Self::LinkTemperature(_) => Some(Dimension::Temperature),
            Self::Joint(joint) => Some(match robot.joints[joint].kind {
                JointKind::Revolute | JointKind::Continuous => Dimension::Angle,
                JointKind::Prismatic => Dimension::Length,
            }),
            Self::Position(_) | Self::PayloadCentre(_) => Some(Dimension::Length),
            Self::Wrench(axis) if axis < 3 => Some(Dimension::Force),
            Self::Wrench(_) => Some(Dimension::Torque),
            Self::PayloadMass => Some(Dimension::Mass),
            Self::Pose | Self::Repeat | Self::Target | Self::Split => None,
            Self::Approach(_) | Self::Orientation(_) => None,
        }
    }

    /// The header word in the unit used inside.
    pub(super) fn header(self, robot: &Robot) -> String {
        let quantity = self.quantity(robot);
        match UNITS
            .iter()
            .find(|u| Some(u.dimension) == self.dimension(robot))
        {
            Some(unit) => format!("{quantity}_{}", unit.name),
            None => quantity,
        }
    }
}

/// Where a quantity stands, and how its number becomes one of the inside: `sign × cell + offset`, then the unit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    /// Index of the column.
    pub(super) index: usize,
    pub(super) unit: Option<&'static Unit>,
    pub(super) sign: f64,
    /// In the unit of the column.
    pub(super) offset: f64,
}

impl Place {
    /// A number as it stands there.
    pub(super) fn plain(index: usize, unit: Option<&'static Unit>) -> Self {
        Self {
            index,
            unit,
            sign: 1.0,
            offset: 0.0,
        }
    }

    /// In units of the inside. A cell without sign and offset is converted as it is: no bit is lost.
    pub(super) fn to_inner(self, cell: f64) -> f64 {
        let number = match (self.sign, self.offset) {
            (1.0, 0.0) => cell,
            (sign, offset) => sign * cell + offset,
        };
        self.unit.map_or(number, |unit| (unit.to_inner)(number))
    }
}

/// The columns of one table, or of one target in it.
#[derive(Clone)]
pub(super) struct Columns {
    /// Header words in the order of the file.
    pub(super) headers: Vec<String>,
    at: BTreeMap<Role, Place>,
    /// A column `split` that the campaign file does not ask for.
    pub(super) unused_split: bool,
    /// How the orientation is written, if not as qw qx qy qz.
    pub(super) convention: Option<Convention>,
    /// The sign of decimals.
    pub(super) decimal: char,
    /// Whose position and orientation these are, where a row has those of several targets.
    pub(super) target: Option<usize>,
    /// Are the header words the user's own, so that a row need not have a cell for each?
    pub(super) mapped: bool,
}

impl Columns {
    /// Finds the role of every header word.
    pub(super) fn find(
        file: &str,
        headers: Vec<String>,
        robot: &Robot,
        split_column: Option<&str>,
    ) -> Result<Self, CampaignError> {
        let legal = Legal::of(robot);
        legal.check_split_column(file, split_column, &headers)?;
        let mut columns = Self::empty(Vec::new());
        for (index, header) in headers.iter().enumerate() {
            let (role, unit) = if Some(header.as_str()) == split_column {
                (Role::Split, None)
            } else {
                legal.look_up(file, index, header, &headers)?
            };
            if role == Role::Split && Some(header.as_str()) != split_column {
                columns.unused_split = true;
                continue;
            }
            if let Some(first) = columns.at.insert(role, Place::plain(index, unit)) {
                let first = first.index;
                return Err(CampaignError::Column {
                    file: file.into(),
                    line: 1,
                    column: header.clone(),
                    found: format!(
                        "the same quantity twice, in columns {} ({}) and {} ({})",
                        first + 1,
                        quoted(&headers[first]),
                        index + 1,
                        quoted(header)
                    ),
                    accepted: "one column for each quantity".into(),
                });
            }
        }
        columns.headers = headers;
        Ok(columns)
    }

    /// A table without a column that means anything yet.
    pub(super) fn empty(headers: Vec<String>) -> Self {
        Self {
            headers,
            at: BTreeMap::new(),
            unused_split: false,
            convention: None,
            decimal: '.',
            target: None,
            mapped: false,
        }
    }

    /// The same columns, to be filled up with those of one target.
    pub(super) fn of_target(&self, target: usize) -> Self {
        let mut columns = self.clone();
        columns.target = Some(target);
        columns
    }

    /// Gives a quantity its place; the place that it had.
    pub(super) fn put(&mut self, role: Role, place: Place) -> Option<Place> {
        self.at.insert(role, place)
    }

    /// Whether the table has this column.
    pub(super) fn has(&self, role: Role) -> bool {
        self.at.contains_key(&role)
    }

    /// Where the column stands in the file, its unit and sign.
    pub(super) fn place(&self, role: Role) -> Option<Place> {
        self.at.get(&role).copied()
    }

    /// Roles of the table in a fixed order.
    pub(super) fn roles(&self) -> impl Iterator<Item = Role> + '_ {
        self.at.keys().copied()
    }

    /// Refuses a table that lacks one of `roles`, saying why it is needed.
    pub(super) fn require(
        &self,
        file: &str,
        roles: &[Role],
        robot: &Robot,
        because: &str,
    ) -> Result<(), CampaignError> {
        match roles.iter().find(|role| !self.has(**role)) {
            None => Ok(()),
            Some(missing) => {
                let names: Vec<String> = roles.iter().map(|role| role.header(robot)).collect();
                Err(CampaignError::Column {
                    file: file.into(),
                    line: 1,
                    column: missing.header(robot),
                    found: format!("no such column, {because}"),
                    accepted: match self.mapped {
                        false => format!(
                            "the columns {} (known units are converted)",
                            names.join(" ")
                        ),
                        true => format!(
                            "the columns {}, or your own words for them under [columns]",
                            names.join(" ")
                        ),
                    },
                })
            }
        }
    }
}

/// What a header word of the plain format means, if it has a meaning that needs no context.
pub(super) fn plain_words(robot: &Robot) -> BTreeMap<String, (Role, Option<&'static Unit>)> {
    let legal = Legal::of(robot);
    let mut words = legal.words;
    words.retain(|word, _| !legal.ambiguous.contains(word));
    words
}

/// Every header word that a table of one robot may have.
struct Legal {
    words: BTreeMap<String, (Role, Option<&'static Unit>)>,
    /// Words that two roles claim: a sliding joint called `x` and the target's position.
    ambiguous: BTreeSet<String>,
    /// Quantities with a unit, and what they measure.
    quantities: BTreeMap<String, Vec<Dimension>>,
    /// The usual word of each role, to suggest.
    usual: Vec<String>,
}

impl Legal {
    fn of(robot: &Robot) -> Self {
        let mut legal = Self {
            words: BTreeMap::new(),
            ambiguous: BTreeSet::new(),
            quantities: BTreeMap::new(),
            usual: Vec::new(),
        };
        for role in Role::all(robot) {
            legal.usual.push(role.header(robot));
            let quantity = role.quantity(robot);
            match role.dimension(robot) {
                None => legal.add(quantity, role, None),
                Some(dimension) => {
                    for unit in UNITS.iter().filter(|u| u.dimension == dimension) {
                        legal.add(format!("{quantity}_{}", unit.name), role, Some(unit));
                    }
                    legal
                        .quantities
                        .entry(quantity)
                        .or_default()
                        .push(dimension);
                }
            }
        }
        legal
    }

    fn add(&mut self, word: String, role: Role, unit: Option<&'static Unit>) {
        if self.words.insert(word.clone(), (role, unit)).is_some() {
            self.ambiguous.insert(word);
        }
    }

    /// The split column may have any name that means nothing else, and must be there.
    fn check_split_column(
        &self,
        file: &str,
        split_column: Option<&str>,
        headers: &[String],
    ) -> Result<(), CampaignError> {
        let Some(name) = split_column else {
            return Ok(());
        };
        let refuse = |found: &str, accepted: String| {
            Err(CampaignError::Column {
                file: file.into(),
                line: 1,
                column: name.into(),
                found: found.into(),
                accepted,
            })
        };
        match self.words.get(name) {
            Some((role, _)) if *role != Role::Split => refuse(
                "a column with a meaning of its own, named by `[split] column` too",
                "another name for the column that holds fit and heldout".into(),
            ),
            _ if !headers.iter().any(|header| header == name) => {
                let words: Vec<String> = headers.iter().take(40).map(|h| quoted(h)).collect();
                refuse(
                    "no such column, but `[split] column` names it",
                    format!("one of the table's columns: {}", words.join(" ")),
                )
            }
            _ => Ok(()),
        }
    }

    fn look_up(
        &self,
        file: &str,
        index: usize,
        header: &str,
        headers: &[String],
    ) -> Result<(Role, Option<&'static Unit>), CampaignError> {
        let refuse = |found: String, accepted: String| {
            let column = if header.is_empty() {
                format!("number {}", index + 1)
            } else {
                header.chars().take(80).collect()
            };
            Err(CampaignError::Column {
                file: file.into(),
                line: 1,
                column,
                found,
                accepted,
            })
        };
        if self.ambiguous.contains(header) {
            return refuse(
                "a word that two quantities of this robot claim".into(),
                "names of joints and links that differ from the other columns; rename them in the robot file".into(),
            );
        }
        if let Some(known) = self.words.get(header) {
            return Ok(*known);
        }
        if header.is_empty() {
            return refuse(
                "no name".into(),
                "a header word for every column; a comma at the end of the line makes one more"
                    .into(),
            );
        }
        if headers.len() == 1 && header.contains([';', '\t']) {
            return refuse(
                "semicolons or tabs between the words".into(),
                "commas between columns, points in numbers".into(),
            );
        }
        let with_units = |dimensions: &[Dimension], quantity: &str| {
            let words: Vec<String> = UNITS
                .iter()
                .filter(|u| dimensions.contains(&u.dimension))
                .map(|u| format!("{quantity}_{}", u.name))
                .collect();
            words.join(", ")
        };
        if let Some(dimensions) = self.quantities.get(header) {
            return refuse("no unit".into(), with_units(dimensions, header));
        }
        if let Some((quantity, unit)) = header.rsplit_once('_')
            && let Some(dimensions) = self.quantities.get(quantity)
        {
            let accepted = with_units(dimensions, quantity);
            return if UNITS.iter().any(|u| u.name == unit) {
                refuse(
                    format!("the unit {}, which does not fit the quantity", quoted(unit)),
                    accepted,
                )
            } else {
                refuse(
                    format!("the unknown unit {}", quoted(unit)),
                    format!("{accepted} (known units: {})", units::names(None)),
                )
            };
        }
        refuse(
            "an unknown column".into(),
            format!("did you mean {}?", self.nearest(header)),
        )
    }

    /// The three words nearest to `header`.
    fn nearest(&self, header: &str) -> String {
        let mut ranked: Vec<(usize, &str)> = self
            .usual
            .iter()
            .map(|word| (distance(header, word), word.as_str()))
            .collect();
        ranked.sort();
        let words: Vec<String> = ranked
            .iter()
            .take(3)
            .map(|(_, word)| format!("`{word}`"))
            .collect();
        words.join(", ")
    }
}

/// Letters to insert, delete or replace to make `b` of `a`, case aside.
pub(super) fn distance(a: &str, b: &str) -> usize {
    // A header word may be a megabyte of garbage; its beginning tells enough.
    let letters = |s: &str| -> Vec<char> { s.to_lowercase().chars().take(64).collect() };
    let (a, b) = (letters(a), letters(b));
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.iter().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replace = diagonal + usize::from(x != y);
            diagonal = row[j + 1];
            row[j + 1] = replace.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}
