//! Formulas against trees evaluated here, against differences, and against arbitrary text.

use misfit_arm::formula::{DEEPEST, Formula, LONGEST};
use misfit_core::effects::{Dual, rates, seeded};
use proptest::prelude::*;

fn value(text: &str) -> f64 {
    let formula = Formula::parse(text).unwrap_or_else(|error| panic!("{text}: {error}"));
    assert!(formula.names.is_empty(), "{text}");
    let (one, other) = (formula.evaluate::<f64>(&[]), formula.value(&[]));
    assert_eq!(one, other, "{text}");
    one
}

#[test]
fn rules_of_arithmetic() {
    // by hand
    let cases = [
        ("1 + 2*3", 7.0),
        ("(1 + 2)*3", 9.0),
        ("8 - 3 - 2", 3.0),
        ("8/4/2", 1.0),
        ("2^3^2", 512.0),
        ("-2^2", -4.0),
        ("(-2)^2", 4.0),
        ("2^-1", 0.5),
        ("2^-2*3", 0.75),
        ("- -2", 2.0),
        ("--2 - -3", 5.0),
        ("2 * -3", -6.0),
        ("2*-3^2", -18.0),
        ("1e-4*1E4", 1.0),
        (".5 + 5.", 5.5),
        ("pi/pi", 1.0),
        ("sin(pi/6)*2", 2.0 * (std::f64::consts::PI / 6.0).sin()),
        ("atan2(1, -1)*4/pi", 3.0),
        ("min(3, max(1, 2))", 2.0),
        ("pow(2, 10) - 2^10", 0.0),
        ("ln(exp(3))", 3.0),
        ("sign(-7) + sign(0) + sign(2)*10", 9.0),
        ("abs(-3) - sqrt(16)", -1.0),
        (" \t( 1\n+ 1 ) ", 2.0),
    ];
    for (text, expected) in cases {
        let found = value(text);
        assert!((found - expected).abs() < 1e-14, "{text} = {found}");
    }
}

#[test]
fn names_are_words_or_words_with_brackets() {
    let formula = Formula::parse("b + q[r1 e-2]*q3 - b/_x9").unwrap();
    let names: Vec<(&str, usize)> = formula
        .names
        .iter()
        .map(|name| (name.text.as_str(), name.at))
        .collect();
    assert_eq!(
        names,
        [("b", 0), ("q[r1 e-2]", 4), ("q3", 14), ("_x9", 21)],
        "in the order of their first mention, each once"
    );
    assert_eq!(formula.value(&[1.0, 2.0, 3.0, 4.0]), 6.75);
}

/// The message, and the character that its caret stands under.
#[track_caller]
fn refused(text: &str) -> (String, Option<char>) {
    let error = Formula::parse(text).expect_err(text);
    let shown = error.to_string();
    let lines: Vec<&str> = shown.lines().collect();
    let [message, line, caret] = lines[..] else {
        panic!("{shown}")
    };
    assert!(line.chars().count() <= 100, "{shown}");
    let column = caret.chars().position(|c| c == '^').unwrap();
    (message.to_owned(), line.chars().nth(column))
}

