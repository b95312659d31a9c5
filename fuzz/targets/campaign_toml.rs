//! A campaign file beside its robot and its table.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_campaign::Campaign;
use misfit_fuzz::{Folder, SDA5F, refused};
use std::sync::LazyLock;

const TABLE: &str = "target,r1_s_rad,torso_rad,x_m,y_m,z_m\nr1,0.1,0.2,1,2,3\nr2,0.3,0.4,1,2,3\n";
static FOLDER: LazyLock<Folder> = LazyLock::new(|| {
    Folder::with(&[
        ("sda5f.urdf", SDA5F.as_bytes()),
        ("readings.csv", TABLE.as_bytes()),
    ])
});

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.write("campaign.toml", bytes);
    if let Err(error) = Campaign::load(&path) {
        refused(&error);
    }
});
