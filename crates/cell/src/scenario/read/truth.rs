//! `[[truth]]` of a scenario: values given, presets, random draws.

use crate::effects::table::{Choice, TableError, check_count, unique};
use crate::effects::{Parameter, Role};
use crate::scenario::design::stream;
use crate::scenario::{ScenarioError, Truth, presets};
use crate::setup::Setup;
use crate::space::generator;
use rand::RngExt;
use rand_distr::StandardNormal;
use toml::{Table, Value};

/// The hidden effects with all their parameters: values given, presets, random draws on top.
pub(in crate::scenario) fn truths(
    file: &str,
    tables: Vec<Table>,
    setup: &Setup,
    seed: u64,
) -> Result<Vec<Truth>, ScenarioError> {
    check_count(file, tables.len())?;
    let mut random = generator(seed, stream::TRUTH);
    let mut choices = Vec::new();
    let mut truths = Vec::new();
    for (index, mut table) in tables.into_iter().enumerate() {
        let place = format!("[[truth]] number {}", index + 1);
        let form = |message: String| ScenarioError::form(file, format!("{place}: {message}"));
        let own = OwnKeys::take(&mut table).map_err(form)?;
        let choice = Choice::parse(file, &place, table)?;
        let mut parameters = choice.effect.parameters(setup);
        own.apply_preset(&choice, setup, &mut parameters)
            .map_err(form)?;
        choice.apply(file, setup, &mut parameters)?;
        for parameter in &mut parameters {
            // drawn for every parameter, so that a value given for one does not move the others
            let draw: f64 = random.sample(StandardNormal);
            if !choice
                .values
                .iter()
                .any(|(name, _)| *name == parameter.name)
            {
                parameter.value += own.spread * parameter.typical * draw;
            }
        }
        truths.push(truth(&choice, parameters));
        choices.push(choice);
    }
    unique(file, &choices).map_err(|error: TableError| ScenarioError::Table(error))?;
    Ok(truths)
}

fn truth(choice: &Choice, parameters: Vec<Parameter>) -> Truth {
    Truth {
        effect: choice.effect.clone(),
        values: parameters
            .into_iter()
            .map(|parameter| (parameter.name, parameter.value))
            .collect(),
    }
}

/// What a `[[truth]]` table has beside the keys of an effect.
struct OwnKeys {
    preset: Option<String>,
    exponent: Option<i32>,
    /// Standard deviation of random draws, typical sizes.
    spread: f64,
}

impl OwnKeys {
    fn take(table: &mut Table) -> Result<Self, String> {
        let preset = match table.remove("preset") {
            None => None,
            Some(Value::String(name)) => Some(name),
            Some(other) => {
                return Err(format!("preset is {other}; accepted: {}", presets::NAMES));
            }
        };
        let exponent = table.remove("exponent").map(|value| {
            let exponent = value.as_integer().and_then(|x| i32::try_from(x).ok());
            let exponent = exponent.filter(|x| (0..=9).contains(x));
            exponent.ok_or_else(|| format!("exponent is {value}; accepted: 0 to 9"))
        });
        let spread = table.remove("random").map(|value| {
            let spread = value.as_float().or(value.as_integer().map(|i| i as f64));
            let spread = spread.filter(|x| x.is_finite() && *x >= 0.0);
            spread.ok_or_else(|| {
                format!(
                    "random is {value}; accepted: a standard deviation in typical sizes, 0 or more"
                )
            })
        });
        let own = Self {
            preset,
            exponent: exponent.transpose()?,
            spread: spread.transpose()?.unwrap_or(0.0),
        };
        match table.contains_key("hold") {
            true => Err("a truth is not held; leave hold out".to_owned()),
            false => Ok(own),
        }
    }

    /// Stiffness of the preset as compliances.
    fn apply_preset(
        &self,
        choice: &Choice,
        setup: &Setup,
        parameters: &mut [Parameter],
    ) -> Result<(), String> {
        let Some(name) = &self.preset else {
            return match self.exponent {
                Some(_) => Err("exponent goes with preset = \"paper\"".to_owned()),
                None => Ok(()),
            };
        };
        if choice.effect.role() != Some(Role::Spring) {
            return Err(format!(
                "presets are for {}, not {}",
                Role::Spring.id(),
                choice.effect.id()
            ));
        }
        for (joint, stiffness) in presets::stiffness(name, self.exponent, setup)? {
            let mut parameters = parameters.iter_mut();
            if let Some(parameter) = parameters.find(|p| p.joint() == Some(joint)) {
                parameter.value = 1.0 / stiffness;
            }
        }
        Ok(())
    }
}
