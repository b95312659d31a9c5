//! How far two clocks are apart, from a motion that both streams have seen.
//!
//! Over a fixed short time the target moves by a chord whose length does not depend on the frame it is measured in. The chord
//! of the nominal robot's link, from the joint states, and the chord that the tracker saw are correlated over all offsets
//! (Knapp & Carter 1976); the best is refined by least squares together with the target's place on its link, which turns
//! of the link make visible, and with a scale, which a wrong unit makes visible. Parts of the record, each by itself, say
//! how sure that is, and whether the offset drifts.
//!
//! Of a wrench the chord of the force is taken, and of the robot that of gravity in the link's frame: what hangs on the sensor
//! turns with the hand.

use super::stream::Series;
use crate::robot::Robot;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use std::ops::Range;

/// Chords last at least so long: at 10 µm of noise 0.14 mm/s remain, s.
const CHORD: f64 = 0.1;
/// Least correlation of two streams that saw the same motion. Simulated: 0.99 and more of trackers and wrenches, 0.15 of noise
/// without motion; unrelated motions were not tried.
const LEAST_CORRELATION: f64 = 0.6;
/// The next best offset must leave so many times the variance that the best leaves.
const DISTINCT: f64 = 2.0;
/// A nominal chord below this is rounding, m (or a part of gravity).
const STILL: f64 = 1e-5;
/// Most steps of a grid: three days.
const MOST_STEPS: f64 = 5e6;
/// Most points that least squares take.
const MOST_POINTS: usize = 20_000;
/// Parts of the record that are estimated by themselves, and the fewest points of one.
const PARTS: usize = 8;
const FEWEST_POINTS: usize = 8;
/// A drift is believed, and applied, from so many standard deviations on (Student's t of six degrees of freedom: p = 0.002).
const DRIFT_SIGNIFICANCE: f64 = 5.0;

/// What is known of the clock of a stream against that of the joint states.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct ClockReport {
    /// What the stream is used as, with its topic.
    pub role: String,
    /// `estimated`, `given`, `unknown`.
    pub status: Status,
    /// Stamp of the stream less stamp of the joints at the same instant, s; if unknown what the log times say.
    pub offset_s: f64,
    /// One standard deviation, s; from parts of the record.
    pub std_s: Option<f64>,
    /// What the log times alone say, s.
    pub by_log_times_s: f64,
    /// Correlation of the chords at the best offset.
    pub correlation: Option<f64>,
    /// The best correlation of any other offset.
    pub next_correlation: Option<f64>,
    /// Change of the offset over time, s/s, applied if it is significant.
    pub drift: Option<f64>,
    /// One standard deviation of it.
    pub drift_std: Option<f64>,
    /// The drift is applied.
    pub drift_applied: bool,
    /// Measured over nominal chord: 1 of a tracker in m; kg of a sensor.
    pub scale: Option<f64>,
    /// Why it is unknown.
    pub why: Option<String>,
}

/// Where an offset comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// From the motion.
    Estimated,
    /// The spec says it.
    Given,
    /// The log times are followed.
    Unknown,
}

/// An offset between two series that [`super::stream::series`] brought near each other.
#[derive(Debug, Clone, PartialEq)]
pub struct Offset {
    /// Time of the stream less time of the joints, at `middle`, s.
    pub offset: f64,
    /// s/s.
    pub drift: f64,
    /// s, in the stream's time.
    pub middle: f64,
}

impl Offset {
    /// The joints' time of a time of the stream, s.
    pub fn joints_time(&self, time: f64) -> f64 {
        time - self.offset - self.drift * (time - self.middle)
    }
}

/// Something that the robot's motion moves: `place + turn · lever`, on a fine grid.
pub struct Path {
    start: f64,
    step: f64,
    points: Vec<Option<(Vector3<f64>, Matrix3<f64>)>>,
}

impl Path {
    /// Origin and axes of a link in the base frame as the joints say.
    pub fn of_link(robot: &Robot, link: usize, joints: &Series<Vec<f64>>) -> Self {
        Self::sampled(robot, link, joints, |pose| {
            let turn = pose.rotation.to_rotation_matrix().into_inner();
            (pose.translation.vector, turn)
        })
    }

