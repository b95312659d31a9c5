//! The one integration-test binary of this crate: one module per subject.

#![allow(clippy::unwrap_used, clippy::too_many_lines, missing_docs)]

#[allow(dead_code)] // each crate uses a part
mod common;
mod dual_quaternion;
mod filter;
mod formula;
mod nist;
mod plan;
