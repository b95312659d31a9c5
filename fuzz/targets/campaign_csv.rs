//! The table of a campaign; as tasks first, which need less of it.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_campaign::{Campaign, read_tasks};
use misfit_fuzz::{Folder, SDA5F, refused};
use std::sync::LazyLock;

const CAMPAIGN: &str = "robot = \"sda5f.urdf\"\ntable = \"readings.csv\"\n[[target]]\nname = \"r1\"\nlink = \"r1_flange\"\n\
    [[target]]\nname = \"r2\"\nlink = \"r2_flange\"\n[split]\nfraction = 0.3\nseed = 1\n";
const TABLE: &str = "target,r1_s_rad,x_m,y_m,z_m\nr1,0.1,1,2,3\n";
static CELL: LazyLock<(Folder, Campaign)> = LazyLock::new(|| {
    let folder = Folder::with(&[
        ("sda5f.urdf", SDA5F.as_bytes()),
        ("campaign.toml", CAMPAIGN.as_bytes()),
        ("readings.csv", TABLE.as_bytes()),
    ]);
    let campaign = Campaign::load(&folder.path("campaign.toml")).unwrap();
    (folder, campaign)
});

fuzz_target!(|bytes: &[u8]| {
    let (folder, campaign) = &*CELL;
    let table = folder.write("readings.csv", bytes);
    if let Err(error) = read_tasks(&table, campaign) {
        return refused(&error);
    }
    match Campaign::load(&folder.path("campaign.toml")) {
        Ok(campaign) => assert!(!campaign.readings.is_empty()),
        Err(error) => refused(&error),
    }
});
