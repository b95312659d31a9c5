//! Signs of loads: a wrench against the known weight, and springs that want to be negative.

use super::finding::{Finding, Severity};
use super::linear::Springs;
use super::table::quantile;
use crate::campaign::{Campaign, Reading};
use nalgebra::Vector3;

/// A wrench that is a weight has this direction at least, as a cosine against gravity.
const ALONG: f64 = 0.9;
/// Of the weights that a wrench and a payload say, in the middle: below this the sign is reversed.
const REVERSED: f64 = -0.5;
/// Readings without which nothing is said of signs.
const MIN_READINGS: usize = 6;
/// Springs are negative when one compliance for all is so many deviations below zero ...
const SURE: f64 = -6.0;
/// ... and free ones leave at most this share of the squares that none leave.
const EXPLAINS: f64 = 0.6;
/// A reversed wrench is right when the usual model leaves less than this share of what it left.
const CONFIRMED: f64 = 0.6;

/// What forces say of their own sign: forces of the load on the arm and weights that should act, both in the base frame, N.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sign {
    /// Nothing to compare.
    Unknown,
    /// As it should be.
    Right,
    /// Against the known weight, or against gravity in all readings.
    Reversed(f64),
}

/// Compares forces with known weights: the middle of how much of the weight acts.
pub fn against_weight(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Sign {
    let heaviest = pairs.iter().map(|(_, w)| w.norm()).fold(0.0, f64::max);
    let shares: Vec<f64> = pairs
        .iter()
        .filter(|(_, weight)| weight.norm() > 0.1 * heaviest)
        .map(|(force, weight)| force.dot(weight) / weight.norm_squared())
        .collect();
    if heaviest <= 0.0 || shares.len() < MIN_READINGS {
        return Sign::Unknown;
    }
    let middle = quantile(&shares, 0.5);
    match middle < REVERSED {
        true => Sign::Reversed(middle),
        false => Sign::Right,
    }
}

/// Forces alone: what hangs on an arm pulls along gravity. The middle cosine of the larger half of them.
pub fn along_gravity(forces: &[Vector3<f64>], gravity: &Vector3<f64>) -> Sign {
    let sizes: Vec<f64> = forces.iter().map(|f| f.norm()).collect();
    let middle = quantile(&sizes, 0.5).max(1e-3 * sizes.iter().copied().fold(0.0, f64::max));
    let cosines: Vec<f64> = forces
        .iter()
        .filter(|f| f.norm() >= middle && f.norm() > 0.0)
        .map(|f| f.dot(gravity) / (f.norm() * gravity.norm()))
        .collect();
    if gravity.norm() == 0.0 || cosines.len() < MIN_READINGS {
        return Sign::Unknown;
    }
    // all of them along one line, or they are forces of a process
    match (
        quantile(&cosines, 0.9) < -ALONG,
        quantile(&cosines, 0.1) > ALONG,
    ) {
        (true, _) => Sign::Reversed(quantile(&cosines, 0.5)),
        (_, true) => Sign::Right,
        _ => Sign::Unknown,
    }
}

/// Do springs want to be negative?
pub fn negative(springs: &Springs) -> bool {
    springs.together < SURE && springs.left < EXPLAINS && springs.signs.0 > springs.signs.1
}

/// Findings about wrenches.
pub fn wrenches(campaign: &Campaign, readings: &[&Reading]) -> Option<Finding> {
    let mut pairs = Vec::new();
    let mut forces = Vec::new();
    for reading in readings {
        let Some(wrench) = reading.wrench else {
            continue;
        };
        let link = &campaign.robot.links[campaign.targets[reading.target].link];
        let pose = campaign.robot.body_poses(&reading.joints)[link.body] * link.body_from_link;
        let force = pose.rotation * wrench.force;
        match reading.payload {
            Some(payload) => pairs.push((force, campaign.gravity * payload.mass)),
            None => forces.push(force),
        }
    }
    let (sign, evidence) = match against_weight(&pairs) {
        Sign::Unknown => (
            along_gravity(&forces, &campaign.gravity),
            "of the force points along gravity",
        ),
        known => (known, "of the known weight acts along gravity"),
    };
    let Sign::Reversed(share) = sign else {
        return None;
    };
    // without a known weight something may push from below
    let severity = if pairs.is_empty() {
        Severity::Warning
    } else {
        Severity::Error
    };
    Some(
        Finding::new(
            "wrench_sign",
            severity,
            "the wrench is reversed: it is what the arm does to the load, not the load to the arm",
        )
        .because(format!("{:.0} % {evidence}, in the middle", 100.0 * share))
        .remedy("change the signs of fx fy fz tx ty tz, or of gravity in the campaign file if the base hangs"),
    )
}

/// The same reading with the wrench reversed.
pub fn reversed(reading: &Reading) -> Reading {
    let mut reading = reading.clone();
    if let Some(wrench) = &mut reading.wrench {
        wrench.force = -wrench.force;
        wrench.torque = -wrench.torque;
    }
    reading
}

/// The finding about a wrench, sure if the usual model leaves less with the wrench reversed: `ratio` of what it leaves then.
pub fn confirmed(mut finding: Finding, ratio: f64) -> Finding {
    if ratio < CONFIRMED {
        finding.severity = Severity::Error;
        finding.evidence += &format!(
            "; reversed, the usual model leaves {:.0} % of it",
            100.0 * ratio
        );
    }
    finding
}

/// Findings about springs.
pub fn springs(springs: &Springs, loaded_by_wrench: bool) -> Option<Finding> {
    if !negative(springs) {
        return None;
    }
    let whose = match loaded_by_wrench {
        true => "of the wrench, or of gravity,",
        false => "of gravity (or of the payload)",
    };
    Some(
        Finding::new(
            "negative_springs",
            Severity::Error,
            format!("the arm gives way against its load: the sign {whose} is reversed"),
        )
        .because(format!(
            "one compliance for all joints is {:.0} deviations below zero, and {} of the joints' own are; free springs leave \
             {:.0} % of the squares that none leave",
            -springs.together,
            springs.signs.0,
            100.0 * springs.left
        ))
        .remedy("check `gravity` (in the base frame, 0, 0, -9.81 for an upright base) and the signs of the wrench columns"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wrench_against_the_known_weight_is_reversed() {
        let weight = Vector3::new(0.0, 0.0, -50.0);
        let of = |share: f64, n: usize| against_weight(&vec![(weight * share, weight); n]);
        assert_eq!(of(1.0, 6), Sign::Right);
        assert_eq!(of(0.6, 6), Sign::Right);
        assert_eq!(of(-1.0, 6), Sign::Reversed(-1.0));
        assert_eq!(of(-0.4, 6), Sign::Right);
        assert_eq!(of(-1.0, 5), Sign::Unknown);
        // unloaded readings do not count
        let mut pairs = vec![(weight, weight); 6];
        pairs.extend(vec![(-weight * 0.01, weight * 0.0); 20]);
        assert_eq!(against_weight(&pairs), Sign::Right);
    }

    #[test]
    fn forces_of_a_process_have_no_sign() {
        let down = Vector3::new(0.0, 0.0, -9.81);
        assert_eq!(along_gravity(&[down; 6], &down), Sign::Right);
        assert_eq!(along_gravity(&[-down; 6], &down), Sign::Reversed(-1.0));
        let mut mixed = vec![-down; 6];
        mixed.push(Vector3::x() * 20.0);
        mixed.push(Vector3::y() * 20.0);
        assert_eq!(along_gravity(&mixed, &down), Sign::Unknown);
        assert_eq!(along_gravity(&[], &down), Sign::Unknown);
    }

    #[test]
    fn a_reversed_wrench_that_explains_is_an_error() {
        let of = |ratio| confirmed(Finding::new("x", Severity::Warning, ""), ratio).severity;
        assert_eq!(of(0.59), Severity::Error);
        assert_eq!(of(0.61), Severity::Warning);
        assert_eq!(of(f64::NAN), Severity::Warning);
    }

    #[test]
    fn springs_are_negative_where_that_explains_and_not_by_chance() {
        let of = |together: f64, left: f64, signs: (usize, usize)| {
            negative(&Springs {
                together,
                left,
                signs,
            })
        };
        assert!(of(-20.0, 0.1, (3, 0)));
        assert!(!of(-5.9, 0.1, (3, 0)));
        assert!(!of(-20.0, 0.61, (3, 0)));
        assert!(!of(-20.0, 0.1, (2, 2)));
        assert!(!of(20.0, 0.1, (0, 3)));
    }
}
