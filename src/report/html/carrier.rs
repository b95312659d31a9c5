//! Which variable carries the error, and how an effect fits through it.
//!
//! Of an effect of the model its pull on each reading is computed by leaving it out of the prediction, all other
//! parameters kept. What the last model leaves, plus that pull, is what the readings show of the effect (a component
//! plus residual plot); the pull alone is the fitted effect. Both are shown as an error of the joint that the effect
//! turns, if it does no more than turn one, else along the direction in which it pushes most; against the variable of
//! which the pull is the smoothest function.

use super::{Picture, ReportError, Results, fitted, panel, picture, rms, thinned};
use crate::campaign::{Campaign, Reading};
use crate::diagnosis::{Diagnosis, Verdict, ripple};
use crate::dual_quaternion::rotation_vector;
use crate::fit::alike::Alike;
use crate::fit::{Fit, residuals};
use crate::model::{Rows, Term, Workspace, stacked};
use crate::plot::{Content, Dots, Series};
use crate::report::diagnosis::{p_value, words};
use crate::report::format::number;
use crate::robot::JointKind;
use nalgebra::{DMatrix, Matrix3, Vector3, Vector6};
use std::f64::consts::TAU;

/// What the section shows.
pub(super) struct Section {
    /// What there is, or why there is nothing.
    pub note: String,
    pub plots: Vec<Plot>,
    pub contrasts: Vec<Contrast>,
    /// Is there a column of what the named effects leave?
    pub left: bool,
    /// What the misfit follows, in words.
    pub patterns: Vec<String>,
}

/// An effect, or a pattern without a name.
pub(super) struct Plot {
    pub title: String,
    pub words: String,
    pub pictures: Vec<Picture>,
    pub variable: String,
    pub unit: &'static str,
    /// Is there an effect to be left out?
    pub named: bool,
    pub bins: Vec<Bin>,
}

/// Readings of one stretch of the variable.
pub(super) struct Bin {
    pub range: String,
    pub count: usize,
    pub without: String,
    pub with: String,
}

/// Between what the misfit differs.
pub(super) struct Contrast {
    pub words: &'static str,
    pub before: String,
    pub p_before: String,
    pub after: String,
    pub p_after: String,
}

/// Readings computed and drawn at most.
const MOST: usize = 1000;
/// Effects drawn at most.
const EFFECTS: usize = 3;
/// An effect turns one joint alone if so much of its pull is a turn of it.
const TURNS: f64 = 0.98;
/// A variable carries a pull that jumps by less than this share of what chance would make it jump.
const SMOOTH: f64 = 0.5;
/// A variable must carry it better than one before it in the list by this factor.
const BETTER: f64 = 0.7;
/// Stretches of the variable in the table.
const BINS: usize = 8;
/// Points of a line.
const LINE: usize = 60;
/// A variable is said to carry the misfit below this probability.
const CARRIES: f64 = 1e-4;

/// One reading: what is left, and how it answers each observed joint.
struct Seen {
    left: Vector6<f64>,
    rates: DMatrix<f64>,
    torques: Vec<f64>,
}

/// A variable that may carry an error.
struct Variable {
    /// With its unit.
    name: String,
    values: Vec<f64>,
    decimals: usize,
}

/// Errors as they are shown.
struct Shown {
    words: String,
    /// Of which quantity.
    quantity: String,
    unit: &'static str,
    scale: f64,
    left: Vec<f64>,
    pull: Vec<f64>,
}

