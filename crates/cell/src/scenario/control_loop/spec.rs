//! `[loop]` of a scenario: what is held, what pulls, which filters and models correct.

use super::super::pull::Pull;
use super::super::tool::{Tool, check_target};
use super::filter::FilterEntry;
use crate::setup::Setup;
use crate::space::Space;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};

/// Ticks of all runs: a typing error must not cost a day.
const MAX_TICKS: usize = 1_000_000;

/// `[loop]` of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlLoop {
    /// Ticks per second.
    pub rate_hz: f64,
    /// How long each pose is held, s.
    pub duration_s: f64,
    /// Name of the target that is held; the first if left out.
    pub target: Option<String>,
    /// Random postures whose poses are held.
    pub poses: Option<usize>,
    /// Or the pose of this posture: rad (m) by joint, zero for joints left out.
    pub posture_rad: Option<BTreeMap<String, f64>>,
    /// The tool: a dead weight that is known before.
    #[serde(default)]
    pub payload: Tool,
    /// What pulls besides.
    #[serde(default, rename = "pull")]
    pub pulls: Vec<Pull>,
    /// Models that correct, as for `[compensate]`.
    #[serde(default = "default_models")]
    pub models: Vec<String>,
    /// Filters, each a run of its own.
    #[serde(default, rename = "filter")]
    pub filters: Vec<FilterEntry>,
}

fn default_models() -> Vec<String> {
    vec!["default".to_owned()]
}

impl ControlLoop {
    /// Refuses what makes no sense for a robot.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, setup: &Setup) -> Result<(), String> {
        let wrong = |what: String| Err(format!("[loop] {what}"));
        if !(self.rate_hz > 0.0 && self.rate_hz <= 1e5) {
            return wrong(format!(
                "rate_hz is {}; accepted: above 0, up to 100000",
                self.rate_hz
            ));
        }
        if !(self.duration_s * self.rate_hz >= 2.0 && self.duration_s.is_finite()) {
            return wrong(format!(
                "duration_s is {}; accepted: two ticks of 1 / rate_hz or more",
                self.duration_s
            ));
        }
        if let Some(name) = &self.target {
            check_target("[loop] target", name, setup)?;
        }
        match (self.poses, &self.posture_rad) {
            (Some(1..=MAX_TICKS), None) => {}
            (None, Some(posture)) => check_posture(posture, setup)?,
            (Some(poses), None) => {
                return wrong(format!("poses is {poses}; accepted: 1 to {MAX_TICKS}"));
            }
            _ => {
                return wrong(
                    "accepted: either poses = N (random ones) or posture_rad = { joint = angle }"
                        .to_owned(),
                );
            }
        }
        self.payload.check("[loop] payload")?;
        self.pulls.iter().try_for_each(Pull::check)?;
        let fast = |pull: &&Pull| pull.frequency_hz.is_some_and(|f| f >= self.rate_hz / 2.0);
        if let Some(pull) = self.pulls.iter().find(fast) {
            return Err(format!(
                "[[loop.pull]] frequency_hz is {}; accepted: below half of rate_hz, {}",
                pull.frequency_hz.unwrap_or_default(),
                self.rate_hz / 2.0
            ));
        }
        if (1..self.models.len()).any(|k| self.models[..k].contains(&self.models[k])) {
            return wrong("models has one of them twice; accepted: each once".to_owned());
        }
        if self.models.is_empty() {
            return wrong(
                "models is empty; accepted: \"default\", \"true\", words as for --effects"
                    .to_owned(),
            );
        }
        if self.filters.is_empty() {
            return wrong("has no [[loop.filter]]; accepted: one or more, kind = \"none\" for the measured wrench as it is".to_owned());
        }
        let mut names = BTreeSet::new();
        for filter in &self.filters {
            filter.law("[[loop.filter]]", self.rate_hz)?;
            if !names.insert(filter.name()) {
                return Err(format!(
                    "[[loop.filter]] {} stands there twice",
                    filter.name()
                ));
            }
        }
        let runs = self.poses.unwrap_or(1) * self.filters.len() * self.models.len();
        let all = self.duration_s * self.rate_hz * runs as f64;
        if all > MAX_TICKS as f64 {
            return wrong(format!(
                "asks for {all} ticks: duration_s × rate_hz, by pose, filter and model; accepted: at most {MAX_TICKS}"
            ));
        }
        Ok(())
    }

    /// Ticks of one run.
    pub fn ticks(&self) -> usize {
        (self.duration_s * self.rate_hz).round() as usize
    }

    /// Index of the target that is held.
    pub fn target(&self, setup: &Setup) -> usize {
        let named = |name: &String| setup.targets.iter().position(|t| t.name == *name);
        self.target.as_ref().and_then(named).unwrap_or(0)
    }

    /// Names of the filters, in their order.
    pub fn filter_names(&self) -> Vec<String> {
        self.filters.iter().map(FilterEntry::name).collect()
    }

    /// Time of a tick, s.
    pub(super) fn time(&self, tick: usize) -> f64 {
        tick as f64 / self.rate_hz
    }
}

fn check_posture(posture: &BTreeMap<String, f64>, setup: &Setup) -> Result<(), String> {
    let ranges = Space::within_limits(&setup.robot, 0.0).ranges;
    for (name, angle) in posture {
        let Some(joint) = setup.robot.joint(name) else {
            let known: Vec<&str> = setup.robot.joints.iter().map(|j| j.name.as_str()).collect();
            return Err(format!(
                "[loop.posture_rad] no joint is called \"{name}\"; known: {}",
                known.join(", ")
            ));
        };
        let (least, most) = ranges[joint];
        if !(least..=most).contains(angle) {
            return Err(format!(
                "[loop.posture_rad] {name} is {angle}; accepted: its limits, {least} to {most}"
            ));
        }
    }
    Ok(())
}
