//! A sweep on the terminal, and as JSON.

use super::format::{number, render, say, table, wrap};
use misfit_cell::sweep::summary::{Bin, Check, Summary};
use serde::Serialize;
use std::fmt::Write;

/// `misfit.sweep/1`.
#[derive(Debug, Serialize)]
pub struct SweepDocument {
    schema: &'static str,
    scenario: String,
    seed: u64,
    summary: Summary,
    expect: Vec<Check>,
    passed: bool,
}

impl SweepDocument {
    /// The document.
    pub fn new(scenario: &str, seed: u64, summary: Summary, expect: Vec<Check>) -> Self {
        Self {
            schema: "misfit.sweep/1",
            scenario: scenario.to_owned(),
            seed,
            summary,
            passed: expect.iter().all(|check| check.passed),
            expect,
        }
    }

    /// Were all expectations met?
    pub fn passed(&self) -> bool {
        self.passed
    }

    /// The report.
    pub fn text(&self, title: &str) -> String {
        let mut out = String::new();
        let summary = &self.summary;
        let head = format!(
            "{} · {title} · seed {} · {} cases, {} families",
            self.scenario, self.seed, summary.cases, summary.families
        );
        say(&mut out, &head);
        out.push('\n');
        let _ = writeln!(out, "{}\n", answers(summary));
        if !summary.confusion.is_empty() {
            let _ = writeln!(out, "wrong");
            for (way, cases) in &summary.confusion {
                let cases: Vec<String> = cases.iter().map(usize::to_string).collect();
                let line = format!("  {way}: case {}", cases.join(", "));
                let _ = writeln!(out, "{}", wrap(&line, 4));
            }
            let _ = writeln!(out);
        }
        if !summary.matrix.is_empty() {
            let _ = writeln!(out, "hidden → said, λ from 30");
            for (hidden, answers) in &summary.matrix {
                let mut answers: Vec<(&String, &usize)> = answers.iter().collect();
                answers.sort_by(|a, b| b.1.cmp(a.1).then(a.0.cmp(b.0)));
                let said: Vec<String> = answers
                    .iter()
                    .map(|(answer, n)| {
                        let answer = if *answer == hidden { "itself" } else { answer };
                        format!("{answer} {n}")
                    })
                    .collect();
                let line = format!("  {hidden:<20} {}", said.join(" · "));
                let _ = writeln!(out, "{}", wrap(&line, 23));
            }
            let _ = writeln!(out);
        }
        let _ = writeln!(out, "{}", checks(&self.expect));
        out
    }
}

/// Shares of the cases by what was hidden and what was answered.
fn answers(summary: &Summary) -> String {
    let mut rows = table(
        &[
            "hidden",
            "λ",
            "cases",
            "right",
            "incomplete",
            "in a set",
            "nothing",
            "unknown",
            "wrong",
        ],
        &[2, 3, 4, 5, 6, 7, 8, 9],
    );
    let mut add = |what: &str, span: String, bin: &Bin| {
        let share = |n: usize| {
            if n == 0 {
                "·".to_owned()
            } else {
                format!("{:.1} %", 100.0 * n as f64 / bin.cases as f64)
            }
        };
        if bin.cases > 0 {
            rows.add_row(vec![
                what.to_owned(),
                span,
                bin.cases.to_string(),
                share(bin.right),
                share(bin.incomplete),
                share(bin.in_set),
                share(bin.partial),
                share(bin.missed),
                share(bin.unknown),
                share(bin.wrong),
            ]);
        }
    };
    for bin in &summary.one {
        let span = match bin.to {
            Some(to) => format!("{} to {}", number(bin.from), number(to)),
            None => format!("over {}", number(bin.from)),
        };
        add("one effect", span, bin);
    }
    add("nothing", String::new(), &summary.none);
    add("two effects", "both over 60".to_owned(), &summary.two);
    add("two effects", "less".to_owned(), &summary.two_faint);
    add("not in catalogue", "over 100".to_owned(), &summary.outside);
    add(
        "not in catalogue",
        "less".to_owned(),
        &summary.outside_faint,
    );
    render(&rows)
}

/// What was expected, and what came out.
fn checks(expect: &[Check]) -> String {
    let mut rows = table(&["", "found", "cases", "asked", ""], &[1, 2, 3]);
    for check in expect {
        let Some(found) = check.found else { continue };
        let asked = check.limit.map_or_else(String::new, |limit| {
            format!("{} {limit}", if check.least { "≥" } else { "≤" })
        });
        let verdict = match (check.limit, check.passed) {
            (None, _) => "",
            (_, true) => "ok",
            (_, false) => "MISSED",
        };
        rows.add_row(vec![
            check.what.to_owned(),
            format!("{found:.3}"),
            check.cases.to_string(),
            asked,
            verdict.to_owned(),
        ]);
    }
    render(&rows)
}
