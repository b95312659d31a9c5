//! A limits file: where the arm may be measured.
//!
//! ```toml
//! margin = 0.05              # share of each joint's range left free at either end
//! least_height_m = 0.2       # of the targets above the base
//! [fixed]
//! torso_deg = 0
//! [limits]                   # narrower than the robot's own
//! r1_s_deg = [-60, 90]
//! [[forbidden]]              # postures with all of these at once
//! r1_l_deg = [-110, -60]
//! r1_e_rad = [1.0, 2.9]
//! ```

use crate::campaign::to_inner;
use crate::input::{self, InputError, LARGEST_TOML};
use crate::robot::{JointKind, Robot};
use crate::space::{Region, Space};
use serde::Deserialize;
use std::path::Path;
use toml::Value;

/// Why a limits file says nothing useful.
#[derive(Debug, thiserror::Error)]
pub enum LimitsError {
    /// The file cannot be read.
    #[error("{file}: cannot be read: {source}")]
    Read {
        /// The file.
        file: String,
        /// Reason.
        source: InputError,
    },
    /// Not of this form.
    #[error("{file}: {message}")]
    Form {
        /// The file.
        file: String,
        /// What is wrong, where, and what is accepted.
        message: String,
    },
}

/// What a limits file says; what it leaves out stays as it is.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    margin: Option<f64>,
    least_height_m: Option<f64>,
    #[serde(default)]
    fixed: toml::Table,
    #[serde(default)]
    limits: toml::Table,
    #[serde(default)]
    forbidden: Vec<toml::Table>,
}

impl Limits {
    /// Reads a limits file into a space.
    ///
    /// # Errors
    /// Whatever does not fit the format, with file and key, what was found and what is accepted.
    pub fn load(path: &Path, robot: &Robot, space: &mut Space) -> Result<(), LimitsError> {
        let file = path.display().to_string();
        let text = input::text(path, LARGEST_TOML).map_err(|source| LimitsError::Read {
            file: file.clone(),
            source,
        })?;
        let form = |message: String| LimitsError::Form {
            file: file.clone(),
            message,
        };
        let read: Self = input::toml(&text).map_err(form)?;
        read.apply(robot, space).map_err(form)
    }

    /// Puts what the file says into a space.
    fn apply(&self, robot: &Robot, space: &mut Space) -> Result<(), String> {
        if let Some(margin) = self.margin {
            if !(0.0..0.5).contains(&margin) {
                return Err(format!(
                    "margin is {margin}; accepted: shares of a joint's range from 0 to below 0.5"
                ));
            }
            let whole = Space::within_limits(robot, margin);
            let ranges = space.ranges.iter_mut().zip(whole.ranges);
            for (range, new) in ranges.filter(|(range, _)| range.0 < range.1) {
                *range = new;
            }
        }
        if let Some(height) = self.least_height_m {
            if !height.is_finite() {
                return Err(format!(
                    "least_height_m is {height}; accepted: finite numbers"
                ));
            }
            space.least_height = height;
        }
        for (key, value) in &self.limits {
            let place = format!("[limits] {key}");
            let (joint, [lower, upper]) = range(robot, &place, key, value)?;
            // a margin is for the robot's limits; these are meant as they stand
            let (least, greatest) = robot.joints[joint].limits.unwrap_or((lower, upper));
            if lower < least || upper > greatest {
                return Err(format!(
                    "{place} = {value}; accepted: a range within the robot's own, {least:.4} to {greatest:.4}"
                ));
            }
            space.ranges[joint] = (lower, upper);
        }
        for (key, value) in &self.fixed {
            let place = format!("[fixed] {key}");
            let (joint, unit) = joint(robot, &place, key)?;
            let angle = number(value).map(unit).filter(|x| x.is_finite());
            let angle =
                angle.ok_or_else(|| format!("{place} = {value}; accepted: a finite number"))?;
            space.ranges[joint] = (angle, angle);
        }
        for (index, table) in self.forbidden.iter().enumerate() {
            let mut region = Region::new();
            for (key, value) in table {
                let place = format!("[[forbidden]] number {}, {key}", index + 1);
                let (joint, [lower, upper]) = range(robot, &place, key, value)?;
                region.push((joint, lower, upper));
            }
            if region.is_empty() {
                return Err(format!(
                    "[[forbidden]] number {} is empty and would forbid everything; accepted: ranges of joints",
                    index + 1
                ));
            }
            space.forbidden.push(region);
        }
        Ok(())
    }
}

fn number(value: &Value) -> Option<f64> {
    value.as_float().or(value.as_integer().map(|i| i as f64))
}

/// From the unit of a key to rad or m.
type ToInner = fn(f64) -> f64;

/// The joint that a key names, and the way from its unit to rad or m.
fn joint(robot: &Robot, place: &str, key: &str) -> Result<(usize, ToInner), String> {
    let split = key.rsplit_once('_');
    let found = split.and_then(|(name, unit)| {
        let joint = robot.joint(name)?;
        let slides = robot.joints[joint].kind == JointKind::Prismatic;
        Some((joint, to_inner(unit, slides)?))
    });
    found.ok_or_else(|| {
        let names: Vec<&str> = robot.joints.iter().map(|j| j.name.as_str()).collect();
        format!(
            "{place}: accepted are joints with their unit, <joint>_deg or <joint>_rad (_mm or _m where one slides): {}",
            names.join(", ")
        )
    })
}

/// A joint and its range, rad or m.
fn range(
    robot: &Robot,
    place: &str,
    key: &str,
    value: &Value,
) -> Result<(usize, [f64; 2]), String> {
    let (joint, unit) = joint(robot, place, key)?;
    let ends: Option<Vec<f64>> = value
        .as_array()
        .and_then(|items| items.iter().map(|item| number(item).map(unit)).collect());
    match ends.as_deref() {
        Some(&[lower, upper]) if lower.is_finite() && upper.is_finite() && lower <= upper => {
            Ok((joint, [lower, upper]))
        }
        _ => Err(format!(
            "{place} = {value}; accepted: [least, greatest], two finite numbers"
        )),
    }
}
