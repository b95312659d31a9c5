//! A start for unknown frames from any initial guess: in closed form, from the nominal robot alone.
//!
//! With orientations it is the robot-world / hand-eye problem `A_i Y = X B_i`, solved by the Kronecker
//! product (Shah 2013, *Solving the robot-world/hand-eye calibration problem using the Kronecker product*,
//! J. Mechanisms Robotics 5). Without, rotation and translations are found in turns (Kabsch 1976) from the
//! linear solution and from the 24 rotations of a cube, and the best is kept.

use crate::campaign::{Campaign, Frame, Reading};
use crate::setup::Setup;
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix3, Rotation3, SMatrix, Translation3, UnitQuaternion, Vector3,
};

/// Readings used at most: enough for a start.
const MOST: usize = 400;
/// Rounds of rotation and places in turns from one start at most; each is a few products of small matrices.
const ROUNDS: usize = 40;

/// A start that leaves more than this share of the spread of the positions is none.
const GROSS: f64 = 0.05;

/// Poses to start the fit from.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Tracker in the base frame.
    pub base_from_tracker: Isometry3<f64>,
    /// Targets in their links.
    pub link_from_target: Vec<Isometry3<f64>>,
}

/// One reading beside the nominal robot, as plain numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// base_from_link of the nominal, unloaded robot, m.
    pub link: Isometry3<f64>,
    /// Index of the target.
    pub target: usize,
    /// Of the target in the tracker's frame, m.
    pub position: Vector3<f64>,
    /// tracker_from_target.
    pub orientation: Option<UnitQuaternion<f64>>,
    /// How much it counts, 0 and more.
    pub weight: f64,
}

/// Which frames are known: the tracker's, and those of the targets.
#[derive(Debug, Clone, Copy)]
pub struct Known<'a> {
    /// Tracker in the base frame.
    pub tracker: &'a Frame,
    /// Targets in their links.
    pub targets: &'a [Frame],
}

/// What the tracker's rotation is taken from where both could say it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// Orientations, where there are any.
    Orientations,
    /// Positions alone, looked for from this many rounds of each of 25 rotations on.
    Positions(usize),
}

/// Finds the frames that a campaign marks "estimate" from the readings given; known ones are kept.
pub fn frames(campaign: &Campaign, setup: &Setup, readings: &[&Reading]) -> Start {
    let stride = readings.len().div_ceil(MOST).max(1);
    let sightings: Vec<Sighting> = readings
        .iter()
        .step_by(stride)
        .map(|reading| Sighting {
            link: nominal_link(setup, reading),
            target: reading.target,
            position: reading.position,
            orientation: reading.orientation,
            weight: 1.0,
        })
        .collect();
    let known = Known {
        tracker: &campaign.base_from_tracker,
        targets: &campaign.link_from_target,
    };
    frames_of(known, &sightings, By::Orientations)
}

/// The same from plain numbers.
pub fn frames_of(known: Known<'_>, sightings: &[Sighting], by: By) -> Start {
    let sums = Sums::new(known, sightings);
    let turn = match (known.tracker, by) {
        (Frame::Known(pose), _) => Some(pose.rotation.to_rotation_matrix()),
        (_, By::Orientations) => tracker_rotation(known.targets, sightings),
        (_, By::Positions(_)) => None,
    };
    let rounds = match by {
        By::Orientations => ROUNDS,
        By::Positions(rounds) => rounds,
    };
    let is_known = matches!(known.tracker, Frame::Known(_));
    let rotation = match turn {
        Some(turn) if is_known || sums.rms(&sums.places(&turn)) <= GROSS * spread(sightings) => {
            turn
        }
        // orientations about one axis alone, as a SCARA's, leave the turn about it open
        Some(turn) => sums.better(turn, from_positions(&sums, rounds)),
        None => from_positions(&sums, rounds),
    };
    let places = sums.places(&rotation);
    let place = |first: usize| Translation3::from(places.fixed_rows::<3>(first).into_owned());
    let targets = (0..known.targets.len())
        .map(|target| match known.targets[target] {
            Frame::Known(pose) => pose,
            Frame::Estimate => Isometry3::from_parts(
                place(TARGETS + 3 * target),
                UnitQuaternion::from_rotation_matrix(&target_rotation(
                    sightings, &rotation, target,
                )),
            ),
        })
        .collect();
    let base_from_tracker = match *known.tracker {
        Frame::Known(pose) => pose,
        Frame::Estimate => Isometry3::from_parts(
            place(TRACKER),
            UnitQuaternion::from_rotation_matrix(&rotation),
        ),
    };
    Start {
        base_from_tracker,
        link_from_target: targets,
    }
}

