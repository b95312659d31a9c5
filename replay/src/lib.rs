//! Recordings of `misfit` in the Rerun viewer. Only this crate speaks to Rerun; it reads recordings and changes nothing.
//!
//! [`Scene`] is what is drawn, in numbers and without Rerun; one module each draws the robots, the readings, the loads, the
//! plots and the charts; `layout` is the blueprint that opens by itself.

mod charts;
mod layout;
mod loads;
mod log;
mod plots;
mod readings;
mod robots;
mod save;
mod scale;
mod scene;
mod words;

pub use save::save;
pub use scene::{Drawn, Scene};

use misfit_campaign::recording::Recording;
use rerun::{RecordingStream, RecordingStreamBuilder, RecordingStreamResult};

/// Name of the application in the viewer: layouts that a user saves belong to it.
pub const APPLICATION: &str = "misfit";

/// What is open at first.
#[derive(Debug, Clone, Default)]
pub struct Opening {
    /// Tab of plots, by the beginning of its name; the first one if there is none of it.
    pub tab: Option<String>,
    /// Timeline; the readings' own, or seconds where a process is recorded.
    pub timeline: Option<String>,
}

/// A stream of this recording, to be given a sink.
pub fn stream(recording: &Recording) -> RecordingStreamBuilder {
    RecordingStreamBuilder::new(APPLICATION)
        .recording_id(recording.campaign.name.as_str())
        .recording_name(recording.campaign.name.as_str())
}

/// Sends everything: robots, readings, plots, texts, and the layout.
///
/// # Errors
/// What Rerun says of data that it cannot take.
pub fn draw(
    stream: &RecordingStream,
    recording: &Recording,
    opening: &Opening,
) -> RecordingStreamResult<()> {
    let scene = Scene::of(recording);
    layout::send(stream, &scene, opening)?;
    words::send(stream, &scene)?;
    robots::send(stream, &scene)?;
    readings::send(stream, &scene)?;
    loads::send(stream, &scene)?;
    scale::send(stream, &scene)?;
    plots::send(stream, &scene)?;
    charts::send(stream, &scene)
}
