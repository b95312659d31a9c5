//! What was exported, on the terminal.

mod document;

use super::fit::{model_line, title};
use super::format::{angle, count, length, render, say, table, wrap};
use misfit_arm::robot::JointKind;
use misfit_campaign::Campaign;
use misfit_core::effects::Role;
use misfit_core::export::{Calibrated, dh, position_error, urdf};
use misfit_core::fit::{Fit, Status};
use nalgebra::Isometry3;
use std::fmt::Write;

pub use document::{Document, document};

/// What is exported.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The campaign.
    pub campaign: &'a Campaign,
    /// The model fitted to it.
    pub fit: &'a Fit,
    /// What of that is a rigid robot.
    pub calibrated: &'a Calibrated,
}

/// What became of it.
pub enum Made {
    /// A URDF.
    Urdf(urdf::Written),
    /// A DH table.
    Table(Box<dh::Written>),
    /// All numbers.
    Json,
}

/// A comment for the head of a file: where it is from, and what is in it.
pub fn note(campaign: &Campaign, fit: &Fit, calibrated: &Calibrated) -> String {
    let mut note = format!(
        "calibrated by misfit export from {}, {}; in it: {}",
        campaign.name,
        count(fit.readings.0, "reading"),
        list(&calibrated.held, "nothing"),
    );
    let out = left_out(calibrated);
    if !out.is_empty() {
        let _ = write!(note, "; left out: {}", list(&out, ""));
    }
    if !fit.converged {
        note += "; the fit had NOT converged";
    }
    note
}

fn left_out(calibrated: &Calibrated) -> Vec<String> {
    let left_out = calibrated.left_out.iter();
    left_out.map(|out| out.effect.clone()).collect()
}

fn list(words: &[String], none: &str) -> String {
    if words.is_empty() {
        none.to_owned()
    } else {
        words.join(", ")
    }
}

/// What a user reads; `same` is the campaign and the model as words of a command line.
pub fn text(
    subject: &Subject<'_>,
    file: &str,
    made: &Made,
    same: &str,
    rigid: Option<&Rigid>,
) -> String {
    let Subject {
        campaign,
        fit,
        calibrated,
    } = subject;
    let mut out = format!("{}\n{}\n\n", title(campaign, fit), model_line(fit));
    match made {
        Made::Urdf(_) | Made::Json => out += &joints(calibrated),
        Made::Table(made) => out += &rows(made),
    }
    out.push('\n');
    for line in contents(calibrated, made) {
        say(&mut out, &line);
    }
    for target in unturned(fit, calibrated) {
        let line = format!(
            "note     {target}: no reading has its orientation; its frame is turned as its link's"
        );
        say(&mut out, &line);
    }
    out += &left(subject, made, rigid);
    if !fit.converged {
        let line = format!(
            "\nNOT CONVERGED after {}: the numbers are where the fit stopped",
            count(fit.iterations, "step")
        );
        say(&mut out, &line);
    }
    say(&mut out, &format!("\nwrote    {file}"));
    if !calibrated.left_out.is_empty() {
        let line = format!("\nnext     misfit compensate {same} --tasks poses.csv -o commands.csv");
        say(&mut out, &line);
    }
    out
}

/// What the file holds, how far off it is when read back, and what of it was made up.
fn contents(calibrated: &Calibrated, made: &Made) -> Vec<String> {
    let held = list(&calibrated.held, "nothing: every number is nominal");
    let mut lines = vec![match made {
        Made::Json => format!("rigid    {held}"),
        _ => format!("in it    {held}"),
    }];
    if !calibrated.of_measurement.is_empty() {
        lines.push(format!(
            "besides  {}: of the measurement, no robot's; left out",
            calibrated.of_measurement.join(", ")
        ));
    }
    let read_back = |(position, turn): (f64, f64)| {
        format!(
            "read back and compared with the model at {} random postures without load: off by {}, {}",
            misfit_core::export::POSTURES,
            length(position),
            angle(turn)
        )
    };
    match made {
        Made::Urdf(made) => {
            lines.push(format!("checked  {}", read_back(made.gap)));
            if !made.added.is_empty() {
                lines.push(format!("new      links {}", made.added.join(", ")));
            }
            if made.made_up_inertias {
                lines.push(
                    "note     masses are as identified or in the robot file, but their inertias are not known: \
                     those of small balls stand there"
                        .to_owned(),
                );
            }
            if made.relative_meshes > 0 {
                let which = match made.relative_meshes {
                    1 => "a mesh is".to_owned(),
                    n => format!("{n} meshes are"),
                };
                lines.push(format!(
                    "note     {which} named relative to the file: keep it where the robot's own is"
                ));
            }
        }
        Made::Table(made) => {
            lines.push(format!("checked  {}", read_back(made.gap)));
            lines.extend(remarks(made));
        }
        Made::Json => {}
    }
    lines
}

