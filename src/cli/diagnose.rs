//! `misfit diagnose`.

use super::{Outcome, print, print_json, progress};
use crate::campaign::Campaign;
use crate::diagnosis::{self, ripple};
use crate::fit::Options;
use crate::{model_file, report};
use std::path::PathBuf;

/// Learn what a model is missing: which physical effect, or that nothing is detectable, or that nobody knows.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit diagnose cell3.toml
  misfit diagnose cell3.toml --effects joint_offset,joint_compliance   what does this model lack?
  misfit diagnose cell3.toml --json | jq .verdict")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Effects of the base model, comma-separated; a leading + adds to the default.
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    effects: Option<String>,
    /// Model file with [[effect]] tables.
    #[arg(long, value_name = "M.toml")]
    model: Option<PathBuf>,
    /// Write the model with what is missing, for --model.
    #[arg(short = 'o', long, value_name = "M.toml")]
    save_model: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// Skip the cross-validation of campaigns without held-out readings.
    #[arg(long)]
    no_cross_validation: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let spinner = progress::spinner();
    let campaign = Campaign::load(&arguments.campaign)?;
    let model = model_file::model(
        &campaign,
        arguments.effects.as_deref(),
        arguments.model.as_deref(),
    )?;
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
    let say = |text: &str| spinner.set_message(text.to_owned());
    let found = diagnosis::diagnose(&campaign, &model, &options, say)?;
    spinner.finish_and_clear();
    if let Some(file) = &arguments.save_model {
        model_file::write(file, &found.fit.model)?;
    }
    if arguments.json {
        print_json(&report::diagnosis::document(&found))?;
    } else {
        let path = arguments.campaign.display();
        let next = match (found.named.first(), &arguments.save_model) {
            (Some(_), Some(file)) => {
                format!("misfit fit {path} --model {}     or     ", file.display())
            }
            // its cycles are options: a file holds them
            (Some(&ripple::EFFECT), None) => {
                format!("misfit diagnose {path} -o model.toml     or     ")
            }
            (Some(effect), None) => format!("misfit fit {path} --effects +{effect}     or     "),
            (None, _) => String::new(),
        };
        let text = report::diagnosis::text(&campaign, &found);
        print(&format!("{text}\nnext     {next}misfit ladder {path}\n"))?;
    }
    Ok(if found.fit.converged {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}
