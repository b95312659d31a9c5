//! `[[loop.filter]]` of a scenario: its keys, and the filter that they make.

use crate::compensation::filter::Law;
use serde::Deserialize;

/// Ticks in the window of a moving average: a typing error must not cost a day.
const MAX_WINDOW_TICKS: f64 = 1e6;

/// `[[loop.filter]]`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FilterEntry {
    /// What it is.
    pub kind: FilterKind,
    /// Of a moving average, s.
    pub window_s: Option<f64>,
    /// Of a low pass, -3 dB, Hz.
    pub cutoff_hz: Option<f64>,
    /// Of a low pass: 1, or 2 (Butterworth; if left out).
    pub order: Option<usize>,
    /// Foresee the load of the moment at which the command acts?
    #[serde(default)]
    pub predict: bool,
}

/// What a filter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FilterKind {
    /// The measured wrench as it is.
    None,
    /// The mean of a window.
    MovingAverage,
    /// A low pass of first or second order.
    LowPass,
}

impl FilterEntry {
    /// Its name in reports and expectations: `none`, `moving average 40 ms`, `low pass 8 Hz, order 2, predicted`.
    pub fn name(&self) -> String {
        let mut name = match self.kind {
            FilterKind::None => "none".to_owned(),
            FilterKind::MovingAverage => {
                let window = self.window_s.unwrap_or_default() * 1e3;
                // seven digits: what a decimal fraction times 1000 is meant to be
                format!("moving average {} ms", (window * 1e4).round() / 1e4)
            }
            FilterKind::LowPass => {
                let cutoff = self.cutoff_hz.map(|cutoff| format!(" {cutoff} Hz"));
                format!(
                    "low pass{}, order {}",
                    cutoff.unwrap_or_default(),
                    self.order.unwrap_or(2)
                )
            }
        };
        if self.predict {
            name += ", predicted";
        }
        name
    }

    /// The filter at a rate, Hz. A command acts a tick after its measurement: this is foreseen besides the filter's own
    /// delay. `key` is what messages call it.
    ///
    /// # Errors
    /// A sentence that names the key.
    pub fn law(&self, key: &str, rate: f64) -> Result<Law, String> {
        let wrong = |what: String| Err(format!("{key} {}: {what}", self.name()));
        let window = ("window_s", self.window_s.is_some());
        let cutoff = ("cutoff_hz", self.cutoff_hz.is_some());
        let order = ("order", self.order.is_some());
        let foreign: &[(&str, bool)] = match self.kind {
            FilterKind::None => &[window, cutoff, order],
            FilterKind::MovingAverage => &[cutoff, order],
            FilterKind::LowPass => &[window],
        };
        if let Some((key, _)) = foreign.iter().find(|(_, given)| *given) {
            return wrong(format!("{key} is of another kind of filter; leave it out"));
        }
        let law = match self.kind {
            FilterKind::None => Ok(Law::none()),
            FilterKind::MovingAverage => self.moving_average(rate),
            FilterKind::LowPass => self.low_pass(rate),
        };
        match law {
            Ok(law) if self.predict => Ok(law.foreseeing(1.0)),
            Ok(law) => Ok(law),
            Err(what) => wrong(what),
        }
    }

    fn moving_average(&self, rate: f64) -> Result<Law, String> {
        let missing = "window_s is missing; accepted: the window's length, s";
        let window = self.window_s.ok_or(missing)?;
        let ticks = (window * rate).round();
        match (1.0..=MAX_WINDOW_TICKS).contains(&ticks) {
            true => Ok(Law::moving_average(ticks as usize)),
            false => Err(format!(
                "window_s = {window} holds {ticks} ticks; accepted: 1 to {MAX_WINDOW_TICKS}"
            )),
        }
    }

    fn low_pass(&self, rate: f64) -> Result<Law, String> {
        let missing = "cutoff_hz is missing; accepted: its -3 dB, Hz";
        let cutoff = self.cutoff_hz.ok_or(missing)?;
        let (least, most) = (rate * 1e-4, rate * 0.45);
        if !(least..=most).contains(&cutoff) {
            return Err(format!(
                "cutoff_hz is {cutoff}; accepted at rate_hz = {rate}: {least} to {most}"
            ));
        }
        match self.order.unwrap_or(2) {
            1 => Ok(Law::first_order(cutoff / rate)),
            2 => Ok(Law::second_order(cutoff / rate)),
            other => Err(format!("order is {other}; accepted: 1, 2")),
        }
    }
}
