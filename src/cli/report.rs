//! `misfit report`, and `--report` of the commands that have a result to show.

use super::{Outcome, print, progress};
use crate::campaign::{Campaign, write_atomically};
use crate::diagnosis::{self, Diagnosis, Verdict};
use crate::fit::Options;
use crate::ladder;
use crate::model_file;
use crate::plan::Separation;
use crate::report::diagnosis::{rejected, words_of_verdict};
use crate::report::format::{count, wrap};
use crate::report::html::{Origin, Results, Step, page};
use anyhow::Context;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Put a campaign on one page: verdict, falling error, what carries it, where, parameters, what to do next.
///
/// Climbs the ladder and draws it: one HTML file that needs nothing else, no network and no script.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit report cell3.toml                              writes report.html
  misfit report cell3.toml -o cell3.html
  misfit report cell3.toml --effects +backlash          go on from the default and backlash
  misfit fit cell3.toml --report fit.html               the page of one fit; also diagnose, ladder, run")]
pub struct Arguments {
    /// Campaign: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Effects to go on from, comma-separated; a leading + adds to the default.
    #[arg(long, value_name = "A,B,…", allow_hyphen_values = true)]
    effects: Option<String>,
    /// Model file whose [[effect]] tables are tried beside the catalogue: laws of your own.
    #[arg(long, value_name = "M.toml")]
    candidates: Option<PathBuf>,
    /// Where to write the page.
    #[arg(short, long, value_name = "FILE.html", default_value = "report.html", value_parser = html_path)]
    output: PathBuf,
    /// Skip the cross-validation of campaigns without held-out readings.
    #[arg(long)]
    no_cross_validation: bool,
}

/// A path that a browser opens, and that nothing is read from.
pub(super) fn html_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending == "html" => Ok(path),
        _ => Err("accepted: a path ending in .html".to_owned()),
    }
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let others = [arguments.candidates.as_deref()];
    super::writable(&[Some(&arguments.output)], &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    let campaign = opened.campaign.clone();
    let options = Options {
        cross_validate: !arguments.no_cross_validation,
    };
    let own = match &arguments.candidates {
        Some(file) => model_file::candidates(&campaign, file)?,
        None => Vec::new(),
    };
    let effects = arguments.effects.as_deref();
    let say = |text: &str| spinner.set_message(text.to_owned());
    let ladder = ladder::climb(&campaign, effects, &own, None, &options, say)?;
    opened.add(&ladder.last.fit);
    let next = next_poses(&campaign, &ladder.last);
    let path = arguments.campaign.display();
    let effects = effects.map(|list| format!(" --effects {list}"));
    let own = arguments.candidates.as_ref();
    let own = own.map(|file| format!(" --candidates {}", file.display()));
    let given = effects.unwrap_or_default() + &own.unwrap_or_default();
    let quick = quickly(arguments.no_cross_validation);
    let origin = Origin {
        command: format!("misfit report {path}{given}{quick}"),
        next: after_ladder(&path.to_string(), &given, &ladder.last),
        seed: None,
        findings: opened.findings.clone(),
    };
    let results = Results::Ladder {
        ladder: &ladder,
        next: next.as_ref(),
    };
    write(&arguments.output, &campaign, &results, &origin)?;
    spinner.finish_and_clear();
    let commands: Vec<&str> = origin.next.iter().map(|s| s.command.as_str()).collect();
    let mut title = format!(
        "{} · robot {} · {} fitted",
        campaign.name,
        campaign.robot.name,
        count(ladder.last.fit.readings.0, "reading")
    );
    if let Some(rejected) = rejected(&ladder.last) {
        title = format!("{title} · {rejected}");
    }
    print(&format!(
        "{}\n{}\n\n{}\nnext     {}\n",
        wrap(&title, 9),
        wrap(&words_of_verdict(&ladder.last), 9),
        line(&arguments.output),
        commands.join("\n         ")
    ))?;
    Ok(if ladder.last.fit.converged {
        Outcome::Done
    } else {
        Outcome::Missed
    })
}

/// The poses that would settle an alias; a plan that cannot be made is no reason to keep the verdict back.
pub(super) fn next_poses(campaign: &Campaign, diagnosis: &Diagnosis) -> Option<Separation> {
    diagnosis::next_poses(campaign, diagnosis, diagnosis::POSES)
        .ok()
        .flatten()
}

/// Commands to go on with after a ladder: keep its model; measure what it cannot tell.
pub(super) fn after_ladder(path: &str, given: &str, last: &Diagnosis) -> Vec<Step> {
    let keep = Step::new(
        "keep the model of the last rung, for --model of fit and compensate",
        format!("misfit ladder {path}{given} -o model.toml"),
    );
    let plan = match last.alike.first() {
        Some((a, b)) => {
            let command = format!("misfit plan {path} --separate {},{}", a.id(), b.id());
            return vec![tell_apart(a.id(), b.id(), command), keep];
        }
        None => Step::new(
            "choose the poses that would make the parameters more exact",
            format!("misfit plan {path}"),
        ),
    };
    own_law(path, last)
        .into_iter()
        .chain([keep, plan])
        .collect()
}

/// Where the catalogue has no name for what is left, the user may have an idea.
pub(super) fn own_law(path: &str, last: &Diagnosis) -> Option<Step> {
    let unexplained = matches!(last.verdict, Verdict::Unknown | Verdict::NamedIncomplete);
    (unexplained && !last.stopped && last.power.is_enough()).then(|| {
        Step::new(
            "write down what you think it is as a law of your own (misfit effects show expression), and try it",
            format!("misfit diagnose {path} --candidates laws.toml"),
        )
    })
}

/// What settles an alias.
pub(super) fn tell_apart(a: &str, b: &str, command: String) -> Step {
    Step::new(
        format!("measure poses that tell {a} from {b}; this lists them as a table"),
        command,
    )
}

/// The word of the command line, as it was given.
pub(super) fn quickly(no_cross_validation: bool) -> &'static str {
    match no_cross_validation {
        true => " --no-cross-validation",
        false => "",
    }
}

/// Writes the page; an old file stays whole if it cannot be.
pub(super) fn write(
    path: &Path,
    campaign: &Campaign,
    results: &Results<'_>,
    origin: &Origin,
) -> anyhow::Result<()> {
    let text = page(campaign, results, origin)?;
    write_atomically(path, |file| file.write_all(text.as_bytes()))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Says where it is.
pub(super) fn line(path: &Path) -> String {
    format!("report   {}", path.display())
}
