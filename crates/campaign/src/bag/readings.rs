//! From stops to readings: means, labels, and what is dropped for which reason.

use super::average::{inliers, joints as mean_joints, points, rotations};
use super::dwells::{Stop, apart, merge, still_span, stops, target_bound};
use super::stream::Series;
use super::{DwellSpec, Spec, Tracked};
use crate::MIN_REPEAT_DOF;
use crate::campaign::{Noise, Reading, Wrench};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// Share of a stop for which the tracker has to see its target.
const MIN_SHARE_SEEN: f64 = 0.5;
/// A target creeps if the end of a stop is farther from its beginning than so many times the scatter of a sample,
const CREEP_FACTOR: f64 = 4.0;
/// … and than this, m.
const MIN_CREEP: f64 = 5e-5;

/// Stops and what became of them.
#[derive(Debug, Clone, PartialEq, Default, serde::Serialize)]
pub struct Dwells {
    /// Spans in which no joint moves.
    pub stops: usize,
    /// Stops that gave a reading.
    pub read: usize,
    /// Different postures among these.
    pub postures: usize,
    /// Readings, of all targets.
    pub readings: usize,
    /// Why stops gave none, by target.
    pub dropped: Vec<Drop>,
    /// Outliers thrown out of stops that were read.
    pub outliers: usize,
    /// Samples of the trackers in the means.
    pub samples: usize,
    /// Shortest and longest span that was averaged, s.
    pub averaged_s: Option<(f64, f64)>,
    /// Bound below which a joint is still, rad (m) in 0.2 s; the largest of all joints.
    pub joint_bound: f64,
    /// The same of each target, m in 0.2 s.
    pub target_bounds_m: Vec<f64>,
}

/// Stops without a reading.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Drop {
    /// The target; none if it concerns all.
    pub target: Option<String>,
    /// In words.
    pub why: String,
    /// How many.
    pub stops: usize,
    /// When the first began, s.
    pub first_s: f64,
}

/// Scatter of a target's readings, one standard deviation per coordinate.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Scatter {
    /// The target.
    pub target: String,
    /// Of single samples in a stop: median over the stops.
    pub sample: Sizes,
    /// What the mean would be worth if samples were independent: median of σ/√n.
    pub independent: Sizes,
    /// Of readings of one posture from one direction under one load.
    pub repeats: Option<Sizes>,
    /// Degrees of freedom of that, rows of positions.
    pub repeats_dof: usize,
    /// Groups of repeats.
    pub groups: usize,
}

/// Standard deviations.
#[allow(non_snake_case)] // the names carry their units
#[derive(Debug, Clone, Copy, PartialEq, Default, serde::Serialize)]
pub struct Sizes {
    /// rad (m).
    pub joint_rad: f64,
    /// m.
    pub position_m: f64,
    /// rad.
    pub orientation_rad: Option<f64>,
    /// N.
    pub force_N: Option<f64>,
    /// N·m.
    pub torque_Nm: Option<f64>,
}

pub(super) struct Found {
    pub(super) dwells: Dwells,
    pub(super) scatter: Vec<Scatter>,
    pub(super) noise: Option<Noise>,
    pub(super) readings: Vec<Reading>,
}

/// A stop of one target, averaged.
struct Read {
    reading: Reading,
    sample: Sizes,
    count: usize,
    outliers: usize,
    length: f64,
}

/// Why stops gave no reading, by target: how many, and when the first began, s.
#[derive(Default)]
struct Reasons(BTreeMap<(Option<usize>, String), (usize, f64)>);

impl Reasons {
    fn add(&mut self, target: Option<usize>, why: String, from: f64) {
        self.0.entry((target, why)).or_insert((0, from)).0 += 1;
    }

    fn drops(self, spec: &Spec) -> Vec<Drop> {
        let drops = self.0.into_iter();
        let drops = drops.map(|((target, why), (stops, first_s))| Drop {
            target: target.map(|t| spec.settings.targets[t].name.clone()),
            why,
            stops,
            first_s,
        });
        drops.collect()
    }
}

