//! The model: nominal robot plus effects. Predicts readings and how they change with every parameter.
//!
//! The prediction solves the loaded equilibrium: elastic effects move the arm, which moves the loads, until
//! both agree. Derivatives come in two exact steps: each effect's law by dual numbers, from parameters to
//! deviations; everything behind it (kinematics, geometric stiffness, frames) in closed form, from
//! deviations to the reading. One code path serves every effect.
//!
//! A reading has twelve rows: position, rotation vector (tracker's frame), force and torque of the wrist sensor
//! (link's frame). The wrench is a row only where a payload is known too; alone, it is the load.

mod derivative;
mod prediction;

use crate::campaign::{Campaign, Frame};
use crate::dual_quaternion::{DualQuaternion, constant, rotation_vector};
use crate::effects::{AnyEffect, Dual, Parameter, Role, Stage};
use crate::posture::{Kind, Slots};
use crate::setup::Setup;
use crate::statics::Statics;
pub use derivative::right_jacobian_inverse;
use nalgebra::{
    Const, DMatrix, Dyn, Isometry3, Matrix6, OMatrix, SVector, UnitQuaternion, Vector3, Vector6,
};
use std::sync::Arc;

/// An effect with its parameters, and where they start in the model's parameter vector.
#[derive(Debug, Clone)]
pub struct Term {
    /// The effect.
    pub effect: Arc<dyn AnyEffect>,
    /// Its parameters: start or held values, bounds.
    pub parameters: Vec<Parameter>,
    /// Index of the first in the parameter vector.
    pub first: usize,
}

/// Nominal robot and effects.
#[derive(Debug, Clone)]
pub struct Model {
    /// What is fixed.
    pub setup: Setup,
    /// Effects in the order in which they act.
    pub terms: Vec<Term>,
}

impl Model {
    /// A model of these effects with their default parameters.
    pub fn new(setup: Setup, effects: &[Arc<dyn AnyEffect>]) -> Self {
        let mut first = 0;
        let terms = effects
            .iter()
            .map(|effect| {
                let parameters = effect.parameters(&setup);
                let term = Term {
                    effect: effect.clone(),
                    first,
                    parameters,
                };
                first += term.parameters.len();
                term
            })
            .collect();
        Self { setup, terms }
    }

    /// The same model with one effect more, its parameters free and at zero.
    pub fn with(&self, effect: &Arc<dyn AnyEffect>) -> Self {
        let mut terms = self.terms.clone();
        let first = terms.last().map_or(0, |t| t.first + t.parameters.len());
        terms.push(Term {
            effect: effect.clone(),
            parameters: effect.parameters(&self.setup),
            first,
        });
        Self {
            setup: self.setup.clone(),
            terms,
        }
    }

    /// The same model without one of its effects.
    pub fn without(&self, id: &str) -> Self {
        let mut terms = Vec::new();
        let mut first = 0;
        for term in self.terms.iter().filter(|term| term.effect.id() != id) {
            let mut term = term.clone();
            term.first = first;
            first += term.parameters.len();
            terms.push(term);
        }
        Self {
            setup: self.setup.clone(),
            terms,
        }
    }

    /// Holds the frames that a campaign knows at their poses.
    pub fn hold_known_frames(&mut self, campaign: &Campaign) {
        for term in &mut self.terms {
            let frames: &[Frame] = match term.effect.role() {
                Some(Role::TrackerFrame) => std::slice::from_ref(&campaign.base_from_tracker),
                Some(Role::TargetFrame) => &campaign.link_from_target,
                _ => continue,
            };
            for (frame, parameters) in frames.iter().zip(term.parameters.chunks_exact_mut(6)) {
                let Frame::Known(pose) = frame else { continue };
                for (parameter, value) in parameters.iter_mut().zip(pose_numbers(pose)) {
                    parameter.value = value;
                    parameter.vary = false;
                }
            }
        }
    }

    /// All parameters in the order of the parameter vector, each with its effect's id.
    pub fn parameters(&self) -> impl Iterator<Item = (&str, &Parameter)> {
        self.terms.iter().flat_map(|term| {
            let id = term.effect.id();
            term.parameters.iter().map(move |parameter| (id, parameter))
        })
    }

    /// Start values of all parameters.
    pub fn start(&self) -> Vec<f64> {
        self.parameters()
            .map(|(_, parameter)| parameter.value)
            .collect()
    }

    /// Does the model hold an effect?
    pub fn has(&self, id: &str) -> bool {
        self.terms.iter().any(|term| term.effect.id() == id)
    }

    /// Does anything of the model give way under load?
    pub fn is_elastic(&self) -> bool {
        let elastic = |term: &Term| term.effect.stage() == Stage::Elastic;
        self.terms.iter().any(elastic)
    }

    /// The term of an effect.
    pub fn term(&self, id: &str) -> Option<&Term> {
        self.terms.iter().find(|term| term.effect.id() == id)
    }

