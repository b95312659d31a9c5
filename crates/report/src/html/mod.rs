//! A result as one HTML file: nothing else is needed to read it, on a screen, a phone or paper.
//!
//! Each section is a file that turns results into words, tables and pictures, beside the template that shows them.
//! Templates are compiled in; whatever they are given is escaped, so names of campaigns and joints may hold any
//! letter. No clock is read: the same results give the same bytes.

mod against;
mod blind;
mod carrier;
mod falling;
mod next;
mod origin;
mod parameters;
mod places;
mod pull;
mod variables;
mod verdict;

use crate::plot::{Content, Figure, Panel, PlotError, svg};
use askama::Template;
use misfit_campaign::{Campaign, Reading};
use misfit_core::diagnosis::Diagnosis;
use misfit_core::fit::Fit;
use misfit_core::ladder::{Ladder, Rung};
use misfit_core::plan::Separation;

pub use origin::{Origin, Step};

/// What there is to report.
#[derive(Debug, Clone, Copy)]
pub enum Results<'a> {
    /// A fit.
    Fit {
        /// It.
        fit: &'a Fit,
        /// The fit of the frames alone.
        baseline: Option<&'a Fit>,
    },
    /// A diagnosis.
    Diagnosis {
        /// It.
        diagnosis: &'a Diagnosis,
        /// Poses that would settle an alias.
        next: Option<&'a Separation>,
    },
    /// A ladder and the diagnosis at which it ended.
    Ladder {
        /// It.
        ladder: &'a Ladder,
        /// Poses that would settle an alias.
        next: Option<&'a Separation>,
    },
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A picture.
    #[error(transparent)]
    Plot(#[from] PlotError),
    /// The page.
    #[error("the report cannot be written down: {0}")]
    Page(#[from] askama::Error),
}

impl<'a> Results<'a> {
    fn diagnosis(&self) -> Option<&'a Diagnosis> {
        match *self {
            Results::Fit { .. } => None,
            Results::Diagnosis { diagnosis, .. } => Some(diagnosis),
            Results::Ladder { ladder, .. } => Some(&ladder.last),
        }
    }

    fn next(&self) -> Option<&'a Separation> {
        match *self {
            Results::Fit { .. } => None,
            Results::Diagnosis { next, .. } | Results::Ladder { next, .. } => next,
        }
    }

    /// The model that is reported.
    fn fit(&self) -> &'a Fit {
        match *self {
            Results::Fit { fit, .. } => fit,
            Results::Diagnosis { diagnosis, .. } => &diagnosis.fit,
            Results::Ladder { ladder, .. } => &ladder.last.fit,
        }
    }

    /// What it is compared with: the model before anything was named, or the frames alone. None if it is the same.
    fn before(&self) -> Option<&'a Fit> {
        match *self {
            Results::Fit { baseline, .. } => baseline,
            _ => {
                let diagnosis = self.diagnosis()?;
                (!diagnosis.steps.is_empty()).then_some(&diagnosis.base)
            }
        }
    }

    /// The errors, falling.
    fn rungs(&self) -> Vec<Rung> {
        let rung = |added: &str, fit: &Fit| Rung {
            added: added.to_owned(),
            fit: fit.fit,
            heldout: fit.heldout,
            explained: 0.0,
        };
        match self {
            Results::Fit { fit, baseline } => {
                let frames = baseline.map(|fit| rung("nominal", fit));
                frames.into_iter().chain([rung("fitted", fit)]).collect()
            }
            Results::Diagnosis { diagnosis, .. } => {
                let steps = diagnosis.steps.iter().map(|(id, fit)| rung(id, fit));
                let base = rung("base model", &diagnosis.base);
                std::iter::once(base).chain(steps).collect()
            }
            Results::Ladder { ladder, .. } => ladder.rungs.clone(),
        }
    }
}

/// The page.
#[derive(Template)]
#[template(path = "page.html")]
struct Page {
    title: String,
    findings: Vec<String>,
    verdict: verdict::Section,
    falling: falling::Section,
    carrier: carrier::Section,
    places: Option<places::Section>,
    parameters: parameters::Section,
    blind: blind::Section,
    next: next::Section,
    origin: origin::Section,
}

/// The whole file.
///
/// # Errors
/// If a picture cannot be drawn.
pub fn page(
    campaign: &Campaign,
    results: &Results<'_>,
    origin: &Origin,
) -> Result<String, ReportError> {
    let screened;
    // what was rejected as an outlier is in no fit, and would be all that the pictures show
    let shown = match results.diagnosis() {
        Some(diagnosis) => {
            screened = diagnosis.screened(campaign);
            &screened
        }
        None => campaign,
    };
    let carrier = carrier::section(shown, results)?;
    let page = Page {
        title: campaign.name.clone(),
        findings: origin.findings.iter().map(crate::findings::line).collect(),
        verdict: verdict::section(campaign, results, &carrier.plots, origin),
        falling: falling::section(results)?,
        carrier,
        places: places::section(shown, results)?,
        parameters: parameters::section(results.fit()),
        blind: blind::section(campaign, results),
        next: next::section(campaign, results, origin),
        origin: origin::section(campaign, results, origin),
    };
    Ok(page.render()? + "\n")
}

/// A picture with what it shows in words.
struct Picture {
    svg: String,
    /// For those who do not see it.
    alt: String,
    /// Below it.
    caption: String,
}

/// Width of a picture, px: on a telephone its letters are as large as the text's.
const WIDTH: u32 = 460;

/// One panel as a picture.
fn picture(panel: Panel, height: u32, alt: String, caption: String) -> Result<Picture, PlotError> {
    let figure = Figure {
        title: Vec::new(),
        panels: vec![panel],
        columns: 1,
        panel_size: (WIDTH, height),
    };
    Ok(Picture {
        svg: svg(&figure)?,
        alt,
        caption,
    })
}

/// The panel of a picture.
fn panel(title: &str, x: &str, y: &str, content: Content) -> Panel {
    Panel {
        title: title.to_owned(),
        x: x.to_owned(),
        y: y.to_owned(),
        content,
    }
}

/// Places of at most `most` of `count` things, spread over all of them without a rhythm of their own: designs have
/// rhythms (loads, directions, repeats), and every n-th reading may be of one kind.
fn thinned(count: usize, most: usize) -> Vec<usize> {
    if count <= most {
        return (0..count).collect();
    }
    /// Fractional parts of its multiples are spread evenly.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let share = most as f64 / count as f64;
    let kept = |index: &usize| (*index as f64 * GOLDEN).fract() < share;
    (0..count).filter(kept).take(most).collect()
}

/// The fitted readings.
fn fitted(campaign: &Campaign) -> Vec<&Reading> {
    let readings = campaign.readings.iter();
    readings
        .filter(|reading| reading.split == misfit_campaign::Split::Fit)
        .collect()
}

/// Root mean square.
fn rms(values: impl IntoIterator<Item = f64>) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for value in values {
        sum += value * value;
        count += 1;
    }
    (sum / count.max(1) as f64).sqrt()
}
