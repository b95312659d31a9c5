//! A virtual calibration lab for serial robot arms.
#![doc = ""]

pub mod campaign;
pub mod cli;
pub mod compensation;
pub mod diagnosis;
pub mod dual_quaternion;
pub mod effects;
pub mod export;
pub mod fit;
pub mod formula;
pub mod ladder;
pub mod map;
pub mod model;
pub mod model_file;
pub mod mujoco;
pub mod plan;
pub mod plant;
pub mod plot;
pub mod posture;
pub mod recording;
pub mod report;
pub mod robot;
pub mod scenario;
pub mod setup;
pub mod statics;
pub mod sweep;
