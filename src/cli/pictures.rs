//! Pictures as files.

use crate::campaign::write_atomically;
use crate::plot::{Figure, png, svg};
use anyhow::Context;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a figure as `<stem>.svg` and `<stem>.png`.
pub(super) fn write(stem: &Path, figure: &Figure) -> anyhow::Result<()> {
    let path = |ending: &str| {
        let mut path = stem.as_os_str().to_owned();
        path.push(ending);
        PathBuf::from(path)
    };
    let files = [
        (path(".svg"), svg(figure)?.into_bytes()),
        (path(".png"), png(figure)?),
    ];
    for (path, bytes) in files {
        write_atomically(&path, |file| file.write_all(&bytes))
            .with_context(|| format!("{}: cannot be written", path.display()))?;
    }
    Ok(())
}
