//! What an effect of the model does to each reading, and as what error that is shown.
//!
//! The pull of an effect is computed by leaving it out of the prediction, all other parameters kept. What the last
//! model leaves, plus that pull, is what the readings show of the effect (a component plus residual plot). Both are
//! shown as an error of the joint that the effect turns, if it does no more than turn one, else along the direction in
//! which it pushes most.

use super::rms;
use misfit_arm::dual_quaternion::rotation_vector;
use misfit_arm::robot::JointKind;
use misfit_campaign::Reading;
use misfit_core::effects::Parameter;
use misfit_core::fit::alike::Alike;
use misfit_core::fit::{Fit, residuals};
use misfit_core::model::{Rows, Term, Workspace, stacked};
use nalgebra::{DMatrix, Matrix3, Vector3, Vector6};

/// An effect turns one joint alone if so much of its pull is a turn of it.
const TURNS: f64 = 0.98;

/// One reading: what is left, and how it answers each observed joint.
pub(super) struct Seen {
    pub left: Vector6<f64>,
    pub rates: DMatrix<f64>,
    pub torques: Vec<f64>,
}

/// Residuals of a fit, and how its readings answer the joints.
pub(super) fn seen(fit: &Fit, readings: &[&Reading]) -> Vec<Seen> {
    let setup = &fit.model.setup;
    let answers =
        Alike::of(&fit.model, readings).map(&fit.model, readings, |workspace, reading| {
            let mut all = Rows::zeros(setup.robot.joints.len());
            workspace.joint_jacobian(&fit.model, &fit.values, reading, &mut all);
            let mut rates = DMatrix::zeros(6, setup.observed.len());
            for (place, &joint) in setup.observed.iter().enumerate() {
                rates.set_column(place, &all.fixed_view::<6, 1>(0, joint));
            }
            let torques = workspace.torques(&fit.model, reading);
            (rates, torques)
        });
    let left = residuals(&fit.model, &fit.values, readings);
    let both = left.iter().zip(answers);
    both.map(|(row, (rates, torques))| Seen {
        left: row.fixed_rows::<6>(0).into_owned(),
        rates,
        torques,
    })
    .collect()
}

/// What an effect does to each reading.
pub(super) struct Pull {
    /// Effect.
    pub id: String,
    /// The joint whose part it is, if the effect has one for each joint, and how many there are.
    pub part: Option<(String, usize)>,
    /// `[m; rad]` by reading, tracker's frame.
    pub moves: Vec<Vector6<f64>>,
    /// Root mean square in noise.
    pub size: f64,
}

/// The pull of an effect; where it acts on several joints, of the joint that matters most.
pub(super) fn pull(fit: &Fit, term: &Term, readings: &[&Reading]) -> Pull {
    let setup = &fit.model.setup;
    let joints: Vec<Option<usize>> = term.parameters.iter().map(Parameter::joint).collect();
    let mut parts: Vec<usize> = Vec::new();
    for &joint in joints.iter().flatten() {
        if !parts.contains(&joint) {
            parts.push(joint);
        }
    }
    let whole = joints.iter().any(Option::is_none);
    let groups: Vec<Option<usize>> = match whole {
        true => vec![None],
        false => parts.into_iter().map(Some).collect(),
    };
    let alike = Alike::of(&fit.model, readings);
    let predict = |p: &[f64]| {
        alike.map(
            &fit.model,
            readings,
            |workspace: &mut Workspace, reading| workspace.predict(&fit.model, p, reading),
        )
    };
    let with = predict(&fit.values);
    let count = groups.len();
    let of_group = |group: Option<usize>| {
        let mut p = fit.values.clone();
        for (offset, joint) in joints.iter().enumerate() {
            if group.is_none() || *joint == group {
                p[term.first + offset] = 0.0;
            }
        }
        let without = predict(&p);
        let pairs = with.iter().zip(&without);
        let moves: Vec<Vector6<f64>> = pairs
            .map(|(with, without)| {
                let turn = with.orientation * without.orientation.inverse();
                let turn = rotation_vector(&turn.into_inner());
                stacked(&(with.position - without.position), &turn)
            })
            .collect();
        let size = rms(moves.iter().map(|row| weighted(fit, row).norm()));
        Pull {
            id: term.effect.id().to_owned(),
            part: group.map(|joint| (setup.robot.joints[joint].name.clone(), count)),
            moves,
            size: if size.is_finite() { size } else { 0.0 },
        }
    };
    let mut best: Option<Pull> = None;
    for group in groups {
        let found = of_group(group);
        if best.as_ref().is_none_or(|best| found.size > best.size) {
            best = Some(found);
        }
    }
    best.unwrap_or_else(|| of_group(None))
}

