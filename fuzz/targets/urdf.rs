//! A URDF. What is accepted has finite poses at any posture.
#![no_main]

libfuzzer_sys::fuzz_target!(|text: &str| misfit_fuzz::robot("robot.urdf", text));
