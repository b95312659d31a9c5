//! The one integration-test binary: a module a subject.

#![allow(clippy::unwrap_used, missing_docs)]

mod bag;
mod campaign;
mod cli;
mod common;
mod compensation;
mod control_loop;
mod diagnosis;
mod docs;
mod drill;
mod dual_quaternion;
mod effects;
mod equilibrium;
mod export;
mod expression;
mod faults;
mod filter;
mod fit;
mod form;
mod formula;
mod golden;
mod hostile;
mod house;
mod kinematics;
mod map;
mod nist;
mod plan;
mod plant;
mod plot;
mod recording;
mod report;
mod robot;
mod sweep;
