//! `misfit effects`.

use super::{Outcome, print};
use crate::effects::{CATALOGUE, find, ids};
use crate::report::format::{render, table, wrap};

/// The catalogue of physical effects; `show ID` prints a handbook page.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit effects
  misfit effects show joint_compliance")]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Print an effect's handbook page: law, signature, what it is confused with, sources.
    Show {
        /// Effect, as in the list.
        id: String,
    },
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    match &arguments.command {
        None => {
            let mut rows = table(&["effect", "acts", "what it is"], &[]);
            for entry in CATALOGUE {
                rows.add_row(vec![
                    entry.id.to_owned(),
                    entry.stage.word().to_owned(),
                    entry.summary(),
                ]);
            }
            print(&format!(
                "{}\n\nmisfit effects show ID prints the whole page of one\n",
                render(&rows)
            ))?;
        }
        Some(Command::Show { id }) => {
            let Some(entry) = find(id) else {
                anyhow::bail!("no effect is called \"{id}\"; known: {}", ids());
            };
            print(&format!("{}\n\n", entry.id))?;
            let lines: Vec<String> = entry.page().lines().map(|line| wrap(line, 0)).collect();
            print(&(lines.join("\n") + "\n"))?;
        }
    }
    Ok(Outcome::Done)
}
