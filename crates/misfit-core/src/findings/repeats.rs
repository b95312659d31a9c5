//! Are readings of one pose repeats of one another, and do they agree with the noise that the campaign file states?

use super::doctor::length;
use super::finding::{Finding, Severity};
use super::table::quantile;
use crate::campaign::{Campaign, MIN_REPEAT_DOF, Reading, repeats, wrench_is_measured};
use crate::fit::noise;
use crate::fit::start_values;
use crate::model_file;
use nalgebra::{Matrix3, Vector3};
use statrs::distribution::{ChiSquared, ContinuousCDF};
use std::collections::BTreeMap;

/// Joints of one pose differ by less than this share of what they do in the whole table.
const SAME_JOINTS: f64 = 0.03;
/// Groups of repeats from which on two clusters are looked for.
const MIN_GROUPS: usize = 6;
/// Two clusters: what the better half of the groups leaves within the clusters is below this share of the whole ...
const TWO_CLUSTERS: f64 = 0.05;
/// ... and below this one they are no repeats at all.
const SURELY_TWO: f64 = 0.01;
/// Repeats contradict a stated noise that is larger or smaller by this factor ...
const CONTRADICTED: f64 = 1.5;
/// ... and that so many degrees of freedom have by chance with at most this probability.
const CHANCE: f64 = 1e-6;

/// All findings about repeats.
pub fn findings(campaign: &Campaign, readings: &[&Reading]) -> Vec<Finding> {
    let mut found = other_joints(campaign, readings);
    if found.iter().any(|f| f.severity == Severity::Error) {
        return found;
    }
    let groups = repeats(readings, campaign.noise.as_ref());
    let clusters = clusters(readings, &groups);
    let mixed = clusters.is_some();
    found.extend(clusters);
    if !mixed {
        found.extend(stated(campaign, readings, &groups));
    }
    found.extend(in_a_row(readings, &groups));
    found
}

/// Readings of one pose label with other joints.
fn other_joints(campaign: &Campaign, readings: &[&Reading]) -> Vec<Finding> {
    let mut labels: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (index, reading) in readings.iter().enumerate() {
        if let Some(label) = &reading.pose {
            labels
                .entry((reading.target, label))
                .or_default()
                .push(index);
        }
    }
    let labels: Vec<Vec<usize>> = labels.into_values().collect();
    let joints: Vec<&[f64]> = readings.iter().map(|r| &r.joints[..]).collect();
    let odd = odd_ones(&joints, &labels);
    if odd.is_empty() {
        return Vec::new();
    }
    let repeated = labels.iter().filter(|l| l.len() > 1).count();
    let apart = labels
        .iter()
        .filter(|l| l.iter().any(|i| odd.contains(i)))
        .count();
    let most = 2 * apart > repeated;
    let severity = if most {
        Severity::Error
    } else {
        Severity::Warning
    };
    let lines = odd.iter().map(|&i| readings[i].line).collect();
    let finding = Finding::new(
        "pose_labels",
        severity,
        "readings with one pose label have other joints: they are no repeats",
    )
    .at(lines)
    .because(format!(
        "{} readings of {apart} of {repeated} labels with several readings, in {}",
        odd.len(),
        campaign.name
    ))
    .remedy("give each commanded posture its own label, or leave the column `pose` out");
    vec![finding]
}

/// Readings whose joints differ from those of most others of their label.
fn odd_ones(joints: &[&[f64]], labels: &[Vec<usize>]) -> Vec<usize> {
    let count = joints.first().map_or(0, |q| q.len());
    let of = |joint: usize, rows: &[usize]| -> Vec<f64> {
        rows.iter().map(|&i| joints[i][joint]).collect()
    };
    let all: Vec<usize> = (0..joints.len()).collect();
    let ranges: Vec<f64> = (0..count)
        .map(|joint| {
            let values = of(joint, &all);
            quantile(&values, 0.95) - quantile(&values, 0.05)
        })
        .collect();
    let mut odd = Vec::new();
    for rows in labels.iter().filter(|rows| rows.len() > 1) {
        let middle: Vec<f64> = (0..count)
            .map(|joint| quantile(&of(joint, rows), 0.5))
            .collect();
        odd.extend(rows.iter().filter(|&&i| {
            (0..count).any(|joint| {
                (joints[i][joint] - middle[joint]).abs() > SAME_JOINTS * ranges[joint].max(1e-9)
            })
        }));
    }
    odd.sort_unstable();
    odd
}

