//! The CSV table of a campaign: one line for each reading.

use super::columns::{Columns, Role};
use super::error::CampaignError;
use super::row::{Part, Row};
use super::{Reading, Target};
use crate::robot::Robot;
use csv::{ByteRecord, ReaderBuilder};
use std::collections::BTreeMap;
use std::io;
use std::path::Path;

/// Longest line accepted, bytes; a longer one is not a table.
const LONGEST_LINE: usize = 1_000_000;

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
}

/// What stands in a table.
pub(super) struct Table {
    /// Readings in its order.
    pub(super) readings: Vec<Reading>,
    /// What the user should be told of it.
    pub(super) warnings: Vec<String>,
    /// Does a column say where some joint is?
    pub(super) has_joints: bool,
}

/// Reads a table.
pub(super) fn parse(context: &Context<'_>, bytes: &[u8]) -> Result<Table, CampaignError> {
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
    let mut joints = (0..context.robot.joints.len()).map(Role::Joint);
    Ok(Table {
        readings,
        warnings,
        has_joints: joints.any(|role| columns.has(role)),
    })
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
    if context.with_joints && !joints.iter().any(|role| columns.has(*role)) {
        columns.require(
            file,
            &joints,
            robot,
            "nor one for any other joint of the robot",
        )?;
    }
    Ok(columns)
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
    // Without folders: warnings are recorded, and a recording must not depend on where it was made.
    let file = Path::new(context.file)
        .file_name()
        .map_or(context.file.into(), |name| name.to_string_lossy());
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
