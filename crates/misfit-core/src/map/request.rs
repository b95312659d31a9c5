//! `[map]` of a scenario and the options of `misfit map`: which map is wanted.

use crate::campaign::Payload;
use crate::setup::Setup;
use crate::space::Space;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Points of a map at most.
const MOST_POINTS: usize = 1_000_000;

/// `[map]` of a scenario, and what the command line says besides.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// Targets; all if left out.
    pub targets: Option<Vec<String>>,
    /// Axes of the base frame, two for a slice or three for a volume: `xz` if left out.
    pub plane: Option<String>,
    /// Where a slice lies on the third axis, m; through the posture of reference if left out.
    pub at_m: Option<f64>,
    /// Least and greatest along each axis, m; all that the arm can reach if left out.
    pub range_m: Option<Vec<[f64; 2]>>,
    /// Points, about.
    pub points: Option<usize>,
    /// Who tells: model, plant, or both.
    pub by: Option<Vec<By>>,
    /// Model, as for `[compensate]`.
    pub model: Option<String>,
    /// Which error.
    #[serde(default)]
    pub error: Which,
    /// Hold the orientation that the posture of reference has? Else any will do.
    #[serde(default)]
    pub hold_orientation: bool,
    /// Posture of reference: rad (m) by joint; joints left out stand in the middle of their ranges.
    #[serde(default)]
    pub posture_rad: BTreeMap<String, f64>,
}

/// Who tells how far the arm is off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// The model.
    Model,
    /// MuJoCo.
    Plant,
}

/// Which error is mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Which {
    /// What the load does: loaded against not loaded.
    #[default]
    Load,
    /// All: loaded against the nominal robot.
    Total,
}

impl By {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            By::Model => "the model",
            By::Plant => "MuJoCo",
        }
    }
}

impl Which {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            Which::Load => "deflection",
            Which::Total => "error",
        }
    }
}

impl Request {
    /// Refuses what makes no sense for a robot.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, setup: &Setup) -> Result<(), String> {
        self.targets(setup)?;
        let axes = self.axes()?;
        let wrong = |what: String| Err(format!("[map] {what}"));
        if let Some(at) = self.at_m {
            if axes.len() == 3 {
                return wrong(
                    "at_m is of a slice, but plane names all three axes; leave it out".to_owned(),
                );
            }
            if !(-100.0..=100.0).contains(&at) {
                return wrong(format!("at_m is {at}; accepted: -100 to 100"));
            }
        }
        if let Some(ranges) = &self.range_m {
            let good = |range: &[f64; 2]| {
                range.iter().all(|x| x.abs() <= 100.0) && range[1] - range[0] >= 1e-3
            };
            if ranges.len() != axes.len() || !ranges.iter().all(good) {
                return wrong(format!(
                    "range_m is {ranges:?}; accepted: {} pairs [least, greatest] in m, -100 to 100, at least 1 mm apart",
                    axes.len()
                ));
            }
        }
        if let Some(points) = self.points
            && !(4..=MOST_POINTS).contains(&points)
        {
            return wrong(format!("points is {points}; accepted: 4 to {MOST_POINTS}"));
        }
        let by = self.tellers();
        if by.is_empty() || (by.len() > 1 && by[1..].contains(&by[0])) || by.len() > 2 {
            return wrong("by: accepted are \"model\", \"plant\", each once".to_owned());
        }
        for (name, angle) in &self.posture_rad {
            if setup.robot.joint(name).is_none() {
                let known: Vec<&str> = setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
                return wrong(format!(
                    "posture_rad: no joint is called \"{name}\"; known: {}",
                    known.join(", ")
                ));
            }
            let joint = setup.robot.joints.iter().find(|joint| joint.name == *name);
            let (least, most) = joint.and_then(|j| j.limits).unwrap_or((-1e3, 1e3));
            if !(least..=most).contains(angle) {
                return wrong(format!(
                    "posture_rad: {name} is {angle}; accepted: {least} to {most}"
                ));
            }
        }
        Ok(())
    }

    /// Refuses a load that does nothing where what it does is wanted.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_load(&self, load: &Payload) -> Result<(), String> {
        if load.mass == 0.0 && self.error == Which::Load {
            return Err(
                "[map] the load is 0 kg: there is no deflection; accepted: a load, or error = \"total\"".to_owned(),
            );
        }
        Ok(())
    }

    /// Targets by index.
    ///
    /// # Errors
    /// For a name that no target has, and one that stands there twice.
    pub fn targets(&self, setup: &Setup) -> Result<Vec<usize>, String> {
        let Some(names) = &self.targets else {
            return Ok((0..setup.targets.len()).collect());
        };
        let known = || {
            let names: Vec<&str> = setup.targets.iter().map(|t| t.name.as_str()).collect();
            names.join(", ")
        };
        if names.is_empty() {
            return Err(format!("[map] targets is empty; accepted: {}", known()));
        }
        let find = |name: &String| {
            let found = setup.targets.iter().position(|t| t.name == *name);
            found.ok_or_else(|| format!("[map] no target is called \"{name}\"; known: {}", known()))
        };
        let found: Vec<usize> = names.iter().map(find).collect::<Result<_, _>>()?;
        match (1..found.len()).find(|&k| found[..k].contains(&found[k])) {
            Some(k) => Err(format!(
                "[map] targets has \"{}\" twice; accepted: each once",
                names[k]
            )),
            None => Ok(found),
        }
    }

    /// Who tells; the plant if nothing is said.
    pub fn tellers(&self) -> Vec<By> {
        self.by.clone().unwrap_or_else(|| vec![By::Plant])
    }

    /// Axes by index.
    pub(super) fn axes(&self) -> Result<Vec<usize>, String> {
        let plane = self.plane.as_deref().unwrap_or("xz");
        let found: Option<Vec<usize>> = plane.chars().map(|c| "xyz".find(c)).collect();
        let distinct = |axes: &[usize]| (1..axes.len()).all(|k| !axes[..k].contains(&axes[k]));
        match found {
            Some(axes) if matches!(axes.len(), 2 | 3) && distinct(&axes) => Ok(axes),
            _ => Err(format!(
                "[map] plane is \"{plane}\"; accepted: two axes of the base frame for a slice, such as xz, or xyz for a volume"
            )),
        }
    }

    /// The posture of reference, by joint of the robot, rad (m).
    pub fn posture(&self, setup: &Setup, space: &Space) -> Vec<f64> {
        let joints = setup.robot.joints.iter().zip(&space.ranges);
        joints
            .map(|(joint, (least, most))| {
                let told = self.posture_rad.get(&joint.name).copied();
                told.unwrap_or((least + most) / 2.0)
            })
            .collect()
    }
}