    /// Gravity in the link's frame: the force on a sensor per kg.
    pub fn of_gravity(
        robot: &Robot,
        link: usize,
        joints: &Series<Vec<f64>>,
        gravity: &Vector3<f64>,
    ) -> Self {
        Self::sampled(robot, link, joints, |pose| {
            (pose.rotation.inverse() * gravity, Matrix3::zeros())
        })
    }

    fn sampled(
        robot: &Robot,
        link: usize,
        joints: &Series<Vec<f64>>,
        of: impl Fn(&nalgebra::Isometry3<f64>) -> (Vector3<f64>, Matrix3<f64>),
    ) -> Self {
        const MOST: f64 = 1e6;
        let (start, end) = joints.span().unwrap_or((0.0, 0.0));
        let step = (CHORD / 8.0).max((end - start) / MOST);
        let link = &robot.links[link];
        let count = ((end - start) / step) as usize + 1;
        let points = (0..count).map(|k| {
            let q = joints.at(start + k as f64 * step)?;
            Some(of(&(robot.body_poses(&q)[link.body] * link.body_from_link)))
        });
        Self {
            start,
            step,
            points: points.collect(),
        }
    }

    fn at(&self, time: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let place = (time - self.start) / self.step;
        if !(0.0..1e9).contains(&place) {
            return None;
        }
        let (before, part) = (place.floor() as usize, place.fract());
        let (p, r) = (*self.points.get(before)?)?;
        if part == 0.0 {
            return Some((p, r));
        }
        let (p1, r1) = (*self.points.get(before + 1)?)?;
        Some((p + (p1 - p) * part, r + (r1 - r) * part))
    }

    /// Chord about a time with its part that is proportional to the lever.
    fn chord(&self, time: f64, length: f64) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let (p0, r0) = self.at(time - length / 2.0)?;
        let (p1, r1) = self.at(time + length / 2.0)?;
        Some((p1 - p0, r1 - r0))
    }
}

/// What the motion says of an offset.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimate {
    /// The offset, with a drift if that is significant.
    pub offset: Offset,
    /// One standard deviation, s.
    pub std: Option<f64>,
    /// Drift and its standard deviation, s/s.
    pub drift: Option<(f64, f64)>,
    /// Of the chords at the best offset.
    pub correlation: f64,
    /// Of the next best.
    pub next: f64,
    /// Measured over nominal.
    pub scale: f64,
}

/// Why the motion says nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct Unknown {
    /// In words.
    pub why: String,
    /// Best correlation and the next, if there is a motion at all.
    pub correlations: Option<(f64, f64)>,
}

/// Offset of a measured stream against the path that the joints say, at most `most` seconds, from a lever to start with (m).
///
/// # Errors
/// Nothing moves; the chords do not correlate; two offsets explain them alike.
pub fn estimate(
    path: &Path,
    measured: &Series<Vector3<f64>>,
    lever: Vector3<f64>,
    most: f64,
) -> Result<Estimate, Unknown> {
    let chord = CHORD.max(4.0 * measured.interval());
    let step = chord / 2.0;
    let coarse = Coarse::of(path, measured, &lever, chord, step)?;
    let (lag, correlation, next) = coarse.best((most / step) as i64)?;
    let unknown = |why: &str| {
        Err(Unknown {
            why: why.into(),
            correlations: Some((correlation, next)),
        })
    };
    if correlation < LEAST_CORRELATION {
        return unknown("the motions do not correlate");
    }
    let start = lag as f64 * step;
    let points = points(measured, chord, step);
    let mut fit = LeastSquares {
        path,
        chord,
        offset: start,
        scale: 1.0,
        lever,
    };
    let at_start = fit.scale_of(&points);
    fit.scale = if at_start > 0.0 { at_start } else { 1.0 };
    fit.solve(&points, chord);
    // the lever sharpens the peak as much as it does the others: it is the ratio of what is left that counts
    if (1.0 - next.max(0.0).powi(2)) < DISTINCT * (1.0 - correlation.powi(2)) {
        return unknown("another offset explains the motions nearly as well");
    }
    let refined = fit.correlation(&points).unwrap_or(correlation);
    let (std, drift, middle) = fit.parts(&points);
    let significant = drift.filter(|(drift, std)| drift.abs() > DRIFT_SIGNIFICANCE * std);
    Ok(Estimate {
        offset: Offset {
            offset: fit.offset,
            drift: significant.map_or(0.0, |(drift, _)| drift),
            middle,
        },
        std,
        drift,
        correlation: refined.max(correlation),
        next,
        scale: fit.scale,
    })
}

