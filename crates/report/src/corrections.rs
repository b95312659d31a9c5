//! Commands that models correct, as they arrive in MuJoCo: on the terminal, as JSON, and as bars.

use super::format::{angle, count, length, number, render, table, wrap};
use super::format::{model_name, percent};
use crate::plot::{Content, Figure, Panel};
use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::compensated::{Arrival, Compensate, Corrections, Miss};
use serde::Serialize;
use std::fmt::Write;

/// What a model's corrections are worth, as data.
#[derive(Debug, Serialize)]
pub struct CorrectionsDocument {
    model: String,
    poses: usize,
    unreached: usize,
    before_rms: Miss,
    after_rms: Miss,
    after_max: Miss,
    reduction: f64,
    coverage: Option<f64>,
    mean_square: Option<f64>,
    arrivals: Vec<Arrival>,
}

/// The document of corrections; poses one by one where the scenario lists them.
pub fn document(corrections: &Corrections, list: bool) -> CorrectionsDocument {
    let (before_rms, after_rms) = corrections.rms();
    CorrectionsDocument {
        model: corrections.model.clone(),
        poses: corrections.arrivals.len(),
        unreached: corrections.unreached,
        before_rms,
        after_rms,
        after_max: corrections.most(),
        reduction: corrections.reduction(),
        coverage: corrections.coverage(),
        mean_square: corrections.mean_square(),
        arrivals: match list {
            true => corrections.arrivals.clone(),
            false => Vec::new(),
        },
    }
}

/// Corrected commands in MuJoCo, model by model, and pose by pose if wanted.
pub fn text(scenario: &Scenario, wanted: &Compensate, all: &[Corrections]) -> String {
    let load = scenario.design.loads.last();
    let load = load.map_or(0.0, |load| load.mass);
    let mut out = format!(
        "{} × {} · {} kg · rms errors of the poses that MuJoCo reaches\n\n",
        count(wanted.campaigns, "campaign"),
        count(wanted.poses * scenario.setup.targets.len(), "pose"),
        number(load),
    );
    let header = [
        "corrected by",
        "before",
        "after",
        "falls by",
        "at most",
        "turned",
        "after",
        "at most",
        "in 95 %",
    ];
    let mut rows = table(&header, &[1, 2, 3, 4, 5, 6, 7, 8]);
    for corrections in all {
        let (before, after) = corrections.rms();
        let most = corrections.most();
        rows.add_row(vec![
            model_name(&corrections.model).to_owned(),
            length(before.position_m),
            length(after.position_m),
            percent(corrections.reduction()),
            length(most.position_m),
            angle(before.orientation_rad),
            angle(after.orientation_rad),
            angle(most.orientation_rad),
            corrections
                .coverage()
                .map_or("—".to_owned(), |c| format!("{:.1} %", c * 100.0)),
        ]);
    }
    out += &render(&rows);
    out += "\n\n";
    for corrections in all.iter().filter(|c| c.unreached > 0) {
        let line = format!(
            "{} out of reach of commands that the {} corrects, within the joints' limits: left out above",
            count(corrections.unreached, "pose"),
            model_name(&corrections.model)
        );
        let _ = writeln!(out, "{}", wrap(&line, 2));
    }
    if wanted.list
        && let Some(last) = all.last()
    {
        let header = [
            "pose",
            "target",
            "before",
            "after",
            "±1 σ",
            "orientation before",
            "after",
            "±1 σ",
        ];
        let mut rows = table(&header, &[2, 3, 4, 5, 6, 7]);
        for (index, arrival) in last.arrivals.iter().enumerate() {
            let predicted = arrival.predicted;
            rows.add_row(vec![
                format!("{}", index % wanted.poses + 1),
                arrival.target.clone(),
                length(arrival.before.position_m),
                length(arrival.after.position_m),
                predicted.map_or("—".to_owned(), |p| length(p.position_m)),
                angle(arrival.before.orientation_rad),
                angle(arrival.after.orientation_rad),
                predicted.map_or("—".to_owned(), |p| angle(p.orientation_rad)),
            ]);
        }
        let _ = writeln!(out, "{}\n", render(&rows));
    }
    out
}

/// A number of an arrival, in the unit of its axis.
type Quantity = fn(&Arrival) -> f64;

/// The paper's Fig. 7 to 9: each pose of each target without and with the last model's correction, and the drop.
pub fn figure(scenario: &Scenario, wanted: &Compensate, last: &Corrections) -> Figure {
    let setup = &scenario.setup;
    let names: Vec<&str> = setup.targets.iter().map(|t| t.name.as_str()).collect();
    let of = |name: &str| -> Vec<&Arrival> {
        let own = last.arrivals.iter();
        own.filter(|arrival| arrival.target == name).collect()
    };
    let labels = |count: usize| (1..=count).map(|pose| pose.to_string()).collect();
    let bars = |title: String, y: &str, series: Vec<(String, Vec<f64>)>| Panel {
        title,
        x: "pose".to_owned(),
        y: y.to_owned(),
        content: Content::Bars {
            labels: labels(series.iter().map(|s| s.1.len()).max().unwrap_or(0)),
            series,
        },
    };
    let mut panels = Vec::new();
    for name in &names {
        let own = of(name);
        let quantity = |of: Quantity| own.iter().map(|a| of(a)).collect::<Vec<f64>>();
        let all: [(&str, &str, Quantity); 4] = [
            ("without", "position, mm", |a| a.before.position_m * 1e3),
            ("with", "position, µm", |a| a.after.position_m * 1e6),
            ("without", "orientation, mrad", |a| {
                a.before.orientation_rad * 1e3
            }),
            ("with", "orientation, µrad", |a| {
                a.after.orientation_rad * 1e6
            }),
        ];
        for (word, y, of) in all {
            let series = vec![(String::new(), quantity(of))];
            panels.push(bars(format!("{name}, {word} compensation"), y, series));
        }
    }
    let drops: [(&str, &str, Quantity); 2] = [
        ("drop of position errors", "mm", |a| {
            (a.before.position_m - a.after.position_m) * 1e3
        }),
        ("drop of orientation errors", "mrad", |a| {
            (a.before.orientation_rad - a.after.orientation_rad) * 1e3
        }),
    ];
    for (title, y, drop) in drops {
        let series = names.iter().map(|name| {
            let own = of(name);
            ((*name).to_owned(), own.iter().map(|a| drop(a)).collect())
        });
        panels.push(bars(title.to_owned(), y, series.collect()));
    }
    let load = scenario.design.loads.last().map_or(0.0, |load| load.mass);
    Figure {
        title: vec![
            format!(
                "{}: {} of each target under {} kg, commands without and with compensation",
                setup.robot.name,
                count(wanted.poses, "pose"),
                number(load)
            ),
            format!(
                "corrected by the {}, reached in MuJoCo",
                model_name(&last.model)
            ),
        ],
        panels,
        columns: 4,
        panel_size: (360, 280),
    }
}
