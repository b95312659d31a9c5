//! The one integration-test binary: a module a subject.

#![allow(clippy::unwrap_used, missing_docs)]

mod campaign;
mod cli;
mod common;
mod compensation;
mod diagnosis;
mod dual_quaternion;
mod effects;
mod equilibrium;
mod export;
mod expression;
mod fit;
mod form;
mod formula;
mod house;
mod kinematics;
mod plan;
mod plant;
mod recording;
mod robot;
mod sweep;
