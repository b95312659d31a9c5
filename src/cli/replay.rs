//! `misfit replay`: starts a program of its own, so that this one does without a viewer's four hundred crates.

use super::{Outcome, terminal};
use anyhow::Context;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Name of the program.
const PROGRAM: &str = "misfit-replay";

/// Show a recording in the Rerun viewer: robots, errors magnified, loads, curves and the verdict.
///
/// Starts misfit-replay, which is built apart (cargo build --release -p misfit-replay). The layout opens by itself; the
/// viewer's timelines are reading (number), time (s) and step (of a ladder).
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit ladder hidden.mcap --record found.mcap   readings with what a ladder found
  misfit replay found.mcap                        opens the viewer (pip install rerun-sdk==0.36.3 has it)
  misfit replay found.mcap --save found.rrd       for later: rerun found.rrd
  misfit replay found.mcap --connect rerun+http://127.0.0.1:9876/proxy

Exit codes: 0 done; 1 could not do it; 2 wrong usage.")]
pub struct Arguments {
    /// Recording written by misfit.
    #[arg(value_name = "X.mcap")]
    pub recording: PathBuf,
    /// File to write instead of opening the viewer.
    #[arg(long, value_name = "X.rrd", conflicts_with = "connect", value_parser = rrd)]
    pub save: Option<PathBuf>,
    /// Address of a viewer that is open already.
    #[arg(long, value_name = "URL")]
    pub connect: Option<String>,
    /// Tab of plots that is open at first, by the beginning of its name; the first one if left out.
    #[arg(long, value_name = "NAME")]
    pub tab: Option<String>,
    /// Timeline that is on at first: reading, time or step.
    #[arg(long, value_name = "NAME", value_parser = ["reading", "time", "step"])]
    pub timeline: Option<String>,
}

impl Arguments {
    /// As they were given.
    fn words(&self) -> Vec<OsString> {
        let mut words = Vec::new();
        if let Some(path) = &self.save {
            words.extend(["--save".into(), path.into()]);
        }
        let others = [
            ("--connect", &self.connect),
            ("--tab", &self.tab),
            ("--timeline", &self.timeline),
        ];
        for (name, value) in others {
            if let Some(value) = value {
                words.extend([name.into(), value.into()]);
            }
        }
        words.extend(["--".into(), self.recording.clone().into()]);
        words
    }
}

/// Runs the command.
pub(super) fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let program = found()?;
    let mut command = Command::new(&program);
    command.args(arguments.words());
    if terminal::is_quiet() {
        command.stdout(Stdio::null());
    }
    let status = command
        .status()
        .with_context(|| format!("{}: cannot be started", program.display()))?;
    match status.code() {
        Some(0) => Ok(Outcome::Done),
        Some(code) => Ok(Outcome::Ended(u8::try_from(code).unwrap_or(1))),
        None => anyhow::bail!("{}: was ended by a signal", program.display()),
    }
}

/// The program beside this one, else on the PATH.
fn found() -> anyhow::Result<PathBuf> {
    let file = format!("{PROGRAM}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok();
    let beside = beside.as_deref().and_then(Path::parent).map(Path::to_owned);
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders = beside.into_iter().chain(std::env::split_paths(&path));
    let mut programs = folders.map(|folder| folder.join(&file));
    programs.find(|program| program.is_file()).with_context(|| {
        format!(
            "{PROGRAM} is neither beside misfit nor on the PATH; get it with `cargo build --release -p {PROGRAM}` or \
             `cargo install --path replay`"
        )
    })
}

/// A path that the viewer will know as its own.
fn rrd(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending == "rrd" => Ok(path),
        _ => Err("accepted: a path ending in .rrd".to_owned()),
    }
}
