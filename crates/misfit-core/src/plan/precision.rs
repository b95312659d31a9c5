//! Poses that make parameters precise: D- or A-optimal, and how much more poses would bring.

use super::criterion::{Criterion, Determinant, Variances, covariance};
use super::observability::{Observability, indices};
use super::{Information, PlanError, Task, foreseen, of_readings, postures, stream};
use crate::campaign::Reading;
use crate::fit::LOST;
use crate::fit::noise::{isotropic, whiteners};
use crate::fit::solve::WEAK;
use nalgebra::DMatrix;

/// Random postures at which the accuracy is foretold.
const TESTS: usize = 100;
/// Exchanges start from so many of the best random designs.
const STARTS: usize = 3;
/// Steps of the curve, as shares of the number of poses asked for.
const SHARES: [f64; 5] = [0.25, 0.5, 1.0, 2.0, 4.0];
/// More poses bring nothing once the error of a prediction is within this share above the noise of a reading.
const NOTHING_GAINED: f64 = 0.05;

/// What the poses are chosen for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Aim {
    /// D: the smallest volume of uncertainty.
    D,
    /// A: the smallest mean square error, of predicted positions or of parameters.
    A,
}

/// What a design is worth.
#[derive(Debug, Clone, PartialEq)]
pub struct Figures {
    /// Observability indices.
    pub observability: Observability,
    /// Root mean square position error at random test poses that the parameters' uncertainty makes, m.
    pub accuracy: f64,
    /// Standard deviations of all parameters, SI; none for those that are held or that the readings do not fix.
    pub std: Vec<Option<f64>>,
}

/// One point of the curve of diminishing returns.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Step {
    /// New poses.
    pub poses: usize,
    /// Accuracy of as many chosen poses, m.
    pub accuracy_m: f64,
    /// Accuracy of as many random poses, the median design, m.
    pub random_accuracy_m: f64,
}

/// Poses for precision.
#[derive(Debug, Clone, PartialEq)]
pub struct Precision {
    /// Joint angles of the proposed poses, rad or m.
    pub poses: Vec<Vec<f64>>,
    /// With the proposed poses.
    pub proposed: Figures,
    /// With as many random ones: the median design by the criterion.
    pub random: Figures,
    /// With what is measured already alone, if anything is.
    pub measured: Option<Figures>,
    /// Noise of the position of a single reading, all three axes, m.
    pub noise: f64,
    /// Accuracy by number of poses.
    pub curve: Vec<Step>,
    /// Number of new poses beyond which a prediction is within 5 % of the noise of a reading; none if more poses than
    /// anyone measures would not do.
    pub enough: Option<usize>,
}

/// Chooses the poses of a task that make its model's parameters most precise.
///
/// `interest` are effects whose parameters count, all others free; none for all parameters. [`Aim::A`] without
/// `interest` is the accuracy at test poses, which depends on no choice of units; with it, the sum of variances
/// of those parameters in typical sizes.
///
/// # Errors
/// If there are no postures to choose from, or nothing to be estimated.
pub fn precise(
    task: &Task<'_>,
    aim: Aim,
    interest: &[String],
    mut on_step: impl FnMut(&str),
) -> Result<Precision, PlanError> {
    let free = task.free();
    let ids: Vec<&str> = task.model.parameters().map(|(id, _)| id).collect();
    let of_interest: Vec<usize> = (0..free.len())
        .filter(|&column| interest.is_empty() || interest.iter().any(|id| id == ids[free[column]]))
        .collect();
    for effect in interest {
        if !free.iter().any(|&k| ids[k] == *effect) {
            return Err(PlanError::Nothing {
                effect: effect.clone(),
            });
        }
    }
    if of_interest.is_empty() {
        return Err(PlanError::Nothing {
            effect: "the model".to_owned(),
        });
    }
    on_step("candidates");
    let information = Information::gather(task, task.model, task.values, &free)?;
    let (weight, noise) = test_poses(task, &free)?;
    let criterion = criterion(aim, (!interest.is_empty()).then_some(&of_interest), &weight);
    let plan = Plan {
        task,
        free: &free,
        information: &information,
        weight: &weight,
    };
    on_step("exchanging poses");
    let criterion = criterion.as_ref();
    let designs = |poses: usize| information.random_designs(criterion, poses, task.seed);
    let random = designs(task.poses);
    let taken = information.best(criterion, &random[..STARTS]);
    let reach = noise * ((1.0 + NOTHING_GAINED).powi(2) - 1.0).sqrt();
    let mut step = |count: usize| {
        on_step(&format!("{count} poses"));
        let random = designs(count);
        let chosen = if count == task.poses {
            taken.clone()
        } else {
            information.best(criterion, &random[..1])
        };
        Step {
            poses: count,
            accuracy_m: plan.accuracy(&information.of(&chosen)),
            random_accuracy_m: plan.accuracy(&information.of(&random[random.len() / 2])),
        }
    };
    let counts = steps(task.poses, information.candidates.len());
    let mut curve: Vec<Step> = counts.into_iter().map(&mut step).collect();
    // down to where the poses are too few
    while let Some(first) = curve.first()
        && first.accuracy_m <= reach
        && first.poses > 1
    {
        let fewer = step(first.poses / 2);
        curve.insert(0, fewer);
    }
    let random = &random[random.len() / 2];
    // indices over the directions that both designs fix
    let directions = |design: &[usize]| plan.figures(design, usize::MAX).observability.directions;
    let most = directions(&taken).min(directions(random));
    let before = (!task.measured.is_empty()).then(|| plan.figures(&[], most));
    Ok(Precision {
        poses: taken
            .iter()
            .map(|&k| information.postures[k].clone())
            .collect(),
        proposed: plan.figures(&taken, most),
        random: plan.figures(random, most),
        enough: enough(before.as_ref().map(|b| b.accuracy), &curve, reach),
        measured: before,
        noise,
        curve,
    })
}

