//! `--record` of the commands that fit: campaign and results in one recording.

use super::simulate::recording_path;
use crate::campaign::Campaign;
use crate::model::Model;
use crate::model_file;
use crate::recording::{Beside, Results, write_campaign};
use anyhow::Context;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Where to record, the same in every command that fits.
#[derive(Debug, clap::Args)]
pub struct Record {
    /// Record readings, predictions, misfit, rungs and verdict, for `misfit replay` and other viewers.
    #[arg(long, value_name = "X.mcap", value_parser = recording_path)]
    pub record: Option<PathBuf>,
}

impl Record {
    /// Writes it, if it is wanted; the model and the `--json` document are attached. Says where it is.
    pub fn write(
        &self,
        campaign: &Campaign,
        results: impl FnOnce() -> anyhow::Result<Results>,
        model: &Model,
        document: &impl Serialize,
        command: &str,
    ) -> anyhow::Result<String> {
        let Some(file) = &self.record else {
            return Ok(String::new());
        };
        let metadata = BTreeMap::from([("command".to_owned(), command.to_owned())]);
        write(
            file,
            campaign,
            &results()?,
            model,
            document,
            metadata,
            Vec::new(),
        )?;
        Ok(format!(
            "recorded {} · see it with: misfit replay {}\n",
            file.display(),
            file.display()
        ))
    }
}

/// Campaign and results with the model and the result document attached, beside `attachments`.
#[expect(
    clippy::too_many_arguments,
    reason = "one procedure, still to be split by its steps"
)]
pub fn write(
    file: &Path,
    campaign: &Campaign,
    results: &Results,
    model: &Model,
    document: &impl Serialize,
    mut metadata: BTreeMap<String, String>,
    mut attachments: Vec<(String, Vec<u8>)>,
) -> anyhow::Result<()> {
    metadata.insert("misfit".to_owned(), env!("CARGO_PKG_VERSION").to_owned());
    let json = serde_json::to_vec_pretty(document)?;
    let model = model_file::text(model).context("the model cannot be written as TOML")?;
    attachments.push(("model.toml".to_owned(), model.into_bytes()));
    attachments.push(("result.json".to_owned(), json));
    let beside = Beside {
        results: Some(results),
        metadata,
        attachments,
        ..Beside::default()
    };
    write_campaign(campaign, file, &beside)?;
    Ok(())
}
