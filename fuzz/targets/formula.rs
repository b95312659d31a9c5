//! A formula. What is parsed has the same value by both ways of evaluation, or none by both.
#![no_main]

use libfuzzer_sys::fuzz_target;
use misfit_arm::formula::Formula;
use misfit_fuzz::refused;

fuzz_target!(|text: &str| {
    match Formula::parse(text) {
        Err(error) => refused(&error),
        Ok(formula) => {
            let values: Vec<f64> = (0..formula.names.len())
                .map(|k| 0.3 + 0.7 * k as f64)
                .collect();
            let (one, other) = (formula.evaluate(&values), formula.value(&values));
            assert_eq!(one.is_nan(), other.is_nan(), "{one} and {other}");
        }
    }
});
