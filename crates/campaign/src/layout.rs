//! How a table is laid out: what `[table]` of a campaign file says of delimiters, header rows and sheets.

use super::encoding::{self, Encoding};
use super::error::{CampaignError, quoted};
use super::keys::Keys;
use serde::Deserialize;
use toml::Value;

/// What separates the cells of a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delimiter {
    /// This one ASCII character.
    One(u8),
    /// Any number of blanks and tabs.
    Blanks,
}

/// The layout of a table; rows are counted from 1 as an editor or a spreadsheet counts them.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    /// Path as the campaign file has it.
    pub file: String,
    pub delimiter: Delimiter,
    /// `.` or `,`.
    pub decimal: char,
    /// Row of the header words; what is above is not read.
    pub header_row: usize,
    /// Row of units below the header words.
    pub units_row: Option<usize>,
    /// Lines that begin with this character are left out.
    pub comment: Option<u8>,
    /// Where there is no byte order mark; UTF-8 if left out.
    pub encoding: Option<Encoding>,
    /// Sheet of a workbook; its only one, if left out.
    pub sheet: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    #[serde(alias = "path")]
    file: String,
    delimiter: Option<String>,
    decimal: Option<String>,
    header_row: Option<usize>,
    units_row: Option<usize>,
    comment: Option<String>,
    encoding: Option<String>,
    sheet: Option<String>,
}

impl Layout {
    /// Plain CSV: commas, points, the header in the first row.
    pub fn plain(file: &str) -> Self {
        Self {
            file: file.into(),
            delimiter: Delimiter::One(b','),
            decimal: '.',
            header_row: 1,
            units_row: None,
            comment: None,
            encoding: None,
            sheet: None,
        }
    }

    /// Is it a workbook by its ending, and not a text?
    pub fn is_workbook(&self) -> bool {
        let ending = std::path::Path::new(&self.file).extension();
        ending.is_some_and(|e| e.eq_ignore_ascii_case("xlsx") || e.eq_ignore_ascii_case("xlsm"))
    }

    /// The layout that `table` says: a path, or a table with the path and what differs from plain CSV.
    pub fn settle(keys: &Keys<'_>, value: &Value) -> Result<Self, CampaignError> {
        let entry: Entry = match value {
            Value::String(file) => return Ok(Self::plain(file)),
            Value::Table(table) => match table.clone().try_into() {
                Ok(entry) => entry,
                Err(error) => {
                    let error: toml::de::Error = error;
                    return keys.refuse(
                        "table",
                        error.message().to_owned(),
                        "file, delimiter, decimal, header_row, units_row, comment, encoding, sheet",
                    );
                }
            },
            _ => {
                return keys.refuse(
                    "table",
                    value.type_str().into(),
                    "the path of a table, or [table] with `file` and what differs from plain CSV",
                );
            }
        };
        let mut layout = Self::plain(&entry.file);
        layout.sheet = entry.sheet;
        if let Some(word) = &entry.decimal {
            layout.decimal = match word.as_str() {
                "." => '.',
                "," => ',',
                _ => return keys.refuse("table.decimal", quoted(word), "\".\" or \",\""),
            };
        }
        layout.delimiter = match &entry.delimiter {
            Some(word) => delimiter(keys, word)?,
            // a decimal comma leaves the semicolon, as spreadsheets do
            None if layout.decimal == ',' => Delimiter::One(b';'),
            None => layout.delimiter,
        };
        if layout.delimiter == Delimiter::One(layout.decimal as u8) {
            return keys.refuse(
                "table.delimiter",
                format!("{:?}, which is the decimal sign too", layout.decimal),
                "two different characters",
            );
        }
        if let Some(row) = entry.header_row {
            if row == 0 {
                let accepted = "the row of the header words, counted from 1";
                return keys.refuse("table.header_row", "0".into(), accepted);
            }
            layout.header_row = row;
        }
        if let Some(row) = entry.units_row {
            if row <= layout.header_row {
                return keys.refuse(
                    "table.units_row",
                    row.to_string(),
                    &format!("a row below the header in row {}", layout.header_row),
                );
            }
            layout.units_row = Some(row);
        }
        layout.comment = match entry.comment.as_deref().map(str::as_bytes) {
            None | Some([]) => None,
            Some([one]) if one.is_ascii_graphic() => Some(*one),
            Some(_) => {
                let found = quoted(entry.comment.as_deref().unwrap_or_default());
                return keys.refuse("table.comment", found, "one ASCII character, as \"#\"");
            }
        };
        if let Some(word) = &entry.encoding {
            layout.encoding = match encoding::for_label(word) {
                Some(encoding) => Some(encoding),
                None => {
                    return keys.refuse(
                        "table.encoding",
                        quoted(word),
                        "a label of the WHATWG encoding standard: utf-8, utf-16le, windows-1252, shift_jis …",
                    );
                }
            };
        }
        Ok(layout)
    }
}

fn delimiter(keys: &Keys<'_>, word: &str) -> Result<Delimiter, CampaignError> {
    match (word, word.as_bytes()) {
        ("tab", _) => Ok(Delimiter::One(b'\t')),
        ("blanks" | " ", _) => Ok(Delimiter::Blanks),
        (_, [one]) if one.is_ascii() && !one.is_ascii_alphanumeric() && !b"\"\r\n.+-".contains(one) => {
            Ok(Delimiter::One(*one))
        }
        _ => keys.refuse(
            "table.delimiter",
            quoted(word),
            "one ASCII character (\",\", \";\", \"|\"), \"tab\", or \"blanks\" for any number of blanks and tabs",
        ),
    }
}
