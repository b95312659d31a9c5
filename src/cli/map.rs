//! `misfit map`.

use super::arguments::{ModelArguments, outcome};
use super::{Outcome, pictures, plan, print, print_json, progress, usage};
use crate::campaign::{Payload, RobotFile, write_atomically};
use crate::compensation::{Reach, Robot};
use crate::fit::{self, Options};
use crate::map::{By, Map, Request, Which, by_model, postures};
use crate::report::run::RunDocument;
use crate::scenario::expect::check_map;
use crate::scenario::mapped::{self, Maps};
use crate::scenario::{Job, Scenario};
use crate::setup::Setup;
use crate::space::Space;
use crate::{recording, report};
use anyhow::Context;
use nalgebra::Vector3;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Map the workspace: how far a load bends the arm, over a slice or a volume.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit map scenarios/map.toml -o out/deflection        by MuJoCo and by a fitted model
  misfit map cell3.toml --load-kg 5 -o deflection        by the model fitted to your campaign
  misfit map cell3.toml --plane xy --at-m 0.8 --error total -o error
  misfit map cell3.toml --plane xyz --points 100000 -o volume

Written with -o STEM: STEM.svg and STEM.png (STEM.plant… and STEM.model… where both tell), every point
as STEM.csv, and as points for the viewer in STEM.mcap.")]
pub struct Arguments {
    /// Scenario (by MuJoCo, unless its [map] says otherwise), or a campaign (by the model fitted to it).
    spec: PathBuf,
    /// Targets, comma-separated; all if left out.
    #[arg(long, value_name = "A,B,…")]
    targets: Option<String>,
    /// Two axes of the base frame for a slice, such as xz, or xyz for a volume.
    #[arg(long, value_name = "AXES")]
    plane: Option<String>,
    /// Where a slice lies on the third axis, m.
    #[arg(long, value_name = "M", allow_hyphen_values = true)]
    at_m: Option<f64>,
    /// Points, about.
    #[arg(long, value_name = "N")]
    points: Option<usize>,
    /// Load, kg; the scenario's last, or the campaign's heaviest if left out.
    #[arg(long, value_name = "KG")]
    load_kg: Option<f64>,
    /// Centre of the load in the target's link, m; that of the load above if left out.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true)]
    com_m: Option<String>,
    /// Of a scenario: who tells.
    #[arg(long, value_enum)]
    by: Option<Teller>,
    /// What the load does, or all that the target is off its nominal place.
    #[arg(long, value_enum)]
    error: Option<Error>,
    /// Hold the orientation of the posture of reference; any will do otherwise.
    #[arg(long)]
    hold_orientation: bool,
    #[command(flatten)]
    model: ModelArguments,
    /// Pictures, table and points to write: STEM.svg, .png, .csv, .mcap; into a folder under the name of what is mapped.
    #[arg(short, long, value_name = "STEM")]
    output: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Teller {
    /// A model fitted to the scenario's campaign.
    Model,
    /// MuJoCo.
    Plant,
    /// One beside the other.
    Both,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Error {
    /// Loaded against not loaded.
    Load,
    /// Loaded against the nominal robot.
    Total,
}

/// `misfit.map/1`.
#[derive(Debug, Serialize)]
struct Document {
    schema: &'static str,
    #[serde(flatten)]
    map: report::map::MapDocument,
}

/// Runs the command.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let com = arguments.com_m.as_deref().map(vector).transpose()?;
    if let Some(mass) = arguments.load_kg
        && !(mass >= 0.0 && mass.is_finite())
    {
        return Err(usage(format!("--load-kg {mass}: accepted: 0 or more")));
    }
    if let Some(output) = &arguments.output {
        let stem = stem(output, &arguments.spec);
        for ending in [".csv", ".mcap", ".svg", ".png"] {
            let path = pictures::with_ending(&stem, ending);
            super::spare(&path, &arguments.spec, &[arguments.model.model.as_deref()])?;
        }
    }
    if plan::is_scenario(&arguments.spec)? {
        if arguments.model.is_given() {
            return Err(usage(
                "--effects and --model go with a campaign; a scenario names its model in [map] model",
            ));
        }
        let scenario = Scenario::load(&arguments.spec)?;
        let mut wanted = match &scenario.job {
            Job::Map(wanted) => wanted.clone(),
            _ => Request::default(),
        };
        adjust(arguments, &mut wanted);
        // the campaign that a model is fitted to keeps its own loads
        let mut load = match (arguments.load_kg, com) {
            (Some(mass), Some(com)) => Payload { mass, com },
            _ => mapped::last_load(&scenario)?,
        };
        load.mass = arguments.load_kg.unwrap_or(load.mass);
        load.com = com.unwrap_or(load.com);
        let maps = draw(&scenario, &wanted, load)?;
        let file = (&scenario.setup, &scenario.robot_file);
        let space = &scenario.design.space;
        return finish(arguments, file, space, &wanted, &maps);
    }
    if arguments.by.is_some_and(|by| by != Teller::Model) {
        return Err(usage("--by: a campaign has no plant; accepted: model"));
    }
    let campaign = super::open_and_say(&arguments.spec)?.campaign;
    let mut wanted = Request::default();
    adjust(arguments, &mut wanted);
    let spinner = progress::spinner();
    spinner.set_message("fitting");
    let model = arguments.model.model(&campaign)?;
    let setup = &model.setup;
    wanted.check(setup).map_err(|what| anyhow::anyhow!(what))?;
    let options = Options {
        cross_validate: false,
    };
    let found = fit::fit(&campaign, &model, &options, |_| {})?;
    let robot = Robot::new(&model, &found.values);
    let payloads = campaign.readings.iter().filter_map(|r| r.payload);
    let heaviest = payloads.max_by(|a, b| a.mass.total_cmp(&b.mass));
    let mut load = heaviest.unwrap_or(Payload {
        mass: 0.0,
        com: Vector3::zeros(),
    });
    load.mass = arguments.load_kg.unwrap_or(load.mass);
    load.com = com.unwrap_or(load.com);
    if load.mass == 0.0 && wanted.error == Which::Load {
        anyhow::bail!(
            "{}: the load is 0 kg{}: there is no deflection; accepted: --load-kg above 0, or --error total",
            arguments.spec.display(),
            match (arguments.load_kg, heaviest) {
                (None, None) => ", as no reading has a payload",
                _ => "",
            }
        );
    }
    let space = Space::within_limits(&campaign.robot, 0.0);
    spinner.set_message("mapping");
    let maps = of_model(&robot, &wanted, &space, load)?;
    spinner.finish_and_clear();
    finish(
        arguments,
        (setup, &campaign.robot_file),
        &space,
        &wanted,
        &maps,
    )?;
    Ok(outcome(&found))
}

/// What the command line says besides.
fn adjust(arguments: &Arguments, wanted: &mut Request) {
    if let Some(list) = &arguments.targets {
        wanted.targets = Some(plan::words(list).into_iter().map(str::to_owned).collect());
    }
    if let Some(plane) = &arguments.plane {
        wanted.plane = Some(plane.clone());
        // another slice lies elsewhere
        wanted.at_m = None;
        wanted.range_m = None;
    }
    wanted.at_m = arguments.at_m.or(wanted.at_m);
    wanted.points = arguments.points.or(wanted.points);
    match arguments.by {
        Some(Teller::Model) => wanted.by = Some(vec![By::Model]),
        Some(Teller::Plant) => wanted.by = Some(vec![By::Plant]),
        Some(Teller::Both) => wanted.by = Some(vec![By::Plant, By::Model]),
        None => {}
    }
    match arguments.error {
        Some(Error::Load) => wanted.error = Which::Load,
        Some(Error::Total) => wanted.error = Which::Total,
        None => {}
    }
    wanted.hold_orientation |= arguments.hold_orientation;
}

fn vector(text: &str) -> anyhow::Result<Vector3<f64>> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|x| x.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) if [x, y, z].iter().all(|x| x.is_finite()) => Ok(Vector3::new(x, y, z)),
        _ => Err(usage(format!(
            "--com-m {text}: accepted: three numbers in m, such as 0,0,0.05"
        ))),
    }
}

