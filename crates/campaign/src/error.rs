//! What can be wrong with a campaign's files, said so that the user can put it right.

use crate::input::InputError;
use crate::robot::RobotError;

/// Why a campaign could not be read or written.
///
/// Every message names the file, the line and column or key, what was found and what is accepted.
#[derive(Debug, thiserror::Error)]
pub enum CampaignError {
    /// No file that is read here: missing, too large, of another kind.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// As the user wrote it, or as the campaign file refers to it.
        file: String,
        /// Why.
        source: InputError,
    },
    /// The file system refused to write; what was there before is untouched.
    #[error("{file}: cannot be written: {source}")]
    Write {
        /// The file to be written.
        file: String,
        /// What the system says.
        source: std::io::Error,
    },
    /// Neither a campaign file nor a recording.
    #[error(
        "{file}: found {found}; accepted: a campaign file ending in .toml (with its CSV table), or a recording ending in .mcap"
    )]
    Kind {
        /// The file.
        file: String,
        /// Its ending, or that there is none.
        found: String,
    },
    /// The campaign file is not TOML, or has keys it should not have.
    #[error("{file}: {message}")]
    Toml {
        /// The campaign file.
        file: String,
        /// Line, column and what is wrong.
        message: String,
    },
    /// A value of the campaign file is not acceptable.
    #[error("{file}, key `{key}`: found {found}; accepted: {accepted}")]
    Key {
        /// The campaign file.
        file: String,
        /// The key with its table, `noise.position_m`.
        key: String,
        /// The value.
        found: String,
        /// What may stand there.
        accepted: String,
    },
    /// The header of the table is not acceptable.
    #[error("{file}, line {line}, column `{column}`: found {found}; accepted: {accepted}")]
    Column {
        /// The table.
        file: String,
        /// Line of the header.
        line: usize,
        /// The header word, or the missing one.
        column: String,
        /// What is wrong with it.
        found: String,
        /// What may stand there.
        accepted: String,
    },
    /// A cell of the table is not acceptable.
    #[error("{file}, line {line}, column `{column}`: found {found}; accepted: {accepted}")]
    Cell {
        /// The table.
        file: String,
        /// Line in the file; the header is line 1.
        line: usize,
        /// The header word.
        column: String,
        /// The cell.
        found: String,
        /// What may stand there.
        accepted: String,
    },
    /// A whole line of the table is not acceptable.
    #[error("{file}, line {line}: found {found}; accepted: {accepted}")]
    Row {
        /// The table.
        file: String,
        /// Line in the file; the header is line 1.
        line: usize,
        /// What is wrong with it.
        found: String,
        /// What may stand there.
        accepted: String,
    },
    /// The robot file.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A campaign made by a program that does not hold together, so nothing was written.
    #[error("{name}: cannot be written: {problem}")]
    Inconsistent {
        /// Name of the campaign.
        name: String,
        /// What does not hold.
        problem: String,
    },
}

impl CampaignError {
    /// The same of a header that is not in the first line.
    pub(super) fn at_line(mut self, number: usize) -> Self {
        if let Self::Column { line, .. } = &mut self {
            *line = number;
        }
        self
    }
}

/// A piece of the user's text for a message: quoted, on one line, and short.
pub(super) fn quoted(text: &str) -> String {
    const LONGEST: usize = 60;
    if text.is_empty() {
        return "an empty cell".into();
    }
    let mut shown: String = text.chars().take(LONGEST).collect();
    if text.chars().count() > LONGEST {
        shown.push('…');
    }
    format!("{shown:?}")
}
