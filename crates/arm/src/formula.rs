//! Formulas: from text to steps, from steps to numbers. Algebra only, no robot in it.
//!
//! Numbers, names, `+ - * / ^`, unary minus, parentheses, functions and `pi`. `^` binds tightest and to the right,
//! then unary minus (`-x^2` is `-(x^2)`), then `* /`, then `+ -`. A name is a word, or a word with anything in
//! brackets: `q3`, `q[r1_e]`; what names mean is the caller's business.
//!
//! The steps stand in postfix order, constants folded, so that evaluation needs no recursion and the depth of the
//! parser's own is the only one to be limited.
//!
//! Source: Pratt 1973, *Top down operator precedence*, POPL.

use crate::dual_quaternion::{Scalar, constant};

/// Longest text, bytes.
pub const LONGEST: usize = 1000;
/// Deepest nesting of parentheses, functions, powers and signs.
pub const DEEPEST: usize = 64;

/// A formula as parsed.
#[derive(Debug, Clone, PartialEq)]
pub struct Formula {
    /// What it was parsed from.
    pub text: String,
    /// Its names in the order of their first mention: the order in which evaluation takes their values.
    pub names: Vec<Name>,
    steps: Vec<Step>,
}

/// A name in a formula.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Name {
    /// As written: `q3`, `q[r1_e]`.
    pub text: String,
    /// Byte of its first mention.
    pub at: usize,
}

/// One step of postfix order: operands come before it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Step {
    Number(f64),
    Name(usize),
    Negate,
    Add,
    Subtract,
    Multiply,
    Divide,
    /// To a constant power.
    Power(f64),
    /// To a power that is a step itself: the base must be above zero.
    PowerOf,
    Call(Function),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Function {
    Sin,
    Cos,
    Tan,
    Asin,
    Acos,
    Atan,
    Atan2,
    Sinh,
    Cosh,
    Tanh,
    Exp,
    Ln,
    Sqrt,
    Abs,
    Sign,
    Min,
    Max,
    Pow,
}

const FUNCTIONS: [(&str, usize, Function); 18] = [
    ("sin", 1, Function::Sin),
    ("cos", 1, Function::Cos),
    ("tan", 1, Function::Tan),
    ("asin", 1, Function::Asin),
    ("acos", 1, Function::Acos),
    ("atan", 1, Function::Atan),
    ("atan2", 2, Function::Atan2),
    ("sinh", 1, Function::Sinh),
    ("cosh", 1, Function::Cosh),
    ("tanh", 1, Function::Tanh),
    ("exp", 1, Function::Exp),
    ("ln", 1, Function::Ln),
    ("sqrt", 1, Function::Sqrt),
    ("abs", 1, Function::Abs),
    ("sign", 1, Function::Sign),
    ("min", 2, Function::Min),
    ("max", 2, Function::Max),
    ("pow", 2, Function::Pow),
];

/// Is a word one that a formula understands by itself?
pub fn is_reserved(word: &str) -> bool {
    word == "pi" || word == "log" || FUNCTIONS.iter().any(|(name, ..)| *name == word)
}

/// Is a text one word, and so fit to be a name: a letter or `_`, then letters, digits, `_`?
pub fn is_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_')
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
}

/// What is wrong with a formula, and where; shown with a caret under the place.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FormulaError {
    /// What was found and what is accepted.
    pub message: String,
    /// The formula.
    pub text: String,
    /// Byte that it is about.
    pub at: usize,
}

impl std::error::Error for FormulaError {}

impl std::fmt::Display for FormulaError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        /// Characters shown to either side of the place.
        const SHOWN: usize = 38;
        let start = self.text[..self.at].rfind('\n').map_or(0, |at| at + 1);
        let end = self.text[self.at..].find('\n');
        let end = end.map_or(self.text.len(), |end| self.at + end);
        let tame = |c: char| if c.is_control() { ' ' } else { c };
        let before: Vec<char> = self.text[start..self.at].chars().map(tame).collect();
        let behind: Vec<char> = self.text[self.at..end].chars().map(tame).collect();
        let cut = before.len().saturating_sub(SHOWN);
        let mut line: String = if cut > 0 { "…".into() } else { String::new() };
        line.extend(&before[cut..]);
        let column = line.chars().count();
        line.extend(behind.iter().take(SHOWN));
        if behind.len() > SHOWN {
            line.push('…');
        }
        let line = line.trim_end();
        write!(f, "{}\n    {line}\n    {:column$}^", self.message, "")
    }
}

