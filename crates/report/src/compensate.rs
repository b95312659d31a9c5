//! Corrected commands on the terminal, and as JSON.

use super::format::{angle, count, length, number, render, say, table, wrap};
use misfit_campaign::{Campaign, Reading};
use misfit_core::compensation::{Corrected, End};
use misfit_core::fit::Fit;
use nalgebra::Vector6;
use serde::Serialize;
use std::fmt::Write;

/// Rows shown on a terminal; the file holds all.
const SHOWN: usize = 40;

/// `misfit.compensate/1`.
#[derive(Debug, Serialize)]
pub struct Document {
    schema: &'static str,
    campaign: String,
    robot: String,
    effects: Vec<String>,
    converged: bool,
    /// Of the readings that the model was fitted to, m.
    position_rms_m: f64,
    tasks: Vec<TaskDocument>,
}

#[derive(Debug, Serialize)]
struct TaskDocument {
    line: usize,
    pose: Option<String>,
    target: String,
    status: &'static str,
    joints: Vec<JointDocument>,
    before: MissDocument,
    after: MissDocument,
    std: Option<MissDocument>,
    overloaded: Vec<OverloadDocument>,
    unseen: Option<String>,
}

#[derive(Debug, Serialize)]
struct JointDocument {
    joint: String,
    /// rad (m).
    command: f64,
    /// rad (m).
    nominal: f64,
}

#[derive(Debug, Serialize)]
struct MissDocument {
    position_m: f64,
    /// None where any orientation will do.
    orientation_rad: Option<f64>,
}

#[derive(Debug, Serialize)]
struct OverloadDocument {
    joint: String,
    /// N·m (N).
    torque: f64,
    /// N·m (N).
    rating: f64,
}

/// The document.
pub fn document(
    campaign: &Campaign,
    fit: &Fit,
    tasks: &[Reading],
    corrected: &[Corrected],
) -> Document {
    let joint = |index: usize| campaign.robot.joints[index].name.clone();
    let tasks = tasks.iter().zip(corrected).map(|(task, c)| TaskDocument {
        line: task.line,
        pose: task.pose.clone(),
        target: campaign.targets[task.target].name.clone(),
        status: status(c),
        joints: (0..c.command.joints.len())
            .map(|index| JointDocument {
                joint: joint(index),
                command: c.command.joints[index],
                nominal: c.nominal.joints[index],
            })
            .collect(),
        before: miss(task, &c.before),
        after: miss(task, &c.command.left),
        std: c
            .deviation()
            .map(|(position_m, orientation_rad)| MissDocument {
                position_m,
                orientation_rad: task.orientation.map(|_| orientation_rad),
            }),
        overloaded: c
            .overloaded
            .iter()
            .map(|&(index, torque, rating)| OverloadDocument {
                joint: joint(index),
                torque,
                rating,
            })
            .collect(),
        unseen: c.unseen.as_ref().map(|(name, _)| name.clone()),
    });
    Document {
        schema: "misfit.compensate/1",
        campaign: campaign.name.clone(),
        robot: campaign.robot.name.clone(),
        effects: fit
            .model
            .terms
            .iter()
            .map(|t| t.effect.id().to_owned())
            .collect(),
        converged: fit.converged,
        position_rms_m: fit.fit.position_rms_m,
        tasks: tasks.collect(),
    }
}

fn miss(task: &Reading, twist: &Vector6<f64>) -> MissDocument {
    MissDocument {
        position_m: twist.fixed_rows::<3>(0).norm(),
        orientation_rad: task.orientation.map(|_| twist.fixed_rows::<3>(3).norm()),
    }
}

/// One word for what became of a task.
pub fn status(corrected: &Corrected) -> &'static str {
    match &corrected.command.end {
        End::Reached if corrected.is_uncertain() => "uncertain",
        End::Reached => "corrected",
        End::AtLimit(_) => "at_limit",
        End::OutOfReach => "out_of_reach",
        End::Collapsed => "collapsed",
        End::Forbidden => "forbidden",
    }
}

