//! A bag of another program, from its file to a campaign.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_campaign::bag::{self, Spec};
use misfit_campaign::recording::read_bag;
use misfit_fuzz::{Folder, THREE, refused};
use std::sync::LazyLock;

const SPEC: &str = "robot = \"three.urdf\"\n[[target]]\nname = \"ball\"\nlink = \"tip\"\ntracker = \"/tracker/point\"\n";
static CELL: LazyLock<(Folder, Spec)> = LazyLock::new(|| {
    let folder = Folder::with(&[
        ("three.urdf", THREE.as_bytes()),
        ("import.toml", SPEC.as_bytes()),
    ]);
    let spec = Spec::load(&folder.path("import.toml")).unwrap();
    (folder, spec)
});

fuzz_target!(|bytes: &[u8]| {
    let (folder, spec) = &*CELL;
    let path = folder.write("fuzzed.mcap", bytes);
    match read_bag(&path, |_| true) {
        Err(error) => refused(&error),
        Ok(bag) => {
            if let Err(error) = bag::import(&bag, spec) {
                refused(&error);
            }
        }
    }
});
