//! Pictures as files.

use crate::campaign::write_atomically;
use crate::plot::{Figure, png, svg};
use anyhow::Context;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The stem with an ending behind it; dots in the stem stay.
pub(super) fn with_ending(stem: &Path, ending: &str) -> PathBuf {
    let mut path = stem.as_os_str().to_owned();
    path.push(ending);
    PathBuf::from(path)
}

/// Writes a figure as `<stem>.svg` and `<stem>.png`.
pub(super) fn write(stem: &Path, figure: &Figure) -> anyhow::Result<()> {
    let files = [
        (with_ending(stem, ".svg"), svg(figure)?.into_bytes()),
        (with_ending(stem, ".png"), png(figure)?),
    ];
    for (path, bytes) in files {
        write_atomically(&path, |file| file.write_all(&bytes))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}
