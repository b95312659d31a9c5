//! The CSV table of a campaign: one line for each reading.

use super::Reading;
use super::columns::{Columns, Role};
use super::error::CampaignError;
use super::mapping::Context;
use super::row::{Part, Row};
use super::rows::Rows;
use crate::input::MOST_READINGS;
use csv::ByteRecord;
use std::collections::BTreeMap;
use std::path::Path;

/// What stands in a table.
pub(super) struct Table {
    /// Readings in its order.
    pub(super) readings: Vec<Reading>,
    /// What the user should be told of it.
    pub(super) warnings: Vec<String>,
    /// What was left out as the campaign file says.
    pub(super) notes: Vec<String>,
    /// Does a column say where some joint is?
    pub(super) has_joints: bool,
}

/// Reads a table, row by row: what is held in memory is one row and the readings.
pub(super) fn parse(context: &Context<'_>, rows: &mut dyn Rows) -> Result<Table, CampaignError> {
    let mut record = ByteRecord::new();
    let mut readings = Vec::new();
    let mut left_out = BTreeMap::new();
    let refuse = |found: &str| CampaignError::Row {
        file: context.file.into(),
        line: context.layout.header_row,
        found: found.into(),
        accepted: "a line of header words, then one line for each reading".into(),
    };
    let line = rows
        .next(&mut record)?
        .ok_or_else(|| refuse("an empty file"))?;
    let (columns, mut notes) = header(context, line, &record, rows)?;
    let mut unseen = 0;
    while let Some(line) = rows.next(&mut record)? {
        if context.mapping.is_some() && is_blank(&record) {
            continue;
        }
        let mut seen = 0;
        for columns in &columns {
            let row = Row {
                context,
                columns,
                line,
                record: &record,
            };
            row.check_count()?;
            if columns.target.is_some() && row.sees_nothing()? {
                continue;
            }
            if readings.len() == MOST_READINGS {
                return Err(CampaignError::Row {
                    file: context.file.into(),
                    line,
                    found: format!("more than {MOST_READINGS} readings"),
                    accepted: format!("at most {MOST_READINGS}"),
                });
            }
            readings.push(row.reading(&mut left_out)?);
            seen += 1;
        }
        unseen += usize::from(seen == 0);
    }
    if readings.is_empty() {
        return Err(refuse("a header without a single reading below it"));
    }
    if unseen > 0 {
        notes.push(format!("{unseen} rows without the position of any target"));
    }
    let name = short_name(context.file);
    let columns = &columns[0];
    let mut warnings = warnings(context, columns, &left_out, readings.len());
    warnings.extend(payload_without_centre(context, columns, &readings));
    let mut joints = (0..context.robot.joints.len()).map(Role::Joint);
    Ok(Table {
        readings,
        warnings,
        notes: notes.iter().map(|note| format!("{name}: {note}")).collect(),
        has_joints: joints.any(|role| columns.has(role)),
    })
}

/// Has a row nothing but empty cells, as spreadsheets write them below a table?
fn is_blank(record: &ByteRecord) -> bool {
    record
        .iter()
        .all(|cell| cell.iter().all(u8::is_ascii_whitespace))
}

/// Without folders: what is recorded must not depend on where it was made.
fn short_name(file: &str) -> String {
    Path::new(file)
        .file_name()
        .map_or(file.into(), |name| name.to_string_lossy().into_owned())
}

/// The columns, once the header is known to be complete.
fn header(
    context: &Context<'_>,
    line: usize,
    record: &ByteRecord,
    rows: &mut dyn Rows,
) -> Result<(Vec<Columns>, Vec<String>), CampaignError> {
    let file = context.file;
    let wanted = context.layout.header_row;
    if line != wanted {
        return Err(CampaignError::Row {
            file: file.into(),
            line: wanted,
            found: "a blank line".into(),
            accepted: "the header words".into(),
        });
    }
    let at_line = |error: CampaignError| error.at_line(line);
    let headers = words(file, record).map_err(at_line)?;
    let units = match context.layout.units_row {
        None => None,
        Some(row) => {
            let mut record = ByteRecord::new();
            if rows.next(&mut record)? != Some(row) {
                return Err(CampaignError::Row {
                    file: file.into(),
                    line: row,
                    found: "no units".into(),
                    accepted: "the first row below the header words, as `units_row` says".into(),
                });
            }
            Some(words(file, &record).map_err(|error| error.at_line(row))?)
        }
    };
    let (all, notes) = match context.mapping {
        None => {
            let columns = Columns::find(file, headers, context.robot, context.split_column);
            (vec![columns.map_err(at_line)?], Vec::new())
        }
        Some(mapping) => mapping
            .columns(context, headers, units.as_deref().unwrap_or_default())
            .map_err(at_line)?,
    };
    for columns in &all {
        complete(context, columns).map_err(at_line)?;
    }
    Ok((all, notes))
}

