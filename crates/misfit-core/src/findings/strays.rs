//! Single rows and whole poses far off: with many readings of a pose, with two, and with one.
//!
//! Each reading is compared with what all other poses predict (leave one pose out), and with the other readings of its own
//! pose and load, whose differences the robot's errors do not touch.

use super::finding::{Finding, Severity};
use super::linear::{Left, LinearFit};
use super::table::quantile;
use crate::campaign::{Campaign, Reading, repeats};
use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor};

/// Kinds of the findings made here: of single rows, of whole poses.
pub(super) const KINDS: [&str; 2] = ["stray_row", "stray_pose"];

/// Rounds of rejection and of what the rest says.
const ROUNDS: usize = 6;
/// Probability of one false stray in a campaign.
const FALSE: f64 = 1e-4;
/// More than this share of the readings are no strays: they are another robot, or another set-up.
const MAX_SHARE: f64 = 0.15;
/// Degrees of freedom without which nothing can be said of a row.
pub const MIN_DOF: usize = 12;
/// Two readings of a pose differ by as many deviations of what pairs differ by.
const FAR_PAIR: f64 = 7.0;

/// Strays among readings; indices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Strays {
    /// Readings that do not agree with the others.
    pub rows: Vec<usize>,
    /// Poses all readings of which are off.
    pub poses: Vec<Vec<usize>>,
    /// The farthest, m.
    pub farthest: f64,
    /// What the others leave, m, rms of a coordinate.
    pub noise: f64,
}

/// Limit of the sum of squares of so many rows over the noise squared, the noise known from so many degrees of freedom,
/// that one of `count` readings exceeds by chance with probability [`FALSE`].
pub fn limit(rows: usize, dof: usize, count: usize) -> f64 {
    let p = FALSE / count.max(1) as f64;
    let (rows_f, dof_f) = (rows as f64, dof as f64);
    let chi = ChiSquared::new(rows_f).map_or(f64::INFINITY, |c| c.inverse_cdf(1.0 - p));
    let fisher = FisherSnedecor::new(rows_f, dof_f);
    let fisher = fisher.map_or(f64::INFINITY, |f| rows_f * f.inverse_cdf(1.0 - p));
    // real robots leave more than noise: errors of poses that are nearly alike
    2.0 * chi.max(fisher)
}

/// Which readings are beyond their limit, of the squares left in units of a noise first assumed, of which the middle tells
/// the true one.
pub fn beyond(left: &[Left], kept: &[bool], dof: usize) -> Vec<bool> {
    let ratio = |l: &Left| {
        let middle = ChiSquared::new(l.rows as f64).map_or(1.0, |c| c.inverse_cdf(0.5));
        l.squares / middle
    };
    let of_kept: Vec<f64> = left
        .iter()
        .zip(kept)
        .filter(|(l, kept)| **kept && l.rows > 0)
        .map(|(l, _)| ratio(l))
        .collect();
    let factor = quantile(&of_kept, 0.5);
    let count = left.len();
    let mut limits = [f64::NAN; 7];
    left.iter()
        .map(|l| {
            if l.rows == 0 || l.rows > 6 || factor.is_nan() || factor <= 0.0 {
                return false;
            }
            if limits[l.rows].is_nan() {
                limits[l.rows] = limit(l.rows, dof, count);
            }
            l.squares > factor * limits[l.rows]
        })
        .collect()
}

/// Looks for strays with the usual model.
pub fn by_model(fit: &mut LinearFit) -> Option<(Vec<bool>, Vec<Left>)> {
    let count: usize = fit.poses.iter().map(Vec::len).sum();
    let mut kept = vec![true; count];
    let mut left = Vec::new();
    for round in 0..ROUNDS {
        let dof = fit.dof();
        if dof < MIN_DOF {
            return None;
        }
        left = fit.left_out()?;
        let next: Vec<bool> = beyond(&left, &kept, dof).iter().map(|far| !far).collect();
        let few = next.iter().filter(|kept| !**kept).count() as f64 <= MAX_SHARE * count as f64;
        if !few {
            return None;
        }
        if next == kept && round > 0 {
            break;
        }
        kept = next;
        fit.keep(&kept)?;
    }
    Some((kept.iter().map(|kept| !kept).collect(), left))
}

