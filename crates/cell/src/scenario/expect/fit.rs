//! Of a fit, and of a study of many.

use super::super::Scenario;
use super::super::efficiency::Study;
use super::{Check, Expect, Range, at_most, within};
use crate::fit::{Fit, Status};
use crate::numbers::number;
use serde::{Deserialize, Serialize};

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
    pub relative_std: Option<Range>,
    /// Largest |value - truth| in the fit's own standard deviations.
    pub sigmas: Option<f64>,
}

impl ExpectParameter {
    /// Refuses what expects nothing.
    pub(super) fn check(&self) -> Result<(), String> {
        let idle = self.status.is_none()
            && self.relative_error.is_none()
            && self.relative_std.is_none()
            && self.sigmas.is_none();
        if idle {
            return Err(format!(
                "[[expect.parameter]] {} expects nothing; accepted: status, relative_error, relative_std, sigmas",
                self.name
            ));
        }
        Ok(())
    }
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
    checks.extend(at_most(
        "variance efficiency of the paper's estimator",
        study.paper_efficiency(),
        expect.paper_efficiency,
    ));
    checks
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
        if let Some(Range { least, most }) = wanted.relative_std {
            let found = row.and_then(|row| Some(row.std? / row.truth.abs()));
            checks.push(Check {
                what: format!("standard deviation over truth of {name}"),
                found: found.map_or("none".to_owned(), number),
                accepted: format!("{} to {}", number(least), number(most)),
                met: found.is_some_and(|found| (least..=most).contains(&found)),
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
