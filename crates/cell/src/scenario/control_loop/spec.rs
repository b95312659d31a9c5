//! `[loop]` of a scenario: what is held, what pulls, which filters and models correct.

use super::super::design::DesignLoad;
use super::super::pull::Pull;
use crate::compensation::filter::Law;
use crate::setup::Setup;
use crate::space::Space;
use nalgebra::Vector3;
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};

/// Ticks of all runs at most, so that a slip of the pen is no day's work.
const MOST_TICKS: usize = 1_000_000;

/// `[loop]` of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlLoop {
    /// Ticks a second.
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

/// `[[loop.filter]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterEntry {
    /// What it is.
    pub kind: FilterKind,
    /// Of a moving average, s.
    pub window_s: Option<f64>,
    /// Of a low pass, -3 dB, Hz.
    pub cutoff_hz: Option<f64>,
    /// Of a low pass: 1, or 2 (Butterworth; if left out).
    pub order: Option<usize>,
    /// Foresee the load of the moment at which the command acts?
    #[serde(default)]
    pub predict: bool,
}

/// What a filter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// The measured wrench as it is.
    None,
    /// The mean of a window.
    MovingAverage,
    /// A low pass of first or second order.
    LowPass,
}

impl FilterEntry {
    /// Its name in reports and expectations: `none`, `moving average 40 ms`, `low pass 8 Hz, order 2, predicted`.
    pub fn name(&self) -> String {
        let mut name = match self.kind {
            FilterKind::None => "none".to_owned(),
            FilterKind::MovingAverage => {
                let window = self.window_s.unwrap_or_default() * 1e3;
                // seven digits: what a decimal fraction times 1000 is meant to be
                format!("moving average {} ms", (window * 1e4).round() / 1e4)
            }
            FilterKind::LowPass => {
                let cutoff = self.cutoff_hz.map(|cutoff| format!(" {cutoff} Hz"));
                format!(
                    "low pass{}, order {}",
                    cutoff.unwrap_or_default(),
                    self.order.unwrap_or(2)
                )
            }
        };
        if self.predict {
            name += ", predicted";
        }
        name
    }

    /// The filter at a rate, Hz. A command acts a tick after its measurement: this is foreseen besides the filter's own
    /// delay. `key` is what messages call it.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn law(&self, key: &str, rate: f64) -> Result<Law, String> {
        let wrong = |what: String| Err(format!("{key} {}: {what}", self.name()));
        let foreign = match self.kind {
            FilterKind::None => [
                ("window_s", self.window_s.is_some()),
                ("cutoff_hz", self.cutoff_hz.is_some()),
                ("order", self.order.is_some()),
            ],
            FilterKind::MovingAverage => [
                ("cutoff_hz", self.cutoff_hz.is_some()),
                ("order", self.order.is_some()),
                ("", false),
            ],
            FilterKind::LowPass => [
                ("window_s", self.window_s.is_some()),
                ("", false),
                ("", false),
            ],
        };
        if let Some((key, _)) = foreign.iter().find(|(_, given)| *given) {
            return wrong(format!("{key} is of another kind of filter; leave it out"));
        }
        let law = match self.kind {
            FilterKind::None => Law::none(),
            FilterKind::MovingAverage => {
                let Some(window) = self.window_s else {
                    return wrong(
                        "window_s is missing; accepted: the window's length, s".to_owned(),
                    );
                };
                let ticks = (window * rate).round();
                if !(1.0..=MOST_TICKS as f64).contains(&ticks) {
                    return wrong(format!(
                        "window_s = {window} holds {ticks} ticks; accepted: 1 to {MOST_TICKS}"
                    ));
                }
                Law::moving_average(ticks as usize)
            }
            FilterKind::LowPass => {
                let Some(cutoff) = self.cutoff_hz else {
                    return wrong("cutoff_hz is missing; accepted: its -3 dB, Hz".to_owned());
                };
                let (least, most) = (rate * 1e-4, rate * 0.45);
                if !(least..=most).contains(&cutoff) {
                    return wrong(format!(
                        "cutoff_hz is {cutoff}; accepted at rate_hz = {rate}: {least} to {most}"
                    ));
                }
                match self.order.unwrap_or(2) {
                    1 => Law::first_order(cutoff / rate),
                    2 => Law::second_order(cutoff / rate),
                    other => return wrong(format!("order is {other}; accepted: 1, 2")),
                }
            }
        };
        Ok(match self.predict {
            true => law.foreseeing(1.0),
            false => law,
        })
    }
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
        if let Some(name) = &self.target
            && !setup.targets.iter().any(|target| target.name == *name)
        {
            let known: Vec<&str> = setup.targets.iter().map(|t| t.name.as_str()).collect();
            return wrong(format!(
                "target = \"{name}\" is no target; known: {}",
                known.join(", ")
            ));
        }
        match (self.poses, &self.posture_rad) {
            (Some(1..=MOST_TICKS), None) => {}
            (None, Some(posture)) => check_posture(posture, setup)?,
            (Some(poses), None) => {
                return wrong(format!("poses is {poses}; accepted: 1 to {MOST_TICKS}"));
            }
            _ => {
                return wrong(
                    "accepted: either poses = N (random ones) or posture_rad = { joint = angle }"
                        .to_owned(),
                );
            }
        }
        let tool = &self.payload;
        if !(tool.mass_kg >= 0.0 && tool.mass_kg.is_finite())
            || tool.com_m.iter().any(|x| !x.is_finite())
        {
            return wrong(
                "payload: accepted are a finite mass_kg of 0 or more and a finite com_m".to_owned(),
            );
        }
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
        if all > MOST_TICKS as f64 {
            return wrong(format!(
                "asks for {all} ticks: duration_s × rate_hz, by pose, filter and model; accepted: at most {MOST_TICKS}"
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

    pub(super) fn tool(&self) -> DesignLoad {
        DesignLoad {
            mass: self.payload.mass_kg,
            com: Vector3::from(self.payload.com_m),
            pull: Vector3::zeros(),
        }
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
