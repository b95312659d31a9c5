//! Which of many candidates to take: exchange, one place after the other, until no exchange makes the design better.
//!
//! In each place the candidate that serves best beside all others taken is found: criteria are concave, so a gradient
//! bounds what each can bring, and only those whose bound exceeds the best value found are tried. Each exchange
//! makes the criterion larger; there are finitely many designs; so it ends.
//!
//! Sources: Fedorov 1972, *Theory of Optimal Experiments*; Mitchell 1974, Technometrics 16 (DETMAX); Meyer, Nachtsheim
//! 1995, Technometrics 37 (coordinate exchange).

use super::criterion::Criterion;
use nalgebra::DMatrix;
use rand::Rng;
use rand::seq::index;

/// Candidates tried in one place, those of the highest bound first: to try all of them takes twice as long and gains
/// nothing (docs/decisions/0005).
const TRIED: usize = 12;
/// A gain below this share of the criterion is rounding.
const ROUNDING: f64 = 1e-10;
/// Rounds over all places; five are usual.
const ROUNDS: usize = 50;

/// Information of what is measured already and of some candidates.
pub fn information(
    measured: &DMatrix<f64>,
    candidates: &[DMatrix<f64>],
    taken: &[usize],
) -> DMatrix<f64> {
    let mut sum = measured.clone();
    for &index in taken {
        sum += &candidates[index];
    }
    sum
}

/// So many different candidates by chance, in rising order.
pub fn draw(candidates: usize, count: usize, random: &mut impl Rng) -> Vec<usize> {
    let mut taken = index::sample(random, candidates, count.min(candidates)).into_vec();
    taken.sort_unstable();
    taken
}

/// Exchanges candidates in `taken` for others until none makes the criterion larger; each is taken at most once.
/// What comes out is in rising order.
pub fn exchange(
    criterion: &dyn Criterion,
    measured: &DMatrix<f64>,
    candidates: &[DMatrix<f64>],
    mut taken: Vec<usize>,
) -> Vec<usize> {
    let mut value = criterion.value(&information(measured, candidates, &taken));
    for _ in 0..ROUNDS {
        let mut changed = false;
        for place in 0..taken.len() {
            let rest: Vec<usize> = taken
                .iter()
                .copied()
                .filter(|&k| k != taken[place])
                .collect();
            let without = information(measured, candidates, &rest);
            let Some(gradient) = criterion.gradient(&without) else {
                continue;
            };
            let least = criterion.value(&without);
            let mut bounds: Vec<(f64, usize)> = (0..candidates.len())
                .filter(|k| !taken.contains(k))
                .map(|k| (least + candidates[k].dot(&gradient), k))
                .collect();
            // of equal bounds the first candidate goes first
            bounds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for &(bound, candidate) in bounds.iter().take(TRIED) {
                let enough = value + ROUNDING * value.abs();
                if bound <= enough {
                    break;
                }
                let reached = criterion.value(&(&without + &candidates[candidate]));
                if reached > enough {
                    value = reached;
                    taken[place] = candidate;
                    changed = true;
                }
            }
        }
        if !changed {
            break;
        }
    }
    taken.sort_unstable();
    taken
}
