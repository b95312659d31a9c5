//! Identification: scenarios' expectations, what must not matter, what cannot be seen, and a real robot.

use crate::common::{campaign, file, link_pose, motion, posture, random, reading};
use crate::common::{effect, sda5f, six_axis};
use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Frame, Reading, Split};
use misfit_cell::scenario::Scenario;
use misfit_cell::scenario::design::DesignLoad;
use misfit_cell::scenario::efficiency::{study, true_values};
use misfit_cell::scenario::expect::{check_fit, compare};
use misfit_cell::scenario::simulate::simulate;
use misfit_core::effects::{CATALOGUE, EffectList, Need, Role};
use misfit_core::fit::solve::{Linear, Problem, reduce, solve};
use misfit_core::fit::{
    CampaignProblem, Errors, FOLDS, Fit, HeldoutBy, Options, Status, fit, folds, noise,
};
use misfit_core::model_file;
use nalgebra::{DMatrix, Isometry3, Vector3};
use std::f64::consts::PI;
use std::sync::LazyLock;

fn scenario(name: &str) -> Scenario {
    Scenario::load(&file(&format!("scenarios/{name}.toml"))).unwrap()
}

fn fitted(campaign: &Campaign, effects: &EffectList) -> Fit {
    let model = model_file::model(campaign, effects, None).unwrap();
    let options = Options {
        cross_validate: false,
    };
    fit(campaign, &model, &options, |_| {}).unwrap()
}

fn value(fit: &Fit, effect: &str, name: &str) -> f64 {
    fit.values[fit.index(effect, name).unwrap()]
}

fn status(fit: &Fit, effect: &str, name: &str) -> Status {
    fit.status[fit.index(effect, name).unwrap()]
}

/// Indices, values and standard deviations of the compliances that were estimated.
fn springs(fit: &Fit) -> Vec<(usize, f64, f64)> {
    let term = fit.model.term("joint_compliance").unwrap();
    (term.first..term.first + term.parameters.len())
        .filter_map(|k| Some((k, fit.values[k], fit.std[k]?)))
        .collect()
}

/// A campaign of arm R1: 15 poses without load and with 5 kg, noise and geometry as in its scenario.
static ONE_ARM: LazyLock<(Scenario, Campaign, Fit)> = LazyLock::new(|| {
    let mut scenario = scenario("efficiency");
    scenario.design.poses = 15;
    scenario.design.repeats = 1;
    let campaign = simulate(&scenario, || {}).unwrap();
    let fit = fitted(&campaign, &EffectList::DEFAULT);
    assert!(fit.converged);
    assert_eq!(springs(&fit).len(), 7, "all but the torso's");
    (scenario, campaign, fit)
});

mod scenarios {
    use super::*;

    fn assert_expectations_met(name: &str) {
        let scenario = scenario(name);
        let campaign = simulate(&scenario, || {}).unwrap();
        let model = model_file::model(&campaign, &scenario.effects, None).unwrap();
        let options = Options {
            cross_validate: scenario.expect.heldout_position_rms_mm.is_some(),
        };
        let found = fit(&campaign, &model, &options, |_| {}).unwrap();
        let checks = check_fit(&scenario.expect, &found, &compare(&scenario, &found));
        assert!(checks.len() > 15, "{name} expects {} things", checks.len());
        for check in checks {
            assert!(
                check.met,
                "{}: found {}, accepted {}",
                check.what, check.found, check.accepted
            );
        }
    }

    #[test]
    fn springs_configured_in_mujoco_come_back() {
        assert_expectations_met("springs");
    }

    #[test]
    fn without_noise_they_come_back_to_a_millionth() {
        assert_expectations_met("noise_free");
    }

    /// Forty campaigns say little more than that nothing is badly wrong; the scenario itself runs 150, and 2000
    /// when asked.
    #[test]
    fn the_fit_is_about_as_good_as_any_can_be() {
        let study = study(&scenario("efficiency"), 40, || {}).unwrap();
        assert_eq!(study.not_converged, 0);
        let (efficiency, std) = (study.efficiency(), study.efficiency_std());
        assert!((efficiency - 1.0).abs() < 4.0 * std, "{efficiency} ± {std}");
        assert!(efficiency > 0.8, "{efficiency}");
        // 280 intervals: one standard deviation of their coverage is 1.3 %
        let coverage = study.coverage();
        assert!((0.90..=0.99).contains(&coverage), "{coverage}");
        let paper = study.paper_efficiency();
        assert!(paper < 0.5, "{paper}");
    }
}