/// Root mean square of the positions about their mean, m.
fn spread(sightings: &[Sighting]) -> f64 {
    let count = sightings.len().max(1) as f64;
    let mean = sightings
        .iter()
        .map(|sighting| sighting.position)
        .sum::<Vector3<f64>>()
        / count;
    let squares = sightings
        .iter()
        .map(|sighting| (sighting.position - mean).norm_squared());
    (squares.sum::<f64>() / count).sqrt()
}

/// base_from_link of the nominal, unloaded robot.
pub fn nominal_link(setup: &Setup, reading: &Reading) -> Isometry3<f64> {
    let link = &setup.robot.links[setup.targets[reading.target].link];
    setup.robot.body_poses(&reading.joints)[link.body] * link.body_from_link
}

/// The tracker's rotation in the base frame as the orientations say it, if there are any.
fn tracker_rotation(targets: &[Frame], pairs: &[Sighting]) -> Option<Rotation3<f64>> {
    // a target whose own rotation is known says it directly
    let mut sum = Matrix3::zeros();
    for pair in pairs {
        if let (Frame::Known(target), Some(seen)) = (targets[pair.target], pair.orientation) {
            sum += (pair.link.rotation * target.rotation * seen.inverse())
                .to_rotation_matrix()
                .into_inner()
                * pair.weight;
        }
    }
    if sum != Matrix3::zeros() {
        return Some(nearest_rotation(&sum));
    }
    // otherwise the target with most orientations
    let count = |target: usize| {
        let of_target = pairs.iter().filter(|p| p.target == target);
        of_target.filter(|p| p.orientation.is_some()).count()
    };
    let target = (0..targets.len()).rev().max_by_key(|&t| count(t))?;
    let mut kronecker = SMatrix::<f64, 9, 9>::zeros();
    for pair in pairs.iter().filter(|p| p.target == target) {
        let Some(seen) = pair.orientation else {
            continue;
        };
        let a = pair.link.rotation.to_rotation_matrix().into_inner();
        let b = seen.to_rotation_matrix().into_inner();
        kronecker += b.kronecker(&a) * pair.weight;
    }
    if count(target) == 0 {
        return None;
    }
    if count(target) == 1 {
        // one reading cannot tell tracker from target: leave the target unturned
        let pair = pairs
            .iter()
            .find(|p| p.target == target && p.orientation.is_some())?;
        let seen = pair.orientation?;
        return Some((pair.link.rotation * seen.inverse()).to_rotation_matrix());
    }
    if kronecker.iter().any(|x| !x.is_finite()) {
        return None;
    }
    let svd = kronecker.svd(true, false);
    let left = svd.u?;
    let matrix = Matrix3::from_iterator(left.column(svd.singular_values.imax()).iter().copied());
    // singular vectors have a free sign; a rotation has determinant +1
    let matrix = if matrix.determinant() < 0.0 {
        -matrix
    } else {
        matrix
    };
    Some(nearest_rotation(&matrix))
}

