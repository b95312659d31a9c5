//! What no effect of the catalogue has to explain: errors of one joint that follow a variable in any way.
//!
//! Each pattern is a set of functions `φ(reading)` added to one joint's angle, scored exactly as an effect is: base
//! model partialled out, evidence with unknown size. Where a pattern explains a campaign better than every effect,
//! the catalogue does not know the cause, and the pattern says which variable carries it.
//!
//! With `B_k` the whitened derivative of a reading by joint `k`, `Q` an orthonormal basis of the base model's columns and
//! `r` the residual beside them, `Xᵀ M X = Σ φ φᵀ B_kᵀB_k - (Σ φ QᵀB_k)(Σ φ QᵀB_k)ᵀ` and `Xᵀ M r = Σ φ B_kᵀr`.

use super::contrasts::Field;
use super::motion::Motion;
use super::score::{Against, Score, log_mean};
use crate::campaign::pose_key;
use crate::effects::Role;
use crate::fit::Fit;
use crate::fit::alike::{angles, members, numbered};
use crate::robot::JointKind;
use nalgebra::{DMatrix, DVector, Isometry3, Vector3};
use rayon::prelude::*;

/// Size of a pattern that would not surprise, rad.
const TYPICAL: f64 = 1e-4;
/// The same of a compliance across joints, rad/(N·m).
const COMPLIANCE: f64 = 1e-5;
/// Widths of local functions of an angle, rad.
const WIDTHS: [f64; 2] = [0.15, 0.4];
/// Force on a link that would not surprise, N, and how it changes with the link's place, N/m.
const PULL: [f64; 2] = [10.0, 30.0];
/// Local functions over a joint's range at most.
const MOST_BUMPS: usize = 48;
/// Cycles a turn in each angle of waves in two.
const WAVES: [f64; 3] = [1.0, 2.0, 3.0];
/// An error of its own in every pose is tried up to so many poses.
const MOST_POSES: usize = 64;

/// A pattern and how well it explains the misfit.
#[derive(Debug, Clone, PartialEq)]
pub struct Pattern {
    /// Contrast of the design in which it shows.
    pub class: &'static str,
    /// What it follows.
    pub variable: String,
    /// In words.
    pub words: String,
    /// Probability of as much in any pattern of its kind from noise alone.
    pub p_value: f64,
    /// Log evidence of its kind against the base model, nats.
    pub log_evidence: f64,
}

/// One joint as the readings (or poses) see it.
struct Seen {
    name: String,
    joint: usize,
    /// `QᵀB_k`, a column each.
    through: DMatrix<f64>,
    /// `B_kᵀB_k`.
    weight: DVector<f64>,
    /// `B_kᵀr`.
    pull: DVector<f64>,
}

impl Seen {
    /// Scores functions (a column each, by reading or pose) of typical size `size` as errors of this joint.
    fn score(&self, functions: &DMatrix<f64>, size: f64, variance: f64) -> Score {
        let mut scores = self.scores(functions, functions.ncols(), size, variance);
        scores.remove(0)
    }

    /// The same of sets of so many functions each.
    fn scores(
        &self,
        functions: &DMatrix<f64>,
        width: usize,
        size: f64,
        variance: f64,
    ) -> Vec<Score> {
        let through = &self.through * functions;
        let unit = size * size / variance;
        let score = |first: usize| {
            let own = functions.columns(first, width);
            let through = through.columns(first, width);
            let mut weighted = own.into_owned();
            for mut column in weighted.column_iter_mut() {
                column.component_mul_assign(&self.weight);
            }
            let raw = own.tr_mul(&weighted) * unit;
            let information = &raw - through.tr_mul(&through) * unit;
            let gradient = own.tr_mul(&self.pull) * (size / variance);
            Score::of(information, &gradient, raw.trace())
        };
        (0..functions.ncols()).step_by(width).map(score).collect()
    }

    /// Rows of one group added up: functions that are the same over a group need no more.
    fn grouped(&self, groups: &[usize], count: usize) -> Self {
        let mut through = DMatrix::zeros(self.through.nrows(), count);
        let (mut weight, mut pull) = (DVector::zeros(count), DVector::zeros(count));
        for (row, &group) in groups.iter().enumerate() {
            let mut sum = through.column_mut(group);
            sum += self.through.column(row);
            weight[group] += self.weight[row];
            pull[group] += self.pull[row];
        }
        Self {
            name: self.name.clone(),
            joint: self.joint,
            through,
            weight,
            pull,
        }
    }
}

