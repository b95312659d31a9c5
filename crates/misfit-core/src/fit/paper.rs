//! The paper's own estimator, to compare with: joint compliance from loaded minus unloaded poses by
//! unweighted linear least squares on the 8 rows of the dual quaternion.
//!
//! For a pose `y = q_loaded - q_unloaded = A c`, `A = G [J_1 τ_1 … J_n τ_n]`, `τ = Jᵀ w` of the load alone
//! at the nominal posture; all poses stacked, `c = (AᵀA)⁻¹ Aᵀ y`.
//!
//! Source: Appl. Sci. 2019, 9, 65, eq. 30 to 35, 46 and 47, with its virtual work (eq. 13 to 18) corrected:
//! the 8-row Jacobian is `G J`, the torque `Jᵀ w`. The paper's assumptions are kept: the load is the only
//! cause, and every row counts alike, metres/2 beside radians/2. What it needs and takes as known, the frames,
//! comes from a weighted fit of frames and geometry to the unloaded readings.

use super::{Fit, FitError, Options};
use crate::campaign::{Campaign, Payload, Reading, Split, conditions};
use crate::dual_quaternion::{DualQuaternion, Vector8};
use crate::effects::{EffectList, Role};
use crate::model::Model;
use crate::model_file::ModelError;
use crate::posture::{Kind, Slots};
use crate::setup::Setup;
use crate::statics::{Load, Statics};
use nalgebra::{DMatrix, DVector, Isometry3, Vector6};
use std::collections::BTreeMap;

/// The paper's estimate.
#[derive(Debug, Clone)]
pub struct PaperFit {
    /// Compliances.
    pub joints: Vec<PaperJoint>,
    /// Loaded poses compared with their unloaded counterparts.
    pub pairs: usize,
    /// Root mean square of the deflection that it leaves, m.
    pub position_rms: f64,
    /// The deflection itself, root mean square, m.
    pub deflection_rms: f64,
    /// The fit of the frames to the unloaded readings.
    pub frames: Fit,
}

/// One joint's estimate.
#[derive(Debug, Clone, PartialEq)]
pub struct PaperJoint {
    /// Index of the joint.
    pub joint: usize,
    /// Name of it.
    pub name: String,
    /// Compliance, rad/(N·m) (m/N); none where no load turns the joint.
    pub compliance: Option<f64>,
    /// Its standard deviation if all rows had the same, independent noise (they do not).
    pub std: Option<f64>,
}

/// Why the paper's estimator has nothing to go on.
#[derive(Debug, thiserror::Error)]
pub enum PaperError {
    /// No pair of a loaded and an unloaded reading.
    #[error(
        "{campaign}: --method paper compares loaded with unloaded readings of the same pose, target and \
         direction, with orientation; found no such pair. Accepted: a column pose, and payload_kg both 0 and \
         above 0 (or wrench columns)"
    )]
    NoPairs {
        /// Campaign file.
        campaign: String,
    },
    /// The fit of the frames.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The model of the frames.
    #[error(transparent)]
    Model(#[from] ModelError),
}

/// Torques below this are rounding, N·m.
const NO_TORQUE: f64 = 1e-9;

