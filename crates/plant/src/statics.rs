//! Static equilibrium: Newton on the sprung joints, from where the springs are at rest.
//!
//! The residual is MuJoCo's; the tangent stiffness is its difference quotient, kept as long as the steps
//! shrink tenfold. For the stiff joints of a robot that is one tangent and two or three steps. It also
//! tells stable equilibrium from a balancing act.

use super::PlantError;
use crate::mujoco::{Data, MujocoError};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// A sprung coordinate.
pub(super) struct Spring {
    /// For messages.
    pub(super) name: String,
    /// N·m/rad or N/m.
    pub(super) stiffness: f64,
    /// Whether its unit is m.
    pub(super) slides: bool,
    /// Index in qpos.
    pub(super) qpos: usize,
    /// Index in torques.
    pub(super) dof: usize,
}

impl Spring {
    /// Beyond this a joint no longer holds its load: rad or m.
    fn limit(&self) -> f64 {
        if self.slides { 0.1 } else { 1.0 }
    }
}

/// Steps this small end the search, rad or m.
const SETTLED: f64 = 1e-13;
/// Steps below this that shrink no more are rounding, rad or m.
const ROUNDING: f64 = 1e-9;
/// A step is at most this share of a joint's limit.
const LONGEST_STEP: f64 = 0.2;
/// Width of the difference quotients, rad or m: their error, 1e-6 of the stiffness that gravity adds, only
/// slows the last step.
const DIFFERENCE: f64 = 1e-6;
/// Equilibrium this far from where the tangent was taken gets a new one to judge its stability, rad or m.
const NEARBY: f64 = 1e-2;
const ITERATIONS: usize = 100;

/// Brings the sprung coordinates of `data` from where they are, which must be at rest, to equilibrium.
/// `load` sets `qfrc_applied` for the poses that `data` has when it is called.
pub(super) fn solve(
    data: &mut Data,
    springs: &[Spring],
    load: impl FnMut(&mut Data) -> Result<(), MujocoError>,
) -> Result<(), PlantError> {
    let mut torques = Torques {
        all: vec![0.0; data.model().dofs()],
        data,
        springs,
        load,
    };
    let rest = torques.position();
    let mut q = rest.clone();
    let mut residual = torques.at(&q)?;
    if springs.is_empty() {
        return Ok(());
    }
    let mut tangent: Option<Tangent> = None;
    let mut last = f64::INFINITY;
    for _ in 0..ITERATIONS {
        let fresh = tangent.is_none();
        let used = match tangent.take() {
            Some(kept) => kept,
            None => Tangent::new(&mut torques, &q, &residual)?,
        };
        let mut step = used.cholesky.solve(&residual);
        let reach = |step: &DVector<f64>| {
            springs
                .iter()
                .zip(step.iter())
                .map(|(s, x)| x.abs() / s.limit())
                .fold(0.0, f64::max)
        };
        let length = reach(&step);
        if !length.is_finite() {
            return Err(stuck(springs, &residual, ITERATIONS));
        }
        if length > LONGEST_STEP {
            step *= LONGEST_STEP / length;
        }
        // Halved as long as it overshoots: the torques at its end push back as hard as they pushed on.
        let pushed = residual.dot(&step);
        loop {
            let next = &q + &step;
            residual = torques.at(&next)?;
            if step.amax() < ROUNDING || residual.dot(&step) >= -0.9 * pushed {
                q = next;
                break;
            }
            step *= 0.5;
        }
        for (i, spring) in springs.iter().enumerate() {
            let deflection = q[i] - rest[i];
            if deflection.abs() > spring.limit() {
                return Err(PlantError::GivesWay {
                    joint: spring.name.clone(),
                    deflection,
                });
            }
        }
        let size = step.amax();
        if size <= SETTLED || (fresh && size < ROUNDING && size > 0.1 * last) {
            return judge(&mut torques, &q, &residual, used);
        }
        if size <= 0.1 * last && !used.shifted {
            tangent = Some(used);
        }
        last = size;
    }
    Err(stuck(springs, &residual, ITERATIONS))
}

