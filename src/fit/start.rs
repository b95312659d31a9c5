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

/// Poses to start the fit from.
#[derive(Debug, Clone, PartialEq)]
pub struct Start {
    /// Tracker in the base frame.
    pub base_from_tracker: Isometry3<f64>,
    /// Targets in their links.
    pub link_from_target: Vec<Isometry3<f64>>,
}

/// One reading beside the nominal robot.
struct Pair<'a> {
    link: Isometry3<f64>,
    reading: &'a Reading,
}

/// Finds the frames that a campaign marks "estimate" from the readings given; known ones are kept.
pub fn frames(campaign: &Campaign, setup: &Setup, readings: &[&Reading]) -> Start {
    let stride = readings.len().div_ceil(MOST).max(1);
    let pairs: Vec<Pair> = readings
        .iter()
        .step_by(stride)
        .map(|reading| Pair {
            link: nominal_link(setup, reading),
            reading,
        })
        .collect();
    let turn = tracker_rotation(campaign, &pairs);
    let (rotation, places) = match turn {
        Some(rotation) => (rotation, translations(campaign, &pairs, &rotation)),
        None => from_positions(campaign, &pairs),
    };
    let targets = (0..campaign.targets.len())
        .map(|target| match campaign.link_from_target[target] {
            Frame::Known(pose) => pose,
            Frame::Estimate => Isometry3::from_parts(
                Translation3::from(places.targets[target]),
                UnitQuaternion::from_rotation_matrix(&target_rotation(&pairs, &rotation, target)),
            ),
        })
        .collect();
    let base_from_tracker = match campaign.base_from_tracker {
        Frame::Known(pose) => pose,
        Frame::Estimate => Isometry3::from_parts(
            Translation3::from(places.tracker),
            UnitQuaternion::from_rotation_matrix(&rotation),
        ),
    };
    Start {
        base_from_tracker,
        link_from_target: targets,
    }
}

/// base_from_link of the nominal, unloaded robot.
fn nominal_link(setup: &Setup, reading: &Reading) -> Isometry3<f64> {
    let link = &setup.robot.links[setup.targets[reading.target].link];
    setup.robot.body_poses(&reading.joints)[link.body] * link.body_from_link
}

