//! Files that others wrote: what kind of file is read, how large it may be, how deep its TOML may go.
//!
//! Every input is opened here, so that none is read past its limit, and none is waited for.

use std::fmt;
use std::fs::{File, FileType};
use std::io::{self, Read};
use std::path::Path;
use toml_parser::Source;
use toml_parser::lexer::TokenKind;

/// Largest file of TOML, bytes: people write these, and a thousand links take less than one.
pub const LARGEST_TOML: u64 = 4_000_000;
/// Largest URDF, bytes. Real ones are a few kilobytes.
pub const LARGEST_URDF: u64 = 16_000_000;
/// Largest table, bytes.
pub const LARGEST_TABLE: u64 = 2_000_000_000;
/// Longest line of a table, bytes; a quoted cell may go over several lines, all of which count.
pub const LONGEST_LINE: usize = 1_000_000;
/// Largest workbook, bytes: a million rows of twenty columns take less.
pub const LARGEST_WORKBOOK: u64 = 200_000_000;
/// Most that a workbook may unpack to, bytes.
pub const LARGEST_WORKBOOK_UNPACKED: u64 = 500_000_000;
/// Most readings of a campaign, in a table, a recording or by a scenario's design.
pub const MOST_READINGS: usize = 1_000_000;
/// Largest recording, and the most that its records may unpack to, bytes.
pub const LARGEST_RECORDING: u64 = 2_000_000_000;
/// Most levels of TOML: of brackets and of dots in keys. What reads it calls itself once a level.
pub const DEEPEST_TOML: usize = 64;

/// Why a file is not read.
#[derive(Debug, thiserror::Error)]
pub enum InputError {
    /// The system refuses.
    #[error(transparent)]
    System(#[from] io::Error),
    /// A folder, a pipe, a device: a pipe may never end, and may never begin.
    #[error("found {found}; accepted: a regular file")]
    Kind {
        /// What it is.
        found: &'static str,
    },
    /// Larger than anything that was ever measured or written by hand.
    #[error("found more than {limit}; accepted: at most {limit}")]
    TooLarge {
        /// The limit with its unit.
        limit: String,
    },
    /// Something in it that would cost more than it is worth.
    #[error("found {found}; accepted: {accepted}")]
    Content {
        /// What.
        found: String,
        /// What may stand there.
        accepted: String,
    },
    /// Bytes that are no text.
    #[error("line {line}: found bytes that are not UTF-8; accepted: text in UTF-8")]
    NotText {
        /// Line of the first of them.
        line: usize,
    },
}

/// Opens a regular file of at most `limit` bytes.
///
/// # Errors
/// If it cannot be opened, is no regular file, or is larger.
pub fn open(path: &Path, limit: u64) -> Result<File, InputError> {
    // Asked before it is opened: a named pipe without a writer is opened only when there is one.
    let metadata = std::fs::metadata(path)?;
    if !metadata.is_file() {
        return Err(InputError::Kind {
            found: kind(metadata.file_type()),
        });
    }
    if metadata.len() > limit {
        return Err(too_large(limit));
    }
    Ok(File::open(path)?)
}

/// Reads a regular file of at most `limit` bytes. The limit holds while reading too: a file may grow.
///
/// # Errors
/// If it cannot be read, is no regular file, or is larger.
pub fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>, InputError> {
    let mut bytes = Vec::new();
    open(path, limit)?.take(limit + 1).read_to_end(&mut bytes)?;
    match bytes.len() as u64 <= limit {
        true => Ok(bytes),
        false => Err(too_large(limit)),
    }
}

/// The same of a text.
///
/// # Errors
/// As [`bytes`], and if it is not UTF-8, with the line.
pub fn text(path: &Path, limit: u64) -> Result<String, InputError> {
    String::from_utf8(bytes(path, limit)?).map_err(|error| {
        let valid = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        InputError::NotText {
            line: 1 + valid.iter().filter(|byte| **byte == b'\n').count(),
        }
    })
}

/// The refusal of what is larger than so many bytes.
pub fn too_large(limit: u64) -> InputError {
    InputError::TooLarge {
        limit: size(limit).to_string(),
    }
}

/// A number of bytes as limits are written.
pub fn size(bytes: u64) -> impl fmt::Display {
    match bytes {
        0..1_000_000 => format!("{bytes} bytes"),
        1_000_000..1_000_000_000 => format!("{} MB", bytes / 1_000_000),
        _ => format!("{} GB", bytes / 1_000_000_000),
    }
}

fn kind(kind: FileType) -> &'static str {
    #[cfg(unix)]
    {
        use std::os::unix::fs::FileTypeExt;
        if kind.is_fifo() {
            return "a pipe";
        }
        if kind.is_char_device() || kind.is_block_device() {
            return "a device";
        }
        if kind.is_socket() {
            return "a socket";
        }
    }
    match kind.is_dir() {
        true => "a folder",
        false => "a special file",
    }
}

