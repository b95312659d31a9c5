//! `misfit run`.

use super::{
    Outcome, drill, make_folder, map, page, print, print_json, progress, record, simulate,
};
use crate::fit::{self, Options};
use crate::model_file;
use crate::report;
use crate::report::html::{Origin, Results, Step};
use crate::report::run::{Instead, RunDocument};
use crate::scenario::compensated::{self, Compensate};
use crate::scenario::control_loop::{self, ControlLoop, Looped};
use crate::scenario::expect::{check_compensation, check_fit, check_loop, check_study, compare};
use crate::scenario::{Job, Scenario, efficiency, simulate::truth_text, workspace};
use anyhow::Context;
use std::path::{Path, PathBuf};

/// Run a scenario: simulate, fit, compare with the truth, and check what it expects.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit run scenarios/springs.toml
  misfit run scenarios/springs.toml -o out/      keeps recording, truth and result
  misfit run scenarios/efficiency.toml --campaigns 2000")]
pub struct Arguments {
    /// Scenario file.
    scenario: PathBuf,
    /// Folder to keep the recording (readings, predictions, misfit), the truth and the result in.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Write the fit as one HTML page too, with pictures.
    #[arg(long, value_name = "FILE.html", value_parser = page::html_path)]
    report: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// Seed, instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Campaigns of the efficiency study, instead of the scenario's number.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    campaigns: Option<u32>,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut scenario = Scenario::load(&arguments.scenario)?;
    if let Some(seed) = arguments.seed {
        scenario.seed = seed;
    }
    if arguments.report.is_some() && !matches!(scenario.job, Job::Fit) {
        anyhow::bail!(
            "{}: has {}; --report goes with scenarios that do nothing but simulate and fit one campaign",
            scenario.file,
            scenario.job.key()
        );
    }
    if let (Some(more), Job::Study { campaigns }) = (arguments.campaigns, &mut scenario.job) {
        *campaigns = more as usize;
    } else if arguments.campaigns.is_some() {
        anyhow::bail!(
            "{}: is no efficiency study; --campaigns goes with scenarios that have campaigns = N",
            scenario.file
        );
    }
    let folder = arguments.output.as_deref();
    if let Some(folder) = folder {
        make_folder(folder)?;
    }
    let (document, text) = match &scenario.job {
        Job::Fit => fit_once(arguments, &scenario)?,
        Job::Study { campaigns } => study(&scenario, *campaigns)?,
        Job::Compensate(wanted) => corrections(&scenario, wanted, folder)?,
        Job::Loop(wanted) => loops(&scenario, wanted, folder)?,
        Job::Map(wanted) => map::of_scenario(&scenario, wanted, folder)?,
        Job::Drill(wanted) => drill::bore(&scenario, wanted, folder)?,
    };
    if let Some(folder) = folder {
        let path = folder.join(format!("{}.result.json", scenario.name));
        simulate::write_text(&path, &(serde_json::to_string_pretty(&document)? + "\n"))?;
    }
    if arguments.json {
        print_json(&document)?;
    } else {
        print(&text)?;
    }
    let converged = scenario.expect.converged.is_some()
        || document
            .fit
            .as_ref()
            .is_none_or(report::json::FitDocument::converged);
    Ok(if document.passed && converged {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}

/// One campaign: simulated, fitted, compared.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
fn fit_once(arguments: &Arguments, scenario: &Scenario) -> anyhow::Result<(RunDocument, String)> {
    let campaign = simulate::campaign(scenario)?;
    let spinner = progress::spinner();
    let say = |text: &str| spinner.set_message(text.to_owned());
    let model = model_file::model(&campaign, &scenario.effects, scenario.model.as_deref())?;
    let options = Options {
        cross_validate: true,
    };
    let frames = model_file::frames_only(&campaign)?;
    let baseline = fit::fit(&campaign, &frames, &options, say)?;
    let found = fit::fit(&campaign, &model, &options, say)?;
    spinner.finish_and_clear();
    if let Some(file) = &arguments.report {
        let path = arguments.scenario.display();
        let seed = arguments
            .seed
            .map_or_else(String::new, |seed| format!(" --seed {seed}"));
        let recording = format!("{}.mcap", scenario.name);
        let origin = Origin {
            findings: Vec::new(),
            command: format!("misfit run {path}{seed}"),
            next: vec![
                Step::new(
                    "keep the campaign that this scenario simulates",
                    format!("misfit simulate {path}{seed} -o {recording}"),
                ),
                Step::new(
                    "then ask which physical effect the model lacks, if any",
                    format!("misfit report {recording}"),
                ),
            ],
            seed: Some(scenario.seed),
        };
        let results = Results::Fit {
            fit: &found,
            baseline: Some(&baseline),
        };
        page::write(file, &campaign, &results, &origin)?;
    }
    if let Some(folder) = &arguments.output {
        let path = folder.join(format!("{}.mcap", scenario.name));
        record::write(
            &path,
            &campaign,
            &report::recording::of_fit(&campaign, Some(&baseline), &found),
            &found.model,
            &report::json::fit(&found, Some(&baseline)),
            simulate::metadata(scenario),
            vec![(
                simulate::SCENARIO_FILE.to_owned(),
                scenario.without_truth.clone().into(),
            )],
        )?;
        simulate::write_text(&simulate::truth_path(&path), &truth_text(scenario))?;
    }
    let compared = compare(scenario, &found);
    let checks = check_fit(&scenario.expect, &found, &compared);
    let by_paper = match scenario.compare_paper {
        true => Some(fit::paper::fit(&campaign)?),
        false => None,
    };
    let survey = survey(scenario)?;
    let instead = instead(scenario)?;
    let text = format!(
        "{}\n{}\n{}{}{}{}",
        report::run::title(scenario),
        report::fit::text(
            &campaign,
            &found,
            Some(&baseline),
            report::fit::Detail::Errors
        ),
        report::run::springs(&compared, found.quantile(), by_paper.as_ref()),
        report::run::survey(scenario, &survey),
        report::run::instead(&instead),
        report::run::checks(&checks)
    );
    let document = RunDocument {
        fit: Some(report::json::fit(&found, Some(&baseline))),
        truth: compared,
        paper: by_paper.as_ref().map(report::paper::document),
        workspace: survey,
        instead,
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}

/// The survey of the workspace, if the scenario wants one.
fn survey(scenario: &Scenario) -> anyhow::Result<Vec<workspace::Survey>> {
    let Some(wanted) = &scenario.workspace else {
        return Ok(Vec::new());
    };
    let rounds = wanted.exponents.len().max(1) * scenario.setup.targets.len();
    let bar = progress::bar((rounds * wanted.postures) as u64, "postures");
    let rows = workspace::survey(scenario, wanted, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(rows)
}

/// What other designs could do, the scenario's own first.
fn instead(scenario: &Scenario) -> anyhow::Result<Vec<Instead>> {
    if scenario.instead.is_empty() {
        return Ok(Vec::new());
    }
    let own = [("as measured".to_owned(), scenario.design.clone())];
    let designs = own.iter().chain(&scenario.instead);
    designs
        .map(|(title, design)| {
            let mut other = scenario.clone();
            other.design = design.clone();
            Ok(Instead {
                title: title.clone(),
                bounds: efficiency::bounds(&other)?,
            })
        })
        .collect()
}

/// Many campaigns against the Cramér-Rao bound.
fn study(scenario: &Scenario, campaigns: usize) -> anyhow::Result<(RunDocument, String)> {
    let bar = progress::bar(campaigns as u64, "campaigns");
    let study = efficiency::study(scenario, campaigns, || bar.inc(1))?;
    bar.finish_and_clear();
    let checks = check_study(&scenario.expect, &study);
    let text = format!(
        "{}\n{}\n{}",
        report::run::title(scenario),
        report::run::study(&study),
        report::run::checks(&checks)
    );
    let document = RunDocument {
        study: Some(report::run::study_document(&study)),
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}

/// Corrected commands, visited in MuJoCo.
fn corrections(
    scenario: &Scenario,
    wanted: &Compensate,
    folder: Option<&Path>,
) -> anyhow::Result<(RunDocument, String)> {
    let bar = progress::bar(wanted.campaigns as u64, "campaigns");
    let found = compensated::compensate(scenario, wanted, || bar.inc(1))?;
    bar.finish_and_clear();
    // a picture of single poses, where the scenario wants them one by one
    if let (Some(folder), Some(last), true) = (folder, found.last(), wanted.list)
        && !last.arrivals.is_empty()
    {
        let figure = report::corrections::figure(scenario, wanted, last);
        super::pictures::write(&folder.join(&scenario.name), &figure)?;
    }
    let checks = check_compensation(&scenario.expect, &found);
    let text = format!(
        "{}\n{}{}",
        report::run::title(scenario),
        report::corrections::text(scenario, wanted, &found),
        report::run::checks(&checks)
    );
    let documents = found.iter();
    let documents = documents
        .map(|corrections| report::corrections::document(corrections, wanted.list))
        .collect();
    let document = RunDocument {
        compensation: documents,
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}

/// Poses held in a control loop, in MuJoCo.
fn loops(
    scenario: &Scenario,
    wanted: &ControlLoop,
    folder: Option<&Path>,
) -> anyhow::Result<(RunDocument, String)> {
    let bar = progress::bar(control_loop::runs(wanted) as u64, "runs");
    let found = control_loop::hold(scenario, wanted, || bar.inc(1))?;
    bar.finish_and_clear();
    if let Some(folder) = folder {
        keep_loops(folder, scenario, wanted, &found)?;
    }
    let checks = check_loop(&scenario.expect, &found);
    let text = format!(
        "{}\n{}{}",
        report::run::title(scenario),
        report::control_loop::text(scenario, wanted, &found),
        report::run::checks(&checks)
    );
    let documents = found.iter();
    let documents = documents
        .map(|looped| report::control_loop::document(wanted, looped))
        .collect();
    let document = RunDocument {
        loops: documents,
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}

/// Every tick as a table, and each filter's runs as a recording.
fn keep_loops(
    folder: &Path,
    scenario: &Scenario,
    wanted: &ControlLoop,
    found: &[Looped],
) -> anyhow::Result<()> {
    let path = folder.join(format!("{}.loop.csv", scenario.name));
    crate::campaign::write_atomically(&path, |out| {
        report::control_loop::write_csv(scenario, wanted, found, out)
    })
    .with_context(|| format!("{}: cannot be written", path.display()))?;
    for (model, looped) in found.iter().enumerate() {
        for (filter, filtered) in looped.filters.iter().enumerate() {
            if looped.poses == 0 {
                continue; // nothing was held
            }
            let campaign = control_loop::recorded(scenario, wanted, looped, filter);
            let name = format!("{} {} {}", model + 1, filter + 1, filtered.filter);
            let words = name.split(|c: char| !c.is_alphanumeric());
            let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
            let path = folder.join(format!(
                "{}.loop_{}.mcap",
                scenario.name,
                words.join("_").to_lowercase()
            ));
            simulate::write_recording(scenario, &campaign, &path)?;
        }
    }
    Ok(())
}
