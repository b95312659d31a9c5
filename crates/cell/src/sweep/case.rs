//! One blind case: who is hidden, how large, and the campaign that shows it.

use super::hidden::{CaseError, Hidden, Twist, truths};
use super::outside::{NAMES, Outside};
use super::signal;
use super::size::Bench;
use crate::campaign::{Campaign, Noise, Split};
use crate::effects::{EffectList, Parameter, Role, find};
use crate::fit::noise;
use crate::model_file::{self};
use crate::plant::PlantSpec;
use crate::scenario::Scenario;
use crate::scenario::blind::Blind;
use crate::scenario::design::{stream, visits};
use crate::scenario::efficiency::true_values;
use crate::scenario::simulate::{PACE, measure};
use crate::space::generator;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// What kind of case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// Nothing is hidden.
    None,
    /// One effect.
    One,
    /// Two effects.
    Two,
    /// One that the catalogue does not hold.
    Outside,
}

impl Class {
    /// Its word in tables.
    pub fn word(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::One => "one",
            Self::Two => "two",
            Self::Outside => "outside",
        }
    }
}

/// A drawn case with its campaign.
#[derive(Clone)]
pub struct Case {
    /// Number.
    pub number: usize,
    /// What kind.
    pub class: Class,
    /// The scenario with the case's seed and all truths that the catalogue can say.
    pub scenario: Scenario,
    /// The plant.
    pub plant: PlantSpec,
    /// Ids of the hidden effects, or the name of one outside the catalogue.
    pub hidden: Vec<String>,
    /// Largest parameter of each, typical sizes (sizes of the law outside the catalogue).
    pub sizes: Vec<f64>,
    /// Signal of each, beside the base model and the other hidden effect.
    pub lambdas: Vec<f64>,
    /// Signal of all hidden effects of another form than the catalogue's that their own laws cannot take up beside the
    /// base model; none where all have the catalogue's.
    pub deviation: Option<f64>,
    /// Contrast in which an effect outside the catalogue shows.
    pub contrast: Option<&'static str>,
    /// Readings for the diagnosis.
    pub campaign: Campaign,
    /// Whitened rms of the held-out readings about their true values.
    pub oracle: Option<f64>,
}

/// The class of a case and its number within it.
fn class(blind: &Blind, number: usize) -> (Class, usize) {
    let mut left = number;
    for (class, count) in [
        (Class::One, blind.one),
        (Class::None, blind.none),
        (Class::Two, blind.two),
    ] {
        if left < count {
            return (class, left);
        }
        left -= count;
    }
    (Class::Outside, left)
}

