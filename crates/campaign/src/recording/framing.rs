//! Where records begin and end in an MCAP file, watched while it is read.
//!
//! The library counts what is left of a chunk down by the lengths of its records, and believes them. In a chunk that is
//! not packed a record may claim more than the chunk has left: that is refused here, before the library has it.

use mcap::records::op;
use std::io::{self, Read};

/// Opcode and length of a record.
const HEAD: usize = 9;
/// Of a chunk: times, size when unpacked, checksum, and the length of the compression's name.
const CHUNK_HEAD: usize = 32;
/// And its size.
const SIZE: usize = 8;

/// A file that is watched.
pub(super) struct Framing<R> {
    input: R,
    /// Bytes to be passed over.
    skip: u64,
    /// Bytes of what is read, until there are as many as it has.
    held: Vec<u8>,
    wanted: usize,
    next: Next,
}

/// What is read.
enum Next {
    Magic,
    Record,
    /// Of this length.
    Chunk(u64),
    ChunkSize(u64),
    /// With so much of the chunk left, and so much behind its records.
    Inside(u64, u64),
}

impl<R> Framing<R> {
    pub(super) fn new(input: R) -> Self {
        Self {
            input,
            skip: 0,
            held: Vec::new(),
            wanted: mcap::MAGIC.len(),
            next: Next::Magic,
        }
    }

    fn pass(&mut self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            let skipped = usize::try_from(self.skip).map_or(bytes.len(), |n| n.min(bytes.len()));
            self.skip -= skipped as u64;
            bytes = &bytes[skipped..];
            let more = (self.wanted - self.held.len()).min(bytes.len());
            self.held.extend_from_slice(&bytes[..more]);
            bytes = &bytes[more..];
            if self.held.len() == self.wanted {
                (self.next, self.wanted, self.skip) = self.step()?;
                self.held.clear();
            }
        }
        Ok(())
    }

    /// What comes behind what is held, how many bytes that has, and how many before it are passed over.
    fn step(&self) -> io::Result<(Next, usize, u64)> {
        let held = &self.held;
        let record = |skip| Ok((Next::Record, HEAD, skip));
        match self.next {
            Next::Magic => record(0),
            Next::Record if held[0] == op::CHUNK => {
                Ok((Next::Chunk(length(&held[1..])), CHUNK_HEAD, 0))
            }
            Next::Record => record(length(&held[1..])),
            // packed, so that its records are counted as they are unpacked
            Next::Chunk(size) if held[CHUNK_HEAD - 4..] != [0; 4] => {
                record(size.saturating_sub(CHUNK_HEAD as u64))
            }
            Next::Chunk(size) => Ok((Next::ChunkSize(size), SIZE, 0)),
            Next::ChunkSize(size) => {
                let left = length(held);
                match size.checked_sub((CHUNK_HEAD + SIZE) as u64 + left.min(u64::MAX / 2)) {
                    None => Err(refusal("a chunk is longer than its record")),
                    Some(behind) if left == 0 => record(behind),
                    Some(behind) => Ok((Next::Inside(left, behind), HEAD, 0)),
                }
            }
            Next::Inside(left, behind) => {
                let size = length(&held[1..]);
                match left.checked_sub(size.saturating_add(HEAD as u64)) {
                    None => Err(refusal(
                        "a record is longer than the chunk that it stands in",
                    )),
                    Some(0) => record(size + behind),
                    Some(left) => Ok((Next::Inside(left, behind), HEAD, size)),
                }
            }
        }
    }
}

/// The number of eight bytes.
fn length(bytes: &[u8]) -> u64 {
    let eight = bytes.first_chunk().copied().unwrap_or_default();
    u64::from_le_bytes(eight)
}

fn refusal(problem: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, problem)
}

impl<R: Read> Read for Framing<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.input.read(buffer)?;
        self.pass(&buffer[..count])?;
        Ok(count)
    }
}
