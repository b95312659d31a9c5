//! What must come out of a scenario: its `[expect]`, and how it was met.

use super::Scenario;
use super::compensated::{Compensate, Corrections};
use super::control_loop::{ControlLoop, Looped};
use super::drill::summary::summary;
use super::drill::{Bored, Drilling, Mode};
use super::efficiency::Study;
use super::mapped::{Maps, agreement};
use crate::fit::{Fit, Status};
use crate::map::{By, Request};
use crate::report::format::number;
use crate::setup::Setup;
use serde::{Deserialize, Serialize};

/// Expectations; whatever is left out is not checked.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// The fit converges (or not).
    pub converged: Option<bool>,
    /// Largest fitted position error, rms, mm.
    pub fit_position_rms_mm: Option<f64>,
    /// Largest held-out (or cross-validated) position error, rms, mm.
    pub heldout_position_rms_mm: Option<f64>,
    /// Range of the fitted whitened rms.
    pub whitened_rms: Option<[f64; 2]>,
    /// Expectations of parameters.
    #[serde(default, rename = "parameter")]
    pub parameters: Vec<ExpectParameter>,
    /// Range of the pooled variance efficiency of the weighted fit against the Cramér-Rao bound.
    pub efficiency: Option<[f64; 2]>,
    /// Range of the share of 95 % intervals that hold the truth.
    pub coverage: Option<[f64; 2]>,
    /// Largest variance efficiency of the paper's estimator.
    pub paper_efficiency: Option<f64>,
    /// Expectations of corrected commands.
    #[serde(default)]
    pub compensation: Vec<ExpectCompensation>,
    /// Expectations of control loops.
    #[serde(default, rename = "loop")]
    pub loops: Vec<ExpectLoop>,
    /// Expectations of maps.
    #[serde(default)]
    pub map: Vec<ExpectMap>,
    /// Expectations of holes.
    #[serde(default)]
    pub drill: Vec<ExpectDrill>,
}

/// Expectation of the map of one target.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectMap {
    /// Target.
    pub target: String,
    /// Who tells.
    pub by: By,
    /// Range of the largest error of position, mm.
    pub position_max_mm: Option<[f64; 2]>,
    /// Range of the largest error of orientation, mrad.
    pub orientation_max_mrad: Option<[f64; 2]>,
    /// Largest difference from the other one's map, over the largest error.
    pub apart: Option<f64>,
    /// Least share of the points that is in reach.
    pub reached: Option<f64>,
}

/// Expectation of a hole.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
pub struct ExpectDrill {
    /// One of `[drill] commands`.
    pub commands: Mode,
    /// Range of the distance of the hole from its place, µm.
    pub hole_um: Option<[f64; 2]>,
    /// Range of the angle between drill and normal, µrad.
    pub tilt_urad: Option<[f64; 2]>,
    /// Range of the largest thrust, N.
    pub thrust_N: Option<[f64; 2]>,
    /// Largest time between the largest thrust and the breakthrough, s.
    pub breakthrough_s: Option<f64>,
    /// Range of the largest lateral force, N.
    pub lateral_N: Option<[f64; 2]>,
    /// Largest sum of the two sensors over the largest thrust, forces and moments.
    pub balance: Option<f64>,
}

/// Expectation of a loop: one model with one filter.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectLoop {
    /// One of `[loop] models`.
    pub model: String,
    /// One of its filters, by the name that the report gives it.
    pub filter: String,
    /// Range of the position's error, rms, µm.
    pub position_rms_um: Option<[f64; 2]>,
    /// Largest error of a position, µm.
    pub position_max_um: Option<f64>,
    /// Range of its part from noise, rms, µm.
    pub noise_rms_um: Option<[f64; 2]>,
    /// Range of its part from delay, rms, µm.
    pub lag_rms_um: Option<[f64; 2]>,
    /// Least share by which the error falls, rms, against commands corrected for the tool alone.
    pub reduction: Option<f64>,
    /// Most poses left out and ticks without a command; none if left out.
    pub unreached: Option<usize>,
}

