//! What can be wrong with a robot file, in words its author can act on.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use thiserror::Error;

/// Largest robot file that is read, bytes. Real ones are a few kilobytes.
const MAX_BYTES: u64 = 16 << 20;

/// Why a robot file was refused.
#[derive(Debug, Error)]
pub enum RobotError {
    /// The file could not be opened or is not text.
    #[error("{file}: cannot be read: {source}")]
    Unreadable {
        /// The file as the user named it.
        file: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The ending names no format known here.
    #[error(
        "{file}: not a robot file by its ending; accepted: .urdf or .xml (URDF), .toml (DH table)"
    )]
    Ending {
        /// The file as the user named it.
        file: String,
    },
    /// Far larger than a robot.
    #[error("{file}: {bytes} bytes; a robot file has at most {MAX_BYTES}")]
    TooLarge {
        /// The file as the user named it.
        file: String,
        /// Its size.
        bytes: u64,
    },
    /// Something in it is not acceptable.
    #[error("{file}: {place}: {found}; {accepted}")]
    Refused {
        /// The file as the user named it.
        file: String,
        /// Link, joint, row, key or line.
        place: String,
        /// What stands there.
        found: String,
        /// What could stand there.
        accepted: String,
    },
}

impl RobotError {
    /// Refuses what was `found` at `place`, saying what would be `accepted`.
    pub(super) fn refused(
        file: &str,
        place: impl Into<String>,
        found: impl Into<String>,
        accepted: impl Into<String>,
    ) -> Self {
        RobotError::Refused {
            file: file.to_owned(),
            place: place.into(),
            found: found.into(),
            accepted: accepted.into(),
        }
    }
}

/// Refuses a text too large to be a robot.
pub(super) fn check_size(file: &str, bytes: u64) -> Result<(), RobotError> {
    if bytes > MAX_BYTES {
        return Err(RobotError::TooLarge {
            file: file.to_owned(),
            bytes,
        });
    }
    Ok(())
}

/// Reads a whole text file without ever holding much more than the largest one allowed.
pub(super) fn read_text(path: &Path, file: &str) -> Result<String, RobotError> {
    let unreadable = |source| RobotError::Unreadable {
        file: file.to_owned(),
        source,
    };
    let handle = File::open(path).map_err(unreadable)?;
    check_size(file, handle.metadata().map_err(unreadable)?.len())?;
    let mut text = String::new();
    handle
        .take(MAX_BYTES + 1)
        .read_to_string(&mut text)
        .map_err(unreadable)?;
    Ok(text)
}
