//! `misfit effects`.

use super::{Outcome, print};
use crate::effects::{CATALOGUE, Entry, find, ids};
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
            print(&format!(
                "{}\n\n{}",
                reflowed(&entry.page()),
                at_hand(entry)
            ))?;
        }
    }
    Ok(Outcome::Done)
}

/// What one does with an effect: the end of its page.
fn at_hand(entry: &Entry) -> String {
    let id = entry.id;
    let mut rows = vec![format!("acts     {}", entry.stage.word())];
    let needs = entry.needs.iter();
    rows.extend(needs.map(|need| {
        let need = need.sentence();
        format!("needs    {}", need.strip_prefix("needs ").unwrap_or(need))
    }));
    if !entry.aliases.is_empty() {
        rows.push(format!("like     {}", entry.aliases.join(", ")));
    }
    match entry.needs_options() {
        // what a file alone tells has no short form
        true => {
            rows.push("fit      misfit fit cell3.toml --model laws.toml".to_owned());
            rows.push("try      misfit diagnose cell3.toml --candidates laws.toml".to_owned());
        }
        false => {
            rows.push(format!("fit      misfit fit cell3.toml --effects +{id}"));
            rows.push(format!("hide     [[truth]] kind = \"{id}\" in a scenario"));
        }
    }
    let rows = rows.iter().map(|row| wrap(&format!("  {row}"), 11) + "\n");
    format!("## At hand\n{}", rows.collect::<String>())
}

/// A page with its paragraphs and list items filled anew: the source's lines are longer than a terminal's. Headings and
/// tables keep their lines.
fn reflowed(page: &str) -> String {
    // each with the indent of its further lines, none where nothing can follow
    let mut blocks: Vec<(String, Option<usize>)> = Vec::new();
    for line in page.lines() {
        let indent = match line.chars().next() {
            None | Some('#' | '|') => None,
            Some('-' | '*') => Some(2),
            _ => Some(0),
        };
        match blocks.last_mut() {
            Some((last, Some(hanging)))
                if indent == Some(0) && (*hanging > 0) == line.starts_with(' ') =>
            {
                *last = format!("{last} {}", line.trim_start());
            }
            _ => blocks.push((line.to_owned(), indent)),
        }
    }
    let lines = blocks.iter();
    let lines: Vec<String> = lines
        .map(|(text, indent)| wrap(text, indent.unwrap_or(0)))
        .collect();
    lines.join("\n")
}
