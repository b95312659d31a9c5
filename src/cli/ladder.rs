//! `misfit ladder`.

use super::{Outcome, print, print_json, progress};
use crate::campaign::Campaign;
use crate::fit::Options;
use crate::{ladder, report};
use std::path::PathBuf;

/// Watch the error fall: from frames alone, rung by rung, until nothing more is detectable.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit ladder cell3.toml
  misfit ladder cell3.toml --json | jq '.rungs[].added'")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
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
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
    let say = |text: &str| spinner.set_message(text.to_owned());
    let found = ladder::climb(&campaign, &options, say)?;
    spinner.finish_and_clear();
    if arguments.json {
        print_json(&report::ladder::document(&found))?;
    } else {
        print(&report::ladder::text(&campaign, &found))?;
    }
    Ok(if found.last.fit.converged {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}
