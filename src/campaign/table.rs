//! The CSV table of a campaign: one line for each reading.

use super::columns::{Columns, Role};
use super::error::{CampaignError, quoted};
use super::{Campaign, Payload, Reading, Split, Target, Wrench};
use crate::robot::Robot;
use csv::{ByteRecord, ReaderBuilder, WriterBuilder};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::io;

/// Longest line accepted, bytes; a longer one is not a table.
const LONGEST_LINE: usize = 1_000_000;

/// How far a quaternion's norm may be from 1 before it is taken for a mistake.
const NORM_TOLERANCE: f64 = 1e-3;

/// What the campaign file says that a table is read with.
pub(super) struct Context<'a> {
    /// Name of the table for messages.
    pub(super) file: &'a str,
    pub(super) robot: &'a Robot,
    pub(super) targets: &'a [Target],
    /// Column that holds `fit` and `heldout`.
    pub(super) split_column: Option<&'a str>,
}

/// Readings in the order of the table, and what the user should be told of it.
pub(super) fn parse(
    context: &Context<'_>,
    bytes: &[u8],
) -> Result<(Vec<Reading>, Vec<String>), CampaignError> {
    check_lines(context.file, bytes)?;
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(bytes);
    let mut record = ByteRecord::new();
    let mut lines = Lines::default();
    let mut columns = None;
    let mut readings = Vec::new();
    let mut left_out = BTreeMap::new();
    while reader
        .read_byte_record(&mut record)
        .map_err(|error| CampaignError::Read {
            file: context.file.into(),
            source: io::Error::other(error),
        })?
    {
        let line = lines.of(bytes, &record);
        let Some(columns) = &columns else {
            columns = Some(header(context, line, &record)?);
            continue;
        };
        let row = Row {
            context,
            columns,
            line,
            record: &record,
        };
        row.check_count()?;
        readings.push(row.reading(&mut left_out)?);
    }
    let refuse = |found: &str| CampaignError::Row {
        file: context.file.into(),
        line: 1,
        found: found.into(),
        accepted: "a line of header words, then one line for each reading".into(),
    };
    let columns = columns.ok_or_else(|| refuse("an empty file"))?;
    if readings.is_empty() {
        return Err(refuse("a header without a single reading below it"));
    }
    let warnings = warnings(context, &columns, &left_out, readings.len());
    Ok((readings, warnings))
}

/// Refuses lines so long that the file cannot be a table.
fn check_lines(file: &str, bytes: &[u8]) -> Result<(), CampaignError> {
    match bytes
        .split(|byte| *byte == b'\n')
        .position(|line| line.len() > LONGEST_LINE)
    {
        None => Ok(()),
        Some(index) => Err(CampaignError::Row {
            file: file.into(),
            line: index + 1,
            found: "a line longer than 1 MB".into(),
            accepted: "lines of at most 1 MB".into(),
        }),
    }
}

/// Counts lines on the way through the table: the CSV reader's own count misses blank ones.
#[derive(Default)]
struct Lines {
    offset: usize,
    passed: usize,
}

impl Lines {
    /// Line on which the record begins.
    fn of(&mut self, bytes: &[u8], record: &ByteRecord) -> usize {
        let start = record
            .position()
            .and_then(|position| usize::try_from(position.byte()).ok())
            .unwrap_or(self.offset)
            .clamp(self.offset, bytes.len());
        let blank = bytes[start..]
            .iter()
            .take_while(|byte| matches!(byte, b'\n' | b'\r'))
            .count();
        let newlines = |part: &[u8]| part.iter().filter(|byte| **byte == b'\n').count();
        self.passed += newlines(&bytes[self.offset..start + blank]);
        self.offset = start + blank;
        self.passed + 1
    }
}