/// All stops with all targets.
pub(super) fn readings(spec: &Spec, joints: &Series<Vec<f64>>, tracked: &[Tracked]) -> Found {
    let mut reasons = Reasons::default();
    let mut dwells = Dwells::default();
    let stops = long_stops(spec, joints, &mut dwells, &mut reasons);
    let bound = |t: &Tracked| target_bound(&t.position, &stops, spec.dwell.settle_s);
    dwells.target_bounds_m = tracked.iter().map(bound).collect();
    let averaging = Averaging {
        rule: &spec.dwell,
        joints,
        zero: joints.span().map_or(0.0, |(first, _)| first),
    };
    let mut postures: Vec<(Vec<f64>, usize)> = Vec::new();
    let mut reads: Vec<Read> = Vec::new();
    for stop in &stops {
        let mut own = Vec::new();
        for (target, streams) in tracked.iter().enumerate() {
            match averaging.read(streams, target, dwells.target_bounds_m[target], stop) {
                Ok(read) => own.push(read),
                Err(why) => reasons.add(Some(target), why, stop.from - averaging.zero),
            }
        }
        if own.is_empty() {
            continue;
        }
        dwells.read += 1;
        let place = postures
            .iter()
            .position(|(posture, _)| apart(posture, &stop.joints) < spec.dwell.same_pose_rad);
        let place = place.unwrap_or_else(|| {
            postures.push((stop.joints.clone(), 0));
            postures.len() - 1
        });
        postures[place].1 += 1;
        for mut read in own {
            read.reading.pose = Some(format!("{}", place + 1));
            read.reading.repeat = Some(format!("{}", postures[place].1));
            read.reading.line = reads.len() + 2;
            dwells.outliers += read.outliers;
            dwells.samples += read.count;
            let (a, b) = dwells.averaged_s.unwrap_or((f64::INFINITY, 0.0));
            dwells.averaged_s = Some((a.min(read.length), b.max(read.length)));
            reads.push(read);
        }
    }
    dwells.postures = postures.len();
    dwells.readings = reads.len();
    dwells.dropped = reasons.drops(spec);
    let scatter: Vec<Scatter> = (0..tracked.len())
        .map(|target| scatter(&reads, target, &spec.settings.targets[target].name))
        .collect();
    Found {
        noise: noise(&scatter),
        dwells,
        scatter,
        readings: reads.into_iter().map(|read| read.reading).collect(),
    }
}

/// Stops that are long enough, those merged between which no joint left its place.
fn long_stops(
    spec: &Spec,
    joints: &Series<Vec<f64>>,
    dwells: &mut Dwells,
    reasons: &mut Reasons,
) -> Vec<Stop> {
    let rule = &spec.dwell;
    let (all, joint_bounds) = stops(joints, rule.same_pose_rad);
    let least = rule.min_s + 2.0 * rule.settle_s;
    let zero = joints.span().map_or(0.0, |(first, _)| first);
    let (long, short): (Vec<Stop>, Vec<Stop>) = all
        .into_iter()
        .partition(|stop| stop.to - stop.from >= least);
    for stop in &short {
        reasons.add(None, format!("shorter than {least:.2} s"), stop.from - zero);
    }
    dwells.stops = long.len() + short.len();
    dwells.joint_bound = joint_bounds.iter().copied().fold(0.0, f64::max);
    let (stops, merged) = merge(joints, long, rule.same_pose_rad);
    for _ in 0..merged {
        let why = "part of the stop before: no joint left its place";
        reasons.add(None, why.to_owned(), 0.0);
    }
    stops
}

/// What all means share.
struct Averaging<'a> {
    rule: &'a DwellSpec,
    joints: &'a Series<Vec<f64>>,
    /// When the joints begin, s.
    zero: f64,
}