/// What a user reads; `written` names the file with the commands, if there is one.
pub fn text(
    campaign: &Campaign,
    tasks: &[Reading],
    corrected: &[Corrected],
    ground: &str,
    written: Option<&str>,
) -> String {
    let mut out = format!(
        "{} · robot {} · {}\n{}\n\n",
        campaign.name,
        campaign.robot.name,
        count(tasks.len(), "task"),
        wrap(&format!("model    {ground}"), 9),
    );
    out += &task_table(campaign, tasks, corrected);
    out.push('\n');
    if tasks.len() > SHOWN {
        let _ = writeln!(out, "  … and {} more", tasks.len() - SHOWN);
    }
    out.push('\n');
    let reached = corrected.iter().filter(|c| c.command.end == End::Reached);
    let reached = format!(
        "reached  {} of {}, as the model has it; before is what the nominal robot's commands would miss",
        reached.count(),
        tasks.len()
    );
    say(&mut out, &reached);
    for (task, c) in tasks.iter().zip(corrected) {
        for remark in remarks(campaign, task, c) {
            say(&mut out, &remark);
        }
    }
    match written {
        Some(file) => say(&mut out, &format!("\nwrote    {file}")),
        None => say(
            &mut out,
            "\nnext     the same with -o commands.csv writes the commands",
        ),
    }
    out
}

fn task_table(campaign: &Campaign, tasks: &[Reading], corrected: &[Corrected]) -> String {
    let header = [
        "pose", "target", "before", "left", "±1 σ", "turned", "left", "±1 σ", "status",
    ];
    let mut rows = table(&header, &[2, 3, 4, 5, 6, 7]);
    for (task, c) in tasks.iter().zip(corrected).take(SHOWN) {
        let (before, left) = (miss(task, &c.before), miss(task, &c.command.left));
        let turned = |angle_: Option<f64>| angle_.map_or("—".to_owned(), angle);
        let deviation = c.deviation();
        rows.add_row(vec![
            task.pose
                .clone()
                .unwrap_or_else(|| format!("line {}", task.line)),
            campaign.targets[task.target].name.clone(),
            length(before.position_m),
            length(left.position_m),
            deviation.map_or("—".to_owned(), |d| length(d.0)),
            turned(before.orientation_rad),
            turned(left.orientation_rad),
            turned(
                deviation
                    .filter(|_| task.orientation.is_some())
                    .map(|d| d.1),
            ),
            status(c).replace('_', " "),
        ]);
    }
    render(&rows)
}

/// What a user has to know of one task.
fn remarks(campaign: &Campaign, task: &Reading, c: &Corrected) -> Vec<String> {
    let mut lines = Vec::new();
    let label = match &task.pose {
        Some(pose) => format!("pose {pose} (line {})", task.line),
        None => format!("line {}", task.line),
    };
    let name = |joint: usize| campaign.robot.joints[joint].name.as_str();
    match &c.command.end {
        End::AtLimit(joints) => {
            let joints: Vec<&str> = joints.iter().map(|&j| name(j)).collect();
            lines.push(format!(
                "limit    {label}: {} would have to go beyond its limit",
                joints.join(", ")
            ));
        }
        End::OutOfReach => lines.push(format!(
            "far      {label}: out of reach, or the arm is singular there"
        )),
        End::Collapsed => lines.push(format!(
            "load     {label}: the arm does not hold this load in the model"
        )),
        End::Forbidden => lines.push(format!(
            "limits   {label}: only in a posture outside of the joints' limits or those of --limits"
        )),
        End::Reached => {}
    }
    for &(joint, torque, rating) in &c.overloaded {
        lines.push(format!(
            "load     {label}: {} bears {} N·m, rated {}",
            name(joint),
            number(torque),
            number(rating)
        ));
    }
    if c.is_uncertain() {
        let most = c.unseen.as_ref().map_or_else(String::new, |(what, moved)| {
            format!(
                "; the campaign never saw {what}, a typical one moves this pose by {}",
                length(*moved)
            )
        });
        lines.push(format!(
            "unsure   {label}: what is left is as uncertain as what is corrected{most}"
        ));
    }
    lines
}
