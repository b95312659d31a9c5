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
            print(&(reflowed(&entry.page()) + "\n"))?;
        }
    }
    Ok(Outcome::Done)
}

/// A page with its paragraphs filled anew: the source's lines are longer than a terminal's. Headings, list items
/// and tables keep their lines.
fn reflowed(page: &str) -> String {
    let mut lines: Vec<String> = Vec::new();
    let mut paragraph = false;
    for line in page.lines() {
        let prose = !line.is_empty() && !line.starts_with(['#', '|', '-', '*', ' ']);
        match lines.last_mut() {
            Some(last) if prose && paragraph => *last = format!("{last} {line}"),
            _ => lines.push(line.to_owned()),
        }
        paragraph = prose;
    }
    let lines: Vec<String> = lines.iter().map(|line| wrap(line, 0)).collect();
    lines.join("\n")
}
