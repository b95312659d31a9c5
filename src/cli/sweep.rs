//! `misfit sweep`.

use super::{Outcome, print, print_json, progress};
use crate::report::sweep::SweepDocument;
use crate::scenario::Scenario;
use crate::sweep::store::{Shard, sweep};
use crate::sweep::summary::{checks, summary};
use std::path::PathBuf;

/// Draw blind cases, diagnose them without their truth, and score the answers.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit sweep scenarios/blind/rich.toml                 all its cases, and what it expects of them
  misfit sweep scenarios/blind/rich.toml -o out/         keeps out/cases.csv; goes on where it stopped
  misfit sweep scenarios/blind/rich.toml -o out/ --shard 3/16
                                                         a sixteenth; copy the parts of all into one folder
                                                         and run it there without --shard: the same result")]
pub struct Arguments {
    /// Scenario file with a [blind] table.
    scenario: PathBuf,
    /// Folder for the table of cases, kept in parts so that a sweep goes on where it stopped.
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
    /// Only the first cases.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    cases: Option<u32>,
    /// Only this share of the cases, as 3/16.
    #[arg(long, value_name = "K/N", value_parser = shard, requires = "output")]
    shard: Option<Shard>,
    /// Seed, instead of the scenario's.
    #[arg(long)]
    seed: Option<u64>,
    /// Print the figures as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let mut scenario = Scenario::load(&arguments.scenario)?;
    if let Some(seed) = arguments.seed {
        scenario.seed = seed;
    }
    let Some(blind) = scenario.blind.clone() else {
        anyhow::bail!(crate::sweep::CaseError::NotBlind {
            file: scenario.file.clone()
        });
    };
    let all = blind.cases();
    let cases = arguments.cases.map_or(all, |n| all.min(n as usize));
    let bar = progress::bar(cases as u64, "cases");
    let whole = Shard { index: 0, count: 1 };
    let rows = sweep(
        &scenario,
        cases,
        arguments.shard.unwrap_or(whole),
        arguments.output.as_deref(),
        |n| bar.inc(n as u64),
    )?;
    bar.finish_and_clear();
    if rows.len() < cases {
        print(&format!(
            "{} of {cases} cases are done; with the parts of the other shards in the same folder:\n\n\
             next     misfit sweep {} -o {}\n",
            rows.len(),
            arguments.scenario.display(),
            arguments.output.clone().unwrap_or_default().display()
        ))?;
        return Ok(Outcome::Done);
    }
    let figures = summary(&rows);
    let expect = checks(&figures, &blind.expect);
    let document = SweepDocument::new(&scenario.name, scenario.seed, figures, expect);
    if arguments.json {
        print_json(&document)?;
    } else {
        print(&document.text(&scenario.title))?;
    }
    Ok(if document.passed() {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').map(|(k, n)| (k.parse(), n.parse()));
    match parts {
        Some((Ok(index @ 1..), Ok(count))) if index <= count => Ok(Shard {
            index: index - 1,
            count,
        }),
        _ => Err("accepted: K/N with K from 1 to N, as 3/16".to_owned()),
    }
}
