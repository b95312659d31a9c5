//! A recording of ours, with what a fit or a ladder found.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_campaign::recording::read_recording;
use misfit_fuzz::{Folder, refused};
use std::sync::LazyLock;

static FOLDER: LazyLock<Folder> = LazyLock::new(|| Folder::with(&[]));

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.write("fuzzed.mcap", bytes);
    match read_recording(&path) {
        Ok(recording) => assert!(!recording.campaign.readings.is_empty()),
        Err(error) => refused(&error),
    }
});