/// The slope of the cost at a point where readings are off by decimetres and a third of a radian: the derivative
/// of the error of an orientation is not that of the orientation.
#[test]
fn slopes_of_the_cost_are_its_differences() {
    let (scenario, campaign, fit) = &*ONE_ARM;
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &scenario.noise);
    let mut p = fit.values.clone();
    let turned = fit.model.term("target_offset").unwrap().first;
    for (k, by) in [0.1, -0.1, 0.2, 0.2, -0.2, 0.3].into_iter().enumerate() {
        p[turned + k] += by;
    }
    let problem = CampaignProblem::new(&fit.model, &readings, &whiteners, &fit.free, &p);
    let free: Vec<f64> = fit.free.iter().map(|&k| p[k]).collect();
    let linear = problem.linearise(&free);
    let cost_at = |free: &[f64]| -> f64 {
        let rows = misfit_core::fit::residuals(&fit.model, &problem.full(free), &readings);
        let pairs = rows.iter().zip(&whiteners);
        pairs.map(|(row, whitener)| whitener.squares(row)).sum()
    };
    let cost = cost_at(&free);
    // two routes to one sum of 180 squares
    assert!((linear.cost() / cost - 1.0).abs() < 1e-12);
    let slopes = linear.factor.transpose() * &linear.right * 2.0;
    for (k, (slope, &scale)) in slopes.iter().zip(problem.scale()).enumerate() {
        // small beside 1 m and 1 rad, for frames and for everything else
        let step = (0.1 / scale).min(1.0) * 1e-3;
        let at = |steps: f64| {
            let mut moved = free.clone();
            moved[k] += steps * step * scale;
            cost_at(&moved)
        };
        let found = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * step);
        // rounding of the cost, 1e-16 of it and more for its many terms, over the step
        let limit = 1e-6 * slope.abs() + 1e-14 * cost / step;
        assert!(
            (found - slope).abs() < limit,
            "parameter {k}: {found:e}, {slope:e}"
        );
    }
}

/// A campaign of repeats: its readings, repeats together, and a model with the frames and springs that it has.
fn with_repeats() -> (Campaign, Fit) {
    let mut scenario = scenario("efficiency");
    scenario.design.poses = 10;
    scenario.design.repeats = 3;
    let mut campaign = simulate(&scenario, || {}).unwrap();
    let order = |r: &Reading| (r.pose.clone(), r.payload.map(|p| p.mass.to_bits()), r.line);
    campaign.readings.sort_by_key(order);
    let fit = fitted(&campaign, &EffectList::DEFAULT);
    assert!(fit.converged);
    (campaign, fit)
}

/// The solver adds repeats up: what it has of them is what all rows, one by one, say.
#[test]
fn sums_of_repeats_say_what_their_rows_do() {
    let (campaign, fit) = with_repeats();
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    let shape = campaign.noise.unwrap();
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &shape);
    let problem = CampaignProblem::new(&fit.model, &readings, &whiteners, &fit.free, &fit.values);
    let mut p: Vec<f64> = fit.free.iter().map(|&k| fit.values[k]).collect();
    // off the minimum, where the residual is not small
    p.iter_mut().for_each(|x| *x *= 1.001);
    let n = p.len();
    let linear = problem.linearise(&p);
    let all = |a: DMatrix<f64>, block: &DMatrix<f64>| a + block.transpose() * block;
    let all = problem
        .blocks(&p)
        .iter()
        .fold(DMatrix::zeros(n + 1, n + 1), all);
    assert!((linear.cost() / all[(n, n)] - 1.0).abs() < 1e-12);
    let information = linear.factor.transpose() * &linear.factor;
    let slopes = linear.factor.transpose() * &linear.right;
    for a in 0..n {
        for b in 0..n {
            let size = (all[(a, a)] * all[(b, b)]).sqrt();
            assert!((information[(a, b)] - all[(a, b)]).abs() <= 1e-8 * size);
        }
        // far below what noise does to it
        let error = (slopes[a] - all[(a, n)]).abs();
        assert!(error <= 1e-3 * all[(a, a)].sqrt(), "{a}: {error:e}");
    }
}

