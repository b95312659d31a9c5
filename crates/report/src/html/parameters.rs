//! What was fitted: values, intervals, status; and what is known only together.

use crate::fit::stiffness;
use crate::format::{count, number, significant};
use misfit_core::effects::Role;
use misfit_core::fit::{Fit, Status};

/// What the section shows.
pub(super) struct Section {
    /// How many directions the readings fix.
    pub rank: String,
    pub effects: Vec<Effect>,
    /// Of parameters other than geometry and frames, the strongest first.
    pub correlations: Vec<Pair>,
    /// Of the others, which are redundant by nature.
    pub redundant: String,
}

/// Parameters of one effect.
pub(super) struct Effect {
    pub id: String,
    /// Folded away: so many that they would hide all others.
    pub folded: bool,
    pub summary: String,
    /// Options that its law was given, a line each.
    pub options: Vec<String>,
    /// Is there a column of stiffness?
    pub springs: bool,
    pub rows: Vec<Row>,
    /// Of an effect with many, those that may be zero.
    pub rest: Vec<Row>,
}

/// One parameter.
pub(super) struct Row {
    pub name: String,
    pub value: String,
    pub half: String,
    pub unit: String,
    pub stiffness: String,
    pub interval: String,
    pub status: &'static str,
}

/// Two parameters.
pub(super) struct Pair {
    pub a: String,
    pub b: String,
    pub value: String,
    /// Its size, %.
    pub size: u32,
}

/// Pairs of correlated parameters listed.
const MAX_PAIRS: usize = 10;
/// Parameters of an effect that are all shown, even if zero lies within their intervals.
const MAX_ALL_SHOWN: usize = 16;
/// Absolute correlation from which on a pair is listed.
const MIN_CORRELATION: f64 = 0.5;
/// Absolute correlation from which on parameters are known together much better than apart.
const MIN_STRONG_CORRELATION: f64 = 0.9;
const NONE: &str = "—";

pub(super) fn section(fit: &Fit) -> Section {
    let names: Vec<(String, bool)> = fit
        .model
        .parameters()
        .map(|(id, p)| {
            let redundant = p.role.is_some_and(Role::is_redundant);
            (format!("{id}.{}", p.name), redundant)
        })
        .collect();
    let all = fit.correlations(MIN_CORRELATION);
    type Found = Vec<(usize, usize, f64)>;
    let (own, others): (Found, Found) = all
        .into_iter()
        .partition(|&(a, b, _)| !names[a].1 && !names[b].1);
    let strong = others
        .iter()
        .filter(|pair| pair.2.abs() >= MIN_STRONG_CORRELATION)
        .count();
    let pair = |&(a, b, value): &(usize, usize, f64)| Pair {
        a: names[a].0.clone(),
        b: names[b].0.clone(),
        value: format!("{value:+.2}"),
        size: (100.0 * value.abs()).round() as u32,
    };
    Section {
        rank: format!(
            "The readings fix {} of {} directions of the parameters.",
            fit.rank,
            fit.free.len()
        ),
        effects: effects(fit),
        correlations: own.iter().take(MAX_PAIRS).map(pair).collect(),
        redundant: match strong {
            0 => String::new(),
            n => format!(
                "{} of 0.9 and more with geometry and frames are not listed: these are redundant by nature, and are \
                 known together.",
                count(n, "correlation")
            ),
        },
    }
}

fn effects(fit: &Fit) -> Vec<Effect> {
    let quantile = fit.quantile();
    let of_term = |term: &misfit_core::model::Term| {
        let id = term.effect.id();
        let springs = term.effect.role() == Some(Role::Spring);
        let of = |(offset, parameter): (usize, &misfit_core::effects::Parameter)| {
            let k = term.first + offset;
            let half = fit.std[k].map(|std| std * quantile);
            let shown = fit.status[k] != Status::Unobservable;
            let value = fit.values[k];
            let (stiff, interval) = match (springs, shown) {
                (true, true) => stiffness(value, half, &parameter.unit),
                _ => (NONE.to_owned(), NONE.to_owned()),
            };
            Row {
                name: parameter.name.clone(),
                value: match shown {
                    true => significant(value, 5),
                    false => NONE.to_owned(),
                },
                half: half.map_or_else(|| NONE.to_owned(), number),
                unit: parameter.unit.clone(),
                stiffness: stiff,
                interval,
                status: fit.status[k].word(),
            }
        };
        let rows: Vec<Row> = term.parameters.iter().enumerate().map(of).collect();
        let known = rows.iter().filter(|row| row.status == "estimated").count();
        let count_all = rows.len();
        let folded = term.effect.role() == Some(Role::Geometry);
        let sure = |k: usize| {
            let half = fit.std[k].map(|std| std * quantile);
            half.is_some_and(|half| fit.values[k].abs() > half)
        };
        let shown = |place: usize| folded || count_all <= MAX_ALL_SHOWN || sure(term.first + place);
        let (rows, rest): (Vec<_>, Vec<_>) =
            rows.into_iter().enumerate().partition(|row| shown(row.0));
        let options = term.effect.options().to_string();
        Effect {
            folded,
            summary: format!(
                "{}, {known} identified one by one",
                count(count_all, "parameter")
            ),
            options: options
                .lines()
                .filter(|line| !line.is_empty())
                .map(str::to_owned)
                .collect(),
            id: id.to_owned(),
            springs,
            rows: rows.into_iter().map(|(_, row)| row).collect(),
            rest: rest.into_iter().map(|(_, row)| row).collect(),
        }
    };
    fit.model.terms.iter().map(of_term).collect()
}