/// Scores every kind of pattern; the best of each kind, most evidence first.
pub fn patterns(field: &Field, fit: &Fit, motions: &[Motion], against: &Against) -> Vec<Pattern> {
    let (seen, torques) = seen(field, fit, motions);
    let readings = field.readings;
    let groups = numbered(readings.iter().map(|r| (r.target, pose_key(r))));
    let first: Vec<usize> = members(&groups).iter().map(|own| own[0]).collect();
    let poses = first.len();
    let angle =
        |joint: usize| -> Vec<f64> { first.iter().map(|&i| readings[i].joints[joint]).collect() };
    let by_pose: Vec<Seen> = (seen.par_iter())
        .map(|seen| seen.grouped(&groups, poses))
        .collect();
    let (periodic, (own, (other, pulled))) = rayon::join(
        || waves(&by_pose, angle, against),
        || {
            rayon::join(
                || own_torque(&seen, &torques, against),
                || {
                    rayon::join(
                        || other_torque(&seen, &torques, against),
                        || pulls(field, &seen, fit, motions, against),
                    )
                },
            )
        },
    );
    let local = bumps(&by_pose, angle, against);
    let mut kinds = vec![local, periodic, own, other, pulled];
    if (2..=MOST_POSES).contains(&poses) {
        kinds.push(each_pose(&by_pose, against));
    }
    let column = |of: &dyn Fn(usize) -> Option<f64>| -> Option<Vec<f64>> {
        let values: Option<Vec<f64>> = (0..readings.len()).map(of).collect();
        let values = values?;
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let scaled = |x: &f64| 2.0 * (x - low) / (high - low) - 1.0;
        (high > low).then(|| values.iter().map(scaled).collect())
    };
    if let Some(time) = column(&|i| readings[i].time) {
        let words = "drifts with time";
        kinds.push(drift(&seen, &time, "time", "time", words, against));
    }
    if let Some(warmth) = column(&|i| readings[i].temperature) {
        let words = "follows the temperature";
        kinds.push(drift(&seen, &warmth, "time", "temperature", words, against));
    }
    if readings.iter().any(|reading| reading.approach.is_some()) {
        kinds.push(sides(&seen, field, against));
    }
    let mut found: Vec<Pattern> = kinds.into_iter().flatten().collect();
    found.sort_by(|a, b| b.log_evidence.total_cmp(&a.log_evidence));
    found
}

/// All observed joints as all readings see them, and the torque on each joint by reading.
fn seen(field: &Field, fit: &Fit, motions: &[Motion]) -> (Vec<Seen>, DMatrix<f64>) {
    let setup = &fit.model.setup;
    let rank = field.rank;
    let n = field.readings.len();
    let mut all: Vec<Seen> = setup
        .observed
        .iter()
        .map(|&joint| Seen {
            name: setup.robot.joints[joint].name.clone(),
            joint,
            through: DMatrix::zeros(rank, n),
            weight: DVector::zeros(n),
            pull: DVector::zeros(n),
        })
        .collect();
    let mut torques = DMatrix::zeros(n, setup.observed.len());
    let through: Vec<DMatrix<f64>> = (motions.par_iter().enumerate())
        .map(|(index, motion)| field.of(index) * &motion.rates)
        .collect();
    all.par_iter_mut().enumerate().for_each(|(place, seen)| {
        for (index, (through, motion)) in through.iter().zip(motions).enumerate() {
            let column = through.column(place);
            seen.through.set_column(index, &column.rows(0, rank));
            seen.pull[index] = column[rank];
            seen.weight[index] = motion.rates.column(place).norm_squared();
        }
    });
    for (index, motion) in motions.iter().enumerate() {
        for (place, seen) in all.iter().enumerate() {
            torques[(index, place)] = motion.torques[seen.joint];
        }
    }
    (all, torques)
}

/// One member of a kind: what it follows, in words, and its score.
type Member = (String, String, Score);

