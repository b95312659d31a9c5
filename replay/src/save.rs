//! Writing a file so that a failure leaves the old one whole.

use crate::{Opening, draw, stream};
use anyhow::Context;
use misfit::recording::Recording;
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
    write(path, &bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

fn write(path: &Path, bytes: &[u8]) -> std::io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".misfit-");
    // temporary files are private by default; a result is not: the user's umask decides
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let mut temporary = builder.tempfile_in(folder)?;
    temporary.write_all(bytes)?;
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}
