//! Options that effects share.

use crate::setup::Setup;
use serde::Deserialize;
use std::collections::BTreeMap;

/// One number for all joints, or a table by joint.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PerJoint {
    /// The same for all.
    All(f64),
    /// By name; the others have the effect's default.
    Each(BTreeMap<String, f64>),
}

impl PerJoint {
    /// The number of a joint, if one is given.
    pub fn of(&self, joint: &str) -> Option<f64> {
        match self {
            PerJoint::All(number) => Some(*number),
            PerJoint::Each(numbers) => numbers.get(joint).copied(),
        }
    }

    /// Refuses numbers that are not above zero, and names of joints that do not exist.
    ///
    /// # Errors
    /// With the option's name, what was found and what is accepted.
    pub fn check(given: Option<&Self>, option: &str, setup: &Setup) -> Result<(), String> {
        let good = |number: f64| number.is_finite() && number > 0.0;
        let refuse = |what: String| Err(format!("{option} {what}; accepted: numbers above 0"));
        match given {
            Some(PerJoint::All(number)) if !good(*number) => refuse(format!("is {number}")),
            Some(PerJoint::Each(numbers)) => {
                for (name, &number) in numbers {
                    if setup.robot.joint(name).is_none() {
                        let known: Vec<&str> =
                            setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
                        return Err(format!(
                            "{option} names the joint \"{name}\"; known: {}",
                            known.join(", ")
                        ));
                    }
                    if !good(number) {
                        return refuse(format!("of {name} is {number}"));
                    }
                }
                Ok(())
            }
            _ => Ok(()),
        }
    }
}