/// Share of the squares about the mean that is left within two clusters, the best of all splits along the direction of the
/// largest spread; none of fewer than three points.
pub fn within_two(points: &[Vector3<f64>]) -> Option<f64> {
    if points.len() < 3 {
        return None;
    }
    let squares = |points: &[Vector3<f64>]| {
        let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
        points
            .iter()
            .map(|p| (p - mean).norm_squared())
            .sum::<f64>()
    };
    let whole = squares(points);
    if whole <= 0.0 {
        return None;
    }
    let mean = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let covariance: Matrix3<f64> = points
        .iter()
        .map(|p| (p - mean) * (p - mean).transpose())
        .sum();
    let eigen = covariance.symmetric_eigen();
    let along = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.dot(&along).total_cmp(&b.dot(&along)));
    let best = (1..sorted.len())
        .map(|k| squares(&sorted[..k]) + squares(&sorted[k..]))
        .fold(f64::INFINITY, f64::min);
    Some(best / whole)
}

/// How the better half of the groups splits into two clusters; none of too few groups.
pub fn two_clusters(groups: &[Vec<Vector3<f64>>]) -> Option<f64> {
    let shares: Vec<f64> = groups.iter().filter_map(|g| within_two(g)).collect();
    (shares.len() >= MIN_GROUPS).then(|| quantile(&shares, 0.5))
}

fn clusters(readings: &[&Reading], groups: &[Vec<usize>]) -> Option<Finding> {
    let positions: Vec<Vec<Vector3<f64>>> = groups
        .iter()
        .map(|group| group.iter().map(|&i| readings[i].position).collect())
        .collect();
    let share = two_clusters(&positions)?;
    if share > TWO_CLUSTERS {
        return None;
    }
    let severity = match share <= SURELY_TWO {
        true => Severity::Error,
        false => Severity::Warning,
    };
    let apart: Vec<f64> = positions
        .iter()
        .filter(|group| group.len() > 2)
        .map(|group| {
            let first = group[0];
            group.iter().map(|p| (p - first).norm()).fold(0.0, f64::max)
        })
        .collect();
    let has = |what: fn(&Reading) -> bool| readings.iter().any(|r| what(r));
    let mut lacking = Vec::new();
    if !has(|r| r.payload.is_some() || r.wrench.is_some()) {
        lacking.push("payload_kg");
    }
    if !has(|r| r.approach.is_some()) {
        lacking.push("approach_<joint>");
    }
    let lacking = match lacking.is_empty() {
        true => "what was changed between them".to_owned(),
        false => format!("the missing column: {}", lacking.join(", or ")),
    };
    Some(
        Finding::new(
            "not_repeats",
            severity,
            "readings of one pose lie in two clusters: they are no repeats, a load or a direction differs between them",
        )
        .because(format!(
            "the clusters are {} apart in the middle of {} groups, and hold {:.1} % of the squares within them",
            length(quantile(&apart, 0.5)),
            apart.len(),
            100.0 * share
        ))
        .remedy(format!("add {lacking}; until then their spread passes for noise")),
    )
}

/// What repeats say of a stated noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Contradiction {
    /// None.
    None,
    /// The stated noise is too small.
    StatedTooSmall,
    /// The stated noise is too large, or the repeats were taken without moving.
    StatedTooLarge,
}

/// Compares mean and middle squares of repeats, in units of the stated variance, of `dof` degrees of freedom.
///
/// Both must agree: of noise with heavy tails the middle is small and the mean is not.
pub fn contradiction(mean: f64, middle: f64, dof: f64) -> Contradiction {
    let Ok(chi) = ChiSquared::new(dof) else {
        return Contradiction::None;
    };
    let limit = CONTRADICTED * CONTRADICTED;
    if mean.min(middle) > limit && chi.sf(mean.min(middle) * dof) < CHANCE {
        Contradiction::StatedTooSmall
    } else if mean.max(middle) < 1.0 / limit && chi.cdf(mean.max(middle) * dof) < CHANCE {
        Contradiction::StatedTooLarge
    } else {
        Contradiction::None
    }
}