/// Both chords on one grid.
struct Coarse {
    nominal: Motion,
    measured: Motion,
    /// Place of the first measured value among the nominal ones.
    first: i64,
}

impl Coarse {
    fn of(
        path: &Path,
        measured: &Series<Vector3<f64>>,
        lever: &Vector3<f64>,
        chord: f64,
        step: f64,
    ) -> Result<Self, Unknown> {
        let nothing = |why: &str| Unknown {
            why: why.into(),
            correlations: None,
        };
        let Some((from, to)) = measured.span() else {
            return Err(nothing("the stream is empty"));
        };
        let end = path.start + path.step * path.points.len().saturating_sub(1) as f64;
        let grid = |from: f64, to: f64, value: &dyn Fn(f64) -> Option<f64>| -> Vec<f64> {
            let count = ((to - from) / step).clamp(0.0, MOST_STEPS) as usize + 1;
            let at = |k| value(from + k as f64 * step).unwrap_or(f64::NAN);
            (0..count).map(at).collect()
        };
        let nominal = grid(path.start, end, &|t| {
            let (p, r) = path.chord(t, chord)?;
            Some((p + r * lever).norm())
        });
        let first = ((from - path.start) / step).round();
        let seen = grid(path.start + first * step, to, &|t| seen(measured, t, chord));
        let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
        if largest(&nominal) < STILL {
            return Err(nothing("the robot does not move"));
        }
        if largest(&seen) <= 0.0 {
            return Err(nothing("what is measured does not change"));
        }
        Ok(Self {
            nominal: Motion::of(nominal),
            measured: Motion::of(seen),
            first: first as i64,
        })
    }

    /// Best offset in steps, at most `most`; the correlation there, and the best beyond that peak.
    fn best(&self, most: i64) -> Result<(i64, f64, f64), Unknown> {
        let all: Vec<f64> = (-most..=most).map(|lag| self.at(lag)).collect();
        let peak = (0..all.len()).max_by(|a, b| all[*a].total_cmp(&all[*b]));
        let Some(peak) = peak.filter(|peak| all[*peak].is_finite()) else {
            return Err(Unknown {
                why: "the streams have no motion in common".into(),
                correlations: None,
            });
        };
        let below = |k: &usize| all[*k] < all[peak] / 2.0;
        let left = (0..peak).rev().find(below).unwrap_or(0);
        let right = (peak..all.len()).find(below).unwrap_or(all.len());
        let others = all[..left].iter().chain(&all[right..]);
        let next = others.copied().fold(0.0, f64::max);
        Ok((peak as i64 - most, all[peak], next))
    }

    /// Correlation of what overlaps; minus infinity if that holds less than half of either motion.
    fn at(&self, lag: i64) -> f64 {
        let shift = self.first - lag;
        let begin = (-shift).max(0) as usize;
        let skipped = shift.max(0) as usize;
        let (nominal, measured) = (&self.nominal, &self.measured);
        let left = measured.values.len().saturating_sub(begin);
        let overlap = left.min(nominal.values.len().saturating_sub(skipped));
        let (mut xy, mut xx, mut yy) = (0.0, 0.0, 0.0);
        for run in nominal.within(skipped, overlap) {
            nominal.values[run].iter().for_each(|x| xx += x * x);
        }
        for run in measured.within(begin, overlap) {
            let from = run.start - begin + skipped;
            for (y, x) in measured.values[run].iter().zip(&nominal.values[from..]) {
                xy += x * y;
                yy += y * y;
            }
        }
        if xx < nominal.whole / 2.0 || yy < measured.whole / 2.0 {
            return f64::NEG_INFINITY;
        }
        match (xx * yy).sqrt() {
            size if size > 0.0 => xy / size,
            _ => f64::NEG_INFINITY,
        }
    }
}

/// Chords on a grid, with the places that have one: a stamp that is years off must not cost years of a grid at each offset.
struct Motion {
    /// Less their mean; zero where there is none.
    values: Vec<f64>,
    runs: Vec<Range<usize>>,
    /// Sum of squares.
    whole: f64,
}

impl Motion {
    fn of(values: Vec<f64>) -> Self {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for place in (0..values.len()).filter(|place| values[*place].is_finite()) {
            match runs.last_mut() {
                Some(run) if run.end == place => run.end += 1,
                _ => runs.push(place..place + 1),
            }
        }
        let values = centred(values);
        Self {
            whole: values.iter().map(|x| x * x).sum(),
            values,
            runs,
        }
    }

