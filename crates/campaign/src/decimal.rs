//! Numbers as people write them: with a point or a comma for decimals, and nothing between thousands.

/// The number, if it is one with this sign of decimals.
pub(super) fn parse(text: &str, decimal: char) -> Option<f64> {
    match decimal {
        '.' => text.parse().ok(),
        // a point beside a decimal comma would be one between thousands: 1.234 is 1234 to its writer
        _ if text.contains('.') => None,
        _ => text.replacen(decimal, ".", 1).parse().ok(),
    }
}

/// What would be read instead of a cell that is no number.
pub(super) fn accepted(text: &str, decimal: char) -> &'static str {
    let grouped = text.chars().any(|c| c.is_ascii_digit())
        && text
            .chars()
            .all(|c| c.is_ascii_digit() || " \u{a0}\u{202f}'’.,+-".contains(c));
    match (grouped, decimal) {
        (true, '.') => {
            "a finite number, with a point for decimals and nothing between thousands (`decimal = \",\"` under \
             [table] reads decimal commas)"
        }
        (true, _) => "a finite number, with a comma for decimals and nothing between thousands",
        (false, '.') => "a finite number, with a point for decimals",
        (false, _) => "a finite number, with a comma for decimals",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thousands_are_never_guessed() {
        for (text, decimal, number) in [
            ("1.5", '.', Some(1.5)),
            ("1,5", ',', Some(1.5)),
            ("-1,5e-3", ',', Some(-1.5e-3)),
            ("12", ',', Some(12.0)),
            ("1.234", ',', None),
            ("1.234,5", ',', None),
            ("1,234.5", '.', None),
            ("1,234", '.', None),
            ("1,234,5", ',', None),
            ("1 234,5", ',', None),
            ("1'234.5", '.', None),
            ("1\u{a0}234.5", '.', None),
        ] {
            assert_eq!(parse(text, decimal), number, "{text}");
            if number.is_none() {
                assert!(accepted(text, decimal).contains("thousands"), "{text}");
            }
        }
        assert!(!accepted("n/a", '.').contains("thousands"));
    }
}
