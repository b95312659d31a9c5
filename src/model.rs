//! The model: nominal robot plus effects. Predicts readings and how they change with every parameter.
//!
//! The prediction solves the loaded equilibrium: elastic effects move the arm, which moves the loads, until
//! both agree. Derivatives come in two exact steps: each effect's law by dual numbers, from parameters to
//! deviations; everything behind it (kinematics, geometric stiffness, frames) in closed form, from
//! deviations to the reading. One code path serves every effect.
//!
//! A reading has twelve rows: position, rotation vector (tracker's frame), force and torque of the wrist sensor
//! (link's frame). The wrench is a row only where a payload is known too; alone, it is the load.

use crate::campaign::{Campaign, Frame, Reading};
use crate::dual_quaternion::{DualQuaternion, constant, rotation_vector};
use crate::effects::{AnyEffect, DIRECTIONS, Dual, Parameter, Stage, rates, seeded};
use crate::posture::{Kind, Posture, Slots};
use crate::setup::Setup;
use crate::statics::{Load, Screw, Statics};
use nalgebra::{
    Const, DMatrix, DVector, Dyn, Isometry3, Matrix3, Matrix6, OMatrix, SVector, UnitQuaternion,
    Vector3, Vector6,
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
            let frames: &[Frame] = match term.effect.id() {
                "tracker_frame" => std::slice::from_ref(&campaign.base_from_tracker),
                "target_offset" => &campaign.link_from_target,
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

/// Changes of an equilibrium smaller than this (rad, m) are rounding.
const SETTLED: f64 = 1e-15;
const ITERATIONS: usize = 60;

/// Is the wrench of a reading measured beside a known load?
pub fn wrench_is_measured(reading: &Reading) -> bool {
    reading.payload.is_some() && reading.wrench.is_some()
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

    /// Predicts one reading.
    pub fn predict(&mut self, model: &Model, p: &[f64], reading: &Reading) -> Prediction {
        self.predict_to(model, p, reading, false, SETTLED)
    }

    /// The same, but the equilibrium need not be better than `enough`, rad (m); sought from the one before if that is
    /// `near`: the same model's and load's in nearly the same posture. Digits beyond `enough` depend on it.
    pub fn predict_to(
        &mut self,
        model: &Model,
        p: &[f64],
        reading: &Reading,
        near: bool,
        enough: f64,
    ) -> Prediction {
        self.rigid.fill(0.0);
        // a wrench that is the load is known before the statics; one beside a known load follows from them
        let measured = wrench_is_measured(reading);
        self.sensed = match (measured, reading.wrench) {
            (false, Some(wrench)) => stacked(&wrench.force, &wrench.torque),
            _ => Vector6::zeros(),
        };
        let mut posture = Posture {
            setup: &model.setup,
            reading,
            wrenches: &self.no_wrench,
            sensed: self.sensed,
            deviations: &mut self.rigid,
            base_from_tracker: DualQuaternion::identity(),
            link_from_target: DualQuaternion::identity(),
        };
        for term in &model.terms {
            match term.effect.stage() {
                Stage::Elastic => {}
                Stage::Sensor if measured => {}
                _ => term.effect.perturb(term.of(p), &mut posture),
            }
        }
        self.frames = Frames {
            base_from_tracker: posture.base_from_tracker,
            link_from_target: posture.link_from_target,
        };
        let settled = self.settle(model, p, reading, near, enough);
        let link = self.link(model, reading);
        self.origin = link.translation();
        self.target = link * self.frames.link_from_target;
        let wrench = if measured {
            self.sense(model, p, reading)
        } else {
            Vector6::zeros()
        };
        let seen = self.frames.base_from_tracker.conjugate() * self.target;
        let scale = 1.0 + self.deviations[self.slots.tracker_scale];
        let position = seen.translation() * scale;
        Prediction {
            position,
            orientation: seen.rotation(),
            wrench,
            settled: settled && position.iter().chain(&wrench).all(|x| x.is_finite()),
        }
    }

    /// The equilibrium of the reading last predicted, deviations by [`Slots`] in rad, m, kg, N·m: a place from where to seek
    /// one near to it.
    pub fn deviations(&self) -> &[f64] {
        &self.deviations
    }

    /// Torque of the load about each joint's axis in the predicted posture, N·m (N for a slide).
    pub fn joint_torques(&mut self, model: &Model, p: &[f64], reading: &Reading) -> Vec<f64> {
        self.predict(model, p, reading);
        self.torques(model, reading)
    }

    /// The same of the reading last predicted.
    pub fn torques(&mut self, model: &Model, reading: &Reading) -> Vec<f64> {
        let setup = &model.setup;
        let load = Load::of(setup, reading);
        self.statics.load(setup, &load, &self.deviations);
        let joints = setup
            .robot
            .joints
            .iter()
            .zip(&self.statics.local_wrench[1..]);
        joints
            .map(|(joint, wrench)| {
                let along = wrench.fixed_rows::<3>(joint.load_row());
                joint.axis.dot(&along)
            })
            .collect()
    }

    /// Where the model has the tracker at the reading last predicted: base frame.
    pub fn base_from_tracker(&self) -> Isometry3<f64> {
        self.frames.base_from_tracker.to_isometry()
    }

    /// Where each link of the robot stands in the posture last predicted: base frame.
    pub fn links(&self, setup: &Setup) -> Vec<Isometry3<f64>> {
        let links = setup.robot.links.iter();
        links
            .map(|link| self.statics.body[link.body].to_isometry() * link.body_from_link)
            .collect()
    }

    /// The first effect whose law has no value at a reading, or has no slope there by its parameters or by
    /// what it bears; the arm hangs under its load as if no elastic effect gave way.
    pub fn lost<'a>(&mut self, model: &'a Model, p: &[f64], reading: &Reading) -> Option<&'a str> {
        let setup = &model.setup;
        self.deviations.fill(0.0);
        self.statics.place(setup, &reading.joints, &self.deviations);
        self.statics
            .load(setup, &Load::of(setup, reading), &self.deviations);
        let wrenches = self.statics.local_wrench.iter();
        let wrenches: Vec<_> = wrenches.map(|wrench| wrench.map(constant)).collect();
        let is_number = |x: &Dual| {
            let mut slopes = rates(x).into_iter();
            x.re.is_finite() && slopes.all(|slopes| slopes.iter().all(|s| s.is_finite()))
        };
        let tried = |term: &Term, p: &[Dual], wrenches: &[Vector6<Dual>]| {
            let mut deviations = vec![constant(0.0); self.slots.count];
            let mut posture = Posture {
                setup,
                reading,
                wrenches,
                sensed: Vector6::from_element(constant(0.0)),
                deviations: &mut deviations,
                base_from_tracker: DualQuaternion::identity(),
                link_from_target: DualQuaternion::identity(),
            };
            term.effect.perturb_dual(p, &mut posture);
            let frames = [posture.base_from_tracker, posture.link_from_target];
            let frames = frames.iter().flat_map(|q| [q.real.coords, q.dual.coords]);
            let mut frames = frames.flat_map(|q| [q.x, q.y, q.z, q.w]);
            deviations.iter().all(is_number) && frames.all(|x| is_number(&x))
        };
        for term in &model.terms {
            let plain: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
            let mut good = (0..plain.len()).step_by(DIRECTIONS).all(|first| {
                let mut p = plain.clone();
                for (direction, x) in p.iter_mut().skip(first).take(DIRECTIONS).enumerate() {
                    *x = seeded(x.re, direction);
                }
                tried(term, &p, &wrenches)
            });
            if term.effect.stage() == Stage::Elastic {
                let along = |w: &Vector6<Dual>| Vector6::from_fn(|k, _| seeded(w[k].re, k));
                let wrenches: Vec<_> = wrenches.iter().map(along).collect();
                good = good && tried(term, &plain, &wrenches);
            }
            if !good {
                return Some(term.effect.id());
            }
        }
        None
    }

    /// What the wrist sensor reads of the known load: the truth, then the sensor's effects on it.
    fn sense(&mut self, model: &Model, p: &[f64], reading: &Reading) -> Vector6<f64> {
        self.sensed = self.statics.payload_wrench(&self.origin);
        let mut posture = Posture {
            setup: &model.setup,
            reading,
            wrenches: &self.no_wrench,
            sensed: self.sensed,
            deviations: &mut self.deviations,
            base_from_tracker: DualQuaternion::identity(),
            link_from_target: DualQuaternion::identity(),
        };
        for term in &model.terms {
            if term.effect.stage() == Stage::Sensor {
                term.effect.perturb(term.of(p), &mut posture);
            }
        }
        let first = self.slots.sensed;
        self.sensed + Vector6::from_column_slice(&self.deviations[first..first + 6])
    }

    /// base_from_link of the target's link in the posture last composed.
    fn link(&self, model: &Model, reading: &Reading) -> DualQuaternion<f64> {
        let link = &model.setup.robot.links[model.setup.targets[reading.target].link];
        self.statics.body[link.body] * DualQuaternion::from_isometry(&link.body_from_link)
    }

    /// Solves the loaded equilibrium into `deviations`, from what they are if that is near.
    fn settle(
        &mut self,
        model: &Model,
        p: &[f64],
        reading: &Reading,
        near: bool,
        enough: f64,
    ) -> bool {
        let setup = &model.setup;
        let load = Load::of(setup, reading);
        let elastic = model.is_elastic();
        if !(near && elastic) {
            self.deviations.copy_from_slice(&self.rigid);
        }
        self.statics.place(setup, &reading.joints, &self.deviations);
        if !elastic {
            if wrench_is_measured(reading) {
                self.statics.load(setup, &load, &self.deviations);
            }
            return true;
        }
        let mut last = f64::INFINITY;
        for _ in 0..ITERATIONS {
            self.statics.load(setup, &load, &self.deviations);
            self.elastic_law(model, p, reading);
            let mut step = self.largest_step();
            // Weights contract the fixed point by about 0.01 an iteration on a stiff arm; on a soft one
            // Newton's method takes over.
            if step > 0.1 * last {
                self.newton_target(model, p, reading);
                step = self.largest_step();
            }
            std::mem::swap(&mut self.deviations, &mut self.next);
            self.statics.place(setup, &reading.joints, &self.deviations);
            if step <= enough {
                return true;
            }
            if !step.is_finite() {
                return false;
            }
            // rounding floor: tiny and no longer falling
            if step < 1e-13 && step >= last {
                return true;
            }
            last = step;
        }
        false
    }

    fn largest_step(&self) -> f64 {
        self.next
            .iter()
            .zip(&self.deviations)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, |a, b| if b.is_nan() { f64::NAN } else { a.max(b) })
    }

    /// `next` = rigid deviations + elastic laws at the present wrenches.
    fn elastic_law(&mut self, model: &Model, p: &[f64], reading: &Reading) {
        self.next.copy_from_slice(&self.rigid);
        let mut posture = Posture {
            setup: &model.setup,
            reading,
            wrenches: &self.statics.local_wrench,
            sensed: self.sensed,
            deviations: &mut self.next,
            base_from_tracker: self.frames.base_from_tracker,
            link_from_target: self.frames.link_from_target,
        };
        for term in &model.terms {
            if term.effect.stage() == Stage::Elastic {
                term.effect.perturb(term.of(p), &mut posture);
            }
        }
    }

    /// Replaces `next` by the Newton step's target: solves `x + dx = law(x) + law'(x) dx`.
    fn newton_target(&mut self, model: &Model, p: &[f64], reading: &Reading) {
        self.find_elastic(model, p, reading);
        let n = self.elastic.len();
        if n == 0 {
            return;
        }
        let matrix = self.one_minus_stiffness(model);
        // a deviation moves by the sum of its parts, the first of which has its gap to close
        let mut gap = DVector::zeros(n);
        for (row, e) in self.elastic.iter().enumerate() {
            if self.elastic[..row].iter().all(|other| other.slot != e.slot) {
                gap[row] = self.next[e.slot] - self.deviations[e.slot];
            }
        }
        if let Some(step) = matrix.lu().solve(&gap) {
            for e in &self.elastic {
                self.next[e.slot] = self.deviations[e.slot];
            }
            for (e, step) in self.elastic.iter().zip(step.iter()) {
                self.next[e.slot] += step;
            }
        }
    }

    /// `1 - G`, `G` the elastic laws' answer to elastic deviations through the loads.
    fn one_minus_stiffness(&self, model: &Model) -> DMatrix<f64> {
        let n = self.elastic.len();
        let mut matrix = DMatrix::identity(n, n);
        for (column, e) in self.elastic.iter().enumerate() {
            for (row, value) in self.answers(model, e.kind).enumerate() {
                matrix[(row, column)] -= value;
            }
        }
        matrix
    }

    /// By elastic deviation: its law's answer to a unit of another deviation.
    fn answers(&self, model: &Model, kind: Kind) -> impl Iterator<Item = f64> {
        let screw = self.statics.screw(&model.setup, kind, &self.deviations);
        let moved = Statics::node_of(kind);
        self.elastic.iter().map(move |e| {
            let row = (&e.world.0, &e.world.1);
            match &screw {
                Some(screw) => {
                    let rates = self.statics.wrench_rates(row, e.node, moved);
                    rates.linear.dot(&screw.linear) + rates.angular.dot(&screw.angular)
                }
                None => self.statics.load_rate(&model.setup, row, e.node, kind),
            }
        })
    }

    /// Finds the deviations that depend on wrenches, and how: dual numbers along each wrench component, of all
    /// nodes at once, since most laws see only their own node's; those that see others one node at a time.
    fn find_elastic(&mut self, model: &Model, p: &[f64], reading: &Reading) {
        self.elastic.clear();
        let near = |term: &Term| {
            let elastic = term.effect.stage() == Stage::Elastic;
            elastic && term.effect.distant(&model.setup).is_empty()
        };
        self.find_elastic_of(model, p, reading, None, near);
        for term in &model.terms {
            if term.effect.stage() != Stage::Elastic {
                continue;
            }
            for joint in term.effect.distant(&model.setup) {
                let this = |other: &Term| std::ptr::eq(other, term);
                self.find_elastic_of(model, p, reading, Some(joint + 1), this);
            }
        }
    }

    /// The same for some of the terms, by the wrench of one node or (none) each deviation's own.
    fn find_elastic_of(
        &mut self,
        model: &Model,
        p: &[f64],
        reading: &Reading,
        only: Option<usize>,
        wanted: impl Fn(&Term) -> bool,
    ) {
        let wrenches = self.statics.local_wrench.iter();
        for (node, (dual, wrench)) in self.dual_wrenches.iter_mut().zip(wrenches).enumerate() {
            for k in 0..6 {
                dual[k] = match only {
                    Some(one) if one != node => constant(wrench[k]),
                    _ => seeded(wrench[k], k),
                };
            }
        }
        self.dual_deviations.fill(constant(0.0));
        let mut posture = Posture {
            setup: &model.setup,
            reading,
            wrenches: &self.dual_wrenches,
            sensed: self.sensed.map(constant),
            deviations: &mut self.dual_deviations,
            base_from_tracker: DualQuaternion::identity(),
            link_from_target: DualQuaternion::identity(),
        };
        for term in model.terms.iter().filter(|term| wanted(term)) {
            let p: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
            term.effect.perturb_dual(&p, &mut posture);
        }
        for (slot, value) in self.dual_deviations.iter().enumerate() {
            if let Some(rates) = rates(value) {
                let compliance = rates.fixed_rows::<6>(0).into_owned();
                if compliance != Vector6::zeros() {
                    let kind = self.slots.kind(slot);
                    let node = only.unwrap_or(Statics::node_of(kind).0);
                    self.elastic.push(Elastic {
                        kind,
                        slot,
                        node,
                        world: self.statics.world_row(node, &compliance),
                    });
                }
            }
        }
    }

    /// Predicts one reading, and its derivative: the rows for each parameter marked in `wanted`, written into
    /// the columns of `jacobian`.
    pub fn sensitivity(
        &mut self,
        model: &Model,
        p: &[f64],
        wanted: &[bool],
        reading: &Reading,
        jacobian: &mut Rows,
    ) -> Prediction {
        let prediction = self.prepare(model, p, reading, &[]);
        self.derivative(model, p, wanted, reading, jacobian);
        prediction
    }

    /// Predicts one reading, and how it answers deviations: what [`Workspace::derivative`] goes on from. The equilibrium is
    /// sought from the [`Workspace::deviations`] of one that is `near`, if there are any.
    pub fn prepare(
        &mut self,
        model: &Model,
        p: &[f64],
        reading: &Reading,
        near: &[f64],
    ) -> Prediction {
        let mut prediction = None;
        if !near.is_empty() {
            self.deviations.copy_from_slice(near);
            let found = self.predict_to(model, p, reading, true, SETTLED);
            prediction = found.settled.then_some(found);
        }
        let prediction = prediction.unwrap_or_else(|| self.predict(model, p, reading));
        self.prepare_response(model, p, reading);
        prediction
    }

    /// The derivative of the reading last prepared, as [`Workspace::sensitivity`] has it; or of one that differs from it
    /// only in what effects with parameters of zero see.
    pub fn derivative(
        &mut self,
        model: &Model,
        p: &[f64],
        wanted: &[bool],
        reading: &Reading,
        jacobian: &mut Rows,
    ) {
        jacobian.fill(0.0);
        self.entries.clear();
        self.dual_deviations.fill(constant(0.0));
        for index in 0..model.terms.len() {
            self.term_entries(model, index, p, wanted, reading, jacobian);
        }
        let entries = std::mem::take(&mut self.entries);
        for entry in &entries {
            let row = self.slot_row(model, reading, entry.slot);
            let mut column = jacobian.column_mut(entry.parameter);
            column += row * entry.value;
        }
        self.entries = entries;
    }

    /// The rows for a unit of each joint's angle, the load following: what a joint's lack of repeatability does
    /// to the reading.
    pub fn joint_jacobian(
        &mut self,
        model: &Model,
        p: &[f64],
        reading: &Reading,
        jacobian: &mut Rows,
    ) -> Prediction {
        let prediction = self.prepare(model, p, reading, &[]);
        for joint in 0..model.setup.robot.joints.len() {
            let row = self.slot_row(model, reading, joint);
            jacobian.set_column(joint, &row);
        }
        prediction
    }

    /// Motion of the target under a unit of a joint's angle in the posture last predicted, the deflections left as they
    /// are: `[v; ω]` in the tracker's frame, of the target's origin.
    pub fn joint_twist(&self, model: &Model, reading: &Reading, joint: usize) -> Vector6<f64> {
        self.direct_row(model, reading, Kind::Joint(joint))
    }

    /// Sets up how the target answers elastic deviations: `response = Y_e (1 - G)⁻¹`, 6 × elastic.
    fn prepare_response(&mut self, model: &Model, p: &[f64], reading: &Reading) {
        self.slot_rows.fill(None);
        self.by_screw.fill(None);
        self.sensor = match wrench_is_measured(reading) {
            true => self.sensor_gain(model, p, reading),
            false => Matrix6::identity(),
        };
        if model.is_elastic() {
            self.find_elastic(model, p, reading);
        } else {
            self.elastic.clear();
        }
        let n = self.elastic.len();
        let mut direct = DMatrix::zeros(6, n);
        for (column, e) in self.elastic.iter().enumerate() {
            direct.set_column(column, &self.direct_row(model, reading, e.kind));
        }
        if n == 0 {
            // nalgebra's LU refuses a system of none
            self.response = direct;
            return;
        }
        let matrix = self.one_minus_stiffness(model);
        self.response = match matrix.transpose().lu().solve(&direct.transpose()) {
            Some(solution) => solution.transpose(),
            // a posture at the edge of collapse: the direct answer is the best there is
            None => direct,
        };
    }

    /// Change of what the wrist sensor reads with the true wrench, its effects included.
    fn sensor_gain(&mut self, model: &Model, p: &[f64], reading: &Reading) -> Matrix6<f64> {
        self.dual_deviations.fill(constant(0.0));
        let mut sensed = self.sensed.map(constant);
        for k in 0..6 {
            sensed[k] = seeded(self.sensed[k], k);
        }
        let mut posture = Posture {
            setup: &model.setup,
            reading,
            wrenches: &self.dual_wrenches,
            sensed,
            deviations: &mut self.dual_deviations,
            base_from_tracker: DualQuaternion::identity(),
            link_from_target: DualQuaternion::identity(),
        };
        for term in &model.terms {
            if term.effect.stage() == Stage::Sensor {
                let p: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
                term.effect.perturb_dual(&p, &mut posture);
            }
        }
        let mut gain = Matrix6::identity();
        for row in 0..6 {
            if let Some(rates) = rates(&self.dual_deviations[self.slots.sensed + row]) {
                for column in 0..6 {
                    gain[(row, column)] += rates[column];
                }
            }
        }
        gain
    }

    /// Motion of the target as the tracker sees it under a unit of a deviation, the loads left where they are.
    fn direct_row(&self, model: &Model, reading: &Reading, kind: Kind) -> Vector6<f64> {
        if kind == Kind::TrackerScale {
            let seen = self.frames.base_from_tracker.conjugate() * self.target;
            return stacked(&seen.translation(), &Vector3::zeros());
        }
        let Some(screw) = self.statics.screw(&model.setup, kind, &self.deviations) else {
            return Vector6::zeros();
        };
        let (node, _) = Statics::node_of(kind);
        let body = model.setup.target_body(reading.target);
        if !self.statics.carries(node, body) {
            return Vector6::zeros();
        }
        self.seen(&screw)
    }

    /// Motion of the target under a screw in the base frame, in the tracker's frame.
    fn seen(&self, screw: &Screw) -> Vector6<f64> {
        let point = self.target.translation();
        let back = self.frames.base_from_tracker.conjugate();
        let scale = 1.0 + self.deviations[self.slots.tracker_scale];
        stacked(
            &(back.transform_vector(&screw.at(&point)) * scale),
            &back.transform_vector(&screw.angular),
        )
    }

    /// What a screw of all that a node carries does to the target as the tracker sees it, the loads following.
    fn by_screw(
        &mut self,
        model: &Model,
        reading: &Reading,
        (node, turns_joint_frame): (usize, bool),
    ) -> Matrix6<f64> {
        let place = 2 * node + usize::from(turns_joint_frame);
        if let Some(known) = self.by_screw[place] {
            return known;
        }
        let mut by_screw = Matrix6::zeros();
        if self
            .statics
            .carries(node, model.setup.target_body(reading.target))
        {
            let back = self.frames.base_from_tracker.rotation().inverse();
            let back = back.to_rotation_matrix().into_inner();
            let scale = 1.0 + self.deviations[self.slots.tracker_scale];
            let lever = -self.target.translation().cross_matrix();
            let mut part = |row, column, own: Matrix3<f64>| {
                by_screw.fixed_view_mut::<3, 3>(row, column).copy_from(&own);
            };
            part(0, 0, back * scale);
            part(0, 3, back * lever * scale);
            part(3, 3, back);
        }
        for (column, e) in self.elastic.iter().enumerate() {
            let row = (&e.world.0, &e.world.1);
            let moved = (node, turns_joint_frame);
            let rates = self.statics.wrench_rates(row, e.node, moved);
            let rates = stacked(&rates.linear, &rates.angular);
            by_screw += self.response.fixed_view::<6, 1>(0, column) * rates.transpose();
        }
        self.by_screw[place] = Some(by_screw);
        by_screw
    }

    /// What a unit of a deviation does to the reading, the loads following.
    fn slot_row(&mut self, model: &Model, reading: &Reading, slot: usize) -> Row {
        if let Some(row) = self.slot_rows[slot] {
            return row;
        }
        let kind = self.slots.kind(slot);
        let pose = match self.statics.screw(&model.setup, kind, &self.deviations) {
            Some(screw) => {
                let by_screw = self.by_screw(model, reading, Statics::node_of(kind));
                by_screw * stacked(&screw.linear, &screw.angular)
            }
            None => {
                let mut pose = self.direct_row(model, reading, kind);
                for (column, answer) in self.answers(model, kind).enumerate() {
                    if answer != 0.0 {
                        pose += self.response.fixed_view::<6, 1>(0, column) * answer;
                    }
                }
                pose
            }
        };
        let mut row = Row::zeros();
        row.fixed_rows_mut::<6>(0).copy_from(&pose);
        if wrench_is_measured(reading) {
            let turn = pose.fixed_rows::<3>(3).into_owned();
            let turn = self.frames.base_from_tracker.transform_vector(&turn);
            let wrench = match kind {
                Kind::Sensed(k) => Vector6::ith(k, 1.0),
                _ => self.sensor * self.statics.payload_wrench_rate(&self.origin, &turn, kind),
            };
            row.fixed_rows_mut::<6>(6).copy_from(&wrench);
        }
        self.slot_rows[slot] = Some(row);
        row
    }

    /// One effect's derivative: deviations into `entries`, frames straight into `jacobian`.
    fn term_entries(
        &mut self,
        model: &Model,
        index: usize,
        p: &[f64],
        wanted: &[bool],
        reading: &Reading,
        jacobian: &mut Rows,
    ) {
        let term = &model.terms[index];
        let count = term.parameters.len();
        let free: Vec<usize> = (0..count).filter(|k| wanted[term.first + k]).collect();
        for chunk in free.chunks(DIRECTIONS) {
            let mut duals: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
            for (direction, &k) in chunk.iter().enumerate() {
                duals[k] = seeded(duals[k].re, direction);
            }
            if term.effect.stage() == Stage::Elastic {
                for (dual, wrench) in self
                    .dual_wrenches
                    .iter_mut()
                    .zip(&self.statics.local_wrench)
                {
                    *dual = wrench.map(constant);
                }
            }
            let mut posture = Posture {
                setup: &model.setup,
                reading,
                wrenches: &self.dual_wrenches,
                sensed: self.sensed.map(constant),
                deviations: &mut self.dual_deviations,
                base_from_tracker: DualQuaternion::identity(),
                link_from_target: DualQuaternion::identity(),
            };
            if term.effect.stage() == Stage::Instrument {
                // frames compose: all instrument effects act in turn, this one with derivatives
                for (other, t) in model.terms.iter().enumerate() {
                    if other == index {
                        term.effect.perturb_dual(&duals, &mut posture);
                    } else if t.effect.stage() == Stage::Instrument {
                        let p: Vec<Dual> = t.of(p).iter().map(|&x| constant(x)).collect();
                        t.effect.perturb_dual(&p, &mut posture);
                    }
                }
            } else {
                term.effect.perturb_dual(&duals, &mut posture);
            }
            let (tracker, target) = (posture.base_from_tracker, posture.link_from_target);
            for (slot, value) in self.dual_deviations.iter_mut().enumerate() {
                if let Some(rates) = rates(value) {
                    for (direction, &k) in chunk.iter().enumerate() {
                        if rates[direction] != 0.0 {
                            self.entries.push(Entry {
                                slot,
                                parameter: term.first + k,
                                value: rates[direction],
                            });
                        }
                    }
                } else if value.re == 0.0 {
                    continue;
                }
                // few are touched: to clean these alone is sooner done
                *value = constant(0.0);
            }
            if term.effect.stage() == Stage::Instrument {
                for (direction, &k) in chunk.iter().enumerate() {
                    let by_tracker = screw_of(&tracker, direction);
                    let by_target = self.in_base(model, reading, &screw_of(&target, direction));
                    let net = Screw {
                        linear: by_target.linear - by_tracker.linear,
                        angular: by_target.angular - by_tracker.angular,
                    };
                    let pose = self.seen(&net);
                    let mut column = jacobian.column_mut(term.first + k);
                    column.rows_mut(0, 6).copy_from(&pose);
                }
            }
        }
    }

    /// A screw given in the target's link frame, in the base frame.
    fn in_base(&self, model: &Model, reading: &Reading, screw: &Screw) -> Screw {
        let base_from_link = self.link(model, reading);
        let angular = base_from_link.transform_vector(&screw.angular);
        let origin = base_from_link.translation();
        Screw {
            linear: base_from_link.transform_vector(&screw.linear) - angular.cross(&origin),
            angular,
        }
    }
}