impl Averaging<'_> {
    /// One target at one stop, or why not; the target is still below a bound, m in 0.2 s.
    fn read(
        &self,
        streams: &Tracked,
        target: usize,
        bound: f64,
        stop: &Stop,
    ) -> Result<Read, String> {
        let (rule, joints, zero) = (self.rule, self.joints, self.zero);
        let (from, to) = (stop.from + rule.settle_s, stop.to - rule.settle_s);
        let (span, seen) = still_span(&streams.position, from, to, bound);
        if seen < MIN_SHARE_SEEN {
            return Err("the tracker does not see the target".into());
        }
        let (from, to) = span.ok_or("the target moves")?;
        if to - from < rule.min_s {
            return Err("the target moves".into());
        }
        let enough = |what: &str, count: usize| match count >= rule.min_samples {
            true => Ok(()),
            false => Err(format!(
                "fewer than {} samples of the {what}",
                rule.min_samples
            )),
        };
        let own = joints.range(from, to);
        enough("joints", own.len())?;
        let angles = mean_joints(&joints.values[own]);
        let range = streams.position.range(from, to);
        enough("tracker", range.len())?;
        let samples = &streams.position.values[range.clone()];
        let kept = inliers(samples);
        enough("tracker", kept.len())?;
        let good: Vec<Vector3<f64>> = kept.iter().map(|k| samples[*k]).collect();
        let position = points(&good);
        let third = good.len() / 3;
        if third > 0 {
            let ends = points(&good[good.len() - third..]).mean - points(&good[..third]).mean;
            if ends.norm() > (CREEP_FACTOR * position.scatter).max(MIN_CREEP) {
                return Err("the target creeps".into());
            }
        }
        let orientation = match &streams.orientation {
            None => None,
            Some(all) => {
                let turned: Vec<UnitQuaternion<f64>> =
                    kept.iter().map(|k| all[range.start + k]).collect();
                Some(rotations(&turned).ok_or("its orientations have no mean")?)
            }
        };
        let wrench = match &streams.wrench {
            None => None,
            Some(series) => {
                let own = &series.values[series.range(from, to)];
                if own.is_empty() {
                    return Err("no wrench".into());
                }
                enough("wrench", own.len())?;
                let (forces, torques): (Vec<_>, Vec<_>) =
                    own.iter().map(|w| (w.force, w.torque)).unzip();
                Some((points(&forces), points(&torques)))
            }
        };
        let sample = Sizes {
            joint_rad: angles.scatter,
            position_m: position.scatter,
            orientation_rad: orientation.map(|o| o.scatter),
            force_N: wrench.map(|(force, _)| force.scatter),
            torque_Nm: wrench.map(|(_, torque)| torque.scatter),
        };
        let mut reading = Reading::to_be(target, angles.mean);
        reading.time = Some((from + to) / 2.0 - zero);
        reading.approach = Some(stop.approach.clone());
        reading.position = position.mean;
        reading.orientation = orientation.map(|o| o.mean);
        reading.wrench = wrench.map(|(force, torque)| Wrench {
            force: force.mean,
            torque: torque.mean,
        });
        Ok(Read {
            reading,
            sample,
            count: good.len(),
            outliers: samples.len() - good.len(),
            length: to - from,
        })
    }
}

/// Middle of some sizes.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    super::stream::quantile(&mut values, 0.5)
}

