//! The command line: one file a command.

mod arguments;
mod check;
mod compensate;
mod completions;
mod diagnose;
mod drill;
mod effects;
mod export;
mod fit;
mod import;
mod ladder;
mod map;
mod opened;
mod page;
mod pictures;
mod plan;
mod progress;
mod record;
pub mod replay;
mod report;
mod run;
mod simulate;
mod sweep;
mod terminal;

use crate::campaign::folder_of;
use crate::input::{self, LARGEST_TOML};
use anyhow::Context;
use clap::{CommandFactory, Parser, Subcommand};
use opened::{Despite, open, open_and_say};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use terminal::{print, print_json};

/// A virtual calibration lab for serial robot arms.
///
/// Compare a model with measurements, see where it fails, learn which physical effect is missing, add it, and
/// watch the error fall.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100, after_help = EXIT_CODES)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
    /// Print nothing but errors, and what --json asks for.
    #[arg(short, long, global = true)]
    quiet: bool,
}

const EXIT_CODES: &str = "Exit codes: 0 done; 1 could not do it; 2 wrong usage; 3 done, but an [expect] was \
missed, the fit did not converge, or a task was not reached.";

#[derive(Debug, Subcommand)]
enum Command {
    Simulate(simulate::Arguments),
    Import(import::Arguments),
    Check(check::Arguments),
    Fit(fit::Arguments),
    Diagnose(diagnose::Arguments),
    Ladder(ladder::Arguments),
    Report(report::Arguments),
    Replay(replay::Arguments),
    Plan(plan::Arguments),
    Compensate(compensate::Arguments),
    Map(map::Arguments),
    Drill(drill::Arguments),
    Export(export::Arguments),
    Run(run::Arguments),
    Effects(effects::Arguments),
    Sweep(sweep::Arguments),
    Completions(completions::Completions),
    Man(completions::Manual),
}

/// How a command ended when it did what it was asked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Exit code 0.
    Done,
    /// Exit code 3: an expectation was missed, or a fit did not converge.
    Missed,
    /// Exit code of the program that did it, which has said why.
    Ended(u8),
}

/// Parses, runs, says what went wrong.
pub fn main() -> ExitCode {
    let arguments = Arguments::parse();
    if arguments.quiet {
        terminal::be_quiet();
    }
    let result = match arguments.command {
        Command::Simulate(arguments) => simulate::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Check(arguments) => check::run(&arguments),
        Command::Fit(arguments) => fit::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Ladder(arguments) => ladder::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Plan(arguments) => plan::run(&arguments),
        Command::Compensate(arguments) => compensate::run(&arguments),
        Command::Map(arguments) => map::run(&arguments),
        Command::Drill(arguments) => drill::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Run(arguments) => run::run(&arguments),
        Command::Effects(arguments) => effects::run(&arguments),
        Command::Sweep(arguments) => sweep::run(&arguments),
        Command::Completions(arguments) => completions::completions(&arguments),
        Command::Man(arguments) => completions::manual(&arguments),
    };
    match result {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::Missed) => ExitCode::from(3),
        Ok(Outcome::Ended(code)) => ExitCode::from(code),
        Err(error) if closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => match error.downcast::<clap::Error>() {
            Ok(usage) => {
                // nothing is left to be done if stderr is closed
                let _ = usage.print();
                ExitCode::from(2)
            }
            Err(error) => {
                use std::io::Write;
                let message = message(&error);
                let _ = writeln!(std::io::stderr(), "misfit: {}", terminal::tame(&message));
                ExitCode::FAILURE
            }
        },
    }
}

/// The error and its causes, each said once: most messages hold their cause already.
pub fn message(error: &anyhow::Error) -> String {
    let mut text = error.to_string();
    for cause in error.chain().skip(1).map(ToString::to_string) {
        if !text.contains(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}

/// Wrong usage that only the command itself can see: exit code 2.
fn usage(message: impl std::fmt::Display) -> anyhow::Error {
    let kind = clap::error::ErrorKind::ValueValidation;
    Arguments::command().error(kind, message).into()
}

/// Refuses files to be written that are read, or that have no folder: before the work, not after it.
fn writable(
    outputs: &[Option<&Path>],
    campaign: &Path,
    others: &[Option<&Path>],
) -> anyhow::Result<()> {
    for output in outputs.iter().flatten() {
        folder_of(output).with_context(|| format!("{}: cannot be written", output.display()))?;
        spare(output, campaign, others)?;
    }
    Ok(())
}

/// Refuses to write over a file that is read: a campaign, its table and robot, and others.
fn spare(output: &Path, campaign: &Path, others: &[Option<&Path>]) -> anyhow::Result<()> {
    let Ok(own) = output.canonicalize() else {
        return Ok(()); // nothing is there yet
    };
    let mut read = vec![campaign.to_owned()];
    read.extend(others.iter().flatten().map(|path| path.to_path_buf()));
    let text = input::text(campaign, LARGEST_TOML).unwrap_or_default();
    if let Ok(table) = input::toml::<toml::Table>(&text) {
        let folder = campaign.parent().unwrap_or(Path::new(""));
        let named = ["robot", "table"].iter().filter_map(|key| {
            let value = table.get(*key)?;
            value.as_str().or_else(|| value.get("file")?.as_str())
        });
        read.extend(named.map(|name| folder.join(name)));
    }
    let same = |path: &&PathBuf| path.canonicalize().is_ok_and(|path| path == own);
    match read.iter().find(same) {
        Some(path) => anyhow::bail!(
            "{}: is {}, which is read here: nothing was written; accepted: another file",
            output.display(),
            path.display()
        ),
        None => Ok(()),
    }
}

/// Makes a folder to write to, if it is not there.
fn make_folder(folder: &Path) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))
}

/// A reader that has seen enough (`misfit … | head`) is no fault.
fn closed_pipe(error: &anyhow::Error) -> bool {
    error
        .downcast_ref::<std::io::Error>()
        .is_some_and(|error| error.kind() == std::io::ErrorKind::BrokenPipe)
}