/// Expectation of the commands that one model corrects.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectCompensation {
    /// One of `[compensate] models`.
    pub model: String,
    /// Largest miss of a position, µm.
    pub position_max_um: Option<f64>,
    /// Largest miss of an orientation, µrad.
    pub orientation_max_urad: Option<f64>,
    /// Range of the position's miss, rms, µm.
    pub position_rms_um: Option<[f64; 2]>,
    /// Least share by which the position error falls, rms.
    pub reduction: Option<f64>,
    /// Range of the share of coordinates inside their predicted 95 % intervals.
    pub coverage: Option<[f64; 2]>,
    /// Most poses that no command reaches; none if left out.
    pub unreached: Option<usize>,
}

/// Expectation of one parameter, or of all that a pattern with `*` names.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExpectParameter {
    /// `effect.parameter`; `*` stands for anything.
    pub name: String,
    /// Its status.
    pub status: Option<String>,
    /// Largest |value - truth| / |truth|.
    pub relative_error: Option<f64>,
    /// Range of the fit's standard deviation over the truth.
    pub relative_std: Option<[f64; 2]>,
    /// Largest |value - truth| in the fit's own standard deviations.
    pub sigmas: Option<f64>,
}

impl Expect {
    /// Refuses expectations that would check nothing: those of a study in a scenario with one fit, those of a fit
    /// in a study, and a parameter of which nothing is expected.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self, study: bool) -> Result<(), String> {
        let of_study = [
            ("efficiency", self.efficiency.is_some()),
            ("coverage", self.coverage.is_some()),
            ("paper_efficiency", self.paper_efficiency.is_some()),
        ];
        let of_fit = [
            ("converged", self.converged.is_some()),
            ("fit_position_rms_mm", self.fit_position_rms_mm.is_some()),
            (
                "heldout_position_rms_mm",
                self.heldout_position_rms_mm.is_some(),
            ),
            ("whitened_rms", self.whitened_rms.is_some()),
            ("parameter", !self.parameters.is_empty()),
        ];
        let (idle, why) = if study {
            (
                &of_fit[..],
                "is of one fit, but campaigns makes this a study of many",
            )
        } else {
            (
                &of_study[..],
                "is of a study, but the scenario has no campaigns = N",
            )
        };
        if let Some((key, _)) = idle.iter().find(|(_, given)| *given) {
            return Err(format!("[expect] {key} {why}; it would check nothing"));
        }
        for wanted in &self.parameters {
            let idle = wanted.status.is_none()
                && wanted.relative_error.is_none()
                && wanted.relative_std.is_none()
                && wanted.sigmas.is_none();
            if idle {
                return Err(format!(
                    "[[expect.parameter]] {} expects nothing; accepted: status, relative_error, \
                     relative_std, sigmas",
                    wanted.name
                ));
            }
        }
        Ok(())
    }
}

impl Expect {
    /// Is anything expected of a fit?
    fn is_of_fit(&self) -> bool {
        self.converged.is_some()
            || self.fit_position_rms_mm.is_some()
            || self.heldout_position_rms_mm.is_some()
            || self.whitened_rms.is_some()
            || !self.parameters.is_empty()
    }

