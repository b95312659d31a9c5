//! `misfit drill`.

use super::{Outcome, make_folder, pictures, print, print_json, progress, simulate};
use crate::report;
use crate::report::run::RunDocument;
use crate::scenario::drill::{self, Bored, Drilling};
use crate::scenario::expect::check_drill;
use crate::scenario::{Job, Scenario};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Drill a board with two arms in MuJoCo: nominal commands, corrected ones, and in the loop of both wrist sensors.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit drill scenarios/drill.toml
  misfit drill scenarios/drill.toml -o out/     keeps every tick, both wrists' curves and recordings

Written with -o: NAME.drill.csv with every tick; the six force and torque curves of each wrist as
NAME.board.svg, .png and NAME.drill.svg, .png; a recording of each hole.")]
pub struct Arguments {
    /// Scenario file with [drill].
    scenario: PathBuf,
    /// Folder to keep ticks, pictures and recordings in.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Seed, instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut scenario = Scenario::load(&arguments.scenario)?;
    if let Some(seed) = arguments.seed {
        scenario.seed = seed;
    }
    let Job::Drill(wanted) = &scenario.job else {
        anyhow::bail!(
            "{}: has no [drill]; accepted: a scenario with one, such as scenarios/drill.toml",
            scenario.file
        );
    };
    let folder = arguments.output.as_deref();
    if let Some(folder) = folder {
        make_folder(folder)?;
    }
    let (document, text) = bore(&scenario, wanted, folder)?;
    if arguments.json {
        print_json(&document)?;
    } else {
        print(&text)?;
    }
    Ok(match document.passed {
        true => Outcome::Done,
        false => Outcome::Missed,
    })
}

/// Drills, keeps what is to be kept, and checks what is expected.
pub(super) fn bore(
    scenario: &Scenario,
    wanted: &Drilling,
    folder: Option<&Path>,
) -> anyhow::Result<(RunDocument, String)> {
    let bar = progress::bar(wanted.modes.len() as u64, "holes");
    let holes = drill::bore(scenario, wanted, || bar.inc(1))?;
    bar.finish_and_clear();
    let mut kept = String::new();
    if let Some(folder) = folder {
        kept = keep(scenario, wanted, &holes, folder)?;
    }
    let checks = check_drill(&scenario.expect, wanted, &holes);
    let text = format!(
        "{}\n{}{kept}{}",
        report::run::title(scenario),
        report::drill::text(scenario, wanted, &holes),
        report::run::checks(&checks)
    );
    let document = RunDocument {
        drill: Some(report::drill::document(wanted, &holes)),
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}

/// Every tick as a table, both wrists' curves as pictures, each hole as a recording.
fn keep(
    scenario: &Scenario,
    wanted: &Drilling,
    holes: &[Bored],
    folder: &Path,
) -> anyhow::Result<String> {
    let path = folder.join(format!("{}.drill.csv", scenario.name));
    crate::campaign::write_atomically(&path, |out| report::drill::write_csv(wanted, holes, out))
        .with_context(|| format!("{}: cannot be written", path.display()))?;
    for (name, figure) in report::drill::figures(scenario, wanted, holes) {
        pictures::write(&folder.join(format!("{}.{name}", scenario.name)), &figure)?;
    }
    for hole in holes {
        let campaign = drill::recorded(scenario, wanted, hole);
        let word = hole.mode.word();
        let path = folder.join(format!("{}.{word}.mcap", scenario.name));
        simulate::write_recording(scenario, &campaign, &path)?;
    }
    Ok(format!(
        "wrote    {} · {}.board and {}.drill as .svg and .png · {} recordings\n\n",
        path.display(),
        scenario.name,
        scenario.name,
        holes.len()
    ))
}