/// The best of a kind, with the evidence of the whole kind.
fn best(class: &'static str, members: Vec<Member>, against: &Against) -> Option<Pattern> {
    let (words, scores): (Vec<_>, Vec<_>) = members
        .into_iter()
        .map(|(variable, words, score)| ((variable, words), score))
        .unzip();
    best_of(class, &scores, |index| words[index].clone(), against)
}

/// The same where only the best is put in words.
fn best_of(
    class: &'static str,
    scores: &[Score],
    words: impl Fn(usize) -> (String, String),
    against: &Against,
) -> Option<Pattern> {
    let logs: Vec<f64> = scores.iter().map(|score| score.log_evidence).collect();
    let count = scores.len() as f64;
    let (top, score) = scores
        .iter()
        .enumerate()
        .filter(|(_, score)| score.dof > 0)
        .max_by(|a, b| a.1.log_evidence.total_cmp(&b.1.log_evidence))?;
    let (variable, words) = words(top);
    let p = against.p_value(score.chi2, score.dof as f64);
    Some(Pattern {
        class,
        variable,
        words,
        p_value: (p * count).min(1.0),
        log_evidence: log_mean(&logs),
    })
}

/// An error of one joint near some of its own angles.
fn bumps(seen: &[Seen], angle: impl Fn(usize) -> Vec<f64>, against: &Against) -> Option<Pattern> {
    let mut members = Vec::new();
    for seen in seen {
        let angles = angle(seen.joint);
        let low = angles.iter().copied().fold(f64::INFINITY, f64::min);
        let high = angles.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        for width in WIDTHS {
            let count = (((high - low) / width).ceil() as usize + 1).min(MOST_BUMPS);
            let step = (high - low) / (count.max(2) - 1) as f64;
            let functions = DMatrix::from_fn(angles.len(), count, |row, column| {
                let off = (angles[row] - low - step * column as f64) / step.max(width);
                (-0.5 * off * off).exp()
            });
            let words = format!("an error of {0} near some angles of {0}", seen.name);
            let score = seen.score(&functions, TYPICAL, against.variance);
            members.push((seen.name.clone(), words, score));
        }
    }
    best("pose", members, against)
}

/// An error of one joint that is periodic in the angles of two.
fn waves(
    seen: &[Seen],
    angle: impl Fn(usize) -> Vec<f64> + Sync,
    against: &Against,
) -> Option<Pattern> {
    let mut pairs = Vec::new();
    for second in 0..seen.len() {
        for first in 0..second {
            pairs.push((first, second));
        }
    }
    let mut cycles = Vec::new();
    for m in WAVES {
        cycles.extend(WAVES.into_iter().flat_map(|n| [(m, n), (m, -n)]));
    }
    let scores: Vec<Vec<Score>> = pairs
        .par_iter()
        .map(|&(first, second)| {
            let (a, b) = (angle(seen[first].joint), angle(seen[second].joint));
            let mut functions = DMatrix::zeros(a.len(), 2 * cycles.len());
            for (wave, &(m, n)) in cycles.iter().enumerate() {
                for row in 0..a.len() {
                    let (sin, cos) = (m * a[row] + n * b[row]).sin_cos();
                    functions[(row, 2 * wave)] = sin;
                    functions[(row, 2 * wave + 1)] = cos;
                }
            }
            let own = |own: &Seen| own.scores(&functions, 2, TYPICAL, against.variance);
            seen.iter().flat_map(own).collect()
        })
        .collect();
    let words = |index: usize| {
        let (place, (m, n)) = (index / cycles.len(), cycles[index % cycles.len()]);
        let (first, second) = pairs[place / seen.len()];
        let own = &seen[place % seen.len()].name;
        let (first, second) = (&seen[first].name, &seen[second].name);
        let sign = if n > 0.0 { "+" } else { "-" };
        let size = n.abs();
        (
            format!("{first} and {second}"),
            format!("an error of {own} that goes with {m} × {first} {sign} {size} × {second}"),
        )
    };
    best_of("pose", &scores.concat(), words, against)
}

/// An error of one joint that any pose has for itself.
fn each_pose(seen: &[Seen], against: &Against) -> Option<Pattern> {
    let members = seen.iter().map(|seen| {
        let functions = DMatrix::identity(seen.weight.len(), seen.weight.len());
        let words = format!("an error of {} that follows no single angle", seen.name);
        let score = seen.score(&functions, TYPICAL, against.variance);
        ("posture".to_owned(), words, score)
    });
    best("pose", members.collect(), against)
}

