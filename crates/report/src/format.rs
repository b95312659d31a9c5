//! Tables and texts as people read them: at most 100 columns.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
pub use misfit_campaign::numbers::{angle, count, length, number, significant};

/// Columns of the output.
pub const WIDTH: u16 = 100;

/// A table without rules, numbers to the right.
pub fn table(header: &[&str], right: &[usize]) -> Table {
    let mut table = Table::new();
    table
        .load_style(presets::NOTHING)
        .set_content_arrangement(ContentArrangement::Dynamic)
        .set_width(WIDTH)
        .set_header(header.to_vec());
    for &column in right {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

/// A model's name for people.
pub fn model_name(model: &str) -> &str {
    match model {
        "default" => "default model",
        "true" => "the truth",
        "" => "frames alone",
        words => words,
    }
}

/// A share in per cent.
pub fn percent(share: f64) -> String {
    // below a millionth of a per cent it is rounding
    if share.abs() < 1e-8 {
        return "< 1e-6 %".to_owned();
    }
    format!("{} %", number(share * 100.0))
}

/// A table's text without trailing blanks.
pub fn render(table: &Table) -> String {
    let lines: Vec<String> = table
        .lines()
        .map(|line| format!(" {}", line.trim_end()))
        .collect();
    lines.join("\n")
}

/// Appends a line whose label takes nine columns, broken behind it.
pub fn say(out: &mut String, line: &str) {
    out.push_str(&wrap(line, 9));
    out.push('\n');
}

/// Breaks a text at blanks into lines of at most [`WIDTH`] columns, continuation lines indented; the blanks
/// that it starts with are kept.
pub fn wrap(text: &str, indent: usize) -> String {
    let words = text.trim_start_matches(' ');
    let mut line = " ".repeat(text.len() - words.len());
    let mut used = line.len();
    let mut lines = Vec::new();
    let mut fresh = true;
    for word in words.split(' ') {
        let long = word.chars().count();
        if !fresh && used + 1 + long > WIDTH as usize {
            lines.push(std::mem::replace(&mut line, " ".repeat(indent)));
            used = indent;
            fresh = true;
        }
        if !fresh {
            line.push(' ');
            used += 1;
        }
        line.push_str(word);
        used += long;
        fresh = false;
    }
    lines.push(line);
    lines.join("\n")
}
