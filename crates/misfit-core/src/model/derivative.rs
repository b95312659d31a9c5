//! How a prediction changes with every parameter, and where it does not.

use super::prediction::SETTLED;
use super::{Entry, Model, Prediction, Row, Rows, Term, Workspace, stacked};
use crate::campaign::Reading;
use crate::campaign::wrench_is_measured;
use crate::dual_quaternion::{DualQuaternion, constant};
use crate::effects::{DIRECTIONS, Dual, Stage, rates, seeded};
use crate::posture::{Kind, Posture};
use crate::statics::{Load, Screw, Statics};
use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3, Vector6};

impl Workspace {
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
        for index in 0..model.terms.len() {
            self.term_entries(model, index, (p, wanted), reading, jacobian);
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
        let mut sensed = self.sensed.map(constant);
        for k in 0..6 {
            sensed[k] = seeded(self.sensed[k], k);
        }
        let wrenches = &self.dual_wrenches;
        let duals = &mut self.dual_deviations;
        let mut posture = Posture::new(&model.setup, reading, wrenches, sensed, duals);
        for term in &model.terms {
            if term.effect.stage() == Stage::Sensor {
                let p: Vec<Dual> = term.of(p).iter().map(|&x| constant(x)).collect();
                term.effect.perturb_dual(&p, &mut posture);
            }
        }
        let touched = posture.touched();
        let mut gain = Matrix6::identity();
        for row in 0..6 {
            if let Some(rates) = rates(&self.dual_deviations[self.slots.sensed + row]) {
                for column in 0..6 {
                    gain[(row, column)] += rates[column];
                }
            }
        }
        self.dual_deviations[touched].fill(constant(0.0));
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
        (p, wanted): (&[f64], &[bool]),
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
            let wrenches = &self.dual_wrenches;
            let sensed = self.sensed.map(constant);
            let all = &mut self.dual_deviations;
            let mut posture = Posture::new(&model.setup, reading, wrenches, sensed, all);
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
            for slot in posture.touched() {
                // clean for the next
                let value = std::mem::replace(&mut self.dual_deviations[slot], constant(0.0));
                if let Some(rates) = rates(&value) {
                    for (direction, &k) in chunk.iter().enumerate() {
                        if rates[direction] != 0.0 {
                            self.entries.push(Entry {
                                slot,
                                parameter: term.first + k,
                                value: rates[direction],
                            });
                        }
                    }
                }
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
            let sensed = Vector6::from_element(constant(0.0));
            let mut posture = Posture::new(setup, reading, wrenches, sensed, &mut deviations);
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
