//! The `[blind]` table of a scenario: how many cases of which kind, and what they must show.

use crate::effects::{CATALOGUE, Entry, Role};
use serde::Deserialize;

/// What a sweep must show: shares from 0 to 1, all optional.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Least share named right at λ ≥ 100.
    pub named_from_100: Option<f64>,
    /// Least share named right at λ from 60 to 100.
    pub named_from_60: Option<f64>,
    /// Greatest share of wrong single names among all with one hidden effect.
    pub wrong: Option<f64>,
    /// Greatest share of alarms where nothing is hidden.
    pub alarms: Option<f64>,
    /// Least share of `nothing` at λ < 10.
    pub nothing_below_10: Option<f64>,
    /// Least share of `unknown` with the right contrast, outside the catalogue at λ > 100.
    pub unknown: Option<f64>,
    /// Least share of exact pairs, both λ > 60.
    pub pairs: Option<f64>,
    /// Greatest median of held-out whitened rms over that of the noise after naming.
    pub heldout_ratio: Option<f64>,
    /// Least share of alias sets resolved by the proposed poses where they can be.
    pub resolved: Option<f64>,
    /// Does the right name with the remark that its form may be wrong count as right?
    #[serde(default)]
    pub incomplete_is_right: bool,
}

/// What a sweep draws.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Blind {
    /// Cases with one hidden effect.
    pub one: usize,
    /// Cases without any.
    #[serde(default)]
    pub none: usize,
    /// Cases with two.
    #[serde(default)]
    pub two: usize,
    /// Cases with one that the catalogue does not hold.
    #[serde(default)]
    pub outside: usize,
    /// Effects to draw from; all but frames, geometry and joint compliance if left out.
    pub families: Option<Vec<String>>,
    /// The signal λ of an effect is log-uniform between these.
    #[serde(default = "range")]
    pub lambda: [f64; 2],
    /// The same for effects outside the catalogue and for pairs.
    #[serde(default = "strong")]
    pub strong_lambda: [f64; 2],
    /// Never larger than this, typical sizes.
    #[serde(default = "ten")]
    pub most: f64,
    /// Share of readings that are outliers.
    #[serde(default)]
    pub outliers: f64,
    /// Size of an outlier, standard deviations of its reading.
    #[serde(default = "ten")]
    pub outlier_sigma: f64,
    /// True noise over the noise that the campaign states.
    #[serde(default = "unity")]
    pub noise_factor: f64,
    /// The plant's law differs from the catalogue's.
    #[serde(default)]
    pub wrong_form: bool,
    /// Poses to propose and measure after an alias verdict; none if 0.
    #[serde(default)]
    pub resolve_poses: usize,
    /// What must come out.
    #[serde(default)]
    pub expect: Expected,
}

fn range() -> [f64; 2] {
    [3.0, 3000.0]
}

fn strong() -> [f64; 2] {
    [60.0, 3000.0]
}

fn ten() -> f64 {
    10.0
}

fn unity() -> f64 {
    1.0
}

/// Cases at most.
const MOST_CASES: usize = 1_000_000;

impl Blind {
    /// Refuses what makes no sweep.
    ///
    /// # Errors
    /// What was found, and what is accepted.
    pub fn check(&self) -> Result<(), String> {
        for (name, [low, high]) in [
            ("lambda", self.lambda),
            ("strong_lambda", self.strong_lambda),
        ] {
            if !(low > 0.0 && high >= low && high.is_finite()) {
                return Err(format!(
                    "[blind] {name} = [{low}, {high}]; accepted: two numbers above 0, the larger last"
                ));
            }
        }
        for (name, value, accepted) in [
            ("outliers", self.outliers, 0.0..0.5),
            ("outlier_sigma", self.outlier_sigma, 0.0..1e6),
            ("noise_factor", self.noise_factor, 1e-3..1e3),
            ("most", self.most, 1e-6..1e6),
        ] {
            if !accepted.contains(&value) {
                return Err(format!(
                    "[blind] {name} = {value}; accepted: {} to {}",
                    accepted.start, accepted.end
                ));
            }
        }
        let kinds = [self.one, self.none, self.two, self.outside];
        let cases = kinds.into_iter().fold(0, usize::saturating_add);
        if !(1..=MOST_CASES).contains(&cases) {
            return Err(format!(
                "[blind] one + none + two + outside = {cases}; accepted: 1 to {MOST_CASES}"
            ));
        }
        for name in self.families.iter().flatten() {
            if !hideable().contains(&name.as_str()) {
                return Err(format!(
                    "[blind] families names \"{name}\"; accepted: {}",
                    hideable().join(", ")
                ));
            }
        }
        let families = self.families().len();
        if (self.one > 0 && families == 0) || (self.two > 0 && families < 2) {
            return Err("[blind] families: too few to draw from".to_owned());
        }
        Ok(())
    }

    /// Cases in all.
    pub fn cases(&self) -> usize {
        self.one + self.none + self.two + self.outside
    }

    /// Effects to draw from.
    pub fn families(&self) -> Vec<&'static str> {
        let wanted = |id: &&str| {
            let listed = self.families.as_ref();
            listed.is_none_or(|names| names.iter().any(|name| name == id))
        };
        hideable().into_iter().filter(wanted).collect()
    }
}

fn hideable() -> Vec<&'static str> {
    // what needs options has no form of its own, and what every base model holds is not hidden
    let hides =
        |entry: &&Entry| !entry.role.is_some_and(Role::is_of_base_model) && !entry.needs_options();
    CATALOGUE
        .iter()
        .filter(hides)
        .map(|entry| entry.id)
        .collect()
}
