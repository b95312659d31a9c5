//! What is written to stdout, and how: colours only where a terminal shows them, nothing at all with `--quiet`.

use anstyle::{AnsiColor, Style};
use serde::Serialize;
use std::borrow::Cow;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether `--quiet` was given; set once, before a command starts.
static QUIET: AtomicBool = AtomicBool::new(false);

/// From now on neither results for people nor progress.
pub fn be_quiet() {
    QUIET.store(true, Ordering::Relaxed);
}

/// Was `--quiet` given?
pub fn is_quiet() -> bool {
    QUIET.load(Ordering::Relaxed)
}

/// Writes results for people to stdout; `NO_COLOR` (no-color.org) and pipes get them plain.
pub fn print(text: &str) -> anyhow::Result<()> {
    if is_quiet() {
        return Ok(());
    }
    let mut out = anstream::stdout().lock();
    out.write_all(painted(&tame(text)).as_bytes())?;
    out.flush()?;
    Ok(())
}

/// A text that only says something: what names in a user's file hold cannot colour, move or clear a terminal.
pub fn tame(text: &str) -> Cow<'_, str> {
    let wild = |c: char| c.is_control() && c != '\n';
    match text.contains(wild) {
        true => text.replace(wild, "\u{fffd}").into(),
        false => text.into(),
    }
}

/// Writes bytes for programs to stdout as they are, also with `--quiet`.
pub fn print_plain(text: &str) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    out.write_all(text.as_bytes())?;
    out.flush()?;
    Ok(())
}

/// Writes a result document to stdout, also with `--quiet`.
pub fn print_json(document: &impl Serialize) -> anyhow::Result<()> {
    print_plain(&(serde_json::to_string_pretty(document)? + "\n"))
}

/// Colours a report: its labels, what to do next, bars, what was met and what was missed.
fn painted(text: &str) -> String {
    let mut out = String::with_capacity(2 * text.len());
    let mut in_next = false;
    for line in text.split_inclusive('\n') {
        if line.starts_with("## ") {
            out += &paint(Style::new().bold().underline(), line.trim_end());
            out.push('\n');
            continue;
        }
        let label = label(line);
        in_next = match label {
            Some(label) => label.trim_end() == "next",
            None => in_next && line.starts_with("         "),
        };
        let (head, rest) = line.split_at(label.map_or(0, str::len));
        if !head.is_empty() {
            out += &paint(Style::new().bold(), head);
        }
        let rest = match rest.strip_suffix('\n') {
            Some(rest) => (rest, "\n"),
            None => (rest, ""),
        };
        let word = head.trim_end();
        let all_met = word == "expect"
            && rest.0.split_whitespace().next() == rest.0.split_whitespace().nth(2);
        let style = match word {
            _ if in_next => Some(AnsiColor::Cyan.on_default()),
            "verdict" | "missing" => Some(Style::new().bold()),
            "expect" if all_met => Some(AnsiColor::Green.on_default()),
            "expect" => Some(AnsiColor::Red.on_default()),
            _ if rest.0.trim_start().starts_with("MISSED") => Some(AnsiColor::Red.on_default()),
            _ => None,
        };
        match style {
            Some(style) => out += &paint(style, rest.0),
            None => out += &bars(rest.0),
        }
        out += rest.1;
    }
    out
}

/// The label at the start of a line, the blanks after it included: small words, then two blanks or more.
fn label(line: &str) -> Option<&str> {
    let gap = line.find("  ")?;
    let words = &line[..gap];
    let good = !words.is_empty() && words.chars().all(|c| c.is_ascii_lowercase() || c == ' ');
    let rest = line[gap..].trim_start_matches(' ');
    (good && gap <= 16 && !rest.trim().is_empty()).then(|| &line[..line.len() - rest.len()])
}

/// Bars in the colour of the pictures.
fn bars(text: &str) -> String {
    let Some(first) = text.find('█') else {
        return text.to_owned();
    };
    let (head, rest) = text.split_at(first);
    let bar = rest.trim_start_matches('█');
    let (blocks, tail) = rest.split_at(rest.len() - bar.len());
    format!(
        "{head}{}{tail}",
        paint(AnsiColor::Blue.on_default(), blocks)
    )
}

fn paint(style: Style, text: &str) -> String {
    format!("{style}{text}{style:#}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_its_colours_a_report_is_what_it_was() {
        let report = "cell · robot six_axis\nmodel    geometry · 5 of\n         7\n\n  between poses   × 3  ███ \n\
                      verdict  backlash\nexpect   2 of 3 met\n  MISSED x: found 1\nexpect   3 of 3 met\n\
                      next     misfit fit a\n         misfit ladder a\nlast  ";
        let painted = painted(report);
        assert_eq!(anstream::adapter::strip_str(&painted).to_string(), report);
        for piece in [
            "\u{1b}[1mmodel    \u{1b}[0mgeometry",
            "\u{1b}[34m███\u{1b}[0m ",
            "\u{1b}[31m2 of 3 met\u{1b}[0m",
            "\u{1b}[31m  MISSED x",
            "\u{1b}[32m3 of 3 met\u{1b}[0m",
            "\u{1b}[36mmisfit fit a\u{1b}[0m",
            "\u{1b}[36m         misfit ladder a\u{1b}[0m",
        ] {
            assert!(painted.contains(piece), "{piece:?} in {painted:?}");
        }
    }
}
