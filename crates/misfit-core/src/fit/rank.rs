//! What the readings say about each parameter, and what they do not, in words.
//!
//! From the singular value decomposition of the whitened Jacobian with columns in typical sizes: directions
//! that count give the covariance; each of the others is a combination of parameters that leaves every reading
//! as it is, and a parameter that lies in such directions by more than a tenth is *unobservable*: its value is
//! the smallest that goes with the rest.

use super::solve::{Solution, Spectrum, WEAK};
use crate::effects::{Parameter, Role};
use crate::model::Model;
use nalgebra::{DMatrix, DVector};
use std::collections::BTreeMap;

/// What became of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// Found by the fit.
    Estimated,
    /// Kept at its value, and applied.
    Held,
    /// The readings do not fix it.
    Unobservable,
    /// Stopped by its least or greatest value.
    AtBound,
}

impl Status {
    /// One word for tables.
    pub fn word(self) -> &'static str {
        match self {
            Status::Estimated => "estimated",
            Status::Held => "held",
            Status::Unobservable => "unobservable",
            Status::AtBound => "at bound",
        }
    }
}

/// Something the readings do not say.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Unobservable {
    /// Parameter, or group of them.
    pub what: String,
    /// The reason.
    pub why: String,
}

pub(super) struct Judged {
    pub std: Vec<Option<f64>>,
    pub status: Vec<Status>,
    pub covariance: DMatrix<f64>,
    pub unobservable: Vec<Unobservable>,
    pub rank: usize,
}

/// Share of a parameter in directions without information from which on it counts as unobservable.
pub const LOST: f64 = 0.1;

/// Judges the parameters of a solution; `variance` scales the covariance.
pub(super) fn judge(model: &Model, free: &[usize], solution: &Solution, variance: f64) -> Judged {
    let parameters: Vec<(&str, &Parameter)> = model.parameters().collect();
    let names: Vec<(&str, &Parameter)> = free.iter().map(|&k| parameters[k]).collect();
    let n = free.len();
    // a parameter at its bound is held there: it takes no part in the others' spread
    let inner: Vec<usize> = (0..n).filter(|&k| !solution.at_bound[k]).collect();
    let everything = Spectrum::of(solution.linear.factor.clone());
    let spectrum = Spectrum::of(solution.linear.factor.select_columns(&inner));
    let m = inner.len();
    let lost: Vec<f64> = (0..n).map(|k| everything.lost(k)).collect();
    let mut scaled = DMatrix::zeros(m, m);
    for (i, &value) in spectrum.values.iter().enumerate() {
        let v = spectrum.v.column(i);
        let weight = if i < spectrum.rank {
            variance / (value * value)
        } else {
            // nothing measured: as uncertain as a typical value
            1.0
        };
        scaled += v * v.transpose() * weight;
    }
    let mut covariance = DMatrix::zeros(n, n);
    for (i, &a) in inner.iter().enumerate() {
        for (j, &b) in inner.iter().enumerate() {
            covariance[(a, b)] = scaled[(i, j)] * names[a].1.typical * names[b].1.typical;
        }
    }
    let mut std = vec![None; parameters.len()];
    let mut status = vec![Status::Held; parameters.len()];
    for (k, &index) in free.iter().enumerate() {
        status[index] = if lost[k] > LOST {
            Status::Unobservable
        } else if solution.at_bound[k] {
            Status::AtBound
        } else {
            Status::Estimated
        };
        if status[index] == Status::Estimated {
            std[index] = Some(covariance[(k, k)].sqrt());
        }
    }
    Judged {
        std,
        status,
        covariance,
        unobservable: in_words(&names, &solution.linear.factor, &everything, &lost),
        rank: everything.rank,
    }
}

/// Parameters that no reading depends on one by one; the others grouped by effect, with their partners.
fn in_words(
    names: &[(&str, &Parameter)],
    factor: &DMatrix<f64>,
    spectrum: &Spectrum,
    lost: &[f64],
) -> Vec<Unobservable> {
    let norms: Vec<f64> = factor.column_iter().map(|column| column.norm()).collect();
    let mut words = Vec::new();
    let mut together: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (k, (effect, parameter)) in names.iter().enumerate() {
        if lost[k] <= LOST {
            continue;
        }
        if norms[k] < WEAK {
            words.push(Unobservable {
                what: format!("{effect}.{}", parameter.name),
                why: format!("{}{}", unseen(parameter), size(norms[k], parameter)),
            });
        } else {
            together.entry(effect).or_default().push(k);
        }
    }
    for (effect, members) in together {
        let partners = partners(names, &norms, spectrum, &members);
        let all = names.iter().filter(|(id, _)| *id == effect).count();
        let what = match &members[..] {
            [one] => format!("{effect}.{}", names[*one].1.name),
            _ => format!("{effect}: {} of {all} parameters", members.len()),
        };
        let strongest = members.iter().map(|&k| norms[k]).fold(0.0, f64::max);
        let why = if names[members[0]].1.role == Some(Role::Geometry) && !partners.is_empty() {
            format!(
                "redundant by nature: what one does its neighbours or {} can undo; no reading needs more",
                partners.join(", ")
            )
        } else if strongest < 10.0 * WEAK {
            "too weak beside the others to be told from them".to_owned()
        } else if partners.is_empty() {
            "only in combination with each other: some motions of one undo those of another"
                .to_owned()
        } else {
            format!(
                "only in combination with {}: what one does the other can undo",
                partners.join(", ")
            )
        };
        words.push(Unobservable { what, why });
    }
    words
}

/// Why a reading may not depend on a parameter at all.
fn unseen(parameter: &Parameter) -> String {
    match parameter.role {
        Some(Role::Spring) => format!("no reading loads the {} axis", parameter.name),
        Some(Role::TargetFrame) if parameter.unit == "rad" => {
            "no reading holds an orientation".to_owned()
        }
        _ => "no reading depends on it".to_owned(),
    }
}

/// How little a parameter moves the readings, for those that it moves at all.
fn size(norm: f64, parameter: &Parameter) -> String {
    // so small a share of σ is no reason to look further
    if norm < 5e-3 {
        return String::new();
    }
    format!(
        " (a typical {:.0e} {} moves all readings together by {norm:.2} σ)",
        parameter.typical, parameter.unit
    )
}

/// Parameters that take part in undoing what `members` do, as effects or single names, largest first.
fn partners(
    names: &[(&str, &Parameter)],
    norms: &[f64],
    spectrum: &Spectrum,
    members: &[usize],
) -> Vec<String> {
    let mut weight = DVector::<f64>::zeros(names.len());
    for i in spectrum.rank..spectrum.values.len() {
        let v = spectrum.v.column(i);
        let concerned: f64 = members.iter().map(|&k| v[k] * v[k]).sum();
        if concerned < 0.01 {
            continue;
        }
        // what each parameter contributes to the cancellation, in σ
        let moved: Vec<f64> = (0..names.len()).map(|k| (v[k] * norms[k]).abs()).collect();
        let largest = moved.iter().copied().fold(0.0, f64::max);
        for (k, &m) in moved.iter().enumerate() {
            if m > 0.1 * largest {
                weight[k] = weight[k].max(concerned);
            }
        }
    }
    let mut found: Vec<String> = Vec::new();
    for (k, (effect, _)) in names.iter().enumerate() {
        let own = members.iter().any(|&m| names[m].0 == *effect);
        if !own && weight[k] > 0.0 && !found.iter().any(|name| name == effect) {
            found.push((*effect).to_owned());
        }
    }
    found
}
