//! The one integration-test binary: a module a subject.

#![allow(clippy::unwrap_used, missing_docs)]

mod campaign;
mod cli;
mod plant;
mod recording;
mod robot;