pub(super) fn section(campaign: &Campaign, results: &Results<'_>) -> Result<Section, ReportError> {
    let all = fitted(campaign);
    let kept = thinned(all.len(), MOST);
    let readings: Vec<&Reading> = kept.iter().map(|&k| all[k]).collect();
    let mut plots = Vec::new();
    let note;
    match results.diagnosis() {
        Some(diagnosis) if diagnosis.named.is_empty() => {
            let pattern = match diagnosis.verdict {
                Verdict::Unknown => unnamed(diagnosis, &readings)?,
                _ => None,
            };
            note = match (diagnosis.verdict, &pattern) {
                (Verdict::Nothing, _) => "No variable carries the error: what is left is noise, as far as this \
                                          campaign can tell."
                    .to_owned(),
                (_, Some(_)) => "No effect of the catalogue is drawn: none explains it. The line is the mean of the \
                                 points about it."
                    .to_owned(),
                _ => "What carries the error is not a variable of single readings.".to_owned(),
            };
            plots.extend(pattern);
        }
        diagnosis => {
            let fit = results.fit();
            let ids = match diagnosis {
                Some(diagnosis) => diagnosis.named.clone(),
                None => added(fit, results.before()),
            };
            let seen = seen(fit, &readings);
            let mut drawn = Vec::new();
            for term in ids.iter().filter_map(|id| fit.model.term(id)) {
                drawn.push(pull(fit, term, &readings));
            }
            drawn.sort_by(|a, b| b.size.total_cmp(&a.size));
            for pull in drawn.iter().take(EFFECTS).filter(|pull| pull.size > 0.0) {
                let waves = diagnosis.map_or(&[][..], |d| &d.waves);
                plots.push(named(fit, &seen, pull, &readings, waves)?);
            }
            note = match plots.is_empty() {
                true => "The model holds no effect beside frames and geometry that could be drawn.".to_owned(),
                false => "Left: what the readings show if the effect is left out of the model, all other parameters kept, \
                          and the fitted effect through it. Right: what is left with it, on the same scale."
                    .to_owned(),
            };
        }
    }
    let few = match readings.len() < all.len() {
        true => format!(" {} of {} readings are drawn.", readings.len(), all.len()),
        false => String::new(),
    };
    let diagnosis = results.diagnosis();
    Ok(Section {
        note: note + &few,
        plots,
        contrasts: diagnosis.map_or_else(Vec::new, contrasts),
        left: diagnosis.is_some_and(|d| !d.steps.is_empty()),
        patterns: diagnosis.map_or_else(Vec::new, patterns),
    })
}

/// Effects that a fit has and the one before has not; without one before, those beside frames and geometry.
fn added(fit: &Fit, before: Option<&Fit>) -> Vec<String> {
    let usual = ["geometry", "tracker_frame", "target_offset", "joint_offset"];
    let ids = fit.model.terms.iter().map(|term| term.effect.id());
    let new = |id: &&str| !usual.contains(id) && before.is_none_or(|fit| !fit.model.has(id));
    ids.filter(new).map(str::to_owned).collect()
}

fn contrasts(diagnosis: &Diagnosis) -> Vec<Contrast> {
    let row = |contrast: &crate::diagnosis::Contrast| {
        let left = diagnosis
            .contrasts_left
            .iter()
            .find(|c| c.name == contrast.name);
        let ratio = |c: &crate::diagnosis::Contrast| format!("× {}", number(c.ratio.sqrt()));
        Contrast {
            words: words(contrast.name),
            before: ratio(contrast),
            p_before: p_value(contrast.p_value),
            after: left.map_or_else(String::new, ratio),
            p_after: left.map_or_else(String::new, |c| p_value(c.p_value)),
        }
    };
    diagnosis.contrasts.iter().map(row).collect()
}

fn patterns(diagnosis: &Diagnosis) -> Vec<String> {
    let carried = diagnosis.patterns.iter().filter(|p| p.p_value < CARRIES);
    let say = |p: &crate::diagnosis::Pattern| {
        format!(
            "as if there were {}, {} (evidence {:+.0} nats)",
            p.words,
            p_value(p.p_value),
            p.log_evidence
        )
    };
    carried.take(2).map(say).collect()
}

/// Residuals of a fit, and how its readings answer the joints.
fn seen(fit: &Fit, readings: &[&Reading]) -> Vec<Seen> {
    let setup = &fit.model.setup;
    let answers =
        Alike::of(&fit.model, readings).map(&fit.model, readings, |workspace, reading| {
            let mut all = Rows::zeros(setup.robot.joints.len());
            workspace.joint_jacobian(&fit.model, &fit.values, reading, &mut all);
            let mut rates = DMatrix::zeros(6, setup.observed.len());
            for (place, &joint) in setup.observed.iter().enumerate() {
                rates.set_column(place, &all.fixed_view::<6, 1>(0, joint));
            }
            let torques = workspace.joint_torques(&fit.model, &fit.values, reading);
            (rates, torques)
        });
    let left = residuals(&fit.model, &fit.values, readings);
    let both = left.iter().zip(answers);
    both.map(|(row, (rates, torques))| Seen {
        left: row.fixed_rows::<6>(0).into_owned(),
        rates,
        torques,
    })
    .collect()
}

