//! Arguments and endings that the commands which fit a campaign share.

use super::opened::{Despite, Opened};
use super::record::Record;
use super::{Outcome, page};
use crate::campaign::Campaign;
use crate::effects::table::TableError;
use crate::effects::{AnyEffect, EffectList};
use crate::fit::{Fit, Options};
use crate::model::Model;
use crate::model_file;
use crate::recording::Results as Recorded;
use crate::report::html::{Origin, Results, Step};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// Effects by name.
#[derive(Debug, clap::Args)]
pub struct Effects {
    /// Effects of the model, comma-separated; a leading + adds to the default (or to those of a model file).
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    pub effects: Option<String>,
}

impl Effects {
    /// The list that was given; the default model if none was.
    pub fn list(&self) -> Result<EffectList, TableError> {
        match &self.effects {
            Some(text) => EffectList::parse("--effects", text),
            None => Ok(EffectList::DEFAULT),
        }
    }

    /// As given, with a space in front; empty if not.
    pub fn as_given(&self) -> String {
        let list = self.effects.as_ref();
        list.map_or_else(String::new, |list| format!(" --effects {list}"))
    }
}

/// The model of a campaign.
#[derive(Debug, clap::Args)]
pub struct ModelArguments {
    #[command(flatten)]
    pub effects: Effects,
    /// Model file with [[effect]] tables, values to start from or to hold; it replaces the default model.
    #[arg(long, value_name = "M.toml")]
    pub model: Option<PathBuf>,
}

impl ModelArguments {
    /// Was anything given?
    pub fn is_given(&self) -> bool {
        self.effects.effects.is_some() || self.model.is_some()
    }

    /// The model for a campaign.
    pub fn model(&self, campaign: &Campaign) -> anyhow::Result<Model> {
        let file = self.model.as_deref();
        let list = match (self.effects.list(), file) {
            // a law of the model file, which alone knows its name
            (Err(TableError::UnknownEffect { file, found, .. }), Some(own))
                if model_file::read(own, campaign)?
                    .iter()
                    .any(|choice| choice.effect.id() == found) =>
            {
                return Err(TableError::Twice { file, found }.into());
            }
            (list, _) => list?,
        };
        Ok(model_file::model(campaign, &list, file)?)
    }

    /// The file as given, with a space in front; empty if not.
    pub fn file_as_given(&self) -> String {
        let file = self.model.as_ref();
        file.map_or_else(String::new, |file| format!(" --model {}", file.display()))
    }

    /// Both as given.
    pub fn as_given(&self) -> String {
        self.file_as_given() + &self.effects.as_given()
    }
}

/// Laws of the user's own.
#[derive(Debug, clap::Args)]
pub struct Candidates {
    /// Model file whose [[effect]] tables are tried beside the catalogue: laws of your own.
    #[arg(long, value_name = "M.toml")]
    pub candidates: Option<PathBuf>,
}

impl Candidates {
    /// The effects of the file; none if none is named.
    pub fn load(&self, campaign: &Campaign) -> anyhow::Result<Vec<Arc<dyn AnyEffect>>> {
        Ok(match &self.candidates {
            Some(file) => model_file::candidates(campaign, file)?,
            None => Vec::new(),
        })
    }

    /// As given, with a space in front; empty if not.
    pub fn as_given(&self) -> String {
        let file = self.candidates.as_ref();
        file.map_or_else(String::new, |file| {
            format!(" --candidates {}", file.display())
        })
    }
}

/// How much is computed.
#[derive(Debug, clap::Args)]
pub struct Effort {
    /// Skip the cross-validation of campaigns without held-out readings.
    #[arg(long)]
    no_cross_validation: bool,
}

impl Effort {
    /// Options of fits.
    pub fn options(&self) -> Options {
        Options {
            cross_validate: !self.no_cross_validation,
        }
    }

    /// As given, with a space in front; empty if not.
    pub fn as_given(&self) -> &'static str {
        match self.no_cross_validation {
            true => " --no-cross-validation",
            false => "",
        }
    }
}

/// Where a result goes, besides the terminal.
#[derive(Debug, clap::Args)]
pub struct Outputs {
    /// Write the result as one HTML page too, with pictures.
    #[arg(long, value_name = "FILE.html", value_parser = page::html_path)]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub record: Record,
    /// Print the result as JSON.
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub effort: Effort,
    #[command(flatten)]
    pub despite: Despite,
}

/// A result, and what a page and a recording say about it.
pub struct Found<'a, Document, Recording> {
    /// The model that was found.
    pub model: &'a Model,
    /// What `--json` prints.
    pub document: &'a Document,
    /// The command without where its result goes.
    pub command: String,
    /// What to go on with, for the page.
    pub next: Vec<Step>,
    /// What a recording holds; made only if there is one.
    pub recorded: Recording,
    /// What a page shows.
    pub page: Results<'a>,
}

/// What was written, in lines for the terminal; empty if nothing was.
pub struct Written {
    /// The page.
    pub report: String,
    /// The recording.
    pub record: String,
}

impl Outputs {
    /// Writes page and recording, if they are wanted.
    pub fn write<Document, Recording>(
        &self,
        opened: &Opened,
        found: Found<'_, Document, Recording>,
    ) -> anyhow::Result<Written>
    where
        Document: Serialize,
        Recording: FnOnce() -> anyhow::Result<Recorded>,
    {
        let campaign = &opened.campaign;
        let record = self.record.write(
            campaign,
            found.recorded,
            found.model,
            &opened.with(found.document),
            &found.command,
        )?;
        let mut report = String::new();
        if let Some(file) = &self.report {
            let origin = Origin {
                command: found.command,
                next: found.next,
                seed: None,
                findings: opened.findings.clone(),
            };
            page::write(file, campaign, &found.page, &origin)?;
            report = format!("{}\n", page::line(file));
        }
        Ok(Written { report, record })
    }
}

/// How a command ends whose result is a fit.
pub fn outcome(fit: &Fit) -> Outcome {
    match fit.converged {
        true => Outcome::Done,
        false => Outcome::Missed,
    }
}
