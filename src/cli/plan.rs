//! `misfit plan`.

use super::arguments::{ModelArguments, outcome};
use super::{Outcome, print, print_json, progress, simulate, usage};
use crate::campaign::{Campaign, Noise, Payload, Reading, Split, render_commands};
use crate::effects::AnyEffect;
use crate::effects::table::Choice;
use crate::fit::{self, Fit, Options};
use crate::input::{self, LARGEST_TOML};
use crate::model::Model;
use crate::plan::{self, Aim, Limits, Protocol, Task};
use crate::report::plan::{Ground, Result as Planned};
use crate::scenario::{Scenario, efficiency, planned};
use crate::space::Space;
use crate::{model_file, report};
use anyhow::Context;
use nalgebra::Vector3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Choose poses to measure: so that parameters become precise, or two effects can be told apart.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit plan scenarios/hidden.toml --poses 15                   a campaign before it is measured
  misfit plan cell3.toml --poses 10 --csv next.csv               what to measure next
  misfit plan cell3.toml --of joint_compliance                   precise springs, all else free
  misfit plan cell3.toml --separate bearing_tilt,link_flexibility

A limits file (--limits) says where the arm may be measured; all of it is optional:
  margin = 0.05                   share of each joint's range left free at either end
  least_height_m = 0.2            of the targets above the base
  [fixed]
  torso_deg = 0
  [limits]
  r1_s_deg = [-60, 90]
  [[forbidden]]                   postures with all of these at once
  r1_l_deg = [-110, -60]
  r1_e_deg = [60, 170]")]
pub struct Arguments {
    /// Scenario, or a campaign whose readings count as measured: robot, targets, frames, noise, loads.
    spec: PathBuf,
    /// Poses to choose; as many as the scenario's design has, or 15.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=500))]
    poses: Option<u16>,
    /// Smallest volume of the parameters' uncertainty (d), or smallest mean square error (a): of positions at test
    /// poses, or with --of of those parameters.
    #[arg(long, value_enum, default_value_t = Criterion::D, conflicts_with = "separate")]
    criterion: Criterion,
    /// Effects whose parameters count; all others are free.
    #[arg(long, value_name = "A,B,…", conflicts_with = "separate")]
    of: Option<String>,
    /// Tell these two effects apart.
    #[arg(long, value_name = "A,B")]
    separate: Option<String>,
    #[command(flatten)]
    model: ModelArguments,
    /// Limits file: joint ranges, fixed joints, forbidden postures, least height.
    #[arg(long, value_name = "LIMITS.toml")]
    limits: Option<PathBuf>,
    /// Payloads to measure with, kg; their centre is that of the heaviest known one.
    #[arg(long, value_name = "KG,KG,…", allow_hyphen_values = true)]
    loads: Option<String>,
    /// Targets to measure; all if left out.
    #[arg(long, value_name = "A,B,…")]
    targets: Option<String>,
    /// Directions from which each pose is approached.
    #[arg(long, value_parser = clap::value_parser!(u8).range(1..=2))]
    directions: Option<u8>,
    /// Repeats of each pose, load and direction.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1000))]
    repeats: Option<u16>,
    /// Random postures to choose from.
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u16).range(2..=5000))]
    candidates: u16,
    /// Do not count the campaign's readings as measured.
    #[arg(long)]
    from_scratch: bool,
    /// Seed of the random postures; the scenario's, or 1.
    #[arg(long)]
    seed: Option<u64>,
    /// Write the commands as a table of a campaign, to be measured.
    #[arg(long, value_name = "POSES.csv")]
    csv: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Criterion {
    /// Determinant.
    D,
    /// Average.
    A,
}

/// What a scenario or a campaign says about readings to be taken.
struct Spec {
    campaign: Campaign,
    model: Model,
    values: Vec<f64>,
    noise: Noise,
    protocol: Protocol,
    space: Space,
    poses: usize,
    seed: u64,
    /// The fit of a campaign; a scenario is known.
    fit: Option<Fit>,
}

/// Poses proposed after a campaign if none says how many.
const POSES: usize = 15;

