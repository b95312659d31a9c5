//! Identify robot arms from measurements, and diagnose which physical effect the model lacks.

pub mod compensation;
pub mod diagnosis;
pub mod effects;
pub mod export;
pub mod findings;
pub mod fit;
pub mod ladder;
pub mod map;
pub mod model;
pub mod model_file;
pub mod plan;
pub mod posture;
pub mod statics;

use misfit_arm::{dual_quaternion, formula, input, robot};
use misfit_campaign::{self as campaign, setup, space};
use misfit_truth as plant;