/// By the model alone.
fn of_model(
    robot: &Robot<'_>,
    wanted: &Request,
    space: &Space,
    load: Payload,
) -> anyhow::Result<Maps> {
    let setup = &robot.model.setup;
    let told = |what: String| anyhow::anyhow!(what);
    let posture = wanted.posture(setup, space);
    let mut maps = Vec::new();
    for target in wanted.targets(setup).map_err(told)? {
        let reach = Reach {
            moving: setup.robot.chain(setup.target_body(target)),
            ranges: space.ranges.clone(),
        };
        let grid = wanted.grid(setup, target, &posture, &reach).map_err(told)?;
        let hold = (&reach, wanted.hold_orientation);
        let found = postures(robot, target, &grid, &posture, hold);
        maps.push(Map {
            target,
            off: by_model(robot, target, &found, &load, wanted.error),
            grid,
            postures: found,
            by: By::Model,
        });
    }
    Ok(Maps {
        maps,
        stiffness: vec![(By::Model, robot.stiffness())],
        load,
    })
}

/// By whom the scenario says.
fn draw(scenario: &Scenario, wanted: &Request, load: Payload) -> anyhow::Result<Maps> {
    let spinner = progress::spinner();
    spinner.set_message("mapping");
    let maps = mapped::map(scenario, wanted, load, || {})?;
    spinner.finish_and_clear();
    Ok(maps)
}