/// Noise of repeats against the stated one, of positions and of orientations.
fn stated(campaign: &Campaign, readings: &[&Reading], groups: &[Vec<usize>]) -> Vec<Finding> {
    let Some(noise) = campaign.noise else {
        return Vec::new();
    };
    let Ok(model) = model_file::frames_only(campaign) else {
        return Vec::new();
    };
    let p = start_values(campaign, &model, readings);
    let whiteners = noise::whiteners(&model, &p, readings, &noise);
    let mut found = Vec::new();
    let kinds: [(&str, &str, Square, Square); 2] = [
        (
            "position",
            "position_m",
            |group, all| squares_of(group, |i| all[i].position),
            |group, _| group.len() as f64,
        ),
        (
            "orientation",
            "orientation_rad",
            |group, all| {
                let first = all[group[0]].orientation;
                squares_of(group, |i| match (first, all[i].orientation) {
                    (Some(first), Some(own)) => (own * first.inverse()).scaled_axis(),
                    _ => Vector3::repeat(f64::NAN),
                })
            },
            |group, _| group.len() as f64,
        ),
    ];
    for (name, key, squares, members) in kinds {
        let stated = |i: usize| match name {
            "position" => whiteners[i].position_variance,
            _ => whiteners[i].orientation_variance,
        };
        let known = match name {
            "position" => noise.position > 0.0 || noise.radial > 0.0,
            _ => noise.orientation > 0.0,
        };
        let (mut sum, mut dof, mut middles) = (0.0, 0.0, Vec::new());
        for group in groups.iter().filter(|_| known) {
            let own = squares(group, readings) / stated(group[0]);
            let own_dof = 3.0 * (members(group, readings) - 1.0);
            if !own.is_finite() || own_dof <= 0.0 {
                continue;
            }
            let middle = ChiSquared::new(own_dof).map_or(own_dof, |c| c.inverse_cdf(0.5));
            sum += own;
            dof += own_dof;
            middles.push(own / middle);
        }
        if dof < MIN_REPEAT_DOF as f64 {
            continue;
        }
        // errors of the joints do to the coordinates what makes half of them independent at least
        let (mean, middle) = (sum / dof, quantile(&middles, 0.5));
        let verdict = contradiction(mean, middle, dof / 2.0);
        if verdict != Contradiction::None {
            found.push(said(verdict, name, key, mean.sqrt(), dof as usize));
        }
    }
    found
}

type Square = fn(&[usize], &[&Reading]) -> f64;

fn squares_of(group: &[usize], value: impl Fn(usize) -> Vector3<f64>) -> f64 {
    let mean = group.iter().map(|&i| value(i)).sum::<Vector3<f64>>() / group.len() as f64;
    group
        .iter()
        .map(|&i| (value(i) - mean).norm_squared())
        .sum()
}

fn said(verdict: Contradiction, name: &str, key: &str, ratio: f64, dof: usize) -> Finding {
    let (what, remedy) = match verdict {
        Contradiction::StatedTooSmall => (
            format!("repeats scatter more in {name} than [noise] states"),
            format!(
                "state {key} as it is, or look for what differs between repeats: load, direction, temperature, time"
            ),
        ),
        _ => (
            format!(
                "repeats scatter less in {name} than [noise] states: taken without moving the arm, or stated too large"
            ),
            format!(
                "approach the pose anew for each repeat, or state {key} and joint_rad as they are"
            ),
        ),
    };
    Finding::new("noise_stated", Severity::Warning, what)
        .because(format!(
            "{ratio:.2} times the stated deviation, from {dof} degrees of freedom"
        ))
        .remedy(remedy)
}

/// Share of the repeats that follow one another, from which on nothing shows that the arm moved between them.
const IN_A_ROW: f64 = 0.9;

fn in_a_row(readings: &[&Reading], groups: &[Vec<usize>]) -> Option<Finding> {
    let pairs = groups.iter().flat_map(|group| group.windows(2));
    let (mut follow, mut all) = (0, 0);
    for pair in pairs {
        all += 1;
        follow += usize::from(pair[1] == pair[0] + 1);
    }
    if all < MIN_GROUPS || (follow as f64) < IN_A_ROW * all as f64 {
        return None;
    }
    Some(
        Finding::new(
            "repeats_in_a_row",
            Severity::Note,
            "repeats follow one another in the table: if the arm did not move between them, they show the instrument's \
             noise alone, not how well the joints repeat",
        )
        .because(format!("{follow} of {all} repeats of {} readings", readings.len()))
        .remedy("visit other poses between repeats"),
    )
}

/// What `[noise]` leaves out beside what it states: read as zero, it makes those readings exact, or drops them.
pub fn unstated(campaign: &Campaign) -> Option<Finding> {
    let noise = campaign.noise?;
    let has = |of: fn(&Reading) -> bool| campaign.readings.iter().any(of);
    let table = [
        ("position_m", noise.position > 0.0, true),
        (
            "orientation_rad",
            noise.orientation > 0.0,
            has(|r| r.orientation.is_some()),
        ),
        ("force_N", noise.force > 0.0, has(wrench_is_measured)),
        ("torque_Nm", noise.torque > 0.0, has(wrench_is_measured)),
    ];
    let missing = missing(&table);
    if missing.is_empty() {
        return None;
    }
    let list = missing.join(", ");
    let what = format!("[noise] does not state {list}, though it is measured");
    let finding = Finding::new("unstated_noise", Severity::Warning, what)
        .because("with part of [noise] stated the rest counts as zero: orientations as exact, wrenches as absent")
        .remedy(format!("state {list}, or leave [noise] out: then all of it is estimated"));
    Some(finding)
}