/// Runs the paper's estimator.
///
/// # Errors
/// Without loaded and unloaded readings of the same poses.
pub fn fit(campaign: &Campaign) -> Result<PaperFit, PaperError> {
    let is_loaded = |reading: &Reading| match (reading.payload, reading.wrench) {
        (Some(payload), _) => payload.mass > 0.0,
        (None, Some(wrench)) => wrench.force.norm() > 0.1,
        (None, None) => false,
    };
    let mut unloaded = campaign.clone();
    unloaded
        .readings
        .retain(|reading| !is_loaded(reading) && reading.split == Split::Fit);
    let no_pairs = || PaperError::NoPairs {
        campaign: campaign.name.clone(),
    };
    if unloaded.readings.is_empty() {
        return Err(no_pairs());
    }
    let model = crate::model_file::model(&unloaded, &EffectList::only(Role::Geometry), None)?;
    let options = Options {
        cross_validate: false,
    };
    let frames = super::fit(&unloaded, &model, &options, |_| {})?;
    let pairs = pairs(campaign, is_loaded);
    if pairs.is_empty() {
        return Err(no_pairs());
    }
    let setup = Setup::of(campaign);
    let joints = setup.observed.clone();
    let mut a = DMatrix::zeros(8 * pairs.len(), joints.len());
    let mut y = DVector::zeros(8 * pairs.len());
    let mut twists = Vec::with_capacity(pairs.len());
    for (index, pair) in pairs.iter().enumerate() {
        let (tracker, target) = frame_poses(&frames, &model, pair.reading.target);
        let base = |seen: &Isometry3<f64>| DualQuaternion::<f64>::from_isometry(&(tracker * seen));
        let (before, after) = (base(&pair.unloaded), base(&pair.loaded));
        let sign = after.real.dot(&before.real).signum();
        let difference = after.to_vector() * sign - before.to_vector();
        let rate = before.rate_from_twist();
        let columns = columns(&setup, pair.reading, &target);
        for (column, &joint) in joints.iter().enumerate() {
            let eight: Vector8<f64> = rate * columns[joint];
            a.view_mut((8 * index, column), (8, 1)).copy_from(&eight);
        }
        y.rows_mut(8 * index, 8).copy_from(&difference);
        twists.push((before.twist_from_rate(&difference), columns));
    }
    let (compliance, variance) = unweighted(&a, &y);
    let rms = |left: bool| {
        let squares = twists.iter().map(|(seen, columns)| {
            let mut twist: Vector6<f64> = *seen;
            if left {
                for (c, &joint) in compliance.iter().zip(&joints) {
                    twist -= columns[joint] * c.unwrap_or(0.0);
                }
            }
            twist.fixed_rows::<3>(0).norm_squared()
        });
        (squares.sum::<f64>() / twists.len() as f64).sqrt()
    };
    Ok(PaperFit {
        pairs: pairs.len(),
        position_rms: rms(true),
        deflection_rms: rms(false),
        joints: joints
            .iter()
            .zip(compliance.iter().zip(&variance))
            .map(|(&joint, (&compliance, &variance))| PaperJoint {
                joint,
                name: setup.robot.joints[joint].name.clone(),
                compliance,
                std: variance.map(f64::sqrt),
            })
            .collect(),
        frames,
    })
}

/// Mean poses of one posture, unloaded and under one load, as the tracker sees them.
struct Pair<'a> {
    reading: &'a Reading,
    unloaded: Isometry3<f64>,
    loaded: Isometry3<f64>,
}

fn pairs(campaign: &Campaign, is_loaded: impl Fn(&Reading) -> bool) -> Vec<Pair<'_>> {
    let readings: Vec<&Reading> = campaign
        .readings
        .iter()
        .filter(|reading| reading.split == Split::Fit && reading.orientation.is_some())
        .collect();
    let conditions = conditions(&readings, campaign.noise.as_ref());
    let mut groups: BTreeMap<_, Vec<&Reading>> = BTreeMap::new();
    for (reading, condition) in readings.into_iter().zip(conditions) {
        let key = (condition.pose, condition.direction);
        groups.entry(key).or_default().push(reading);
    }
    let load_key = |payload: Option<Payload>| {
        payload.map(|p| [p.mass, p.com.x, p.com.y, p.com.z].map(f64::to_bits))
    };
    let mut pairs = Vec::new();
    for group in groups.into_values() {
        let (loaded, bare): (Vec<&Reading>, Vec<&Reading>) =
            group.into_iter().partition(|reading| is_loaded(reading));
        let Some(unloaded) = mean_pose(&bare) else {
            continue;
        };
        let mut by_load: BTreeMap<_, Vec<&Reading>> = BTreeMap::new();
        for reading in loaded {
            by_load
                .entry(load_key(reading.payload))
                .or_default()
                .push(reading);
        }
        for readings in by_load.into_values() {
            if let Some(loaded) = mean_pose(&readings) {
                pairs.push(Pair {
                    reading: readings[0],
                    unloaded,
                    loaded,
                });
            }
        }
    }
    pairs
}

