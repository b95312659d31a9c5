//! Filters of the control loop against their transfer functions, and what holds of every linear filter.

use crate::common::random;
use misfit_core::compensation::filter::{Filter, Law};
use nalgebra::{Complex, Vector6};
use proptest::prelude::*;
use rand::RngExt;
use std::f64::consts::{PI, SQRT_2, TAU};

/// A filter of one channel.
fn run(law: &Law, signal: impl IntoIterator<Item = f64>) -> Vec<(f64, f64)> {
    let mut filter = Filter::new(law.clone());
    let signal = signal.into_iter();
    signal
        .map(|x| {
            let (filtered, foreseen) = filter.push(&Vector6::repeat(x));
            (filtered[0], foreseen[0])
        })
        .collect()
}

/// Answer to a single unit after a long rest: filtered and foreseen.
fn impulse(law: &Law, ticks: usize) -> Vec<(f64, f64)> {
    let signal = [0.0, 1.0]
        .into_iter()
        .chain(std::iter::repeat_n(0.0, ticks - 1));
    run(law, signal)[1..].to_vec()
}

/// Frequency response of a finite answer, frequency as a share of the rate.
fn response(answer: impl Iterator<Item = f64>, frequency: f64) -> Complex<f64> {
    let turn = |k: usize| Complex::from_polar(1.0, -TAU * frequency * k as f64);
    answer.enumerate().map(|(k, h)| turn(k) * h).sum()
}

