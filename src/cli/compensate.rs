//! `misfit compensate`.

use super::arguments::{ModelArguments, outcome};
use super::{Outcome, print, print_json, progress, usage};
use crate::campaign::{Reading, Tasks, read_tasks, render_commands, write_atomically};
use crate::compensation::{Corrected, End, Reach, Robot, correct, posture};
use crate::fit::{self, Options};
use crate::model::{Model, Workspace};
use crate::plan::Limits;
use crate::recording::{Beside, Holds, write_campaign};
use crate::report;
use crate::space::{Space, generator};
use anyhow::Context;
use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Correct commands, so that under load the robot arrives at its poses: everything fitted is compensated.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  misfit compensate cell3.toml --tasks poses.csv -o commands.csv
  misfit compensate cell3.toml --tasks poses.csv --effects +backlash
  misfit compensate cell3.toml --tasks poses.csv --frame base --hold torso

The table of tasks has the columns of a campaign's: x_mm y_mm z_mm qw qx qy qz is the pose wanted of
the target (without qw … any orientation will do), payload_kg … the load, approach_<joint> where the
joints come from, <joint>_deg the posture to stay near. fx_N … is the load's wrench, or beside a
payload what pulls besides its weight.")]
pub struct Arguments {
    /// Campaign that the model is fitted to: a .toml file with its table, or a .mcap recording.
    campaign: PathBuf,
    /// Table of tasks: wanted poses and loads.
    #[arg(long, value_name = "TASKS.csv")]
    tasks: PathBuf,
    #[command(flatten)]
    model: ModelArguments,
    /// Frame in which the poses are given.
    #[arg(long, value_enum, default_value_t = Given::Tracker)]
    frame: Given,
    /// Joints that stay where the tasks have them.
    #[arg(long, value_name = "A,B,…")]
    hold: Option<String>,
    /// Limits file: joint ranges and fixed joints, as for `misfit plan`.
    #[arg(long, value_name = "LIMITS.toml")]
    limits: Option<PathBuf>,
    /// Commands to write: a .csv table or a .mcap recording.
    #[arg(short, long, value_name = "FILE", value_parser = output_path)]
    output: Option<PathBuf>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    despite: super::Despite,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum Given {
    /// The tracker's, as readings are.
    Tracker,
    /// The robot's base, standing where the fit finds it.
    Base,
}

/// Refuses tasks that do not say what an effect of the model goes by, and poses out of this world.
fn told(file: &Path, tasks: &[Reading], model: &Model) -> anyhow::Result<()> {
    /// Further away than any tracker sees, m.
    const FURTHEST: f64 = 1000.0;
    for task in tasks {
        if task.position.amax() > FURTHEST {
            anyhow::bail!(
                "{}, line {}: a pose {:e} m away; accepted: up to {FURTHEST} m along each axis",
                file.display(),
                task.line,
                task.position.amax()
            );
        }
        for term in &model.terms {
            let idle = term.parameters.iter().all(|p| !p.vary && p.value == 0.0);
            let mut needs = term.effect.needs().iter();
            if let Some(need) = needs.find(|need| !idle && !need.is_said(task)) {
                anyhow::bail!(
                    "{}, line {}: {} is in the model and {}; this task does not say it",
                    file.display(),
                    task.line,
                    term.effect.id(),
                    need.sentence()
                );
            }
        }
    }
    Ok(())
}

fn output_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("csv" | "mcap") => Ok(path),
        _ => Err("accepted: a path ending in .csv or .mcap".to_owned()),
    }
}

