//! The command under which a robot, as a model has it, takes its target to a pose: loaded, with all its effects.
//!
//! Newton's method on the error twist `ξ = 2 log(p q*)` of dual quaternions, `p` the pose wanted and `q` the one that the
//! loaded equilibrium reaches (corrected form of Appl. Sci. 2019, 9, 65, eq. 36 to 45: there the error is `p q⁻¹`
//! itself and is added to the input). The Jacobian is that of the joints without the answer of the springs, about a
//! thousandth of it on a stiff arm: each step gains as many digits. Of the commands that reach the pose, where there are
//! more joints than the six it takes, the one nearest to a posture of reference.

use crate::campaign::Reading;
use crate::dual_quaternion::DualQuaternion;
use crate::model::{Model, Prediction, Workspace};
use nalgebra::{DMatrix, DVector, Vector6};

/// Reached when nearer than this, m and rad: a hundredth of a nanometre is nothing to any robot.
const REACHED: f64 = 1e-11;
/// At the pose, steps along motions that do not leave it go on until they are smaller than this, rad (m).
const IDLE: f64 = 1e-6;
/// Counts as reached: rounding may keep a long arm from the last digits, m and rad.
const ARRIVED: f64 = 1e-9;
/// No further than this in a step, rad (m): beyond it the Jacobian is another.
const LONGEST: f64 = 0.3;
const ITERATIONS: usize = 100;
/// Each step gains about so much: the equilibrium after it need not be better, within these bounds, rad (m).
const FINER: f64 = 1e-5;
const COARSE: f64 = 1e-6;
const FINEST: f64 = 1e-15;
/// So many steps without coming nearer end the search.
const PATIENCE: usize = 12;
/// Damping of the least squares, as a share of the Jacobian's size: keeps a singular arm's step a number. More would bias
/// the pose towards the reference: by 1e-9 and a drift of 1 mrad, nanometres.
const DAMPING: f64 = 1e-14;
/// First damping tried where a full step leads away from the pose.
const LEAST_DAMPING: f64 = 1e-8;

/// Where the joints may go.
#[derive(Debug, Clone)]
pub struct Reach {
    /// Joints that may move, indices into the robot's.
    pub moving: Vec<usize>,
    /// By joint of the robot: least and greatest angle, rad (m).
    pub ranges: Vec<(f64, f64)>,
}

/// How the search ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// At the pose.
    Reached,
    /// Not at the pose; these joints stand at a limit.
    AtLimit(Vec<usize>),
    /// Not at the pose, and no limit is in the way: it is too far away, or the arm is singular there.
    OutOfReach,
    /// The arm does not hold its load on the way.
    Collapsed,
    /// At the pose, but in a posture that is not allowed.
    Forbidden,
}

/// A command.
#[derive(Debug, Clone)]
pub struct Found {
    /// By joint of the robot, rad (m).
    pub joints: Vec<f64>,
    /// What is left to the pose: `[v; ω]` at the target's origin, tracker's frame, m and rad.
    pub left: Vector6<f64>,
    /// How the search ended.
    pub end: End,
}

/// The twist that would take a prediction to the pose that a task wants: `[v; ω]` at the target's origin, tracker's
/// frame, m and rad. Without a wanted orientation the target moves without turning.
pub fn error(prediction: &Prediction, task: &Reading) -> Vector6<f64> {
    let Some(wanted) = task.orientation else {
        let v = task.position - prediction.position;
        return Vector6::new(v.x, v.y, v.z, 0.0, 0.0, 0.0);
    };
    let at = DualQuaternion::from_parts(prediction.position, prediction.orientation.into_inner());
    let to = DualQuaternion::from_parts(task.position, wanted.into_inner());
    let twist = (to * at.conjugate()).log();
    let angular = twist.fixed_rows::<3>(3).into_owned();
    let linear = twist.fixed_rows::<3>(0) + angular.cross(&prediction.position);
    Vector6::new(
        linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
    )
}