/// With parameters of zero an effect that reads the clock does nothing: repeats are predicted once, and each has the
/// derivatives that it has alone.
#[test]
fn derivatives_at_rest_are_those_of_each_reading() {
    let (mut campaign, fit) = with_repeats();
    for (k, reading) in campaign.readings.iter_mut().enumerate() {
        reading.time = Some(37.0 * (k * k % 101) as f64);
        reading.temperature = Some(18.0 + (k * 7 % 13) as f64);
    }
    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    let whiteners = noise::whiteners(&fit.model, &fit.values, &readings, &campaign.noise.unwrap());
    let mut tried = Vec::new();
    for entry in CATALOGUE.iter().filter(|entry| entry.id != "expression") {
        let effect = effect(entry.id);
        let clock = |need: &Need| matches!(need, Need::Time | Need::Temperature);
        if !effect.needs().iter().any(clock) {
            continue;
        }
        let mut model = fit.model.with(&effect);
        model.setup.time_zero = 1000.0;
        let mut values = fit.values.clone();
        let free: Vec<usize> = (values.len()..model.start().len()).collect();
        values.resize(model.start().len(), 0.0);
        let problem = CampaignProblem::new(&model, &readings, &whiteners, &free, &values);
        let at = vec![0.0; free.len()];
        let pairs = problem
            .blocks(&at)
            .into_iter()
            .zip(problem.blocks_at_rest(&at));
        for (alone, shared) in pairs {
            let size = alone.amax().max(1.0);
            assert!((alone - shared).amax() <= 1e-11 * size, "{}", entry.id);
        }
        tried.push(entry.id);
    }
    tried.sort_unstable();
    assert_eq!(tried, ["frame_drift", "thermal_expansion"]);
}

/// Of many readings a fold takes one step from where the fit of all ended: it must end where a fit without its poses does,
/// though the model lacks an effect and the step leads along a curved valley.
#[test]
fn poses_left_out_of_many_are_predicted_as_by_fits_without_them() {
    let mut scenario = scenario("large");
    scenario.design.poses = 600;
    scenario.design.repeats = 1;
    let campaign = simulate(&scenario, || {}).unwrap();
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
    let options = Options {
        cross_validate: true,
    };
    let found = fit(&campaign, &model, &options, |_| {}).unwrap();
    assert_eq!(found.heldout_by, Some(HeldoutBy::CrossValidation));
    let found = found.heldout.unwrap();

    let readings: Vec<&Reading> = campaign.readings.iter().collect();
    let folds = folds(&readings).0;
    let left_out: Vec<(f64, Errors)> = (0..FOLDS)
        .map(|fold| {
            let mut without = campaign.clone();
            for (reading, own) in without.readings.iter_mut().zip(&folds) {
                if *own == fold {
                    reading.split = Split::Heldout;
                }
            }
            let fit = fitted(&without, &EffectList::DEFAULT);
            (fit.readings.1 as f64, fit.heldout.unwrap())
        })
        .collect();
    let rms = |of: fn(&Errors) -> f64| {
        let squares = left_out.iter().map(|(count, own)| count * of(own).powi(2));
        let count: f64 = left_out.iter().map(|(count, _)| count).sum();
        (squares.sum::<f64>() / count).sqrt()
    };
    let alike = |found: f64, expected: f64| (found / expected - 1.0).abs() < 1e-5;
    let position = rms(|own| own.position_rms_m);
    assert!(
        alike(found.position_rms_m, position),
        "{found:?}, {position}"
    );
    let turn = rms(|own| own.orientation_rms_rad.unwrap());
    assert!(alike(found.orientation_rms_rad.unwrap(), turn), "{turn}");
    let furthest = left_out.iter().map(|(_, own)| own.position_max_m);
    let furthest = furthest.fold(0.0, f64::max);
    let apart = found.position_max_m / furthest - 1.0;
    assert!(apart.abs() < 1e-3, "{apart}");
}