#[test]
fn errors_point_at_the_place() {
    let cases = [
        ("", "the end; accepted here: a number", None),
        ("   ", "the end", None),
        ("1 +", "the end", None),
        ("a b", "\"b\" where the formula could end", Some('b')),
        ("a 2", "\"2\" where the formula could end", Some('2')),
        ("2q3", "\"q3\" right behind a number", Some('q')),
        ("a*(b + 2", "where ) closes the ( in column 3", None),
        ("a)", "\")\" where the formula could end", Some(')')),
        ("a + * b", "\"*\"; accepted here", Some('*')),
        ("a − b", "\"−\" where the formula could end", Some('−')),
        ("ä", "\"ä\"; accepted here", Some('ä')),
        ("1.2.3", "1.2.3 is no number", Some('1')),
        ("1e999", "1e999 is no number", Some('1')),
        ("1e + 2", "\"e\" right behind a number", Some('e')),
        (". + 1", ". is no number", Some('.')),
        (
            "1 + sine(q3)",
            "no function is called \"sine\"; known: sin, cos",
            Some('s'),
        ),
        ("1 + a(q3)", "a product is written a*(…)", Some('a')),
        ("1 + sin", "sin is a function", Some('s')),
        ("2*log(q3)", "accepted: ln(x)", Some('l')),
        (
            "1 + atan2(a)",
            "atan2 with 1 argument; accepted: 2",
            Some('a'),
        ),
        (
            "1 + sin(a, b)",
            "sin with 2 arguments; accepted: 1",
            Some('s'),
        ),
        ("1 + sin()", "sin with 0 arguments; accepted: 1", Some('s')),
        ("1 + sin(a", "where ) closes sin(", None),
        ("min(a, )", "\")\"; accepted here", Some(')')),
        ("q[r1", "the bracket is not closed", Some('[')),
        ("a*(1/0)", "this has no value", Some('/')),
        ("a + ln(-1)", "this has no value", Some('l')),
        ("a + 0^-1", "this has no value", Some('^')),
        ("a\u{0}b", "\"\\0\" where", Some('b')),
    ];
    for (text, part, at) in cases {
        let (message, found) = refused(text);
        assert!(message.contains(part), "{text:?}: {message}");
        // a control character is shown as a blank
        if !text.contains('\u{0}') {
            assert_eq!(found, at, "{text:?}: {message}");
        }
    }
    // in a long formula the place is still in sight
    let long = format!("{}$ + {}", "a + ".repeat(60), "a + ".repeat(60));
    assert_eq!(refused(&long).1, Some('$'));
    // and of many lines its own is shown
    assert_eq!(refused("a +\n  b +\n  ? +\n c").1, Some('?'));
}

#[test]
fn too_long_and_too_deep_are_refused_not_a_crash() {
    let fits = "a+".repeat(LONGEST / 2 - 1) + "a";
    assert_eq!(Formula::parse(&fits).unwrap().value(&[1.0]), 500.0);
    let (message, _) = refused(&("a+".repeat(LONGEST) + "a"));
    assert!(
        message.contains("2001 bytes long; accepted: up to 1000"),
        "{message}"
    );
    let nested = |n: usize| "(".repeat(n) + "a" + &")".repeat(n);
    assert_eq!(
        Formula::parse(&nested(DEEPEST - 1)).unwrap().value(&[2.0]),
        2.0
    );
    let deep = [
        nested(DEEPEST),
        "-".repeat(900) + "a",
        "a^".repeat(400) + "a",
        "(".repeat(999),
        "sin(".repeat(200),
    ];
    for text in deep {
        let (message, _) = refused(&text);
        assert!(message.contains("nested too deeply"), "{message}");
    }
}

/// A formula as this test has it.
#[derive(Debug, Clone)]
enum Tree {
    Number(f64),
    Name(usize),
    Minus(Box<Tree>),
    Binary(char, Box<Tree>, Box<Tree>),
    Power(Box<Tree>, f64),
    Call(&'static str, Vec<Tree>),
}

const NAMES: [&str; 3] = ["a", "q3", "tau[r1_e]"];

impl Tree {
    /// With as few parentheses as the rules allow.
    fn print(&self, least: u8) -> String {
        let (binds, text) = match self {
            Tree::Number(x) => (9, format!("{x:?}")),
            Tree::Name(index) => (9, NAMES[*index].to_owned()),
            Tree::Minus(x) => (5, format!("-{}", x.print(5))),
            Tree::Binary(operator, x, y) => {
                let (left, right) = match operator {
                    '+' | '-' => (1, 2),
                    '*' | '/' => (3, 4),
                    _ => (8, 7),
                };
                let text = format!("{} {operator} {}", x.print(left), y.print(right));
                (left, text)
            }
            Tree::Power(x, power) => (8, format!("{}^{power:?}", x.print(9))),
            Tree::Call(name, list) => {
                let list: Vec<String> = list.iter().map(|x| x.print(0)).collect();
                (9, format!("{name}({})", list.join(", ")))
            }
        };
        // a base is put into parentheses unless it is a single thing
        if binds < least || (least == 8 && binds < 9) {
            format!("({text})")
        } else {
            text
        }
    }