/// Writes and prints.
fn finish(
    arguments: &Arguments,
    (setup, file): (&Setup, &RobotFile),
    space: &Space,
    wanted: &Request,
    maps: &Maps,
) -> anyhow::Result<Outcome> {
    let mut said = String::new();
    if let Some(output) = &arguments.output {
        let stem = stem(output, &arguments.spec);
        said = keep(&stem, (setup, file), space, wanted, maps)?;
    } else {
        said += "next     the same with -o STEM draws it: STEM.png, .svg, .csv, .mcap\n";
    }
    if arguments.json {
        print_json(&Document {
            schema: "misfit.map/1",
            map: report::map::document(setup, wanted, maps),
        })?;
    } else {
        print(&(report::map::text(setup, wanted, maps) + &said))?;
    }
    Ok(Outcome::Done)
}

/// Where the files go: a folder takes them under the name of what is mapped, an ending of theirs is left out.
fn stem(output: &Path, spec: &Path) -> PathBuf {
    let text = output.as_os_str().to_string_lossy();
    if output.is_dir() || text.ends_with(std::path::MAIN_SEPARATOR) {
        return output.join(spec.file_stem().unwrap_or_default());
    }
    match output.extension().and_then(|ending| ending.to_str()) {
        Some("svg" | "png" | "csv" | "mcap") => output.with_extension(""),
        _ => output.to_owned(),
    }
}

/// Pictures, table and points.
fn keep(
    stem: &Path,
    (setup, file): (&Setup, &RobotFile),
    space: &Space,
    wanted: &Request,
    maps: &Maps,
) -> anyhow::Result<String> {
    let with = |ending: &str| pictures::with_ending(stem, ending);
    let figures = report::map::figures(setup, &setup.robot.name, wanted, maps);
    let alone = figures.len() == 1;
    let mut names = Vec::new();
    for (by, figure) in &figures {
        let own = if alone {
            stem.to_owned()
        } else {
            with(&format!(".{by}"))
        };
        pictures::write(&own, figure)?;
        names.push(format!("{}.svg, .png", own.display()));
    }
    let path = with(".csv");
    write_atomically(&path, |out| report::map::write_csv(setup, &maps.maps, out))
        .with_context(|| format!("{}: cannot be written", path.display()))?;
    let clouds = report::map::clouds(setup, &maps.maps);
    let posture = wanted.posture(setup, space);
    let robot = (&setup.robot, file);
    recording::write_clouds(
        robot,
        &posture,
        &clouds,
        &with(".mcap"),
        &Default::default(),
    )?;
    names.push(format!("{}.csv, .mcap", stem.display()));
    Ok(format!(
        "{}\n",
        report::format::wrap(&format!("wrote    {}", names.join(" · ")), 9)
    ))
}

/// A scenario's maps with what it expects of them.
pub(super) fn of_scenario(
    scenario: &Scenario,
    wanted: &Request,
    folder: Option<&Path>,
) -> anyhow::Result<(RunDocument, String)> {
    let maps = draw(scenario, wanted, mapped::last_load(scenario)?)?;
    let setup = &scenario.setup;
    let mut kept = String::new();
    if let Some(folder) = folder {
        let stem = folder.join(format!("{}.map", scenario.name));
        let file = (setup, &scenario.robot_file);
        kept = keep(&stem, file, &scenario.design.space, wanted, &maps)? + "\n";
    }
    let checks = check_map(&scenario.expect, setup, &maps);
    let text = format!(
        "{}\n{}\n{kept}{}",
        report::run::title(scenario),
        report::map::text(setup, wanted, &maps),
        report::run::checks(&checks)
    );
    let document = RunDocument {
        map: Some(report::map::document(setup, wanted, &maps)),
        ..RunDocument::new(scenario, checks)
    };
    Ok((document, text))
}
