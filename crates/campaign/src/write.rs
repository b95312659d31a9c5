//! Writing a campaign as files that anyone can read and edit.

use super::error::CampaignError;
use super::files::write_atomically;
use super::{Campaign, document, render};
use std::fs;
use std::io::Write;
use std::path::Path;

impl Campaign {
    /// Writes `campaign.toml`, `readings.csv` and the robot file into `folder`, making it if need be.
    ///
    /// Columns are in SI units and radians with every digit, so that reading the folder gives
    /// the same campaign; only `name`, `warnings` and the line numbers are the new files' own.
    /// Each file is written beside the old one and then renamed: a failure leaves whole files.
    ///
    /// # Errors
    ///
    /// What the file system says, or why the campaign could not be read back.
    pub fn write_csv(&self, folder: &Path) -> Result<(), CampaignError> {
        self.check()
            .map_err(|problem| CampaignError::Inconsistent {
                name: self.name.clone(),
                problem,
            })?;
        let refuse = |path: &Path, source| CampaignError::Write {
            file: path.display().to_string(),
            source,
        };
        let table_path = folder.join("readings.csv");
        let table = render::render(self).map_err(|source| refuse(&table_path, source))?;
        fs::create_dir_all(folder).map_err(|source| refuse(folder, source))?;
        let document = document::render(self, Some("readings.csv"));
        // The campaign file comes last: where it stands, what it refers to is complete.
        let robot_path = folder.join(&self.robot_file.name);
        let files = [
            (robot_path, self.robot_file.text.as_bytes()),
            (table_path, table.as_slice()),
            (folder.join("campaign.toml"), document.as_bytes()),
        ];
        for (path, bytes) in &files {
            write_atomically(path, |file| file.write_all(bytes))
                .map_err(|source| refuse(path, source))?;
        }
        Ok(())
    }
}