/// Reads TOML.
///
/// # Errors
/// With line, column and what is wrong, short enough to be read whatever the text is.
pub fn toml<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    toml_depth(text)?;
    toml::from_str(text).map_err(|error| toml_message(&error, text))
}

/// A message of the TOML parser, which quotes the line and the key: shortened where these are long.
pub fn toml_message(error: &toml::de::Error, text: &str) -> String {
    const LONGEST: usize = 600;
    let whole = error.to_string();
    let whole = whole.trim_end();
    if whole.len() <= LONGEST {
        return whole.to_owned();
    }
    let place = error.span().and_then(|span| {
        let before = text.get(..span.start)?;
        let (line, column) = (
            before.matches('\n').count() + 1,
            before.rsplit('\n').next()?,
        );
        Some(format!(
            "line {line}, column {}: ",
            column.chars().count() + 1
        ))
    });
    let message = error.message();
    let short: String = message.chars().take(LONGEST).collect();
    let more = if short.len() < message.len() {
        "…"
    } else {
        ""
    };
    format!("{}{short}{more}", place.unwrap_or_default())
}

/// Refuses TOML that nests too deeply, counted without recursion: its parser limits brackets and the parts of a key
/// each, but a level of brackets may hold a key of many parts.
///
/// # Errors
/// What nests too deeply, in words.
pub fn toml_depth(text: &str) -> Result<(), String> {
    // levels of what is open: for each bracket, itself and the parts of the key before it
    let mut open: Vec<usize> = Vec::new();
    // parts of the last header; of the key whose value this is; of the key or number that is being read
    let (mut header, mut key, mut dots) = (0, 0, 0);
    let mut in_value = false;
    let mut line = 1;
    let mut total = 0;
    for token in Source::new(text).lex() {
        match token.kind() {
            TokenKind::Dot => dots += 1,
            TokenKind::Equals => (key, dots, in_value) = (dots, 0, true),
            TokenKind::LeftSquareBracket if open.is_empty() && !in_value => {
                (header, dots) = (0, 0);
            }
            TokenKind::RightSquareBracket if open.is_empty() => (header, dots) = (header + dots, 0),
            TokenKind::LeftSquareBracket | TokenKind::LeftCurlyBracket => {
                open.push(key + 1);
                total += key + 1;
                (key, dots) = (0, 0);
            }
            TokenKind::RightSquareBracket | TokenKind::RightCurlyBracket => {
                total -= open.pop().unwrap_or_default();
                (key, dots) = (0, 0);
            }
            TokenKind::Comma => (key, dots) = (0, 0),
            TokenKind::Newline => {
                line += 1;
                if open.is_empty() {
                    (key, dots, in_value) = (0, 0, false);
                }
            }
            TokenKind::MlBasicString | TokenKind::MlLiteralString => {
                let span = token.span();
                line += text[span.start()..span.end()].matches('\n').count();
            }
            _ => {}
        }
        if header + total + key + dots > DEEPEST_TOML {
            return Err(format!(
                "line {line}: found tables and lists more than {DEEPEST_TOML} deep; accepted: at most \
                 {DEEPEST_TOML} levels"
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn depth_is_that_of_tables_and_lists_and_not_of_texts_and_numbers() {
        let dots = "a.".repeat(200);
        for flat in [
            format!("x = \"{dots}\"\n"),
            format!("# {dots}\nx = 1\n"),
            format!("x = \"\"\"\n{dots}\n\"\"\"\n"),
            format!("x = [{}1.5]\n", "1.5, ".repeat(200)),
            "[a.b]\nx = { y = [1.5, 2.5] }\n".repeat(200),
            "x = [\n  [1.5, 2.5],\n]\n".repeat(200),
        ] {
            toml_depth(&flat).unwrap();
        }
        let key = "a.".repeat(30);
        for deep in [
            format!("{}a = 1", "a.".repeat(65)),
            format!("[{}a]", "a.".repeat(65)),
            format!("[{key}a]\n{key}a = {{ {key}a = 1 }}"),
            format!("x = {}", "[".repeat(65)),
        ] {
            assert!(
                toml_depth(&deep).unwrap_err().contains("at most 64 levels"),
                "{deep}"
            );
        }
    }
}
