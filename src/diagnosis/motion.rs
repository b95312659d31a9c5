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

/// All readings of a fit, in their order.
pub fn motions(fit: &Fit, readings: &[&Reading], whiteners: &[Whitener]) -> Vec<Motion> {
    let setup = &fit.model.setup;
    let alike = Alike::of(&fit.model, readings);
    let found = alike.map(&fit.model, readings, |workspace, reading| {
        let mut jacobian = Rows::zeros(setup.robot.joints.len());
        workspace.joint_jacobian(&fit.model, &fit.values, reading, &mut jacobian);
        let torques = workspace.torques(&fit.model, reading);
        (jacobian, torques)
    });
    let each = found.into_par_iter().zip(whiteners);
    each.map(|((jacobian, torques), whitener)| {
        let mut rates = DMatrix::zeros(whitener.rows, setup.observed.len());
        for (place, &joint) in setup.observed.iter().enumerate() {
            let rate = jacobian.column(joint).into_owned();
            whitener.apply(&rate, &mut |i, value| rates[(i, place)] = value);
        }
        Motion { rates, torques }
    })
    .collect()
}
