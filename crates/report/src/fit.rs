//! A fit on the terminal.

use super::format::{angle, count, length, number, render, significant, table, wrap};
use misfit_campaign::Campaign;
use misfit_core::effects::Role;
use misfit_core::fit::noise::Source;
use misfit_core::fit::{Errors, Fit, HeldoutBy, Status};
use misfit_core::model::Term;
use std::fmt::Write;

/// Which parameters to list.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Detail {
    /// None.
    Errors,
    /// All but geometry, which is counted.
    Usual,
    /// Every one.
    Everything,
}

/// The whole report; `baseline` is the fit of the frames alone.
pub fn text(campaign: &Campaign, fit: &Fit, baseline: Option<&Fit>, detail: Detail) -> String {
    let mut out = String::new();
    let _ = writeln!(out, "{}", title(campaign, fit));
    let _ = writeln!(out, "{}", model_line(fit));
    let _ = writeln!(out, "{}", noise_line(campaign, fit));
    let _ = writeln!(out, "\n{}", error_lines(fit, baseline));
    if detail != Detail::Errors {
        let _ = write!(
            out,
            "{}",
            parameter_tables(fit, detail == Detail::Everything)
        );
    }
    if detail != Detail::Errors {
        let _ = write!(out, "{}", correlation_lines(fit));
    }
    if !fit.unobservable.is_empty() {
        let _ = writeln!(out, "\nnot seen");
        for row in &fit.unobservable {
            let _ = writeln!(out, "{}", wrap(&format!("  {} · {}", row.what, row.why), 4));
        }
    }
    for warning in &campaign.warnings {
        let _ = writeln!(out, "\n{}", wrap(&format!("note     {warning}"), 9));
    }
    let _ = write!(out, "\n{}", ending(fit));
    out
}

pub(super) fn title(campaign: &Campaign, fit: &Fit) -> String {
    let held = match fit.readings.1 {
        0 => String::new(),
        n => format!(" · {n} held out"),
    };
    wrap(
        &format!(
            "{} · robot {} · {} fitted{held}",
            campaign.name,
            campaign.robot.name,
            count(fit.readings.0, "reading")
        ),
        9,
    )
}

pub(super) fn model_line(fit: &Fit) -> String {
    let ids: Vec<&str> = fit.model.terms.iter().map(|t| t.effect.id()).collect();
    wrap(
        &format!(
            "model    {} · the readings fix {} of {} directions",
            ids.join(" + "),
            fit.rank,
            fit.free.len()
        ),
        9,
    )
}

pub(super) fn noise_line(campaign: &Campaign, fit: &Fit) -> String {
    let noise = &fit.noise;
    let mut line = format!("noise    {}", length(noise.position_sigma));
    if let Some(sigma) = noise.orientation_sigma {
        let _ = write!(line, ", {}", angle(sigma));
    }
    line.push_str(" a coordinate (1 σ), ");
    match (noise.source, noise.replicates) {
        (Source::Replicates, Some(pure)) => {
            let _ = write!(line, "from {}", count(pure.groups, "group"));
            let _ = write!(line, " of repeats, {} degrees of freedom", pure.dof);
            if campaign.noise.is_some() {
                let _ = write!(
                    line,
                    "; {} × what the campaign file says",
                    number(noise.factor.sqrt())
                );
            }
        }
        (Source::Campaign, _) => line.push_str("as the campaign file says; no repeats to check it"),
        _ => line.push_str("from what the fit leaves: model errors count as noise"),
    }
    wrap(&line, 9)
}

fn error_lines(fit: &Fit, baseline: Option<&Fit>) -> String {
    // noise taken from what is left makes each row's own whitened rms one, whatever the model: it says nothing
    let whitened = fit.noise.source != Source::Residual;
    let mut header = vec!["error", "rms", "mean", "max", "orientation rms"];
    if whitened {
        header.push("rms / noise");
    }
    let numbers: Vec<usize> = (1..header.len()).collect();
    let mut rows = table(&header, &numbers);
    let mut add = |name: &str, e: &Errors| {
        let mut cells = vec![
            name.to_owned(),
            length(e.position_rms_m),
            length(e.position_mean_m),
            length(e.position_max_m),
            e.orientation_rms_rad.map_or("—".to_owned(), angle),
        ];
        if whitened {
            cells.push(number(e.whitened_rms));
        }
        rows.add_row(cells);
    };
    let held = |by: Option<HeldoutBy>| match by {
        Some(HeldoutBy::CrossValidation) => "cross-validated",
        _ => "held out",
    };
    if let Some(frames) = baseline {
        match &frames.heldout {
            Some(e) => add(&format!("frames alone, {}", held(frames.heldout_by)), e),
            None => add("frames alone", &frames.fit),
        }
    }
    add("fitted", &fit.fit);
    if let Some(e) = &fit.heldout {
        add(held(fit.heldout_by), e);
    }
    render(&rows)
}

