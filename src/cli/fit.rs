//! `misfit fit`.

use super::record::Record;
use super::{Outcome, print, print_json, progress, report as pages, usage};
use crate::campaign::Campaign;
use crate::fit::{self, Options};
use crate::model_file;
use crate::report;
use crate::report::fit::Detail;
use crate::report::html::{Origin, Results, Step};
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
    /// Effects of the model, comma-separated; a leading + adds to the default (or to those of --model).
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    effects: Option<String>,
    /// Model file with [[effect]] tables, values to start from or to hold; it replaces the default model.
    #[arg(long, value_name = "M.toml")]
    model: Option<PathBuf>,
    /// How to estimate: weighted nonlinear least squares, or the paper's unweighted linear estimator.
    #[arg(long, value_enum, default_value_t = Method::Weighted)]
    method: Method,
    /// Write the result as one HTML page too, with pictures.
    #[arg(long, value_name = "FILE.html", value_parser = pages::html_path)]
    report: Option<PathBuf>,
    #[command(flatten)]
    record: Record,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    /// List every geometric parameter.
    #[arg(long)]
    all: bool,
    /// Skip the cross-validation of campaigns without held-out readings.
    #[arg(long)]
    no_cross_validation: bool,
    #[command(flatten)]
    despite: super::Despite,
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
    let outputs = [
        arguments.record.record.as_deref(),
        arguments.report.as_deref(),
    ];
    super::writable(&outputs, &arguments.campaign, &[arguments.model.as_deref()])?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) = opened.check_data(&arguments.despite, "misfit.fit/1", arguments.json)? {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    if arguments.method == Method::Paper {
        return paper(arguments, &campaign);
    }
    let model = model_file::model(
        &campaign,
        arguments.effects.as_deref(),
        arguments.model.as_deref(),
    )?;
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
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
    let of_model = arguments.model.as_ref();
    let of_model =
        of_model.map_or_else(String::new, |model| format!(" --model {}", model.display()));
    let next = format!("misfit diagnose {path}{of_model}");
    let effects = arguments.effects.as_ref();
    let effects = effects.map_or_else(String::new, |list| format!(" --effects {list}"));
    let quickly = pages::quickly(arguments.no_cross_validation);
    let command = format!("misfit fit {path}{of_model}{effects}{quickly}");
    let document = report::json::fit(&found, baseline.as_ref());
    let recorded = arguments.record.write(
        &campaign,
        || report::recording::of_fit(&campaign, baseline.as_ref(), &found),
        &found.model,
        &opened.with(&document),
        &command,
    )?;
    if let Some(file) = &arguments.report {
        let origin = Origin {
            command,
            next: vec![Step::new(
                "ask which physical effect the model lacks, if any",
                next.clone(),
            )],
            seed: None,
            findings: opened.findings.clone(),
        };
        let results = Results::Fit {
            fit: &found,
            baseline: baseline.as_ref(),
        };
        pages::write(file, &campaign, &results, &origin)?;
    }
    spinner.finish_and_clear();
    if arguments.json {
        print_json(&opened.with(&document))?;
    } else {
        let detail = if arguments.all {
            Detail::Everything
        } else {
            Detail::Usual
        };
        let mut text = report::fit::text(&campaign, &found, baseline.as_ref(), detail);
        if let Some(file) = &arguments.report {
            text += &format!("{}\n", pages::line(file));
        }
        print(&format!("{text}{recorded}next     {next}\n"))?;
    }
    Ok(if found.converged {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}

/// The paper's own estimator.
fn paper(arguments: &Arguments, campaign: &Campaign) -> anyhow::Result<Outcome> {
    let others = [
        arguments.effects.is_some(),
        arguments.model.is_some(),
        arguments.report.is_some(),
        arguments.record.record.is_some(),
    ];
    if others.contains(&true) {
        return Err(usage(
            "--method paper estimates joint compliance alone; leave --effects, --model, --report and --record out",
        ));
    }
    let found = fit::paper::fit(campaign)?;
    if arguments.json {
        print_json(&report::paper::document(&found))?;
    } else {
        print(&report::paper::text(campaign, &found))?;
    }
    Ok(Outcome::Done)
}
