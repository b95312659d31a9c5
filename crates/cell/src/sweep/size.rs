//! How large hidden effects have to be, to be seen as well as a case asks.

use super::hidden::{CaseError, Hidden, truths};
use super::signal;
use crate::campaign::{Campaign, Noise};
use crate::effects::{EffectList, find};
use crate::model_file;
use crate::plant::PlantSpec;
use crate::scenario::efficiency::true_values;
use crate::scenario::simulate::{measure, plant_spec};
use crate::scenario::{Scenario, ScenarioError};

/// Where hidden effects are tried out without noise.
pub(super) struct Bench<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) sigma: &'a Noise,
}

impl Bench<'_> {
    pub(super) fn plant(
        &self,
        hidden: &[Hidden],
        sizes: &[f64],
    ) -> Result<PlantSpec, ScenarioError> {
        let scenario = self.scenario;
        let of_plant = |source| scenario.plant_error(source);
        let mut spec = plant_spec(scenario).map_err(of_plant)?;
        for truth in truths(hidden, sizes) {
            let values: Vec<f64> = truth.values.iter().map(|(_, value)| *value).collect();
            let installed = truth.effect.install(&values, &scenario.setup, &mut spec);
            installed.map_err(|source| of_plant(source.into()))?;
        }
        for (hidden, &size) in hidden.iter().zip(sizes) {
            match hidden {
                Hidden::Outside(outside) => {
                    outside.install(size, &scenario.setup.robot, &mut spec);
                }
                Hidden::Effect {
                    twist: Some(twist), ..
                } => twist.install(size, &mut spec),
                Hidden::Effect { .. } => {}
            }
        }
        Ok(spec)
    }

    pub(super) fn silent(
        &self,
        hidden: &[Hidden],
        sizes: &[f64],
    ) -> Result<Campaign, ScenarioError> {
        let spec = self.plant(hidden, sizes)?;
        measure(self.scenario, &spec, &Noise::default(), || {})
    }

    /// λ of each hidden effect at these sizes, given the others.
    pub(super) fn lambdas(&self, hidden: &[Hidden], sizes: &[f64]) -> Result<Vec<f64>, CaseError> {
        if hidden.is_empty() {
            return Ok(Vec::new());
        }
        let all = self.silent(hidden, sizes)?;
        let model = model_file::model(&all, &EffectList::DEFAULT, None)?;
        let mut told = self.scenario.clone();
        told.truth.extend(truths(hidden, sizes));
        let mut found = Vec::new();
        for index in 0..hidden.len() {
            let mut without = sizes.to_vec();
            without[index] = 0.0;
            let rest = self.silent(hidden, &without)?;
            let mut model = model.clone();
            for (other, hidden) in hidden.iter().enumerate() {
                if let (true, Hidden::Effect { effect, .. }) = (other != index, hidden) {
                    model = model.with(effect);
                }
            }
            let values = true_values(&told, &model);
            found.push(signal::lambda(&all, &rest, &model, &values, self.sigma));
        }
        Ok(found)
    }

    /// λ of all hidden effects that the catalogue's laws of the same names do not take up.
    pub(super) fn deviation(&self, hidden: &[Hidden], sizes: &[f64]) -> Result<f64, CaseError> {
        let all = self.silent(hidden, sizes)?;
        let rest = self.silent(hidden, &vec![0.0; sizes.len()])?;
        let mut model = model_file::model(&all, &EffectList::DEFAULT, None)?;
        for hidden in hidden {
            let entry = find(&hidden.name());
            if let Some(usual) = entry.and_then(|entry| entry.make(toml::Table::new()).ok()) {
                model = model.with(&usual);
            }
        }
        let mut told = self.scenario.clone();
        told.truth.extend(truths(hidden, sizes));
        let values = true_values(&told, &model);
        Ok(signal::lambda(&all, &rest, &model, &values, self.sigma))
    }

    /// Sizes at which each hidden effect has the λ wanted of it, given the others; smaller ones where that would be
    /// larger than `most` typical sizes, or than the plant can realise.
    pub(super) fn sizes(
        &self,
        hidden: &[Hidden],
        wanted: &[f64],
        most: f64,
    ) -> Result<Vec<f64>, CaseError> {
        /// Halvings before the plant is believed to have another reason.
        const TRIES: usize = 8;
        let limit: Vec<f64> = hidden
            .iter()
            .map(|hidden| match hidden {
                Hidden::Effect { largest, .. } => most / largest.max(1e-3),
                Hidden::Outside(_) => 10.0 * most,
            })
            .collect();
        let mut sizes = vec![0.3; hidden.len()];
        // λ grows with the square of the size, but for laws with a knee
        for _ in 0..2 {
            let found = self.lambdas(hidden, &sizes)?;
            for (((size, found), wanted), limit) in
                sizes.iter_mut().zip(found).zip(wanted).zip(&limit)
            {
                let ratio = (wanted / found.max(1e-12)).sqrt();
                *size = (*size * ratio).min(*limit);
            }
            for _ in 0..TRIES {
                match self.silent(hidden, &sizes) {
                    Ok(_) => break,
                    Err(ScenarioError::Plant { .. }) => {
                        for size in &mut sizes {
                            *size *= 0.5;
                        }
                    }
                    Err(other) => return Err(other.into()),
                }
            }
        }
        Ok(sizes)
    }
}