/// What is to be small: of the columns of interest, or of all parameters, that have this weight at the test poses.
fn criterion(
    aim: Aim,
    of_interest: Option<&Vec<usize>>,
    weight: &DMatrix<f64>,
) -> Box<dyn Criterion> {
    let count = weight.ncols();
    match (aim, of_interest) {
        (Aim::D, Some(columns)) => Box::new(Determinant::of(columns, count)),
        (Aim::D, None) => Box::new(Determinant::of(&(0..count).collect::<Vec<_>>(), count)),
        (Aim::A, None) => Box::new(Variances {
            weight: weight.clone(),
        }),
        (Aim::A, Some(columns)) => {
            let mut weight = DMatrix::zeros(count, count);
            for &k in columns {
                weight[(k, k)] = 1.0;
            }
            Box::new(Variances { weight })
        }
    }
}

/// What the figures of a design follow from.
struct Plan<'a> {
    task: &'a Task<'a>,
    free: &'a [usize],
    information: &'a Information,
    weight: &'a DMatrix<f64>,
}

impl Plan<'_> {
    /// Root mean square position error at the test poses, m.
    fn accuracy(&self, information: &DMatrix<f64>) -> f64 {
        let variances = Variances {
            weight: self.weight.clone(),
        };
        (-variances.value(information)).max(0.0).sqrt()
    }

    fn figures(&self, taken: &[usize], most: usize) -> Figures {
        let information = self.information.of(taken);
        let (each, measured) = self.information.rows;
        let mut std = vec![None; self.task.values.len()];
        let typical: Vec<f64> = self
            .task
            .model
            .parameters()
            .map(|(_, p)| p.typical)
            .collect();
        if let Some(covariance) = covariance(&information) {
            for (column, &k) in self.free.iter().enumerate() {
                let variance = covariance[(column, column)];
                // the prior's share in what is known of it
                let lost = WEAK * WEAK * variance;
                std[k] = (lost <= LOST).then(|| variance.sqrt() * typical[k]);
            }
        }
        Figures {
            observability: indices(&information, measured + each * taken.len(), most),
            accuracy: self.accuracy(&information),
            std,
        }
    }
}

/// `Σ JᵀJ` of positions at random test poses over their number, m², and the noise of a reading there, m.
fn test_poses(task: &Task<'_>, free: &[usize]) -> Result<(DMatrix<f64>, f64), PlanError> {
    let mut readings: Vec<Reading> = Vec::new();
    for joints in postures(task, TESTS, stream::TESTS)? {
        let mut all = task.protocol.readings(&joints);
        for reading in &mut all {
            reading.orientation = None;
            reading.wrench = None;
        }
        // postures in which the arm collapses are no test
        readings.extend(foreseen(task.model, task.values, all).unwrap_or_default());
    }
    let readings: Vec<&Reading> = readings.iter().collect();
    let count = readings.len().max(1) as f64;
    let metre = isotropic(1.0, 1.0);
    let (weight, _) = of_readings(task.model, task.values, free, &metre, &readings);
    let whiteners = whiteners(task.model, task.values, &readings, &task.noise);
    let variance: f64 = whiteners.iter().map(|w| 3.0 * w.position_variance).sum();
    Ok((weight / count, (variance / count).sqrt()))
}

/// Numbers of poses of the curve, rising: none so large that it leaves nothing to choose.
fn steps(poses: usize, candidates: usize) -> Vec<usize> {
    let mut steps: Vec<usize> = SHARES
        .iter()
        .map(|share| ((share * poses as f64).round() as usize).max(1))
        .filter(|&count| count == poses || 2 * count <= candidates)
        .collect();
    steps.dedup();
    steps
}

/// Number of poses from which on the accuracy is `reach` or better: information grows evenly with poses, so
/// `1/accuracy²` lies on a line between two steps, and goes on along the last one.
fn enough(measured: Option<f64>, curve: &[Step], reach: f64) -> Option<usize> {
    /// Nobody measures more.
    const MOST: f64 = 10_000.0;
    let start = measured.map(|accuracy| (0.0, accuracy));
    let points: Vec<(f64, f64)> = start
        .into_iter()
        .chain(curve.iter().map(|s| (s.poses as f64, s.accuracy_m)))
        .map(|(poses, accuracy)| (poses, accuracy.powi(-2)))
        .collect();
    let wanted = reach.powi(-2);
    let &(first, known) = points.first()?;
    if known >= wanted {
        return Some(first as usize);
    }
    let above = points.iter().position(|&(_, known)| known >= wanted);
    let end = above.unwrap_or(points.len() - 1);
    let (a, b) = (points.get(end.checked_sub(1)?)?, points.get(end)?);
    let count = a.0 + (b.0 - a.0) * (wanted - a.1) / (b.1 - a.1);
    (count.is_finite() && count > 0.0 && count <= MOST).then(|| count.ceil() as usize)
}
