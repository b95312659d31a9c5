//! The records of an MCAP file, one after the other, each of them checked.

use super::error::RecordingError;
use mcap::records::Record;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::io::Read;

/// Largest single record, bytes; ours are thousands of times smaller.
const LARGEST_RECORD: usize = 256_000_000;

/// Hands every record to `take`, to the end, so that a file cut off anywhere is refused.
///
/// # Errors
/// What the file system says; a file that is not whole; whatever `take` refuses.
pub(super) fn each_record(
    file: &str,
    mut input: impl Read,
    mut take: impl FnMut(Record<'_>) -> Result<(), RecordingError>,
) -> Result<(), RecordingError> {
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
                let read = input.read(room).map_err(|source| RecordingError::Read {
                    file: file.into(),
                    source,
                })?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
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
