//! A scenario beside those of the repository, which it may be like.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_cell::scenario::Scenario;
use misfit_fuzz::{Folder, SDA5F, refused};
use std::sync::LazyLock;

const SIX_AXIS: &[u8] = include_bytes!("../../models/six_axis/six_axis.urdf");
static FOLDER: LazyLock<Folder> = LazyLock::new(|| {
    Folder::with(&[
        ("models/sda5f/sda5f.urdf", SDA5F.as_bytes()),
        ("models/six_axis/six_axis.urdf", SIX_AXIS),
        (
            "scenarios/hidden.toml",
            include_bytes!("../../scenarios/hidden.toml"),
        ),
        (
            "scenarios/hose_model.toml",
            include_bytes!("../../scenarios/hose_model.toml"),
        ),
        (
            "scenarios/rich.toml",
            include_bytes!("../../scenarios/blind/rich.toml"),
        ),
    ])
});

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.write("scenarios/fuzzed.toml", bytes);
    match Scenario::load(&path) {
        Err(error) => refused(&error),
        Ok(scenario) => {
            if let Err(error) = scenario.redrawn(7) {
                refused(&error);
            }
        }
    }
});
