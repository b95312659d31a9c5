//! Results for people (terminal) and for programs (JSON).

pub mod compensate;
pub mod diagnosis;
pub mod export;
pub mod fit;
pub mod format;
pub mod json;
pub mod ladder;
pub mod paper;
pub mod plan;
pub mod run;
pub mod sweep;