    /// The term whose effect plays a role.
    pub fn term_of(&self, role: Role) -> Option<&Term> {
        let plays = |term: &&Term| term.effect.role() == Some(role);
        self.terms.iter().find(plays)
    }
}

/// The six numbers of a pose: translation (m), rotation vector (rad).
pub fn pose_numbers(pose: &Isometry3<f64>) -> [f64; 6] {
    let t = pose.translation.vector;
    let r = rotation_vector(&pose.rotation.into_inner());
    [t.x, t.y, t.z, r.x, r.y, r.z]
}

/// What the model says a reading should be.
#[derive(Debug, Clone, Copy)]
pub struct Prediction {
    /// Target position in the tracker's frame, m.
    pub position: Vector3<f64>,
    /// tracker_from_target rotation.
    pub orientation: UnitQuaternion<f64>,
    /// What the wrist sensor should read, `[f; m]`, link frame, N and N·m: the payload's weight.
    pub wrench: Vector6<f64>,
    /// Did the loaded equilibrium converge, and to numbers?
    pub settled: bool,
}

/// Position 3 (m), rotation vector 3 (rad), force 3 (N), torque 3 (N·m).
pub const ROWS: usize = 12;
/// The rows of one reading.
pub type Row = SVector<f64, ROWS>;
/// The rows of one reading by one column a parameter.
pub type Rows = OMatrix<f64, Const<ROWS>, Dyn>;

/// Buffers for predictions of one robot; one a thread.
pub struct Workspace {
    statics: Statics,
    slots: Slots,
    rigid: Vec<f64>,
    deviations: Vec<f64>,
    next: Vec<f64>,
    no_wrench: Vec<Vector6<f64>>,
    dual_wrenches: Vec<Vector6<Dual>>,
    /// All zero but while an effect is asked: who asks one cleans up.
    dual_deviations: Vec<Dual>,
    frames: Frames,
    /// base_from_target of the posture last predicted, and the origin of the target's link.
    target: DualQuaternion<f64>,
    origin: Vector3<f64>,
    sensed: Vector6<f64>,
    elastic: Vec<Elastic>,
    entries: Vec<Entry>,
    slot_rows: Vec<Option<Row>>,
    /// By node, and whether its joint frame turns too.
    by_screw: Vec<Option<Matrix6<f64>>>,
    response: DMatrix<f64>,
    /// What the wrist sensor makes of a change of the true wrench.
    sensor: Matrix6<f64>,
}

#[derive(Clone, Copy)]
struct Frames {
    base_from_tracker: DualQuaternion<f64>,
    link_from_target: DualQuaternion<f64>,
}

/// A deviation's dependence on the wrench at a node: its own, or that of a torque that its law reads. One
/// deviation may have several.
struct Elastic {
    kind: Kind,
    slot: usize,
    /// Node of the wrench.
    node: usize,
    /// By the wrench's components in the base frame: of the force, and of the moment.
    world: (Vector3<f64>, Vector3<f64>),
}

/// A parameter's push on one deviation.
struct Entry {
    slot: usize,
    parameter: usize,
    value: f64,
}

impl Workspace {
    /// Buffers for a model's robot.
    pub fn new(setup: &Setup) -> Self {
        let slots = Slots::of(setup);
        let nodes = setup.robot.bodies.len();
        Self {
            statics: Statics::new(setup),
            slots,
            rigid: vec![0.0; slots.count],
            deviations: vec![0.0; slots.count],
            next: vec![0.0; slots.count],
            no_wrench: vec![Vector6::zeros(); nodes],
            dual_wrenches: vec![Vector6::from_element(constant(0.0)); nodes],
            dual_deviations: vec![constant(0.0); slots.count],
            frames: Frames {
                base_from_tracker: DualQuaternion::identity(),
                link_from_target: DualQuaternion::identity(),
            },
            target: DualQuaternion::identity(),
            origin: Vector3::zeros(),
            sensed: Vector6::zeros(),
            elastic: Vec::new(),
            entries: Vec::new(),
            slot_rows: vec![None; slots.count],
            by_screw: vec![None; 2 * nodes],
            response: DMatrix::zeros(0, 0),
            sensor: Matrix6::identity(),
        }
    }
}

/// Two vectors, one on the other.
pub fn stacked(above: &Vector3<f64>, below: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(above.x, above.y, above.z, below.x, below.y, below.z)
}

impl Term {
    /// Index in the parameter vector of this effect's first parameter at a joint.
    pub fn of_joint(&self, joint: usize) -> Option<usize> {
        let mut parameters = self.parameters.iter();
        let place = parameters.position(|parameter| parameter.joint() == Some(joint))?;
        Some(self.first + place)
    }

    /// This effect's part of the parameter vector.
    pub fn of<'a>(&self, p: &'a [f64]) -> &'a [f64] {
        &p[self.first..self.first + self.parameters.len()]
    }
}
