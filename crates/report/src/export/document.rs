//! Everything identified, as JSON.

use super::Subject;
use misfit_arm::robot::{Joint, JointKind, rpy};
use misfit_core::effects::Role;
use misfit_core::effects::Stage;
use misfit_core::export::{Calibrated, LeftOut};
use misfit_core::fit::{Fit, Status};
use nalgebra::Isometry3;
use serde::Serialize;

/// `misfit.export/1`.
#[derive(Debug, Serialize)]
pub struct Document {
    schema: &'static str,
    campaign: String,
    robot: String,
    effects: Vec<String>,
    converged: bool,
    readings: usize,
    position_rms_m: f64,
    parameters: Vec<ParameterDocument>,
    frames: FramesDocument,
    joints: Vec<JointDocument>,
    links: Vec<LinkDocument>,
    stiffness: Vec<StiffnessDocument>,
    rigid: Vec<String>,
    not_rigid: Vec<LeftOutDocument>,
}

#[derive(Debug, Serialize)]
struct ParameterDocument {
    effect: String,
    name: String,
    unit: String,
    value: f64,
    std: Option<f64>,
    status: Status,
    of_measurement: bool,
}

#[derive(Debug, Serialize)]
struct FramesDocument {
    base_from_tracker: PoseDocument,
    targets: Vec<TargetDocument>,
}

#[derive(Debug, Serialize)]
struct TargetDocument {
    target: String,
    link: String,
    link_from_target: PoseDocument,
}

/// A pose in three spellings of its rotation's one: the quaternion, and roll, pitch, yaw as in a URDF.
#[derive(Debug, Serialize)]
struct PoseDocument {
    xyz_m: [f64; 3],
    qwxyz: [f64; 4],
    rpy_rad: [f64; 3],
}

#[derive(Debug, Serialize)]
struct JointDocument {
    joint: String,
    kind: &'static str,
    /// Name of the body that carries it.
    parent: String,
    /// Name of the body that it moves.
    child: String,
    axis: [f64; 3],
    /// What the joint's angle is more than its encoder says, rad (m).
    offset: f64,
    /// At encoder zero, in the frame of the body that carries it.
    parent_from_joint: PoseDocument,
    nominal_parent_from_joint: PoseDocument,
    /// What the joint moves, behind its nominal frame.
    joint_from_body: PoseDocument,
    mass_kg: f64,
    nominal_mass_kg: f64,
}

#[derive(Debug, Serialize)]
struct LinkDocument {
    link: String,
    body: String,
    /// In the frame that the body's joint moves.
    body_from_link: PoseDocument,
}

#[derive(Debug, Serialize)]
struct StiffnessDocument {
    joint: String,
    /// rad/(N·m) or m/N.
    compliance: f64,
    compliance_unit: String,
    /// N·m/rad or N/m; none for a rigid joint, or one that the readings do not show.
    stiffness: Option<f64>,
    stiffness_unit: &'static str,
    /// 95 %; no upper end where the joint may be rigid.
    interval_95: Option<(f64, Option<f64>)>,
    status: Status,
}

#[derive(Debug, Serialize)]
struct LeftOutDocument {
    effect: String,
    stage: &'static str,
    /// How far it moves the targets of the campaign's readings.
    rms_m: f64,
    max_m: f64,
}

fn pose(pose: &Isometry3<f64>) -> PoseDocument {
    let t = &pose.translation.vector;
    let q = &pose.rotation;
    PoseDocument {
        xyz_m: [t.x, t.y, t.z],
        qwxyz: [q.w, q.i, q.j, q.k],
        rpy_rad: rpy(q),
    }
}