/// Runs the command.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let pair = match arguments.separate.as_deref().map(words) {
        None => None,
        Some(names) => match names[..] {
            [a, b] if a != b => Some((a, b)),
            _ => return Err(usage("--separate takes two different effects: A,B")),
        },
    };
    if let Some(file) = &arguments.csv {
        let read = [
            arguments.model.model.as_deref(),
            arguments.limits.as_deref(),
        ];
        super::spare(file, &arguments.spec, &read)?;
    }
    let spinner = progress::spinner();
    let say = |text: &str| spinner.set_message(text.to_owned());
    let mut spec = match is_scenario(&arguments.spec)? {
        true => of_scenario(arguments)?,
        false => of_campaign(arguments, say)?,
    };
    adjust(arguments, &mut spec)?;
    let measured: Vec<&Reading> = match (&spec.fit, arguments.from_scratch) {
        (Some(_), false) => fitted(&spec.campaign),
        _ => Vec::new(),
    };
    let task = Task {
        model: &spec.model,
        values: &spec.values,
        noise: spec.noise,
        measured: &measured,
        protocol: spec.protocol.clone(),
        space: spec.space.clone(),
        poses: spec.poses,
        candidates: usize::from(arguments.candidates).max(4 * spec.poses),
        seed: spec.seed,
    };
    let origin = arguments.spec.display().to_string();
    let found = match pair {
        None => {
            let aim = match arguments.criterion {
                Criterion::D => Aim::D,
                Criterion::A => Aim::A,
            };
            let of = interest(arguments.of.as_deref(), &spec.model)?;
            Planned::Precision {
                aim,
                found: Box::new(plan::precise(&task, aim, &of, say)?),
                of,
            }
        }
        Some((a, b)) => {
            let effects = [
                Choice::named("--separate", a)?.effect,
                Choice::named("--separate", b)?.effect,
            ];
            say("sizes of the effects");
            let sizes = [sizes(&spec, &effects[0])?, sizes(&spec, &effects[1])?];
            say("exchanging poses");
            let found = plan::separate(
                &task,
                [&effects[0], &effects[1]],
                [sizes[0].as_deref(), sizes[1].as_deref()],
            )?;
            Planned::Separation {
                found,
                fitted: sizes.iter().any(Option::is_some),
            }
        }
    };
    spinner.finish_and_clear();
    let future = Campaign {
        readings: plan::visits(&task, found.poses()),
        ..spec.campaign.clone()
    };
    if let Some(path) = &arguments.csv {
        let table = render_commands(&future)
            .with_context(|| format!("{}: cannot be written", path.display()))?;
        simulate::write_text(path, &String::from_utf8_lossy(&table))?;
    }
    let ground = Ground {
        origin: &origin,
        task: &task,
        future: &future,
        fit: spec.fit.as_ref(),
        csv: arguments.csv.as_deref(),
    };
    if arguments.json {
        print_json(&report::plan::document(&ground, &found))?;
    } else {
        print(&report::plan::text(&ground, &found))?;
    }
    Ok(spec.fit.as_ref().map_or(Outcome::Done, outcome))
}

pub(super) fn words(list: &str) -> Vec<&str> {
    let words = list.split(',').map(str::trim);
    words.filter(|word| !word.is_empty()).collect()
}

fn fitted(campaign: &Campaign) -> Vec<&Reading> {
    let readings = campaign.readings.iter();
    readings.filter(|r| r.split == Split::Fit).collect()
}

/// A scenario has a design, or is like another one; a campaign has a table.
pub(super) fn is_scenario(path: &Path) -> anyhow::Result<bool> {
    if path.extension().is_none_or(|ending| ending != "toml") {
        return Ok(false);
    }
    let text = input::text(path, LARGEST_TOML)
        .with_context(|| format!("{}: cannot be read", path.display()))?;
    // what is no TOML the reader of campaigns refuses, with its line
    let told = |table: toml::Table| {
        ["design", "like"]
            .iter()
            .any(|key| table.contains_key(*key))
    };
    Ok(input::toml(&text).is_ok_and(told))
}

/// A scenario's design, about its truth: what the plan is for.
fn of_scenario(arguments: &Arguments) -> anyhow::Result<Spec> {
    let scenario = Scenario::load(&arguments.spec)?;
    let (protocol, campaign) = planned(&scenario)?;
    let model = match arguments.model.is_given() {
        true => arguments.model.model(&campaign)?,
        false => model_file::model(&campaign, &scenario.effects, None)?,
    };
    Ok(Spec {
        values: efficiency::true_values(&scenario, &model),
        model,
        noise: scenario.noise,
        protocol,
        space: scenario.design.space.clone(),
        poses: scenario.design.poses,
        seed: scenario.seed,
        fit: None,
        campaign,
    })
}

