//! A tool as a scenario has it: whose target it is, and what hangs there.

use super::design::DesignLoad;
use crate::setup::Setup;
use nalgebra::Vector3;
use serde::Deserialize;

/// A dead weight on the target's link.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tool {
    /// kg.
    #[serde(default)]
    pub mass_kg: f64,
    /// Its centre in the target link's frame, m.
    #[serde(default)]
    pub com_m: [f64; 3],
}

impl Tool {
    /// Refuses what is no mass. `key` is what messages call it.
    pub(super) fn check(&self, key: &str) -> Result<(), String> {
        let is_mass = self.mass_kg >= 0.0 && self.mass_kg.is_finite();
        match is_mass && self.com_m.iter().all(|x| x.is_finite()) {
            true => Ok(()),
            false => Err(format!(
                "{key}: accepted are a finite mass_kg of 0 or more and a finite com_m"
            )),
        }
    }

    pub(super) fn load(&self) -> DesignLoad {
        DesignLoad {
            mass: self.mass_kg,
            com: Vector3::from(self.com_m),
            pull: Vector3::zeros(),
        }
    }
}

/// Refuses a name that no target has. `key` is what messages call it.
pub(super) fn check_target(key: &str, name: &str, setup: &Setup) -> Result<(), String> {
    if setup.targets.iter().any(|target| target.name == name) {
        return Ok(());
    }
    let known: Vec<&str> = setup.targets.iter().map(|t| t.name.as_str()).collect();
    Err(format!(
        "{key} = \"{name}\" is no target; known: {}",
        known.join(", ")
    ))
}