/// How one joint gives under its own torque, beyond a spring.
fn own_torque(seen: &[Seen], torques: &DMatrix<f64>, against: &Against) -> Option<Pattern> {
    let members = seen.par_iter().enumerate().map(|(place, seen)| {
        let column = torques.column(place);
        let largest = column.amax().max(1e-12);
        // saturating earlier and later, odd and even
        let functions = DMatrix::from_fn(column.len(), 4, |row, kind| {
            let t = column[row] / largest;
            match kind {
                0 => (20.0 * t).tanh(),
                1 => (5.0 * t).tanh(),
                2 => t.abs(),
                _ => t * t * t,
            }
        });
        let words = format!("an error of {0} that follows the torque on {0}", seen.name);
        let score = seen.score(&functions, TYPICAL, against.variance);
        (format!("torque on {}", seen.name), words, score)
    });
    best("load", members.collect(), against)
}

/// How one joint gives under another's torque.
fn other_torque(seen: &[Seen], torques: &DMatrix<f64>, against: &Against) -> Option<Pattern> {
    let of = |own: &Seen| -> Vec<Member> {
        let scores = own.scores(torques, 1, COMPLIANCE, against.variance);
        let others = seen.iter().zip(scores);
        let others = others.filter(|(bearing, _)| bearing.joint != own.joint);
        let member = |(bearing, score): (&Seen, Score)| {
            let words = format!(
                "an error of {} that follows the torque on {}",
                own.name, bearing.name
            );
            (format!("torque on {}", bearing.name), words, score)
        };
        others.map(member).collect()
    };
    let members: Vec<Vec<Member>> = seen.par_iter().map(of).collect();
    best("load", members.concat(), against)
}

/// Something pulls at a link, by the springs of the joints: a hose, a cable. Its force is a constant and a linear function
/// of the link's place, both in the base frame: one for all readings in a posture.
fn pulls(
    field: &Field,
    seen: &[Seen],
    fit: &Fit,
    motions: &[Motion],
    against: &Against,
) -> Option<Pattern> {
    let setup = &fit.model.setup;
    let springs = fit.model.term_of(Role::Spring)?;
    let compliance = |joint: usize| {
        let index = springs.of_joint(joint);
        index.map_or(0.0, |index| fit.values[index])
    };
    let posture_of = numbered((field.readings.iter()).map(|reading| angles(reading)));
    let postures: Vec<Vec<Isometry3<f64>>> = members(&posture_of)
        .iter()
        .map(|own| setup.robot.body_poses(&field.readings[own[0]].joints))
        .collect();
    let count = postures.len();
    let seen: Vec<Seen> = (seen.par_iter())
        .map(|seen| seen.grouped(&posture_of, count))
        .collect();
    let cross = products(motions, &posture_of, seen.len(), count);
    let member = |&joint: &usize| -> Member {
        let body = joint + 1;
        let places = postures.iter().map(|poses| poses[body].translation.vector);
        let middle = places.sum::<Vector3<f64>>() / count.max(1) as f64;
        let chain = setup.robot.chain(body);
        let bent = |seen: &&Seen| {
            let kind = setup.robot.joints[seen.joint].kind;
            chain.contains(&seen.joint) && kind != JointKind::Prismatic
        };
        // turns of each joint that gives way, postures by forces
        let turns = |seen: &Seen| {
            let mut turns = DMatrix::zeros(count, FORCES);
            for (row, poses) in postures.iter().enumerate() {
                let place = poses[body].translation.vector;
                let pose = poses[seen.joint + 1];
                let axis = pose.rotation * *setup.robot.joints[seen.joint].axis;
                let lever = place - pose.translation.vector;
                for (column, force) in forces(&(place - middle)).iter().enumerate() {
                    turns[(row, column)] = axis.dot(&lever.cross(force));
                }
            }
            turns * compliance(seen.joint)
        };
        let turns: Vec<Option<DMatrix<f64>>> = (seen.iter())
            .map(|seen| Some(seen).filter(bent).map(turns))
            .collect();
        let mut squares = DMatrix::zeros(FORCES, FORCES);
        let mut through = DMatrix::zeros(field.rank, FORCES);
        let mut pull = DVector::zeros(FORCES);
        for (a, one) in turns.iter().enumerate() {
            let Some(one) = one else { continue };
            through += &seen[a].through * one;
            pull += one.tr_mul(&seen[a].pull);
            for (b, other) in turns.iter().enumerate().take(a + 1) {
                let Some(other) = other else { continue };
                let mut weighted = other.clone();
                for mut column in weighted.column_iter_mut() {
                    column.component_mul_assign(&cross[a][b]);
                }
                let both = one.tr_mul(&weighted);
                if a != b {
                    squares += both.transpose();
                }
                squares += both;
            }
        }
        let raw = squares.trace() / against.variance;
        let information = (squares - through.transpose() * &through) / against.variance;
        let score = Score::of(information, &(pull / against.variance), raw);
        let name = &setup.robot.bodies[body].name;
        (
            format!("place of {name}"),
            format!("something pulled at {name} (a hose, a cable)"),
            score,
        )
    };
    let turning = |joint: &&usize| setup.robot.joints[**joint].kind != JointKind::Prismatic;
    // the last link's load is the payload's, and the wrist sensor's
    let links = setup.observed.len().saturating_sub(1);
    let pulled: Vec<usize> = setup.observed[..links]
        .iter()
        .filter(turning)
        .copied()
        .collect();
    let members = pulled.par_iter().map(member).collect();
    best("pose", members, against)
}

