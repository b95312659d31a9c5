//! `misfit report`, and `--report` of the commands that have a result to show.

use super::arguments::{Candidates, Effects, Effort, outcome};
use super::{Outcome, page, print, progress};
use crate::campaign::Campaign;
use crate::diagnosis::{self, Diagnosis, Verdict};
use crate::ladder;
use crate::plan::Separation;
use crate::report::diagnosis::{rejected, words_of_verdict};
use crate::report::format::{count, wrap};
use crate::report::html::{Origin, Results, Step};
use std::path::PathBuf;

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
    #[command(flatten)]
    effects: Effects,
    #[command(flatten)]
    candidates: Candidates,
    /// Where to write the page.
    #[arg(short, long, value_name = "FILE.html", default_value = "report.html", value_parser = page::html_path)]
    output: PathBuf,
    #[command(flatten)]
    effort: Effort,
}

/// Runs the command.
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let others = [arguments.candidates.candidates.as_deref()];
    super::writable(&[Some(&arguments.output)], &arguments.campaign, &others)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    let campaign = opened.campaign.clone();
    let own = arguments.candidates.load(&campaign)?;
    let effects = arguments.effects.list()?;
    let options = arguments.effort.options();
    let say = |text: &str| spinner.set_message(text.to_owned());
    let mut ladder = ladder::climb(&campaign, &effects, &own, None, &options, say)?;
    opened.add(&ladder.last.fit);
    ladder.last.reject_too(&opened.rejected);
    let next = next_poses(&campaign, &ladder.last);
    let path = arguments.campaign.display();
    let given = arguments.effects.as_given() + &arguments.candidates.as_given();
    let quick = arguments.effort.as_given();
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
    page::write(&arguments.output, &campaign, &results, &origin)?;
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
        page::line(&arguments.output),
        commands.join("\n         ")
    ))?;
    Ok(outcome(&ladder.last.fit))
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