/// Seeks the command for a task (its wanted pose in `position` and `orientation`, tracker's frame), from `start` and as
/// near to `reference` as can be (by joint of the robot, rad or m).
pub fn solve(
    workspace: &mut Workspace,
    model: &Model,
    p: &[f64],
    task: &Reading,
    (start, reference): (&[f64], &[f64]),
    reach: &Reach,
) -> Found {
    let rows = if task.orientation.is_some() { 6 } else { 3 };
    let clamped = |q: &[f64]| -> Vec<f64> {
        let mut q = q.to_vec();
        for &joint in &reach.moving {
            let (least, most) = reach.ranges[joint];
            q[joint] = q[joint].clamp(least, most);
        }
        q
    };
    let mut reading = task.clone();
    reading.joints = clamped(start);
    let mut best: Option<Found> = None;
    let (mut damping, mut waited, mut moved) = (DAMPING, 0, f64::INFINITY);
    let mut jacobian = DMatrix::zeros(rows, reach.moving.len());
    let (mut near, mut enough) = (false, COARSE);
    for _ in 0..ITERATIONS {
        let prediction = workspace.predict_to(model, p, &reading, near, enough);
        near = prediction.settled;
        let exact = enough <= 0.01 * REACHED;
        let left = match prediction.settled {
            true => error(&prediction, task),
            false => Vector6::repeat(f64::INFINITY),
        };
        let size = left.norm();
        // better than the next step will come
        enough = (size * FINER).clamp(FINEST, COARSE);
        let least = best.as_ref().map_or(f64::INFINITY, |b| b.left.norm());
        if size < least || size <= REACHED {
            waited = if size < 0.9 * least { 0 } else { waited + 1 };
            damping = DAMPING.max(damping * 0.01);
            for (column, &joint) in reach.moving.iter().enumerate() {
                let twist = workspace.joint_twist(model, &reading, joint);
                jacobian.column_mut(column).copy_from(&twist.rows(0, rows));
            }
            best = Some(Found {
                joints: reading.joints.clone(),
                left,
                end: End::OutOfReach,
            });
        } else {
            // no nearer: a shorter step from the best so far
            waited += 1;
            damping = (damping * 100.0).max(LEAST_DAMPING);
        }
        let Some(best) = &best else {
            return Found {
                joints: reading.joints,
                left: Vector6::repeat(f64::NAN),
                end: End::Collapsed,
            };
        };
        if (exact && size <= REACHED && moved <= IDLE) || waited > PATIENCE {
            break;
        }
        let wanted = best.left.rows(0, rows).into_owned();
        let step = step(&jacobian, &wanted, &best.joints, reference, reach, damping);
        moved = step.amax();
        reading.joints.clone_from(&best.joints);
        for (&joint, step) in reach.moving.iter().zip(step.iter()) {
            reading.joints[joint] += step;
        }
        reading.joints = clamped(&reading.joints);
    }
    let Some(mut found) = best else {
        unreachable!("the first prediction is the best so far")
    };
    found.end = if found.left.norm() <= ARRIVED {
        End::Reached
    } else {
        let stuck = |&joint: &usize| {
            let (least, most) = reach.ranges[joint];
            found.joints[joint] <= least || found.joints[joint] >= most
        };
        let stuck: Vec<usize> = reach.moving.iter().copied().filter(stuck).collect();
        if stuck.is_empty() {
            End::OutOfReach
        } else {
            End::AtLimit(stuck)
        }
    };
    found
}

/// The step by moving joint: to the pose, and of all such the one that ends nearest to the reference. Joints that it would
/// carry past a limit stop there, and the others are solved for again.
fn step(
    jacobian: &DMatrix<f64>,
    wanted: &DVector<f64>,
    at: &[f64],
    reference: &[f64],
    reach: &Reach,
    damping: f64,
) -> DVector<f64> {
    let n = reach.moving.len();
    let mut step = DVector::zeros(n);
    let mut free: Vec<usize> = (0..n).collect();
    loop {
        let own = jacobian.select_columns(&free);
        // a damped step goes where the pose is, not where the reference is
        let pull = if damping > DAMPING { 0.0 } else { 1.0 };
        let drift = DVector::from_iterator(
            free.len(),
            free.iter()
                .map(|&k| pull * (reference[reach.moving[k]] - at[reach.moving[k]])),
        );
        let mut rest = wanted - &own * &drift;
        for k in (0..n).filter(|k| !free.contains(k)) {
            rest -= jacobian.column(k) * step[k];
        }
        let mut gram = &own * own.transpose();
        let damping = damping * gram.trace().max(f64::MIN_POSITIVE);
        for k in 0..gram.nrows() {
            gram[(k, k)] += damping;
        }
        let Some(factor) = gram.cholesky() else {
            return DVector::zeros(n);
        };
        let mut moved = drift + own.transpose() * factor.solve(&rest);
        let longest = moved.amax();
        if longest > LONGEST {
            moved *= LONGEST / longest;
        }
        let mut stopped = Vec::new();
        for (&k, &by) in free.iter().zip(moved.iter()) {
            let joint = reach.moving[k];
            let (least, most) = reach.ranges[joint];
            step[k] = (at[joint] + by).clamp(least, most) - at[joint];
            if step[k] != by && (at[joint] + by < least || at[joint] + by > most) {
                stopped.push(k);
            }
        }
        if stopped.is_empty() || free.len() <= stopped.len() {
            return step;
        }
        free.retain(|k| !stopped.contains(k));
    }
}