    /// What of the runs lies among `count` places from `first` on.
    fn within(&self, first: usize, count: usize) -> impl Iterator<Item = Range<usize>> {
        let end = first.saturating_add(count);
        let clipped = move |run: &Range<usize>| run.start.max(first)..run.end.min(end);
        self.runs.iter().map(clipped).filter(|run| !run.is_empty())
    }
}

/// Values less their mean; what is missing is zero.
fn centred(mut values: Vec<f64>) -> Vec<f64> {
    let there = values.iter().filter(|x| x.is_finite());
    let count = there.clone().count().max(1);
    let mean = there.sum::<f64>() / count as f64;
    for x in &mut values {
        *x = if x.is_finite() { *x - mean } else { 0.0 };
    }
    values
}

/// Length of the measured chord about a time; none where it is beyond numbers.
fn seen(measured: &Series<Vector3<f64>>, time: f64, chord: f64) -> Option<f64> {
    let (from, to) = (time - chord / 2.0, time + chord / 2.0);
    let length = (measured.at(to)? - measured.at(from)?).norm();
    length.is_finite().then_some(length)
}

/// Times of the stream with the chords it saw: all, or every so many.
fn points(measured: &Series<Vector3<f64>>, chord: f64, step: f64) -> Vec<(f64, f64)> {
    let Some((from, to)) = measured.span() else {
        return Vec::new();
    };
    let count = ((to - from) / step).clamp(0.0, MOST_STEPS) as usize + 1;
    let stride = count.div_ceil(MOST_POINTS);
    let times = (0..count).step_by(stride).map(|k| from + k as f64 * step);
    times
        .filter_map(|t| Some((t, seen(measured, t, chord)?)))
        .collect()
}

/// Offset, scale and lever by Gauss-Newton.
struct LeastSquares<'a> {
    path: &'a Path,
    chord: f64,
    offset: f64,
    scale: f64,
    lever: Vector3<f64>,
}

