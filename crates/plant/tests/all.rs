//! The one integration-test binary of this crate: one module per subject.

#![allow(clippy::unwrap_used, clippy::too_many_lines, missing_docs)]

mod plant;
