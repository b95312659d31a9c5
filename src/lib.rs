//! The command line of `misfit`: a virtual calibration lab for robot arms.
#![doc = ""]

pub mod cli;

use misfit_arm::input;
use misfit_campaign::{self as campaign, bag, recording, setup, space};
use misfit_cell::{scenario, sweep};
use misfit_core::{
    compensation, diagnosis, effects, export, findings, fit, ladder, map, model, model_file, plan,
};
use misfit_report::{self as report, plot};
