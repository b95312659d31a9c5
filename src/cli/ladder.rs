//! `misfit ladder`.

use super::record::Record;
use super::{Outcome, print, print_json, progress, report as pages};
use crate::diagnosis::Verdict;
use crate::fit::Options;
use crate::ladder::{self, Stop};
use crate::report::html::{Origin, Results};
use crate::{model_file, report};
use std::path::PathBuf;

/// Watch the error fall: from frames alone, rung by rung, until nothing more is detectable.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit ladder cell3.toml
  misfit ladder cell3.toml -o model.toml && misfit fit cell3.toml --model model.toml
  misfit ladder cell3.toml --effects +backlash          go on from the default and backlash
  misfit ladder cell3.toml --stop-at 0.3mm              no further than needed
  misfit ladder cell3.toml --record cell3.mcap && misfit replay cell3.mcap
  misfit ladder cell3.toml --json | jq '.rungs[].added'")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Effects to go on from, comma-separated; a leading + adds to the default.
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    effects: Option<String>,
    /// Model file whose [[effect]] tables are tried beside the catalogue: laws of your own.
    #[arg(long, value_name = "M.toml")]
    candidates: Option<PathBuf>,
    /// Stop at an error of the fitted readings (0.3mm), after so many rungs (5), or with an effect.
    #[arg(long, value_name = "WHERE", value_parser = Stop::parse)]
    stop_at: Option<Stop>,
    /// Write the model of the last rung, for --model.
    #[arg(short = 'o', long, value_name = "M.toml")]
    save_model: Option<PathBuf>,
    /// Write the result as one HTML page too, with pictures.
    #[arg(long, value_name = "FILE.html", value_parser = pages::html_path)]
    report: Option<PathBuf>,
    #[command(flatten)]
    record: Record,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// Skip the cross-validation of campaigns without held-out readings.
    #[arg(long)]
    no_cross_validation: bool,
    #[command(flatten)]
    despite: super::Despite,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let outputs = [
        arguments.save_model.as_deref(),
        arguments.record.record.as_deref(),
        arguments.report.as_deref(),
    ];
    let others = [arguments.candidates.as_deref()];
    super::writable(&outputs, &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) =
        opened.check_data(&arguments.despite, "misfit.ladder/1", arguments.json)?
    {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
    let own = match &arguments.candidates {
        Some(file) => model_file::candidates(&campaign, file)?,
        None => Vec::new(),
    };
    let say = |text: &str| spinner.set_message(text.to_owned());
    let found = ladder::climb(
        &campaign,
        arguments.effects.as_deref(),
        &own,
        arguments.stop_at.as_ref(),
        &options,
        say,
    )?;
    opened.add(&found.last.fit);
    if let Some(file) = &arguments.save_model {
        model_file::write(file, &found.last.fit.model)?;
    }
    let path = arguments.campaign.display();
    let effects = arguments.effects.as_ref();
    let effects = effects.map(|list| format!(" --effects {list}"));
    let own = arguments.candidates.as_ref();
    let own = own.map(|file| format!(" --candidates {}", file.display()));
    let given = effects.unwrap_or_default() + &own.unwrap_or_default();
    let next = match &arguments.save_model {
        Some(file) => format!("misfit fit {path} --model {}", file.display()),
        None => format!("misfit ladder {path}{given} -o model.toml"),
    };
    let stop = arguments.stop_at.as_ref();
    let stop = stop.map_or_else(String::new, |stop| format!(" --stop-at {stop}"));
    let quickly = pages::quickly(arguments.no_cross_validation);
    let command = format!("misfit ladder {path}{given}{stop}{quickly}");
    let document = report::ladder::document(&found);
    let recorded = arguments.record.write(
        &campaign,
        || report::recording::of_ladder(&campaign, &found),
        &found.last.fit.model,
        &opened.with(&document),
        &command,
    )?;
    if let Some(file) = &arguments.report {
        let poses = pages::next_poses(&campaign, &found.last);
        let origin = Origin {
            command,
            next: pages::after_ladder(&path.to_string(), &given, &found.last),
            seed: None,
            findings: opened.findings.clone(),
        };
        let results = Results::Ladder {
            ladder: &found,
            next: poses.as_ref(),
        };
        pages::write(file, &campaign, &results, &origin)?;
    }
    spinner.finish_and_clear();
    if arguments.json {
        print_json(&opened.with(&document))?;
    } else {
        let mut text = report::ladder::text(&campaign, &found);
        if let Some(file) = &arguments.report {
            text += &format!("\n{}\n", pages::line(file));
        }
        print(&format!("{text}{recorded}\nnext     {next}\n"))?;
    }
    Ok(
        if found.last.fit.converged && found.last.verdict != Verdict::CannotTell {
            Outcome::Done
        } else {
            Outcome::Missed
        },
    )
}
