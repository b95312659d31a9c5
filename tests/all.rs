//! The one integration-test binary: a module a subject.

#![allow(clippy::unwrap_used, clippy::too_many_lines, missing_docs)]

mod bag;
mod cli;
#[allow(dead_code)] // each crate uses a part
#[path = "../crates/cell/tests/common.rs"]
mod common;
mod compensation;
mod control_loop;
mod docs;
mod drill;
mod export;
mod faults;
mod golden;
mod hostile;
mod house;
mod map;
#[path = "../crates/campaign/tests/measured.rs"]
mod measured;
mod report;
#[allow(dead_code)]
#[path = "../crates/campaign/tests/two_arms.rs"]
mod two_arms;
