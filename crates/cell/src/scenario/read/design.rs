//! `[design]` of a scenario: its keys, and what they may be.

use crate::scenario::design::{Design, DesignLoad, WarmUp};
use crate::setup::Setup;
use crate::space::Space;
use nalgebra::Vector3;
use serde::Deserialize;

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DesignEntry {
    poses: usize,
    #[serde(default)]
    heldout_poses: usize,
    #[serde(default)]
    loads: Vec<LoadEntry>,
    #[serde(default = "one")]
    directions: usize,
    #[serde(default = "one")]
    repeats: usize,
    #[serde(default)]
    order: Order,
    #[serde(default = "tenth")]
    margin: f64,
    #[serde(default)]
    least_height_m: f64,
    #[serde(default)]
    fixed_rad: toml::map::Map<String, toml::Value>,
    temperature: Option<WarmUpEntry>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
struct WarmUpEntry {
    #[serde(default = "twenty")]
    start_degC: f64,
    warm_up_K: f64,
    warm_up_s: f64,
}

#[derive(Debug, Deserialize, Default)]
#[serde(rename_all = "snake_case")]
enum Order {
    #[default]
    Random,
    PoseByPose,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
struct LoadEntry {
    #[serde(default)]
    mass_kg: f64,
    #[serde(default)]
    com_m: [f64; 3],
    #[serde(default)]
    pull_N: [f64; 3],
}

fn one() -> usize {
    1
}

fn twenty() -> f64 {
    20.0
}

fn tenth() -> f64 {
    0.1
}

impl DesignEntry {
    /// The design on this robot.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub(super) fn design(&self, setup: &Setup) -> Result<Design, String> {
        check(self.poses >= 1, "poses is 0; accepted: 1 or more")?;
        check(
            self.heldout_poses < self.poses,
            "heldout_poses leaves nothing to fit; accepted: fewer than poses",
        )?;
        check(
            matches!(self.directions, 1 | 2),
            "directions: accepted are 1 and 2",
        )?;
        check(self.repeats >= 1, "repeats is 0; accepted: 1 or more")?;
        check(
            (0.0..0.5).contains(&self.margin),
            "margin: accepted are shares of a joint's range from 0 to below 0.5",
        )?;
        check(
            self.least_height_m.is_finite(),
            "least_height_m: accepted are finite numbers",
        )?;
        Ok(Design {
            poses: self.poses,
            heldout: self.heldout_poses,
            more: Vec::new(),
            loads: self.loads()?,
            directions: self.directions,
            repeats: self.repeats,
            random_order: matches!(self.order, Order::Random),
            temperature: self
                .temperature
                .as_ref()
                .map(WarmUpEntry::settle)
                .transpose()?,
            space: self.space(setup)?,
        })
    }

    fn loads(&self) -> Result<Vec<DesignLoad>, String> {
        if self.loads.is_empty() {
            return Ok(vec![DesignLoad::default()]);
        }
        let loads = self.loads.iter().map(|load| {
            let numbers = load.com_m.iter().chain(&load.pull_N).chain([&load.mass_kg]);
            check(
                numbers.clone().all(|x| x.is_finite()) && load.mass_kg >= 0.0,
                "loads: accepted are finite numbers and masses of 0 or more",
            )?;
            Ok(DesignLoad {
                mass: load.mass_kg,
                com: Vector3::from(load.com_m),
                pull: Vector3::from(load.pull_N),
            })
        });
        loads.collect()
    }

    /// Where postures may be: within limits, above the least height, with some joints at fixed angles.
    fn space(&self, setup: &Setup) -> Result<Space, String> {
        let mut space = Space::within_limits(&setup.robot, self.margin);
        space.least_height = self.least_height_m;
        for (name, value) in &self.fixed_rad {
            let Some(joint) = setup.robot.joint(name) else {
                let known: Vec<&str> = setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
                return Err(format!(
                    "[design.fixed_rad] no joint is called \"{name}\"; known: {}",
                    known.join(", ")
                ));
            };
            let angle = value.as_float().or(value.as_integer().map(|i| i as f64));
            match angle.filter(|x| x.is_finite()) {
                Some(angle) => space.ranges[joint] = (angle, angle),
                None => {
                    return Err(format!(
                        "[design.fixed_rad] {name} is {value}; accepted: a finite number"
                    ));
                }
            }
        }
        Ok(space)
    }
}

impl WarmUpEntry {
    fn settle(&self) -> Result<WarmUp, String> {
        let (start, rise, time) = (self.start_degC, self.warm_up_K, self.warm_up_s);
        check(
            start.is_finite() && rise.is_finite() && time.is_finite() && time > 0.0,
            "temperature: accepted are finite start_degC and warm_up_K, and warm_up_s above 0",
        )?;
        Ok(WarmUp { start, rise, time })
    }
}

fn check(good: bool, message: &str) -> Result<(), String> {
    match good {
        true => Ok(()),
        false => Err(format!("[design] {message}")),
    }
}