/// Mean of `Aᵀ X B` over a target's readings; no turn where none has an orientation.
fn target_rotation(pairs: &[Sighting], tracker: &Rotation3<f64>, target: usize) -> Rotation3<f64> {
    let mut sum = Matrix3::zeros();
    for pair in pairs.iter().filter(|p| p.target == target) {
        if let Some(seen) = pair.orientation {
            sum += pair
                .link
                .rotation
                .to_rotation_matrix()
                .into_inner()
                .transpose()
                * tracker.matrix()
                * seen.to_rotation_matrix().matrix()
                * pair.weight;
        }
    }
    if sum == Matrix3::zeros() {
        Rotation3::identity()
    } else {
        nearest_rotation(&sum)
    }
}

/// Where the tracker's place, the first target's and the one stand among the numbers of [`Sums`].
const TRACKER: usize = 9;
const TARGETS: usize = 12;

/// Sums over the readings of the squares of `A y + a − t − X p`: a form in the nine numbers of the tracker's rotation `X`
/// (by columns), its place `t`, the places `y` of the targets in their links, and 1. What is known of `t` and `y` stands in
/// `known`. However often the turns below go round, readings are looked at once.
struct Sums {
    form: DMatrix<f64>,
    /// The numbers of the form; zero where they are not known.
    known: DVector<f64>,
    /// Which of `t` and `y` are not.
    unknown: Vec<usize>,
    /// Pseudo-inverse of their part of the form.
    inverse: DMatrix<f64>,
    readings: usize,
}

impl Sums {
    fn new(known_frames: Known<'_>, pairs: &[Sighting]) -> Self {
        let count = TARGETS + 3 * known_frames.targets.len() + 1;
        let mut form = DMatrix::<f64>::zeros(count, count);
        for pair in pairs {
            let mut rows = DMatrix::<f64>::zeros(3, count);
            for axis in 0..3 {
                for k in 0..3 {
                    rows[(axis, 3 * k + axis)] = -pair.position[k];
                }
                rows[(axis, TRACKER + axis)] = -1.0;
                rows[(axis, count - 1)] = pair.link.translation.vector[axis];
            }
            let turn = pair.link.rotation.to_rotation_matrix();
            rows.fixed_view_mut::<3, 3>(0, TARGETS + 3 * pair.target)
                .copy_from(turn.matrix());
            form.gemm_tr(pair.weight, &rows, &rows, 1.0);
        }
        let mut known = DVector::zeros(count);
        known[count - 1] = 1.0;
        let mut unknown = Vec::new();
        let frames = std::iter::once((TRACKER, known_frames.tracker));
        let targets = (TARGETS..).step_by(3).zip(known_frames.targets);
        for (first, frame) in frames.chain(targets) {
            match frame {
                Frame::Known(pose) => known
                    .fixed_rows_mut::<3>(first)
                    .copy_from(&pose.translation.vector),
                Frame::Estimate => unknown.extend(first..first + 3),
            }
        }
        let inverse = pseudo_inverse(form.select_rows(&unknown).select_columns(&unknown));
        Self {
            form,
            known,
            unknown,
            inverse,
            readings: pairs.len(),
        }
    }

    /// The places that leave least with the tracker turned so.
    fn places(&self, rotation: &Rotation3<f64>) -> DVector<f64> {
        let mut all = self.known.clone();
        all.rows_mut(0, 9)
            .copy_from_slice(rotation.matrix().as_slice());
        let slope = (&self.form * &all).select_rows(&self.unknown);
        for (k, place) in self.unknown.iter().zip((&self.inverse * slope).iter()) {
            all[*k] = -place;
        }
        all
    }

    /// What they leave, m rms.
    fn rms(&self, all: &DVector<f64>) -> f64 {
        // of exact readings rounding leaves less than nothing
        let squares = all.dot(&(&self.form * all)).max(0.0);
        (squares / self.readings.max(1) as f64).sqrt()
    }

    /// Of two rotations of the tracker the one that leaves less.
    fn better(&self, one: Rotation3<f64>, other: Rotation3<f64>) -> Rotation3<f64> {
        let left = |rotation: &Rotation3<f64>| self.rms(&self.places(rotation));
        if left(&one) <= left(&other) {
            one
        } else {
            other
        }
    }

