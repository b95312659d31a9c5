//! A model file, for a robot of fifteen joints. What is accepted is written as a file that is accepted.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_campaign::Campaign;
use misfit_core::effects::EffectList;
use misfit_core::model_file;
use misfit_fuzz::{Folder, refused};
use std::sync::LazyLock;

static CELL: LazyLock<(Folder, Campaign)> = LazyLock::new(|| {
    let folder = Folder::with(&[(
        "hidden.mcap",
        include_bytes!("../../recordings/hidden.mcap"),
    )]);
    let campaign = Campaign::load(&folder.path("hidden.mcap")).unwrap();
    (folder, campaign)
});

fuzz_target!(|bytes: &[u8]| {
    let (folder, campaign) = &*CELL;
    let path = folder.write("model.toml", bytes);
    match model_file::model(campaign, &EffectList::DEFAULT, Some(&path)) {
        Err(error) => refused(&error),
        Ok(model) => {
            let text = model_file::text(&model).unwrap();
            let path = folder.write("written.toml", text.as_bytes());
            model_file::model(campaign, &EffectList::DEFAULT, Some(&path)).unwrap();
        }
    }
    if let Err(error) = model_file::candidates(campaign, &path) {
        refused(&error);
    }
});
