//! Numbers and tables as people read them: at most 100 columns, SI prefixes where they help.

use comfy_table::{CellAlignment, ContentArrangement, Table, presets};

/// Columns of the output.
pub const WIDTH: u16 = 100;

/// Three significant digits, without an exponent where that is short.
pub fn number(value: f64) -> String {
    significant(value, 3)
}

/// So many significant digits, without an exponent where that is short.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if !value.is_finite() {
        return value.to_string();
    }
    let exponent = value.abs().log10().floor() as i32;
    if !(-4..=5).contains(&exponent) {
        return format!("{value:.*e}", digits.saturating_sub(1));
    }
    let decimals = (digits as i32 - 1 - exponent).max(0) as usize;
    format!("{value:.decimals$}")
}

/// A length in mm; µm below a hundredth of one, nm below a thousandth of that.
pub fn length(metres: f64) -> String {
    let size = metres.abs();
    if size >= 1e-5 || size == 0.0 {
        format!("{} mm", number(metres * 1e3))
    } else if size >= 1e-8 {
        format!("{} µm", number(metres * 1e6))
    } else {
        format!("{} nm", number(metres * 1e9))
    }
}

/// An angle in mrad; µrad below a tenth of one.
pub fn angle(radians: f64) -> String {
    let size = radians.abs();
    if size >= 1e-4 || size == 0.0 {
        format!("{} mrad", number(radians * 1e3))
    } else if size >= 1e-8 {
        format!("{} µrad", number(radians * 1e6))
    } else {
        format!("{} nrad", number(radians * 1e9))
    }
}

/// A count with its word: `1 reading`, `3 readings`.
pub fn count(n: usize, word: &str) -> String {
    if n == 1 {
        format!("1 {word}")
    } else {
        format!("{n} {word}s")
    }
}

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

/// A table's text without trailing blanks.
pub fn render(table: &Table) -> String {
    let lines: Vec<String> = table
        .lines()
        .map(|line| format!(" {}", line.trim_end()))
        .collect();
    lines.join("\n")
}

/// Breaks a text at blanks into lines of at most [`WIDTH`] columns, continuation lines indented.
pub fn wrap(first: &str, indent: usize) -> String {
    let mut lines = vec![String::new()];
    let mut used = 0;
    for word in first.split(' ') {
        let long = word.chars().count();
        if used + long + 1 > WIDTH as usize && used > indent {
            lines.push(" ".repeat(indent));
            used = indent;
        } else if used > 0 || !lines[lines.len() - 1].is_empty() {
            if let Some(line) = lines.last_mut() {
                line.push(' ');
            }
            used += 1;
        }
        if let Some(line) = lines.last_mut() {
            line.push_str(word);
        }
        used += long;
    }
    lines.join("\n")
}
