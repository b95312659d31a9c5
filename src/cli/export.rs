//! `misfit export`.

use super::arguments::{ModelArguments, outcome};
use super::{Outcome, print, progress, usage};
use crate::campaign::{Campaign, write_atomically};
use crate::effects::Role;
use crate::export::{Calibrated, dh, urdf};
use crate::fit::{self, Options};
use crate::report::export::{self as report, Made};
use crate::{model_file, report::export::Subject};
use anyhow::Context;
use std::io::Write;
use std::path::PathBuf;

/// Write what was identified in forms that others read: a calibrated URDF, a corrected DH table, or all numbers as JSON.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit export cell3.toml -o calibrated.urdf           the robot file with calibrated numbers
  misfit export cell3.toml -o table.toml                a DH table, row by row beside the nominal one
  misfit export cell3.toml -o table.toml --target r1    of the arm that carries target r1
  misfit export cell3.toml -o found.json --model m.toml && jq .stiffness found.json

A URDF or a DH table holds what is the same in every posture; what bends, slips or winds is listed with
its size, and `misfit compensate` corrects commands for it.")]
pub struct Arguments {
    /// Campaign that the model is fitted to: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// File to write; its ending is the format: .urdf, .toml (DH table) or .json.
    #[arg(short, long, value_name = "FILE", value_parser = output_path)]
    output: PathBuf,
    /// Whose arm the DH table is of; needed where there are several targets.
    #[arg(long, value_name = "NAME")]
    target: Option<String>,
    /// Four numbers in each row of the DH table also where axes are nearly parallel: exact, but with large offsets, and
    /// refused where they are absurd. Without it such a row has a fifth (Hayati's beta).
    #[arg(long)]
    four_numbers: bool,
    #[command(flatten)]
    despite: super::Despite,
}

#[derive(Clone, Copy, PartialEq)]
enum Format {
    Urdf,
    Table,
    Json,
}

/// The format by a path's ending.
fn format(path: &std::path::Path) -> Option<Format> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("urdf") => Some(Format::Urdf),
        Some("toml") => Some(Format::Table),
        Some("json") => Some(Format::Json),
        _ => None,
    }
}

fn output_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match format(&path) {
        Some(_) => Ok(path),
        None => Err("accepted: a path ending in .urdf, .toml (DH table) or .json".to_owned()),
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let path = &arguments.output;
    let is_table = format(path) == Some(Format::Table);
    if !is_table && (arguments.target.is_some() || arguments.four_numbers) {
        return Err(usage(
            "--target and --four-numbers are for DH tables: -o FILE.toml",
        ));
    }
    let others = [arguments.model.model.as_deref()];
    super::writable(&[Some(path)], &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    opened.refuse(&arguments.despite)?;
    let campaign = opened.campaign.clone();
    let target = if is_table {
        target(arguments, &campaign)?
    } else {
        0
    };
    let model = arguments.model.model(&campaign)?;
    spinner.set_message("fitting");
    let options = Options {
        cross_validate: false,
    };
    let found = fit::fit(&campaign, &model, &options, |_| {})?;
    opened.add(&found);
    opened.refuse(&arguments.despite)?;
    let calibrated = Calibrated::of(&found, &campaign);
    let file = path.display().to_string();
    let note = report::note(&campaign, &found, &calibrated);
    let subject = Subject {
        campaign: &campaign,
        fit: &found,
        calibrated: &calibrated,
    };
    let (bytes, made) = match format(path) {
        Some(Format::Urdf) => {
            let made = urdf::write(&calibrated, &campaign, &file, &note)?;
            (made.text.clone(), Made::Urdf(made))
        }
        Some(Format::Table) => {
            let names = (file.as_str(), note.as_str());
            let made = dh::write(
                &calibrated,
                &campaign,
                target,
                names,
                arguments.four_numbers,
            )?;
            (made.text.clone(), Made::Table(Box::new(made)))
        }
        _ => {
            let document = report::document(&subject);
            (
                serde_json::to_string_pretty(&opened.with(&document))? + "\n",
                Made::Json,
            )
        }
    };
    let rigid = rigid_fit(&subject, &campaign, &options)?;
    write_atomically(path, |out| out.write_all(bytes.as_bytes()))
        .with_context(|| format!("{file}: cannot be written"))?;
    spinner.finish_and_clear();
    let same = format!(
        "{}{}",
        arguments.campaign.display(),
        arguments.model.as_given()
    );
    print(&report::text(&subject, &file, &made, &same, rigid.as_ref()))?;
    Ok(outcome(&found))
}

/// Where the model holds what a file cannot: what the frames alone leave, and a fit of what the file can hold.
fn rigid_fit(
    subject: &Subject<'_>,
    campaign: &Campaign,
    options: &Options,
) -> anyhow::Result<Option<report::Rigid>> {
    if subject.calibrated.left_out.is_empty() {
        return Ok(None);
    }
    let frames = model_file::frames_only(campaign)?;
    let nominal = fit::fit(campaign, &frames, options, |_| {})?;
    let mut model = subject.fit.model.clone();
    for effect in &subject.calibrated.left_out {
        model = model.without(&effect.effect);
    }
    let own = fit::fit(campaign, &model, options, |_| {})?;
    let effects = model.terms.iter().map(|term| &term.effect);
    let effects: Vec<&str> = effects
        .filter(|effect| !effect.role().is_some_and(Role::is_frame))
        .map(|effect| effect.id())
        .collect();
    Ok(Some(report::Rigid {
        nominal: crate::export::position_error(&nominal.model, &nominal.values, &campaign.readings),
        own: crate::export::position_error(&own.model, &own.values, &campaign.readings),
        effects: effects.join(","),
    }))
}

/// The target whose arm a table is of.
fn target(arguments: &Arguments, campaign: &Campaign) -> anyhow::Result<usize> {
    let names: Vec<&str> = campaign.targets.iter().map(|t| t.name.as_str()).collect();
    match &arguments.target {
        Some(wanted) => names.iter().position(|name| name == wanted).ok_or_else(|| {
            usage(format!(
                "--target {wanted}: no such target; accepted: {}",
                names.join(", ")
            ))
        }),
        None if names.len() == 1 => Ok(0),
        None => Err(usage(format!(
            "a DH table is of one arm: say --target NAME; accepted: {}",
            names.join(", ")
        ))),
    }
}
