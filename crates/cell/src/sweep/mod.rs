//! Blind cases: does the diagnosis find what was hidden?
//!
//! ```text
//! scenario + [blind] ─► case (who is hidden, how large: λ) ─► plant ─► campaign ─► diagnosis ─► row ─► summary
//! ```
//!
//! A case follows from the scenario's seed and its own number alone, so that any part of a sweep can be done
//! anywhere, in any order, on any number of threads. The diagnosis sees the campaign; only the score sees the truth.

pub mod case;
mod hidden;
mod outside;
pub mod score;
mod signal;
mod size;

pub mod store;
pub mod summary;

pub use hidden::CaseError;
