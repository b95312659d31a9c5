//! `misfit-replay`: what `misfit replay` starts.

use anyhow::Context;
use clap::Parser;
use misfit::recording::read_recording;
use misfit_replay::{draw, save, stream};
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

/// Show a recording in the Rerun viewer: robots, errors, loads, curves and the verdict, in a layout that opens by itself.
#[derive(Debug, Parser)]
#[command(
    name = "misfit replay",
    version,
    max_term_width = 100,
    after_help = "Examples:
  misfit replay hidden.mcap                       opens the viewer (`pip install rerun-sdk==0.36.3` has it)
  misfit replay hidden.mcap --save hidden.rrd     for later: rerun hidden.rrd
  misfit replay hidden.mcap --connect rerun+http://127.0.0.1:9876/proxy

The viewer's timelines: reading (number), time (s), step (of the ladder).

Exit codes: 0 done; 1 could not do it; 2 wrong usage."
)]
struct Arguments {
    /// Recording written by misfit.
    recording: PathBuf,
    /// File to write instead of opening the viewer.
    #[arg(long, value_name = "X.rrd", conflicts_with = "connect", value_parser = rrd)]
    save: Option<PathBuf>,
    /// Address of a viewer that is open already.
    #[arg(long, value_name = "URL")]
    connect: Option<String>,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            let mut text = error.to_string();
            for cause in error.chain().skip(1).map(ToString::to_string) {
                if !text.contains(&cause) {
                    text = format!("{text}: {cause}");
                }
            }
            // nothing is left to be done if stderr is closed
            let _ = writeln!(std::io::stderr(), "misfit: {text}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let recording = read_recording(&arguments.recording)?;
    if let Some(path) = &arguments.save {
        save(&recording, path)?;
        let said = writeln!(std::io::stdout(), "{} · open it with: rerun {0}", path.display());
        return match said {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
            _ => Ok(()),
        };
    }
    let builder = stream(&recording);
    let stream = match &arguments.connect {
        Some(url) => builder.connect_grpc_opts(url.as_str()).with_context(|| format!("{url}: no viewer there"))?,
        None => builder.spawn().context(
            "the viewer does not start; accepted: `rerun` of version 0.36.3 on the PATH (pip install rerun-sdk==0.36.3), \
             or --save X.rrd",
        )?,
    };
    draw(&stream, &recording)?;
    stream.flush_blocking().context("the viewer did not take it all")
}

/// A path that the viewer will know as its own.
fn rrd(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending == "rrd" => Ok(path),
        _ => Err("accepted: a path ending in .rrd".to_owned()),
    }
}