/// Readings far from the others of their pose and load, by positions (m); of two the one that the model believes less
/// (`left`, larger is worse).
pub fn by_repeats(positions: &[Vec<[f64; 3]>], left: &[Vec<f64>]) -> Vec<(usize, usize)> {
    let distance =
        |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let mut pairs = Vec::new();
    for group in positions {
        for pair in group.windows(2) {
            pairs.push(distance(&pair[0], &pair[1]));
        }
    }
    // the middle of the norm of three standard normal numbers, of a difference
    let sigma = quantile(&pairs, 0.5) / (1.538_17 * 2.0_f64.sqrt());
    if pairs.len() < 8 || sigma.is_nan() || sigma <= 0.0 {
        return Vec::new();
    }
    let mut found = Vec::new();
    for (number, group) in positions.iter().enumerate() {
        if group.len() == 2 {
            if distance(&group[0], &group[1]) > FAR_PAIR * 2.0_f64.sqrt() * sigma {
                found.push((number, usize::from(left[number][1] > left[number][0])));
            }
            continue;
        }
        let middle = [0, 1, 2].map(|k| {
            let values: Vec<f64> = group.iter().map(|p| p[k]).collect();
            quantile(&values, 0.5)
        });
        let far = |p: &[f64; 3]| distance(p, &middle) > FAR_PAIR * 1.2 * sigma;
        let few = 2 * group.iter().filter(|p| far(p)).count() < group.len();
        let far = group.iter().enumerate().filter(|(_, p)| few && far(p));
        found.extend(far.map(|(place, _)| (number, place)));
    }
    if found.len() as f64 > MAX_SHARE * positions.iter().map(Vec::len).sum::<usize>() as f64 {
        return Vec::new();
    }
    found
}

/// Strays of a campaign among these readings.
pub fn of(campaign: &Campaign, readings: &[&Reading], fit: &mut LinearFit) -> Strays {
    let (mut far, left) =
        by_model(fit).unwrap_or_else(|| (vec![false; readings.len()], Vec::new()));
    let size = |i: usize| left.get(i).map_or(0.0, |l| l.squares);
    let groups = repeats(readings, campaign.noise.as_ref());
    let positions: Vec<Vec<[f64; 3]>> = groups
        .iter()
        .map(|group| group.iter().map(|&i| readings[i].position.into()).collect())
        .collect();
    let sizes: Vec<Vec<f64>> = groups
        .iter()
        .map(|group| group.iter().map(|&i| size(i)).collect())
        .collect();
    for (group, place) in by_repeats(&positions, &sizes) {
        far[groups[group][place]] = true;
    }
    let near: Vec<f64> = (0..left.len())
        .filter(|&i| !far[i])
        .map(|i| left[i].distance)
        .collect();
    let mut found = Strays {
        noise: quantile(&near, 0.5) / 1.538_17,
        ..Strays::default()
    };
    for pose in &fit.poses {
        match pose.len() > 1 && pose.iter().all(|&i| far[i]) {
            true => found.poses.push(pose.clone()),
            false => found.rows.extend(pose.iter().filter(|&&i| far[i])),
        }
    }
    found.rows.sort_unstable();
    let all = found.rows.iter().chain(found.poses.iter().flatten());
    let distances = all.filter_map(|&i| left.get(i)).map(|l| l.distance);
    found.farthest = distances.fold(0.0, f64::max);
    found
}

