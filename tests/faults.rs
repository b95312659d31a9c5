//! What the machine does to a run: killed, no space, no physics.

use crate::cli::misfit;
use rand::RngExt;
use rand::SeedableRng;
use rand_pcg::Pcg64;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const SIX_AXIS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/six_axis/six_axis.urdf");

/// A folder with a scenario of the six-axis arm.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    let scenario = format!(
        "robot = {SIX_AXIS:?}\nseed = 3\n[[target]]\nname = \"flange\"\nlink = \"flange\"\n\
         [noise]\nposition_m = 1e-5\norientation_rad = 8.7e-5\n\
         [design]\nposes = 40\nloads = [{{ mass_kg = 0.0 }}, {{ mass_kg = 40.0, com_m = [0.1, 0.0, 0.1] }}]\n"
    );
    fs::write(folder.path().join("cell.toml"), scenario).unwrap();
    folder
}

/// `misfit simulate` of it with a seed.
fn simulate(folder: &Path, seed: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    command
        .current_dir(folder)
        .env_remove("RUST_BACKTRACE")
        .args(["simulate", "cell.toml", "-o", "x.mcap", "--seed", seed]);
    command
}

/// One line on stderr that holds these words, and exit code 1.
#[track_caller]
fn refused(output: &Output, words: &[&str]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    for word in words {
        assert!(said.contains(word), "{word:?} is not in: {said}");
    }
}

#[test]
#[cfg(unix)]
fn a_run_killed_at_any_moment_leaves_the_old_file_or_the_whole_new_one() {
    const RUNS: usize = 500;
    let folder = folder();
    let path = folder.path().join("x.mcap");
    let whole = |seed: &str| {
        assert!(
            simulate(folder.path(), seed)
                .output()
                .unwrap()
                .status
                .success()
        );
        fs::read(&path).unwrap()
    };
    let old = whole("1");
    let began = Instant::now();
    let new = whole("2");
    let takes = began.elapsed();
    assert!(old != new);
    let mut random = Pcg64::seed_from_u64(5);
    let (mut kept, mut written) = (0, 0);
    for run in 0..RUNS {
        fs::write(&path, &old).unwrap();
        let mut child = simulate(folder.path(), "2")
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // most of them near the end, where the file is written
        let share = 1.2 * random.random_range(0.0..1.0f64).sqrt();
        std::thread::sleep(Duration::from_secs_f64(takes.as_secs_f64() * share));
        child.kill().unwrap();
        child.wait().unwrap();
        let found = fs::read(&path).unwrap();
        if found == old {
            kept += 1;
        } else {
            assert!(
                found == new,
                "run {run}: {} bytes, neither old nor new",
                found.len()
            );
            written += 1;
        }
        // what a killed run leaves behind is named so that nobody takes it for a result
        for entry in fs::read_dir(folder.path()).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            if name.starts_with(".misfit-") {
                fs::remove_file(folder.path().join(name)).unwrap();
            } else {
                assert!(
                    ["cell.toml", "x.mcap", "x.truth.toml"].contains(&&*name),
                    "{name}"
                );
            }
        }
    }
    // both happened, so moments before and after the file was replaced were met
    assert!(kept > 0 && written > 0, "{kept} kept, {written} written");
}

#[test]
#[cfg(unix)]
fn no_space_for_the_output_is_said_and_the_old_file_stays() {
    let folder = folder();
    assert!(
        simulate(folder.path(), "1")
            .output()
            .unwrap()
            .status
            .success()
    );
    let old = fs::read(folder.path().join("x.mcap")).unwrap();
    let campaign = fs::read_to_string(folder.path().join("cell.toml")).unwrap();
    assert!(old.len() > 16 * 512 && campaign.len() < 512);
    // a file of more than 16 blocks of 512 bytes cannot be written, as on a full disk
    let script = "trap '' XFSZ; ulimit -f 16; exec \"$0\" \"$@\"";
    let output = Command::new("sh")
        .current_dir(folder.path())
        .args(["-c", script, env!("CARGO_BIN_EXE_misfit")])
        .args([
            "fit",
            "x.mcap",
            "--no-cross-validation",
            "--record",
            "x2.mcap",
        ])
        .output()
        .unwrap();
    refused(&output, &["x2.mcap", "File too large"]);
    assert!(!folder.path().join("x2.mcap").exists());
    assert_eq!(fs::read(folder.path().join("x.mcap")).unwrap(), old);
    let left = fs::read_dir(folder.path()).unwrap();
    let left = left.filter(|e| {
        let name = e.as_ref().unwrap().file_name();
        name.to_string_lossy().starts_with(".misfit-")
    });
    assert_eq!(left.count(), 0, "a temporary file was left behind");
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_standard_output_is_an_error() {
    let full = fs::OpenOptions::new()
        .write(true)
        .open("/dev/full")
        .unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_misfit"))
        .arg("effects")
        .stdout(full)
        .output()
        .unwrap();
    refused(&output, &["No space left on device"]);
}

#[test]
#[cfg(unix)]
fn a_missing_or_wrong_mujoco_is_said_with_the_remedy() {
    let folder = folder();
    let empty = folder.path().join("empty");
    fs::create_dir(&empty).unwrap();
    let missing = simulate(folder.path(), "1")
        .env("MUJOCO_DIR", &empty)
        .output()
        .unwrap();
    refused(
        &missing,
        &[
            "cell.toml",
            "MuJoCo cannot be used",
            "MUJOCO_DIR",
            "libmujoco.so",
        ],
    );
    fs::write(empty.join("libmujoco.so"), "no library").unwrap();
    let wrong = simulate(folder.path(), "1")
        .env("MUJOCO_DIR", &empty)
        .output()
        .unwrap();
    refused(
        &wrong,
        &[
            "cell.toml",
            "MuJoCo cannot be used",
            "libmujoco.so",
            "MUJOCO_DIR",
        ],
    );
    assert!(!folder.path().join("x.mcap").exists());
    // what needs no physics works without it
    misfit(folder.path())
        .env("MUJOCO_DIR", &empty)
        .arg("effects")
        .assert()
        .success();
}