/// Rosenbrock's valley: the first full step leaves its floor, the second ends at the minimum.
#[test]
fn a_curved_valley_is_crossed() {
    struct Valley;
    impl Problem for Valley {
        fn linearise(&self, p: &[f64]) -> Linear {
            let (x, y) = (p[0], p[1]);
            let rows = [-200.0 * x, 100.0, 100.0 * (y - x * x), -1.0, 0.0, 1.0 - x];
            reduce(vec![DMatrix::from_row_slice(2, 3, &rows)], 2)
        }
        fn scale(&self) -> &[f64] {
            &[1.0, 1.0]
        }
        fn bounds(&self) -> &[(f64, f64)] {
            &[(-9.0, 9.0), (-9.0, 9.0)]
        }
        fn prior(&self) -> f64 {
            0.0
        }
    }
    let found = solve(&Valley, &[-1.2, 1.0], &[0.0, 0.0], |_, _| {});
    assert!(found.converged);
    assert!(found.iterations <= 2, "{}", found.iterations);
    assert!(
        found.p.iter().all(|x| (x - 1.0).abs() < 1e-9),
        "{:?}",
        found.p
    );
}

/// One block of any height says what the same rows say in many.
#[test]
fn rows_in_one_block_are_reduced_as_those_in_many() {
    let rows = DMatrix::from_fn(37, 6, |i, k| ((3 * i + 1) as f64 * (k as f64 + 0.7)).sin());
    let many: Vec<_> = (0..37).map(|i| rows.rows(i, 1).into_owned()).collect();
    for blocks in [
        vec![rows.clone()],
        many,
        vec![rows.rows(0, 6).into_owned(), rows.rows(6, 31).into_owned()],
    ] {
        let linear = reduce(blocks, 5);
        let normal = rows.transpose() * &rows;
        let found = linear.factor.transpose() * &linear.factor;
        assert!((found - normal.view((0, 0), (5, 5))).amax() < 1e-12);
        assert!((linear.cost() - normal[(5, 5)]).abs() < 1e-12);
        let slopes = linear.factor.transpose() * &linear.right;
        assert!((slopes - normal.view((0, 5), (5, 1))).amax() < 1e-12);
    }
}

mod does_not_matter {
    use super::*;

