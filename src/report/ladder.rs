//! A ladder on the terminal, and as JSON.

use super::diagnosis::{DiagnosisDocument, document as diagnosis_document, words_of_verdict};
use super::format::{angle, length, render, table, wrap};
use crate::campaign::Campaign;
use crate::ladder::{Ladder, Rung};
use serde::Serialize;

/// `misfit.ladder/1`.
#[derive(Debug, Serialize)]
pub struct LadderDocument {
    schema: &'static str,
    rungs: Vec<Rung>,
    last: DiagnosisDocument,
}

/// The document.
pub fn document(ladder: &Ladder) -> LadderDocument {
    LadderDocument {
        schema: "misfit.ladder/1",
        rungs: ladder.rungs.clone(),
        last: diagnosis_document(&ladder.last),
    }
}

/// The report.
pub fn text(campaign: &Campaign, ladder: &Ladder) -> String {
    let mut rows = table(
        &["rung", "fitted", "not fitted", "orientation", ""],
        &[1, 2, 3],
    );
    let of = |rung: &Rung| rung.heldout.unwrap_or(rung.fit);
    let largest = ladder.rungs.iter().map(|r| of(r).position_rms_m);
    let largest = largest.fold(f64::MIN_POSITIVE, f64::max);
    for rung in &ladder.rungs {
        let shown = of(rung);
        let bar = (40.0 * shown.position_rms_m / largest).round() as usize;
        rows.add_row(vec![
            match rung.added.as_str() {
                "nominal" => "frames alone".to_owned(),
                added => format!("+ {added}"),
            },
            length(rung.fit.position_rms_m),
            rung.heldout
                .map_or("—".to_owned(), |e| length(e.position_rms_m)),
            shown.orientation_rms_rad.map_or("—".to_owned(), angle),
            "█".repeat(bar),
        ]);
    }
    let title = format!(
        "{} · robot {} · position error, rms, rung by rung",
        campaign.name, campaign.robot.name
    );
    format!(
        "{}\n\n{}\n\n{}\n",
        wrap(&title, 9),
        render(&rows),
        wrap(&words_of_verdict(&ladder.last), 9)
    )
}