/// How the frames of a rigid robot differ from the nominal ones.
fn joints(calibrated: &Calibrated) -> String {
    let header = ["joint", "zero off by", "behind it moved", "turned", "mass"];
    let mut rows = table(&header, &[1, 2, 3, 4]);
    let robot = &calibrated.setup.robot;
    for (index, joint) in robot.joints.iter().enumerate() {
        let (offset, motion) = (calibrated.offsets[index], &calibrated.motions[index + 1]);
        let mass = calibrated.masses[index + 1];
        let dash = || "—".to_owned();
        let is_off = offset != 0.0;
        let is_moved = *motion != Isometry3::identity();
        if !is_off && !is_moved && mass == 0.0 {
            continue;
        }
        rows.add_row(vec![
            joint.name.clone(),
            match (is_off, joint.kind) {
                (false, _) => dash(),
                (_, JointKind::Prismatic) => length(offset),
                _ => angle(offset),
            },
            if is_moved {
                length(motion.translation.vector.norm())
            } else {
                dash()
            },
            if is_moved {
                angle(2.0 * motion.rotation.imag().norm().asin())
            } else {
                dash()
            },
            if mass != 0.0 {
                format!("{mass:+.3} kg")
            } else {
                dash()
            },
        ]);
    }
    if rows.row_count() == 0 {
        return " every joint is nominal\n".to_owned();
    }
    render(&rows) + "\n"
}

/// The table, and what is different from the nominal one.
fn rows(made: &dh::Written) -> String {
    let has_fifth = !made.corrected.fifths().is_empty();
    let mut header = vec!["joint", "alpha °", "mrad", "a mm", "mm"];
    if has_fifth {
        header.push("beta °");
    }
    header.extend(["theta °", "mrad", "d mm", "mm"]);
    let right: Vec<usize> = (1..header.len()).collect();
    let mut rows = table(&header, &right);
    for (new, old) in made.corrected.rows.iter().zip(&made.nominal.rows) {
        let mut cells = vec![
            new.joint.name.clone(),
            fixed(new.alpha.to_degrees()),
            signed((new.alpha - old.alpha) * 1e3),
            fixed(new.a * 1e3),
            signed((new.a - old.a) * 1e3),
        ];
        if has_fifth {
            cells.push(match new.beta {
                0.0 => "—".to_owned(),
                beta => fixed(beta.to_degrees()),
            });
        }
        cells.extend([
            fixed(new.theta.to_degrees()),
            signed((new.theta - old.theta) * 1e3),
            fixed(new.d * 1e3),
            signed((new.d - old.d) * 1e3),
        ]);
        rows.add_row(cells);
    }
    let mut out = render(&rows) + "\n";
    for (name, new, old) in [
        ("base", &made.corrected.base, &made.nominal.base),
        ("tool", &made.corrected.tool, &made.nominal.tool),
    ] {
        let moved = (new.translation.vector - old.translation.vector).norm();
        let turned = 2.0
            * (old.rotation.inverse() * new.rotation)
                .imag()
                .norm()
                .min(1.0)
                .asin();
        // less is rounding
        let _ = if moved < 1e-12 && turned < 1e-12 {
            writeln!(out, "  [{name}] as nominal")
        } else {
            let (moved, turned) = (length(moved), angle(turned));
            writeln!(out, "  [{name}] moved by {moved}, turned by {turned}")
        };
    }
    out
}

/// Four decimals; no zero has a sign.
fn fixed(value: f64) -> String {
    let text = format!("{value:.4}");
    match text.as_str() {
        "-0.0000" => "0.0000".to_owned(),
        _ => text,
    }
}

fn signed(value: f64) -> String {
    let text = format!("{value:+.4}");
    match text.as_str() {
        "-0.0000" | "+0.0000" => "0".to_owned(),
        _ => text,
    }
}