/// The columns, once the header is known to be complete.
fn header(
    context: &Context<'_>,
    line: usize,
    record: &ByteRecord,
) -> Result<Columns, CampaignError> {
    let file = context.file;
    if line != 1 {
        return Err(CampaignError::Row {
            file: file.into(),
            line: 1,
            found: "a blank line".into(),
            accepted: "the header words".into(),
        });
    }
    let mut headers = Vec::new();
    for (index, word) in record.iter().enumerate() {
        let word = std::str::from_utf8(word).map_err(|_| CampaignError::Column {
            file: file.into(),
            column: format!("number {}", index + 1),
            found: "bytes that are not UTF-8".into(),
            accepted: "text in UTF-8".into(),
        })?;
        headers.push(word.trim().to_owned());
    }
    let robot = context.robot;
    let columns = Columns::find(file, headers, robot, context.split_column)?;
    columns.require(file, &Role::POSITION, robot, "but a reading has a position")?;
    if Role::ORIENTATION.iter().any(|role| columns.has(*role)) {
        columns.require(
            file,
            &Role::ORIENTATION,
            robot,
            "but other parts of the orientation are there",
        )?;
    }
    if Role::WRENCH.iter().any(|role| columns.has(*role)) {
        columns.require(
            file,
            &Role::WRENCH,
            robot,
            "but other parts of the wrench are there",
        )?;
    }
    if Role::PAYLOAD_CENTRE.iter().any(|role| columns.has(*role)) {
        let mut roles = vec![Role::PayloadMass];
        roles.extend(Role::PAYLOAD_CENTRE);
        columns.require(
            file,
            &roles,
            robot,
            "but other parts of the payload are there",
        )?;
    }
    if context.targets.len() > 1 {
        columns.require(
            file,
            &[Role::Target],
            robot,
            "but the campaign has several targets",
        )?;
    }
    let joints: Vec<Role> = (0..robot.joints.len()).map(Role::Joint).collect();
    if !joints.is_empty() && !joints.iter().any(|role| columns.has(*role)) {
        columns.require(
            file,
            &joints,
            robot,
            "nor one for any other joint of the robot",
        )?;
    }
    Ok(columns)
}

/// What a reading may lack although the table has its columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Time,
    Temperature,
    LinkTemperature(usize),
    Approach,
    Orientation,
    Wrench,
    Payload,
}

/// What the user has to be told: nothing is set to zero in silence.
fn warnings(
    context: &Context<'_>,
    columns: &Columns,
    left_out: &BTreeMap<Part, (usize, usize)>,
    count: usize,
) -> Vec<String> {
    let robot = context.robot;
    let mut warnings = Vec::new();
    let fixed: Vec<&str> = (0..robot.joints.len())
        .filter(|joint| !columns.has(Role::Joint(*joint)))
        .map(|joint| robot.joints[joint].name.as_str())
        .collect();
    if !fixed.is_empty() {
        warnings.push(format!(
            "{}: no column for {}: taken to stay at zero",
            context.file,
            fixed.join(", ")
        ));
    }
    if columns.unused_split {
        warnings.push(format!(
            "{}: the column `split` is not used; `[split] column = \"split\"` in the campaign file would hold its rows out",
            context.file
        ));
    }
    for (part, (rows, first)) in left_out {
        let what = match part {
            Part::Time => "time".to_owned(),
            Part::Temperature => "temperature".to_owned(),
            Part::LinkTemperature(link) => format!("temperature of {}", robot.links[*link].name),
            Part::Approach => "approach".to_owned(),
            Part::Orientation => "orientation".to_owned(),
            Part::Wrench => "wrench".to_owned(),
            Part::Payload => "payload".to_owned(),
        };
        warnings.push(format!(
            "{}: {rows} of {count} readings leave the {what} empty (first in line {first}): not given there",
            context.file
        ));
    }
    warnings
}

/// One line of the table.
struct Row<'a> {
    context: &'a Context<'a>,
    columns: &'a Columns,
    line: usize,
    record: &'a ByteRecord,
}

