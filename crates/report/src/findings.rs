//! Findings about a campaign's data: for people, and as JSON.

use super::format::wrap;
use misfit_core::findings::{Finding, Severity, lines_in_words};
use serde::Serialize;

/// `misfit.check/1`.
#[derive(Debug, Serialize)]
pub struct CheckDocument<'a> {
    schema: &'static str,
    campaign: &'a str,
    readings: usize,
    findings: &'a [Finding],
}

/// The document of `misfit check`.
pub fn document<'a>(
    campaign: &'a misfit_campaign::Campaign,
    findings: &'a [Finding],
) -> CheckDocument<'a> {
    CheckDocument {
        schema: "misfit.check/1",
        campaign: &campaign.name,
        readings: campaign.readings.len(),
        findings,
    }
}

/// The word of a severity.
pub fn word(severity: Severity) -> &'static str {
    match severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "note",
    }
}

/// A finding in a few lines: what, where, evidence and remedy; a line to be written stands by itself, whole.
pub fn text(finding: &Finding) -> String {
    let mut what = format!("{:<8} {}", word(finding.severity), finding.what);
    if !finding.lines.is_empty() {
        what += &format!(" ({})", lines_in_words(&finding.lines));
    }
    let mut text = wrap(&what, 9) + "\n";
    if !finding.evidence.is_empty() {
        text += &format!("{}\n", wrap(&format!("         {}", finding.evidence), 9));
    }
    let remedy = finding.remedy.as_str();
    let (words, line) = match remedy.split_once(": ") {
        Some((words, line)) if line.contains(" = ") => (format!("{words}:"), line),
        _ => (remedy.to_owned(), ""),
    };
    if !words.is_empty() {
        text += &format!("{}\n", wrap(&format!("         → {words}"), 11));
    }
    if !line.is_empty() {
        text += &format!("           {line}\n");
    }
    text
}

/// A finding on one line, as on stderr.
pub fn line(finding: &Finding) -> String {
    let mut text = format!("{}: {}", word(finding.severity), finding.what);
    if !finding.lines.is_empty() {
        text += &format!(" ({})", lines_in_words(&finding.lines));
    }
    for part in [&finding.evidence, &finding.remedy] {
        if !part.is_empty() {
            text += &format!("; {part}");
        }
    }
    text
}

/// All findings of a campaign as `misfit check` prints them.
pub fn check(campaign: &misfit_campaign::Campaign, findings: &[Finding]) -> String {
    let mut text = format!(
        "{} · robot {} · {} readings\n",
        campaign.name,
        campaign.robot.name,
        campaign.readings.len()
    );
    for finding in findings {
        text += &self::text(finding);
    }
    let count = |severity| findings.iter().filter(|f| f.severity == severity).count();
    let counts = [Severity::Error, Severity::Warning, Severity::Note].map(|severity| {
        let count = count(severity);
        let plural = if count == 1 { "" } else { "s" };
        format!("{count} {}{plural}", word(severity))
    });
    text + &format!("findings {}\n", counts.join(" · "))
}