/// What to measure after a campaign, about its fit.
fn of_campaign(arguments: &Arguments, say: impl Fn(&str)) -> anyhow::Result<Spec> {
    let campaign = super::open_and_say(&arguments.spec)?.campaign;
    let model = arguments.model.model(&campaign)?;
    let options = Options {
        cross_validate: false,
    };
    say("fitting the model");
    let fit = fit::fit(&campaign, &model, &options, |_| {})?;
    let readings = fitted(&campaign);
    let next = Task::after(&fit, &readings, POSES);
    let (noise, protocol, space) = (next.noise, next.protocol, next.space);
    Ok(Spec {
        model,
        values: fit.values.clone(),
        noise,
        protocol,
        space,
        poses: POSES,
        seed: 1,
        fit: Some(fit),
        campaign,
    })
}

/// What the command line says besides.
fn adjust(arguments: &Arguments, spec: &mut Spec) -> anyhow::Result<()> {
    let protocol = &mut spec.protocol;
    if let Some(list) = &arguments.targets {
        protocol.targets = words(list)
            .into_iter()
            .map(|name| {
                let targets = &spec.campaign.targets;
                targets
                    .iter()
                    .position(|t| t.name == name)
                    .with_context(|| {
                        let names: Vec<&str> = targets.iter().map(|t| t.name.as_str()).collect();
                        format!(
                            "--targets: no target is called \"{name}\"; known: {}",
                            names.join(", ")
                        )
                    })
            })
            .collect::<Result<_, _>>()?;
        protocol.targets.sort_unstable();
        protocol.targets.dedup();
        if protocol.targets.is_empty() {
            anyhow::bail!("--targets: none is named; accepted: one or more");
        }
    }
    let posture = spec.fit.as_ref().and(spec.campaign.readings.first());
    let posture = posture.map(|reading| &reading.joints[..]);
    spec.space
        .park(&spec.model.setup, &protocol.targets, posture);
    if let Some(list) = &arguments.loads {
        let com = protocol.loads.iter().flatten();
        let com = com.max_by(|a, b| a.mass.total_cmp(&b.mass));
        let com = com.map_or_else(Vector3::zeros, |payload| payload.com);
        protocol.loads = words(list)
            .into_iter()
            .map(|word| match word.parse::<f64>() {
                Ok(mass) if mass.is_finite() && mass >= 0.0 => Ok(Some(Payload { mass, com })),
                _ => anyhow::bail!(
                    "--loads: found \"{word}\"; accepted: masses in kg, finite, 0 or more"
                ),
            })
            .collect::<Result<_, _>>()?;
        if protocol.loads.is_empty() {
            anyhow::bail!("--loads: none is named; accepted: masses in kg");
        }
    }
    if let Some(directions) = arguments.directions {
        protocol.directions = match directions {
            1 => vec![None],
            _ => vec![Some(-1.0), Some(1.0)],
        };
    }
    if let Some(repeats) = arguments.repeats {
        protocol.repeats = usize::from(repeats);
    }
    if let Some(path) = &arguments.limits {
        Limits::load(path, &spec.campaign.robot, &mut spec.space)?;
    }
    if let Some(poses) = arguments.poses {
        spec.poses = usize::from(poses);
    }
    if let Some(seed) = arguments.seed {
        spec.seed = seed;
    }
    Ok(())
}

/// The effects named, each of which the model must hold.
fn interest(list: Option<&str>, model: &Model) -> anyhow::Result<Vec<String>> {
    let ids: Vec<&str> = model.terms.iter().map(|t| t.effect.id()).collect();
    words(list.unwrap_or_default())
        .into_iter()
        .map(|name| {
            ids.iter()
                .copied()
                .find(|id| *id == name)
                .map(str::to_owned)
                .with_context(|| {
                    format!(
                        "--of: the model has no effect \"{name}\"; it has: {}",
                        ids.join(", ")
                    )
                })
        })
        .collect()
}

/// Values of an effect's parameters as a campaign has them: fitted with the model and it; none for a scenario.
fn sizes(spec: &Spec, effect: &Arc<dyn AnyEffect>) -> anyhow::Result<Option<Vec<f64>>> {
    if spec.fit.is_none() || spec.model.has(effect.id()) {
        return Ok(None);
    }
    let options = Options {
        cross_validate: false,
    };
    let model = spec.model.with(effect);
    let fit = fit::fit(&spec.campaign, &model, &options, |_| {})?;
    Ok(model
        .term(effect.id())
        .map(|term| term.of(&fit.values).to_vec()))
}
