//! A sweep on disk: parts of a few cases each, whole or not there, and the table that they make.
//!
//! A part's name and content depend on its cases alone: an interrupted sweep goes on where it stopped, and the parts
//! of shards done elsewhere are put together by copying them into one folder.

use super::hidden::CaseError;
use super::score::{Row, score};
use crate::campaign::write_atomically;
use crate::scenario::Scenario;
use rayon::prelude::*;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Cases a part.
const PART: usize = 4;

/// Why a sweep cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A case.
    #[error(transparent)]
    Case(#[from] CaseError),
    /// A file.
    #[error("{file}: {source}")]
    File {
        /// Its path.
        file: String,
        /// Reason.
        source: std::io::Error,
    },
    /// The folder of another sweep.
    #[error(
        "{file}: belongs to another sweep than {scenario}: its scenario differs. Accepted: an empty folder, or that \
         of the same scenario"
    )]
    Other {
        /// The file that tells.
        file: String,
        /// Scenario file.
        scenario: String,
    },
    /// A part that is none.
    #[error("{file}: {message}; delete it, and the sweep makes it anew")]
    Part {
        /// Its path.
        file: String,
        /// What is wrong.
        message: String,
    },
}

/// One share of a sweep: the `index`-th of `count`, from 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 0.
    pub index: usize,
    /// How many there are.
    pub count: usize,
}

/// Does the cases of a shard that the folder does not hold yet; all rows that it holds then, in order.
///
/// # Errors
/// If a case cannot be drawn, or the folder not be used.
pub fn sweep(
    scenario: &Scenario,
    cases: usize,
    shard: Shard,
    folder: Option<&Path>,
    on_cases: impl Fn(usize) + Sync,
) -> Result<Vec<Row>, StoreError> {
    if let Some(folder) = folder {
        claim(scenario, folder)?;
    }
    let parts: Vec<usize> = (0..cases.div_ceil(PART)).collect();
    let rows: Vec<Vec<Row>> = parts
        .into_par_iter()
        .with_max_len(1)
        .map(|part| {
            let path = folder.map(|folder| folder.join(format!("part-{part:06}.csv")));
            let numbers = part * PART..((part + 1) * PART).min(cases);
            let count = numbers.len();
            let kept = match &path {
                Some(path) if path.exists() => Some(read(path, numbers.clone())?),
                _ => None,
            };
            let rows = match kept {
                Some(rows) => rows,
                None if part % shard.count != shard.index => Vec::new(),
                None => {
                    let rows: Vec<Row> = numbers
                        .map(|number| score(scenario, number))
                        .collect::<Result<_, _>>()?;
                    if let Some(path) = &path {
                        write(path, &rows)?;
                    }
                    rows
                }
            };
            on_cases(count);
            Ok(rows)
        })
        .collect::<Result<_, StoreError>>()?;
    let rows: Vec<Row> = rows.into_iter().flatten().collect();
    if let (Some(folder), true) = (folder, rows.len() == cases) {
        write(&folder.join("cases.csv"), &rows)?;
    }
    Ok(rows)
}

/// Makes the folder, and sees that it holds this sweep or none.
fn claim(scenario: &Scenario, folder: &Path) -> Result<(), StoreError> {
    let at = |path: &Path, source| StoreError::File {
        file: path.display().to_string(),
        source,
    };
    std::fs::create_dir_all(folder).map_err(|source| at(folder, source))?;
    let path = folder.join("sweep.toml");
    let mut text = format!("# seed {}\n", scenario.seed);
    text += &scenario.text;
    match std::fs::read_to_string(&path) {
        Ok(found) if found == text => Ok(()),
        Ok(_) => Err(StoreError::Other {
            file: path.display().to_string(),
            scenario: scenario.file.clone(),
        }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            write_atomically(&path, |out| out.write_all(text.as_bytes()))
                .map_err(|source| at(&path, source))
        }
        Err(source) => Err(at(&path, source)),
    }
}

/// Reads a part; its cases must be these.
fn read(path: &PathBuf, numbers: std::ops::Range<usize>) -> Result<Vec<Row>, StoreError> {
    let part = |message: String| StoreError::Part {
        file: path.display().to_string(),
        message,
    };
    let mut reader = csv::Reader::from_path(path).map_err(|error| part(error.to_string()))?;
    let rows: Vec<Row> = reader
        .deserialize()
        .collect::<Result<_, _>>()
        .map_err(|error| part(error.to_string()))?;
    if rows.iter().map(|row| row.case).eq(numbers.clone()) {
        Ok(rows)
    } else {
        Err(part(format!(
            "holds other cases than {} to {}",
            numbers.start,
            numbers.end.saturating_sub(1)
        )))
    }
}

/// Writes rows as CSV.
fn write(path: &Path, rows: &[Row]) -> Result<(), StoreError> {
    let written = write_atomically(path, |out| {
        let mut writer = csv::Writer::from_writer(out);
        for row in rows {
            writer.serialize(row).map_err(std::io::Error::other)?;
        }
        writer.flush()
    });
    written.map_err(|source| StoreError::File {
        file: path.display().to_string(),
        source,
    })
}