fn remarks(made: &dh::Written) -> Vec<String> {
    let mut lines = Vec::new();
    let convention = if made.corrected.modified {
        "modified (Craig)"
    } else {
        "standard"
    };
    let fifths = made.corrected.fifths();
    if fifths.is_empty() {
        lines.push(format!("form     {convention}, four numbers a row"));
    } else {
        let (row, has) = match fifths[..] {
            [_] => ("row", "has"),
            _ => ("rows", "have"),
        };
        lines.push(format!(
            "form     {convention}; {row} {} {has} a fifth number, beta (Hayati): axes nearly parallel; \
             --four-numbers for a controller that takes no fifth",
            fifths.join(", ")
        ));
    }
    let far = made.corrected.far_from(&made.nominal);
    if !far.is_empty() {
        lines.push(format!(
            "note     {} far from nominal: axes nearly parallel or coaxial have their common normal anywhere; \
             the table is exact all the same",
            far.join(", ")
        ));
    }
    if made.others > 0 {
        lines.push(format!(
            "note     {} of the robot are on another arm and not in this table",
            count(made.others, "joint")
        ));
    }
    lines.push(
        "note     shapes and inertias are not in a DH table; where tracker and target are stands in its comments"
            .to_owned(),
    );
    lines
}

/// Targets with a place on their link but without a turn.
fn unturned(fit: &Fit, calibrated: &Calibrated) -> Vec<String> {
    let Some(term) = fit.model.term_of(Role::TargetFrame) else {
        return Vec::new();
    };
    let targets = calibrated.setup.targets.iter().enumerate();
    let names = targets.filter(|(target, _)| {
        let turn = term.first + 6 * target + 3..term.first + 6 * target + 6;
        turn.clone().all(|k| fit.status[k] == Status::Unobservable)
    });
    names.map(|(_, target)| target.name.clone()).collect()
}

/// What the file does not hold, and what that costs.
fn left(subject: &Subject<'_>, made: &Made, rigid: Option<&Rigid>) -> String {
    let Subject {
        campaign,
        fit,
        calibrated,
    } = subject;
    let mut out = String::new();
    let form = match made {
        Made::Urdf(_) => "not in a URDF",
        Made::Table(_) => "not in a table",
        Made::Json => "not rigid",
    };
    let readings = &campaign.readings;
    if calibrated.left_out.is_empty() {
        let _ = writeln!(
            out,
            "\nThe whole model is in it: it leaves {} rms of the readings' positions.",
            length(position_error(&fit.model, &fit.values, readings))
        );
        return out;
    }
    let header = [form, "moves the readings, rms", "at most"];
    let mut rows = table(&header, &[1, 2]);
    for effect in &calibrated.left_out {
        rows.add_row(vec![
            effect.effect.clone(),
            length(effect.rms),
            length(effect.most),
        ]);
    }
    let _ = writeln!(out, "\n{}\n", render(&rows));
    let sentence = format!(
        "Of the readings' positions, {} leaves {} rms, the whole model {}: `misfit compensate` corrects commands \
         for the rest.",
        match made {
            Made::Json => "what is rigid",
            _ => "the file alone",
        },
        length(position_error(&fit.model, &calibrated.values, readings)),
        length(position_error(&fit.model, &fit.values, readings))
    );
    let _ = writeln!(out, "{}", wrap(&sentence, 0));
    if let Some(rigid) = rigid {
        let file = position_error(&fit.model, &calibrated.values, readings);
        let sentence = format!(
            "The nominal robot leaves {}; a fit of nothing but what a file can hold ({}) leaves {}.",
            length(rigid.nominal),
            if rigid.effects.is_empty() {
                "frames"
            } else {
                &rigid.effects
            },
            length(rigid.own)
        );
        let _ = writeln!(out, "{}", wrap(&sentence, 0));
        if file > rigid.nominal {
            let _ = writeln!(
                out,
                "{}",
                wrap(
                    "WARNING  without the rest of the model this file is worse than the nominal robot.",
                    9
                )
            );
        }
        // a tenth is worth another file
        if file > 1.1 * rigid.own {
            let words = match &rigid.effects[..] {
                "" => "\"\"",
                effects => effects,
            };
            let sentence = format!(
                "better   alone, without `misfit compensate`, is the file of that fit: --effects {words}"
            );
            let _ = writeln!(out, "{}", wrap(&sentence, 9));
        }
    }
    out
}

/// What robots that a file can hold leave of the readings' positions, rms, m.
#[derive(Debug, Clone, PartialEq)]
pub struct Rigid {
    /// The nominal one, standing where the readings say.
    pub nominal: f64,
    /// The best one.
    pub own: f64,
    /// Its effects, as for `--effects`.
    pub effects: String,
}