    /// The rotation that leaves least with tracker and targets there (Kabsch 1976).
    fn rotation(&self, all: &DVector<f64>) -> Rotation3<f64> {
        let rest = all.rows_range(TRACKER..);
        let product = self.form.view((0, TRACKER), (9, rest.len())) * rest;
        nearest_rotation(&Matrix3::from_iterator(product.iter().map(|x| -x)))
    }

    /// The rotation nearest to the nine numbers that leave least where all are free.
    fn linear_rotation(&self) -> Option<Rotation3<f64>> {
        let free: Vec<usize> = (0..9).chain(self.unknown.iter().copied()).collect();
        let inverse = pseudo_inverse(self.form.select_rows(&free).select_columns(&free));
        let solution = -inverse * (&self.form * &self.known).select_rows(&free);
        let matrix = Matrix3::from_iterator(solution.iter().take(9).copied());
        (matrix.norm() > 1e-9).then(|| nearest_rotation(&matrix))
    }
}

/// Positions alone: rotation and places in turns, from many starts.
fn from_positions(sums: &Sums, rounds: usize) -> Rotation3<f64> {
    let reach = |start: Rotation3<f64>, rounds: usize| {
        let mut rotation = start;
        let mut places = sums.places(&rotation);
        let mut rms = sums.rms(&places);
        for _ in 0..rounds {
            rotation = sums.rotation(&places);
            places = sums.places(&rotation);
            let next = sums.rms(&places);
            let done = rms - next < 1e-6 * rms;
            rms = next;
            if done {
                break;
            }
        }
        (rms, rotation)
    };
    let starts = sums.linear_rotation().into_iter().chain(cube_rotations());
    let reached = starts.map(|start| reach(start, rounds));
    let best = reached.min_by(|a, b| a.0.total_cmp(&b.0));
    match best {
        Some((_, rotation)) if rounds < ROUNDS => reach(rotation, ROUNDS).1,
        Some((_, rotation)) => rotation,
        None => Rotation3::identity(),
    }
}

/// Pseudo-inverse of a positive semidefinite matrix.
fn pseudo_inverse(matrix: DMatrix<f64>) -> DMatrix<f64> {
    // nothing to decompose, or what is no number, of which the decomposition does not end
    if matrix.is_empty() || matrix.iter().any(|x| !x.is_finite()) {
        return DMatrix::zeros(matrix.nrows(), matrix.ncols());
    }
    let eigen = matrix.symmetric_eigen();
    let largest = eigen.eigenvalues.max();
    let mut vectors = eigen.eigenvectors.clone();
    for (value, mut vector) in eigen.eigenvalues.iter().zip(vectors.column_iter_mut()) {
        vector *= match *value > 1e-12 * largest {
            true => value.recip(),
            false => 0.0,
        };
    }
    vectors * eigen.eigenvectors.transpose()
}

/// The rotation closest to a matrix (Kabsch 1976).
fn nearest_rotation(matrix: &Matrix3<f64>) -> Rotation3<f64> {
    if matrix.iter().any(|x| !x.is_finite()) {
        return Rotation3::identity();
    }
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Rotation3::identity();
    };
    let mut sign = Matrix3::identity();
    sign[(2, 2)] = (u * v_t).determinant().signum();
    // the sign belongs to the smallest singular value, which nalgebra sorts last
    Rotation3::from_matrix_unchecked(u * sign * v_t)
}

/// The 24 rotations of a cube.
fn cube_rotations() -> Vec<Rotation3<f64>> {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let signed: Vec<Vector3<f64>> = axes.iter().flat_map(|a| [*a, -*a]).collect();
    let mut all = Vec::new();
    for x in &signed {
        for y in signed.iter().filter(|y| y.dot(x) == 0.0) {
            all.push(Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[
                *x,
                *y,
                x.cross(y),
            ])));
        }
    }
    all
}