impl LeastSquares<'_> {
    /// Nominal chord at a time of the stream, and its slope by the lever.
    fn nominal(&self, time: f64, offset: f64) -> Option<(f64, Vector3<f64>)> {
        let (p, r) = self.path.chord(time - offset, self.chord)?;
        let vector = p + r * self.lever;
        let length = vector.norm();
        let slope = match length > 0.0 {
            true => r.transpose() * vector / length,
            false => Vector3::zeros(),
        };
        Some((length, slope))
    }

    /// Change of the nominal chord by the offset.
    fn slope(&self, time: f64, offset: f64) -> Option<f64> {
        let delta = self.chord / 8.0;
        let (after, _) = self.nominal(time, offset + delta)?;
        let (before, _) = self.nominal(time, offset - delta)?;
        Some((after - before) / (2.0 * delta))
    }

    /// Scale that fits best.
    fn scale_of(&self, points: &[(f64, f64)]) -> f64 {
        let (mut xy, mut xx) = (0.0, 0.0);
        for (time, seen) in points {
            if let Some((length, _)) = self.nominal(*time, self.offset) {
                xy += length * seen;
                xx += length * length;
            }
        }
        if xx > 0.0 { xy / xx } else { 0.0 }
    }

    fn solve(&mut self, points: &[(f64, f64)], most: f64) {
        const ROUNDS: usize = 12;
        /// A lever that turns hardly show is left where it was, relative to the largest singular value.
        const SEEN: f64 = 1e-3;
        let start = self.offset;
        for _ in 0..ROUNDS {
            let mut normal = DMatrix::<f64>::zeros(5, 5);
            let mut right = DVector::<f64>::zeros(5);
            for (time, seen) in points {
                let (Some((length, by_lever)), Some(by_offset)) = (
                    self.nominal(*time, self.offset),
                    self.slope(*time, self.offset),
                ) else {
                    continue;
                };
                let lever = by_lever * self.scale;
                let row = DVector::from_column_slice(&[
                    by_offset * self.scale,
                    length,
                    lever.x,
                    lever.y,
                    lever.z,
                ]);
                normal.ger(1.0, &row, &row, 1.0);
                right.axpy(seen - self.scale * length, &row, 1.0);
            }
            let sizes = normal
                .diagonal()
                .map(|x| if x > 0.0 { x.sqrt() } else { 1.0 });
            for i in 0..5 {
                right[i] /= sizes[i];
                for j in 0..5 {
                    normal[(i, j)] /= sizes[i] * sizes[j];
                }
            }
            // the decomposition of what is no number does not end
            if !normal.iter().chain(&right).all(|x| x.is_finite()) {
                return;
            }
            // of the normal matrix: the square
            let Ok(step) = normal.svd(true, true).solve(&right, SEEN * SEEN) else {
                return;
            };
            let step = step.component_div(&sizes);
            if !step.iter().all(|x| x.is_finite()) {
                return;
            }
            self.offset = (self.offset + step[0]).clamp(start - most, start + most);
            self.scale = (self.scale + step[1]).max(self.scale / 2.0);
            // A target may be far from its link's origin, but not out of sight.
            self.lever = (self.lever + step.fixed_rows::<3>(2)).map(|x| x.clamp(-3.0, 3.0));
            if step[0].abs() < 1e-9 {
                return;
            }
        }
    }

    /// Correlation of nominal and seen chords.
    fn correlation(&self, points: &[(f64, f64)]) -> Option<f64> {
        let pairs = points
            .iter()
            .filter_map(|(time, seen)| Some((self.nominal(*time, self.offset)?.0, *seen)));
        let (x, y): (Vec<f64>, Vec<f64>) = pairs.unzip();
        let (x, y) = (centred(x), centred(y));
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let size = (dot(&x, &x) * dot(&y, &y)).sqrt();
        (size > 0.0).then(|| dot(&x, &y) / size)
    }

    /// Standard deviation of the offset, drift with its own, and the middle time: from parts of the record, each of
    /// which holds as much of the motion as any other.
    fn parts(&self, points: &[(f64, f64)]) -> (Option<f64>, Option<(f64, f64)>, f64) {
        let rows: Vec<(f64, f64, f64)> = points
            .iter()
            .filter_map(|(time, seen)| {
                let (length, _) = self.nominal(*time, self.offset)?;
                let slope = self.scale * self.slope(*time, self.offset)?;
                Some((*time, slope, seen - self.scale * length))
            })
            .collect();
        let whole: f64 = rows.iter().map(|(_, slope, _)| slope * slope).sum();
        let mean = |rows: &[(f64, f64, f64)]| {
            let (mut at, mut weight) = (0.0, 0.0);
            for (time, slope, _) in rows {
                at += time * slope * slope;
                weight += slope * slope;
            }
            if weight > 0.0 { at / weight } else { 0.0 }
        };
        let middle = mean(&rows);
        let mut estimates = Vec::new();
        let (mut first, mut sum) = (0, 0.0);
        for (k, (_, slope, _)) in rows.iter().enumerate() {
            sum += slope * slope;
            let due = whole * (estimates.len() + 1) as f64 / PARTS as f64;
            let open = sum < due || k + 1 - first < FEWEST_POINTS || estimates.len() + 1 == PARTS;
            if open && k + 1 < rows.len() {
                continue;
            }
            let part = &rows[first..=k];
            first = k + 1;
            let weight: f64 = part.iter().map(|(_, slope, _)| slope * slope).sum();
            // what is left at the end may be too little
            if weight > whole / (2.0 * PARTS as f64) {
                let off: f64 = part.iter().map(|(_, slope, left)| slope * left).sum();
                estimates.push((mean(part) - middle, off / weight));
            }
        }
        let n = estimates.len();
        if n < 4 {
            return (None, None, middle);
        }
        let mean_t = estimates.iter().map(|e| e.0).sum::<f64>() / n as f64;
        let mean_o = estimates.iter().map(|e| e.1).sum::<f64>() / n as f64;
        let tt: f64 = estimates.iter().map(|e| (e.0 - mean_t).powi(2)).sum();
        let to: f64 = estimates
            .iter()
            .map(|e| (e.0 - mean_t) * (e.1 - mean_o))
            .sum();
        let drift = if tt > 0.0 { to / tt } else { 0.0 };
        let about_line: f64 = estimates
            .iter()
            .map(|e| (e.1 - mean_o - drift * (e.0 - mean_t)).powi(2))
            .sum::<f64>()
            / (n - 2) as f64;
        let drift_std = (about_line / tt.max(f64::MIN_POSITIVE)).sqrt();
        let std = (about_line / n as f64).sqrt();
        (Some(std), Some((drift, drift_std)), middle)
    }
}
