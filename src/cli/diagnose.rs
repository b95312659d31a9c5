//! `misfit diagnose`.

use super::record::Record;
use super::{Outcome, print, print_json, progress, report as pages};
use crate::diagnosis::{self, Diagnosis, Verdict};
use crate::fit::{self, Options};
use crate::report::format::WIDTH;
use crate::report::html::{Origin, Results, Step};
use crate::{model_file, report};
use std::path::PathBuf;

/// Learn what a model is missing: which physical effect, or that nothing is detectable, or that nobody knows.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit diagnose cell3.toml
  misfit diagnose cell3.toml --effects joint_offset,joint_compliance   what does this model lack?
  misfit diagnose cell3.toml --json | jq .verdict")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Effects of the base model, comma-separated; a leading + adds to the default.
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    effects: Option<String>,
    /// Model file with [[effect]] tables.
    #[arg(long, value_name = "M.toml")]
    model: Option<PathBuf>,
    /// Model file whose [[effect]] tables are tried beside the catalogue: laws of your own.
    #[arg(long, value_name = "M.toml")]
    candidates: Option<PathBuf>,
    /// Write the model with what is missing, for --model.
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
    let others = [arguments.candidates.as_deref(), arguments.model.as_deref()];
    super::writable(&outputs, &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) =
        opened.check_data(&arguments.despite, "misfit.diagnosis/2", arguments.json)?
    {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    let model = model_file::model(
        &campaign,
        arguments.effects.as_deref(),
        arguments.model.as_deref(),
    )?;
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
    let own = match &arguments.candidates {
        Some(file) => model_file::candidates(&campaign, file)?,
        None => Vec::new(),
    };
    let say = |text: &str| spinner.set_message(text.to_owned());
    let found = diagnosis::diagnose(&campaign, &model, &own, &options, say)?;
    opened.add(&found.fit);
    let next = pages::next_poses(&campaign, &found);
    if let Some(file) = &arguments.save_model {
        model_file::write(file, &found.fit.model)?;
    }
    let path = arguments.campaign.display();
    let of_model = arguments.model.as_ref();
    let of_model = of_model.map(|model| format!(" --model {}", model.display()));
    let given = of_model.as_deref().unwrap_or("");
    let of_candidates = arguments.candidates.as_ref();
    let of_candidates = of_candidates.map(|file| format!(" --candidates {}", file.display()));
    let tried = of_candidates.as_deref().unwrap_or("");
    let is_own = |id: &str| own.iter().any(|effect| effect.id() == id);
    let add = match (
        found.named.first().map(String::as_str),
        &arguments.save_model,
    ) {
        (Some(_), Some(file)) => Some(format!("misfit fit {path} --model {}", file.display())),
        // what it was found with are options (cycles of waves, a knee, a law of the user's own): a file holds them
        (Some(id), None) if has_options(&found, id) || is_own(id) => Some(format!(
            "misfit diagnose {path}{given}{tried} -o model.toml"
        )),
        (Some(effect), None) => Some(format!("misfit fit {path}{given} --effects +{effect}")),
        (None, _) => None,
    };
    let add = add.map(|command| Step::new("fit the model with what is missing", command));
    let apart = found.alike.first().map(|(a, b)| {
        let command = format!("misfit plan {path} --separate {},{}", a.id(), b.id());
        pages::tell_apart(a.id(), b.id(), command)
    });
    // a ladder starts from the frames, whatever the model
    let ladder = of_model
        .is_none()
        .then(|| format!("misfit ladder {path}{tried}"))
        .map(|command| {
            Step::new(
                "watch the error fall from the frames on, rung by rung",
                command,
            )
        });
    let steps: Vec<Step> = add.into_iter().chain(apart).chain(ladder).collect();
    let effects = arguments.effects.as_ref();
    let effects = effects.map_or_else(String::new, |list| format!(" --effects {list}"));
    let command = format!(
        "misfit diagnose {path}{given}{effects}{tried}{}",
        pages::quickly(arguments.no_cross_validation)
    );
    let document = report::diagnosis::document(&found, next.as_ref());
    let mut recorded = String::new();
    if arguments.record.record.is_some() {
        let frames = model_file::frames_only(&campaign)?;
        let frames = fit::fit(&campaign, &frames, &options, |_| {})?;
        recorded = arguments.record.write(
            &campaign,
            || report::recording::of_diagnosis(&campaign, &frames, &found),
            &found.fit.model,
            &opened.with(&document),
            &command,
        )?;
    }
    if let Some(file) = &arguments.report {
        let origin = Origin {
            command,
            next: pages::own_law(&path.to_string(), &found)
                .into_iter()
                .chain(steps.clone())
                .collect(),
            seed: None,
            findings: opened.findings.clone(),
        };
        let results = Results::Diagnosis {
            diagnosis: &found,
            next: next.as_ref(),
        };
        pages::write(file, &campaign, &results, &origin)?;
    }
    spinner.finish_and_clear();
    if arguments.json {
        print_json(&opened.with(&document))?;
    } else {
        let mut text = report::diagnosis::text(&campaign, &found, next.as_ref());
        if let Some(file) = &arguments.report {
            text += &format!("\n{}\n", pages::line(file));
        }
        if !recorded.is_empty() {
            text += &format!("\n{recorded}");
        }
        let commands: Vec<&str> = steps.iter().map(|step| step.command.as_str()).collect();
        if !commands.is_empty() {
            let side = commands.join("     or     ");
            // commands stay whole where they do not fit beside each other
            let next = match side.chars().count() + 9 <= usize::from(WIDTH) {
                true => side,
                false => commands.join("\n         "),
            };
            text += &format!("\nnext     {next}\n");
        }
        print(&text)?;
    }
    Ok(
        if found.fit.converged && found.verdict != Verdict::CannotTell {
            Outcome::Done
        } else {
            Outcome::Missed
        },
    )
}

fn has_options(found: &Diagnosis, effect: &str) -> bool {
    let term = found.fit.model.term(effect);
    term.is_some_and(|term| !term.effect.options().is_empty())
}
