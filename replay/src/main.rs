//! `misfit-replay`: what `misfit replay` starts.

use anyhow::Context;
use clap::Parser;
use misfit::cli::{message, replay::Arguments};
use misfit_campaign::recording::read_recording;
use misfit_replay::{Opening, draw, save, stream};
use std::io::Write;
use std::process::ExitCode;
use std::time::Duration;

/// How long a viewer may take to answer, and to take it all.
const ANSWER: Duration = Duration::from_secs(20);
const TAKEN: Duration = Duration::from_secs(600);

/// Show a recording in the Rerun viewer.
#[derive(Debug, Parser)]
#[command(name = "misfit-replay", version, max_term_width = 100)]
struct Command {
    #[command(flatten)]
    arguments: Arguments,
}

fn main() -> ExitCode {
    let Command { arguments } = Command::parse();
    match run(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // nothing is left to be done if stderr is closed
            let _ = writeln!(std::io::stderr(), "misfit: {}", message(&error));
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> anyhow::Result<()> {
    let opening = Opening {
        tab: arguments.tab.clone(),
        timeline: arguments.timeline.clone(),
    };
    let recording = read_recording(&arguments.recording)?;
    if let Some(path) = &arguments.save {
        save(&recording, &opening, path)?;
        let said = writeln!(
            std::io::stdout(),
            "{} · open it with: rerun {0}",
            path.display()
        );
        return match said {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(error.into()),
            _ => Ok(()),
        };
    }
    let builder = stream(&recording);
    let stream = match &arguments.connect {
        Some(url) => builder
            .connect_grpc_opts(url.as_str())
            .with_context(|| format!("{url}: cannot be connected to"))?,
        None => builder.spawn().map_err(|error| {
            // the library goes on with ways to install the viewer, and with the PATH
            let said = error.to_string();
            anyhow::anyhow!(
                "the viewer does not start: {} accepted: `rerun` of version 0.36.3 on the PATH (pip install \
                 rerun-sdk==0.36.3), or --save X.rrd",
                said.lines().next().unwrap_or_default()
            )
        })?,
    };
    if stream.flush_with_timeout(ANSWER).is_err() {
        // dropping it would wait for a viewer for ever
        std::mem::forget(stream);
        let asked = arguments.connect.as_deref().unwrap_or("the viewer");
        anyhow::bail!("{asked}: no viewer answers; accepted: the address of one that is open");
    }
    draw(&stream, &recording, &opening)?;
    if let Err(error) = stream.flush_with_timeout(TAKEN) {
        std::mem::forget(stream);
        return Err(error).context("the viewer did not take it all");
    }
    Ok(())
}
