//! Tables in workbooks: a sheet of an xlsx file, row by row.
//!
//! What is unpacked is measured before anything is read of it: a workbook is a zip file of XML, and neither says in
//! advance how much memory it will take.

use super::error::{CampaignError, quoted};
use super::layout::Layout;
use super::rows::Rows;
use crate::input::{
    self, InputError, LARGEST_WORKBOOK, LARGEST_WORKBOOK_UNPACKED, LONGEST_LINE, MOST_READINGS,
};
use calamine::{Data, DataRef, Reader, Xlsx, XlsxError};
use csv::ByteRecord;
use quick_xml::events::Event;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::Path;
use zip::ZipArchive;

/// Most parts of a workbook: sheets, styles, pictures.
const MOST_PARTS: usize = 10_000;
/// Most bytes of the texts that cells share: each takes more in memory than in the file.
const MOST_TEXTS: u64 = 100_000_000;
/// Longest reference of a cell: XFD1048576.
const LONGEST_REFERENCE: usize = 10;

/// Rows of a sheet.
pub(super) struct Workbook {
    rows: VecDeque<(usize, ByteRecord)>,
}

impl Workbook {
    /// Reads the sheet that the layout names, or the only one, from the header row on.
    pub(super) fn open(path: &Path, file: &str, layout: &Layout) -> Result<Self, CampaignError> {
        let unread = |source: InputError| CampaignError::Read {
            file: file.into(),
            source,
        };
        let refused = |error: XlsxError| unread(io::Error::other(error).into());
        let mut input = input::open(path, LARGEST_WORKBOOK).map_err(unread)?;
        measure(&mut input).map_err(unread)?;
        input.rewind().map_err(|error| unread(error.into()))?;
        let mut workbook: Xlsx<_> = Xlsx::new(BufReader::new(input)).map_err(refused)?;
        let sheet = sheet(&workbook.sheet_names(), file, layout)?;
        let mut cells = workbook.worksheet_cells_reader(&sheet).map_err(refused)?;
        let mut rows = Filled::new(file, layout);
        while let Some(cell) = cells.next_cell().map_err(refused)? {
            let (row, column) = cell.get_position();
            rows.add(
                row as usize + 1,
                column as usize,
                &text(cell.get_value(), layout.decimal),
            )?;
        }
        Ok(Self { rows: rows.end()? })
    }
}

impl Rows for Workbook {
    fn next(&mut self, record: &mut ByteRecord) -> Result<Option<usize>, CampaignError> {
        Ok(self.rows.pop_front().map(|(number, row)| {
            *record = row;
            number
        }))
    }
}

fn sheet(names: &[String], file: &str, layout: &Layout) -> Result<String, CampaignError> {
    let refuse = |found: String| {
        let list: Vec<String> = names.iter().take(30).map(|name| quoted(name)).collect();
        Err(CampaignError::Row {
            file: file.into(),
            line: layout.header_row,
            found,
            accepted: format!("`sheet = …` under [table], one of {}", list.join(", ")),
        })
    };
    match &layout.sheet {
        Some(name) if names.contains(name) => Ok(name.clone()),
        Some(name) => refuse(format!("no sheet {}", quoted(name))),
        None => match names {
            [only] => Ok(only.clone()),
            _ => refuse(format!("{} sheets, and none is named", names.len())),
        },
    }
}

/// Rows that are being put together from cells.
struct Filled<'a> {
    file: &'a str,
    layout: &'a Layout,
    rows: VecDeque<(usize, ByteRecord)>,
    number: usize,
    cells: Vec<String>,
}

impl<'a> Filled<'a> {
    fn new(file: &'a str, layout: &'a Layout) -> Self {
        Self {
            file,
            layout,
            rows: VecDeque::new(),
            number: 0,
            cells: Vec::new(),
        }
    }

    fn add(&mut self, row: usize, column: usize, cell: &str) -> Result<(), CampaignError> {
        if cell.is_empty() || row < self.layout.header_row {
            return Ok(());
        }
        if row != self.number {
            self.close()?;
            if row < self.number {
                return self.refuse(row, "a row that stands behind later ones", "rows in order");
            }
            self.number = row;
        }
        const MOST_COLUMNS: usize = 16_384;
        if column >= MOST_COLUMNS {
            return self.refuse(row, "a cell beyond column XFD", "at most 16384 columns");
        }
        if self.cells.len() <= column {
            self.cells.resize(column + 1, String::new());
        }
        self.cells[column] = cell.to_owned();
        Ok(())
    }

    /// Ends the row that was being filled.
    fn close(&mut self) -> Result<(), CampaignError> {
        let comment = self.layout.comment.zip(self.cells.first());
        let is_comment = comment.is_some_and(|(mark, cell)| cell.as_bytes().first() == Some(&mark));
        if !self.cells.is_empty() && !is_comment {
            // the header and a row of units are no readings
            if self.rows.len() >= MOST_READINGS + 2 {
                let found = format!("more than {MOST_READINGS} readings");
                return self.refuse(self.number, &found, &format!("at most {MOST_READINGS}"));
            }
            let record =
                ByteRecord::from(self.cells.iter().map(String::as_str).collect::<Vec<_>>());
            self.rows.push_back((self.number, record));
        }
        self.cells.clear();
        Ok(())
    }