/// Products of the motions of two of so many joints, the first not before the second, summed by posture.
fn products(
    motions: &[Motion],
    posture_of: &[usize],
    joints: usize,
    postures: usize,
) -> Vec<Vec<DVector<f64>>> {
    let mut cross = vec![vec![DVector::zeros(postures); joints]; joints];
    for (motion, &posture) in motions.iter().zip(posture_of) {
        for (a, one) in motion.rates.column_iter().enumerate() {
            for (b, other) in motion.rates.column_iter().enumerate().take(a + 1) {
                cross[a][b][posture] += one.dot(&other);
            }
        }
    }
    cross
}

/// Forces of a pull: constant, and symmetric in the place.
const FORCES: usize = 9;

/// Them at a place (m from the middle of all), N.
fn forces(place: &Vector3<f64>) -> [Vector3<f64>; FORCES] {
    let [constant, slope] = PULL;
    let unit = |k: usize| Vector3::from_fn(|i, _| f64::from(u8::from(i == k)));
    let pairs = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];
    std::array::from_fn(|k| match k.checked_sub(3) {
        None => unit(k) * constant,
        Some(k) => {
            let (a, b) = pairs[k];
            let both = unit(a) * place[b] + unit(b) * place[a];
            both * (if a == b { 0.5 } else { 1.0 } * slope)
        }
    })
}

/// An error of one joint that follows something that all joints share.
fn drift(
    seen: &[Seen],
    along: &[f64],
    class: &'static str,
    variable: &str,
    words: &str,
    against: &Against,
) -> Option<Pattern> {
    let functions = DMatrix::from_fn(along.len(), 2, |row, kind| along[row].powi(kind as i32 + 1));
    let members = seen.iter().map(|seen| {
        let words = format!("an error of {} that {words}", seen.name);
        let score = seen.score(&functions, TYPICAL, against.variance);
        (variable.to_owned(), words, score)
    });
    best(class, members.collect(), against)
}

/// An error of one joint that turns with its approach, more at some angles than at others.
fn sides(seen: &[Seen], field: &Field, against: &Against) -> Option<Pattern> {
    let members = seen.iter().map(|seen| {
        let functions = DMatrix::from_fn(field.readings.len(), 3, |row, kind| {
            let reading = field.readings[row];
            let approach = reading.approach.as_ref();
            let side = approach.map_or(0.0, |all| all[seen.joint]);
            let (sin, cos) = reading.joints[seen.joint].sin_cos();
            side * [1.0, sin, cos][kind]
        });
        let words = format!(
            "an error of {} that turns with the direction of its approach",
            seen.name
        );
        let score = seen.score(&functions, TYPICAL, against.variance);
        (format!("approach of {}", seen.name), words, score)
    });
    best("direction", members.collect(), against)
}
