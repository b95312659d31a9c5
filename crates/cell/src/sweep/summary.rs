//! The figures of a sweep: success by signal, alarms, confusion, and whether they are what was asked for.

use super::score::Row;
use crate::scenario::blind::Expected;
use serde::Serialize;
use std::collections::BTreeMap;

/// Edges between bins of λ.
const EDGES: [f64; 5] = [10.0, 30.0, 60.0, 100.0, 300.0];
/// A pair is asked to be named where both have more than this.
const CLEAR: f64 = 60.0;
/// What is outside the catalogue is asked to be seen from here on.
const STRONG: f64 = 100.0;

/// Outcomes of the cases of one bin.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Bin {
    /// λ from ...
    pub from: f64,
    /// ... to; none is without end.
    pub to: Option<f64>,
    /// Cases.
    pub cases: usize,
    /// By outcome.
    pub right: usize,
    /// The right one, said to be incomplete.
    pub incomplete: usize,
    /// A set that holds it.
    pub in_set: usize,
    /// One of two.
    pub partial: usize,
    /// Nothing said.
    pub missed: usize,
    /// Unknown.
    pub unknown: usize,
    /// Wrong.
    pub wrong: usize,
}

impl Bin {
    fn add(&mut self, row: &Row) {
        self.cases += 1;
        match row.outcome.as_str() {
            "right" => self.right += 1,
            "incomplete" => self.incomplete += 1,
            "in_set" => self.in_set += 1,
            "partial" => self.partial += 1,
            "missed" => self.missed += 1,
            "unknown" => self.unknown += 1,
            _ => self.wrong += 1,
        }
    }
}

/// All figures.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Summary {
    /// Cases.
    pub cases: usize,
    /// Families among those with one hidden effect.
    pub families: usize,
    /// Cases with one hidden effect by λ.
    pub one: Vec<Bin>,
    /// Cases without.
    pub none: Bin,
    /// Pairs, both above λ 60.
    pub two: Bin,
    /// Pairs below.
    pub two_faint: Bin,
    /// Outside the catalogue, λ above 100.
    pub outside: Bin,
    /// Of those said to be unknown, the right contrast.
    pub outside_contrast: usize,
    /// Below.
    pub outside_faint: Bin,
    /// Wrong single names, as `hidden → named`, with their cases.
    pub confusion: BTreeMap<String, Vec<usize>>,
    /// Hidden effect by named effect (or verdict), single hidden effects with λ above 30.
    pub matrix: BTreeMap<String, BTreeMap<String, usize>>,
    /// Median of held-out whitened rms over that of the noise, where the hidden one was named.
    pub heldout_ratio: Option<f64>,
    /// The same of the base model.
    pub heldout_ratio_base: Option<f64>,
    /// Alias sets whose proposed poses were measured: resolved, and all that could be.
    pub resolved: (usize, usize),
}

/// Makes the figures.
pub fn summary(rows: &[Row]) -> Summary {
    let mut out = Summary {
        cases: rows.len(),
        one: bins(),
        ..Summary::default()
    };
    let mut families: Vec<&str> = Vec::new();
    let (mut named, mut base) = (Vec::new(), Vec::new());
    for row in rows {
        match row.class.as_str() {
            "one" => {
                if !families.contains(&row.hidden.as_str()) {
                    families.push(&row.hidden);
                }
                let place = EDGES.iter().filter(|edge| row.lambda >= **edge).count();
                out.one[place].add(row);
                if row.outcome == "wrong" {
                    let way = format!("{} → {} ({})", row.hidden, row.named, row.verdict);
                    out.confusion.entry(way).or_default().push(row.case);
                }
                if row.lambda >= EDGES[1] {
                    let answer = if row.named.is_empty() {
                        row.verdict.clone()
                    } else {
                        row.named.clone()
                    };
                    let line = out.matrix.entry(row.hidden.clone()).or_default();
                    *line.entry(answer).or_default() += 1;
                }
                if matches!(row.outcome.as_str(), "right" | "incomplete") {
                    let ratio = |of: Option<f64>| Some(of? / row.heldout_oracle?);
                    named.extend(ratio(row.heldout_named));
                    base.extend(ratio(row.heldout_base));
                }
            }
            "none" => out.none.add(row),
            "two" if row.lambda >= CLEAR => out.two.add(row),
            "two" => out.two_faint.add(row),
            _ if row.lambda >= STRONG => {
                out.outside.add(row);
                let right = row.outcome == "right" && row.contrast == row.contrast_found;
                out.outside_contrast += usize::from(right);
            }
            _ => out.outside_faint.add(row),
        }
        match row.resolved.as_str() {
            "" | "cannot" => {}
            "named" => {
                out.resolved.0 += 1;
                out.resolved.1 += 1;
            }
            _ => out.resolved.1 += 1,
        }
    }
    out.families = families.len();
    out.heldout_ratio = median(named);
    out.heldout_ratio_base = median(base);
    out
}

