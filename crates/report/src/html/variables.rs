//! Variables that may carry an error, and which of them does: the one of which the error is the smoothest function.

use super::pull::Seen;
use misfit_arm::robot::JointKind;
use misfit_campaign::Reading;
use misfit_core::diagnosis::ripple;
use misfit_core::fit::Fit;
use std::f64::consts::TAU;

/// A variable carries a pull that jumps by less than this share of what chance would make it jump.
const SMOOTH: f64 = 0.5;
/// A variable must carry it better than one before it in the list by this factor.
const BETTER: f64 = 0.7;

/// A variable that may carry an error.
pub(super) struct Variable {
    /// With its unit.
    pub name: String,
    pub values: Vec<f64>,
    pub decimals: usize,
}

/// All variables that may carry an error, those of one joint (by place) first.
pub(super) fn variables(
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
pub(super) fn different(readings: &[&Reading], pull: &[f64]) -> Vec<usize> {
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

/// A variable's name without its unit.
pub(super) fn bare(name: &str) -> &str {
    name.split(", ").next().unwrap_or(name)
}

/// The variable of which a pull is the smoothest function, if it is one of any.
pub(super) fn carrying(all: Vec<Variable>, pull: &[f64], keep: &[usize]) -> Option<Variable> {
    let mut best: Option<(f64, Variable)> = None;
    for variable in all {
        let rough = roughness(&variable.values, pull, keep);
        let better = |least: f64| rough < BETTER * least;
        if rough < SMOOTH && best.as_ref().is_none_or(|(least, _)| better(*least)) {
            best = Some((rough, variable));
        }
    }
    best.map(|(_, variable)| variable)
}