/// How the readings of a target scatter.
fn scatter(reads: &[Read], target: usize, name: &str) -> Scatter {
    let own: Vec<&Read> = reads
        .iter()
        .filter(|r| r.reading.target == target)
        .collect();
    let of = |scale: &dyn Fn(&Read) -> f64| {
        let middle = |part: &dyn Fn(&Sizes) -> Option<f64>| {
            median(own.iter().filter_map(|r| Some(part(&r.sample)? * scale(r))))
        };
        Sizes {
            joint_rad: middle(&|s| Some(s.joint_rad)).unwrap_or(0.0),
            position_m: middle(&|s| Some(s.position_m)).unwrap_or(0.0),
            orientation_rad: middle(&|s| s.orientation_rad),
            force_N: middle(&|s| s.force_N),
            torque_Nm: middle(&|s| s.torque_Nm),
        }
    };
    let sample = of(&|_| 1.0);
    let independent = of(&|read| 1.0 / (read.count.max(1) as f64).sqrt());
    let groups = groups(&own);
    let mut sums = [0.0; 5];
    let mut free = 0;
    for group in &groups {
        let n = group.len() as f64;
        free += group.len() - 1;
        let vectors = |of: &dyn Fn(&Reading) -> Option<Vector3<f64>>| -> f64 {
            let all: Vec<Vector3<f64>> = group.iter().filter_map(|r| of(&r.reading)).collect();
            let mean = all.iter().sum::<Vector3<f64>>() / all.len().max(1) as f64;
            all.iter().map(|x| (x - mean).norm_squared()).sum()
        };
        let joints: Vec<Vec<f64>> = group.iter().map(|r| r.reading.joints.clone()).collect();
        sums[0] += mean_joints(&joints).scatter.powi(2) * (n - 1.0);
        sums[1] += vectors(&|r| Some(r.position)) / 3.0;
        let turned: Vec<UnitQuaternion<f64>> =
            group.iter().filter_map(|r| r.reading.orientation).collect();
        if let Some(mean) = rotations(&turned) {
            sums[2] += mean.scatter.powi(2) * (n - 1.0);
        }
        sums[3] += vectors(&|r| r.wrench.map(|w| w.force)) / 3.0;
        sums[4] += vectors(&|r| r.wrench.map(|w| w.torque)) / 3.0;
    }
    let size = |k: usize| (sums[k] / free.max(1) as f64).sqrt();
    Scatter {
        target: name.to_owned(),
        sample,
        independent,
        repeats: (free > 0).then(|| Sizes {
            joint_rad: size(0),
            position_m: size(1),
            orientation_rad: sample.orientation_rad.map(|_| size(2)),
            force_N: sample.force_N.map(|_| size(3)),
            torque_Nm: sample.torque_Nm.map(|_| size(4)),
        }),
        repeats_dof: 3 * free,
        groups: groups.len(),
    }
}

/// Readings that should agree: one posture, one direction, one load.
fn groups<'a>(reads: &[&'a Read]) -> Vec<Vec<&'a Read>> {
    let mut groups: Vec<Vec<&Read>> = Vec::new();
    for read in reads {
        let same = |group: &&mut Vec<&'a Read>| {
            let first = group[0];
            let load = match (first.reading.wrench, read.reading.wrench) {
                (Some(a), Some(b)) => {
                    let noise = read.sample.force_N.unwrap_or(0.0);
                    (a.force - b.force).norm() <= (6.0 * noise).max(0.02 * a.force.norm())
                }
                (None, None) => true,
                _ => false,
            };
            load && first.reading.pose == read.reading.pose
                && first.reading.approach == read.reading.approach
        };
        match groups.iter_mut().find(same) {
            Some(group) => group.push(read),
            None => groups.push(vec![read]),
        }
    }
    groups.retain(|group| group.len() > 1);
    groups
}

/// What the repeats say, if there are enough of them; else nothing is said of the noise.
fn noise(scatter: &[Scatter]) -> Option<Noise> {
    if scatter.iter().map(|s| s.repeats_dof).sum::<usize>() < MIN_REPEAT_DOF {
        return None;
    }
    let pooled = |part: &dyn Fn(&Sizes) -> Option<f64>| {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (sizes, dof) in scatter
            .iter()
            .filter_map(|s| Some((s.repeats?, s.repeats_dof)))
        {
            if let Some(size) = part(&sizes) {
                sum += size * size * dof as f64;
                weight += dof as f64;
            }
        }
        if weight > 0.0 {
            f64::sqrt(sum / weight)
        } else {
            0.0
        }
    };
    let position = pooled(&|s| Some(s.position_m));
    Some(Noise {
        position,
        radial: position,
        orientation: pooled(&|s| s.orientation_rad),
        force: pooled(&|s| s.force_N),
        torque: pooled(&|s| s.torque_Nm),
        ..Noise::default()
    })
}
