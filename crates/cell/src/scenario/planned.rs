//! A scenario as the ground of a plan: how its design measures, in a campaign that was not yet taken.

use super::{Scenario, ScenarioError, simulate};
use crate::campaign::Campaign;
use crate::plan::Protocol;
use nalgebra::Vector3;

/// How the scenario's design measures each pose, and a campaign with the readings of one pose: what a model needs to
/// know of readings that are still to be taken.
///
/// # Errors
/// For designs with pulls, whose loads only the wrist sensor knows, and for scenarios without noise.
pub fn planned(scenario: &Scenario) -> Result<(Protocol, Campaign), ScenarioError> {
    let design = &scenario.design;
    if design
        .loads
        .iter()
        .any(|load| load.pull != Vector3::zeros())
    {
        return Err(scenario.form_error(
            "[design] loads: a plan knows dead weights alone; accepted: loads without pull_N",
        ));
    }
    if scenario.noise.position <= 0.0 {
        return Err(scenario.form_error(
            "[noise] position_m is 0: what is worth measuring depends on the noise; accepted: above 0",
        ));
    }
    let protocol = Protocol {
        targets: (0..scenario.setup.targets.len()).collect(),
        loads: design
            .loads
            .iter()
            .map(|load| Some(load.payload()))
            .collect(),
        directions: match design.directions {
            1 => vec![None],
            _ => vec![Some(-1.0), Some(1.0)],
        },
        repeats: design.repeats,
        orientation: true,
        wrench: scenario.wrench,
    };
    let readings = protocol.readings(&vec![0.0; scenario.setup.robot.joints.len()]);
    Ok((protocol, simulate::campaign(scenario, readings)))
}
