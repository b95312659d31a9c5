//! `misfit check`.

use super::{Outcome, print, print_json, progress};
use crate::findings::Severity;
use crate::report;
use std::path::PathBuf;

/// Check the data of a campaign before anything is fitted: units, signs, columns, rows, repeats, loads.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit check cell3.toml
  misfit check cell3.toml --json | jq '.findings[] | {severity, what, remedy}'

Exit code 1 if there is an error among the findings.")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let spinner = progress::spinner();
    let opened = super::open(&arguments.campaign)?;
    spinner.finish_and_clear();
    if arguments.json {
        print_json(&report::findings::document(
            &opened.campaign,
            &opened.findings,
        ))?;
    } else {
        print(&report::findings::check(&opened.campaign, &opened.findings))?;
    }
    Ok(match opened.worst() {
        Some(Severity::Error) => Outcome::Ended(1),
        _ => Outcome::Done,
    })
}