    /// Refuses expectations of commands in a scenario without any, of a model that corrects none, and those of a fit in
    /// a scenario that reports none.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_compensation(&self, compensate: Option<&Compensate>) -> Result<(), String> {
        for wanted in &self.compensation {
            let Some(compensate) = compensate else {
                return Err(
                    "[[expect.compensation]] is of corrected commands, but the scenario has no [compensate]; it would \
                     check nothing"
                        .to_owned(),
                );
            };
            if !compensate.models.contains(&wanted.model) {
                return Err(format!(
                    "[[expect.compensation]] model = \"{}\"; accepted: one of [compensate] models: {}",
                    wanted.model,
                    compensate.models.join(", ")
                ));
            }
        }
        if compensate.is_some() && self.is_of_fit() {
            return Err(
                "[expect] of a fit in a scenario with [compensate], which reports commands; it would check nothing; \
                 accepted: [[expect.compensation]]"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

/// Checks the expectations of corrected commands.
pub fn check_compensation(expect: &Expect, found: &[Corrections]) -> Vec<Check> {
    let mut checks = Vec::new();
    for wanted in &expect.compensation {
        let Some(found) = found.iter().find(|c| c.model == wanted.model) else {
            continue;
        };
        let name = |what: &str| format!("{what}, commands corrected by {}", wanted.model);
        let most = found.most();
        let mut at_most = |what: &str, found: f64, limit: Option<f64>| {
            if let Some(limit) = limit {
                checks.push(Check {
                    what: name(what),
                    found: number(found),
                    accepted: format!("at most {}", number(limit)),
                    met: found <= limit,
                });
            }
        };
        at_most(
            "largest position error, µm",
            most.position_m * 1e6,
            wanted.position_max_um,
        );
        at_most(
            "largest orientation error, µrad",
            most.orientation_rad * 1e6,
            wanted.orientation_max_urad,
        );
        at_most(
            "poses not reached",
            found.unreached as f64,
            Some(wanted.unreached.unwrap_or(0) as f64),
        );
        let rms = found.rms().1.position_m * 1e6;
        checks.extend(within(
            &name("position error, rms, µm"),
            rms,
            wanted.position_rms_um,
        ));
        let coverage = found.coverage().unwrap_or(f64::NAN);
        checks.extend(within(
            &name("coverage of predicted 95 % intervals"),
            coverage,
            wanted.coverage,
        ));
        let least = wanted.reduction.map(|least| [least, 1.0]);
        checks.extend(within(
            &name("share by which the position error falls"),
            found.reduction(),
            least,
        ));
    }
    checks
}

impl Expect {
    /// Refuses expectations of loops in a scenario without any, of models and filters that it does not have, those that
    /// expect nothing, and those of a fit in a scenario that reports none.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_loop(&self, control_loop: Option<&ControlLoop>) -> Result<(), String> {
        for wanted in &self.loops {
            let Some(control_loop) = control_loop else {
                return Err(
                    "[[expect.loop]] is of a control loop, but the scenario has no [loop]; it would check nothing"
                        .to_owned(),
                );
            };
            let filters = control_loop.filter_names();
            let known = [
                ("model", &wanted.model, &control_loop.models),
                ("filter", &wanted.filter, &filters),
            ];
            for (key, word, words) in known {
                if !words.contains(word) {
                    return Err(format!(
                        "[[expect.loop]] {key} = \"{word}\"; accepted: one of those of [loop]: {}",
                        words.join(" · ")
                    ));
                }
            }
            let idle = wanted.position_rms_um.is_none()
                && wanted.position_max_um.is_none()
                && wanted.noise_rms_um.is_none()
                && wanted.lag_rms_um.is_none()
                && wanted.reduction.is_none()
                && wanted.unreached.is_none();
            if idle {
                return Err(format!(
                    "[[expect.loop]] {}, {} expects nothing; accepted: position_rms_um, position_max_um, noise_rms_um, \
                     lag_rms_um, reduction, unreached",
                    wanted.model, wanted.filter
                ));
            }
        }
        if control_loop.is_some() && self.is_of_fit() {
            return Err(
                "[expect] of a fit in a scenario with [loop], which reports poses held; it would check nothing; \
                 accepted: [[expect.loop]]"
                    .to_owned(),
            );
        }
        Ok(())
    }
}

impl Expect {
    /// Refuses expectations of maps in a scenario without any, of targets and tellers that it does not have, those that
    /// expect nothing, and those of a fit in a scenario that reports none.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_map(&self, map: Option<&Request>, setup: &Setup) -> Result<(), String> {
        for wanted in &self.map {
            let Some(map) = map else {
                return Err(
                    "[[expect.map]] is of a map, but the scenario has no [map]; it would check nothing".to_owned(),
                );
            };
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
        if map.is_some() && self.is_of_fit() {
            return Err(
                "[expect] of a fit in a scenario with [map], which reports maps; it would check nothing; accepted: \
                 [[expect.map]]"
                    .to_owned(),
            );
        }
        Ok(())
    }

    /// Refuses expectations of holes in a scenario without any, of commands that it does not give, those that expect
    /// nothing, and those of a fit in a scenario that reports none.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check_drill(&self, drill: Option<&Drilling>) -> Result<(), String> {
        for wanted in &self.drill {
            let Some(drill) = drill else {
                return Err(
                    "[[expect.drill]] is of a hole, but the scenario has no [drill]; it would check nothing".to_owned(),
                );
            };
            if !drill.modes.contains(&wanted.commands) {
                let known: Vec<&str> = drill.modes.iter().map(|mode| mode.key()).collect();
                return Err(format!(
                    "[[expect.drill]] commands = \"{}\"; accepted: one of [drill] commands: {}",
                    wanted.commands.key(),
                    known.join(", ")
                ));
            }
            let idle = wanted.hole_um.is_none()
                && wanted.tilt_urad.is_none()
                && wanted.thrust_N.is_none()
                && wanted.breakthrough_s.is_none()
                && wanted.lateral_N.is_none()
                && wanted.balance.is_none();
            if idle {
                return Err(format!(
                    "[[expect.drill]] {} expects nothing; accepted: hole_um, tilt_urad, thrust_N, breakthrough_s, \
                     lateral_N, balance",
                    wanted.commands.key()
                ));
            }
        }
        if drill.is_some() && self.is_of_fit() {
            return Err(
                "[expect] of a fit in a scenario with [drill], which reports holes; it would check nothing; accepted: \
                 [[expect.drill]]"
                    .to_owned(),
            );
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
        checks.extend(within(
            &name("model and MuJoCo apart, over the largest"),
            pair.map_or(f64::NAN, |pair| pair.relative),
            wanted.apart.map(|most| [0.0, most]),
        ));
        checks.extend(within(
            &name("share of points in reach"),
            found.reached as f64 / found.points as f64,
            wanted.reached.map(|least| [least, 1.0]),
        ));
    }
    checks
}

/// Checks the expectations of holes.
pub fn check_drill(expect: &Expect, drill: &Drilling, holes: &[Bored]) -> Vec<Check> {
    let mut checks = Vec::new();
    for wanted in &expect.drill {
        let Some(hole) = holes.iter().find(|hole| hole.mode == wanted.commands) else {
            continue;
        };
        let found = summary(drill, hole);
        let name = |what: &str| format!("{what}, commands {}", found.mode.words());
        let hole_error = found.hole_error_m.unwrap_or(f64::NAN) * 1e6;
        checks.extend(within(
            &name("hole off its place, µm"),
            hole_error,
            wanted.hole_um,
        ));
        checks.extend(within(
            &name("axis off the normal, µrad"),
            found.tilt_rad * 1e6,
            wanted.tilt_urad,
        ));
        checks.extend(within(
            &name("largest thrust, N"),
            found.thrust_peak_N,
            wanted.thrust_N,
        ));
        let late = found
            .through_s
            .map_or(f64::NAN, |t| (t - found.thrust_peak_s).abs());
        checks.extend(within(
            &name("largest thrust from the breakthrough, s"),
            late,
            wanted.breakthrough_s.map(|most| [0.0, most]),
        ));
        checks.extend(within(
            &name("largest lateral force, N"),
            found.lateral_peak_N,
            wanted.lateral_N,
        ));
        for (what, share) in [
            (
                "sum of both sensors' forces over the largest thrust",
                found.balance,
            ),
            ("sum of their moments", found.moment_balance),
        ] {
            let range = wanted.balance.map(|most| [0.0, most]);
            checks.extend(within(&name(what), share, range));
        }
        checks.extend(within(
            &name("ticks without a command"),
            found.unreached as f64,
            Some([0.0, 0.0]),
        ));
    }
    checks
}

/// Checks the expectations of control loops.
pub fn check_loop(expect: &Expect, found: &[Looped]) -> Vec<Check> {
    let mut checks = Vec::new();
    for wanted in &expect.loops {
        let Some(looped) = found.iter().find(|l| l.model == wanted.model) else {
            continue;
        };
        let Some(found) = looped.filters.iter().find(|f| f.filter == wanted.filter) else {
            continue;
        };
        let name = |what: &str| format!("{what}, loop of {}, {}", wanted.model, wanted.filter);
        let mut at_most = |what: &str, found: f64, limit: Option<f64>| {
            if let Some(limit) = limit {
                checks.push(Check {
                    what: name(what),
                    found: number(found),
                    accepted: format!("at most {}", number(limit)),
                    met: found <= limit,
                });
            }
        };
        at_most(
            "largest position error, µm",
            found.errors.most.position_m * 1e6,
            wanted.position_max_um,
        );
        at_most(
            "poses left out and ticks without a command",
            (looped.left_out + found.unreached) as f64,
            Some(wanted.unreached.unwrap_or(0) as f64),
        );
        let parts = [
            (
                "position error, rms, µm",
                found.errors.rms,
                wanted.position_rms_um,
            ),
            (
                "position error from noise, rms, µm",
                found.noise,
                wanted.noise_rms_um,
            ),
            (
                "position error from delay, rms, µm",
                found.lag,
                wanted.lag_rms_um,
            ),
        ];
        for (what, part, range) in parts {
            checks.extend(within(&name(what), part.position_m * 1e6, range));
        }
        checks.extend(within(
            &name("share by which the position error falls"),
            looped.reduction(found),
            wanted.reduction.map(|least| [least, 1.0]),
        ));
    }
    checks
}

/// One expectation and how it was met.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// What was expected of what.
    pub what: String,
    /// What was found.
    pub found: String,
    /// What would have been accepted.
    pub accepted: String,
    /// Met?
    pub met: bool,
}

/// A parameter beside its truth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// Effect.
    pub effect: String,
    /// Parameter.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// What the plant had.
    pub truth: f64,
    /// What the fit found.
    pub value: f64,
    /// Its standard deviation.
    pub std: Option<f64>,
    /// Its status.
    pub status: Status,
}

