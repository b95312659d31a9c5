//! One fit, timed, with what it predicts: misfit's side of `make peers`.
//!
//! `peers CAMPAIGN EFFECTS RUNS` prints JSON: seconds of each run, from readings in memory to parameters with their
//! covariance, by the clock; the mean of the processor's; parameters; and the predicted position of every reading held
//! out, in the table's order. Linux only: it asks /proc for the processor's time.

#[path = "../peers/processor.rs"]
mod processor;

use anyhow::{Context, ensure};
use misfit_campaign::{Campaign, Split};
use misfit_core::effects::EffectList;
use misfit_core::fit::{Options, fit};
use misfit_core::model::Workspace;
use misfit_core::model_file;
use std::path::Path;
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [file, effects, runs] = &words[..] else {
        anyhow::bail!("usage: peers CAMPAIGN EFFECTS RUNS");
    };
    let runs: usize = runs.parse().context("RUNS: a number is accepted")?;
    ensure!(runs > 0, "RUNS: accepted: 1 and more");
    let campaign = Campaign::load(Path::new(file))?;
    let model = model_file::model(&campaign, &EffectList::parse("EFFECTS", effects)?, None)?;
    let options = Options {
        cross_validate: false,
    };
    let mut seconds = Vec::new();
    let mut found = None;
    let used = processor::seconds()?;
    for _ in 0..runs {
        let start = Instant::now();
        found = Some(fit(&campaign, &model, &options, |_| {})?);
        seconds.push(start.elapsed().as_secs_f64());
    }
    // of all runs together: the kernel counts a thread's time by the tick, 4 ms
    let processor = (processor::seconds()? - used) / runs as f64;
    let found = found.context("a run")?;
    let mut workspace = Workspace::new(&model.setup);
    let heldout = campaign
        .readings
        .iter()
        .filter(|r| r.split == Split::Heldout);
    let predicted: Vec<[f64; 3]> = heldout
        .map(|reading| {
            workspace
                .predict(&model, &found.values, reading)
                .position
                .into()
        })
        .collect();
    let values: serde_json::Map<String, serde_json::Value> = model
        .parameters()
        .zip(&found.values)
        .map(|((effect, parameter), value)| {
            (format!("{effect}.{}", parameter.name), (*value).into())
        })
        .collect();
    println!(
        "{}",
        serde_json::json!({
            "seconds": seconds,
            "processor_seconds": [processor],
            "parameters": found.values.len(),
            "fixed": found.rank,
            "converged": found.converged,
            "values": values,
            "predicted_m": predicted,
        })
    );
    Ok(())
}
