//! `misfit diagnose`.

use super::arguments::{Candidates, Found, ModelArguments, Outputs, outcome};
use super::{Outcome, print, print_json, progress, report as pages};
use crate::diagnosis::{self, Diagnosis, Verdict};
use crate::fit;
use crate::report::format::WIDTH;
use crate::report::html::{Results, Step};
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
    #[command(flatten)]
    model: ModelArguments,
    #[command(flatten)]
    candidates: Candidates,
    /// Write the model with what is missing, for --model.
    #[arg(short = 'o', long, value_name = "M.toml")]
    save_model: Option<PathBuf>,
    #[command(flatten)]
    outputs: Outputs,
}

/// Runs the command.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let outputs = &arguments.outputs;
    let written = [
        arguments.save_model.as_deref(),
        outputs.record.record.as_deref(),
        outputs.report.as_deref(),
    ];
    let others = [
        arguments.candidates.candidates.as_deref(),
        arguments.model.model.as_deref(),
    ];
    super::writable(&written, &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    if let Some(outcome) =
        opened.check_data(&outputs.despite, "misfit.diagnosis/2", outputs.json)?
    {
        spinner.finish_and_clear();
        return Ok(outcome);
    }
    let campaign = opened.campaign.clone();
    let model = arguments.model.model(&campaign)?;
    let options = outputs.effort.options();
    let own = arguments.candidates.load(&campaign)?;
    let say = |text: &str| spinner.set_message(text.to_owned());
    let mut found = diagnosis::diagnose(&campaign, &model, &own, &options, say)?;
    opened.add(&found.fit);
    found.reject_too(&opened.rejected);
    let next = pages::next_poses(&campaign, &found);
    if let Some(file) = &arguments.save_model {
        model_file::write(file, &found.fit.model)?;
    }
    let path = arguments.campaign.display();
    let given = arguments.model.file_as_given();
    let tried = arguments.candidates.as_given();
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
    let ladder = given
        .is_empty()
        .then(|| format!("misfit ladder {path}{tried}"))
        .map(|command| {
            Step::new(
                "watch the error fall from the frames on, rung by rung",
                command,
            )
        });
    let steps: Vec<Step> = add.into_iter().chain(apart).chain(ladder).collect();
    let document = report::diagnosis::document(&found, next.as_ref());
    let recorded = || {
        let frames = model_file::frames_only(&campaign)?;
        let frames = fit::fit(&campaign, &frames, &options, |_| {})?;
        Ok(report::recording::of_diagnosis(&campaign, &frames, &found))
    };
    let written = outputs.write(
        &opened,
        Found {
            model: &found.fit.model,
            document: &document,
            command: format!(
                "misfit diagnose {path}{}{tried}{}",
                arguments.model.as_given(),
                outputs.effort.as_given()
            ),
            next: pages::own_law(&path.to_string(), &found)
                .into_iter()
                .chain(steps.clone())
                .collect(),
            recorded,
            page: Results::Diagnosis {
                diagnosis: &found,
                next: next.as_ref(),
            },
        },
    )?;
    spinner.finish_and_clear();
    if outputs.json {
        print_json(&opened.with(&document))?;
    } else {
        let mut text = report::diagnosis::text(&campaign, &found, next.as_ref());
        let blocks = [written.report, written.record].into_iter();
        for block in blocks.filter(|block| !block.is_empty()) {
            text += &format!("\n{block}");
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
    Ok(match found.verdict {
        Verdict::CannotTell => Outcome::Missed,
        _ => outcome(&found.fit),
    })
}

fn has_options(found: &Diagnosis, effect: &str) -> bool {
    let term = found.fit.model.term(effect);
    term.is_some_and(|term| !term.effect.options().is_empty())
}