/// Two vectors, one on the other.
pub fn stacked(above: &Vector3<f64>, below: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(above.x, above.y, above.z, below.x, below.y, below.z)
}

impl Term {
    /// This effect's part of the parameter vector.
    pub fn of<'a>(&self, p: &'a [f64]) -> &'a [f64] {
        &p[self.first..self.first + self.parameters.len()]
    }
}

/// Rate of a pose along one direction, as a screw at the origin of the frame that it maps into.
fn screw_of(pose: &DualQuaternion<Dual>, direction: usize) -> Screw {
    let part = |x: &Dual| rates(x).map_or(0.0, |r| r[direction]);
    let value = |q: &nalgebra::Quaternion<Dual>| nalgebra::Quaternion::from(q.coords.map(|x| x.re));
    let rate =
        |q: &nalgebra::Quaternion<Dual>| nalgebra::Quaternion::from(q.coords.map(|x| part(&x)));
    let (real, dual) = (value(&pose.real), value(&pose.dual));
    let (real_rate, dual_rate) = (rate(&pose.real), rate(&pose.dual));
    Screw {
        linear: (dual_rate * real.conjugate() + real_rate * dual.conjugate()).imag() * 2.0,
        angular: (real_rate * real.conjugate()).imag() * 2.0,
    }
}

/// Inverse of the right Jacobian of SO(3): `log(R exp(-ω)) ≈ log R - J⁻¹ ω`.
///
/// Source: Barfoot 2017, *State Estimation for Robotics*, eq. 7.76.
pub fn right_jacobian_inverse(vector: &Vector3<f64>) -> Matrix3<f64> {
    let cross = vector.cross_matrix();
    let angle2 = vector.norm_squared();
    let b = if angle2 < 1e-8 {
        1.0 / 12.0 + angle2 / 720.0
    } else {
        let angle = angle2.sqrt();
        1.0 / angle2 - 1.0 / (2.0 * angle * (angle / 2.0).tan())
    };
    Matrix3::identity() + cross * 0.5 + cross * cross * b
}
