//! `misfit fit`.

use super::arguments::{Found, ModelArguments, Outputs, Written, outcome};
use super::{Outcome, print, print_json, progress, usage};
use crate::campaign::Campaign;
use crate::fit;
use crate::model_file;
use crate::report;
use crate::report::fit::Detail;
use crate::report::html::{Results, Step};
use std::path::PathBuf;

/// Identify a model's parameters from a campaign: values, intervals, errors, and what cannot be seen.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit fit cell3.toml
  misfit fit cell3.toml --effects joint_offset          frames and joint offsets only
  misfit fit cell3.mcap --effects +transmission_error   the default and one more
  misfit fit cell3.toml --json | jq .heldout")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// How to estimate: weighted nonlinear least squares, or the paper's unweighted linear estimator.
    #[arg(long, value_enum, default_value_t = Method::Weighted)]
    method: Method,
    #[command(flatten)]
    outputs: Outputs,
    /// List every geometric parameter.
    #[arg(long)]
    all: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    /// Weighted nonlinear least squares on the loaded equilibrium.
    Weighted,
    /// Joint stiffness from loaded minus unloaded poses, 8 unweighted rows (Appl. Sci. 2019, 9, 65).
    Paper,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let outputs = &arguments.outputs;
    super::writable(
        &[outputs.record.record.as_deref(), outputs.report.as_deref()],
        &arguments.campaign,
        &[arguments.model.model.as_deref()],
    )?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) = opened.check_data(&outputs.despite, "misfit.fit/1", outputs.json)? {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    if arguments.method == Method::Paper {
        return paper(arguments, &campaign);
    }
    let model = arguments.model.model(&campaign)?;
    let options = outputs.effort.options();
    let say = |text: &str| spinner.set_message(text.to_owned());
    let frames = model_file::frames_only(&campaign)?;
    let baseline = if frames.terms.len() < model.terms.len() {
        Some(fit::fit(&campaign, &frames, &options, say)?)
    } else {
        None
    };
    let found = fit::fit(&campaign, &model, &options, say)?;
    opened.add(&found);
    let path = arguments.campaign.display();
    let next = format!("misfit diagnose {path}{}", arguments.model.file_as_given());
    let document =
        report::json::fit(&found, baseline.as_ref()).with_rejected(opened.rejected.len());
    let written = outputs.write(
        &opened,
        Found {
            model: &found.model,
            document: &document,
            command: format!(
                "misfit fit {path}{}{}",
                arguments.model.as_given(),
                outputs.effort.as_given()
            ),
            next: vec![Step::new(
                "ask which physical effect the model lacks, if any",
                next.clone(),
            )],
            recorded: || {
                Ok(report::recording::of_fit(
                    &campaign,
                    baseline.as_ref(),
                    &found,
                ))
            },
            page: Results::Fit {
                fit: &found,
                baseline: baseline.as_ref(),
            },
        },
    )?;
    spinner.finish_and_clear();
    if outputs.json {
        print_json(&opened.with(&document))?;
    } else {
        let detail = if arguments.all {
            Detail::Everything
        } else {
            Detail::Usual
        };
        let text = report::fit::text(&campaign, &found, baseline.as_ref(), detail);
        let Written { report, record } = written;
        print(&format!("{text}{report}{record}next     {next}\n"))?;
    }
    Ok(outcome(&found))
}

/// The paper's own estimator.
fn paper(arguments: &Arguments, campaign: &Campaign) -> anyhow::Result<Outcome> {
    let outputs = &arguments.outputs;
    let written = outputs.report.is_some() || outputs.record.record.is_some();
    if arguments.model.is_given() || written {
        return Err(usage(
            "--method paper estimates joint compliance alone; leave --effects, --model, --report and --record out",
        ));
    }
    let found = fit::paper::fit(campaign)?;
    if outputs.json {
        print_json(&report::paper::document(&found))?;
    } else {
        print(&report::paper::text(campaign, &found))?;
    }
    Ok(Outcome::Done)
}