fn mean_pose(readings: &[&Reading]) -> Option<Isometry3<f64>> {
    let first = readings.first()?.orientation?;
    let n = readings.len() as f64;
    let position = readings
        .iter()
        .map(|r| r.position)
        .sum::<nalgebra::Vector3<f64>>()
        / n;
    let turns: nalgebra::Vector3<f64> = readings
        .iter()
        .filter_map(|r| Some((r.orientation? * first.inverse()).scaled_axis()))
        .sum();
    let orientation = nalgebra::UnitQuaternion::from_scaled_axis(turns / n) * first;
    Some(Isometry3::from_parts(position.into(), orientation))
}

/// base_from_tracker and link_from_target as fitted.
fn frame_poses(frames: &Fit, model: &Model, target: usize) -> (Isometry3<f64>, Isometry3<f64>) {
    let pose = |role: Role, first: usize| {
        let numbers = model
            .term_of(role)
            .map(|term| &term.of(&frames.values)[first..first + 6]);
        numbers.map_or_else(Isometry3::identity, |p| {
            Isometry3::new(
                nalgebra::Vector3::new(p[0], p[1], p[2]),
                nalgebra::Vector3::new(p[3], p[4], p[5]),
            )
        })
    };
    (
        pose(Role::TrackerFrame, 0),
        pose(Role::TargetFrame, 6 * target),
    )
}

/// By joint: `J_j τ_j` at the target, base frame, for the load alone on the nominal arm; metres and radians
/// per unit of compliance.
fn columns(setup: &Setup, reading: &Reading, target: &Isometry3<f64>) -> Vec<Vector6<f64>> {
    let mut statics = Statics::new(setup);
    let still = vec![0.0; Slots::of(setup).count];
    statics.place(setup, &reading.joints, &still);
    let torques = |statics: &mut Statics, load: &Load| -> Vec<f64> {
        statics.load(setup, load, &still);
        let joints = setup.robot.joints.iter().enumerate();
        joints
            .map(|(j, joint)| {
                let wrench = &statics.local_wrench[j + 1];
                wrench.fixed_rows::<3>(joint.load_row()).dot(&joint.axis)
            })
            .collect()
    };
    let load = Load::of(setup, reading);
    let with = torques(&mut statics, &load);
    let without = torques(
        &mut statics,
        &Load {
            payload: None,
            follower: None,
            ..load
        },
    );
    let link = &setup.robot.links[setup.targets[reading.target].link];
    let body = statics.body[link.body].to_isometry();
    let point = (body * link.body_from_link * target).translation.vector;
    (0..setup.robot.joints.len())
        .map(|joint| {
            if !statics.carries(joint + 1, link.body) {
                return Vector6::zeros();
            }
            let Some(screw) = statics.screw(setup, Kind::Joint(joint), &still) else {
                return Vector6::zeros();
            };
            let torque = with[joint] - without[joint];
            let torque = if torque.abs() < NO_TORQUE {
                0.0
            } else {
                torque
            };
            let v = screw.at(&point) * torque;
            let w = screw.angular * torque;
            Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
        })
        .collect()
}

/// `(AᵀA)⁻¹ Aᵀ y` over the columns that are not zero, with variances from the residual.
fn unweighted(a: &DMatrix<f64>, y: &DVector<f64>) -> (Vec<Option<f64>>, Vec<Option<f64>>) {
    let used: Vec<usize> = (0..a.ncols())
        .filter(|&k| a.column(k).norm() > 0.0)
        .collect();
    let mut values = vec![None; a.ncols()];
    let mut variances = vec![None; a.ncols()];
    let part = a.select_columns(&used);
    let normal = part.transpose() * &part;
    if let Some(factor) = normal.cholesky() {
        let c = factor.solve(&(part.transpose() * y));
        let left = y - &part * &c;
        // six of a pose's eight rows are independent
        let dof = (a.nrows() * 6 / 8).saturating_sub(used.len()).max(1);
        let s2 = left.norm_squared() / dof as f64;
        let inverse = factor.inverse();
        for (i, &k) in used.iter().enumerate() {
            values[k] = Some(c[i]);
            variances[k] = Some(s2 * inverse[(i, i)]);
        }
    }
    (values, variances)
}