impl Row<'_> {
    fn check_count(&self) -> Result<(), CampaignError> {
        let (found, expected) = (self.record.len(), self.columns.headers.len());
        if found == expected {
            return Ok(());
        }
        let cells = if found == 1 { "cell" } else { "cells" };
        Err(CampaignError::Row {
            file: self.context.file.into(),
            line: self.line,
            found: format!("{found} {cells}"),
            accepted: format!("{expected}, one for each word of the header"),
        })
    }

    fn reading(
        &self,
        left_out: &mut BTreeMap<Part, (usize, usize)>,
    ) -> Result<Reading, CampaignError> {
        let mut missing = |part| {
            left_out.entry(part).or_insert((0, self.line)).0 += 1;
        };
        let mut note = |present: bool, role: Role, part: Part| {
            if !present && self.columns.has(role) {
                missing(part);
            }
        };
        let robot = self.context.robot;

        let mut joints = Vec::with_capacity(robot.joints.len());
        for joint in 0..robot.joints.len() {
            let role = Role::Joint(joint);
            joints.push(match self.columns.has(role) {
                true => self.required(role)?,
                false => 0.0,
            });
        }
        let mut position = Vector3::zeros();
        for (axis, role) in Role::POSITION.into_iter().enumerate() {
            position[axis] = self.required(role)?;
        }
        let orientation = match self.group(&Role::ORIENTATION)? {
            Some(q) => Some(self.unit_quaternion(&q)?),
            None => None,
        };
        note(
            orientation.is_some(),
            Role::ORIENTATION[0],
            Part::Orientation,
        );
        let wrench = self.group(&Role::WRENCH)?.map(|w| Wrench {
            force: Vector3::new(w[0], w[1], w[2]),
            torque: Vector3::new(w[3], w[4], w[5]),
        });
        note(wrench.is_some(), Role::WRENCH[0], Part::Wrench);
        let payload = self.payload()?;
        note(payload.is_some(), Role::PayloadMass, Part::Payload);
        let approach = self.approach()?;
        if let Some(role) = self
            .columns
            .roles()
            .find(|r| matches!(r, Role::Approach(_)))
        {
            note(approach.is_some(), role, Part::Approach);
        }
        let time = self.optional(Role::Time)?;
        note(time.is_some(), Role::Time, Part::Time);
        let temperature = self.optional(Role::Temperature)?;
        note(temperature.is_some(), Role::Temperature, Part::Temperature);
        let mut link_temperatures = Vec::new();
        for link in 0..robot.links.len() {
            let role = Role::LinkTemperature(link);
            let value = self.optional(role)?;
            note(value.is_some(), role, Part::LinkTemperature(link));
            link_temperatures.extend(value.map(|value| (link, value)));
        }
        Ok(Reading {
            line: self.line,
            pose: self.label(Role::Pose)?,
            repeat: self.label(Role::Repeat)?,
            target: self.target()?,
            split: self.split()?,
            time,
            temperature,
            link_temperatures,
            joints,
            approach,
            position,
            orientation,
            wrench,
            payload,
        })
    }

    /// The cell's text; `None` if the table has no such column.
    fn text(&self, role: Role) -> Result<Option<&str>, CampaignError> {
        let Some((index, _)) = self.columns.place(role) else {
            return Ok(None);
        };
        let bytes = self.record.get(index).unwrap_or_default();
        match std::str::from_utf8(bytes) {
            Ok(text) => Ok(Some(text.trim())),
            Err(_) => self.refuse(role, "bytes that are not UTF-8", "text in UTF-8"),
        }
    }

    /// A label, which may be left empty.
    fn label(&self, role: Role) -> Result<Option<String>, CampaignError> {
        match self.text(role)? {
            None | Some("") => Ok(None),
            Some(text) if text.chars().any(char::is_control) => self.refuse(
                role,
                &quoted(text),
                "a label without line breaks or other control characters",
            ),
            Some(text) => Ok(Some(text.to_owned())),
        }
    }

    fn target(&self) -> Result<usize, CampaignError> {
        let targets = self.context.targets;
        let Some(name) = self.text(Role::Target)? else {
            return Ok(0);
        };
        match targets.iter().position(|target| target.name == name) {
            Some(index) => Ok(index),
            None => {
                let names: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
                let accepted = format!("a target of the campaign file: {}", names.join(", "));
                self.refuse(Role::Target, &quoted(name), &accepted)
            }
        }
    }

    fn split(&self) -> Result<Split, CampaignError> {
        match self.text(Role::Split)? {
            None | Some("fit") => Ok(Split::Fit),
            Some("heldout") => Ok(Split::Heldout),
            Some(word) => self.refuse(Role::Split, &quoted(word), "fit or heldout"),
        }
    }

    fn payload(&self) -> Result<Option<Payload>, CampaignError> {
        let mass = self.optional(Role::PayloadMass)?;
        let com = self.group(&Role::PAYLOAD_CENTRE)?;
        match (mass, com) {
            (None, None) => Ok(None),
            (None, Some(_)) => self.refuse(
                Role::PayloadMass,
                &quoted(""),
                "a number, or the centre of mass left empty too",
            ),
            (Some(mass), _) if mass < 0.0 => {
                let found = self.text(Role::PayloadMass)?.unwrap_or_default();
                self.refuse(Role::PayloadMass, &quoted(found), "a mass of zero or more")
            }
            (Some(mass), com) => Ok(Some(Payload {
                mass,
                com: com.map_or_else(Vector3::zeros, |c| Vector3::new(c[0], c[1], c[2])),
            })),
        }
    }

    /// Joints without a column count as not moved.
    fn approach(&self) -> Result<Option<Vec<f64>>, CampaignError> {
        let roles: Vec<Role> = self
            .columns
            .roles()
            .filter(|role| matches!(role, Role::Approach(_)))
            .collect();
        let Some(values) = self.group(&roles)? else {
            return Ok(None);
        };
        let mut approach = vec![0.0; self.context.robot.joints.len()];
        for (role, value) in roles.into_iter().zip(values) {
            if ![-1.0, 0.0, 1.0].contains(&value) {
                let found = self.text(role)?.unwrap_or_default();
                return self.refuse(role, &quoted(found), "-1, 0 or 1");
            }
            if let Role::Approach(joint) = role {
                approach[joint] = value;
            }
        }
        Ok(Some(approach))
    }

    fn unit_quaternion(&self, q: &[f64]) -> Result<UnitQuaternion<f64>, CampaignError> {
        match unit_quaternion([q[0], q[1], q[2], q[3]]) {
            Ok(q) => Ok(q),
            Err(norm) => {
                let found = format!("qw qx qy qz of norm {norm}");
                self.refuse(
                    Role::ORIENTATION[0],
                    &found,
                    "a unit quaternion (norm 1 within 0.001)",
                )
            }
        }
    }

    /// All cells of the group, or `None` if every one is empty or there are no such columns.
    fn group(&self, roles: &[Role]) -> Result<Option<Vec<f64>>, CampaignError> {
        let mut empty = None;
        let mut values = Vec::with_capacity(roles.len());
        for role in roles {
            match self.optional(*role)? {
                Some(value) => values.push(value),
                None => empty = empty.or(Some(*role)),
            }
        }
        match empty {
            None if roles.is_empty() => Ok(None),
            None => Ok(Some(values)),
            Some(_) if values.is_empty() => Ok(None),
            Some(role) => {
                let robot = self.context.robot;
                let names: Vec<String> = roles.iter().map(|r| r.header(robot)).collect();
                let accepted = format!("a number, or all of {} empty", names.join(" "));
                self.refuse(role, &quoted(""), &accepted)
            }
        }
    }

    fn required(&self, role: Role) -> Result<f64, CampaignError> {
        match self.optional(role)? {
            Some(value) => Ok(value),
            None => self.refuse(role, &quoted(""), "a number"),
        }
    }

    /// The number in units of the inside; `None` if the cell is empty or there is no such column.
    fn optional(&self, role: Role) -> Result<Option<f64>, CampaignError> {
        let text = match self.text(role)? {
            None | Some("") => return Ok(None),
            Some(text) => text,
        };
        let unit = self.columns.place(role).and_then(|(_, unit)| unit);
        let value = text
            .parse::<f64>()
            .ok()
            .map(|number| unit.map_or(number, |unit| (unit.to_inner)(number)));
        match value {
            Some(value) if value.is_finite() => Ok(Some(value)),
            _ => self.refuse(
                role,
                &quoted(text),
                "a finite number, with a point for decimals",
            ),
        }
    }

    fn refuse<T>(&self, role: Role, found: &str, accepted: &str) -> Result<T, CampaignError> {
        let column = match self.columns.place(role) {
            Some((index, _)) => self.columns.headers[index].clone(),
            None => role.header(self.context.robot),
        };
        Err(CampaignError::Cell {
            file: self.context.file.into(),
            line: self.line,
            column,
            found: found.into(),
            accepted: accepted.into(),
        })
    }
}

