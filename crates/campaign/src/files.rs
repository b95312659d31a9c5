//! Writing so that a failure leaves the old file whole.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// The folder that a file is to be written to.
///
/// # Errors
/// If the path names no file.
pub fn folder_of(path: &Path) -> io::Result<&Path> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    match folder.is_dir() {
        true => Ok(folder),
        false => Err(io::Error::new(
            io::ErrorKind::NotFound,
            format!("{} is no folder", folder.display()),
        )),
    }
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
    let folder = folder_of(path)?;
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
