//! Scenarios, sweeps of blind cases, the control loop and the drilling cell: everything around a plant with a truth.

pub mod scenario;
pub mod sweep;

use misfit_arm::{input, robot};
use misfit_campaign::{self as campaign, numbers, setup, space};
use misfit_core::{compensation, diagnosis, effects, fit, map, model, model_file, plan};
use misfit_plant as plant;