/// What an effect does to each reading.
struct Pull {
    /// Effect.
    id: String,
    /// The joint whose part it is, if the effect has one for each joint, and how many there are.
    part: Option<(String, usize)>,
    /// `[m; rad]` by reading, tracker's frame.
    moves: Vec<Vector6<f64>>,
    /// Root mean square in noise.
    size: f64,
}

/// The pull of an effect; where it acts on several joints, of the joint that matters most.
fn pull(fit: &Fit, term: &Term, readings: &[&Reading]) -> Pull {
    let setup = &fit.model.setup;
    let joint_of = |name: &str| {
        let joints = setup.observed.iter().map(|&j| &setup.robot.joints[j].name);
        let own = |joint: &&String| {
            name == joint.as_str()
                || name
                    .strip_prefix(joint.as_str())
                    .is_some_and(|rest| rest.starts_with('.'))
        };
        joints.filter(own).max_by_key(|joint| joint.len()).cloned()
    };
    let joints: Vec<Option<String>> = term.parameters.iter().map(|p| joint_of(&p.name)).collect();
    let mut parts: Vec<String> = Vec::new();
    for joint in joints.iter().flatten() {
        if !parts.contains(joint) {
            parts.push(joint.clone());
        }
    }
    let whole = joints.iter().any(Option::is_none);
    let groups: Vec<Option<String>> = match whole {
        true => vec![None],
        false => parts.into_iter().map(Some).collect(),
    };
    let alike = Alike::of(&fit.model, readings);
    let predict = |p: &[f64]| {
        alike.map(
            &fit.model,
            readings,
            |workspace: &mut Workspace, reading| workspace.predict(&fit.model, p, reading),
        )
    };
    let with = predict(&fit.values);
    let count = groups.len();
    let of_group = |group: Option<String>| {
        let mut p = fit.values.clone();
        for (offset, joint) in joints.iter().enumerate() {
            if group.is_none() || *joint == group {
                p[term.first + offset] = 0.0;
            }
        }
        let without = predict(&p);
        let pairs = with.iter().zip(&without);
        let moves: Vec<Vector6<f64>> = pairs
            .map(|(with, without)| {
                let turn = with.orientation * without.orientation.inverse();
                let turn = rotation_vector(&turn.into_inner());
                stacked(&(with.position - without.position), &turn)
            })
            .collect();
        let size = rms(moves.iter().map(|row| weighted(fit, row).norm()));
        Pull {
            id: term.effect.id().to_owned(),
            part: group.map(|joint| (joint, count)),
            moves,
            size: if size.is_finite() { size } else { 0.0 },
        }
    };
    let mut best: Option<Pull> = None;
    for group in groups {
        let found = of_group(group);
        if best.as_ref().is_none_or(|best| found.size > best.size) {
            best = Some(found);
        }
    }
    best.unwrap_or_else(|| of_group(None))
}

/// A change of a reading in standard deviations of the noise; orientations only where they are measured.
fn weighted(fit: &Fit, row: &Vector6<f64>) -> Vector6<f64> {
    let position = fit.noise.position_sigma.max(f64::MIN_POSITIVE);
    let mut row = *row;
    for k in 0..3 {
        row[k] /= position;
        row[k + 3] *= fit.noise.orientation_sigma.map_or(0.0, |sigma| 1.0 / sigma);
    }
    row
}

