//! A campaign as a command opens it: with its findings, computed once and said on stderr.

use super::terminal;
use crate::campaign::Campaign;
use crate::findings::{self, Finding, Severity};
use crate::report;
use std::path::Path;

/// A campaign and what is wrong with its data.
pub struct Opened {
    /// The campaign.
    pub campaign: Campaign,
    /// Its findings, the worst first.
    pub findings: Vec<Finding>,
}

/// Reads a campaign and looks for what is wrong with it.
pub fn open(path: &Path) -> anyhow::Result<Opened> {
    let campaign = Campaign::load(path)?;
    let findings = findings::findings(&campaign);
    Ok(Opened { campaign, findings })
}

impl Opened {
    /// The worst severity among the findings.
    pub fn worst(&self) -> Option<Severity> {
        findings::worst(&self.findings)
    }

    /// Says the findings on stderr.
    pub fn say(self) -> Self {
        if terminal::is_quiet() {
            return self;
        }
        use std::io::Write;
        let mut out = std::io::stderr().lock();
        for finding in &self.findings {
            // nothing is left to be done if stderr is closed
            let _ = write!(out, "{}", terminal::tame(&report::findings::text(finding)));
        }
        self
    }
}
