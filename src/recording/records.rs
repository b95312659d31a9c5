//! The records of an MCAP file, one after the other, each of them checked.

use super::error::RecordingError;
use crate::input;
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::Read;
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
    let mut input = input::open(path, limit).map_err(unread)?;
    let size = input.metadata().map_err(|error| unread(error.into()))?.len();
    let most = size.saturating_mul(TIMES_ITS_SIZE).clamp(UNPACKED, limit);
    let mut unpacked = 0;
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
                let read = input.read(room).map_err(|error| unread(error.into()))?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
                unpacked += data.len() as u64;
                if unpacked > most {
                    return Err(RecordingError::TooLarge {
                        file: file.clone(),
                        limit: format!("{} of records, {TIMES_ITS_SIZE} times its size", input::size(most)),
                    });
                }
                take(mcap::parse_record(opcode, data).map_err(|error| damaged(file, &error))?)?;
            }
        }
    }
    Ok(())
}

/// A file whose records do not hold together.
pub(super) fn damaged(file: &str, error: &mcap::McapError) -> RecordingError {
    RecordingError::Damaged {
        file: file.into(),
        problem: error.to_string(),
    }
}
