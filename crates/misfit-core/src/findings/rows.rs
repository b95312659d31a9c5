//! Rows that no instrument writes: exact zeros, copies, numbers of another size, a clock that runs backwards.

use super::finding::{Finding, Severity};
use super::table::{middle, spread};
use crate::campaign::{Campaign, Reading, Split};
use nalgebra::Vector3;
use std::collections::BTreeMap;

/// Kind of the finding of positions that are exactly zero.
pub(super) const ZERO_POSITION: &str = "zero_position";

/// Copies beyond this share of the rows make every statement about noise wrong.
const MAX_COPIED: f64 = 0.05;
/// A position this many times the spread away from all others is of another size.
const ANOTHER_SIZE: f64 = 30.0;
/// Turns that no joint makes, rad.
const MAX_ANGLE: f64 = 1e5;
/// Travel that no slide has, m.
const MAX_TRAVEL: f64 = 1e4;
/// Steps back in time that are an accident of the clock, not an order of the table: at most this share of all.
const MAX_BACKWARDS: f64 = 0.02;

/// Rows by what is wrong with them; indices into the readings.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct BadRows {
    /// Positions of exactly zero.
    pub zeros: Vec<usize>,
    /// Rows that are the same as an earlier one in everything that was measured.
    pub copies: Vec<usize>,
    /// Rows with the same measurement as an earlier one, taken at another time.
    pub frozen: Vec<usize>,
    /// Numbers that no position and no joint can have beside the others.
    pub sizes: Vec<usize>,
    /// Rows that are earlier than the one before.
    pub backwards: Vec<usize>,
}

impl BadRows {
    /// Looks at all readings.
    pub fn of(readings: &[Reading], slides: &[bool]) -> Self {
        let zeros = chosen(readings, |r| r.position == Vector3::zeros());
        // one reading at the tracker's own origin of a table that is there is no lost beam
        let zeros = if 2 * zeros.len() > readings.len() {
            Vec::new()
        } else {
            zeros
        };
        let (copies, frozen) = copies(readings);
        Self {
            sizes: other_sizes(readings, slides, &zeros),
            zeros,
            copies,
            frozen,
            backwards: backwards(readings),
        }
    }

    /// All rows that must not be looked at further.
    pub fn unusable(&self) -> Vec<usize> {
        let mut all = [&self.zeros[..], &self.copies[..], &self.sizes[..]].concat();
        all.sort_unstable();
        all.dedup();
        all
    }

    /// What is said of them.
    pub fn findings(&self, campaign: &Campaign) -> Vec<Finding> {
        let readings = &campaign.readings;
        let lines = |rows: &[usize]| rows.iter().map(|&row| readings[row].line).collect();
        let of = |rows: &[usize]| format!("{} of {} rows", rows.len(), readings.len());
        let mut found = Vec::new();
        if !self.zeros.is_empty() {
            found.push(
                Finding::new(
                    ZERO_POSITION,
                    Severity::Warning,
                    "positions of exactly 0, 0, 0: the tracker had lost the target",
                )
                .at(lines(&self.zeros))
                .because(of(&self.zeros))
                .remedy("remove these rows, or leave their position cells empty"),
            );
        }
        if !self.sizes.is_empty() {
            let most = 2 * self.sizes.len() > readings.len();
            let severity = if most {
                Severity::Error
            } else {
                Severity::Warning
            };
            found.push(
                Finding::new(
                    "impossible_number",
                    severity,
                    "numbers of another size than all others: another unit, a lost decimal point, or no measurement",
                )
                .at(lines(&self.sizes))
                .because(of(&self.sizes))
                .remedy("correct or remove these rows"),
            );
        }
        if !self.copies.is_empty() {
            let many = self.copies.len() as f64 > MAX_COPIED * readings.len() as f64;
            let severity = if many {
                Severity::Error
            } else {
                Severity::Warning
            };
            found.push(
                Finding::new("copied_rows", severity, "rows are exact copies of others")
                    .at(lines(&self.copies))
                    .because(format!("{}, equal to the last digit", of(&self.copies)))
                    .remedy("remove the copies: they are no repeats, and say nothing of the noise"),
            );
        }
        if !self.frozen.is_empty() {
            found.push(
                Finding::new(
                    "frozen_values",
                    Severity::Warning,
                    "measured values repeat to the last digit: the instrument's output was frozen, or rows were copied",
                )
                .at(lines(&self.frozen))
                .because(of(&self.frozen))
                .remedy("take these readings again; repeats must be measurements of their own"),
            );
        }
        if !self.backwards.is_empty() {
            found.push(
                Finding::new("time_backwards", Severity::Warning, "time runs backwards")
                    .at(lines(&self.backwards))
                    .because(of(&self.backwards))
                    .remedy(
                        "sort the rows by time, or correct the clock: drifts are looked for along it",
                    ),
            );
        }
        found
    }
}

fn chosen(readings: &[Reading], is: impl Fn(&Reading) -> bool) -> Vec<usize> {
    let all = readings.iter().enumerate();
    all.filter(|(_, r)| is(r)).map(|(row, _)| row).collect()
}

/// Copies, and rows whose measurement alone is that of an earlier row of the same posture.
fn copies(readings: &[Reading]) -> (Vec<usize>, Vec<usize>) {
    let mut seen: BTreeMap<Vec<u64>, Vec<usize>> = BTreeMap::new();
    let (mut copies, mut frozen) = (Vec::new(), Vec::new());
    for (row, reading) in readings.iter().enumerate() {
        let before = seen.entry(measured(reading)).or_default();
        if before.is_empty() {
            before.push(row);
            continue;
        }
        let same = |other: &usize| commanded(&readings[*other]) == commanded(reading);
        match before.iter().any(same) {
            true => copies.push(row),
            false => frozen.push(row),
        }
        before.push(row);
    }
    (copies, frozen)
}

