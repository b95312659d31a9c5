//! A DH table. What is accepted has finite poses at any posture.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit::robot::Robot;
use misfit_fuzz::refused;

fuzz_target!(|text: &str| {
    match Robot::parse("robot.toml", text, None) {
        Err(error) => refused(&error),
        Ok(robot) => {
            let poses = robot.body_poses(&vec![0.5; robot.joints.len()]);
            assert!(
                poses
                    .iter()
                    .all(|pose| pose.to_homogeneous().iter().all(|x| x.is_finite()))
            );
        }
    }
});