/// The document.
pub fn document(subject: &Subject<'_>) -> Document {
    let Subject {
        campaign,
        fit,
        calibrated,
    } = subject;
    let setup = &calibrated.setup;
    let (nominal, robot) = (&setup.robot, calibrated.robot());
    let of_measurement = |id: &str| {
        let term = fit.model.term(id);
        term.is_some_and(|term| term.effect.is_of_measurement())
    };
    let parameters = fit.model.parameters().enumerate();
    let parameters = parameters.map(|(k, (effect, parameter))| ParameterDocument {
        effect: effect.to_owned(),
        name: parameter.name.clone(),
        unit: parameter.unit.clone(),
        value: fit.values[k],
        std: fit.std[k],
        status: fit.status[k],
        of_measurement: of_measurement(effect),
    });
    let links = robot.links.iter().map(|link| LinkDocument {
        link: link.name.clone(),
        body: robot.bodies[link.body].name.clone(),
        body_from_link: pose(&link.body_from_link),
    });
    Document {
        schema: "misfit.export/1",
        campaign: campaign.name.clone(),
        robot: nominal.name.clone(),
        effects: fit
            .model
            .terms
            .iter()
            .map(|t| t.effect.id().to_owned())
            .collect(),
        converged: fit.converged,
        readings: fit.readings.0,
        position_rms_m: fit.fit.position_rms_m,
        parameters: parameters.collect(),
        frames: frames(calibrated),
        joints: joints(calibrated),
        links: links.collect(),
        stiffness: stiffness(fit),
        rigid: calibrated.held.clone(),
        not_rigid: left_out(fit, calibrated),
    }
}

fn frames(calibrated: &Calibrated) -> FramesDocument {
    let setup = &calibrated.setup;
    let or_identity = |frame: &Option<Isometry3<f64>>| pose(&frame.unwrap_or_default());
    let targets = setup.targets.iter().zip(&calibrated.link_from_target);
    let targets = targets.map(|(target, frame)| TargetDocument {
        target: target.name.clone(),
        link: setup.robot.links[target.link].name.clone(),
        link_from_target: or_identity(frame),
    });
    FramesDocument {
        base_from_tracker: or_identity(&calibrated.base_from_tracker),
        targets: targets.collect(),
    }
}

fn joints(calibrated: &Calibrated) -> Vec<JointDocument> {
    let (nominal, robot) = (&calibrated.setup.robot, calibrated.robot());
    let joints = nominal.joints.iter().enumerate();
    let document = |(index, joint): (usize, &Joint)| JointDocument {
        joint: joint.name.clone(),
        kind: match joint.kind {
            JointKind::Revolute => "revolute",
            JointKind::Continuous => "continuous",
            JointKind::Prismatic => "prismatic",
        },
        parent: nominal.bodies[joint.parent].name.clone(),
        child: nominal.bodies[index + 1].name.clone(),
        axis: [joint.axis.x, joint.axis.y, joint.axis.z],
        offset: calibrated.offsets[index],
        parent_from_joint: pose(&robot.joints[index].parent_from_joint),
        nominal_parent_from_joint: pose(&joint.parent_from_joint),
        joint_from_body: pose(&calibrated.motions[index + 1]),
        mass_kg: robot.bodies[index + 1].mass,
        nominal_mass_kg: nominal.bodies[index + 1].mass,
    };
    joints.map(document).collect()
}

/// Effects that are no part of a rigid robot.
fn left_out(fit: &Fit, calibrated: &Calibrated) -> Vec<LeftOutDocument> {
    let left_out = calibrated.left_out.iter();
    let document = |out: &LeftOut| LeftOutDocument {
        effect: out.effect.clone(),
        stage: fit
            .model
            .term(&out.effect)
            .map_or(Stage::Rigid, |term| term.effect.stage())
            .word(),
        rms_m: out.rms,
        max_m: out.most,
    };
    left_out.map(document).collect()
}

fn stiffness(fit: &Fit) -> Vec<StiffnessDocument> {
    let Some(term) = fit.model.term_of(Role::Spring) else {
        return Vec::new();
    };
    let quantile = fit.quantile();
    let rows = term.parameters.iter().enumerate();
    rows.map(|(index, parameter)| {
        let k = term.first + index;
        let c = fit.values[k];
        let seen = fit.status[k] != Status::Unobservable;
        let half = fit.std[k].filter(|_| seen).map(|std| std * quantile);
        StiffnessDocument {
            joint: parameter.name.clone(),
            compliance: c,
            compliance_unit: parameter.unit.clone(),
            stiffness: (seen && c > 0.0).then(|| 1.0 / c),
            stiffness_unit: if parameter.unit == "m/N" {
                "N/m"
            } else {
                "N·m/rad"
            },
            interval_95: half
                .filter(|half| c + half > 0.0)
                .map(|half| (1.0 / (c + half), (c > half).then(|| 1.0 / (c - half)))),
            status: fit.status[k],
        }
    })
    .collect()
}