/// What the instruments say, to the bit.
fn measured(reading: &Reading) -> Vec<u64> {
    let mut numbers: Vec<f64> = reading.position.iter().copied().collect();
    numbers.extend(
        reading
            .orientation
            .iter()
            .flat_map(|q| [q.w, q.i, q.j, q.k]),
    );
    let wrench = reading.wrench.iter();
    numbers.extend(wrench.flat_map(|w| {
        w.force
            .iter()
            .chain(w.torque.iter())
            .copied()
            .collect::<Vec<_>>()
    }));
    let mut bits: Vec<u64> = numbers.into_iter().map(f64::to_bits).collect();
    bits.push(reading.target as u64);
    bits
}

/// What was commanded and when, to the bit.
fn commanded(reading: &Reading) -> Vec<u64> {
    let mut numbers = reading.joints.clone();
    numbers.extend(reading.approach.iter().flatten());
    numbers.extend(reading.payload.map(|payload| payload.mass));
    numbers.extend(reading.time);
    numbers.into_iter().map(f64::to_bits).collect()
}

fn other_sizes(readings: &[Reading], slides: &[bool], zeros: &[usize]) -> Vec<usize> {
    let positions: Vec<Vector3<f64>> = readings
        .iter()
        .enumerate()
        .filter(|(row, _)| zeros.binary_search(row).is_err())
        .map(|(_, r)| r.position)
        .collect();
    let (middle, spread) = (middle(&positions), spread(&positions));
    let far = |r: &Reading| {
        spread > 0.0
            && (r.position - middle).norm() > ANOTHER_SIZE * spread.max(1e-3 * middle.norm())
    };
    let impossible = |r: &Reading| {
        let mut joints = r.joints.iter().zip(slides);
        joints.any(|(q, &slides)| q.abs() > if slides { MAX_TRAVEL } else { MAX_ANGLE })
    };
    chosen(readings, |r| far(r) || impossible(r))
        .into_iter()
        .filter(|row| zeros.binary_search(row).is_err())
        .collect()
}

/// Rows earlier than the one before, where these are few: a table sorted otherwise is no fault.
fn backwards(readings: &[Reading]) -> Vec<usize> {
    let mut back = Vec::new();
    for split in [Split::Fit, Split::Heldout] {
        let own = chosen(readings, |r| r.split == split);
        back.extend(own.windows(2).filter_map(|pair| {
            let (before, now) = (readings[pair[0]].time?, readings[pair[1]].time?);
            (now < before).then_some(pair[1])
        }));
    }
    back.sort_unstable();
    match back.len() as f64 > (MAX_BACKWARDS * readings.len() as f64).max(1.0) {
        true => Vec::new(),
        false => back,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Twenty honest readings, one a second.
    fn honest() -> Vec<Reading> {
        (0..20)
            .map(|k| {
                let angle = 0.3 * f64::from(k);
                let mut reading = Reading::to_be(0, vec![angle, -angle]);
                reading.position = Vector3::new(angle.cos(), angle.sin(), 0.1 * angle);
                reading.time = Some(f64::from(k));
                reading
            })
            .collect()
    }

    fn of(readings: &[Reading]) -> BadRows {
        BadRows::of(readings, &[false, false])
    }

    #[test]
    fn honest_rows_are_left_alone() {
        assert_eq!(of(&honest()), BadRows::default());
        // sorted by something else than time
        let mut sorted = honest();
        sorted.sort_by(|a, b| a.position.x.total_cmp(&b.position.x));
        assert_eq!(of(&sorted), BadRows::default());
    }

    #[test]
    fn each_fault_is_found_where_it_is() {
        type Fault = fn(&mut Vec<Reading>);
        let empty = BadRows::default;
        let table: [(Fault, BadRows); 8] = [
            (
                |r| r[3].position = Vector3::zeros(),
                BadRows {
                    zeros: vec![3],
                    ..empty()
                },
            ),
            (
                |r| r[5].position *= 1000.0,
                BadRows {
                    sizes: vec![5],
                    ..empty()
                },
            ),
            (|r| r[5].position *= 10.0, empty()),
            (
                |r| r[7].joints[1] = 1.1e5,
                BadRows {
                    sizes: vec![7],
                    ..empty()
                },
            ),
            (|r| r[7].joints[1] = 0.9e5, empty()),
            (
                |r| r[9] = r[8].clone(),
                BadRows {
                    copies: vec![9],
                    ..empty()
                },
            ),
            (
                |r| {
                    let time = r[9].time;
                    r[9] = r[8].clone();
                    r[9].time = time;
                },
                BadRows {
                    frozen: vec![9],
                    ..empty()
                },
            ),
            (
                |r| r[11].time = Some(2.0),
                BadRows {
                    backwards: vec![11],
                    ..empty()
                },
            ),
        ];
        for (fault, expected) in table {
            let mut readings = honest();
            fault(&mut readings);
            assert_eq!(of(&readings), expected);
        }
    }

    #[test]
    fn copies_of_all_rows_are_an_error_and_of_one_a_warning() {
        let readings = honest();
        for (copied, severity) in [(20, Severity::Error), (1, Severity::Warning)] {
            let mut all = readings.clone();
            all.extend(readings[..copied].iter().cloned());
            let copies = of(&all).copies;
            assert_eq!(copies, (20..20 + copied).collect::<Vec<_>>());
            let many = copies.len() as f64 > MAX_COPIED * all.len() as f64;
            assert_eq!(many, severity == Severity::Error);
        }
    }
}
