//! `misfit completions` and `misfit man`: what a shell and `man` know of the command line.

use super::terminal::print_plain;
use super::{Arguments as All, Outcome, make_folder};
use anyhow::Context;
use clap::CommandFactory;
use std::path::PathBuf;

/// Print a shell's completions of commands and options.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit completions bash > ~/.local/share/bash-completion/completions/misfit
  misfit completions zsh > ~/.zfunc/_misfit
  misfit completions fish > ~/.config/fish/completions/misfit.fish")]
pub struct Completions {
    /// The shell.
    shell: clap_complete::Shell,
}

/// Print the manual page, or write a page for each command.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit man | man -l -
  misfit man -o ~/.local/share/man/man1        then: man misfit, man misfit-fit")]
pub struct Manual {
    /// Folder to write misfit.1 and a page for each command to.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Runs `misfit completions`.
pub fn completions(arguments: &Completions) -> anyhow::Result<Outcome> {
    let mut script = Vec::new();
    clap_complete::generate(arguments.shell, &mut All::command(), "misfit", &mut script);
    print_plain(&String::from_utf8(script)?)?;
    Ok(Outcome::Done)
}

/// Runs `misfit man`.
pub fn manual(arguments: &Manual) -> anyhow::Result<Outcome> {
    match &arguments.output {
        None => {
            let mut page = Vec::new();
            clap_mangen::Man::new(All::command()).render(&mut page)?;
            print_plain(&String::from_utf8(page)?)?;
        }
        Some(folder) => {
            make_folder(folder)?;
            let unwritten = || format!("{}: cannot be written", folder.display());
            clap_mangen::generate_to(All::command(), folder).with_context(unwritten)?;
        }
    }
    Ok(Outcome::Done)
}
