//! A recording as a file that the viewer opens.

use crate::{Opening, draw, stream};
use anyhow::Context;
use misfit_campaign::recording::Recording;
use misfit_campaign::write_atomically;
use std::io::Write;
use std::path::Path;

/// Writes a recording as an `.rrd` file with its layout in it.
///
/// # Errors
/// What Rerun or the file system says; an old file is then as it was.
pub fn save(recording: &Recording, opening: &Opening, path: &Path) -> anyhow::Result<()> {
    let (stream, storage) = stream(recording).memory()?;
    draw(&stream, recording, opening)?;
    let bytes = storage.drain_as_bytes()?;
    write_atomically(path, |file| file.write_all(&bytes))
        .with_context(|| format!("{}: cannot be written", path.display()))
}
