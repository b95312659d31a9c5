//! Sizes: corrections that no robot needs, and residuals that no instrument has.

use super::doctor::length;
use super::finding::{Finding, Severity};
use crate::campaign::Campaign;
use crate::effects::Role;
use crate::fit::{Fit, Status};
use nalgebra::Vector3;

/// Shares of the robot's reach by which a node is moved: said from the first on, not believed from the second.
const MOVED: (f64, f64) = (0.02, 0.1);
/// The same of turns, rad.
const TURNED: (f64, f64) = (0.12, 0.5);
/// Deviations by which a correction must differ from zero.
const SURE: f64 = 5.0;
/// No robot repeats to this share of the size of its workspace: a tenth of what the best do.
const TOO_GOOD: f64 = 2e-7;

/// How bad a correction is: its size, and those from which on it is said and not believed.
pub fn severity(size: f64, limits: (f64, f64)) -> Option<Severity> {
    match size.abs() {
        size if size >= limits.1 => Some(Severity::Error),
        size if size >= limits.0 => Some(Severity::Warning),
        _ => None,
    }
}

/// Corrections of geometry far beyond what robots have, after a fit.
pub fn findings(campaign: &Campaign, fit: &Fit) -> Vec<Finding> {
    let reach = reach(campaign);
    let mut worst: Option<(f64, Severity, String)> = None;
    for (k, (effect, parameter)) in fit.model.parameters().enumerate() {
        let sure = fit.std[k].is_some_and(|std| fit.values[k].abs() > SURE * std);
        if ![Some(Role::Geometry), Some(Role::Offset)].contains(&parameter.role)
            || fit.status[k] != Status::Estimated
            || !sure
        {
            continue;
        }
        let (size, said, limits) = match parameter.unit.as_str() {
            "m" => (fit.values[k] / reach, length(fit.values[k]), MOVED),
            _ => (
                fit.values[k],
                format!("{:.1}°", fit.values[k].to_degrees()),
                TURNED,
            ),
        };
        let Some(severity) = severity(size, limits) else {
            continue;
        };
        let share = size.abs() / limits.0;
        if worst.as_ref().is_none_or(|(most, _, _)| share > *most) {
            worst = Some((
                share,
                severity,
                format!("{effect} {} {said}", parameter.name),
            ));
        }
    }
    let Some((_, severity, which)) = worst else {
        return Vec::new();
    };
    vec![
        Finding::new(
            "large_correction",
            severity,
            format!("the fit moves the robot farther than robots are off: {which}"),
        )
        .because(format!("the robot reaches {}", length(reach)))
        .remedy(
            "compare the robot file with the robot: another convention of DH, another zero or sign of a joint, another tool?",
        ),
    ]
}

/// Length of the longest chain from the base to a target, m.
fn reach(campaign: &Campaign) -> f64 {
    let robot = &campaign.robot;
    let of = |target: &crate::campaign::Target| -> f64 {
        let link = &robot.links[target.link];
        let chain = robot.chain(link.body);
        let joints = chain
            .iter()
            .map(|&j| robot.joints[j].parent_from_joint.translation.vector);
        joints
            .chain([link.body_from_link.translation.vector])
            .map(|step: Vector3<f64>| step.norm())
            .sum()
    };
    campaign.targets.iter().map(of).fold(1e-3, f64::max)
}

/// Residuals below what any instrument gives.
pub fn too_good(sigma: f64, spread: f64) -> Option<Finding> {
    (sigma < TOO_GOOD * spread).then(|| {
        Finding::new(
            "too_good",
            Severity::Warning,
            "the positions agree with the model better than any robot repeats: they were computed, not measured",
        )
        .because(format!(
            "{:.1e} m left in a coordinate, of positions that spread over {}",
            sigma,
            length(spread)
        ))
        .remedy("use the readings of the instrument, not positions computed from the joints")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centimetres_of_a_metre_are_said_and_decimetres_not_believed() {
        for (size, limits, expected) in [
            (0.019, MOVED, None),
            (-0.021, MOVED, Some(Severity::Warning)),
            (0.11, MOVED, Some(Severity::Error)),
            (0.11, TURNED, None),
            (-0.175, TURNED, Some(Severity::Warning)),
            (0.6, TURNED, Some(Severity::Error)),
        ] {
            assert_eq!(severity(size, limits), expected, "{size}");
        }
    }

    #[test]
    fn no_robot_repeats_to_a_fifth_of_a_micrometre_in_a_metre() {
        assert!(too_good(1e-7, 1.0).is_some());
        assert!(too_good(3e-7, 1.0).is_none());
        assert!(too_good(3e-7, 2.0).is_some());
    }
}
