//! Finds MuJoCo's library when it is first needed.

use super::{MujocoError, OpenError, build_library, header_version, open_library};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Loads the library once for the process; later calls repeat the outcome.
pub(super) fn open() -> Result<(), MujocoError> {
    static OUTCOME: OnceLock<Result<(), MujocoError>> = OnceLock::new();
    OUTCOME.get_or_init(search).clone()
}

fn search() -> Result<(), MujocoError> {
    let Some(header) = header_version() else {
        return match open_library("") {
            Err(OpenError::Missing(why)) => Err(MujocoError::Unavailable(why)),
            _ => Err(MujocoError::Unavailable("built without MuJoCo".to_owned())),
        };
    };
    let built = version_text(header);
    let candidates = match std::env::var_os("MUJOCO_DIR").map(PathBuf::from) {
        // Who names a directory means that one: another MuJoCo in its place would be a surprise.
        Some(directory) => in_directory(&directory, &built)?,
        None => [
            build_library(),
            "libmujoco.so".to_owned(),
            format!("libmujoco.so.{built}"),
        ]
        .into_iter()
        .chain(["libmujoco.dylib".to_owned()])
        .filter(|name| !name.is_empty())
        .collect(),
    };
    let mut missing = Vec::new();
    let mut mismatch = None;
    for library in &candidates {
        match open_library(library) {
            Ok(()) => return Ok(()),
            Err(OpenError::Missing(why)) => missing.push(why),
            Err(OpenError::Version(found)) => {
                let found = version_text(found);
                mismatch.get_or_insert(MujocoError::Version {
                    library: library.clone(),
                    found,
                    built: built.clone(),
                });
            }
        }
    }
    Err(mismatch.unwrap_or_else(|| {
        MujocoError::Unavailable(format!(
            "MuJoCo {built} was not found ({}); install it (Debian/Ubuntu: sudo apt-get install \
             libmujoco-dev) or set MUJOCO_DIR to the directory that holds it",
            missing.join("; ")
        ))
    }))
}

fn in_directory(directory: &Path, built: &str) -> Result<Vec<String>, MujocoError> {
    let names = [
        "libmujoco.so".to_owned(),
        format!("libmujoco.so.{built}"),
        "libmujoco.dylib".to_owned(),
    ];
    let found: Vec<String> = [directory.join("lib"), directory.to_path_buf()]
        .iter()
        .flat_map(|place| names.iter().map(|name| place.join(name)))
        .filter(|path| path.is_file())
        // Absolute: a name without a slash would be searched for elsewhere.
        .map(|path| {
            std::path::absolute(&path)
                .unwrap_or(path)
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    if found.is_empty() {
        return Err(MujocoError::Unavailable(format!(
            "MUJOCO_DIR is {}, which holds neither libmujoco.so nor libmujoco.so.{built}, nor does \
             its lib directory",
            directory.display()
        )));
    }
    Ok(found)
}

/// 222 is 2.2.2, 3017000 is 3.17.0.
fn version_text(version: i32) -> String {
    if version < 1000 {
        format!("{}.{}.{}", version / 100, version / 10 % 10, version % 10)
    } else {
        format!(
            "{}.{}.{}",
            version / 1_000_000,
            version / 1000 % 1000,
            version % 1000
        )
    }
}

#[cfg(test)]
mod tests {
    use super::version_text;

    #[test]
    fn versions_read_as_mujoco_writes_them() {
        assert_eq!(version_text(222), "2.2.2");
        assert_eq!(version_text(337), "3.3.7");
        assert_eq!(version_text(3_017_000), "3.17.0");
        assert_eq!(version_text(4_000_000), "4.0.0");
    }
}
