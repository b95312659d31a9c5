//! What the targets share: folders in memory, with the files that an input stands beside.

use misfit_arm::robot::Robot;
use std::fs;
use std::path::{Path, PathBuf};

/// The robot of most seeds.
pub const SDA5F: &str = include_str!("../models/sda5f/sda5f.urdf");
/// The three-joint arm of `.ci/bag.py`, whose bags are the seeds of the target `bag`.
pub const THREE: &str = include_str!("../.ci/three.urdf");

/// A folder that is gone with its process; in memory where the system has that.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// A new one with these files.
    pub fn with(files: &[(&str, &[u8])]) -> Self {
        let memory = Path::new("/dev/shm");
        let folder = match memory.is_dir() {
            true => tempfile::tempdir_in(memory),
            false => tempfile::tempdir(),
        };
        let folder = Self(folder.unwrap());
        for (name, bytes) in files {
            folder.write(name, bytes);
        }
        folder
    }

    /// Where a file of it is.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Writes a file, and folders above it that are missing.
    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, bytes).unwrap();
        path
    }
}

/// A robot file, by the ending of its name: refused, or a robot whose poses are numbers.
pub fn robot(file: &str, text: &str) {
    match Robot::parse(file, text, None) {
        Err(error) => refused(&error),
        Ok(robot) => {
            let poses = robot.body_poses(&vec![0.5; robot.joints.len()]);
            let mut numbers = poses.iter().flat_map(|pose| {
                let matrix = pose.to_homogeneous();
                matrix.iter().copied().collect::<Vec<f64>>()
            });
            assert!(numbers.all(f64::is_finite));
        }
    }
}

/// A refusal is one message: not empty, and short enough to be read.
pub fn refused(error: &dyn std::error::Error) {
    let message = error.to_string();
    assert!(!message.trim().is_empty(), "an empty message");
    assert!(
        message.len() < 20_000,
        "a message of {} bytes",
        message.len()
    );
}