impl Strays {
    /// What is said of them.
    pub fn findings(&self, readings: &[&Reading]) -> Vec<Finding> {
        let lines = |rows: &[usize]| rows.iter().map(|&row| readings[row].line).collect();
        let far = super::doctor::length(self.farthest);
        let noise = super::doctor::length(self.noise);
        let mut found = Vec::new();
        if !self.rows.is_empty() {
            let (count, of) = (self.rows.len(), readings.len());
            let what = match count {
                1 => "one row does not agree with the others".to_owned(),
                _ => format!("{count} rows do not agree with the others"),
            };
            found.push(
                Finding::new(KINDS[0], Severity::Warning, what)
                    .at(lines(&self.rows))
                    .because(format!(
                        "{count} of {of}: up to {far} from what the other poses predict, which leave {noise} in a coordinate"
                    ))
                    .remedy("measure these again, or remove the rows"),
            );
        }
        if !self.poses.is_empty() {
            let names: Vec<&str> = self
                .poses
                .iter()
                .filter_map(|pose| readings[pose[0]].pose.as_deref())
                .take(8)
                .collect();
            let names = match names.is_empty() {
                true => String::new(),
                false => format!(" ({})", names.join(", ")),
            };
            let what = match self.poses.len() {
                1 => {
                    format!("one pose{names} does not agree with the others in all of its readings")
                }
                n => format!(
                    "{n} poses{names} do not agree with the others in all of their readings"
                ),
            };
            let rows: Vec<usize> = self.poses.iter().flatten().copied().collect();
            found.push(
                Finding::new(KINDS[1], Severity::Warning, what)
                    .at(lines(&rows))
                    .because(format!(
                        "up to {far} from what the other poses predict, which leave {noise} in a coordinate"
                    ))
                    .remedy("measure these poses again, or remove their rows"),
            );
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn limits_are_twice_the_quantiles() {
        // scipy.stats.chi2.isf(1e-6, 3) = 30.665; f.isf(1e-6, 3, 20) * 3 = 64.8
        let much = limit(3, 1_000_000, 100);
        assert!((much - 2.0 * 30.665).abs() < 0.05, "{much}");
        assert!(limit(3, 20, 100) > 1.5 * much);
        assert!(limit(6, 1_000_000, 100) > much);
        assert!(limit(3, 1_000_000, 10_000) > much);
    }

    #[test]
    fn one_far_from_the_middle_is_beyond_and_none_of_the_others() {
        let of = |squares: f64| Left {
            squares,
            rows: 3,
            distance: 0.0,
        };
        // the noise is ten times that assumed
        let mut left: Vec<Left> = (0..41)
            .map(|k| of(237.0 * (0.5 + f64::from(k) / 40.0)))
            .collect();
        let none = vec![false; 41];
        let kept = vec![true; 41];
        assert_eq!(beyond(&left, &kept, 80), none);
        left[7] = of(100.0 * 30.0);
        assert_eq!(beyond(&left, &kept, 80), none);
        left[7] = of(100.0 * 200.0);
        let far = beyond(&left, &kept, 80);
        assert_eq!((0..41).filter(|&k| far[k]).collect::<Vec<_>>(), vec![7]);
    }

    #[test]
    fn of_two_repeats_the_one_that_the_model_believes_less() {
        // deviations of a pair: 1.538 sqrt 2 sigma in the middle, so sigma is 1 here
        let step = 1.538_17 * 2.0_f64.sqrt();
        let pair = |far: f64| vec![[0.0; 3], [far, 0.0, 0.0]];
        let mut positions = vec![pair(step); 10];
        let left = vec![vec![1.0, 2.0]; 10];
        assert!(by_repeats(&positions, &left).is_empty());
        positions[4] = pair(9.8);
        assert!(by_repeats(&positions, &left).is_empty());
        positions[4] = pair(10.0);
        assert_eq!(by_repeats(&positions, &left), vec![(4, 1)]);
        positions[4] = vec![[0.0; 3], [9.0, 0.0, 0.0], [0.1, 0.0, 0.0]];
        assert_eq!(by_repeats(&positions, &left), vec![(4, 1)]);
        // nothing is said of a handful of pairs
        assert!(by_repeats(&[pair(1.0), pair(50.0)], &left).is_empty());
    }
}
