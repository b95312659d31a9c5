//! Errors against a variable: as a picture, as a line of means, and as numbers.

use super::variables::Variable;
use super::{Picture, ReportError, panel, picture, rms};
use crate::plot::{Content, Dots, Series};
use misfit_campaign::numbers::number;

/// Points of the line of an effect, which is smooth.
pub(super) const EFFECT: usize = 60;
/// Points of the line of means, each of so many readings that chance is small.
pub(super) const MEANS: usize = 20;

/// Stretches of the variable in the table.
const BINS: usize = 8;

/// Readings of one stretch of the variable.
pub(super) struct Bin {
    pub range: String,
    pub count: usize,
    pub without: String,
    pub with: String,
}

/// Least and greatest of all, so that two pictures have one scale.
pub(super) fn range(a: &[f64], b: &[f64], c: &[f64]) -> (f64, f64) {
    let all = a.iter().chain(b).chain(c);
    all.fold((0.0, 0.0), |(least, most), &x| (least.min(x), most.max(x)))
}

pub(super) fn scatter(
    title: &str,
    (variable, quantity): (&Variable, &str),
    (values, colour): (&[f64], usize),
    line: Option<(String, Vec<(f64, f64)>)>,
    scale: (f64, f64),
    says: String,
) -> Result<Picture, ReportError> {
    let points = variable.values.iter().copied().zip(values.iter().copied());
    let points: Vec<(f64, f64)> = points.collect();
    let dots = Dots {
        name: "readings".to_owned(),
        points,
        colour,
    };
    let lines = line.map(|(name, points)| Series {
        name,
        points,
        colour: 6,
        dashed: false,
    });
    let content = Content::Scatter {
        dots: vec![dots],
        heights: Some(scale),
        lines: lines.into_iter().collect(),
    };
    let alt = format!(
        "{quantity} of {} readings against {}, {title}: {says}.",
        values.len(),
        variable.name
    );
    let caption = format!("{title}: {says}");
    let panel = panel(title, &variable.name, quantity, content);
    Ok(picture(panel, 320, alt, caption)?)
}

/// A line through points: means of at most so many stretches of equally many, or of equal values of the variable.
pub(super) fn averaged(variable: &[f64], values: &[f64], most: usize) -> Vec<(f64, f64)> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| variable[a].total_cmp(&variable[b]).then(a.cmp(&b)));
    let least = order.len().div_ceil(most);
    let mut line = Vec::new();
    let mut part: Vec<usize> = Vec::new();
    for (at, &k) in order.iter().enumerate() {
        part.push(k);
        let ends = order
            .get(at + 1)
            .is_none_or(|&next| variable[next] != variable[k]);
        if ends && (part.len() >= least || at + 1 == order.len()) {
            let mean = |of: &[f64]| part.iter().map(|&k| of[k]).sum::<f64>() / part.len() as f64;
            line.push((mean(variable), mean(values)));
            part.clear();
        }
    }
    line
}

/// The picture as numbers: stretches of the variable with equally many readings.
pub(super) fn bins(variable: &Variable, without: &[f64], with: &[f64]) -> Vec<Bin> {
    let mut order: Vec<usize> = (0..without.len()).collect();
    let values = &variable.values;
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]).then(a.cmp(&b)));
    let most = order.len().div_ceil(BINS).max(1);
    let mut found = Vec::new();
    let mut part: Vec<usize> = Vec::new();
    for (at, &k) in order.iter().enumerate() {
        part.push(k);
        let next = order.get(at + 1);
        // readings of one value stay together
        let ends = next.is_none_or(|&next| values[next] != values[k]);
        if next.is_none() || (ends && part.len() >= most) {
            let (from, to) = (values[part[0]], values[k]);
            let decimals = variable.decimals;
            let range = match from == to {
                true => format!("{from:.decimals$}"),
                false => format!("{from:.decimals$} … {to:.decimals$}"),
            };
            found.push(Bin {
                range,
                count: part.len(),
                without: number(rms(part.iter().map(|&k| without[k]))),
                with: number(rms(part.iter().map(|&k| with[k]))),
            });
            part.clear();
        }
    }
    found
}