/// A quaternion `[w, x, y, z]` made a unit one; its norm if that is too far from 1.
///
/// One that is a unit quaternion but for rounding is kept bit for bit, so that reading and
/// writing again changes nothing.
pub(crate) fn unit_quaternion(q: [f64; 4]) -> Result<UnitQuaternion<f64>, f64> {
    let quaternion = Quaternion::new(q[0], q[1], q[2], q[3]);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() <= 1e-12 {
        Ok(UnitQuaternion::new_unchecked(quaternion))
    } else if (norm - 1.0).abs() <= NORM_TOLERANCE {
        Ok(UnitQuaternion::new_normalize(quaternion))
    } else {
        Err(norm)
    }
}

/// The table of a campaign, with only the columns that some reading fills.
///
/// Numbers have as many digits as it takes to read back the very same ones.
pub(super) fn render(campaign: &Campaign) -> io::Result<Vec<u8>> {
    let robot = &campaign.robot;
    let roles: Vec<Role> = Role::all(robot)
        .into_iter()
        .filter(|role| match role {
            Role::Target => campaign.targets.len() > 1,
            Role::Split => campaign.readings.iter().any(|r| r.split != Split::Fit),
            Role::Joint(_) | Role::Position(_) => true,
            _ => campaign
                .readings
                .iter()
                .any(|reading| !cell(campaign, reading, *role).is_empty()),
        })
        .collect();
    let headers: Vec<String> = roles.iter().map(|role| role.header(robot)).collect();
    let mut seen = BTreeSet::new();
    if let Some(twice) = headers.iter().find(|header| !seen.insert(*header)) {
        return Err(io::Error::other(format!(
            "two columns would be called `{twice}`; rename the joint or link in the robot file"
        )));
    }
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    writer.write_record(&headers)?;
    for reading in &campaign.readings {
        writer.write_record(roles.iter().map(|role| cell(campaign, reading, *role)))?;
    }
    writer
        .into_inner()
        .map_err(|error| io::Error::other(error.to_string()))
}

