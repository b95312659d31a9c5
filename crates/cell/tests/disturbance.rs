//! What goes wrong while a campaign is measured has the size, the correlation and the place that it is said to have:
//! each by the difference from the same scenario without it.

use crate::common::file;
use misfit_campaign::Campaign;
use misfit_cell::scenario::{Scenario, simulate::simulate};
use nalgebra::Vector3;
use std::fs;

/// σ of the tracker, m and rad; 300 poses, two directions, two repeats.
const SIGMA: f64 = 15e-6;

fn scenario(noise: &str, more: &str) -> Result<Scenario, String> {
    let robot = file("models/six_axis/six_axis.urdf");
    let text = format!(
        "robot = {:?}\nseed = 9\n[[target]]\nname = \"t\"\nlink = \"flange\"\n[noise]\n{noise}\n\
         [design]\nposes = 300\ndirections = 2\nrepeats = 2\nloads = [{{}}, {{ mass_kg = 50 }}]\n{more}\n",
        robot.to_str().unwrap()
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("s.toml");
    fs::write(&path, text).unwrap();
    Scenario::load(&path).map_err(|error| error.to_string())
}

fn measured(noise: &str, more: &str) -> Campaign {
    simulate(&scenario(noise, more).unwrap(), || {}).unwrap()
}

const WHITE: &str = "position_m = 15e-6\norientation_rad = 60e-6";
const NONE: &str = "position_m = 0";

/// Differences of positions between two campaigns of the same design, m.
fn apart(one: &Campaign, other: &Campaign) -> Vec<Vector3<f64>> {
    assert_eq!(one.readings.len(), 2400);
    let pairs = one.readings.iter().zip(&other.readings);
    pairs.map(|(a, b)| a.position - b.position).collect()
}

fn rms(all: impl Iterator<Item = f64>) -> f64 {
    let all: Vec<f64> = all.collect();
    (all.iter().map(|x| x * x).sum::<f64>() / all.len() as f64).sqrt()
}

/// Errors of the tracker by coordinate, in order.
fn errors(noise: &str, more: &str) -> Vec<Vector3<f64>> {
    apart(&measured(noise, more), &measured(NONE, ""))
}

/// Mean product of neighbours over the mean square, of the first coordinate.
fn correlation(errors: &[Vector3<f64>]) -> f64 {
    let products = errors.windows(2).map(|pair| pair[0].x * pair[1].x);
    let squares = errors.iter().map(|e| e.x * e.x);
    products.sum::<f64>() / squares.sum::<f64>()
}

#[test]
fn noise_of_the_tracker_is_correlated_and_keeps_its_size() {
    // the estimate of a correlation of 2400 readings is sure to about 0.02; of σ, at 0.9, to some per cent
    for (rho, within) in [(0.0, 0.07), (0.5, 0.06), (0.9, 0.04)] {
        let more = format!("[disturbance]\ntracker_correlation = {rho}");
        let errors = errors(WHITE, &more);
        assert!((correlation(&errors) - rho).abs() < within, "{rho}");
        let size = rms(errors.iter().flat_map(|e| e.iter().copied()));
        assert!((size / SIGMA - 1.0).abs() < 0.12, "{rho}: {size}");
    }
}

#[test]
fn heavy_tails_keep_the_size() {
    let errors = errors(WHITE, "[disturbance]\ntails_dof = 4");
    let values: Vec<f64> = errors.iter().flat_map(|e| e.iter().copied()).collect();
    let size = rms(values.iter().copied());
    assert!((size / SIGMA - 1.0).abs() < 0.1, "{size}");
    // of normal noise 0.27 % lie beyond three σ; of t with 4 degrees of freedom and σ 1 it is 1.3 % (2 (1 - F(3 √2)))
    let far = values.iter().filter(|x| x.abs() > 3.0 * SIGMA).count() as f64 / values.len() as f64;
    assert!((0.009..0.018).contains(&far), "{far}");
}

#[test]
fn a_walk_has_its_size_beside_the_noise() {
    let errors = errors(NONE, "[disturbance]\ntracker_walk_m = 20e-6");
    for k in 0..3 {
        let size = rms(errors.iter().map(|e| e[k]));
        assert!((size - 20e-6).abs() < 1e-12, "{size}");
    }
    assert!(correlation(&errors) > 0.99);
}

#[test]
fn a_smooth_error_repeats_with_the_pose() {
    let more = "[disturbance]\nsmooth_m = 30e-6\nsmooth_length = 1.0";
    let disturbed = measured(NONE, more);
    let errors = apart(&disturbed, &measured(NONE, ""));
    let size = rms(errors.iter().map(|e| e.norm()));
    // one draw of a process is as large as said on average over draws
    assert!((15e-6..50e-6).contains(&size), "{size}");
    let first = |label: &str| {
        let at = disturbed
            .readings
            .iter()
            .position(|r| r.pose.as_deref() == Some(label));
        errors[at.unwrap()]
    };
    for (reading, error) in disturbed.readings.iter().zip(&errors) {
        let gap = error - first(reading.pose.as_deref().unwrap());
        assert!(gap.norm() < 1e-12, "{gap}");
    }
    assert!((first("p001") - first("p002")).norm() > 1e-7);
}

#[test]
fn static_repeats_share_their_joints() {
    let noise = "position_m = 0\njoint_rad = 30e-6";
    let spread = |more: &str| {
        let errors = apart(&measured(noise, more), &measured(NONE, ""));
        let campaign = measured(NONE, "");
        let mut pairs = Vec::new();
        for (i, a) in campaign.readings.iter().enumerate() {
            for (j, b) in campaign.readings.iter().enumerate().skip(i + 1) {
                let same = a.pose == b.pose && a.approach == b.approach && a.payload == b.payload;
                if same {
                    pairs.push((errors[i] - errors[j]).norm());
                }
            }
        }
        assert_eq!(pairs.len(), 1200);
        (rms(pairs.into_iter()), rms(errors.iter().map(|e| e.norm())))
    };
    let (moved, size) = spread("");
    let (still, size_still) = spread("[disturbance]\nstatic_repeats = true");
    // between two independent draws the difference is √2 of one
    assert!(
        (moved / size / 2f64.sqrt() - 1.0).abs() < 0.1,
        "{moved} {size}"
    );
    assert!(still < 1e-12, "{still}");
    assert!(
        (size_still / size - 1.0).abs() < 0.15,
        "{size_still} {size}"
    );
}

#[test]
fn bad_poses_are_whole_and_bad_readings_are_single() {
    let by_pose = |errors: &[Vector3<f64>], campaign: &Campaign| {
        let mut bad = std::collections::BTreeMap::<String, (usize, usize)>::new();
        for (error, reading) in errors.iter().zip(&campaign.readings) {
            let counts = bad.entry(reading.pose.clone().unwrap()).or_default();
            counts.0 += usize::from(error.norm() > 1e-9);
            counts.1 += 1;
        }
        bad
    };
    let campaign = measured(NONE, "");
    let poses = errors(
        NONE,
        "[disturbance]\nbad_poses = { share = 0.05, coordinate_m = 0.2e-3 }",
    );
    let bad = by_pose(&poses, &campaign);
    assert!(bad.values().all(|(bad, all)| *bad == 0 || bad == all));
    let count = bad.values().filter(|(bad, _)| *bad > 0).count();
    assert!(
        (5..=28).contains(&count),
        "{count} of 300, 15 expected, σ 3.8"
    );
    let single = errors(
        NONE,
        "[disturbance]\nbad_readings = { share = 0.05, coordinate_m = 5e-3 }",
    );
    let hit: Vec<f64> = single
        .iter()
        .map(|e| e.norm())
        .filter(|e| *e > 1e-9)
        .collect();
    assert!(
        (80..=160).contains(&hit.len()),
        "{}: 120 expected",
        hit.len()
    );
    let size = rms(hit.into_iter()) / 3f64.sqrt();
    assert!((4e-3..6e-3).contains(&size), "{size}");
    assert!(
        by_pose(&single, &campaign)
            .values()
            .any(|(bad, all)| 0 < *bad && bad < all)
    );
}

#[test]
fn columns_state_what_they_are_told_to() {
    let plain = measured(WHITE, "");
    let coarse = measured(WHITE, "[disturbance]\nencoder_step_rad = 175e-6");
    for (a, b) in plain.readings.iter().zip(&coarse.readings) {
        assert_eq!(a.position, b.position, "the robot is where it was");
        for (q, counted) in a.joints.iter().zip(&b.joints) {
            assert!((q - counted).abs() <= 175e-6 / 2.0 + 1e-12);
            let steps = counted / 175e-6;
            assert!((steps - steps.round()).abs() < 1e-6, "{steps}");
        }
    }
    let wrong = measured(
        WHITE,
        "[disturbance]\npayload_stated = 0.6\nnoise_stated = 0.25",
    );
    assert_eq!(wrong.noise.unwrap().position, 0.25 * SIGMA);
    for (a, b) in plain.readings.iter().zip(&wrong.readings) {
        assert_eq!(a.payload.unwrap().mass * 0.6, b.payload.unwrap().mass);
        assert_eq!(a.position, b.position);
    }
    let none = measured(WHITE, "[disturbance]\npayload_unstated = true");
    assert!(none.readings.iter().all(|r| r.payload.is_none()));
    let one = measured(WHITE, "[instruments]\norientation = false");
    assert!(one.readings.iter().all(|r| r.orientation.is_none()));
}

#[test]
fn a_step_is_one_motion_from_its_reading_on() {
    let before = measured(NONE, "");
    for (what, least, most) in [
        ("base", 10e-6, 400e-6),
        ("tracker", 10e-6, 700e-6),
        ("tool", 10e-6, 400e-6),
        ("zero", 0.0, 300e-6),
    ] {
        let more = format!("[disturbance]\nstep = {{ what = \"{what}\", at = 0.4, size = 1.0 }}");
        let after = measured(NONE, &more);
        let errors = apart(&after, &before);
        let first = errors.iter().position(|e| e.norm() > 1e-9).unwrap();
        assert!((960..965).contains(&first), "{what}: {first}");
        let size = rms(errors[first..].iter().map(|e| e.norm()));
        assert!((least..most).contains(&size), "{what}: {size}");
        // a tool that is bent moves with the flange: in the tracker's frame its shift turns
        let turns = |error: &Vector3<f64>| (error - errors[first]).norm() / size;
        let varied = errors[first..].iter().map(turns).fold(0.0, f64::max);
        assert!(varied > 0.1, "{what}: {varied}");
    }
}

#[test]
fn disturbances_that_cannot_be_are_refused() {
    for (key, accepted) in [
        ("tracker_correlation = 1.0", "below 1"),
        ("tails_dof = 2.0", "above 2"),
        ("smooth_m = -1.0", "zero or more"),
        ("bad_poses = { share = 1.5, coordinate_m = 1e-3 }", "share"),
        ("encoder_step_rad = inf", "zero or more"),
        ("noise_stated = 0.0", "above zero"),
        ("step = { what = \"zero\", at = 1.1, size = 1.0 }", "share"),
    ] {
        let error = scenario(WHITE, &format!("[disturbance]\n{key}")).unwrap_err();
        let name = key.split(' ').next().unwrap();
        assert!(
            error.contains(name) && error.contains(accepted),
            "{key}: {error}"
        );
    }
}