impl Comparison {
    /// |value - truth| / |truth|.
    pub fn relative_error(&self) -> f64 {
        (self.value - self.truth).abs() / self.truth.abs()
    }
}

/// Sets the fitted parameters beside their truth, where the plant had the same effect.
pub fn compare(scenario: &Scenario, fit: &Fit) -> Vec<Comparison> {
    let mut rows = Vec::new();
    for truth in &scenario.truth {
        for (name, value) in &truth.values {
            let Some(index) = fit.index(truth.effect.id(), name) else {
                continue;
            };
            if let Some((effect, parameter)) = fit.model.parameters().nth(index) {
                rows.push(Comparison {
                    effect: effect.to_owned(),
                    name: name.clone(),
                    unit: parameter.unit.clone(),
                    truth: *value,
                    value: fit.values[index],
                    std: fit.std[index],
                    status: fit.status[index],
                });
            }
        }
    }
    rows
}

/// Checks the expectations of a fit.
pub fn check_fit(expect: &Expect, fit: &Fit, compared: &[Comparison]) -> Vec<Check> {
    let mut checks = Vec::new();
    if let Some(wanted) = expect.converged {
        checks.push(Check {
            what: "the fit converges".to_owned(),
            found: fit.converged.to_string(),
            accepted: wanted.to_string(),
            met: fit.converged == wanted,
        });
    }
    let mut at_most = |what: &str, found: Option<f64>, limit: Option<f64>| {
        if let Some(limit) = limit {
            checks.push(Check {
                what: what.to_owned(),
                found: found.map_or("nothing".to_owned(), number),
                accepted: format!("at most {}", number(limit)),
                met: found.is_some_and(|found| found <= limit),
            });
        }
    };
    at_most(
        "fitted position error, rms, mm",
        Some(fit.fit.position_rms_m * 1e3),
        expect.fit_position_rms_mm,
    );
    at_most(
        "held-out or cross-validated position error, rms, mm",
        fit.heldout.map(|e| e.position_rms_m * 1e3),
        expect.heldout_position_rms_mm,
    );
    checks.extend(within(
        "fitted whitened rms",
        fit.fit.whitened_rms,
        expect.whitened_rms,
    ));
    for wanted in &expect.parameters {
        checks.extend(check_parameter(wanted, fit, compared));
    }
    checks
}

