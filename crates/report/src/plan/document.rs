//! A plan as JSON.

use super::{Ground, Result};
use misfit_core::plan::observability::Observability;
use misfit_core::plan::{Aim, Figures, Outlook, Step, Way};
use serde::Serialize;

/// `misfit.plan/1`.
#[derive(Debug, Serialize)]
pub struct PlanDocument {
    schema: &'static str,
    effects: Vec<String>,
    joints: Vec<String>,
    poses: Vec<Vec<f64>>,
    protocol: ProtocolDocument,
    readings: usize,
    measured: usize,
    candidates: usize,
    seed: u64,
    precision: Option<PrecisionDocument>,
    separation: Option<SeparationDocument>,
}

#[derive(Debug, Serialize)]
struct ProtocolDocument {
    targets: Vec<String>,
    loads: Vec<Option<LoadDocument>>,
    directions: Vec<Option<f64>>,
    repeats: usize,
}

#[derive(Debug, Serialize)]
struct LoadDocument {
    mass_kg: f64,
    com_m: [f64; 3],
}

#[derive(Debug, Serialize)]
struct PrecisionDocument {
    criterion: Aim,
    of: Vec<String>,
    proposed: FiguresDocument,
    random: FiguresDocument,
    measured: Option<FiguresDocument>,
    noise_m: f64,
    curve: Vec<Step>,
    enough: Option<usize>,
}

#[derive(Debug, Serialize)]
struct FiguresDocument {
    observability: Observability,
    accuracy_m: f64,
    parameters: Vec<ParameterRow>,
}

#[derive(Debug, Serialize)]
struct ParameterRow {
    effect: String,
    name: String,
    unit: String,
    std: Option<f64>,
}

#[derive(Debug, Serialize)]
struct SeparationDocument {
    sizes: &'static str,
    ways: Vec<WayDocument>,
}

#[derive(Debug, Serialize)]
struct WayDocument {
    effect: String,
    other: String,
    lambda_measured: f64,
    lambda_random: f64,
    lambda_proposed: f64,
    lambda_alone: f64,
    outlook: Outlook,
}

/// The document.
pub fn document(ground: &Ground<'_>, result: &Result) -> PlanDocument {
    let (task, setup) = (ground.task, &ground.task.model.setup);
    let figures = |figures: &Figures| FiguresDocument {
        observability: figures.observability,
        accuracy_m: figures.accuracy,
        parameters: task
            .model
            .parameters()
            .zip(&figures.std)
            .map(|((effect, parameter), std)| ParameterRow {
                effect: effect.to_owned(),
                name: parameter.name.clone(),
                unit: parameter.unit.clone(),
                std: *std,
            })
            .collect(),
    };
    let (precision, separation) = match result {
        Result::Precision { aim, of, found } => (
            Some(PrecisionDocument {
                criterion: *aim,
                of: of.clone(),
                proposed: figures(&found.proposed),
                random: figures(&found.random),
                measured: found.measured.as_ref().map(figures),
                noise_m: found.noise,
                curve: found.curve.clone(),
                enough: found.enough,
            }),
            None,
        ),
        Result::Separation { found, fitted } => (
            None,
            Some(SeparationDocument {
                sizes: if *fitted { "fitted" } else { "typical" },
                ways: found.ways.iter().map(way).collect(),
            }),
        ),
    };
    let targets = task.protocol.targets.iter();
    PlanDocument {
        schema: "misfit.plan/1",
        effects: task
            .model
            .terms
            .iter()
            .map(|t| t.effect.id().to_owned())
            .collect(),
        joints: setup.robot.joints.iter().map(|j| j.name.clone()).collect(),
        poses: result.poses().to_vec(),
        protocol: ProtocolDocument {
            targets: targets.map(|&t| setup.targets[t].name.clone()).collect(),
            loads: task
                .protocol
                .loads
                .iter()
                .map(|load| {
                    load.map(|payload| LoadDocument {
                        mass_kg: payload.mass,
                        com_m: payload.com.into(),
                    })
                })
                .collect(),
            directions: task.protocol.directions.clone(),
            repeats: task.protocol.repeats,
        },
        readings: ground.future.readings.len(),
        measured: task.measured.len(),
        candidates: task.candidates,
        seed: task.seed,
        precision,
        separation,
    }
}

fn way(way: &Way) -> WayDocument {
    WayDocument {
        effect: way.effect.clone(),
        other: way.other.clone(),
        lambda_measured: way.measured,
        lambda_random: way.random,
        lambda_proposed: way.proposed,
        lambda_alone: way.alone,
        outlook: way.outlook(),
    }
}
