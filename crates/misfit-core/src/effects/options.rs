//! Options that effects share.

use crate::setup::Setup;
use serde::Deserialize;
use std::collections::BTreeMap;

/// Most numbers of an option for one joint; each makes parameters of its own.
const MOST_NUMBERS: usize = 100;

/// Numbers that an option holds for a joint.
pub trait Numbers {
    /// All of them.
    fn numbers(&self) -> &[f64];
}

impl Numbers for f64 {
    fn numbers(&self) -> &[f64] {
        std::slice::from_ref(self)
    }
}

/// One number, or a list.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum List {
    /// One.
    One(f64),
    /// Several.
    Several(Vec<f64>),
}

impl Numbers for List {
    fn numbers(&self) -> &[f64] {
        match self {
            List::One(number) => std::slice::from_ref(number),
            List::Several(numbers) => numbers,
        }
    }
}

/// The same for all joints, or a table by joint.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum PerJoint<T = f64> {
    /// The same for all.
    All(T),
    /// By name.
    Each(BTreeMap<String, T>),
}

impl<T: Numbers> PerJoint<T> {
    /// What is given for a joint.
    pub fn of(&self, joint: &str) -> Option<&T> {
        match self {
            PerJoint::All(numbers) => Some(numbers),
            PerJoint::Each(numbers) => numbers.get(joint),
        }
    }

    /// Refuses numbers that are not above zero or stand twice, and names of joints that do not exist.
    ///
    /// # Errors
    /// With the option's name, what was found and what is accepted.
    pub fn check(given: Option<&Self>, option: &str, setup: &Setup) -> Result<(), String> {
        match given {
            None => Ok(()),
            Some(PerJoint::All(numbers)) => positive(option, numbers),
            Some(PerJoint::Each(each)) => {
                for (name, numbers) in each {
                    if setup.robot.joint(name).is_none() {
                        let known: Vec<&str> =
                            setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
                        return Err(format!(
                            "{option} names the joint \"{name}\"; known: {}",
                            known.join(", ")
                        ));
                    }
                    positive(&format!("{option} of {name}"), numbers)?;
                }
                Ok(())
            }
        }
    }
}

fn positive(what: &str, given: &impl Numbers) -> Result<(), String> {
    let numbers = given.numbers();
    if numbers.len() > MOST_NUMBERS {
        return Err(format!(
            "{what} names {} numbers; accepted: at most {MOST_NUMBERS}",
            numbers.len()
        ));
    }
    for (place, number) in numbers.iter().enumerate() {
        if !(number.is_finite() && *number > 0.0) {
            return Err(format!("{what} is {number}; accepted: numbers above 0"));
        }
        if numbers[..place].contains(number) {
            return Err(format!("{what} names {number} twice; accepted: each once"));
        }
    }
    Ok(())
}