/// Seed of a case: a golden-ratio step keeps those of neighbouring cases apart.
fn seed(scenario: &Scenario, number: usize) -> u64 {
    let step = (number as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    scenario.seed.wrapping_add(step)
}

/// Draws a case and measures it.
///
/// # Errors
/// If the scenario is no sweep, or its base robot cannot be realised.
pub fn draw(scenario: &Scenario, number: usize) -> Result<Case, CaseError> {
    let Some(blind) = &scenario.blind else {
        return Err(CaseError::NotBlind {
            file: scenario.file.clone(),
        });
    };
    let base = scenario.redrawn(seed(scenario, number))?;
    let mut random = generator(base.seed, stream::SWEEP);
    let (class, place) = class(blind, number);
    let sigma = base.noise.times(blind.noise_factor);
    let hidden = hide(&base, blind, class, place, &mut random)?;
    let [low, high] = match class {
        Class::One => blind.lambda,
        _ => blind.strong_lambda,
    };
    let wanted: Vec<f64> = hidden
        .iter()
        .map(|_| low * (high / low).powf(random.random::<f64>()))
        .collect();
    let bench = Bench {
        scenario: &base,
        sigma: &sigma,
    };
    let sizes = bench.sizes(&hidden, &wanted, blind.most)?;
    let lambdas = bench.lambdas(&hidden, &sizes)?;
    let deviation = match blind.wrong_form {
        true => Some(bench.deviation(&hidden, &sizes)?),
        false => None,
    };
    let plant = bench.plant(&hidden, &sizes)?;
    let campaign = measured(&base, &plant)?;
    let truth = measure(&base, &plant, &Noise::default(), || {})?;
    let oracle = oracle(&base, &campaign, &truth)?;
    let mut told = base.clone();
    told.truth.extend(truths(&hidden, &sizes));
    Ok(Case {
        number,
        class,
        contrast: hidden.iter().find_map(|hidden| match hidden {
            Hidden::Outside(outside) => Some(outside.contrast()),
            Hidden::Effect { .. } => None,
        }),
        hidden: hidden.iter().map(Hidden::name).collect(),
        sizes: hidden
            .iter()
            .zip(&sizes)
            .map(|(hidden, size)| match hidden {
                Hidden::Effect { largest, .. } => largest * size,
                Hidden::Outside(_) => *size,
            })
            .collect(),
        lambdas,
        deviation,
        scenario: told,
        plant,
        campaign,
        oracle,
    })
}

/// Measures the plant of a case with the noise and the outliers that its scenario asks for.
///
/// # Errors
/// If it cannot be.
pub fn measured(scenario: &Scenario, plant: &PlantSpec) -> Result<Campaign, CaseError> {
    let Some(blind) = &scenario.blind else {
        return Err(CaseError::NotBlind {
            file: scenario.file.clone(),
        });
    };
    let sigma = scenario.noise.times(blind.noise_factor);
    let mut campaign = measure(scenario, plant, &sigma, || {})?;
    spoil(&mut campaign, blind, &sigma, scenario.seed);
    Ok(campaign)
}

impl Hidden {
    pub(super) fn name(&self) -> String {
        match self {
            Self::Effect { effect, .. } => effect.id().to_owned(),
            Self::Outside(outside) => outside.name().to_owned(),
        }
    }
}

/// Draws what is hidden.
fn hide(
    base: &Scenario,
    blind: &Blind,
    class: Class,
    place: usize,
    random: &mut impl Rng,
) -> Result<Vec<Hidden>, CaseError> {
    let families = blind.families();
    let effect = |id: &'static str, random: &mut _| drawn(base, blind, id, random);
    Ok(match class {
        Class::None => Vec::new(),
        // each family in its turn
        Class::One => vec![effect(families[place % families.len()], random)?],
        Class::Two => {
            let first = random.random_range(0..families.len());
            let other = random.random_range(1..families.len());
            let second = (first + other) % families.len();
            vec![
                effect(families[first], random)?,
                effect(families[second], random)?,
            ]
        }
        Class::Outside => {
            let postures: Vec<Vec<f64>> = visits(base)?
                .into_iter()
                .filter(|visit| visit.pose + base.design.heldout < base.design.poses)
                .map(|visit| visit.joints)
                .collect();
            vec![Hidden::Outside(Outside::draw(
                place % NAMES.len(),
                &base.setup,
                &postures,
                random,
            ))]
        }
    })
}

/// An effect with random parameters: all of them in half of the cases, else those of one joint (or one alone).
fn drawn(
    base: &Scenario,
    blind: &Blind,
    id: &'static str,
    random: &mut impl Rng,
) -> Result<Hidden, CaseError> {
    let entry = find(id);
    let role = entry.and_then(|entry| entry.role);
    let mut options = toml::Table::new();
    let stretch: f64 = random.random_range(-1.0..1.0);
    if blind.wrong_form && role == Some(Role::Hardening) {
        // every joint's knee, 0.4 to 2.5 times its usual one; the catalogue keeps its own
        let factor = 2.5f64.powf(stretch);
        options.insert("knee_factor".to_owned(), factor.into());
    }
    let Some(effect) = entry.and_then(|entry| entry.make(options).ok()) else {
        unreachable!("families are in the catalogue, and need no options")
    };
    let parameters = effect.parameters(&base.setup);
    let alone = random.random::<bool>();
    let chosen = parameters.get(random.random_range(0..parameters.len().max(1)));
    let beside = |parameter: &Parameter| {
        chosen.is_some_and(|chosen| parameter == chosen || parameter.shares_place_with(chosen))
    };
    let mut largest = 0.0f64;
    let values: Vec<(String, f64)> = parameters
        .iter()
        .map(|parameter| {
            let draw: f64 = random.sample(StandardNormal);
            let taken = !alone || beside(parameter);
            let draw = match (taken, parameter.lower >= 0.0) {
                (false, _) => 0.0,
                (true, true) => draw.abs(),
                (true, false) => draw,
            };
            largest = largest.max(draw.abs());
            (parameter.name.clone(), draw * parameter.typical)
        })
        .collect();
    let twist = match blind.wrong_form {
        true => twist(base, &parameters, &values, random)?,
        false => None,
    };
    Ok(Hidden::Effect {
        effect,
        values,
        largest,
        twist,
    })
}

/// How the plant's law differs, for the effects that have such a form.
fn twist(
    base: &Scenario,
    parameters: &[Parameter],
    values: &[(String, f64)],
    random: &mut impl Rng,
) -> Result<Option<Twist>, CaseError> {
    let role = parameters.first().and_then(|parameter| parameter.role);
    Ok(match role {
        Some(Role::Transmission) => {
            let mut of: Vec<(usize, f64)> = Vec::new();
            for (parameter, (_, value)) in parameters.iter().zip(values) {
                let Some(joint) = parameter.joint() else {
                    continue;
                };
                match of.last_mut() {
                    Some((last, size)) if *last == joint => *size += 0.15 * value.abs(),
                    _ => of.push((joint, 0.15 * value.abs())),
                }
            }
            Some(Twist::ThirdHarmonic(of))
        }
        Some(Role::Drift) => {
            let length = PACE * visits(base)?.len().saturating_sub(1) as f64;
            // at the end it has 0.6 to 0.08 of the rate that it begins with
            let constant = length / random.random_range(0.5..2.5);
            Some(Twist::SlowsDown {
                start: -length / 2.0,
                constant,
            })
        }
        Some(Role::Thermal) => {
            let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
            Some(Twist::Bent(sign * random.random_range(0.02..0.05)))
        }
        _ => None,
    })
}

/// Makes outliers of some fitted readings: position and orientation, so many standard deviations away in a random
/// direction.
fn spoil(campaign: &mut Campaign, blind: &Blind, sigma: &Noise, seed: u64) {
    let mut random = generator(seed, stream::OUTLIERS);
    for reading in &mut campaign.readings {
        let hit = random.random::<f64>() < blind.outliers;
        let mut away = |size: f64| {
            let draw = nalgebra::Vector3::from_fn(|_, _| random.sample(StandardNormal));
            draw.try_normalize(1e-9).unwrap_or_default() * size
        };
        let distance = reading.position.norm();
        let position =
            away(blind.outlier_sigma * (sigma.position + sigma.position_per_metre * distance));
        let turn = away(blind.outlier_sigma * sigma.orientation);
        if hit && reading.split == Split::Fit {
            reading.position += position;
            if let Some(orientation) = &mut reading.orientation {
                *orientation = nalgebra::UnitQuaternion::from_scaled_axis(turn) * *orientation;
            }
        }
    }
}

/// Whitened rms of the held-out readings about what they would be without noise.
fn oracle(
    scenario: &Scenario,
    campaign: &Campaign,
    truth: &Campaign,
) -> Result<Option<f64>, CaseError> {
    let seen = signal::readings(campaign, Split::Heldout);
    let exact = signal::readings(truth, Split::Heldout);
    if seen.is_empty() {
        return Ok(None);
    }
    let model = model_file::model(campaign, &EffectList::DEFAULT, None)?;
    let values = true_values(scenario, &model);
    let stated = campaign.noise.unwrap_or(scenario.noise);
    let whiteners = noise::whiteners(&model, &values, &seen, &stated);
    let seen = crate::fit::residuals(&model, &values, &seen);
    let exact = crate::fit::residuals(&model, &values, &exact);
    let rows: usize = whiteners.iter().map(|w| w.rows).sum();
    let squares: f64 = seen
        .iter()
        .zip(&exact)
        .zip(&whiteners)
        .map(|((seen, exact), whitener)| whitener.squares(&(seen - exact)))
        .sum();
    Ok(Some((squares / rows.max(1) as f64).sqrt()))
}