impl Formula {
    /// Parses a formula.
    ///
    /// # Errors
    /// With the place in the text, what was found there, and what is accepted.
    pub fn parse(text: &str) -> Result<Self, FormulaError> {
        let mut parser = Parser {
            text,
            at: 0,
            depth: 0,
            steps: Vec::new(),
            names: Vec::new(),
        };
        if text.len() > LONGEST {
            let message = format!("{} bytes long; accepted: up to {LONGEST}", text.len());
            return Err(parser.error(0, message));
        }
        parser.expression(0)?;
        if parser.peek().is_some() {
            let found = parser.found();
            let message = format!("{found} where the formula could end; accepted: + - * / ^");
            return Err(parser.error(parser.at, message));
        }
        Ok(Self {
            text: text.to_owned(),
            names: parser.names,
            steps: parser.steps,
        })
    }

    /// An error about a place in this formula.
    pub fn error(&self, at: usize, message: String) -> FormulaError {
        FormulaError {
            message,
            text: self.text.clone(),
            at,
        }
    }

    /// Its value, `values` in the order of its names; not a number where it has none.
    pub fn evaluate<S: Scalar>(&self, values: &[S]) -> S {
        let lost = || constant::<S>(f64::NAN);
        let mut stack: Vec<S> = Vec::with_capacity(8);
        for step in &self.steps {
            let mut pop = || stack.pop().unwrap_or_else(lost);
            let result = match *step {
                Step::Number(number) => constant(number),
                Step::Name(index) => values.get(index).copied().unwrap_or_else(lost),
                Step::Negate => -pop(),
                Step::Power(power) => to_constant(pop(), power),
                Step::Call(function) if function.arguments() == 1 => function.of(pop()),
                Step::Call(function) => {
                    let second = pop();
                    function.of_both(pop(), second)
                }
                Step::Add | Step::Subtract | Step::Multiply | Step::Divide | Step::PowerOf => {
                    let right = pop();
                    let left = pop();
                    match *step {
                        Step::Add => left + right,
                        Step::Subtract => left - right,
                        Step::Multiply => left * right,
                        Step::Divide => left / right,
                        _ => power_of(left, right),
                    }
                }
            };
            stack.push(result);
        }
        stack.pop().unwrap_or_else(lost)
    }

    /// The same for plain numbers by a second path, from the last step back to the first, with the standard
    /// library's functions: what a plant realises is not what a model computes.
    pub fn value(&self, values: &[f64]) -> f64 {
        let mut steps = self.steps.iter().rev();
        value_of(&mut steps, values)
    }
}

/// The value of the last operand that `steps` (backwards) hold; nested as deep as the formula is long at most.
fn value_of<'a>(steps: &mut impl Iterator<Item = &'a Step>, values: &[f64]) -> f64 {
    let Some(step) = steps.next() else {
        return f64::NAN;
    };
    let mut last = || value_of(steps, values);
    match *step {
        Step::Number(number) => number,
        Step::Name(index) => values.get(index).copied().unwrap_or(f64::NAN),
        Step::Negate => -last(),
        Step::Power(power) => match last() {
            // no root of what is below zero, infinite or not
            x if x < 0.0 && power.fract() != 0.0 => f64::NAN,
            x => x.powf(power),
        },
        Step::Call(function) if function.arguments() == 1 => {
            let x = last();
            match function {
                Function::Sin => x.sin(),
                Function::Cos => x.cos(),
                Function::Tan => x.tan(),
                Function::Asin => x.asin(),
                Function::Acos => x.acos(),
                Function::Atan => x.atan(),
                Function::Sinh => x.sinh(),
                Function::Cosh => x.cosh(),
                Function::Tanh => x.tanh(),
                Function::Exp => x.exp(),
                Function::Ln => x.ln(),
                Function::Sqrt => x.sqrt(),
                Function::Abs => x.abs(),
                Function::Sign if x == 0.0 => 0.0,
                Function::Sign => x.signum(),
                Function::Atan2 | Function::Min | Function::Max | Function::Pow => f64::NAN,
            }
        }
        _ => {
            let right = last();
            let left = last();
            match *step {
                Step::Add => left + right,
                Step::Subtract => left - right,
                Step::Multiply => left * right,
                Step::Divide => left / right,
                Step::Call(Function::Atan2) => left.atan2(right),
                // f64's own take the number beside a NaN
                Step::Call(Function::Min | Function::Max) if left.is_nan() || right.is_nan() => {
                    f64::NAN
                }
                Step::Call(Function::Min) => left.min(right),
                Step::Call(Function::Max) => left.max(right),
                // only bases above zero have powers that vary; 1 to the power of infinity has no value, nor to that of no
                // number, nor has infinity to that of zero
                _ if left == 1.0 && !right.is_finite() => f64::NAN,
                _ if left.is_infinite() && right == 0.0 => f64::NAN,
                _ if left > 0.0 => left.powf(right),
                _ => f64::NAN,
            }
        }
    }
}