/// The words of a row.
fn words(file: &str, record: &ByteRecord) -> Result<Vec<String>, CampaignError> {
    let mut words = Vec::new();
    for (index, word) in record.iter().enumerate() {
        let word = std::str::from_utf8(word).map_err(|_| CampaignError::Column {
            file: file.into(),
            line: 1,
            column: format!("number {}", index + 1),
            found: "bytes that are not UTF-8".into(),
            accepted: "text in UTF-8".into(),
        })?;
        words.push(word.trim().to_owned());
    }
    Ok(words)
}

/// Refuses columns that lack what every reading needs, or a part of what they have begun.
fn complete(context: &Context<'_>, columns: &Columns) -> Result<(), CampaignError> {
    let (file, robot) = (context.file, context.robot);
    columns.require(file, &Role::POSITION, robot, "but a reading has a position")?;
    if columns.convention.is_none() && Role::ORIENTATION.iter().any(|role| columns.has(*role)) {
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
    if context.targets.len() > 1 && columns.target.is_none() {
        columns.require(
            file,
            &[Role::Target],
            robot,
            "but the campaign has several targets",
        )?;
    }
    let joints: Vec<Role> = (0..robot.joints.len()).map(Role::Joint).collect();
    if context.with_joints && !joints.iter().any(|role| columns.has(*role)) {
        columns.require(
            file,
            &joints,
            robot,
            "nor one for any other joint of the robot",
        )?;
    }
    Ok(())
}

/// A payload whose centre no column says hangs at the origin of its link: that has to be said.
fn payload_without_centre(
    context: &Context<'_>,
    columns: &Columns,
    readings: &[Reading],
) -> Option<String> {
    let loaded = readings
        .iter()
        .filter(|r| r.payload.is_some_and(|p| p.mass > 0.0));
    let count = loaded.count();
    let said = columns.has(Role::PAYLOAD_CENTRE[0]);
    (columns.has(Role::PayloadMass) && !said && count > 0 && context.with_joints).then(|| {
        format!(
            "{}: no column for the centre of the payload: it is taken to hang at the origin of the target's link in {count} \
             readings; accepted: payload_x_m, payload_y_m, payload_z_m, or the effect payload_com in the model",
            short_name(context.file)
        )
    })
}

/// How the warning of a joint without a column begins, behind the file.
pub(super) const NO_COLUMN: &str = "no column for";

/// What the user has to be told: nothing is set to zero in silence.
fn warnings(
    context: &Context<'_>,
    columns: &Columns,
    left_out: &BTreeMap<Part, (usize, usize)>,
    count: usize,
) -> Vec<String> {
    let robot = context.robot;
    let file = short_name(context.file);
    let mut warnings = Vec::new();
    let fixed: Vec<&str> = (0..robot.joints.len())
        .filter(|joint| !columns.has(Role::Joint(*joint)))
        .map(|joint| robot.joints[joint].name.as_str())
        .collect();
    if !fixed.is_empty() {
        warnings.push(format!(
            "{file}: {NO_COLUMN} {}: taken to stay at zero",
            fixed.join(", ")
        ));
    }
    if columns.unused_split {
        warnings.push(format!(
            "{file}: the column `split` is not used; `[split] column = \"split\"` in the campaign file would hold its rows out"
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
            "{file}: {rows} of {count} readings leave the {what} empty (first in line {first}): not given there"
        ));
    }
    warnings
}
