//! Reading with a limit, and writing so that a failure leaves the old file whole.

use std::fs::File;
use std::io::{self, BufWriter, Read, Write};
use std::path::Path;

/// Reads a whole file of at most `limit` bytes; `None` if there is more.
///
/// The limit is kept while reading, so a pipe or a growing file cannot exceed it.
pub(crate) fn read_at_most(path: &Path, limit: u64) -> io::Result<Option<Vec<u8>>> {
    let file = File::open(path)?;
    // A file that says it is too long need not be read first.
    if file.metadata()?.len() > limit {
        return Ok(None);
    }
    let mut bytes = Vec::new();
    file.take(limit + 1).read_to_end(&mut bytes)?;
    Ok((bytes.len() as u64 <= limit).then_some(bytes))
}

/// Fills a temporary file in the same folder, then renames it to `path`.
///
/// # Errors
///
/// Whatever `fill` or the file system says; `path` is then as it was before.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    let mut builder = tempfile::Builder::new();
    builder.prefix(".misfit-");
    // Temporary files are private by default; a result is not: the user's umask decides.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    let temporary = builder.tempfile_in(folder)?;
    let mut writer = BufWriter::new(temporary.as_file());
    fill(&mut writer)?;
    writer.flush()?;
    drop(writer);
    temporary.persist(path).map_err(|error| error.error)?;
    Ok(())
}
