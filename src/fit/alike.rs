//! Readings that a model cannot tell apart: repeats under the same command. Their prediction and its derivatives are
//! the same numbers, and are computed once.

use crate::campaign::Reading;
use crate::effects::{Need, find};
use crate::model::{Model, Workspace, wrench_is_measured};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Readings by what a model sees of them.
#[derive(Debug, Clone)]
pub struct Alike {
    /// Groups in the order of their first readings; indices rise within each.
    pub groups: Vec<Vec<usize>>,
    readings: usize,
}

impl Alike {
    /// Groups readings that agree to the bit in all that the model's predictions depend on.
    pub fn of(model: &Model, readings: &[&Reading]) -> Self {
        let clock = model.terms.iter().any(|term| {
            let effect = &term.effect;
            // of an effect that is not of the catalogue nothing is known
            let reads = |need: &Need| matches!(need, Need::Time | Need::Temperature);
            find(effect.kind()).is_none() || effect.needs().iter().any(reads)
        });
        let mut place = BTreeMap::new();
        let mut groups: Vec<Vec<usize>> = Vec::new();
        for (index, reading) in readings.iter().enumerate() {
            let next = groups.len();
            let own = *place.entry(key(reading, clock)).or_insert(next);
            if own == next {
                groups.push(Vec::new());
            }
            groups[own].push(index);
        }
        Self {
            groups,
            readings: readings.len(),
        }
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
        let mut group_of = vec![0; self.readings];
        for (number, group) in self.groups.iter().enumerate() {
            for &index in group {
                group_of[index] = number;
            }
        }
        group_of.into_iter().map(|g| found[g].clone()).collect()
    }
}

/// Everything of a reading that a prediction depends on; `clock`: its time and temperatures too.
fn key(reading: &Reading, clock: bool) -> (usize, [Option<u64>; 2], Vec<u64>) {
    let bits = f64::to_bits;
    let mut all: Vec<u64> = reading.joints.iter().copied().map(bits).collect();
    // what may be absent is preceded by its number of values
    let mut add = |values: &[f64]| {
        all.push(values.len() as u64);
        all.extend(values.iter().copied().map(bits));
    };
    add(reading.approach.as_deref().unwrap_or(&[]));
    let payload = reading.payload;
    add(&payload.map_or(Vec::new(), |p| vec![p.mass, p.com.x, p.com.y, p.com.z]));
    // beside a known load a wrench is measured, and only its being there counts
    add(&match (reading.wrench, wrench_is_measured(reading)) {
        (None, _) => Vec::new(),
        (Some(_), true) => vec![0.0],
        (Some(wrench), false) => {
            let parts = wrench.force.iter().chain(wrench.torque.iter());
            parts.copied().collect()
        }
    });
    let process = reading.process.iter();
    let process: Vec<f64> = process
        .flat_map(|w| w.force.iter().chain(w.torque.iter()).copied())
        .collect();
    add(&process);
    let clock = if clock {
        for &(link, temperature) in &reading.link_temperatures {
            all.extend([link as u64, temperature.to_bits()]);
        }
        [reading.time, reading.temperature].map(|x| x.map(bits))
    } else {
        [None; 2]
    };
    (reading.target, clock, all)
}
