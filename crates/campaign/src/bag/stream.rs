//! Streams: samples in the order of their stamps, with what was wrong with them.

use crate::recording::Stamp;
use nalgebra::Vector3;

/// A sample's neighbours may be so many median intervals apart, or [`SHORT_GAP`]: beyond is a gap.
const GAP_INTERVALS: f64 = 5.0;
/// s.
const SHORT_GAP: f64 = 0.1;
/// A stamp further back than this was not overtaken on its way: a clock was set, s.
const CLOCK_SET: f64 = 0.5;

/// Values over time, strictly increasing, s since the first log time of the bag: stamps less their usual distance from the
/// log times, so that clocks that count from other years meet.
#[derive(Debug, Clone, PartialEq)]
pub struct Series<T> {
    /// s.
    pub times: Vec<f64>,
    /// One a time.
    pub values: Vec<T>,
    /// Longest distance of neighbours between which values are interpolated, s.
    pub gap: f64,
}

/// What became of a topic's messages.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct StreamReport {
    /// The topic.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub kind: String,
    /// What it is used as: `joints`, `tracker <target>`, `wrench <target>`.
    pub role: String,
    /// Messages (of transforms: those of the pair of frames).
    pub messages: usize,
    /// Samples used.
    pub used: usize,
    /// Median rate, 1/s.
    pub rate_hz: f64,
    /// Longest time between two samples used, s.
    pub longest_gap_s: f64,
    /// Stamps are zero: log times are used.
    pub log_time: bool,
    /// Stamps earlier than one before.
    pub backwards: usize,
    /// Farthest step back, s.
    pub farthest_back_s: f64,
    /// Samples with the stamp of another.
    pub duplicates: usize,
    /// Samples with a number that is not finite: a tracker that has lost its target.
    pub not_finite: usize,
    /// Other samples thrown away, and why.
    pub others: Vec<(String, usize)>,
    /// Median of stamp less log time, s.
    pub stamp_less_log_s: f64,
}

impl StreamReport {
    /// Whether the stamps say that a clock was set in the record.
    pub fn clock_was_set(&self) -> bool {
        self.farthest_back_s > CLOCK_SET
    }
}

/// Makes a series of samples; those that are not finite are left out. `start` is the bag's first log time, ns.
pub fn series<T>(
    (topic, kind, role): (&str, &str, &str),
    samples: Vec<(Stamp, T)>,
    start: i64,
    finite: impl Fn(&T) -> bool,
) -> (Series<T>, StreamReport) {
    let messages = samples.len();
    let log_time = samples.iter().any(|(stamp, _)| stamp.header == 0);
    let mut lags: Vec<i64> = samples
        .iter()
        .map(|(stamp, _)| match log_time {
            true => 0,
            false => stamp.header.saturating_sub(stamp.log),
        })
        .collect();
    lags.sort_unstable();
    let lag = lags.get(lags.len() / 2).copied().unwrap_or(0);
    let (mut backwards, mut farthest_back, mut not_finite) = (0, 0_i64, 0);
    let mut latest = i64::MIN;
    let mut kept: Vec<(i64, T)> = Vec::with_capacity(messages);
    for (stamp, value) in samples {
        let time = if log_time { stamp.log } else { stamp.header };
        if time < latest {
            backwards += 1;
            farthest_back = farthest_back.max(latest.saturating_sub(time));
        }
        latest = latest.max(time);
        if finite(&value) {
            kept.push((time, value));
        } else {
            not_finite += 1;
        }
    }
    kept.sort_by_key(|(time, _)| *time);
    let before = kept.len();
    kept.dedup_by_key(|(time, _)| *time);
    let duplicates = before - kept.len();
    let zero = lag.saturating_add(start);
    let (times, values): (Vec<f64>, Vec<T>) = kept
        .into_iter()
        .map(|(time, value)| (time.saturating_sub(zero) as f64 * 1e-9, value))
        .unzip();
    let mut intervals: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let longest_gap_s = intervals.iter().copied().fold(0.0, f64::max);
    let interval = quantile(&mut intervals, 0.5).unwrap_or(0.0);
    let report = StreamReport {
        topic: topic.into(),
        kind: kind.into(),
        role: role.into(),
        messages,
        used: times.len(),
        rate_hz: if interval > 0.0 { 1.0 / interval } else { 0.0 },
        longest_gap_s,
        log_time,
        backwards,
        farthest_back_s: farthest_back as f64 * 1e-9,
        duplicates,
        not_finite,
        others: Vec::new(),
        stamp_less_log_s: lag as f64 * 1e-9,
    };
    let gap = (GAP_INTERVALS * interval).max(SHORT_GAP);
    (Series { times, values, gap }, report)
}

impl<T> Series<T> {
    /// Indices of the samples from `from` to `to`, s.
    pub fn range(&self, from: f64, to: f64) -> std::ops::Range<usize> {
        let first = self.times.partition_point(|t| *t < from);
        let last = self.times.partition_point(|t| *t <= to);
        first..last.max(first)
    }

    /// First and last time, s.
    pub fn span(&self) -> Option<(f64, f64)> {
        Some((*self.times.first()?, *self.times.last()?))
    }

    /// Median time between samples, s; zero of less than two.
    pub fn interval(&self) -> f64 {
        let mut intervals: Vec<f64> = self.times.windows(2).map(|p| p[1] - p[0]).collect();
        quantile(&mut intervals, 0.5).unwrap_or(0.0)
    }

    /// The samples around a time and how far it is between them (0 to 1); `None` outside and in gaps.
    pub fn between(&self, time: f64) -> Option<(&T, &T, f64)> {
        let after = self.times.partition_point(|t| *t < time);
        if self.times.get(after) == Some(&time) {
            let value = self.values.get(after)?;
            return Some((value, value, 0.0));
        }
        let before = after.checked_sub(1)?;
        let (from, to) = (*self.times.get(before)?, *self.times.get(after)?);
        if to - from > self.gap {
            return None;
        }
        let part = (time - from) / (to - from);
        Some((self.values.get(before)?, self.values.get(after)?, part))
    }
}

impl Series<Vector3<f64>> {
    /// Linear interpolation; `None` outside and in gaps.
    pub fn at(&self, time: f64) -> Option<Vector3<f64>> {
        let (a, b, part) = self.between(time)?;
        Some(a + (b - a) * part)
    }
}

impl Series<Vec<f64>> {
    /// Linear interpolation; `None` outside and in gaps.
    pub fn at(&self, time: f64) -> Option<Vec<f64>> {
        let (a, b, part) = self.between(time)?;
        Some(a.iter().zip(b).map(|(a, b)| a + (b - a) * part).collect())
    }
}

/// A quantile of numbers, which are sorted for it.
pub fn quantile(numbers: &mut [f64], share: f64) -> Option<f64> {
    numbers.sort_by(f64::total_cmp);
    let place = (share * numbers.len().saturating_sub(1) as f64).round() as usize;
    numbers.get(place).copied()
}
