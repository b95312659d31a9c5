//! A ladder on the terminal, and as JSON.

use super::diagnosis::{
    DiagnosisDocument, document as diagnosis_document, p_value, refusal, rejected, waves, words,
    words_of_verdict,
};
use super::format::{angle, length, number, render, table, wrap};
use misfit_campaign::Campaign;
use misfit_core::diagnosis::Verdict;
use misfit_core::effects::Role;
use misfit_core::ladder::{Ladder, LeftOut, Rung};
use serde::Serialize;
use std::fmt::Write;

/// `misfit.ladder/1`.
#[derive(Debug, Serialize)]
pub struct LadderDocument {
    schema: &'static str,
    rungs: Vec<Rung>,
    left_out: Vec<LeftOut>,
    floor_m: Option<f64>,
    stopped_because: String,
    last: DiagnosisDocument,
}

/// The document.
pub fn document(ladder: &Ladder) -> LadderDocument {
    LadderDocument {
        schema: "misfit.ladder/1",
        rungs: ladder.rungs.clone(),
        left_out: ladder.left_out.clone(),
        floor_m: ladder.floor_m,
        stopped_because: stopped_because(ladder),
        last: diagnosis_document(&ladder.last, None),
    }
}

/// The report.
pub fn text(campaign: &Campaign, ladder: &Ladder) -> String {
    let mut rows = table(
        &[
            "rung",
            "fitted",
            "not fitted",
            "orientation",
            "explains",
            "",
        ],
        &[1, 2, 3, 4],
    );
    let of = |rung: &Rung| rung.heldout.unwrap_or(rung.fit);
    let largest = ladder.rungs.iter().map(|r| of(r).position_rms_m);
    let largest = largest.fold(f64::MIN_POSITIVE, f64::max);
    for (place, rung) in ladder.rungs.iter().enumerate() {
        let shown = of(rung);
        let bar = (BAR * shown.position_rms_m / largest).round() as usize;
        rows.add_row(vec![
            match rung.added.as_str() {
                "nominal" => "frames alone".to_owned(),
                added => format!("+ {added}"),
            },
            length(rung.fit.position_rms_m),
            rung.heldout
                .map_or("—".to_owned(), |e| length(e.position_rms_m)),
            shown.orientation_rms_rad.map_or("—".to_owned(), angle),
            if place == 0 {
                String::new()
            } else {
                format!("{:.1} %", 100.0 * rung.explained)
            },
            "█".repeat(bar),
        ]);
    }
    let mut title = format!(
        "{} · robot {} · position error, rms, rung by rung",
        campaign.name, campaign.robot.name
    );
    if let Some(rejected) = rejected(&ladder.last) {
        let _ = write!(title, " · {rejected} from the diagnosis on");
    }
    let floor = match ladder.floor_m {
        Some(floor) => format!("noise    alone would leave {}", length(floor)),
        None => "noise    its size is not known: no repeats, none in the campaign file".to_owned(),
    };
    let mut out = format!("{}\n\n{}\n\n{floor}\n", wrap(&title, 9), render(&rows));
    if ladder.last.named.iter().any(|id| id == Role::Ripple.id()) {
        let _ = write!(
            out,
            "\n{}\n{}",
            Role::Ripple.id(),
            waves(&ladder.last.waves)
        );
    }
    if !ladder.left_out.is_empty() {
        let _ = write!(out, "\n{}\n", without(ladder));
    }
    let verdict = wrap(&words_of_verdict(&ladder.last), 9);
    let why = wrap(&format!("stopped  {}", stopped_because(ladder)), 9);
    let _ = write!(out, "\n{verdict}\n{why}\n");
    out
}

/// Columns of the longest bar.
const BAR: f64 = 24.0;

/// The last model without each effect that was added.
fn without(ladder: &Ladder) -> String {
    let mut rows = table(
        &[
            "the last rung without",
            "fitted",
            "not fitted",
            "evidence lost",
        ],
        &[1, 2, 3],
    );
    for row in &ladder.left_out {
        rows.add_row(vec![
            row.effect.clone(),
            length(row.fit.position_rms_m),
            row.heldout
                .map_or("—".to_owned(), |e| length(e.position_rms_m)),
            format!("{} nats", number(row.evidence_lost)),
        ]);
    }
    render(&rows)
}

/// Why there is no further rung.
pub(super) fn stopped_because(ladder: &Ladder) -> String {
    let last = &ladder.last;
    if last.stopped {
        return "where it was told to; tests still alarm".to_owned();
    }
    if matches!(
        last.verdict,
        Verdict::Nothing | Verdict::Named | Verdict::Alias
    ) {
        return "no test alarms any more".to_owned();
    }
    if let Some(why) = &last.untold {
        return format!("nothing more can be told: {why}");
    }
    let pattern = last.patterns_left.first();
    let pattern = pattern.map(|found| format!("{}, {}", found.words, p_value(found.p_value)));
    let sure = last.contrasts_left.iter().filter(|c| c.p_value < 1e-3);
    let contrast = sure
        .min_by(|a, b| a.p_value.total_cmp(&b.p_value))
        .map(|c| format!("{}, {}", words(c.name), p_value(c.p_value)));
    let places: Vec<String> = contrast.into_iter().chain(pattern).collect();
    let what = match &last.refused {
        Some(effect) => refusal(effect),
        None => "no effect of the catalogue explains what is left".to_owned(),
    };
    format!("{what}; what is left shows most {}", places.join(" and "))
}
