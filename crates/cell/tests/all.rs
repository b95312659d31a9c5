//! The one integration-test binary of this crate: one module per subject.

#![allow(clippy::unwrap_used, clippy::too_many_lines, missing_docs)]

#[allow(dead_code)] // each crate uses a part
mod common;
mod diagnosis;
mod disturbance;
mod effects;
mod equilibrium;
mod expression;
mod findings;
mod fit;
mod form;
mod kinds;
mod kinematics;
#[path = "../../campaign/tests/measured.rs"]
mod measured;
mod sweep;
