//! What can be wrong with a robot file, in words its author can act on.

use crate::input::InputError;
use thiserror::Error;

/// Why a robot file was refused.
#[derive(Debug, Error)]
pub enum RobotError {
    /// The file is missing, too large, of another kind, or no text.
    #[error("{file}: cannot be read: {source}")]
    Unreadable {
        /// The file as the user named it.
        file: String,
        /// Why.
        source: InputError,
    },
    /// The ending names no format known here.
    #[error(
        "{file}: not a robot file by its ending; accepted: .urdf or .xml (URDF), .toml (DH table)"
    )]
    Ending {
        /// The file as the user named it.
        file: String,
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

/// Text of a file or of a parser as it stands in a message: on one line and shortened, for it may have any length.
pub(super) fn short(text: &str) -> String {
    let mut letters = text.replace('\n', " ");
    if let Some((end, _)) = letters.char_indices().nth(400) {
        letters.truncate(end);
        letters.push('…');
    }
    letters
}
