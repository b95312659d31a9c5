//! What a controller makes of a measured wrench: causal filters of six channels, and a look ahead.
//!
//! A filter is `y[k] = Σ b[i] x[k-i] - Σ a[i] y[k-i]` with gain 1 at rest. What is still to come is foreseen along a
//! straight line: over a delay of `d` ticks, from the filtered signal and its slope over the last `m = ⌈d⌉` ticks,
//! `y[k] + d/m (y[k] - y[k-m])`. A slope from one tick to the next would be as exact on a straight line, but undo the filter:
//! with a low pass of first order it gives the unfiltered signal back.
//!
//! Source: Oppenheim and Schafer, *Discrete-Time Signal Processing*, 3rd ed., sec. 7.2 (bilinear transform, Butterworth).

use nalgebra::Vector6;
use std::collections::VecDeque;
use std::f64::consts::{PI, SQRT_2};

/// A linear filter by its coefficients, and how far it looks ahead.
#[derive(Debug, Clone, PartialEq)]
pub struct Law {
    /// Weights of the inputs, the newest first.
    forward: Vec<f64>,
    /// Weights of the outputs before, the newest first; `a[0] = 1` is left out.
    back: Vec<f64>,
    /// Ticks foreseen.
    ahead: f64,
}

impl Law {
    /// The signal as it is.
    pub fn none() -> Self {
        Self {
            forward: vec![1.0],
            back: Vec::new(),
            ahead: 0.0,
        }
    }

    /// Mean of the last so many ticks, 1 or more.
    pub fn moving_average(ticks: usize) -> Self {
        let ticks = ticks.max(1);
        Self {
            forward: vec![1.0 / ticks as f64; ticks],
            back: Vec::new(),
            ahead: 0.0,
        }
    }

    /// Low pass of first order, `cutoff` (-3 dB) as a share of the rate, above 0 and below 0.5.
    pub fn first_order(cutoff: f64) -> Self {
        let w = (PI * cutoff).tan();
        let whole = 1.0 + w;
        Self {
            forward: vec![w / whole, w / whole],
            back: vec![(w - 1.0) / whole],
            ahead: 0.0,
        }
    }

    /// Butterworth's low pass of second order, `cutoff` (-3 dB) as a share of the rate, above 0 and below 0.5.
    pub fn second_order(cutoff: f64) -> Self {
        let w = (PI * cutoff).tan();
        let whole = 1.0 + SQRT_2 * w + w * w;
        let gain = w * w / whole;
        Self {
            forward: vec![gain, 2.0 * gain, gain],
            back: vec![
                2.0 * (w * w - 1.0) / whole,
                (1.0 - SQRT_2 * w + w * w) / whole,
            ],
            ahead: 0.0,
        }
    }

    /// The same, foreseeing its own delay and so many ticks more.
    pub fn foreseeing(mut self, more: f64) -> Self {
        self.ahead = self.delay() + more;
        self
    }

    /// By how many ticks a slow signal is late: group delay at frequency zero, without the look ahead.
    pub fn delay(&self) -> f64 {
        let moment = |weights: &[f64], first: usize| -> f64 {
            let all = weights.iter().enumerate();
            all.map(|(k, weight)| (k + first) as f64 * weight).sum()
        };
        let below = 1.0 + self.back.iter().sum::<f64>();
        let above: f64 = self.forward.iter().sum();
        moment(&self.forward, 0) / above - moment(&self.back, 1) / below
    }

    /// Ticks foreseen.
    pub fn ahead(&self) -> f64 {
        self.ahead
    }

    /// Deviation of what comes out over that of white noise that goes in: root of the sum of the squared answer to a
    /// single unit.
    pub fn noise_gain(&self) -> f64 {
        /// Answers this far below the first sum are nothing.
        const REST: f64 = 1e-16;
        const LONGEST: usize = 10_000_000;
        let mut filter = Filter::new(self.clone());
        filter.push(&Vector6::zeros());
        let still = 2 * (self.forward.len() + self.reach());
        let (mut sum, mut quiet) = (0.0, 0);
        for k in 0..LONGEST {
            let x = if k == 0 { 1.0 } else { 0.0 };
            let (_, y) = filter.push(&Vector6::repeat(x));
            let square = y[0] * y[0];
            sum += square;
            // an answer may pass zero: only a long rest is its end
            quiet = if square <= REST * sum { quiet + 1 } else { 0 };
            if quiet > still + 100 {
                break;
            }
        }
        sum.sqrt()
    }

    /// Ticks that the slope looks back.
    fn reach(&self) -> usize {
        // a whole number of ticks stays one, whatever its rounding
        (self.ahead - 1e-9).ceil().max(0.0) as usize
    }
}

/// A filter at work: its law and what it remembers.
#[derive(Debug, Clone)]
pub struct Filter {
    law: Law,
    /// Inputs, the newest first.
    inputs: VecDeque<Vector6<f64>>,
    /// Filtered, the newest first.
    outputs: VecDeque<Vector6<f64>>,
}

impl Filter {
    /// One that has seen nothing yet.
    pub fn new(law: Law) -> Self {
        Self {
            law,
            inputs: VecDeque::new(),
            outputs: VecDeque::new(),
        }
    }

    /// Takes one measurement (any units, each channel on its own): filtered, and foreseen. The first one is taken for a
    /// signal that has always been so.
    pub fn push(&mut self, measured: &Vector6<f64>) -> (Vector6<f64>, Vector6<f64>) {
        let law = &self.law;
        let kept = law.back.len().max(law.reach()).max(1);
        if self.inputs.is_empty() {
            self.inputs = vec![*measured; law.forward.len()].into();
            self.outputs = vec![*measured; kept].into();
        } else {
            self.inputs.pop_back();
            self.inputs.push_front(*measured);
        }
        let mut filtered = Vector6::zeros();
        for (weight, x) in law.forward.iter().zip(&self.inputs) {
            filtered += x * *weight;
        }
        for (weight, y) in law.back.iter().zip(&self.outputs) {
            filtered -= y * *weight;
        }
        let foreseen = match law.reach() {
            0 => filtered,
            back => {
                let slope = (filtered - self.outputs[back - 1]) / back as f64;
                filtered + slope * law.ahead
            }
        };
        self.outputs.pop_back();
        self.outputs.push_front(filtered);
        (filtered, foreseen)
    }
}
