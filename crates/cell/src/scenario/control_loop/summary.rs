//! Errors of all runs of a model, summed up by filter.

use super::run::Outcome;
use super::{ControlLoop, Errors, Filtered, Looped, Miss, Moment, Trace};
use crate::compensation::filter::Law;
use nalgebra::Vector6;

/// Sums of squares and largest of misses.
#[derive(Default)]
struct Sum {
    squares: Miss,
    most: Miss,
    count: usize,
}

impl Sum {
    fn add(&mut self, twist: &Vector6<f64>) {
        let miss = Miss::of(twist);
        self.squares.position_m += miss.position_m.powi(2);
        self.squares.orientation_rad += miss.orientation_rad.powi(2);
        self.most.position_m = self.most.position_m.max(miss.position_m);
        self.most.orientation_rad = self.most.orientation_rad.max(miss.orientation_rad);
        self.count += 1;
    }

    /// Not numbers where nothing was added: no pose held is no pose held well.
    fn errors(&self) -> Errors {
        let mean = |sum: f64| (sum / self.count as f64).sqrt();
        let most = |most: f64| if self.count > 0 { most } else { f64::NAN };
        Errors {
            rms: Miss {
                position_m: mean(self.squares.position_m),
                orientation_rad: mean(self.squares.orientation_rad),
            },
            most: Miss {
                position_m: most(self.most.position_m),
                orientation_rad: most(self.most.orientation_rad),
            },
        }
    }
}

/// Outcomes come by pose: the base, then each filter with noise and without.
pub(super) fn summed_up<'a>(
    wanted: &ControlLoop,
    name: &str,
    laws: &[Law],
    outcomes: impl Iterator<Item = &'a [Outcome]>,
) -> Looped {
    let (mut nominal, mut tool_alone, mut at_once) =
        (Sum::default(), Sum::default(), Sum::default());
    let mut sums: Vec<[Sum; 3]> = laws.iter().map(|_| Default::default()).collect();
    let mut unreached = vec![0; laws.len()];
    let mut traces = Vec::new();
    let mut poses = 0;
    for (pose, of_pose) in outcomes.enumerate() {
        let [Outcome::Base(base), runs @ ..] = of_pose else {
            continue;
        };
        poses += 1;
        base.nominal.iter().for_each(|e| nominal.add(e));
        base.tool_alone.iter().for_each(|e| tool_alone.add(e));
        base.at_once.iter().for_each(|e| at_once.add(e));
        for (filter, pair) in runs.chunks(2).enumerate() {
            let [
                Outcome::Run {
                    moments,
                    unreached: missing,
                },
                Outcome::Run { moments: quiet, .. },
            ] = pair
            else {
                continue;
            };
            unreached[filter] += missing;
            let [all, noise, lag] = &mut sums[filter];
            for (k, moment) in moments.iter().enumerate() {
                all.add(&moment.after);
                noise.add(&(moment.after - quiet[k].after));
                lag.add(&(quiet[k].after - base.at_once[k]));
            }
            let with_before = moments.iter().zip(&base.tool_alone);
            traces.push(Trace {
                pose,
                filter,
                moments: with_before
                    .map(|(moment, before)| Moment {
                        before: *before,
                        ..moment.clone()
                    })
                    .collect(),
            });
        }
    }
    let tick = 1.0 / wanted.rate_hz;
    let filters = wanted.filters.iter().zip(laws).zip(&sums).zip(unreached);
    Looped {
        model: name.to_owned(),
        poses,
        left_out: 0,
        unseen: None,
        nominal: nominal.errors(),
        tool_alone: tool_alone.errors(),
        at_once: at_once.errors(),
        filters: filters
            .map(|(((entry, law), [all, noise, lag]), unreached)| Filtered {
                filter: entry.name(),
                filter_delay_s: law.delay() * tick,
                delay_s: (law.delay() + 1.0) * tick,
                foreseen_s: law.ahead() * tick,
                noise_gain: law.noise_gain(),
                errors: all.errors(),
                noise: noise.errors().rms,
                lag: lag.errors().rms,
                unreached,
            })
            .collect(),
        traces,
    }
}
