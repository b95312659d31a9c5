//! A campaign as a command opens it: with its findings, computed once and said on stderr.

use super::{Outcome, print, print_json, terminal};
use crate::campaign::{Campaign, Split};
use crate::findings::{self, Finding, Severity};
use crate::fit::Fit;
use crate::report;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// A campaign and what is wrong with its data.
pub struct Opened {
    /// The campaign: to be fitted, without the rows that the others contradict.
    pub campaign: Campaign,
    /// Its findings, the worst first.
    pub findings: Vec<Finding>,
    /// Lines of the rows that were rejected.
    pub rejected: Vec<usize>,
}

/// Whether errors among the findings end a command; the same word in every command that fits.
#[derive(Debug, clap::Args)]
pub struct Despite {
    /// Go on although there are errors among the findings about the data.
    #[arg(long)]
    despite_findings: bool,
}

/// A result with the findings about its data.
#[derive(Debug, Serialize)]
pub struct WithFindings<'a, T: Serialize> {
    #[serde(flatten)]
    document: &'a T,
    findings: &'a [Finding],
}

/// What is said instead of a result where the data have errors.
#[derive(Debug, Serialize)]
struct CheckData<'a> {
    schema: &'static str,
    verdict: &'static str,
    converged: bool,
    effects: [(); 0],
    findings: &'a [Finding],
}

/// Reads a campaign and looks for what is wrong with it.
pub fn open(path: &Path) -> anyhow::Result<Opened> {
    let campaign = Campaign::load(path)?;
    let findings = findings::findings(&campaign);
    Ok(Opened {
        campaign,
        findings,
        rejected: Vec::new(),
    })
}

/// The same, says the findings on stderr, and rejects the rows that the others contradict: in every command the same.
pub fn open_and_say(path: &Path) -> anyhow::Result<Opened> {
    let mut opened = open(path)?;
    say(&opened.findings);
    opened.rejected = findings::strays(&opened.findings);
    let is_kept = |line: &usize| opened.rejected.binary_search(line).is_err();
    let readings = &mut opened.campaign.readings;
    readings.retain(|reading| reading.split != Split::Fit || is_kept(&reading.line));
    if !opened.rejected.is_empty() && !terminal::is_quiet() {
        let count = report::format::count(opened.rejected.len(), "reading");
        let lines: Vec<String> = opened.rejected.iter().map(usize::to_string).collect();
        let text = format!(
            "rejected {count}: nothing is fitted to lines {}",
            lines.join(", ")
        );
        // nothing is left to be done if stderr is closed
        let _ = writeln!(
            std::io::stderr().lock(),
            "{}",
            report::format::wrap(&text, 9)
        );
    }
    Ok(opened)
}

/// Says findings on stderr; notes only if they are what the reader left out.
fn say(findings: &[Finding]) {
    if terminal::is_quiet() {
        return;
    }
    let mut out = std::io::stderr().lock();
    for finding in findings {
        if finding.severity > Severity::Note || finding.kind == "reading" {
            let line = report::findings::line(finding);
            // nothing is left to be done if stderr is closed
            let _ = writeln!(out, "{}", terminal::tame(&line));
        }
    }
}

impl Opened {
    /// The worst severity among the findings.
    pub fn worst(&self) -> Option<Severity> {
        findings::worst(&self.findings)
    }

    fn stops(&self, despite: &Despite) -> bool {
        self.worst() == Some(Severity::Error) && !despite.despite_findings
    }

    /// Ends a command that gives a verdict, where the data have errors: the verdict is to check them.
    pub fn check_data(
        &self,
        despite: &Despite,
        schema: &'static str,
        json: bool,
    ) -> anyhow::Result<Option<Outcome>> {
        if !self.stops(despite) {
            return Ok(None);
        }
        if json {
            print_json(&CheckData {
                schema,
                verdict: "check_data",
                converged: false,
                effects: [],
                findings: &self.findings,
            })?;
        } else {
            let text = report::findings::check(&self.campaign, &self.findings);
            print(&format!(
                "{text}\nverdict  check the data: nothing was fitted (--despite-findings fits all the same)\n"
            ))?;
        }
        Ok(Some(Outcome::Ended(1)))
    }

    /// Refuses to write what a robot would be told, where the data have errors.
    pub fn refuse(&self, despite: &Despite) -> anyhow::Result<()> {
        if self.stops(despite) {
            anyhow::bail!(
                "{}: the data have errors: nothing was written; --despite-findings writes all the same",
                self.campaign.name
            );
        }
        Ok(())
    }

    /// Adds what only a fit shows, and says it.
    pub fn add(&mut self, fit: &Fit) {
        let more = findings::of_a_fit(&self.campaign, fit);
        say(&more);
        self.findings.extend(more);
    }

    /// A result with the findings.
    pub fn with<'a, T: Serialize>(&'a self, document: &'a T) -> WithFindings<'a, T> {
        WithFindings {
            document,
            findings: &self.findings,
        }
    }
}