/// The turn of one joint (by place among the observed) that comes nearest to a change of each reading.
fn turns(fit: &Fit, seen: &[Seen], place: usize, rows: &[Vector6<f64>]) -> Vec<f64> {
    let turn = |(seen, row): (&Seen, &Vector6<f64>)| {
        let rate = weighted(fit, &seen.rates.fixed_view::<6, 1>(0, place).into_owned());
        let square = rate.norm_squared();
        match square > 0.0 {
            true => rate.dot(&weighted(fit, row)) / square,
            false => 0.0,
        }
    };
    seen.iter().zip(rows).map(turn).collect()
}

/// The joint that a pull turns, if it does no more than that.
fn turned(fit: &Fit, seen: &[Seen], pull: &Pull) -> Option<usize> {
    let all: f64 = pull
        .moves
        .iter()
        .map(|row| weighted(fit, row).norm_squared())
        .sum();
    let share = |place: usize| {
        let angles = turns(fit, seen, place, &pull.moves);
        let explained = angles.iter().zip(seen).map(|(angle, seen)| {
            let rate = seen.rates.fixed_view::<6, 1>(0, place).into_owned();
            angle * angle * weighted(fit, &rate).norm_squared()
        });
        explained.sum::<f64>() / all
    };
    let places = 0..fit.model.setup.observed.len();
    let shares = places.map(|place| (place, share(place)));
    let best = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best.1 > TURNS).then_some(best.0)
}

/// Unit and scale of errors whose largest is this: of angles, of lengths.
fn unit(largest: f64, turns: bool) -> (&'static str, f64) {
    match (turns, largest < 1e-3) {
        (true, true) => ("µrad", 1e6),
        (true, false) => ("mrad", 1e3),
        (false, true) => ("µm", 1e6),
        (false, false) => ("mm", 1e3),
    }
}

/// Errors as a turn (or slide) of one joint.
fn of_joint(fit: &Fit, seen: &[Seen], place: usize, moves: &[Vector6<f64>]) -> Shown {
    let setup = &fit.model.setup;
    let joint = &setup.robot.joints[setup.observed[place]];
    let left: Vec<Vector6<f64>> = seen.iter().map(|seen| seen.left).collect();
    let left = turns(fit, seen, place, &left);
    let pull = turns(fit, seen, place, moves);
    let largest = left.iter().zip(&pull).map(|(a, b)| (a + b).abs());
    let largest = largest.fold(0.0, f64::max);
    let (unit, scale) = unit(largest, joint.kind != JointKind::Prismatic);
    Shown {
        words: format!("as an error of joint {}", joint.name),
        quantity: format!("error of {}, {unit}", joint.name),
        unit,
        scale,
        left,
        pull,
    }
}

