//! The one integration-test binary of this crate: one module per subject.

#![allow(clippy::unwrap_used, missing_docs)]

mod robot;
mod urdf_oracle;