/// Runs the command.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
pub fn run(arguments: &Arguments) -> anyhow::Result<Outcome> {
    let read = [
        Some(arguments.tasks.as_path()),
        arguments.model.model.as_deref(),
        arguments.limits.as_deref(),
    ];
    super::writable(&[arguments.output.as_deref()], &arguments.campaign, &read)?;
    let spinner = progress::spinner();
    let mut opened = super::open_and_say(&arguments.campaign)?;
    opened.refuse(&arguments.despite)?;
    let campaign = opened.campaign.clone();
    let Tasks {
        readings: mut tasks,
        has_joints: named,
        warnings,
    } = read_tasks(&arguments.tasks, &campaign)?;
    let model = arguments.model.model(&campaign)?;
    let robot_joints = &campaign.robot.joints;
    let mut held = Vec::new();
    for word in arguments.hold.iter().flat_map(|list| list.split(',')) {
        let known = || {
            robot_joints
                .iter()
                .map(|j| j.name.as_str())
                .collect::<Vec<_>>()
        };
        let joint = robot_joints
            .iter()
            .position(|joint| joint.name == word.trim());
        held.push(joint.ok_or_else(|| {
            usage(format!(
                "--hold {word}: no such joint; accepted: {}",
                known().join(", ")
            ))
        })?);
    }
    let mut space = Space::within_limits(&campaign.robot, 0.0);
    space.least_height = f64::NEG_INFINITY;
    let own = space.ranges.clone();
    if let Some(path) = &arguments.limits {
        Limits::load(path, &campaign.robot, &mut space)?;
    }
    told(&arguments.tasks, &tasks, &model)?;
    for (joint, (least, most)) in space.ranges.iter().enumerate() {
        // a joint that the limits fix stands there, whatever the table says
        if least == most && own[joint] != (*least, *most) {
            tasks
                .iter_mut()
                .for_each(|task| task.joints[joint] = *least);
        }
    }
    spinner.set_message("fitting");
    let options = Options {
        cross_validate: false,
    };
    let found = fit::fit(&campaign, &model, &options, |_| {})?;
    opened.add(&found);
    opened.refuse(&arguments.despite)?;
    let robot = Robot::new(&model, &found.values);
    if arguments.frame == Given::Base {
        let tracker_from_base = robot.base_from_tracker().inverse();
        for task in &mut tasks {
            let turn = task.orientation.unwrap_or_else(UnitQuaternion::identity);
            let pose =
                tracker_from_base * Isometry3::from_parts(Translation3::from(task.position), turn);
            task.position = pose.translation.vector;
            task.orientation = task.orientation.map(|_| pose.rotation);
        }
    }
    spinner.set_message("correcting");
    let corrected: Vec<Corrected> = tasks
        .par_iter_mut()
        .enumerate()
        .map(|(index, task)| {
            let mut workspace = Workspace::new(&model.setup);
            let chain = model
                .setup
                .robot
                .chain(model.setup.target_body(task.target));
            let moving = chain.into_iter().filter(|joint| {
                !held.contains(joint) && space.ranges[*joint].0 < space.ranges[*joint].1
            });
            let reach = Reach {
                moving: moving.collect(),
                ranges: space.ranges.clone(),
            };
            if !named {
                let mut random = generator(1, index as u128);
                task.joints = posture(&mut workspace, &robot, task, (&space, &reach), &mut random);
            }
            let mut corrected = correct(&mut workspace, &robot, Some(&found), task, &reach);
            let there = &corrected.command.joints;
            if corrected.command.end == End::Reached && !space.allows(&model.setup, there) {
                corrected.command.end = End::Forbidden;
            }
            corrected
        })
        .collect();
    spinner.finish_and_clear();
    let mut written = None;
    if let Some(path) = &arguments.output {
        // only what arrives: a robot must not be sent anywhere else
        let readings = tasks
            .iter()
            .zip(&corrected)
            .filter(|(_, c)| c.command.end == End::Reached);
        let mut commands = campaign.clone();
        commands.readings = readings
            .map(|(task, c)| Reading {
                joints: c.command.joints.clone(),
                ..task.clone()
            })
            .collect();
        let count = commands.readings.len();
        let is_recording = path.extension().is_some_and(|ending| ending == "mcap");
        if is_recording && count > 0 {
            let metadata = [("misfit".to_owned(), env!("CARGO_PKG_VERSION").to_owned())];
            let beside = Beside {
                holds: Holds::Commands,
                metadata: metadata.into(),
                ..Beside::default()
            };
            write_campaign(&commands, path, &beside)?;
        } else if !is_recording {
            let bytes = render_commands(&commands)?;
            write_atomically(path, |file| file.write_all(&bytes))
                .with_context(|| format!("{}: cannot be written", path.display()))?;
        }
        written = Some(match is_recording && count == 0 {
            true => format!("{} was not written: no task is reached", path.display()),
            false => format!("{} · {} commands", path.display(), count),
        });
    }
    if arguments.json {
        let document = report::compensate::document(&campaign, &found, &tasks, &corrected);
        print_json(&opened.with(&document))?;
    } else {
        let effects: Vec<&str> = model.terms.iter().map(|t| t.effect.id()).collect();
        let ground = format!(
            "{}, fitted to {} readings, {} rms",
            effects.join(" + "),
            found.readings.0,
            report::format::length(found.fit.position_rms_m)
        );
        let mut text =
            report::compensate::text(&campaign, &tasks, &corrected, &ground, written.as_deref());
        for warning in &warnings {
            text += &format!(
                "{}\n",
                report::format::wrap(&format!("note     {warning}"), 9)
            );
        }
        print(&text)?;
    }
    let all = corrected.iter().all(|c| c.command.end == End::Reached);
    Ok(match all {
        true => outcome(&found),
        false => Outcome::Missed,
    })
}
