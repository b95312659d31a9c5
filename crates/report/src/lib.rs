//! Results for people (terminal) and for programs (JSON).

pub mod compensate;
pub mod control_loop;
pub mod corrections;
pub mod diagnosis;
pub mod drill;
pub mod export;
pub mod findings;
pub mod fit;
pub mod format;
pub mod html;
pub mod import;
pub mod json;
pub mod ladder;
pub mod map;
pub mod paper;
pub mod plan;
pub mod plot;
pub mod recording;
pub mod run;
pub mod sweep;
