//! The paper's estimate on the terminal, and as JSON.

use super::format::{length, number, render, table, wrap};
use misfit_campaign::Campaign;
use misfit_core::effects::Role;
use misfit_core::fit::paper::PaperFit;
use serde::Serialize;
use std::fmt::Write;

/// `misfit.paper/1`.
#[derive(Debug, Serialize)]
pub struct PaperDocument {
    schema: &'static str,
    pairs: usize,
    deflection_rms_m: f64,
    position_rms_m: f64,
    parameters: Vec<Row>,
}

#[derive(Debug, Serialize)]
struct Row {
    effect: &'static str,
    name: String,
    unit: &'static str,
    value: Option<f64>,
    std: Option<f64>,
    status: &'static str,
}

/// The document.
pub fn document(fit: &PaperFit) -> PaperDocument {
    PaperDocument {
        schema: "misfit.paper/1",
        pairs: fit.pairs,
        deflection_rms_m: fit.deflection_rms,
        position_rms_m: fit.position_rms,
        parameters: fit
            .joints
            .iter()
            .map(|joint| Row {
                effect: Role::Spring.id(),
                name: joint.name.clone(),
                unit: "rad/(N·m)",
                value: joint.compliance,
                std: joint.std,
                status: match joint.compliance {
                    Some(_) => "estimated",
                    None => "unobservable",
                },
            })
            .collect(),
    }
}

/// The report.
pub fn text(campaign: &Campaign, fit: &PaperFit) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{} · robot {} · {} loaded poses beside their unloaded ones",
        campaign.name, campaign.robot.name, fit.pairs
    );
    let _ = writeln!(
        out,
        "method   the paper's: unweighted least squares on 8 dual-quaternion rows a pose (eq. 35, 47)"
    );
    let _ = writeln!(
        out,
        "error    deflection {} rms, of which {} is left\n",
        length(fit.deflection_rms),
        length(fit.position_rms)
    );
    let mut rows = table(
        &[Role::Spring.id(), "c (1e-6)", "± 1 σ", "K = 1/c", "status"],
        &[1, 2, 3],
    );
    for joint in &fit.joints {
        let dash = || "—".to_owned();
        rows.add_row(vec![
            joint.name.clone(),
            joint.compliance.map_or_else(dash, |c| number(c * 1e6)),
            joint.std.map_or_else(dash, |s| number(s * 1e6)),
            joint
                .compliance
                .map_or_else(dash, |c| format!("{} N·m/rad", number(1.0 / c))),
            match joint.compliance {
                Some(c) if c < 0.0 => "negative: noise".to_owned(),
                Some(_) => "estimated".to_owned(),
                None => "no load turns it".to_owned(),
            },
        ]);
    }
    let _ = writeln!(out, "{}", render(&rows));
    let _ = writeln!(
        out,
        "\n{}",
        wrap(
            "next     the weighted fit of the same campaign (without --method) uses the noise of each reading \
             and gives intervals that hold",
            9
        )
    );
    out
}
