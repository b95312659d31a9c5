//! `misfit ladder`.

use super::arguments::{Candidates, Effects, Found, Outputs, outcome};
use super::{Outcome, print, print_json, progress, report as pages};
use crate::diagnosis::Verdict;
use crate::ladder::{self, Stop};
use crate::report::html::Results;
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
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    candidates: Candidates,
    /// Stop at an error of the fitted readings (0.3mm), after so many rungs (5), or with an effect.
    #[arg(long, value_name = "WHERE", value_parser = Stop::parse)]
    stop_at: Option<Stop>,
    /// Write the model of the last rung, for --model.
    #[arg(short = 'o', long, value_name = "M.toml")]
    save_model: Option<PathBuf>,
    #[command(flatten)]
    outputs: Outputs,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let outputs = &arguments.outputs;
    let written = [
        arguments.save_model.as_deref(),
        outputs.record.record.as_deref(),
        outputs.report.as_deref(),
    ];
    let others = [arguments.candidates.candidates.as_deref()];
    super::writable(&written, &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) = opened.check_data(&outputs.despite, "misfit.ladder/1", outputs.json)? {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    let own = arguments.candidates.load(&campaign)?;
    let say = |text: &str| spinner.set_message(text.to_owned());
    let mut found = ladder::climb(
        &campaign,
        &arguments.effects.list()?,
        &own,
        arguments.stop_at.as_ref(),
        &outputs.effort.options(),
        say,
    )?;
    opened.add(&found.last.fit);
    found.last.reject_too(&opened.rejected);
    if let Some(file) = &arguments.save_model {
        model_file::write(file, &found.last.fit.model)?;
    }
    let path = arguments.campaign.display();
    let given = arguments.effects.as_given() + &arguments.candidates.as_given();
    let next = match &arguments.save_model {
        Some(file) => format!("misfit fit {path} --model {}", file.display()),
        None => format!("misfit ladder {path}{given} -o model.toml"),
    };
    let stop = arguments.stop_at.as_ref();
    let stop = stop.map_or_else(String::new, |stop| format!(" --stop-at {stop}"));
    let document = report::ladder::document(&found);
    let poses = outputs.report.as_ref();
    let poses = poses.and_then(|_| pages::next_poses(&campaign, &found.last));
    let written = outputs.write(
        &opened,
        Found {
            model: &found.last.fit.model,
            document: &document,
            command: format!(
                "misfit ladder {path}{given}{stop}{}",
                outputs.effort.as_given()
            ),
            next: pages::after_ladder(&path.to_string(), &given, &found.last),
            recorded: || Ok(report::recording::of_ladder(&campaign, &found)),
            page: Results::Ladder {
                ladder: &found,
                next: poses.as_ref(),
            },
        },
    )?;
    spinner.finish_and_clear();
    if outputs.json {
        print_json(&opened.with(&document))?;
    } else {
        let mut text = report::ladder::text(&campaign, &found);
        if !written.report.is_empty() {
            text += &format!("\n{}", written.report);
        }
        print(&format!("{text}{}\nnext     {next}\n", written.record))?;
    }
    Ok(match found.last.verdict {
        Verdict::CannotTell => Outcome::Missed,
        _ => outcome(&found.last.fit),
    })
}