/// Errors along the direction in which a pull pushes most.
fn along(seen: &[Seen], moves: &[Vector6<f64>]) -> Shown {
    let at = |row: &Vector6<f64>| Vector3::new(row[0], row[1], row[2]);
    let spread: Matrix3<f64> = moves.iter().map(|row| at(row) * at(row).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut direction = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    // one of two opposite ones, always the same
    if direction[direction.iamax()] < 0.0 {
        direction = -direction;
    }
    let left: Vec<f64> = seen
        .iter()
        .map(|seen| direction.dot(&at(&seen.left)))
        .collect();
    let pull: Vec<f64> = moves.iter().map(|row| direction.dot(&at(row))).collect();
    let largest = left.iter().zip(&pull).map(|(a, b)| (a + b).abs());
    let (unit, scale) = unit(largest.fold(0.0, f64::max), false);
    Shown {
        words: format!(
            "along the direction in which it pushes most, ({:.2}, {:.2}, {:.2}) in the tracker's frame",
            direction.x, direction.y, direction.z
        ),
        quantity: format!("error, {unit}"),
        unit,
        scale,
        left,
        pull,
    }
}

/// All variables that may carry an error, those of one joint (by place) first.
fn variables(
    fit: &Fit,
    seen: &[Seen],
    readings: &[&Reading],
    first: Option<usize>,
    waves: &[ripple::Wave],
) -> Vec<Variable> {
    let setup = &fit.model.setup;
    let mut places: Vec<usize> = (0..setup.observed.len()).collect();
    places.sort_by_key(|&place| (Some(place) != first, place));
    let mut found: Vec<Variable> = Vec::new();
    let mut add = |name: String, values: Option<Vec<f64>>, decimals: usize| {
        if let Some(values) = values
            && values.iter().all(|x| x.is_finite())
            && values.iter().any(|x| *x != values[0])
        {
            found.push(Variable {
                name,
                values,
                decimals,
            });
        }
    };
    for &place in &places {
        let joint = setup.observed[place];
        let (name, slides) = {
            let own = &setup.robot.joints[joint];
            (&own.name, own.kind == JointKind::Prismatic)
        };
        let scale = if slides { 1e3 } else { 1f64.to_degrees() };
        let unit = if slides { "mm" } else { "°" };
        let angles = readings.iter().map(|r| r.joints[joint] * scale);
        add(format!("{name}, {unit}"), Some(angles.collect()), 0);
        let torques = seen.iter().map(|seen| seen.torques[joint]).collect();
        let unit = if slides { "N" } else { "N·m" };
        let what = if slides { "force" } else { "torque" };
        add(format!("{what} on {name}, {unit}"), Some(torques), 1);
        let sides = readings
            .iter()
            .map(|r| r.approach.as_ref().map(|all| all[joint]));
        add(format!("approach of {name} (−1, +1)"), sides.collect(), 0);
    }
    add(
        "time, s".to_owned(),
        readings.iter().map(|r| r.time).collect(),
        0,
    );
    add(
        "temperature, °C".to_owned(),
        readings.iter().map(|r| r.temperature).collect(),
        1,
    );
    let masses = readings.iter().map(|r| r.payload.map(|p| p.mass));
    add("payload, kg".to_owned(), masses.collect(), 1);
    for wave in waves {
        if let Some(joint) = setup.robot.joint(&wave.joint) {
            let phase = |r: &&Reading| (r.joints[joint] / TAU * wave.cycles).rem_euclid(1.0);
            let phases = readings.iter().map(phase).collect();
            let name = format!(
                "phase of {:.0} cycles a turn of {}, periods",
                wave.cycles, wave.joint
            );
            add(name, Some(phases), 2);
        }
    }
    found
}

/// How much a pull jumps along a variable, in what chance would make it jump (von Neumann's ratio).
fn roughness(variable: &[f64], pull: &[f64], keep: &[usize]) -> f64 {
    let mean = keep.iter().map(|&k| pull[k]).sum::<f64>() / keep.len() as f64;
    let spread: f64 = keep.iter().map(|&k| (pull[k] - mean).powi(2)).sum();
    if spread <= 0.0 || keep.len() < 3 {
        return f64::INFINITY;
    }
    let mut order = keep.to_vec();
    // where the variable is the same the order must not be that of the pull or of the time
    let shuffled = |k: usize| (k as f64 * 0.618_033_988_749_894_9).fract();
    order.sort_by(|&a, &b| {
        let by_value = variable[a].total_cmp(&variable[b]);
        by_value.then(shuffled(a).total_cmp(&shuffled(b)))
    });
    let jumps = order.windows(2).map(|w| (pull[w[1]] - pull[w[0]]).powi(2));
    jumps.sum::<f64>() / (2.0 * spread)
}

/// Readings of which no other in the same posture has the same pull: repeats would make any clock look smooth.
fn different(readings: &[&Reading], pull: &[f64]) -> Vec<usize> {
    let largest = pull
        .iter()
        .fold(0f64, |a, b| a.max(b.abs()))
        .max(f64::MIN_POSITIVE);
    let mut known = std::collections::BTreeSet::new();
    let new = |&k: &usize| {
        let joints: Vec<u64> = readings[k].joints.iter().map(|x| x.to_bits()).collect();
        known.insert((joints, (pull[k] / largest * 1e3).round() as i64))
    };
    (0..pull.len()).filter(new).collect()
}

/// An effect of the model.
fn named(
    fit: &Fit,
    seen: &[Seen],
    pull: &Pull,
    readings: &[&Reading],
    waves: &[ripple::Wave],
) -> Result<Plot, ReportError> {
    let turned = turned(fit, seen, pull);
    let shown = match turned {
        Some(place) => of_joint(fit, seen, place, &pull.moves),
        None => along(seen, &pull.moves),
    };
    let keep = different(readings, &shown.pull);
    let mut best: Option<(f64, Variable)> = None;
    for variable in variables(fit, seen, readings, turned, waves) {
        let rough = roughness(&variable.values, &shown.pull, &keep);
        if rough < SMOOTH
            && best
                .as_ref()
                .is_none_or(|(least, _)| rough < BETTER * least)
        {
            best = Some((rough, variable));
        }
    }
    let (variable, carried) = match best {
        Some((_, variable)) => (variable, true),
        // no single variable: against what the effect itself says
        None => {
            let own = Variable {
                name: format!("what {} predicts, {}", pull.id, shown.unit),
                values: shown.pull.iter().map(|x| x * shown.scale).collect(),
                decimals: 1,
            };
            (own, false)
        }
    };
    let part = match &pull.part {
        Some((joint, count)) if *count > 1 => {
            format!(" Of its {count} joints {joint} is shown, which matters most.")
        }
        _ => String::new(),
    };
    let words = match carried {
        true => format!("Shown {}.{part}", shown.words),
        false => format!(
            "No single variable carries it: what the readings show of it, {}, against what it predicts.{part}",
            shown.words
        ),
    };
    let without: Vec<f64> = shown
        .left
        .iter()
        .zip(&shown.pull)
        .map(|(left, pull)| (left + pull) * shown.scale)
        .collect();
    let with: Vec<f64> = shown.left.iter().map(|x| x * shown.scale).collect();
    let effect: Vec<f64> = shown.pull.iter().map(|x| x * shown.scale).collect();
    let line = averaged(&variable.values, &effect);
    let title = format!("{} against {}", pull.id, bare(&variable.name));
    let name = format!("fitted {}", pull.id);
    let (before, after) = (rms(without.iter().copied()), rms(with.iter().copied()));
    let scale = range(&without, &effect, &with);
    let pictures = vec![
        scatter(
            &format!("without {}", pull.id),
            (&variable, &shown.quantity),
            (&without, 0),
            Some((name, line)),
            scale,
            format!("rms {} {}", number(before), shown.unit),
        )?,
        scatter(
            &format!("with {}", pull.id),
            (&variable, &shown.quantity),
            (&with, 1),
            None,
            scale,
            format!("rms {} {}", number(after), shown.unit),
        )?,
    ];
    Ok(Plot {
        title,
        words,
        pictures,
        bins: bins(&variable, &without, &with),
        variable: variable.name,
        unit: shown.unit,
        named: true,
    })
}

/// A variable's name without its unit.
fn bare(name: &str) -> &str {
    name.split(", ").next().unwrap_or(name)
}

/// What a pattern without a name says: the misfit of the base model against its variable.
fn unnamed(diagnosis: &Diagnosis, readings: &[&Reading]) -> Result<Option<Plot>, ReportError> {
    let fit = &diagnosis.base;
    let Some(pattern) = diagnosis.patterns.first() else {
        return Ok(None);
    };
    let seen = seen(fit, readings);
    let setup = &fit.model.setup;
    // patterns say in words which joint errs: the longest name that fits is it
    let errs = |place: &usize| {
        let joint = &setup.robot.joints[setup.observed[*place]].name;
        pattern.words.starts_with(&format!("an error of {joint} "))
    };
    let place = (0..setup.observed.len()).find(errs);
    let nothing = vec![Vector6::zeros(); readings.len()];
    let shown = match place {
        Some(place) => of_joint(fit, &seen, place, &nothing),
        None => {
            let moves: Vec<Vector6<f64>> = seen.iter().map(|seen| seen.left).collect();
            let mut shown = along(&seen, &moves);
            shown.pull = vec![0.0; moves.len()];
            shown
        }
    };
    let all = variables(fit, &seen, readings, place, &diagnosis.waves);
    let named = |variable: &&Variable| {
        let name = variable.name.as_str();
        let rest = name.strip_prefix(pattern.variable.as_str());
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with(',') || rest.starts_with(" ("))
    };
    let Some(variable) = all.iter().find(named) else {
        return Ok(None);
    };
    let left: Vec<f64> = shown.left.iter().map(|x| x * shown.scale).collect();
    let line = averaged(&variable.values, &left);
    let picture = scatter(
        "what the model leaves",
        (variable, &shown.quantity),
        (&left, 0),
        Some(("mean".to_owned(), line)),
        range(&left, &left, &left),
        format!("rms {} {}", number(rms(left.iter().copied())), shown.unit),
    )?;
    Ok(Some(Plot {
        title: format!("the misfit against {}", bare(&variable.name)),
        words: format!(
            "It is as if there were {}. Shown {}.",
            pattern.words, shown.words
        ),
        pictures: vec![picture],
        bins: bins(variable, &left, &left),
        variable: variable.name.clone(),
        unit: shown.unit,
        named: false,
    }))
}

