//! How each reading answers its joints, whitened: what waves and patterns are made of.

use crate::campaign::Reading;
use crate::fit::Fit;
use crate::fit::alike::Alike;
use crate::fit::noise::Whitener;
use crate::model::Rows;
use nalgebra::DMatrix;
use rayon::prelude::*;

/// One reading under unit turns of the observed joints.
pub struct Motion {
    /// Whitened rows by observed joints, the load following, 1/rad.
    pub rates: DMatrix<f64>,
    /// Torque of the load about every joint of the robot, N·m.
    pub torques: Vec<f64>,
}

/// How all readings of a fit answer the robot's joints (12 × joints, m/rad and rad/rad), and the torques of their loads about
/// these, N·m.
pub fn answers(fit: &Fit, readings: &[&Reading]) -> (Vec<Rows>, Vec<Vec<f64>>) {
    let setup = &fit.model.setup;
    let alike = Alike::of(&fit.model, readings);
    let found = alike.map(&fit.model, readings, |workspace, reading| {
        let mut jacobian = Rows::zeros(setup.robot.joints.len());
        workspace.joint_jacobian(&fit.model, &fit.values, reading, &mut jacobian);
        (jacobian, workspace.torques(&fit.model, reading))
    });
    found.into_iter().unzip()
}

/// The same, whitened.
pub fn motions(
    fit: &Fit,
    (jacobians, torques): (Vec<Rows>, Vec<Vec<f64>>),
    whiteners: &[Whitener],
) -> Vec<Motion> {
    let observed = &fit.model.setup.observed;
    let each = jacobians.into_par_iter().zip(torques).zip(whiteners);
    each.map(|((jacobian, torques), whitener)| {
        let mut rates = DMatrix::zeros(whitener.rows, observed.len());
        for (place, &joint) in observed.iter().enumerate() {
            let rate = jacobian.column(joint).into_owned();
            whitener.apply(&rate, &mut |i, value| rates[(i, place)] = value);
        }
        Motion { rates, torques }
    })
    .collect()
}