    fn value(&self, values: &[f64]) -> f64 {
        match self {
            Tree::Number(x) => *x,
            Tree::Name(index) => values[*index],
            Tree::Minus(x) => -x.value(values),
            Tree::Binary(operator, x, y) => {
                let (x, y) = (x.value(values), y.value(values));
                match operator {
                    '+' => x + y,
                    '-' => x - y,
                    '*' => x * y,
                    '/' => x / y,
                    _ if x > 0.0 => x.powf(y),
                    _ => f64::NAN,
                }
            }
            Tree::Power(x, power) => x.value(values).powf(*power),
            Tree::Call(name, list) => {
                let x = list[0].value(values);
                let y = list.get(1).map_or(0.0, |y| y.value(values));
                match *name {
                    "sin" => x.sin(),
                    "cos" => x.cos(),
                    "tan" => x.tan(),
                    "asin" => x.asin(),
                    "acos" => x.acos(),
                    "atan" => x.atan(),
                    "sinh" => x.sinh(),
                    "cosh" => x.cosh(),
                    "tanh" => x.tanh(),
                    "exp" => x.exp(),
                    "ln" => x.ln(),
                    "sqrt" => x.sqrt(),
                    "abs" => x.abs(),
                    "sign" if x == 0.0 => 0.0,
                    "sign" => x.signum(),
                    "atan2" => x.atan2(y),
                    "min" if x.is_nan() || y.is_nan() => f64::NAN,
                    "max" if x.is_nan() || y.is_nan() => f64::NAN,
                    "min" => x.min(y),
                    "max" => x.max(y),
                    _ => unreachable!("{name}"),
                }
            }
        }
    }

    /// Names and values without a number in between would be folded, or refused where they have no value.
    fn is_constant(&self) -> bool {
        match self {
            Tree::Number(_) => true,
            Tree::Name(_) => false,
            Tree::Minus(x) | Tree::Power(x, _) => x.is_constant(),
            Tree::Binary(_, x, y) => x.is_constant() && y.is_constant(),
            Tree::Call(_, list) => list.iter().all(Tree::is_constant),
        }
    }

