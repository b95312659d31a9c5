//! What a process pulls with, over time.

use nalgebra::Vector3;
use serde::Deserialize;
use std::f64::consts::TAU;

/// `[[loop.pull]]`: a force at a point of the target's link.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
#[allow(non_snake_case)] // the keys carry their units
pub struct Pull {
    /// How it goes over time.
    pub shape: Shape,
    /// Its full size, base frame, N.
    pub force_N: [f64; 3],
    /// Where it pulls, in the target link's frame, m: off the link's origin it turns the wrist, too.
    #[serde(default)]
    pub at_m: [f64; 3],
    /// When it begins, s.
    #[serde(default)]
    pub at_s: f64,
    /// How long a ramp rises, s.
    pub over_s: Option<f64>,
    /// Of a sine, Hz.
    pub frequency_hz: Option<f64>,
    /// When it ends, s; never if left out.
    pub until_s: Option<f64>,
}

/// How a pull goes over time, as a share of its full size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// All of it from its beginning.
    Step,
    /// Rises evenly, then stays.
    Ramp,
    /// Swings about zero, from zero.
    Sine,
}

impl Pull {
    /// The force at a time from the start of the loop (s), base frame, N.
    pub fn at(&self, time: f64) -> Vector3<f64> {
        let since = time - self.at_s;
        let ended = self.until_s.is_some_and(|end| time >= end);
        let share = match self.shape {
            _ if since < 0.0 || ended => 0.0,
            Shape::Step => 1.0,
            Shape::Ramp => self.over_s.map_or(1.0, |over| (since / over).min(1.0)),
            Shape::Sine => (TAU * self.frequency_hz.unwrap_or(0.0) * since).sin(),
        };
        Vector3::from(self.force_N) * share
    }

    /// Refuses numbers and keys that make no sense for its shape.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn check(&self) -> Result<(), String> {
        let wrong = |what: String| Err(format!("[[loop.pull]] {what}"));
        let vectors = [("force_N", self.force_N), ("at_m", self.at_m)];
        for (key, vector) in vectors {
            if vector.iter().any(|x| !x.is_finite()) {
                return wrong(format!("{key} is {vector:?}; accepted: finite numbers"));
            }
        }
        if !(self.at_s >= 0.0 && self.at_s.is_finite()) {
            return wrong(format!("at_s is {}; accepted: 0 or more", self.at_s));
        }
        if let Some(end) = self.until_s.filter(|end| end.is_nan() || *end <= self.at_s) {
            return wrong(format!("until_s is {end}; accepted: later than at_s"));
        }
        let shape = self.shape;
        for (key, value, of) in [
            ("over_s", self.over_s, Shape::Ramp),
            ("frequency_hz", self.frequency_hz, Shape::Sine),
        ] {
            match value {
                Some(_) if shape != of => {
                    return wrong(format!(
                        "{key} is of another shape ({of:?}); leave it out of this one ({shape:?})"
                    ));
                }
                Some(value) if !(value > 0.0 && value.is_finite()) => {
                    return wrong(format!("{key} is {value}; accepted: above 0"));
                }
                None if shape == of => {
                    return wrong(format!("{key} is missing; accepted: above 0"));
                }
                _ => {}
            }
        }
        Ok(())
    }
}
