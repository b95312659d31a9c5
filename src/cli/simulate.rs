//! `misfit simulate`.

use super::{Outcome, print, progress};
use crate::campaign::Campaign;
use crate::recording::{Beside, write_campaign};
use crate::report::format::count;
use crate::scenario::{Scenario, simulate};
use anyhow::Context;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Simulate a measurement campaign in MuJoCo: readings, and the truth in a file of its own.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit simulate scenarios/springs.toml                 writes springs.mcap and springs.truth.toml
  misfit simulate scenarios/springs.toml --csv cell/     writes cell/campaign.toml with its table
  misfit fit springs.mcap")]
pub struct Arguments {
    /// Scenario file.
    scenario: PathBuf,
    /// Recording to write; the scenario's name with .mcap if nothing else is asked for (--csv DIR writes TOML and CSV).
    #[arg(short, long, value_name = "X.mcap", value_parser = recording_path)]
    output: Option<PathBuf>,
    /// Folder to write the campaign to as TOML and CSV.
    #[arg(long, value_name = "DIR")]
    csv: Option<PathBuf>,
    /// Seed, instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut scenario = Scenario::load(&arguments.scenario)?;
    if let Some(seed) = arguments.seed {
        scenario.seed = seed;
    }
    let campaign = campaign(&scenario)?;
    let recording = match (&arguments.output, &arguments.csv) {
        (Some(path), _) => Some(path.clone()),
        (None, None) => Some(PathBuf::from(format!("{}.mcap", scenario.name))),
        (None, Some(_)) => None,
    };
    let mut said = String::new();
    if let Some(path) = &recording {
        write_recording(&scenario, &campaign, path)?;
        let truth = truth_path(path);
        write_text(&truth, &simulate::truth_text(&scenario))?;
        said += &format!(
            "{} · {}\n{} · the truth, for scoring\n",
            path.display(),
            count(campaign.readings.len(), "reading"),
            truth.display()
        );
    }
    if let Some(folder) = &arguments.csv {
        // beside the folder, not in it: what is handed to a fit holds readings only
        let truth = truth_beside(folder)?;
        campaign.write_csv(folder)?;
        write_text(&truth, &simulate::truth_text(&scenario))?;
        said += &format!(
            "{} · {}\n{} · the truth, for scoring\n",
            folder.join("campaign.toml").display(),
            count(campaign.readings.len(), "reading"),
            truth.display()
        );
    }
    let next = match (&recording, &arguments.csv) {
        (Some(path), _) => path.clone(),
        (None, Some(folder)) => folder.join("campaign.toml"),
        (None, None) => PathBuf::new(),
    };
    print(&format!(
        "{said}\nnext     misfit fit {0}     or     misfit diagnose {0}\n",
        next.display()
    ))?;
    Ok(Outcome::Done)
}

/// Simulates with a progress bar.
pub(super) fn campaign(scenario: &Scenario) -> anyhow::Result<Campaign> {
    let readings = scenario.design.readings(scenario.setup.targets.len());
    let bar = progress::bar(readings as u64, "readings");
    let campaign = simulate::simulate(scenario, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(campaign)
}

/// Writes the recording, with the scenario but for its truth.
pub(super) fn write_recording(
    scenario: &Scenario,
    campaign: &Campaign,
    path: &Path,
) -> anyhow::Result<()> {
    let beside = Beside {
        metadata: metadata(scenario),
        attachments: vec![(
            SCENARIO_FILE.to_owned(),
            scenario.without_truth.clone().into(),
        )],
        ..Beside::default()
    };
    write_campaign(campaign, path, &beside)?;
    Ok(())
}

/// Name of the attached scenario.
pub(super) const SCENARIO_FILE: &str = "scenario.toml";

/// Where a simulated recording comes from.
pub(super) fn metadata(scenario: &Scenario) -> BTreeMap<String, String> {
    BTreeMap::from([
        ("scenario".to_owned(), scenario.name.clone()),
        ("seed".to_owned(), scenario.seed.to_string()),
        ("misfit".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
    ])
}

/// `x.mcap` → `x.truth.toml`, beside it.
pub(super) fn truth_path(beside: &Path) -> PathBuf {
    beside.with_extension("truth.toml")
}

/// `cell/` → `cell.truth.toml`, beside the folder; `.` and `..` have names, too.
fn truth_beside(folder: &Path) -> anyhow::Result<PathBuf> {
    let named = match folder.file_name() {
        Some(_) => folder.to_owned(),
        None => folder
            .canonicalize()
            .with_context(|| format!("{}: cannot be read", folder.display()))?,
    };
    match named.file_name() {
        // appended, so that cell.1/ and cell.2/ keep a truth each
        Some(name) => {
            let mut name = name.to_owned();
            name.push(".truth.toml");
            Ok(named.with_file_name(name))
        }
        None => anyhow::bail!(
            "{}: nothing can stand beside it, and the truth must not be in it",
            folder.display()
        ),
    }
}

/// A path that `fit` will know as a recording, and that is no scenario's.
pub(super) fn recording_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending == "mcap" => Ok(path),
        _ => Err("accepted: a path ending in .mcap".to_owned()),
    }
}

/// Writes a small file so that a failure leaves the old one whole.
pub(super) fn write_text(path: &Path, text: &str) -> anyhow::Result<()> {
    use std::io::Write;
    crate::campaign::write_atomically(path, |writer| writer.write_all(text.as_bytes()))
        .with_context(|| format!("{}: cannot be written", path.display()))
}
