//! One line of a table to one reading.

use super::columns::{Columns, Role};
use super::decimal;
use super::error::{CampaignError, quoted};
use super::mapping::Context;
use super::orientation::unit_quaternion;
use super::{Payload, Reading, Split, Wrench};
use csv::ByteRecord;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// What a reading may lack although the table has its columns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Part {
    Time,
    Temperature,
    LinkTemperature(usize),
    Approach,
    Orientation,
    Wrench,
    Payload,
}

/// One line of the table.
pub(super) struct Row<'a> {
    pub(super) context: &'a Context<'a>,
    pub(super) columns: &'a Columns,
    pub(super) line: usize,
    pub(super) record: &'a ByteRecord,
}

impl Row<'_> {
    /// A cell for each header word.
    pub(super) fn check_count(&self) -> Result<(), CampaignError> {
        let (found, expected) = (self.record.len(), self.columns.headers.len());
        if found == expected {
            return Ok(());
        }
        // spreadsheets leave out what is empty at the end of a row, or write more of it
        let beyond = |cell: &[u8]| cell.iter().all(u8::is_ascii_whitespace);
        if self.columns.mapped && self.record.iter().skip(expected).all(beyond) {
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

    /// The reading; parts that it leaves empty are counted in `left_out` with the first line.
    pub(super) fn reading(
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
        let orientation = self.orientation()?;
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
            process: None,
        })
    }

    /// Is every cell of the position empty, as of a target that the tracker did not see?
    pub(super) fn sees_nothing(&self) -> Result<bool, CampaignError> {
        for role in Role::POSITION {
            if !self.text(role)?.unwrap_or_default().is_empty() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn orientation(&self) -> Result<Option<UnitQuaternion<f64>>, CampaignError> {
        let Some(convention) = self.columns.convention else {
            let q = self.group(&Role::ORIENTATION)?;
            return q.map(|q| self.unit_quaternion(&q)).transpose();
        };
        let Some(values) = self.group(&Role::ORIENTATION[..convention.count()])? else {
            return Ok(None);
        };
        match convention.rotation(&values) {
            Ok(rotation) => Ok(Some(rotation)),
            Err(norm) => {
                let found = format!("a quaternion of norm {norm}");
                let accepted = "a unit quaternion (norm 1 within 0.001)";
                self.refuse(Role::ORIENTATION[0], &found, accepted)
            }
        }
    }

    /// The cell's text; `None` if the table has no such column.
    fn text(&self, role: Role) -> Result<Option<&str>, CampaignError> {
        let Some(place) = self.columns.place(role) else {
            return Ok(None);
        };
        let bytes = self.record.get(place.index).unwrap_or_default();
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
        if let Some(target) = self.columns.target {
            return Ok(target);
        }
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
        let number = decimal::parse(text, self.columns.decimal)
            .map(|number| match self.columns.place(role) {
                Some(place) => place.to_inner(number),
                None => number,
            })
            .filter(|number| number.is_finite());
        match number {
            Some(number) => Ok(Some(number)),
            None => self.refuse(
                role,
                &quoted(text),
                decimal::accepted(text, self.columns.decimal),
            ),
        }
    }

    fn refuse<T>(&self, role: Role, found: &str, accepted: &str) -> Result<T, CampaignError> {
        let column = match self.columns.place(role) {
            Some(place) => self.columns.headers[place.index].clone(),
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
