//! Compiles the C shim that speaks to MuJoCo, against the headers of `MUJOCO_DIR` or of the system.
//!
//! Without headers the shim is compiled to a stub that explains itself, so that everything but the
//! simulated robot still builds and runs. The library itself is loaded at run time.

use std::env;
use std::path::{Path, PathBuf};

fn main() {
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=csrc");
    println!("cargo:rerun-if-env-changed=MUJOCO_DIR");

    let mut shim = cc::Build::new();
    shim.file("csrc/mujoco_shim.c")
        .std("c11")
        .define("_DEFAULT_SOURCE", None)
        .warnings(true)
        .extra_warnings(true);

    let directory = env::var_os("MUJOCO_DIR").map(PathBuf::from);
    match include_directory(directory.as_deref()) {
        Ok(include) => {
            println!(
                "cargo:rerun-if-changed={}",
                include.join("mujoco/mujoco.h").display()
            );
            shim.include(include);
            if let Some(library) = directory.as_deref().and_then(library) {
                let quoted = library
                    .to_string_lossy()
                    .replace('\\', "\\\\")
                    .replace('"', "\\\"");
                shim.define("MISFIT_MUJOCO_LIBRARY", format!("\"{quoted}\"").as_str());
            }
        }
        Err(why) => {
            println!("cargo:warning=built without MuJoCo, simulation will not work: {why}");
            shim.define("MISFIT_NO_MUJOCO", None);
        }
    }
    shim.compile("misfit_mujoco_shim");
}

/// The directory that holds `mujoco/mujoco.h`.
fn include_directory(mujoco_dir: Option<&Path>) -> Result<PathBuf, String> {
    if env::var("CARGO_CFG_TARGET_FAMILY").as_deref() != Ok("unix") {
        return Err("the shim loads MuJoCo with dlopen, which this system lacks".into());
    }
    // A MUJOCO_DIR that holds no MuJoCo is a mistake to be told of, not to be papered over with
    // whatever version the system has.
    let candidates = match mujoco_dir {
        Some(directory) => vec![directory.join("include")],
        None => [
            "/usr/include",
            "/usr/local/include",
            "/opt/homebrew/include",
        ]
        .map(PathBuf::from)
        .to_vec(),
    };
    candidates.iter().find(|path| path.join("mujoco/mujoco.h").is_file()).cloned().ok_or_else(|| {
        let places: Vec<_> = candidates.iter().map(|path| path.display().to_string()).collect();
        format!(
            "no mujoco/mujoco.h in {}; install libmujoco-dev (Debian/Ubuntu: sudo apt-get install \
             libmujoco-dev) or set MUJOCO_DIR to a directory with include/ and lib/",
            places.join(", ")
        )
    })
}

/// The library under `MUJOCO_DIR`, by its plain name or with a version behind it (as Python's wheels
/// have it).
fn library(mujoco_dir: &Path) -> Option<PathBuf> {
    let mut found: Vec<PathBuf> = [mujoco_dir.join("lib"), mujoco_dir.to_path_buf()]
        .iter()
        .filter_map(|directory| directory.read_dir().ok())
        .flatten()
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            name == "libmujoco.dylib" || name.starts_with("libmujoco.so")
        })
        .collect();
    found.sort();
    found.into_iter().next()
}