/// What stands in one cell; empty if the reading has no such part.
fn cell(campaign: &Campaign, reading: &Reading, role: Role) -> String {
    let number = |x: f64| format!("{x:?}");
    let optional = |x: Option<f64>| x.map(number).unwrap_or_default();
    match role {
        Role::Pose => reading.pose.clone().unwrap_or_default(),
        Role::Repeat => reading.repeat.clone().unwrap_or_default(),
        Role::Target => campaign.targets[reading.target].name.clone(),
        Role::Split => match reading.split {
            Split::Fit => "fit".into(),
            Split::Heldout => "heldout".into(),
        },
        Role::Time => optional(reading.time),
        Role::Temperature => optional(reading.temperature),
        Role::LinkTemperature(link) => optional(
            reading
                .link_temperatures
                .iter()
                .find(|(index, _)| *index == link)
                .map(|(_, value)| *value),
        ),
        Role::Joint(joint) => number(reading.joints[joint]),
        Role::Approach(joint) => reading
            .approach
            .as_ref()
            .map(|approach| format!("{}", approach[joint]))
            .unwrap_or_default(),
        Role::Position(axis) => number(reading.position[axis]),
        // nalgebra keeps quaternions as (x, y, z, w).
        Role::Orientation(axis) => optional(
            reading
                .orientation
                .map(|q| q.coords[if axis == 0 { 3 } else { axis - 1 }]),
        ),
        Role::Wrench(axis) => optional(reading.wrench.map(|w| match axis {
            0..3 => w.force[axis],
            _ => w.torque[axis - 3],
        })),
        Role::PayloadMass => optional(reading.payload.map(|p| p.mass)),
        Role::PayloadCentre(axis) => optional(reading.payload.map(|p| p.com[axis])),
    }
}
