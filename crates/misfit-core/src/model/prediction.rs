//! Predictions: the loaded equilibrium of one reading, and what the instruments see of it.

use super::{Elastic, Frames, Model, Prediction, Term, Workspace, stacked};
use crate::campaign::Reading;
use crate::campaign::wrench_is_measured;
use crate::dual_quaternion::{DualQuaternion, constant};
use crate::effects::{Dual, Stage, rates, seeded};
use crate::posture::{Kind, Posture};
use crate::setup::Setup;
use crate::statics::{Load, Statics};
use nalgebra::{DMatrix, DVector, Isometry3, Vector6};

/// Changes of an equilibrium smaller than this (rad, m) are rounding.
pub(super) const SETTLED: f64 = 1e-15;
const ITERATIONS: usize = 60;

impl Workspace {
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
        let wrenches = &self.no_wrench;
        let rigid = &mut self.rigid;
        let mut posture = Posture::new(&model.setup, reading, wrenches, self.sensed, rigid);
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

    /// The equilibrium of the reading last predicted, deviations by [`Slots`](crate::posture::Slots) in rad, m, kg, N·m: a place from where to seek
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

    /// What the wrist sensor reads of the known load: the truth, then the sensor's effects on it.
    fn sense(&mut self, model: &Model, p: &[f64], reading: &Reading) -> Vector6<f64> {
        self.sensed = self.statics.payload_wrench(&self.origin);
        let wrenches = &self.no_wrench;
        let all = &mut self.deviations;
        let mut posture = Posture::new(&model.setup, reading, wrenches, self.sensed, all);
        for term in &model.terms {
            if term.effect.stage() == Stage::Sensor {
                term.effect.perturb(term.of(p), &mut posture);
            }
        }
        let first = self.slots.sensed;
        self.sensed + Vector6::from_column_slice(&self.deviations[first..first + 6])
    }

    /// base_from_link of the target's link in the posture last composed.
    pub(super) fn link(&self, model: &Model, reading: &Reading) -> DualQuaternion<f64> {
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
        let wrenches = &self.statics.local_wrench;
        let next = &mut self.next;
        let mut posture = Posture::new(&model.setup, reading, wrenches, self.sensed, next);
        posture.base_from_tracker = self.frames.base_from_tracker;
        posture.link_from_target = self.frames.link_from_target;
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
    pub(super) fn one_minus_stiffness(&self, model: &Model) -> DMatrix<f64> {
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
    pub(super) fn answers(&self, model: &Model, kind: Kind) -> impl Iterator<Item = f64> {
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
    pub(super) fn find_elastic(&mut self, model: &Model, p: &[f64], reading: &Reading) {
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
        let wrenches = &self.dual_wrenches;
        let sensed = self.sensed.map(constant);
        let duals = &mut self.dual_deviations;
        let mut posture = Posture::new(&model.setup, reading, wrenches, sensed, duals);
        for term in model.terms.iter().filter(|term| wanted(term)) {
            let p: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
            term.effect.perturb_dual(&p, &mut posture);
        }
        for slot in posture.touched() {
            let value = std::mem::replace(&mut self.dual_deviations[slot], constant(0.0));
            if let Some(rates) = rates(&value) {
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
}
