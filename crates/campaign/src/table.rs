//! The CSV table of a campaign: one line for each reading.

use super::columns::{Columns, Role};
use super::error::CampaignError;
use super::row::{Part, Row};
use super::{Reading, Target};
use crate::input::{self, InputError, LARGEST_TABLE, LONGEST_LINE, MOST_READINGS};
use crate::robot::Robot;
use csv::{ByteRecord, ReaderBuilder};
use std::cell::RefCell;
use std::collections::{BTreeMap, VecDeque};
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

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

/// Reads a table, row by row: what is held in memory is one row and the readings.
pub(super) fn parse(context: &Context<'_>, input: impl Read) -> Result<Table, CampaignError> {
    let unread = |source: InputError| CampaignError::Read {
        file: context.file.into(),
        source,
    };
    let mut input = BufReader::new(input.take(LARGEST_TABLE + 1));
    const MARK: &[u8] = b"\xef\xbb\xbf";
    if input
        .fill_buf()
        .map_err(|e| unread(e.into()))?
        .starts_with(MARK)
    {
        input.consume(MARK.len());
    }
    let lines = RefCell::new(Lines::default());
    let mut reader = ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .from_reader(Counted {
            input,
            lines: &lines,
        });
    let mut record = ByteRecord::new();
    let mut columns = None;
    let mut readings = Vec::new();
    let mut left_out = BTreeMap::new();
    loop {
        lines.borrow_mut().leave(reader.position().byte());
        let read = reader.read_byte_record(&mut record);
        if lines.borrow().too_long {
            return Err(CampaignError::Row {
                file: context.file.into(),
                line: lines.borrow().passed + 1,
                found: "a row longer than 1 MB".into(),
                accepted:
                    "rows of at most 1 MB; a quote that is not closed goes on over the lines below"
                        .into(),
            });
        }
        if lines.borrow().read > LARGEST_TABLE {
            return Err(unread(input::too_large(LARGEST_TABLE)));
        }
        if !read.map_err(|error| unread(io::Error::other(error).into()))? {
            break;
        }
        let start = record.position().map_or(0, csv::Position::byte);
        let line = lines.borrow_mut().leave(start);
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
        if readings.len() == MOST_READINGS {
            return Err(CampaignError::Row {
                file: context.file.into(),
                line,
                found: format!("more than {MOST_READINGS} readings"),
                accepted: format!("at most {MOST_READINGS}"),
            });
        }
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

/// What the CSV reader takes in, its lines counted on the way: the reader's own count misses blank ones.
struct Counted<'a, R> {
    input: R,
    lines: &'a RefCell<Lines>,
}

impl<R: Read> Read for Counted<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        // An end of the input, as the reader sees it: it must not go on with a row that has no end.
        let mut lines = self.lines.borrow_mut();
        let start = lines.start;
        lines.leave(start);
        lines.too_long = lines.read > lines.start + LONGEST_LINE as u64;
        if lines.too_long {
            return Ok(0);
        }
        let count = self.input.read(buffer)?;
        lines.pass(&buffer[..count]);
        Ok(count)
    }
}

/// Lines that were read and whose rows are still to come.
#[derive(Default)]
struct Lines {
    /// Bytes read.
    read: u64,
    /// Where the next row begins, once blank lines are left behind.
    start: u64,
    /// Number of lines before that.
    passed: usize,
    /// Ends of whole lines, and whether a line is blank.
    ahead: VecDeque<(u64, bool)>,
    /// Has the line that is being read anything in it?
    begun: bool,
    /// Is more of a row read than a row may have?
    too_long: bool,
}

impl Lines {
    fn pass(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.read += 1;
            match byte {
                b'\n' => {
                    self.ahead.push_back((self.read, !self.begun));
                    self.begun = false;
                }
                b'\r' => {}
                _ => self.begun = true,
            }
        }
    }

    /// Leaves the lines that end before a byte, and blank ones behind it; the number of the line that comes next.
    fn leave(&mut self, start: u64) -> usize {
        self.start = self.start.max(start);
        // between the two bytes of a line's end the row is over too
        while let Some(&(end, blank)) = self.ahead.front()
            && (end <= self.start + 1 || blank)
        {
            self.ahead.pop_front();
            self.passed += 1;
            self.start = self.start.max(end);
        }
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
