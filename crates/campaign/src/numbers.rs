//! Numbers as people read them: SI prefixes where they help.

/// Three significant digits, without an exponent where that is short.
pub fn number(value: f64) -> String {
    significant(value, 3)
}

/// So many significant digits, without an exponent where that is short.
pub fn significant(value: f64, digits: usize) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    if value.is_nan() {
        return "—".to_owned();
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

/// A length in mm; µm below a hundredth of one, nm below a thousandth of that. Picometres are rounding.
pub fn length(metres: f64) -> String {
    let size = metres.abs();
    if size.is_nan() {
        "—".to_owned()
    } else if size > 0.0 && size < 1e-12 {
        "< 0.001 nm".to_owned()
    } else if size >= 1e-5 || size == 0.0 {
        format!("{} mm", number(metres * 1e3))
    } else if size >= 1e-8 {
        format!("{} µm", number(metres * 1e6))
    } else {
        format!("{} nm", number(metres * 1e9))
    }
}

/// An angle in mrad; µrad below a tenth of one. Picoradians are rounding.
pub fn angle(radians: f64) -> String {
    let size = radians.abs();
    if size.is_nan() {
        "—".to_owned()
    } else if size > 0.0 && size < 1e-12 {
        "< 0.001 nrad".to_owned()
    } else if size >= 1e-4 || size == 0.0 {
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