/// One table per effect: compliances with their stiffness, frames and offsets as they are, geometry as a count.
fn parameter_tables(fit: &Fit, all: bool) -> String {
    let mut out = String::new();
    for term in &fit.model.terms {
        let range = term.first..term.first + term.parameters.len();
        let id = term.effect.id();
        let role = term.effect.role();
        if role == Some(Role::Geometry) && !all {
            let line = format!(
                " {id} · {} parameters, {} identified one by one, the others only in combination (--all lists them)",
                range.len(),
                range
                    .filter(|&k| fit.status[k] == Status::Estimated)
                    .count()
            );
            let _ = writeln!(out, "\n{}", wrap(&line, 2));
            continue;
        }
        let rows = match role {
            Some(Role::Spring) => compliance_table(fit, term),
            _ => value_table(fit, term),
        };
        let _ = writeln!(out, "\n{rows}");
    }
    out
}

/// Compliances and their stiffness.
fn compliance_table(fit: &Fit, term: &Term) -> String {
    let unit = match term.parameters.iter().all(|p| p.unit == "rad/(N·m)") {
        true => "c µrad/(N·m)",
        false => "c (1e-6 SI)",
    };
    let id = term.effect.id();
    let interval = "95 % interval of K";
    let header = [id, unit, "± 95 %", "K = 1/c", interval, "status"];
    let mut rows = table(&header, &[1, 2, 3, 4]);
    let dash = || "—".to_owned();
    for (parameter, k) in term.parameters.iter().zip(term.first..) {
        let half = fit.std[k].map(|std| std * fit.quantile());
        let (value, interval) = stiffness(fit.values[k], half, &parameter.unit);
        let shown = fit.status[k] != Status::Unobservable;
        let (c, value) = match shown {
            true => (number(fit.values[k] * 1e6), value),
            false => (dash(), dash()),
        };
        let half = half.map_or_else(dash, |h| number(h * 1e6));
        let status = fit.status[k].word().to_owned();
        rows.add_row(vec![
            parameter.name.clone(),
            c,
            half,
            value,
            interval,
            status,
        ]);
    }
    render(&rows)
}

/// Parameters as they are.
fn value_table(fit: &Fit, term: &Term) -> String {
    let header = [term.effect.id(), "value", "± 95 %", "unit", "status"];
    let mut rows = table(&header, &[1, 2]);
    let dash = || "—".to_owned();
    for (parameter, k) in term.parameters.iter().zip(term.first..) {
        let value = match fit.status[k] {
            Status::Unobservable => dash(),
            _ => significant(fit.values[k], 6),
        };
        let half = fit.std[k].map_or_else(dash, |std| number(std * fit.quantile()));
        let status = fit.status[k].word().to_owned();
        rows.add_row(vec![
            parameter.name.clone(),
            value,
            half,
            parameter.unit.clone(),
            status,
        ]);
    }
    render(&rows)
}

/// Stiffness and its interval; a compliance that may be zero has no upper end.
pub(super) fn stiffness(c: f64, half: Option<f64>, unit: &str) -> (String, String) {
    let unit = match unit {
        "m/N" => "N/m",
        _ => "N·m/rad",
    };
    let value = if c > 0.0 {
        format!("{} {unit}", number(1.0 / c))
    } else {
        "rigid".to_owned()
    };
    let interval = match half {
        None => "—".to_owned(),
        Some(half) if c - half > 0.0 => {
            format!(
                "{} … {}",
                number(1.0 / (c + half)),
                number(1.0 / (c - half))
            )
        }
        Some(half) => format!("≥ {}", number(1.0 / (c + half))),
    };
    (value, interval)
}

/// Pairs that are known together much better than apart; geometry and frames, redundant by nature, are left out.
fn correlation_lines(fit: &Fit) -> String {
    /// Absolute correlation from which on a pair is listed.
    const MIN_CORRELATION: f64 = 0.9;
    /// Pairs listed.
    const MAX_PAIRS: usize = 5;
    let parameters: Vec<_> = fit.model.parameters().collect();
    let own = |k: usize| !parameters[k].1.role.is_some_and(Role::is_redundant);
    let pairs = fit.correlations(MIN_CORRELATION).into_iter();
    let pairs: Vec<_> = pairs.filter(|&(a, b, _)| own(a) && own(b)).collect();
    if pairs.is_empty() {
        return String::new();
    }
    let mut out = "\ncorrelated: known together better than apart\n".to_owned();
    for &(a, b, value) in pairs.iter().take(MAX_PAIRS) {
        let name = |k: usize| format!("{}.{}", parameters[k].0, parameters[k].1.name);
        let _ = writeln!(out, "  {} and {}  {value:+.2}", name(a), name(b));
    }
    if pairs.len() > MAX_PAIRS {
        let _ = writeln!(out, "  and {} pairs more", pairs.len() - MAX_PAIRS);
    }
    out
}

fn ending(fit: &Fit) -> String {
    if fit.converged {
        format!("converged in {}\n", count(fit.iterations, "step"))
    } else {
        wrap(
            &format!(
                "NOT CONVERGED after {}: the figures above are where it stopped. A wrong \
                 number among the readings does that (diagnose names the lines that it rejects), or too many effects, or \
                 a start too far off (--model)",
                count(fit.iterations, "step")
            ),
            2,
        ) + "\n"
    }
}
