//! The falling error, rung by rung: a chart and the table that it is drawn from.

use super::{Picture, ReportError, Results, panel, picture};
use crate::format::{angle, length, number};
use crate::ladder::stopped_because;
use crate::plot::{Content, Levels};
use misfit_core::fit::noise::Source;
use misfit_core::ladder::Rung;

/// What the section shows.
pub(super) struct Section {
    pub picture: Option<Picture>,
    pub rows: Vec<Row>,
    /// Is there a column of what each rung explains?
    pub explains: bool,
    /// Each effect that was added, left out again.
    pub without: Vec<Without>,
    /// A line each.
    pub notes: Vec<String>,
}

/// A rung.
pub(super) struct Row {
    pub name: String,
    pub fitted: String,
    pub heldout: String,
    pub max: String,
    pub orientation: String,
    pub explained: String,
}

/// The last model without one effect.
pub(super) struct Without {
    pub effect: String,
    pub fitted: String,
    pub heldout: String,
    pub lost: String,
}

const NONE: &str = "—";

pub(super) fn section(results: &Results<'_>) -> Result<Section, ReportError> {
    let rungs = results.rungs();
    let fit = results.fit();
    let floor =
        (fit.noise.source != Source::Residual).then(|| fit.noise.position_sigma * 3f64.sqrt());
    let explains = matches!(results, Results::Ladder { .. });
    let rows = rungs.iter().enumerate().map(|(place, rung)| Row {
        name: name(rung),
        fitted: length(rung.fit.position_rms_m),
        heldout: rung
            .heldout
            .map_or_else(|| NONE.to_owned(), |e| length(e.position_rms_m)),
        max: length(rung.fit.position_max_m),
        orientation: rung
            .fit
            .orientation_rms_rad
            .map_or_else(|| NONE.to_owned(), angle),
        explained: match place {
            0 => NONE.to_owned(),
            _ => format!("{:.1} %", 100.0 * rung.explained),
        },
    });
    let rows = rows.collect();
    let mut notes = vec![match floor {
        Some(floor) => format!("Noise alone would leave {}.", length(floor)),
        None => {
            "The size of the noise is not known: no repeats, none in the campaign file.".to_owned()
        }
    }];
    let mut without = Vec::new();
    if let Results::Ladder { ladder, .. } = results {
        notes.push(format!("It stopped because {}.", because(ladder)));
        let row = |row: &misfit_core::ladder::LeftOut| Without {
            effect: row.effect.clone(),
            fitted: length(row.fit.position_rms_m),
            heldout: row
                .heldout
                .map_or_else(|| NONE.to_owned(), |e| length(e.position_rms_m)),
            lost: format!("{} nats", number(row.evidence_lost)),
        };
        without = ladder.left_out.iter().map(row).collect();
    }
    let picture = match rungs.len() {
        0 | 1 => None,
        _ => Some(chart(&rungs, floor)?),
    };
    Ok(Section {
        picture,
        rows,
        explains,
        without,
        notes,
    })
}

/// Why there is no further rung, as the end of a sentence.
fn because(ladder: &misfit_core::ladder::Ladder) -> String {
    match ladder.last.stopped {
        true => "it was told to; tests still alarm".to_owned(),
        false => stopped_because(ladder),
    }
}

fn name(rung: &Rung) -> String {
    match rung.added.as_str() {
        "nominal" => "frames alone".to_owned(),
        plain @ ("fitted" | "base model") => plain.to_owned(),
        added => format!("+ {added}"),
    }
}

fn chart(rungs: &[Rung], floor: Option<f64>) -> Result<Picture, ReportError> {
    let mm = |metres: f64| Some(metres * 1e3);
    let fitted: Vec<Option<f64>> = rungs
        .iter()
        .map(|rung| mm(rung.fit.position_rms_m))
        .collect();
    let mut series = vec![("fitted".to_owned(), fitted)];
    if rungs.iter().any(|rung| rung.heldout.is_some()) {
        let held = rungs.iter();
        let held = held.map(|rung| rung.heldout.and_then(|errors| mm(errors.position_rms_m)));
        series.push(("not fitted".to_owned(), held.collect()));
    }
    let rows: Vec<String> = rungs.iter().map(name).collect();
    let height = 100 + 30 * rows.len() as u32;
    let alt: Vec<String> = rungs
        .iter()
        .map(|rung| format!("{} {}", name(rung), length(rung.fit.position_rms_m)))
        .collect();
    let levels = Levels {
        rows,
        series,
        reference: floor.map(|floor| ("noise alone".to_owned(), floor * 1e3)),
    };
    let panel = panel(
        "",
        "position error, rms, mm (logarithmic)",
        "",
        Content::Levels(levels),
    );
    Ok(picture(
        panel,
        height,
        format!("Falling position error of the fitted readings: {}.", alt.join(", ")),
        "Position error, rms, rung by rung, downwards. The axis is logarithmic: the same way to the left is the same factor."
            .to_owned(),
    )?)
}
