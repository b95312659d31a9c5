//! Of maps of the workspace.

use super::super::mapped::{Maps, agreement};
use super::{Check, Expect, Range, at_least, at_most, within};
use crate::map::{By, Request, Which};
use crate::setup::Setup;
use serde::Deserialize;

/// Expectation of the map of one target.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectMap {
    /// Target.
    pub target: String,
    /// Who tells.
    pub by: By,
    /// Range of the largest error of position, mm.
    pub position_max_mm: Option<Range>,
    /// Range of the largest error of orientation, mrad.
    pub orientation_max_mrad: Option<Range>,
    /// Largest difference from the other one's map, over the largest error.
    pub apart: Option<f64>,
    /// Least share of the points that is in reach.
    pub reached: Option<f64>,
}

impl Expect {
    /// Refuses expectations of targets and tellers that the map does not have, and those that expect nothing.
    pub(super) fn check_map(&self, map: &Request, setup: &Setup) -> Result<(), String> {
        for wanted in &self.map {
            let targets = map.targets(setup)?;
            let names: Vec<&str> = targets
                .iter()
                .map(|&target| setup.targets[target].name.as_str())
                .collect();
            if !names.contains(&wanted.target.as_str()) {
                return Err(format!(
                    "[[expect.map]] target = \"{}\"; accepted: one of those of [map]: {}",
                    wanted.target,
                    names.join(", ")
                ));
            }
            let by = map.tellers();
            if !by.contains(&wanted.by) {
                return Err(format!(
                    "[[expect.map]] {}: [map] by does not have {}",
                    wanted.target,
                    wanted.by.words()
                ));
            }
            if wanted.apart.is_some() && by.len() < 2 {
                return Err(format!(
                    "[[expect.map]] {}: apart needs both, by = [\"plant\", \"model\"] in [map]",
                    wanted.target
                ));
            }
            if wanted.apart.is_some() && map.error == Which::Total {
                return Err(format!(
                    "[[expect.map]] {}: apart is of what a load does; [map] error = \"total\" is against each one's own \
                     nominal robot",
                    wanted.target
                ));
            }
            let idle = wanted.position_max_mm.is_none()
                && wanted.orientation_max_mrad.is_none()
                && wanted.apart.is_none()
                && wanted.reached.is_none();
            if idle {
                return Err(format!(
                    "[[expect.map]] {} expects nothing; accepted: position_max_mm, orientation_max_mrad, apart, reached",
                    wanted.target
                ));
            }
        }
        Ok(())
    }
}

/// Checks the expectations of maps.
pub fn check_map(expect: &Expect, setup: &Setup, maps: &Maps) -> Vec<Check> {
    let mut checks = Vec::new();
    let agreements = agreement(setup, maps);
    for wanted in &expect.map {
        let all = maps.maps.iter().map(|map| map.summary(setup));
        let mut own = all.filter(|map| map.target == wanted.target && map.by == wanted.by);
        let Some(found) = own.next() else { continue };
        let name =
            |what: &str| format!("{what}, map of {} by {}", wanted.target, wanted.by.words());
        checks.extend(within(
            &name("largest position error, mm"),
            found.position_max_m * 1e3,
            wanted.position_max_mm,
        ));
        checks.extend(within(
            &name("largest orientation error, mrad"),
            found.orientation_max_rad * 1e3,
            wanted.orientation_max_mrad,
        ));
        let pair = agreements.iter().find(|a| a.target == wanted.target);
        checks.extend(at_most(
            &name("model and MuJoCo apart, over the largest"),
            pair.map_or(f64::NAN, |pair| pair.relative),
            wanted.apart,
        ));
        checks.extend(at_least(
            &name("share of points in reach"),
            found.reached as f64 / found.points as f64,
            wanted.reached,
        ));
    }
    checks
}