/// Least and greatest of all, so that two pictures have one scale.
fn range(a: &[f64], b: &[f64], c: &[f64]) -> (f64, f64) {
    let all = a.iter().chain(b).chain(c);
    all.fold((0.0, 0.0), |(least, most), &x| (least.min(x), most.max(x)))
}

fn scatter(
    title: &str,
    (variable, quantity): (&Variable, &str),
    (values, colour): (&[f64], usize),
    line: Option<(String, Vec<(f64, f64)>)>,
    scale: (f64, f64),
    says: String,
) -> Result<Picture, ReportError> {
    let points = variable.values.iter().copied().zip(values.iter().copied());
    let points: Vec<(f64, f64)> = points.collect();
    let dots = Dots {
        name: "readings".to_owned(),
        points,
        colour,
    };
    let lines = line.map(|(name, points)| Series {
        name,
        points,
        colour: 6,
        dashed: false,
    });
    let content = Content::Scatter {
        dots: vec![dots],
        heights: Some(scale),
        lines: lines.into_iter().collect(),
    };
    let alt = format!(
        "{quantity} of {} readings against {}, {title}: {says}.",
        values.len(),
        variable.name
    );
    let caption = format!("{title}: {says}");
    let panel = panel(title, &variable.name, quantity, content);
    Ok(picture(panel, 320, alt, caption)?)
}