/// Equilibrium counts if the arm returns to it.
fn judge<L>(
    torques: &mut Torques<'_, L>,
    q: &DVector<f64>,
    residual: &DVector<f64>,
    last: Tangent,
) -> Result<(), PlantError>
where
    L: FnMut(&mut Data) -> Result<(), MujocoError>,
{
    if !last.shifted && (q - &last.at).amax() <= NEARBY {
        return Ok(());
    }
    let here = Tangent::new(torques, q, residual)?;
    if here.shifted {
        let joint = torques.springs[here.softest].name.clone();
        return Err(PlantError::Unstable { joint });
    }
    // Back from the last difference to the solution.
    torques.at(q)?;
    Ok(())
}

fn stuck(springs: &[Spring], residual: &DVector<f64>, iterations: usize) -> PlantError {
    let worst = residual.iamax();
    PlantError::NoEquilibrium {
        joint: springs[worst].name.clone(),
        residual: residual[worst],
        iterations,
    }
}

/// Torques on the sprung coordinates, as a function of these alone.
struct Torques<'a, L> {
    data: &'a mut Data,
    springs: &'a [Spring],
    load: L,
    all: Vec<f64>,
}

impl<L: FnMut(&mut Data) -> Result<(), MujocoError>> Torques<'_, L> {
    fn position(&self) -> DVector<f64> {
        DVector::from_iterator(
            self.springs.len(),
            self.springs.iter().map(|s| self.data.qpos()[s.qpos]),
        )
    }

    fn at(&mut self, q: &DVector<f64>) -> Result<DVector<f64>, MujocoError> {
        let qpos = self.data.qpos_mut();
        for (spring, x) in self.springs.iter().zip(q.iter()) {
            qpos[spring.qpos] = *x;
        }
        self.data.update_position()?;
        (self.load)(self.data)?;
        self.data.static_residual(&mut self.all)?;
        Ok(DVector::from_iterator(
            self.springs.len(),
            self.springs.iter().map(|s| self.all[s.dof]),
        ))
    }
}

/// Tangent stiffness: how the residual falls with the coordinates.
struct Tangent {
    cholesky: Cholesky<f64, Dyn>,
    at: DVector<f64>,
    /// Whether the arm is unstable here, and stiffness was added to find a way down.
    shifted: bool,
    /// The coordinate whose stiffness is the least part of its spring's.
    softest: usize,
}

impl Tangent {
    fn new<L>(
        torques: &mut Torques<'_, L>,
        q: &DVector<f64>,
        residual: &DVector<f64>,
    ) -> Result<Tangent, PlantError>
    where
        L: FnMut(&mut Data) -> Result<(), MujocoError>,
    {
        let n = q.len();
        let mut stiffness = DMatrix::zeros(n, n);
        for i in 0..n {
            let mut aside = q.clone();
            aside[i] += DIFFERENCE;
            let width = aside[i] - q[i];
            let moved = torques.at(&aside)?;
            stiffness.set_column(i, &((residual - moved) / width));
        }
        let stiffness = (&stiffness + stiffness.transpose()) * 0.5;
        let springs = torques.springs;
        let part = |i: usize| stiffness[(i, i)] / springs[i].stiffness;
        let softest = (0..n)
            .min_by(|&a, &b| part(a).total_cmp(&part(b)))
            .unwrap_or(0);
        // Springs twice, four times, … as stiff as they are make any arm stable in the end.
        for shift in std::iter::once(0.0).chain((-1..40).map(|power| 2f64.powi(power))) {
            let mut tried = stiffness.clone();
            for (i, spring) in springs.iter().enumerate() {
                tried[(i, i)] += shift * spring.stiffness;
            }
            if let Some(cholesky) = tried.cholesky() {
                return Ok(Tangent {
                    cholesky,
                    at: q.clone(),
                    shifted: shift > 0.0,
                    softest,
                });
            }
        }
        Err(stuck(springs, residual, 0))
    }
}
