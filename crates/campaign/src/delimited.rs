//! Tables of text: lines of cells between delimiters, in whatever encoding.

use super::encoding::decoded;
use super::error::CampaignError;
use super::layout::{Delimiter, Layout};
use super::rows::Rows;
use crate::input::{self, InputError, LARGEST_TABLE, LONGEST_LINE};
use csv::{ByteRecord, ReaderBuilder};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read};
use std::rc::Rc;

/// Rows of a text: what is held in memory is one row.
pub(super) struct Delimited<'a> {
    file: &'a str,
    lines: Rc<RefCell<Lines>>,
    reader: csv::Reader<Counted<BufReader<Box<dyn Read + 'a>>>>,
    blanks: bool,
}

impl<'a> Delimited<'a> {
    /// Leaves out what is above the header.
    pub(super) fn new(
        file: &'a str,
        layout: &Layout,
        input: impl Read + 'a,
    ) -> Result<Self, CampaignError> {
        let decoded = decoded(input.take(LARGEST_TABLE + 1), layout.encoding);
        let mut input = BufReader::new(decoded);
        let mut lines = Lines {
            comment: layout.comment,
            ..Lines::default()
        };
        for line in 1..layout.header_row {
            let read = skip_line(&mut input).map_err(|source| unread(file, source))?;
            lines.read += read;
            if lines.read > LARGEST_TABLE {
                return Err(unread(file, input::too_large(LARGEST_TABLE)));
            }
            if read == 0 {
                return Err(CampaignError::Row {
                    file: file.into(),
                    line,
                    found: "the end of the file".into(),
                    accepted: format!("header words in line {}", layout.header_row),
                });
            }
        }
        (lines.above, lines.start) = (lines.read, lines.read);
        lines.passed = layout.header_row - 1;
        let lines = Rc::new(RefCell::new(lines));
        let mut builder = ReaderBuilder::new();
        builder
            .has_headers(false)
            .flexible(true)
            .comment(layout.comment);
        if let Delimiter::One(byte) = layout.delimiter {
            builder.delimiter(byte);
        } else {
            builder.delimiter(b' ');
        }
        Ok(Self {
            file,
            reader: builder.from_reader(Counted {
                input,
                lines: lines.clone(),
            }),
            lines,
            blanks: layout.delimiter == Delimiter::Blanks,
        })
    }
}

impl Rows for Delimited<'_> {
    fn next(&mut self, record: &mut ByteRecord) -> Result<Option<usize>, CampaignError> {
        let above = self.lines.borrow().above;
        let byte = self.reader.position().byte();
        self.lines.borrow_mut().leave(above + byte);
        let read = self.reader.read_byte_record(record);
        if self.lines.borrow().too_long {
            return Err(CampaignError::Row {
                file: self.file.into(),
                line: self.lines.borrow().passed + 1,
                found: "a row longer than 1 MB".into(),
                accepted:
                    "rows of at most 1 MB; a quote that is not closed goes on over the lines below"
                        .into(),
            });
        }
        if self.lines.borrow().read > LARGEST_TABLE {
            return Err(unread(self.file, input::too_large(LARGEST_TABLE)));
        }
        if !read.map_err(|error| unread(self.file, io::Error::other(error)))? {
            return Ok(None);
        }
        let start = above + record.position().map_or(0, csv::Position::byte);
        let line = self.lines.borrow_mut().leave(start);
        if self.blanks {
            let cells: ByteRecord = record
                .iter()
                .flat_map(|cell| cell.split(|byte| *byte == b'\t'))
                .filter(|cell| !cell.is_empty())
                .collect();
            *record = cells;
        }
        Ok(Some(line))
    }
}

fn unread(file: &str, source: impl Into<InputError>) -> CampaignError {
    CampaignError::Read {
        file: file.into(),
        source: source.into(),
    }
}

/// Leaves one line unread; how many bytes it had.
fn skip_line(input: &mut impl BufRead) -> io::Result<u64> {
    let mut count = 0;
    loop {
        let buffer = input.fill_buf()?;
        let end = buffer.iter().position(|byte| *byte == b'\n');
        let used = end.map_or(buffer.len(), |end| end + 1);
        let over = end.is_some() || used == 0;
        input.consume(used);
        count += used as u64;
        if over || count > LARGEST_TABLE {
            return Ok(count);
        }
    }
}

/// What the CSV reader takes in, its lines counted on the way: the reader's own count misses blank ones.
struct Counted<R> {
    input: R,
    lines: Rc<RefCell<Lines>>,
}

impl<R: Read> Read for Counted<R> {
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
    /// Of them those above the header.
    above: u64,
    /// Lines that begin with this character are comments.
    comment: Option<u8>,
    /// Where the next row begins, once blank lines are left behind.
    start: u64,
    /// Number of lines before that.
    passed: usize,
    /// Ends of whole lines, and whether a line is blank or a comment.
    ahead: VecDeque<(u64, bool)>,
    /// Has the line that is being read anything in it?
    begun: bool,
    /// Is it a comment?
    in_comment: bool,
    /// Is more of a row read than a row may have?
    too_long: bool,
}

impl Lines {
    fn pass(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.read += 1;
            match byte {
                b'\n' => {
                    self.ahead
                        .push_back((self.read, !self.begun || self.in_comment));
                    (self.begun, self.in_comment) = (false, false);
                }
                b'\r' => {}
                _ => {
                    self.in_comment |= !self.begun && Some(*byte) == self.comment;
                    self.begun = true;
                }
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