    /// The tracker elsewhere, its readings moved with it. The noise is made the same on all axes and at all
    /// distances, or the tracker's place would count.
    #[test]
    fn where_the_tracker_stands() {
        let mut here = ONE_ARM.1.clone();
        here.noise = Some(misfit_campaign::Noise {
            joint: 1e-5,
            ..noise::isotropic(1.5e-5, 8.7e-5)
        });
        let before = springs(&fitted(&here, &EffectList::DEFAULT));
        for seed in 0..3 {
            let there_from_here = motion(&mut random(seed));
            let mut there = here.clone();
            for reading in &mut there.readings {
                let position = nalgebra::Point3::from(reading.position);
                reading.position = (there_from_here * position).coords;
                reading.orientation = reading.orientation.map(|o| there_from_here.rotation * o);
            }
            let found = fitted(&there, &EffectList::DEFAULT);
            assert!(found.converged);
            let after = springs(&found);
            assert_eq!(before.len(), after.len());
            for ((_, a, std), (_, b, other)) in before.iter().zip(&after) {
                // directions of frames and geometry that no reading fixes are parted otherwise; their
                // curvature reaches the springs in the fourth digit of the uncertainty
                assert!((a - b).abs() < 1e-3 * std, "{:e} σ", (a - b) / std);
                assert!((std / other - 1.0).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_order_of_the_readings() {
        let (_, campaign, fit) = &*ONE_ARM;
        let mut shuffled = campaign.clone();
        use rand::seq::SliceRandom;
        shuffled.readings.shuffle(&mut random(5));
        let other = fitted(&shuffled, &EffectList::DEFAULT);
        for ((k, a, _), (_, b, _)) in springs(fit).iter().zip(&springs(&other)) {
            // sums in another order, and one Newton step from the same basin
            assert!(
                (a / b - 1.0).abs() < 1e-9,
                "parameter {k}: {:e}",
                a / b - 1.0
            );
        }
    }

    #[test]
    fn how_many_threads_there_are() {
        let (scenario, campaign, fit) = &*ONE_ARM;
        let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|x| x.to_bits()).collect() };
        for threads in [1, 2, 8] {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            let (again, other) = pool.install(|| {
                let again = simulate(scenario, || {}).unwrap();
                let fit = fitted(&again, &EffectList::DEFAULT);
                (again, fit)
            });
            assert_eq!(again.readings, campaign.readings, "{threads} threads");
            assert_eq!(bits(&other.values), bits(&fit.values), "{threads} threads");
            assert_eq!(
                bits(other.covariance.as_slice()),
                bits(fit.covariance.as_slice()),
                "{threads} threads"
            );
            assert_eq!(other.status, fit.status);
        }
    }
}

mod frames {
    use super::*;

    /// Readings of the nominal, rigid robot, straight from nalgebra's isometries.
    fn ideal(
        setup: &Setup,
        base_from_tracker: &Isometry3<f64>,
        link_from_target: &[Isometry3<f64>],
    ) -> Campaign {
        let mut random = random(7);
        let mut readings = Vec::new();
        for (target, at) in link_from_target.iter().enumerate() {
            for _ in 0..12 {
                let joints = posture(&setup.robot, &mut random);
                let seen = base_from_tracker.inverse() * link_pose(setup, target, &joints) * at;
                readings.push(Reading {
                    position: seen.translation.vector,
                    orientation: Some(seen.rotation),
                    ..reading(target, joints)
                });
            }
        }
        campaign(setup, readings)
    }

    /// Trackers anywhere, also turned by exactly half a turn, where a rotation vector has no sign and a linear
    /// solution may have none either.
    fn trackers() -> Vec<Isometry3<f64>> {
        let axes = [
            Vector3::x(),
            Vector3::y(),
            Vector3::z(),
            Vector3::new(1.0, 1.0, 0.0).normalize(),
            Vector3::new(1.0, -2.0, 3.0).normalize(),
        ];
        let at = Vector3::new(2.5, -1.0, 0.7);
        let half_turns = axes.iter().map(|axis| Isometry3::new(at, axis * PI));
        let mut random = random(8);
        let anywhere = (0..5).map(|_| motion(&mut random));
        [Isometry3::identity()]
            .into_iter()
            .chain(half_turns)
            .chain(anywhere)
            .collect()
    }

    fn targets(count: usize) -> Vec<Isometry3<f64>> {
        let half_turn = Isometry3::new(Vector3::new(0.1, 0.02, -0.05), Vector3::x() * PI);
        let ordinary = Isometry3::new(
            Vector3::new(-0.03, 0.08, 0.12),
            Vector3::new(0.4, 1.0, -2.0),
        );
        [half_turn, ordinary][..count].to_vec()
    }

    /// Fits the frames to readings without error: any that is left says that they were not found.
    #[track_caller]
    fn assert_found(campaign: &Campaign) {
        let model = model_file::frames_only(campaign).unwrap();
        let options = Options {
            cross_validate: false,
        };
        let found = fit(campaign, &model, &options, |_| {}).unwrap();
        assert!(found.converged);
        // readings of some metres, rounded, and differences of the two routes to them
        let left = found.fit.position_rms_m;
        assert!(left < 1e-12, "{left:e} m are left");
        assert!(found.fit.orientation_rms_rad.unwrap_or(0.0) < 1e-12);
    }

    #[test]
    fn are_found_from_anywhere() {
        for setup in [six_axis(), sda5f()] {
            let targets = targets(setup.targets.len());
            for tracker in trackers() {
                assert_found(&ideal(&setup, &tracker, &targets));
            }
        }
    }

    #[test]
    fn are_found_from_positions_alone() {
        for setup in [six_axis(), sda5f()] {
            let targets = targets(setup.targets.len());
            for tracker in trackers() {
                let mut campaign = ideal(&setup, &tracker, &targets);
                for reading in &mut campaign.readings {
                    reading.orientation = None;
                }
                assert_found(&campaign);
            }
        }
    }

    #[test]
    fn are_found_when_one_of_two_targets_has_no_orientation() {
        let setup = sda5f();
        let targets = targets(2);
        for tracker in trackers() {
            let mut campaign = ideal(&setup, &tracker, &targets);
            for reading in campaign.readings.iter_mut().filter(|r| r.target == 1) {
                reading.orientation = None;
            }
            assert_found(&campaign);
        }
    }

    #[test]
    fn are_found_beside_a_known_one() {
        let setup = sda5f();
        let targets = targets(2);
        for tracker in trackers() {
            for with_orientation in [true, false] {
                let mut campaign = ideal(&setup, &tracker, &targets);
                if !with_orientation {
                    for reading in &mut campaign.readings {
                        reading.orientation = None;
                    }
                }
                let mut known_tracker = campaign.clone();
                known_tracker.base_from_tracker = Frame::Known(tracker);
                assert_found(&known_tracker);
                let mut known_targets = campaign.clone();
                known_targets.link_from_target =
                    targets.iter().map(|pose| Frame::Known(*pose)).collect();
                assert_found(&known_targets);
                campaign.link_from_target[1] = Frame::Known(targets[1]);
                assert_found(&campaign);
            }
        }
    }
}

mod cannot_be_seen {
    use super::*;

    #[test]
    fn much_in_a_few_readings() {
        let (_, whole, _) = &*ONE_ARM;
        for count in [1, 2, 3, 10] {
            let mut few = whole.clone();
            few.readings.truncate(count);
            let found = fitted(&few, &EffectList::DEFAULT);
            assert!(
                found.values.iter().all(|x| x.is_finite()),
                "{count} readings"
            );
            assert!(found.fit.position_rms_m.is_finite());
            // six numbers a reading at most
            assert!(
                found.rank <= 6 * count,
                "rank {} of {count} readings",
                found.rank
            );
            let estimated = found
                .status
                .iter()
                .filter(|s| **s == Status::Estimated)
                .count();
            assert!(estimated <= 6 * count, "{estimated} of {count} readings");
            assert!(!found.unobservable.is_empty());
            if count <= 3 {
                let lost = found
                    .status
                    .iter()
                    .filter(|s| **s == Status::Unobservable)
                    .count();
                assert!(
                    2 * lost > found.free.len(),
                    "{lost} of {}",
                    found.free.len()
                );
            }
        }
    }

    /// Its axis is along gravity, whatever hangs on the arm.
    #[test]
    fn the_torsos_spring_under_any_dead_weight() {
        let mut scenario = scenario("efficiency");
        scenario.design.poses = 15;
        for (mass, com) in [(2.0, [0.0, 0.0, 0.0]), (20.0, [0.3, -0.2, 0.1])] {
            scenario.design.loads[1] = DesignLoad {
                mass,
                com: Vector3::from(com),
                pull: Vector3::zeros(),
            };
            let found = fitted(&simulate(&scenario, || {}).unwrap(), &EffectList::DEFAULT);
            assert_eq!(
                status(&found, "joint_compliance", "torso"),
                Status::Unobservable
            );
            // and so it stays where it started, at rigid; a typical value is 1e-4 rad/(N·m)
            let compliance = value(&found, "joint_compliance", "torso");
            assert!(compliance.abs() < 1e-15, "{compliance:e}");
            let why = found.unobservable.iter();
            let why = why
                .filter(|u| u.what == "joint_compliance.torso")
                .collect::<Vec<_>>();
            assert!(
                why.len() == 1 && why[0].why.contains("no reading loads"),
                "{why:?}"
            );
        }
    }

    /// The links beyond the T axis have their masses on it, so a load centred on it too leaves no torque.
    #[test]
    fn the_last_spring_with_a_load_on_its_axis() {
        let mut scenario = scenario("efficiency");
        let last = scenario.setup.robot.joint("r1_t").unwrap();
        let body = &scenario.setup.robot.bodies[last + 1];
        assert_eq!(
            (body.com.x, body.com.y),
            (0.0, 0.0),
            "the link itself is off the axis"
        );
        // geometry errors would move it off the axis
        scenario
            .truth
            .retain(|truth| truth.effect.id() != "geometry");
        scenario.effects = EffectList::only(Role::Spring);
        scenario.design.poses = 15;
        for (com, expected) in [
            ([0.0, 0.0, 0.05], Status::Unobservable),
            ([0.05, 0.0, 0.05], Status::Estimated),
        ] {
            scenario.design.loads[1].com = Vector3::from(com);
            let campaign = simulate(&scenario, || {}).unwrap();
            let found = fitted(&campaign, &scenario.effects);
            assert_eq!(
                status(&found, "joint_compliance", "r1_t"),
                expected,
                "{com:?}"
            );
            assert_eq!(
                status(&found, "joint_compliance", "r1_b"),
                Status::Estimated
            );
        }
    }

    /// Geometry left out of the model, and all of it in the readings: wrong by 70 standard deviations, springs at
    /// their bounds, offsets pulled far along directions that hardly count. The fit still has an end.
    #[test]
    fn the_truth_by_a_model_that_leaves_out_most_of_it() {
        let mut scenario = scenario("springs");
        scenario.design.poses = 10;
        scenario.design.repeats = 1;
        scenario.design.directions = 1;
        for seed in 0..3 {
            scenario.seed = seed;
            let campaign = simulate(&scenario, || {}).unwrap();
            let found = fitted(
                &campaign,
                &EffectList::parse("test", "joint_offset,joint_compliance").unwrap(),
            );
            assert!(found.fit.whitened_rms > 10.0, "{}", found.fit.whitened_rms);
            // fewer than ten are taken; a fit that creeps takes all fifty
            assert!(
                found.converged && found.iterations < 20,
                "{}",
                found.iterations
            );
        }
    }

    /// A rope over a pulley, 20 N sideways, does what no weight can.
    #[test]
    fn the_torsos_spring_until_something_pulls_sideways() {
        let mut scenario = scenario("efficiency");
        scenario.noise.force = 0.05;
        scenario.noise.torque = 0.005;
        scenario.design.loads.push(DesignLoad {
            mass: 0.0,
            com: Vector3::new(0.05, 0.0, 0.05),
            pull: Vector3::new(20.0, 0.0, 0.0),
        });
        let campaign = simulate(&scenario, || {}).unwrap();
        let found = fitted(&campaign, &EffectList::DEFAULT);
        assert!(found.converged);
        let truth = true_values(&scenario, &found.model);
        let index = found.index("joint_compliance", "torso").unwrap();
        assert_eq!(found.status[index], Status::Estimated);
        let std = found.std[index].unwrap();
        assert!(std < 0.1 * truth[index], "{} of it", std / truth[index]);
        // all eight springs; one in 1e6 is beyond 5 σ by chance
        for (k, value, std) in springs(&found) {
            let off = (value - truth[k]) / std;
            assert!(off.abs() < 5.0, "parameter {k}: {off} σ");
        }
    }
}

/// Fraunhofer IPA's robot accuracy data, series C: a UR10 and a laser tracker.
mod ur10 {
    use super::*;
    use crate::measured::measured;

    fn heldout(campaign: &Campaign, effects: &str) -> f64 {
        let found = fitted(campaign, &EffectList::parse("test", effects).unwrap());
        assert!(found.converged);
        assert_eq!(found.readings.1, heldout_count(campaign));
        found.heldout.unwrap().position_rms_m * 1e3
    }

    fn heldout_count(campaign: &Campaign) -> usize {
        let readings = campaign.readings.iter();
        readings
            .filter(|reading| reading.split == Split::Heldout)
            .count()
    }

    /// Each richer model predicts readings better that it has not seen; the figures are those of this data set.
    #[test]
    fn richer_models_predict_better() {
        let Some(path) = measured("fit::ur10::richer_models_predict_better", "series_C.toml")
        else {
            return;
        };
        let campaign = Campaign::load(&path).unwrap();
        let frames = heldout(&campaign, "");
        assert!((0.98..1.00).contains(&frames), "{frames} mm");
        let offsets = heldout(&campaign, "joint_offset");
        assert!(offsets <= 0.551, "{offsets} mm");
        let geometry = heldout(&campaign, "geometry");
        assert!(geometry <= 0.50, "{geometry} mm");
    }
}