/// Checks the expectations of an efficiency study.
pub fn check_study(expect: &Expect, study: &Study) -> Vec<Check> {
    let mut checks = Vec::new();
    checks.extend(within(
        "pooled variance efficiency",
        study.efficiency(),
        expect.efficiency,
    ));
    checks.extend(within(
        "coverage of 95 % intervals",
        study.coverage(),
        expect.coverage,
    ));
    if let Some(limit) = expect.paper_efficiency {
        let found = study.paper_efficiency();
        checks.push(Check {
            what: "variance efficiency of the paper's estimator".to_owned(),
            found: number(found),
            accepted: format!("at most {}", number(limit)),
            met: found <= limit,
        });
    }
    checks
}

fn within(what: &str, found: f64, range: Option<[f64; 2]>) -> Option<Check> {
    let [low, high] = range?;
    Some(Check {
        what: what.to_owned(),
        found: number(found),
        accepted: format!("{} to {}", number(low), number(high)),
        met: (low..=high).contains(&found),
    })
}

fn check_parameter(wanted: &ExpectParameter, fit: &Fit, compared: &[Comparison]) -> Vec<Check> {
    let mut checks = Vec::new();
    let parameters: Vec<(usize, String)> = fit
        .model
        .parameters()
        .enumerate()
        .map(|(index, (effect, parameter))| (index, format!("{effect}.{}", parameter.name)))
        .filter(|(_, name)| matches(&wanted.name, name))
        .collect();
    if parameters.is_empty() {
        return vec![Check {
            what: format!("{} is in the model", wanted.name),
            found: "no such parameter".to_owned(),
            accepted: "effect.parameter, * for anything".to_owned(),
            met: false,
        }];
    }
    for (index, name) in parameters {
        let status = fit.status[index].word();
        if let Some(accepted) = &wanted.status {
            checks.push(Check {
                what: format!("status of {name}"),
                found: status.to_owned(),
                accepted: accepted.replace('_', " "),
                met: accepted.replace('_', " ") == status,
            });
        }
        let row = compared
            .iter()
            .find(|row| format!("{}.{}", row.effect, row.name) == name);
        if let Some([low, high]) = wanted.relative_std {
            let found = row.and_then(|row| Some(row.std? / row.truth.abs()));
            checks.push(Check {
                what: format!("standard deviation over truth of {name}"),
                found: found.map_or("none".to_owned(), number),
                accepted: format!("{} to {}", number(low), number(high)),
                met: found.is_some_and(|found| (low..=high).contains(&found)),
            });
        }
        let mut at_most = |what: &str, found: Option<f64>, limit: Option<f64>| {
            if let Some(limit) = limit {
                checks.push(Check {
                    what: format!("{what} of {name}"),
                    found: found.map_or("no truth to compare with".to_owned(), number),
                    accepted: format!("at most {}", number(limit)),
                    met: found.is_some_and(|found| found <= limit),
                });
            }
        };
        at_most(
            "relative error",
            row.map(Comparison::relative_error),
            wanted.relative_error,
        );
        let sigmas = row.and_then(|row| row.std.map(|std| (row.value - row.truth).abs() / std));
        at_most("error in standard deviations", sigmas, wanted.sigmas);
    }
    checks
}

/// Does a pattern, `*` for anything, match a whole name?
fn matches(pattern: &str, name: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == name,
        Some((head, tail)) => name.strip_prefix(head).is_some_and(|rest| {
            (0..=rest.len())
                .filter(|&at| rest.is_char_boundary(at))
                .any(|at| matches(tail, &rest[at..]))
        }),
    }
}