/// A line through points: means of as many stretches of equally many, or of equal values of the variable.
fn averaged(variable: &[f64], values: &[f64]) -> Vec<(f64, f64)> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| variable[a].total_cmp(&variable[b]).then(a.cmp(&b)));
    let least = order.len().div_ceil(LINE);
    let mut line = Vec::new();
    let mut part: Vec<usize> = Vec::new();
    for (at, &k) in order.iter().enumerate() {
        part.push(k);
        let ends = order
            .get(at + 1)
            .is_none_or(|&next| variable[next] != variable[k]);
        if ends && (part.len() >= least || at + 1 == order.len()) {
            let mean = |of: &[f64]| part.iter().map(|&k| of[k]).sum::<f64>() / part.len() as f64;
            line.push((mean(variable), mean(values)));
            part.clear();
        }
    }
    line
}

/// The picture as numbers: stretches of the variable with equally many readings.
fn bins(variable: &Variable, without: &[f64], with: &[f64]) -> Vec<Bin> {
    let mut order: Vec<usize> = (0..without.len()).collect();
    let values = &variable.values;
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
    let most = order.len().div_ceil(BINS).max(1);
    let mut found = Vec::new();
    let mut part: Vec<usize> = Vec::new();
    for (at, &k) in order.iter().enumerate() {
        part.push(k);
        let next = order.get(at + 1);
        // readings of one value stay together
        let ends = next.is_none_or(|&next| values[next] != values[k]);
        if next.is_none() || (ends && part.len() >= most) {
            let (from, to) = (values[part[0]], values[k]);
            let decimals = variable.decimals;
            let range = match from == to {
                true => format!("{from:.decimals$}"),
                false => format!("{from:.decimals$} … {to:.decimals$}"),
            };
            found.push(Bin {
                range,
                count: part.len(),
                without: number(rms(part.iter().map(|&k| without[k]))),
                with: number(rms(part.iter().map(|&k| with[k]))),
            });
            part.clear();
        }
    }
    found
}
