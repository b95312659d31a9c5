//! Refusals of keys of TOML files.

use super::error::CampaignError;

/// Says which key of which file is wrong.
pub struct Keys<'a> {
    /// Name of the file for messages.
    pub file: &'a str,
}

impl Keys<'_> {
    /// Refuses what stands under a key.
    ///
    /// # Errors
    /// Always.
    pub fn refuse<T>(&self, key: &str, found: String, accepted: &str) -> Result<T, CampaignError> {
        Err(CampaignError::Key {
            file: self.file.into(),
            key: key.into(),
            found,
            accepted: accepted.into(),
        })
    }
}
