//! The page that a command writes: where it may go, and how.

use crate::campaign::{Campaign, write_atomically};
use crate::report::html::{Origin, Results, page};
use anyhow::Context;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A path that a browser opens, and that nothing is read from.
pub(super) fn html_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension() {
        Some(ending) if ending == "html" => Ok(path),
        _ => Err("accepted: a path ending in .html".to_owned()),
    }
}

/// Writes the page; an old file stays whole if it cannot be.
pub(super) fn write(
    path: &Path,
    campaign: &Campaign,
    results: &Results<'_>,
    origin: &Origin,
) -> anyhow::Result<()> {
    let text = page(campaign, results, origin)?;
    write_atomically(path, |file| file.write_all(text.as_bytes()))
        .with_context(|| format!("{}: cannot be written", path.display()))
}

/// Says where it is.
pub(super) fn line(path: &Path) -> String {
    format!("report   {}", path.display())
}
