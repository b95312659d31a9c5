//! Readings that a model cannot tell apart: repeats under the same command. Their prediction and its derivatives are
//! the same numbers, and are computed once.

use crate::campaign::Reading;
use crate::campaign::wrench_is_measured;
use crate::effects::{AnyEffect, Need, find};
use crate::model::{Model, Workspace, stacked};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Readings by what a model sees of them.
#[derive(Debug, Clone)]
pub struct Alike {
    /// Groups in the order of their first readings; indices rise within each.
    pub groups: Vec<Vec<usize>>,
    /// Group of each reading.
    pub group_of: Vec<usize>,
}

impl Alike {
    /// Groups readings that agree to the bit in all that the model's predictions depend on.
    pub fn of(model: &Model, readings: &[&Reading]) -> Self {
        let clock = model.terms.iter().any(|term| reads_clock(&*term.effect));
        Self::by(readings, clock)
    }

    /// The same, by their times and temperatures too, or by what repeats have in common.
    pub fn by(readings: &[&Reading], clock: bool) -> Self {
        let digest = |all: &mut Vec<u64>, (index, reading): (usize, &&Reading)| {
            seen(reading, clock, all);
            (digest(all), index)
        };
        let each = readings.par_iter().enumerate();
        let mut order: Vec<([u64; 2], usize)> = each.map_init(Vec::new, digest).collect();
        order.par_sort_unstable();
        let mut first_of: Vec<usize> = (0..readings.len()).collect();
        for alike in order.chunk_by(|a, b| a.0 == b.0) {
            for &(_, index) in alike {
                first_of[index] = alike[0].1;
            }
        }
        let mut count = 0;
        let mut group_of = vec![0; readings.len()];
        for (index, first) in first_of.into_iter().enumerate() {
            group_of[index] = if first == index {
                count
            } else {
                group_of[first]
            };
            count += usize::from(first == index);
        }
        let groups = members(&group_of);
        Self { groups, group_of }
    }

    /// What `then` makes of one reading of each group, for all readings; in parallel, whatever the number of threads.
    pub fn map<T: Clone + Send>(
        &self,
        model: &Model,
        readings: &[&Reading],
        then: impl Fn(&mut Workspace, &Reading) -> T + Sync,
    ) -> Vec<T> {
        let found: Vec<T> = self
            .groups
            .par_iter()
            .map_init(
                || Workspace::new(&model.setup),
                |workspace, group| then(workspace, readings[group[0]]),
            )
            .collect();
        self.group_of.iter().map(|&g| found[g].clone()).collect()
    }
}

/// A reading's joint angles, to the bit.
pub fn angles(reading: &Reading) -> Vec<u64> {
    reading.joints.iter().map(|q| q.to_bits()).collect()
}

/// Numbers things in the order of their first appearance, from 0.
pub fn numbered<K: Ord>(things: impl Iterator<Item = K>) -> Vec<usize> {
    let mut place = BTreeMap::new();
    let number = |thing: K| {
        let next = place.len();
        *place.entry(thing).or_insert(next)
    };
    things.map(number).collect()
}

/// Members of each number.
pub fn members(numbers: &[usize]) -> Vec<Vec<usize>> {
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (index, &number) in numbers.iter().enumerate() {
        if number == members.len() {
            members.push(Vec::new());
        }
        members[number].push(index);
    }
    members
}

/// The same readings, repeats under the same command behind their first.
pub fn together<'a>(readings: &[&'a Reading]) -> Vec<&'a Reading> {
    let groups = Alike::by(readings, false).groups;
    groups.iter().flatten().map(|&i| readings[i]).collect()
}

/// May what an effect does differ between repeats under the same command, which times and temperatures tell apart?
pub fn reads_clock(effect: &dyn AnyEffect) -> bool {
    let reads = |need: &Need| matches!(need, Need::Time | Need::Temperature);
    // of an effect that is not of the catalogue nothing is known
    find(effect.kind()).is_none() || effect.needs().iter().any(reads)
}

/// 128 bits: readings that differ have the same with a chance of 3e-39, which is as good as never.
fn digest(all: &[u64]) -> [u64; 2] {
    [0, 1].map(|number: u64| {
        let mut hasher = DefaultHasher::new();
        (number, all).hash(&mut hasher);
        hasher.finish()
    })
}

/// Everything of a reading that a prediction depends on, in place of what `all` held; `clock`: its time and temperatures
/// too.
fn seen(reading: &Reading, clock: bool, all: &mut Vec<u64>) {
    let bits = f64::to_bits;
    all.clear();
    all.push(reading.target as u64);
    all.extend(reading.joints.iter().copied().map(bits));
    // what may be absent is preceded by its number of values
    let mut add = |values: &[f64]| {
        all.push(values.len() as u64);
        all.extend(values.iter().copied().map(bits));
    };
    add(reading.approach.as_deref().unwrap_or(&[]));
    match reading.payload {
        Some(p) => add(&[p.mass, p.com.x, p.com.y, p.com.z]),
        None => add(&[]),
    }
    // beside a known load a wrench is measured, and only its being there counts
    match (reading.wrench, wrench_is_measured(reading)) {
        (None, _) => add(&[]),
        (Some(_), true) => add(&[0.0]),
        (Some(wrench), false) => add(stacked(&wrench.force, &wrench.torque).as_slice()),
    }
    match &reading.process {
        Some(w) => add(stacked(&w.force, &w.torque).as_slice()),
        None => add(&[]),
    }
    if clock {
        add(reading.time.as_slice());
        add(reading.temperature.as_slice());
        for &(link, temperature) in &reading.link_temperatures {
            all.extend([link as u64, temperature.to_bits()]);
        }
    }
}