/// Keys that are measured and not stated, where another is stated; rows are key, stated, measured.
fn missing(table: &[(&'static str, bool, bool)]) -> Vec<&'static str> {
    let measured = table.iter().filter(|row| row.2);
    match measured.clone().any(|row| row.1) {
        true => measured.filter(|row| !row.1).map(|row| row.0).collect(),
        false => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_of_a_label_are_compared_with_what_they_do_in_the_table() {
        let rows: Vec<Vec<f64>> = (0..20).map(|k| vec![f64::from(k / 2)]).collect();
        let labels: Vec<Vec<usize>> = (0..10).map(|k| vec![2 * k, 2 * k + 1]).collect();
        let odd = |rows: &[Vec<f64>]| {
            let joints: Vec<&[f64]> = rows.iter().map(|q| &q[..]).collect();
            odd_ones(&joints, &labels)
        };
        assert!(odd(&rows).is_empty());
        // three per cent of nine
        for (off, expected) in [(0.26, 0), (0.28, 1)] {
            let mut rows = rows.clone();
            rows[5][0] += off;
            assert_eq!(odd(&rows).len(), expected, "{off}");
        }
        let joints: Vec<&[f64]> = rows.iter().map(|q| &q[..]).collect();
        let one = vec![(0..20).collect::<Vec<usize>>()];
        assert!(odd_ones(&joints, &one).len() > 15);
    }

    #[test]
    fn two_clusters_need_most_groups_to_split() {
        let x = |x: f64| Vector3::new(x, 0.0, 0.0);
        // by hand: 0, 2 | 10, 12: within 2 + 2, whole 104
        let share = within_two(&[x(0.0), x(10.0), x(2.0), x(12.0)]);
        assert!(share.is_some_and(|share| (share - 4.0 / 104.0).abs() < 1e-12));
        assert_eq!(within_two(&[x(0.0), x(1.0)]), None);
        assert_eq!(within_two(&[x(1.0); 4]), None);
        let split = vec![x(0.0), x(0.1), x(10.0), x(10.1)];
        let one = vec![x(0.0), x(1.0), x(2.0), x(3.0)];
        let of = |n: usize| {
            let mut groups = vec![split.clone(); n];
            groups.extend(vec![one.clone(); 10 - n]);
            two_clusters(&groups).unwrap_or(f64::NAN)
        };
        assert!(of(7) < SURELY_TWO && of(4) > TWO_CLUSTERS);
        assert_eq!(two_clusters(&vec![split; 5]), None);
    }

    #[test]
    fn a_stated_noise_is_contradicted_both_ways_by_mean_and_middle() {
        use Contradiction::{None, StatedTooLarge, StatedTooSmall};
        for (mean, middle, dof, expected) in [
            (1.0, 1.0, 100.0, None),
            (9.0, 9.0, 100.0, StatedTooSmall),
            (2.3, 2.3, 100.0, StatedTooSmall),
            (2.2, 2.2, 100.0, None),
            // one bad pair, or heavy tails
            (9.0, 1.0, 100.0, None),
            (1.0, 0.3, 100.0, None),
            (0.43, 0.43, 100.0, StatedTooLarge),
            (0.46, 0.46, 100.0, None),
            // too few to say so
            (2.3, 2.3, 12.0, None),
            (0.43, 0.43, 12.0, None),
            // scipy.stats.chi2.sf(48, 12) = 3.1e-6, sf(54, 12) = 2.7e-7
            (4.0, 4.0, 12.0, None),
            (4.5, 4.5, 12.0, StatedTooSmall),
        ] {
            assert_eq!(
                contradiction(mean, middle, dof),
                expected,
                "{mean} {middle} {dof}"
            );
        }
    }

    #[test]
    fn keys_are_missing_beside_others_that_are_stated() {
        let of = |stated: [bool; 2], measured: [bool; 2]| {
            missing(&[("a", stated[0], measured[0]), ("b", stated[1], measured[1])])
        };
        assert!(of([true, true], [true, true]).is_empty());
        assert_eq!(of([true, false], [true, true]), ["b"]);
        assert_eq!(of([false, true], [true, true]), ["a"]);
        // what is not measured need not be stated, and where nothing is stated nothing is missing
        assert!(of([true, false], [true, false]).is_empty());
        assert!(of([false, false], [true, true]).is_empty());
    }
}
