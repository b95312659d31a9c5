//! The records of an MCAP file, one after the other, each of them checked.

use super::error::RecordingError;
use super::framing::Framing;
use crate::input;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::{self, Read};
use std::path::Path;

/// Largest single record, bytes; ours are thousands of times smaller.
const LARGEST_RECORD: usize = 256_000_000;

/// What a recording may always unpack to, bytes; a larger one to so many times its size. Angles and poses shrink to a
/// tenth when packed, not to a thousandth: that is an archive made to fill a memory.
const UNPACKED: u64 = 256_000_000;
const TIMES_ITS_SIZE: u64 = 200;

/// Hands every record to `take`, to the end, so that a file cut off anywhere is refused.
///
/// # Errors
/// A file that is not read or not whole, or unpacks to too much; whatever `take` refuses.
pub(super) fn each_record(
    path: &Path,
    limit: u64,
    mut take: impl FnMut(Record<'_>) -> Result<(), RecordingError>,
) -> Result<(), RecordingError> {
    let file = &path.display().to_string();
    let unread = |source| RecordingError::Read {
        file: file.clone(),
        source,
    };
    let input = input::open(path, limit).map_err(unread)?;
    let size = input
        .metadata()
        .map_err(|error| unread(error.into()))?
        .len();
    let most = size.saturating_mul(TIMES_ITS_SIZE).clamp(UNPACKED, limit);
    let mut input = Framing::new(input);
    let mut unpacked = 0;
    let broken = |problem| RecordingError::Damaged {
        file: file.clone(),
        problem,
    };
    let options = LinearReaderOptions::default()
        .with_validate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(LARGEST_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(|error| damaged(file, &error))? {
            LinearReadEvent::ReadRequest(wanted) => {
                // Piece by piece: a damaged length must not cost memory.
                let room = reader.insert(wanted.clamp(1, 1 << 20));
                let read = input.read(room).map_err(|error| match error.kind() {
                    io::ErrorKind::InvalidData => broken(error.to_string()),
                    _ => unread(error.into()),
                })?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
                unpacked += data.len() as u64;
                if unpacked > most {
                    return Err(RecordingError::TooLarge {
                        file: file.clone(),
                        limit: format!(
                            "{} of records, {TIMES_ITS_SIZE} times its size",
                            input::size(most)
                        ),
                    });
                }
                match fits(opcode, data) {
                    None => {}
                    Some(true) => take(
                        mcap::parse_record(opcode, data).map_err(|error| damaged(file, &error))?,
                    )?,
                    Some(false) => {
                        let problem =
                            format!("a record of type {opcode} claims more than it holds");
                        return Err(broken(problem));
                    }
                }
            }
        }
    }
    Ok(())
}

/// Do the lengths that stand in a record fit into it? `None` for types of records that nothing here needs.
///
/// Asked before the library parses it, which takes memory for a length before it looks whether that is there, and does not
/// expect an attachment shorter than its checksum.
fn fits(opcode: u8, data: &[u8]) -> Option<bool> {
    let mut rest = Some(data);
    match opcode {
        op::SCHEMA => {
            skip(&mut rest, 2);
            parts(&mut rest, 3);
        }
        op::CHANNEL => {
            skip(&mut rest, 4);
            parts(&mut rest, 2);
            map(&mut rest);
        }
        op::MESSAGE => skip(&mut rest, 22),
        op::ATTACHMENT => {
            skip(&mut rest, 16);
            parts(&mut rest, 2);
            let length = rest.and_then(|rest| rest.first_chunk().copied());
            skip(&mut rest, 8);
            let length = length.map(u64::from_le_bytes);
            skip(
                &mut rest,
                length
                    .and_then(|n| usize::try_from(n).ok())
                    .unwrap_or(usize::MAX),
            );
            skip(&mut rest, 4);
        }
        op::METADATA => {
            parts(&mut rest, 1);
            map(&mut rest);
        }
        _ => return None,
    }
    Some(rest.is_some())
}

/// Leaves so many bytes behind; `None` if there are fewer.
fn skip(rest: &mut Option<&[u8]>, bytes: usize) {
    *rest = rest.and_then(|rest| rest.get(bytes..));
}

/// A text or list behind its length.
fn part<'a>(rest: &mut Option<&'a [u8]>) -> Option<&'a [u8]> {
    let length = rest.and_then(|rest| rest.first_chunk().copied());
    skip(rest, 4);
    let length = length.map(u32::from_le_bytes)? as usize;
    let found = rest.and_then(|rest| rest.get(..length));
    skip(rest, length);
    found
}

fn parts(rest: &mut Option<&[u8]>, count: usize) {
    for _ in 0..count {
        part(rest);
    }
}

/// A list of pairs of texts.
fn map(rest: &mut Option<&[u8]>) {
    let mut pairs = part(rest);
    while pairs.is_some_and(|pairs| !pairs.is_empty()) {
        parts(&mut pairs, 2);
    }
    if pairs.is_none() {
        *rest = None;
    }
}

/// A file whose records do not hold together.
pub(super) fn damaged(file: &str, error: &mcap::McapError) -> RecordingError {
    RecordingError::Damaged {
        file: file.into(),
        problem: error.to_string(),
    }
}