/// The tracker's rotation in the base frame if it is known or the readings hold orientations.
fn tracker_rotation(campaign: &Campaign, pairs: &[Pair]) -> Option<Rotation3<f64>> {
    if let Frame::Known(pose) = campaign.base_from_tracker {
        return Some(pose.rotation.to_rotation_matrix());
    }
    // a target whose own rotation is known says it directly
    let mut sum = Matrix3::zeros();
    for pair in pairs {
        if let (Frame::Known(target), Some(seen)) = (
            campaign.link_from_target[pair.reading.target],
            pair.reading.orientation,
        ) {
            sum += (pair.link.rotation * target.rotation * seen.inverse())
                .to_rotation_matrix()
                .into_inner();
        }
    }
    if sum != Matrix3::zeros() {
        return Some(nearest_rotation(&sum));
    }
    // otherwise the target with most orientations
    let count = |target: usize| {
        let of_target = pairs.iter().filter(|p| p.reading.target == target);
        of_target
            .filter(|p| p.reading.orientation.is_some())
            .count()
    };
    let target = (0..campaign.targets.len())
        .rev()
        .max_by_key(|&t| count(t))?;
    let mut kronecker = SMatrix::<f64, 9, 9>::zeros();
    for pair in pairs.iter().filter(|p| p.reading.target == target) {
        let Some(seen) = pair.reading.orientation else {
            continue;
        };
        let a = pair.link.rotation.to_rotation_matrix().into_inner();
        let b = seen.to_rotation_matrix().into_inner();
        kronecker += b.kronecker(&a);
    }
    if count(target) == 0 {
        return None;
    }
    if count(target) == 1 {
        // one reading cannot tell tracker from target: leave the target unturned
        let pair = pairs
            .iter()
            .find(|p| p.reading.target == target && p.reading.orientation.is_some())?;
        let seen = pair.reading.orientation?;
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
fn target_rotation(pairs: &[Pair], tracker: &Rotation3<f64>, target: usize) -> Rotation3<f64> {
    let mut sum = Matrix3::zeros();
    for pair in pairs.iter().filter(|p| p.reading.target == target) {
        if let Some(seen) = pair.reading.orientation {
            sum += pair
                .link
                .rotation
                .to_rotation_matrix()
                .into_inner()
                .transpose()
                * tracker.matrix()
                * seen.to_rotation_matrix().matrix();
        }
    }
    if sum == Matrix3::zeros() {
        Rotation3::identity()
    } else {
        nearest_rotation(&sum)
    }
}

/// Positions of tracker and targets, and what they leave (m, rms).
struct Places {
    tracker: Vector3<f64>,
    targets: Vec<Vector3<f64>>,
    rms: f64,
}

/// Linear least squares for `A y - t = X p - a`, `y` in the links and `t` in the base.
fn translations(campaign: &Campaign, pairs: &[Pair], tracker: &Rotation3<f64>) -> Places {
    let count = 3 + 3 * campaign.targets.len();
    let mut normal = DMatrix::<f64>::zeros(count, count);
    let mut right = DVector::<f64>::zeros(count);
    let known_tracker = match campaign.base_from_tracker {
        Frame::Known(pose) => Some(pose.translation.vector),
        Frame::Estimate => None,
    };
    let row_of = |pair: &Pair| {
        let turn = pair.link.rotation.to_rotation_matrix().into_inner();
        let mut value = tracker * pair.reading.position - pair.link.translation.vector;
        let mut row = DMatrix::<f64>::zeros(3, count);
        match known_tracker {
            Some(t) => value += t,
            None => row
                .view_mut((0, 0), (3, 3))
                .copy_from(&(-Matrix3::identity())),
        }
        let first = 3 + 3 * pair.reading.target;
        match campaign.link_from_target[pair.reading.target] {
            Frame::Known(pose) => value -= turn * pose.translation.vector,
            Frame::Estimate => row.view_mut((0, first), (3, 3)).copy_from(&turn),
        }
        (row, value)
    };
    for pair in pairs {
        let (row, value) = row_of(pair);
        normal += row.transpose() * &row;
        right += row.transpose() * value;
    }
    let solution = least_norm(normal, &right);
    let squares: f64 = pairs
        .iter()
        .map(|pair| {
            let (row, value) = row_of(pair);
            (row * &solution - value).norm_squared()
        })
        .sum();
    let part =
        |first: usize| Vector3::new(solution[first], solution[first + 1], solution[first + 2]);
    Places {
        tracker: known_tracker.unwrap_or(part(0)),
        targets: (0..campaign.targets.len())
            .map(|t| match campaign.link_from_target[t] {
                Frame::Known(pose) => pose.translation.vector,
                Frame::Estimate => part(3 + 3 * t),
            })
            .collect(),
        rms: (squares / pairs.len().max(1) as f64).sqrt(),
    }
}

/// Positions alone: rotation and translations in turns, from many starts.
fn from_positions(campaign: &Campaign, pairs: &[Pair]) -> (Rotation3<f64>, Places) {
    let mut starts: Vec<Rotation3<f64>> = linear_rotation(campaign, pairs).into_iter().collect();
    starts.extend(cube_rotations());
    let mut best: Option<(Rotation3<f64>, Places)> = None;
    for start in starts {
        let mut rotation = start;
        let mut places = translations(campaign, pairs, &rotation);
        for _ in 0..40 {
            let mut sum = Matrix3::zeros();
            for pair in pairs {
                let at = pair.link * nalgebra::Point3::from(places.targets[pair.reading.target]);
                sum += (at.coords - places.tracker) * pair.reading.position.transpose();
            }
            rotation = nearest_rotation(&sum);
            let next = translations(campaign, pairs, &rotation);
            let done = places.rms - next.rms < 1e-6 * places.rms;
            places = next;
            if done {
                break;
            }
        }
        if best.as_ref().is_none_or(|(_, kept)| places.rms < kept.rms) {
            best = Some((rotation, places));
        }
    }
    best.unwrap_or_else(|| {
        let rotation = Rotation3::identity();
        (rotation, translations(campaign, pairs, &rotation))
    })
}

/// Solves `A y - P vec(X) - t = -a` with the rotation's nine numbers free, then takes the nearest rotation.
fn linear_rotation(campaign: &Campaign, pairs: &[Pair]) -> Option<Rotation3<f64>> {
    let count = 12 + 3 * campaign.targets.len();
    let mut normal = DMatrix::<f64>::zeros(count, count);
    let mut right = DVector::<f64>::zeros(count);
    for pair in pairs {
        let mut row = DMatrix::<f64>::zeros(3, count);
        for k in 0..3 {
            for axis in 0..3 {
                row[(axis, 3 * k + axis)] = -pair.reading.position[k];
            }
            row[(k, 9 + k)] = -1.0;
        }
        let turn = pair.link.rotation.to_rotation_matrix().into_inner();
        let mut value = -pair.link.translation.vector;
        match campaign.link_from_target[pair.reading.target] {
            Frame::Known(pose) => value -= turn * pose.translation.vector,
            Frame::Estimate => row
                .view_mut((0, 12 + 3 * pair.reading.target), (3, 3))
                .copy_from(&turn),
        }
        normal += row.transpose() * &row;
        right += row.transpose() * value;
    }
    let solution = least_norm(normal, &right);
    let matrix = Matrix3::from_iterator(solution.iter().take(9).copied());
    (matrix.norm() > 1e-9).then(|| nearest_rotation(&matrix))
}

/// Least-norm solution of a positive semidefinite system.
fn least_norm(normal: DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    // the decomposition of what is no number does not end
    if normal.iter().any(|x| !x.is_finite()) {
        return DVector::zeros(right.len());
    }
    let eigen = normal.symmetric_eigen();
    let largest = eigen.eigenvalues.iter().fold(0.0f64, |a, &b| a.max(b));
    let mut solution = DVector::zeros(right.len());
    for (value, vector) in eigen
        .eigenvalues
        .iter()
        .zip(eigen.eigenvectors.column_iter())
    {
        if *value > 1e-12 * largest {
            solution += vector * (vector.dot(right) / value);
        }
    }
    solution
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