/// Every kind, with what its magnitude is by the textbook, and its delay.
type Magnitude = Box<dyn Fn(f64) -> f64>;
fn kinds() -> Vec<(&'static str, Law, Magnitude, f64)> {
    let mut all: Vec<(&'static str, Law, Magnitude, f64)> =
        vec![("none", Law::none(), Box::new(|_| 1.0), 0.0)];
    for n in [1_usize, 2, 5, 25] {
        let magnitude = move |f: f64| {
            let n = n as f64;
            (PI * f * n).sin().abs() / (n * (PI * f).sin())
        };
        let delay = (n as f64 - 1.0) / 2.0;
        all.push((
            "moving average",
            Law::moving_average(n),
            Box::new(magnitude),
            delay,
        ));
    }
    for cutoff in [0.01, 0.032, 0.1, 0.3] {
        // Butterworth's |H|² = 1 / (1 + (Ω/Ωc)^2n), Ω warped by the bilinear transform
        let warped = move |f: f64| (PI * f).tan() / (PI * cutoff).tan();
        let w = (PI * cutoff).tan();
        all.push((
            "first order",
            Law::first_order(cutoff),
            Box::new(move |f| 1.0 / (1.0 + warped(f).powi(2)).sqrt()),
            0.5 / w,
        ));
        all.push((
            "second order",
            Law::second_order(cutoff),
            Box::new(move |f| 1.0 / (1.0 + warped(f).powi(4)).sqrt()),
            SQRT_2 * 0.5 / w,
        ));
    }
    all
}

/// 1e-9: the answer of the slowest filter is cut off where it is below 1e-13.
#[test]
fn the_frequency_response_is_that_of_the_textbook() {
    for (name, law, magnitude, _) in kinds() {
        let answer = impulse(&law, 2000);
        for frequency in [0.001, 0.01, 0.032, 0.1, 0.21, 0.3, 0.45] {
            let found = response(answer.iter().map(|(y, _)| *y), frequency).norm();
            let wanted = magnitude(frequency);
            assert!(
                (found - wanted).abs() < 1e-9,
                "{name} at {frequency}: {found} for {wanted}"
            );
        }
    }
    for cutoff in [0.01, 0.032, 0.1, 0.3] {
        for law in [Law::first_order(cutoff), Law::second_order(cutoff)] {
            let answer = impulse(&law, 2000);
            let found = response(answer.iter().map(|(y, _)| *y), cutoff).norm();
            assert!((found - 0.5_f64.sqrt()).abs() < 1e-9, "not -3 dB: {found}");
        }
    }
}

/// The delay stated is that of the textbook, and the mean of the answer's times: a ramp comes out so much later, and
/// foreseen not at all.
#[test]
fn a_ramp_comes_out_late_by_the_delay_and_foreseen_on_time() {
    for (name, law, _, delay) in kinds() {
        assert!((law.delay() - delay).abs() < 1e-9, "{name}: {delay}");
        let answer = impulse(&law, 2000);
        let mean: f64 = answer
            .iter()
            .enumerate()
            .map(|(k, (y, _))| k as f64 * y)
            .sum();
        assert!((mean - delay).abs() < 1e-8, "{name}: {mean} for {delay}");
        for more in [0.0, 1.0, 3.5] {
            let ahead = law.clone().foreseeing(more);
            assert!((ahead.ahead() - delay - more).abs() < 1e-9);
            const SLOPE: f64 = 0.3;
            let out = run(&ahead, (0..3000).map(|k| SLOPE * k as f64));
            for (k, (filtered, foreseen)) in out.iter().enumerate().skip(2000) {
                let late = k as f64 - filtered / SLOPE;
                assert!((late - delay).abs() < 1e-8, "{name}: late by {late}");
                let gap = foreseen / SLOPE - (k as f64 + more);
                assert!(gap.abs() < 1e-8, "{name}: foreseen {gap} off");
            }
        }
    }
}

/// Closed forms: a moving average rises evenly, a first order by a power, and a second order overshoots by e^(-π) = 4.3 %.
#[test]
fn steps_are_answered_as_in_the_textbook() {
    let step = |ticks: usize| std::iter::once(0.0).chain(std::iter::repeat_n(1.0, ticks));
    for (k, (y, _)) in run(&Law::moving_average(10), step(30)).iter().enumerate() {
        assert!((y - (k as f64 / 10.0).min(1.0)).abs() < 1e-12);
    }
    let w = (PI * 0.05).tan();
    let (b, a) = (w / (1.0 + w), (1.0 - w) / (1.0 + w));
    let out = run(&Law::first_order(0.05), step(200));
    for (k, (y, _)) in out[1..].iter().enumerate() {
        assert!((y - (1.0 - (1.0 - b) * a.powi(k as i32))).abs() < 1e-12);
    }
    let out = run(&Law::second_order(0.002), step(3000));
    let most = out.iter().map(|(y, _)| *y).fold(0.0, f64::max);
    // sampled between its peaks and warped: a thousandth
    assert!((most - 1.0 - (-PI).exp()).abs() < 1e-3, "{most}");
}

/// Parseval: the gain of white noise is the response's mean square over all frequencies, here of the textbook's response,
/// with the look ahead's own factor, by a sum over a fine grid.
#[test]
fn the_noise_gain_is_the_mean_of_the_squared_response() {
    for (name, law, magnitude, delay) in kinds() {
        for more in [None, Some(1.0)] {
            let law = match more {
                None => law.clone(),
                Some(more) => law.clone().foreseeing(more),
            };
            let ahead = more.map_or(0.0, |more| delay + more);
            let back = (ahead - 1e-6).ceil().max(1.0);
            const GRID: usize = 200_000;
            let square = |k: usize| {
                let f = (k as f64 + 0.5) / GRID as f64 / 2.0;
                let late = Complex::from_polar(1.0, -TAU * f * back);
                let factor =
                    Complex::new(1.0, 0.0) + (Complex::new(1.0, 0.0) - late) * ahead / back;
                (magnitude(f) * factor.norm()).powi(2)
            };
            let wanted = ((0..GRID).map(square).sum::<f64>() / GRID as f64).sqrt();
            let found = law.noise_gain();
            // the grid's own error
            assert!(
                (found / wanted - 1.0).abs() < 1e-5,
                "{name}, {more:?}: {found} for {wanted}"
            );
        }
    }
    for n in [1, 4, 100] {
        let gain = Law::moving_average(n).noise_gain();
        assert!((gain - (n as f64).powf(-0.5)).abs() < 1e-12);
    }
    // twice the last one less the one before it
    let gain = Law::none().foreseeing(1.0).noise_gain();
    assert!((gain - 5.0_f64.sqrt()).abs() < 1e-12);
}

fn any_law() -> impl Strategy<Value = Law> {
    let plain = prop_oneof![
        Just(Law::none()),
        (1_usize..60).prop_map(Law::moving_average),
        (0.003..0.45).prop_map(Law::first_order),
        (0.003..0.45).prop_map(Law::second_order),
    ];
    (plain, any::<bool>(), 0.0..3.0).prop_map(|(law, ahead, more)| match ahead {
        true => law.foreseeing(more),
        false => law,
    })
}

proptest! {
    /// What always has been so stays so, from the first measurement on.
    #[test]
    fn a_constant_stays_one(law in any_law(), value in -100.0..100.0) {
        for (filtered, foreseen) in run(&law, std::iter::repeat_n(value, 300)) {
            // rounding of a filter whose weights are near 2 and 1: 1e-16 by the square of its time constant
            prop_assert!((filtered - value).abs() < 1e-10 * (1.0 + value.abs()));
            prop_assert!((foreseen - value).abs() < 1e-9 * (1.0 + value.abs()));
        }
    }

    /// Of a sum of signals the sum of the answers; and no channel knows of another.
    #[test]
    fn filters_are_linear_and_their_channels_apart(law in any_law(), seed in 0_u64..1000, share in -3.0..3.0) {
        let mut random = random(seed);
        let mut signal = || -> Vec<Vector6<f64>> {
            (0..200).map(|_| Vector6::from_fn(|_, _| random.random_range(-1.0..1.0))).collect()
        };
        let (a, b) = (signal(), signal());
        let answer = |signal: &mut dyn Iterator<Item = Vector6<f64>>| -> Vec<Vector6<f64>> {
            let mut filter = Filter::new(law.clone());
            signal.map(|x| filter.push(&x).1).collect()
        };
        let of_a = answer(&mut a.iter().copied());
        let of_b = answer(&mut b.iter().copied());
        let of_both = answer(&mut a.iter().zip(&b).map(|(a, b)| a + b * share));
        for k in 0..200 {
            let gap: Vector6<f64> = of_both[k] - of_a[k] - of_b[k] * share;
            prop_assert!(gap.amax() < 1e-9);
        }
        let alone = answer(&mut a.iter().map(|a| Vector6::new(0.0, 0.0, a[2], 0.0, 0.0, 0.0)));
        for k in 0..200 {
            prop_assert_eq!(alone[k][2], of_a[k][2]);
            prop_assert_eq!(alone[k][0], 0.0);
        }
    }
}