/// A change of a reading in standard deviations of the noise; orientations only where they are measured.
fn weighted(fit: &Fit, row: &Vector6<f64>) -> Vector6<f64> {
    let position = fit.noise.position_sigma.max(f64::MIN_POSITIVE);
    let mut row = *row;
    for k in 0..3 {
        row[k] /= position;
        row[k + 3] *= fit.noise.orientation_sigma.map_or(0.0, |sigma| 1.0 / sigma);
    }
    row
}

/// The turn of one joint (by place among the observed) that comes nearest to a change of each reading.
fn turns(fit: &Fit, seen: &[Seen], place: usize, rows: &[Vector6<f64>]) -> Vec<f64> {
    let turn = |(seen, row): (&Seen, &Vector6<f64>)| {
        let rate = weighted(fit, &seen.rates.fixed_view::<6, 1>(0, place).into_owned());
        let square = rate.norm_squared();
        match square > 0.0 {
            true => rate.dot(&weighted(fit, row)) / square,
            false => 0.0,
        }
    };
    seen.iter().zip(rows).map(turn).collect()
}

/// The joint that a pull turns, if it does no more than that.
pub(super) fn turned(fit: &Fit, seen: &[Seen], pull: &Pull) -> Option<usize> {
    let all: f64 = pull
        .moves
        .iter()
        .map(|row| weighted(fit, row).norm_squared())
        .sum();
    let share = |place: usize| {
        let angles = turns(fit, seen, place, &pull.moves);
        let explained = angles.iter().zip(seen).map(|(angle, seen)| {
            let rate = seen.rates.fixed_view::<6, 1>(0, place).into_owned();
            angle * angle * weighted(fit, &rate).norm_squared()
        });
        explained.sum::<f64>() / all
    };
    let places = 0..fit.model.setup.observed.len();
    let shares = places.map(|place| (place, share(place)));
    let best = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (best.1 > TURNS).then_some(best.0)
}

/// Unit and scale of errors whose largest is this: of angles, of lengths.
fn unit(largest: f64, turns: bool) -> (&'static str, f64) {
    match (turns, largest < 1e-3) {
        (true, true) => ("µrad", 1e6),
        (true, false) => ("mrad", 1e3),
        (false, true) => ("µm", 1e6),
        (false, false) => ("mm", 1e3),
    }
}

/// Errors as they are shown.
pub(super) struct Shown {
    pub words: String,
    /// Of which quantity.
    pub quantity: String,
    pub unit: &'static str,
    pub scale: f64,
    pub left: Vec<f64>,
    pub pull: Vec<f64>,
}

/// Errors as a turn (or slide) of one joint.
pub(super) fn of_joint(fit: &Fit, seen: &[Seen], place: usize, moves: &[Vector6<f64>]) -> Shown {
    let setup = &fit.model.setup;
    let joint = &setup.robot.joints[setup.observed[place]];
    let left: Vec<Vector6<f64>> = seen.iter().map(|seen| seen.left).collect();
    let left = turns(fit, seen, place, &left);
    let pull = turns(fit, seen, place, moves);
    let largest = left.iter().zip(&pull).map(|(a, b)| (a + b).abs());
    let largest = largest.fold(0.0, f64::max);
    let (unit, scale) = unit(largest, joint.kind != JointKind::Prismatic);
    Shown {
        words: format!("as an error of joint {}", joint.name),
        quantity: format!("error of {}, {unit}", joint.name),
        unit,
        scale,
        left,
        pull,
    }
}

/// Errors along the direction in which a pull pushes most.
pub(super) fn along(seen: &[Seen], moves: &[Vector6<f64>]) -> Shown {
    let at = |row: &Vector6<f64>| Vector3::new(row[0], row[1], row[2]);
    let spread: Matrix3<f64> = moves.iter().map(|row| at(row) * at(row).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    let mut direction = eigen
        .eigenvectors
        .column(eigen.eigenvalues.imax())
        .into_owned();
    // one of two opposite ones, always the same
    if direction[direction.iamax()] < 0.0 {
        direction = -direction;
    }
    let left: Vec<f64> = seen
        .iter()
        .map(|seen| direction.dot(&at(&seen.left)))
        .collect();
    let pull: Vec<f64> = moves.iter().map(|row| direction.dot(&at(row))).collect();
    let largest = left.iter().zip(&pull).map(|(a, b)| (a + b).abs());
    let (unit, scale) = unit(largest.fold(0.0, f64::max), false);
    Shown {
        words: format!(
            "along the direction in which it pushes most, ({:.2}, {:.2}, {:.2}) in the tracker's frame",
            direction.x, direction.y, direction.z
        ),
        quantity: format!("error, {unit}"),
        unit,
        scale,
        left,
        pull,
    }
}
