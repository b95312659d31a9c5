//! Campaigns of whichever kind of file.

use super::error::CampaignError;
use super::{Campaign, read};
#[cfg(feature = "mcap")]
use crate::recording::{self, RecordingError};
use std::path::Path;

/// Why a file is no campaign.
#[derive(Debug, thiserror::Error)]
pub enum LoadError {
    /// The campaign's files.
    #[error(transparent)]
    Campaign(#[from] CampaignError),
    /// The recording.
    #[cfg(feature = "mcap")]
    #[error(transparent)]
    Recording(#[from] Box<RecordingError>),
}

impl Campaign {
    /// Reads a campaign: a `.toml` file with its CSV table and robot, or (feature `mcap`) a `.mcap` recording.
    ///
    /// Paths in the file are relative to it. All units are converted to SI and radians.
    ///
    /// # Errors
    ///
    /// Whatever does not fit the format, with file, line and column, what was found and what
    /// would be accepted.
    pub fn load(path: &Path) -> Result<Self, LoadError> {
        match path.extension().and_then(|ending| ending.to_str()) {
            Some("toml") => Ok(read::load_toml(path)?),
            #[cfg(feature = "mcap")]
            Some("mcap") => Ok(recording::read_campaign(path).map_err(Box::new)?),
            ending => Err(CampaignError::Kind {
                file: path.display().to_string(),
                found: match ending {
                    _ if path.is_dir() => "a folder".into(),
                    Some(ending) => format!("a file ending in .{ending}"),
                    None => "a file without an ending".into(),
                },
            }
            .into()),
        }
    }
}
