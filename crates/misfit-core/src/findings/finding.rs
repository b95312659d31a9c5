//! One finding: what is wrong with a campaign's data, where, why it is believed, and what to do.

use serde::Serialize;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Good to know.
    Note,
    /// Results may mislead.
    Warning,
    /// No result of these data can be believed.
    Error,
}

/// What was found in the data before any effect is asked for.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Finding {
    /// Which kind, as one word for programs.
    pub kind: &'static str,
    /// How bad it is.
    pub severity: Severity,
    /// Lines of the table that it is about; none if it is about all of them.
    pub lines: Vec<usize>,
    /// What is wrong, in one sentence.
    pub what: String,
    /// The numbers that say so.
    pub evidence: String,
    /// What to do: a command, a line of a file, or a measurement.
    pub remedy: String,
}

impl Finding {
    /// A finding about the whole table.
    pub fn new(kind: &'static str, severity: Severity, what: impl Into<String>) -> Self {
        Self {
            kind,
            severity,
            lines: Vec::new(),
            what: what.into(),
            evidence: String::new(),
            remedy: String::new(),
        }
    }

    /// The same about these lines, in their order.
    pub fn at(mut self, mut lines: Vec<usize>) -> Self {
        lines.sort_unstable();
        lines.dedup();
        self.lines = lines;
        self
    }

    /// The same with the numbers that say so.
    pub fn because(mut self, evidence: impl Into<String>) -> Self {
        self.evidence = evidence.into();
        self
    }

    /// The same with what to do.
    pub fn remedy(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = remedy.into();
        self
    }
}

/// The worst severity among findings.
pub fn worst(findings: &[Finding]) -> Option<Severity> {
    findings.iter().map(|finding| finding.severity).max()
}

/// Numbers of lines in words: ranges of neighbours, at most eight of them.
pub fn lines_in_words(lines: &[usize]) -> String {
    const MAX_RANGES: usize = 8;
    let ranges: Vec<&[usize]> = lines.chunk_by(|a, b| b - a == 1).collect();
    let words: Vec<String> = ranges
        .iter()
        .take(MAX_RANGES)
        .map(|range| match range {
            [only] => only.to_string(),
            [first, .., last] => format!("{first}-{last}"),
            [] => String::new(),
        })
        .collect();
    let more = match ranges.len().checked_sub(MAX_RANGES) {
        Some(more) if more > 0 => format!(" and {more} more"),
        _ => String::new(),
    };
    let word = if lines.len() == 1 { "line" } else { "lines" };
    format!("{word} {}{more}", words.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_said_as_ranges() {
        for (lines, words) in [
            (vec![4], "line 4"),
            (vec![4, 5, 6], "lines 4-6"),
            (vec![2, 3, 7], "lines 2-3, 7"),
            (
                (0..10).map(|k| 3 * k).collect(),
                "lines 0, 3, 6, 9, 12, 15, 18, 21 and 2 more",
            ),
        ] {
            assert_eq!(lines_in_words(&lines), words);
        }
    }

    #[test]
    fn an_error_is_worse_than_a_warning_and_that_than_a_note() {
        let of = |severity| Finding::new("x", severity, "");
        let (note, warning, error) = (Severity::Note, Severity::Warning, Severity::Error);
        assert_eq!(worst(&[]), None);
        assert_eq!(worst(&[of(note)]), Some(note));
        assert_eq!(worst(&[of(note), of(warning)]), Some(warning));
        assert_eq!(worst(&[of(error), of(warning)]), Some(error));
        let json = serde_json::to_string(&of(error).at(vec![3, 2, 3])).unwrap_or_default();
        assert!(
            json.contains(r#""severity":"error","lines":[2,3]"#),
            "{json}"
        );
    }
}