/// `x` to a constant power; whole ones for any `x`.
fn to_constant<S: Scalar>(x: S, power: f64) -> S {
    // as many as a double tells apart from its neighbours' products
    if power.fract() == 0.0 && power.abs() <= 64.0 {
        let positive = x.powi(power.abs() as i32);
        return if power < 0.0 {
            S::one() / positive
        } else {
            positive
        };
    }
    if power == 0.5 {
        return x.sqrt();
    }
    // exp(power ln 0) has no derivative, but the power above one has: zero
    if x == S::zero() && power > 1.0 {
        return x * S::zero();
    }
    let size = (x.abs().ln() * constant(power)).exp();
    match x < S::zero() {
        false => size,
        true if power.fract() != 0.0 => constant(f64::NAN),
        true if power % 2.0 == 0.0 => size,
        true => -size,
    }
}

impl Function {
    fn arguments(self) -> usize {
        match self {
            Function::Atan2 | Function::Min | Function::Max | Function::Pow => 2,
            _ => 1,
        }
    }

    fn of<S: Scalar>(self, x: S) -> S {
        match self {
            Function::Sin => x.sin(),
            Function::Cos => x.cos(),
            Function::Tan => x.tan(),
            Function::Asin => x.asin(),
            Function::Acos => x.acos(),
            Function::Atan => x.atan(),
            Function::Sinh => x.sinh(),
            Function::Cosh => x.cosh(),
            Function::Tanh => tanh(x),
            Function::Exp => x.exp(),
            Function::Ln => x.ln(),
            Function::Sqrt => x.sqrt(),
            Function::Abs => x.abs(),
            _ => sign(x),
        }
    }

    fn of_both<S: Scalar>(self, a: S, b: S) -> S {
        match self {
            Function::Atan2 => atan2(a, b),
            Function::Min if a < b => a,
            Function::Max if a > b => a,
            Function::Min if b <= a => b,
            Function::Max if b >= a => b,
            Function::Pow => power_of(a, b),
            // one of them is no number
            _ => a + b,
        }
    }
}

/// A power that varies, of a base above zero.
fn power_of<S: Scalar>(base: S, power: S) -> S {
    if base > S::zero() {
        return (base.ln() * power).exp();
    }
    constant(f64::NAN)
}

/// -1, 0 or 1; no number of no number.
fn sign<S: Scalar>(x: S) -> S {
    if x > S::zero() {
        S::one()
    } else if x < S::zero() {
        -S::one()
    } else {
        x * S::zero()
    }
}

/// The quotient of sinh and cosh that dual numbers take overflows from 710 on.
fn tanh<S: Scalar>(x: S) -> S {
    if x.abs() < S::one() {
        return x.tanh();
    }
    let small = (x.abs() * constant(-2.0)).exp();
    sign(x) * (S::one() - small) / (S::one() + small)
}

/// The quotient y/x that dual numbers take has no derivative at x = 0, where the angle has one.
fn atan2<S: Scalar>(y: S, x: S) -> S {
    if y.abs() > x.abs() {
        return sign(y) * S::frac_pi_2() - (x / y).atan();
    }
    y.atan2(x)
}