fn bins() -> Vec<Bin> {
    let mut from = 0.0;
    let ends = EDGES.iter().map(|edge| Some(*edge)).chain([None]);
    ends.map(|to| {
        let bin = Bin {
            from,
            to,
            ..Bin::default()
        };
        from = to.unwrap_or(from);
        bin
    })
    .collect()
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// One expectation beside what was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Check {
    /// What.
    pub what: &'static str,
    /// Found; none without cases.
    pub found: Option<f64>,
    /// Cases.
    pub cases: usize,
    /// Limit; none if nothing is expected.
    pub limit: Option<f64>,
    /// Is the limit the least, or the greatest?
    pub least: bool,
    /// Kept? Always, where nothing is expected or there are no cases.
    pub passed: bool,
}

/// All expectations.
pub fn checks(summary: &Summary, expected: &Expected) -> Vec<Check> {
    let hit = |bin: &Bin| {
        let more = if expected.incomplete_is_right {
            bin.incomplete
        } else {
            0
        };
        bin.right + more
    };
    let share = |bins: &[&Bin]| {
        let cases: usize = bins.iter().map(|bin| bin.cases).sum();
        (bins.iter().map(|bin| hit(bin)).sum::<usize>(), cases)
    };
    let bins = &summary.one;
    let all: usize = bins.iter().map(|bin| bin.cases).sum();
    let wrong: usize = bins.iter().map(|bin| bin.wrong).sum();
    let strong = share(&[&bins[4], &bins[5]]);
    let rows = [
        (
            "named right, λ ≥ 100",
            strong,
            expected.named_from_100,
            true,
        ),
        (
            "named right, λ 60 to 100",
            share(&[&bins[3]]),
            expected.named_from_60,
            true,
        ),
        ("wrong single names", (wrong, all), expected.wrong, false),
        (
            "alarms without an effect",
            (summary.none.cases - summary.none.right, summary.none.cases),
            expected.alarms,
            false,
        ),
        (
            "\"nothing\", λ < 10",
            (bins[0].missed, bins[0].cases),
            expected.nothing_below_10,
            true,
        ),
        (
            "outside the catalogue, λ > 100: \"unknown\", right contrast",
            (summary.outside_contrast, summary.outside.cases),
            expected.unknown,
            true,
        ),
        (
            "two effects, both λ > 60: the pair",
            share(&[&summary.two]),
            expected.pairs,
            true,
        ),
        (
            "aliases resolved by the proposed poses",
            summary.resolved,
            expected.resolved,
            true,
        ),
    ];
    let mut found: Vec<Check> = rows
        .into_iter()
        .map(|(what, (hits, cases), limit, least)| {
            let share = (cases > 0).then(|| hits as f64 / cases as f64);
            check(what, share, cases, limit, least)
        })
        .collect();
    found.push(check(
        "held-out whitened rms over that of noise, named",
        summary.heldout_ratio,
        bins.iter().map(|bin| bin.right + bin.incomplete).sum(),
        expected.heldout_ratio,
        false,
    ));
    found
}

fn check(
    what: &'static str,
    found: Option<f64>,
    cases: usize,
    limit: Option<f64>,
    least: bool,
) -> Check {
    let kept = |found: f64, limit: f64| {
        if least {
            found >= limit
        } else {
            found <= limit
        }
    };
    let pair = found.zip(limit);
    Check {
        what,
        found,
        cases,
        limit,
        least,
        passed: pair.is_none_or(|(found, limit)| kept(found, limit)),
    }
}