    /// Does any part of constants alone have no value?
    fn is_refused(&self) -> bool {
        let parts: Vec<&Tree> = match self {
            Tree::Number(_) | Tree::Name(_) => Vec::new(),
            Tree::Minus(x) | Tree::Power(x, _) => vec![x],
            Tree::Binary(_, x, y) => vec![x, y],
            Tree::Call(_, list) => list.iter().collect(),
        };
        let lost = self.is_constant() && !self.value(&[]).is_finite();
        lost || parts.into_iter().any(Tree::is_refused)
    }
}

fn tree() -> impl Strategy<Value = Tree> {
    let leaf = prop_oneof![
        (0.0..10.0f64).prop_map(Tree::Number),
        (0..NAMES.len()).prop_map(Tree::Name),
        (0..NAMES.len()).prop_map(Tree::Name),
    ];
    leaf.prop_recursive(5, 24, 2, |inner| {
        let one = prop::sample::select(vec![
            "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "ln",
            "sqrt", "abs", "sign",
        ]);
        let two = prop::sample::select(vec!["atan2", "min", "max"]);
        let operator = prop::sample::select(vec!['+', '-', '*', '/']);
        let power = prop::sample::select(vec![-2.0, -1.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0]);
        prop_oneof![
            inner.clone().prop_map(|x| Tree::Minus(Box::new(x))),
            (operator, inner.clone(), inner.clone()).prop_map(|(o, x, y)| Tree::Binary(
                o,
                Box::new(x),
                Box::new(y)
            )),
            (inner.clone(), power).prop_map(|(x, power)| Tree::Power(Box::new(x), power)),
            (inner.clone(), 0..NAMES.len()).prop_map(|(x, k)| Tree::Binary(
                '^',
                Box::new(x),
                Box::new(Tree::Name(k))
            )),
            (one, inner.clone()).prop_map(|(name, x)| Tree::Call(name, vec![x])),
            (two, inner.clone(), inner).prop_map(|(name, x, y)| Tree::Call(name, vec![x, y])),
        ]
    })
}

/// The formula of a tree, and the values of its names in the formula's order.
fn parsed(tree: &Tree, values: &[f64]) -> Option<(Formula, Vec<f64>)> {
    let text = tree.print(0);
    let formula = match Formula::parse(&text) {
        Ok(formula) => formula,
        Err(error) => {
            assert!(
                tree.is_refused() || text.len() > LONGEST,
                "{text}: {error}\n{tree:?}"
            );
            return None;
        }
    };
    assert!(!tree.is_refused(), "{text} has no value");
    let of = |name: &str| NAMES.iter().position(|known| *known == name).unwrap();
    let values = formula.names.iter().map(|name| values[of(&name.text)]);
    let values = values.collect();
    Some((formula, values))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn what_is_printed_is_parsed_and_has_the_value_of_its_tree(
        tree in tree(),
        values in prop::array::uniform3(-3.0..3.0f64),
    ) {
        let Some((formula, values)) = parsed(&tree, &values).map(|(f, v)| (f, (v, values))) else {
            return Ok(());
        };
        let expected = tree.value(&values.1);
        // the plain path does the same operations in the same order
        let plain = formula.value(&values.0);
        prop_assert!(
            plain == expected || plain.is_nan() && expected.is_nan(),
            "{}: {plain} for {expected}", formula.text
        );
        // the path of the dual numbers rounds its powers, tanh and atan2 otherwise
        let other = formula.evaluate::<f64>(&values.0);
        if expected.is_finite() && is_tame(&tree, &values.1) {
            prop_assert!(
                (other - expected).abs() <= 1e-9 * (1.0 + expected.abs()),
                "{}: {other} for {expected}", formula.text
            );
        }
    }

    #[test]
    fn slopes_are_those_of_differences(
        tree in tree(),
        values in prop::array::uniform3(-3.0..3.0f64),
    ) {
        let Some((formula, values)) = parsed(&tree, &values).map(|(f, v)| (f, (v, values))) else {
            return Ok(());
        };
        if !is_tame(&tree, &values.1) {
            return Ok(());
        }
        let values = values.0;
        let duals: Vec<Dual> = values.iter().enumerate().map(|(k, &x)| seeded(x, k)).collect();
        let found = formula.evaluate(&duals);
        for k in 0..values.len() {
            let at = |h: f64| {
                let mut moved = values.clone();
                moved[k] += h;
                formula.value(&moved)
            };
            let difference = |h: f64| ((at(h) - at(-h)) * 8.0 - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
            let (coarse, fine) = (difference(2e-4), difference(1e-4));
            // where differences of two widths disagree there is a kink, a pole, or only rounding
            let scale = 1.0 + fine.abs();
            if !fine.is_finite() || (coarse - fine).abs() > 1e-7 * scale || at(0.0).abs() > 1e3 {
                continue;
            }
            let slope = rates(&found).map_or(0.0, |rates| rates[k]);
            prop_assert!(
                (slope - fine).abs() < 1e-5 * scale,
                "{}: slope {k} is {slope}, differences say {fine}", formula.text
            );
        }
    }

    #[test]
    fn no_text_crashes_the_parser(text in "\\PC{0,60}") {
        let _ = Formula::parse(&text).map(|formula| formula.value(&[0.5; 64]));
    }

    #[test]
    fn no_pieces_of_formulas_crash_the_parser(
        pieces in prop::collection::vec(
            prop::sample::select(vec![
                "(", ")", "+", "-", "*", "/", "^", ",", "1", "2.5", "1e", ".", "e5", "a", "q3", "q[", "]",
                "sin", "atan2(", "min(", "pi", " ", "é", "\n", "\0", "log", "[",
            ]),
            0..40,
        ),
    ) {
        let text = pieces.concat();
        match Formula::parse(&text) {
            Ok(formula) => {
                let values = vec![0.5; formula.names.len()];
                let (one, other) = (formula.evaluate::<f64>(&values), formula.value(&values));
                prop_assert!(one.is_finite() == other.is_finite(), "{text}: {one}, {other}");
            }
            Err(error) => prop_assert!(error.to_string().contains('^')),
        }
    }
}

/// Are all parts of moderate size, and away from where a function jumps or has a pole? There two ways of rounding need
/// not agree.
fn is_tame(tree: &Tree, values: &[f64]) -> bool {
    let size = tree.value(values).abs();
    if !(size < 1e4 && (size > 1e-3 || matches!(tree, Tree::Number(_) | Tree::Name(_)))) {
        return false;
    }
    match tree {
        Tree::Number(_) | Tree::Name(_) => true,
        Tree::Minus(x) | Tree::Power(x, _) => is_tame(x, values),
        Tree::Binary(_, x, y) => is_tame(x, values) && is_tame(y, values),
        Tree::Call(name, list) => {
            let x = list[0].value(values);
            let y = list.get(1).map_or(1.0, |y| y.value(values));
            let kink = match *name {
                "asin" | "acos" => (1.0 - x.abs()) < 1e-3,
                "tan" => x.cos().abs() < 1e-2,
                "atan2" => x.abs() < 1e-3 && y < 0.0,
                "min" | "max" => (x - y).abs() < 1e-3,
                "sin" | "cos" => x.abs() > 1e3,
                _ => false,
            };
            !kink && list.iter().all(|x| is_tame(x, values))
        }
    }
}

#[test]
fn slopes_hold_where_dual_numbers_have_traps() {
    // closed forms: d tanh = 1 - tanh², d atan2(y, x) = (x dy - y dx)/(x² + y²), d|x| = sign
    let slope = |text: &str, at: &[f64], k: usize| {
        let formula = Formula::parse(text).unwrap();
        let duals: Vec<Dual> = at.iter().enumerate().map(|(k, &x)| seeded(x, k)).collect();
        let found = formula.evaluate(&duals);
        (found.re, rates(&found).unwrap()[k])
    };
    assert_eq!(slope("tanh(x)", &[800.0], 0), (1.0, 0.0));
    assert_eq!(slope("tanh(x)", &[-800.0], 0), (-1.0, 0.0));
    let (value, rate) = slope("tanh(x)", &[2.0], 0);
    assert!((value - 2f64.tanh()).abs() < 1e-15);
    assert!((rate - (1.0 - 2f64.tanh().powi(2))).abs() < 1e-15);
    for (y, x) in [
        (2.0, 0.0),
        (-2.0, 0.0),
        (0.0, -2.0),
        (1.0, -3.0),
        (-3.0, -1.0),
    ] {
        let square: f64 = x * x + y * y;
        let (value, by_y) = slope("atan2(y, x)", &[y, x], 0);
        let (_, by_x) = slope("atan2(y, x)", &[y, x], 1);
        assert!((value - f64::atan2(y, x)).abs() < 1e-15, "{y} {x}");
        assert!((by_y - x / square).abs() < 1e-15, "{y} {x}: {by_y}");
        assert!((by_x + y / square).abs() < 1e-15, "{y} {x}: {by_x}");
    }
    assert_eq!(slope("x^2", &[0.0], 0), (0.0, 0.0));
    assert_eq!(slope("x^1.5", &[0.0], 0), (0.0, 0.0));
    assert_eq!(slope("x^3", &[-2.0], 0), (-8.0, 12.0));
    assert_eq!(slope("x^-1", &[-2.0], 0), (-0.5, -0.25));
    assert_eq!(slope("abs(x)", &[-2.0], 0), (2.0, -1.0));
    // what is no number stays none
    for text in ["min(x, 1)", "max(1, x)", "sign(x)", "abs(x)", "x^2", "x*0"] {
        let formula = Formula::parse(text).unwrap();
        assert!(formula.evaluate(&[f64::NAN]).is_nan(), "{text}");
        assert!(formula.value(&[f64::NAN]).is_nan(), "{text}");
    }
}