struct Parser<'a> {
    text: &'a str,
    at: usize,
    depth: usize,
    steps: Vec<Step>,
    names: Vec<Name>,
}

/// How tightly unary minus binds its operand: more than `*`, less than `^`.
const MINUS: u8 = 5;

/// How tightly an operator binds to its left and to its right.
fn binding(operator: char) -> Option<(u8, u8, Step)> {
    match operator {
        '+' => Some((1, 2, Step::Add)),
        '-' => Some((1, 2, Step::Subtract)),
        '*' => Some((3, 4, Step::Multiply)),
        '/' => Some((3, 4, Step::Divide)),
        '^' => Some((8, 7, Step::PowerOf)),
        _ => None,
    }
}

impl Parser<'_> {
    fn error(&self, at: usize, message: String) -> FormulaError {
        FormulaError {
            message,
            text: self.text.to_owned(),
            at,
        }
    }

    /// The next character that is no blank; the parser stands before it.
    fn peek(&mut self) -> Option<char> {
        let rest = &self.text[self.at..];
        self.at += rest.len() - rest.trim_start().len();
        self.text[self.at..].chars().next()
    }

    /// What stands at the place, for messages.
    fn found(&mut self) -> String {
        match self.peek() {
            None => "the end".to_owned(),
            Some(c) if c.is_ascii_alphanumeric() || c == '_' => {
                let rest = &self.text[self.at..];
                let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
                format!("\"{}\"", &rest[..end.unwrap_or(rest.len())])
            }
            Some(c) => format!("\"{}\"", c.escape_debug()),
        }
    }

    /// An operand, and all operators that bind at least as tightly as `least`.
    fn expression(&mut self, least: u8) -> Result<(), FormulaError> {
        self.depth += 1;
        if self.depth > DEEPEST {
            let message = format!("nested too deeply; accepted: up to {DEEPEST} levels");
            return Err(self.error(self.at, message));
        }
        self.operand()?;
        while let Some((left, right, step)) = self.peek().and_then(binding) {
            if left < least {
                break;
            }
            let at = self.at;
            self.at += 1;
            self.expression(right)?;
            self.push(step, at)?;
        }
        self.depth -= 1;
        Ok(())
    }

    fn operand(&mut self) -> Result<(), FormulaError> {
        let first = self.peek();
        let at = self.at;
        match first {
            Some('-') => {
                self.at += 1;
                self.expression(MINUS)?;
                self.push(Step::Negate, at)
            }
            Some('(') => {
                self.at += 1;
                self.expression(0)?;
                self.expect(')', &format!("closes the ( in column {}", self.column(at)))
            }
            Some(c) if c.is_ascii_digit() || c == '.' => self.number(),
            Some(c) if c.is_ascii_alphabetic() || c == '_' => self.word(),
            _ => {
                let found = self.found();
                let message =
                    format!("{found}; accepted here: a number, a name, a function, - or (");
                Err(self.error(at, message))
            }
        }
    }

    /// Column of a place, counted from 1.
    fn column(&self, at: usize) -> usize {
        self.text[..at].chars().count() + 1
    }

    fn expect(&mut self, wanted: char, what: &str) -> Result<(), FormulaError> {
        if self.peek() == Some(wanted) {
            self.at += wanted.len_utf8();
            return Ok(());
        }
        let found = self.found();
        let message = format!("{found} where {wanted} {what}; accepted: {wanted} or + - * / ^");
        Err(self.error(self.at, message))
    }

    fn number(&mut self) -> Result<(), FormulaError> {
        let at = self.at;
        let rest = &self.text.as_bytes()[at..];
        let digit = |k: usize| rest.get(k).is_some_and(u8::is_ascii_digit);
        let mut end = 0;
        while digit(end) || rest.get(end) == Some(&b'.') {
            end += 1;
        }
        if matches!(rest.get(end), Some(b'e' | b'E')) {
            let signed = usize::from(matches!(rest.get(end + 1), Some(b'+' | b'-')));
            if digit(end + 1 + signed) {
                end += 2 + signed;
                while digit(end) {
                    end += 1;
                }
            }
        }
        let text = &self.text[at..at + end];
        let number = text.parse().ok().filter(|x: &f64| x.is_finite());
        let Some(number) = number else {
            let message = format!("{text} is no number; accepted: such as 2, 0.5, 1e-4");
            return Err(self.error(at, message));
        };
        self.at += end;
        if matches!(self.text[self.at..].chars().next(), Some(c) if c.is_ascii_alphabetic() || c == '_')
        {
            let found = self.found();
            let message =
                format!("{found} right behind a number; accepted: an operator between them, as *");
            return Err(self.error(self.at, message));
        }
        self.steps.push(Step::Number(number));
        Ok(())
    }

    /// A name, a constant or a function with its arguments.
    fn word(&mut self) -> Result<(), FormulaError> {
        let at = self.at;
        let rest = &self.text[at..];
        let end = rest.find(|c: char| !(c.is_ascii_alphanumeric() || c == '_'));
        let mut word = &rest[..end.unwrap_or(rest.len())];
        if rest[word.len()..].starts_with('[') {
            let Some(close) = rest.find(']') else {
                let message = "the bracket is not closed; accepted: such as q[a1]".to_owned();
                return Err(self.error(at + word.len(), message));
            };
            word = &rest[..=close];
        }
        self.at += word.len();
        let function = FUNCTIONS.iter().find(|(name, ..)| *name == word);
        let called = self.peek() == Some('(');
        match (function, called) {
            (Some(&(name, count, function)), true) => self.call(at, name, count, function),
            (Some((name, ..)), false) => {
                let message = format!("{name} is a function; accepted: {name}(…)");
                Err(self.error(at, message))
            }
            (None, _) if word == "log" => {
                let message = "log could be either; accepted: ln(x), or ln(x)/ln(10)".to_owned();
                Err(self.error(at, message))
            }
            (None, true) => {
                let known: Vec<&str> = FUNCTIONS.iter().map(|(name, ..)| *name).collect();
                let known = known.join(", ");
                let message = format!(
                    "no function is called \"{word}\"; known: {known} (a product is written {word}*(…))"
                );
                Err(self.error(at, message))
            }
            (None, false) if word == "pi" => {
                self.steps.push(Step::Number(std::f64::consts::PI));
                Ok(())
            }
            (None, false) => {
                let known = self.names.iter().position(|name| name.text == word);
                let index = known.unwrap_or(self.names.len());
                if known.is_none() {
                    let text = word.to_owned();
                    self.names.push(Name { text, at });
                }
                self.steps.push(Step::Name(index));
                Ok(())
            }
        }
    }

    fn call(
        &mut self,
        at: usize,
        name: &str,
        count: usize,
        function: Function,
    ) -> Result<(), FormulaError> {
        self.at += 1;
        let mut found = 0;
        if self.peek() != Some(')') {
            loop {
                self.expression(0)?;
                found += 1;
                if self.peek() != Some(',') {
                    break;
                }
                self.at += 1;
            }
        }
        self.expect(')', &format!("closes {name}("))?;
        if found != count {
            let message = format!(
                "{name} with {found} argument{}; accepted: {count}",
                if found == 1 { "" } else { "s" }
            );
            return Err(self.error(at, message));
        }
        self.push(Step::Call(function), at)
    }

    /// Adds an operation on the operands just pushed; on numbers alone it is done at once.
    fn push(&mut self, step: Step, at: usize) -> Result<(), FormulaError> {
        let power = matches!(step, Step::PowerOf | Step::Call(Function::Pow));
        // an operand that ends with a number is that number
        if power && let Some(&Step::Number(exponent)) = self.steps.last() {
            self.steps.pop();
            return self.push(Step::Power(exponent), at);
        }
        let operands = match step {
            Step::Negate | Step::Power(_) => 1,
            Step::Call(function) => function.arguments(),
            _ => 2,
        };
        self.steps.push(step);
        let first = self.steps.len() - 1 - operands;
        let numbers = self.steps[first..first + operands].iter();
        if numbers.clone().all(|step| matches!(step, Step::Number(_))) {
            let number = value_of(&mut self.steps[first..].iter().rev(), &[]);
            if !number.is_finite() {
                let message = "this has no value; accepted: what is a finite number".to_owned();
                return Err(self.error(at, message));
            }
            self.steps.truncate(first);
            self.steps.push(Step::Number(number));
        }
        Ok(())
    }
}