    fn end(mut self) -> Result<VecDeque<(usize, ByteRecord)>, CampaignError> {
        self.close()?;
        Ok(self.rows)
    }

    fn refuse<T>(&self, line: usize, found: &str, accepted: &str) -> Result<T, CampaignError> {
        Err(CampaignError::Row {
            file: self.file.into(),
            line,
            found: found.into(),
            accepted: accepted.into(),
        })
    }
}

/// A cell as a text table would have it. A number has as many digits as it takes to read it back.
fn text(value: &DataRef<'_>, decimal: char) -> String {
    let number = |number: f64| {
        let text = number.to_string();
        match decimal {
            '.' => text,
            _ => text.replace('.', ","),
        }
    };
    match value {
        DataRef::Empty => String::new(),
        DataRef::Int(value) => value.to_string(),
        DataRef::Float(value) => number(*value),
        DataRef::DateTime(value) => number(value.as_f64()),
        DataRef::SharedString(text) => (*text).to_owned(),
        other => Data::from(other.clone()).to_string(),
    }
}

/// Unpacks every part, leaving it unread but for claims that would cost memory: bombs, sizes and references that
/// no spreadsheet has.
fn measure(input: &mut File) -> Result<(), InputError> {
    let damaged = |error: zip::result::ZipError| InputError::System(io::Error::other(error));
    let mut archive = ZipArchive::new(BufReader::new(input)).map_err(damaged)?;
    if archive.len() > MOST_PARTS {
        return Err(InputError::Content {
            found: format!("{} parts in a workbook", archive.len()),
            accepted: format!("at most {MOST_PARTS}"),
        });
    }
    let mut left = LARGEST_WORKBOOK_UNPACKED;
    for index in 0..archive.len() {
        let part = archive.by_index(index).map_err(damaged)?;
        let name = part.name().map_err(damaged)?.to_ascii_lowercase();
        let mut part = Limited { part, left };
        if name.ends_with(".xml") || name.ends_with(".rels") {
            inspect(BufReader::new(&mut part), &name)?;
        }
        io::copy(&mut part, &mut io::sink())?;
        if name.ends_with("sharedstrings.xml") && left - part.left > MOST_TEXTS {
            return Err(InputError::Content {
                found: format!("more than {} of texts", input::size(MOST_TEXTS)),
                accepted: format!("at most {}", input::size(MOST_TEXTS)),
            });
        }
        left = part.left;
    }
    Ok(())
}

/// Ends with an error once more than what is left was unpacked.
struct Limited<R> {
    part: R,
    left: u64,
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.part.read(buffer)?;
        self.left = match self.left.checked_sub(count as u64) {
            Some(left) => left,
            None => {
                return Err(io::Error::other(format!(
                    "found a workbook that unpacks to more than {0}; accepted: at most {0}",
                    input::size(LARGEST_WORKBOOK_UNPACKED)
                )));
            }
        };
        Ok(count)
    }
}

/// Refuses counts and references in a part of XML that no spreadsheet writes: a reader would take memory for them.
fn inspect(part: impl io::BufRead, name: &str) -> Result<(), InputError> {
    let mut xml = quick_xml::Reader::from_reader(part);
    let mut buffer = Vec::new();
    loop {
        buffer.clear();
        // the longest that a cell may hold is 32767 letters
        let longest = |length: usize| match length <= LONGEST_LINE {
            true => Ok(()),
            false => Err(InputError::Content {
                found: format!("a piece of more than 1 MB in {name}"),
                accepted: "cells of at most 1 MB".into(),
            }),
        };
        let element = match xml.read_event_into(&mut buffer) {
            Ok(Event::Start(element) | Event::Empty(element)) => element,
            Ok(Event::Eof) => return Ok(()),
            Ok(event) => {
                longest(event.len())?;
                continue;
            }
            Err(quick_xml::Error::Io(error)) => {
                return Err(io::Error::other(error.to_string()).into());
            }
            // whoever reads the part says what is wrong with it
            Err(_) => return Ok(()),
        };
        longest(element.len())?;
        for attribute in element.attributes().with_checks(false).flatten() {
            let key = attribute.key.as_ref();
            let value: &str = attribute.value.as_ref();
            let count =
                key == "uniqueCount" && value.parse::<usize>().is_ok_and(|n| n > 10_000_000);
            let reference = key == "r"
                && value.len() > LONGEST_REFERENCE
                && ["c", "row"].contains(&element.local_name().as_ref());
            if count || reference {
                let shown: String = value.chars().take(40).collect();
                return Err(InputError::Content {
                    found: format!("{key} = {shown:?} in {name}"),
                    accepted: "at most 10000000 texts, and cells up to XFD1048576".into(),
                });
            }
        }
    }
}
