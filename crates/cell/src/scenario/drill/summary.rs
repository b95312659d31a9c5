//! What a hole was worth, in a few numbers.

use super::{Bored, Drilling, Mode, Sample, cutting};
use crate::campaign::Wrench;
use nalgebra::Vector3;
use serde::Serialize;

/// Depth from which on the cut counts as steady, and up to which, as shares of the board's thickness: the cone is in, the
/// arms have given way, the last layer is not reached.
const STEADY: (f64, f64) = (0.3, 0.9);
/// Share of the approach whose sensor readings are the tools' weights.
const TARE: f64 = 0.8;

/// A hole in numbers.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[allow(non_snake_case)] // the keys carry their units
pub struct Summary {
    /// How its commands were made.
    pub mode: Mode,
    /// From where it is to be to where it is, m; none if the drill did not get in.
    pub hole_error_m: Option<f64>,
    /// Mean angle between the drill's axis and the board's normal in the steady cut, rad.
    pub tilt_rad: f64,
    /// Largest thrust, N, and when, s.
    pub thrust_peak_N: f64,
    /// When that was, s.
    pub thrust_peak_s: f64,
    /// How deep the tip was then, m.
    pub thrust_peak_depth_m: f64,
    /// When the tip came through, s; none if it did not.
    pub through_s: Option<f64>,
    /// Mean thrust of the steady cut, N.
    pub thrust_steady_N: f64,
    /// Largest torque about the axis, N·m.
    pub torque_peak_Nm: f64,
    /// Largest lateral force on the drill while it cuts, N.
    pub lateral_peak_N: f64,
    /// Mean lateral force of the steady cut, N.
    pub lateral_steady_N: f64,
    /// Mean force along z that the board's sensor has in the steady cut, weights taken off, its own frame, N.
    pub board_fz_N: f64,
    /// The same of the drill's.
    pub tool_fz_N: f64,
    /// Mean sum of the two sensors' forces in the steady cut, weights taken off, over the largest thrust.
    pub balance: f64,
    /// The same of their moments about the hole, over the largest thrust times the distance of the sensors.
    pub moment_balance: f64,
    /// How far the command was moved along the feed to touch, m.
    pub touch_m: f64,
    /// Ticks whose command was not found.
    pub unreached: usize,
    /// Largest thrust over that under which the drill buckles.
    pub buckling: f64,
    /// Largest bending stress in the chuck over that at which carbide breaks.
    pub bending: f64,
}

/// Mean readings of both sensors before the drill touches: the weights.
pub fn tare(wanted: &Drilling, hole: &Bored) -> [Wrench; 2] {
    let before = |sample: &&Sample| sample.time < TARE * wanted.approach_s;
    let before: Vec<&Sample> = hole.samples.iter().filter(before).collect();
    let mean = |of: fn(&Sample) -> &Wrench| {
        let count = before.len().max(1) as f64;
        let sum = |part: fn(&Wrench) -> &Vector3<f64>| -> Vector3<f64> {
            before.iter().map(|sample| part(of(sample))).sum()
        };
        Wrench {
            force: sum(|w| &w.force) / count,
            torque: sum(|w| &w.torque) / count,
        }
    };
    [mean(|s| &s.board), mean(|s| &s.tool)]
}

/// What is left of a reading without the weight.
pub fn without(reading: &Wrench, weight: &Wrench) -> Wrench {
    Wrench {
        force: reading.force - weight.force,
        torque: reading.torque - weight.torque,
    }
}

/// Sums a hole up.
pub fn summary(wanted: &Drilling, hole: &Bored) -> Summary {
    let thickness = cutting::thickness(&wanted.layers());
    let weights = tare(wanted, hole);
    let samples = &hole.samples;
    let peak = samples
        .iter()
        .fold(None::<&Sample>, |best, sample| match best {
            Some(best) if best.need.thrust >= sample.need.thrust => Some(best),
            _ => Some(sample),
        });
    let cutting = samples.iter().filter(|s| s.need.thrust > 0.0);
    let most = |of: &dyn Fn(&Sample) -> f64| cutting.clone().map(of).fold(0.0, f64::max);
    let drill = wanted.drill();
    let through = samples.iter().position(|s| s.depth > thickness);
    let cut = &samples[..through.unwrap_or(samples.len())];
    let inside = STEADY.0 * thickness..STEADY.1 * thickness;
    let steady: Vec<&Sample> = cut.iter().filter(|s| inside.contains(&s.depth)).collect();
    let count = steady.len() as f64; // without a steady cut there are no means
    let mean = |of: &dyn Fn(&Sample) -> f64| steady.iter().map(|s| of(s)).sum::<f64>() / count;
    let process = |sample: &Sample| {
        [
            without(&sample.board, &weights[0]),
            without(&sample.tool, &weights[1]),
        ]
    };
    // no steady cut, no balance
    let none = if steady.is_empty() { f64::NAN } else { 0.0 };
    let (mut force, mut moment) = (Vector3::repeat(none), Vector3::repeat(none));
    let mut distance = 0.0;
    for sample in &steady {
        let origins = sample.links.map(|link| link.translation.vector);
        distance += (origins[0] - origins[1]).norm() / count;
        for (link, wrench) in sample.links.iter().zip(process(sample)) {
            let pull = link.rotation * wrench.force;
            let arm = link.translation.vector - (origins[0] + origins[1]) / 2.0;
            force += pull / count;
            moment += (link.rotation * wrench.torque + arm.cross(&pull)) / count;
        }
    }
    let thrust_peak = peak.map_or(0.0, |s| s.need.thrust);
    Summary {
        mode: hole.mode,
        hole_error_m: hole.miss.map(|miss| miss.norm()),
        tilt_rad: mean(&|s| s.tilt),
        thrust_peak_N: thrust_peak,
        thrust_peak_s: peak.map_or(0.0, |s| s.time),
        thrust_peak_depth_m: peak.map_or(0.0, |s| s.depth),
        through_s: through.map(|index| samples[index].time),
        thrust_steady_N: mean(&|s| s.need.thrust),
        torque_peak_Nm: most(&|s| s.need.torque),
        lateral_peak_N: most(&|s| s.lateral.norm()),
        lateral_steady_N: mean(&|s| s.lateral.norm()),
        board_fz_N: mean(&|s| process(s)[0].force.z),
        tool_fz_N: mean(&|s| process(s)[1].force.z),
        balance: force.norm() / thrust_peak,
        moment_balance: moment.norm() / (thrust_peak * distance),
        touch_m: hole.touch,
        unreached: hole.unreached,
        buckling: thrust_peak / drill.buckling_load(),
        bending: most(&|s| drill.bending_stress(s.lateral.norm(), s.depth)) / cutting::RUPTURE,
    }
}
