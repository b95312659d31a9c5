//! Plans: exchange against all designs there are, indices against other formulas, figures of the study, and what a
//! planned design is worth against simulated campaigns.

use crate::common::{self, about_typical, effect, payload, random, sda5f, setup, six_axis};
use misfit_arm::robot::Robot;
use misfit_campaign::setup::Setup;
use misfit_campaign::space::Space;
use misfit_campaign::{Campaign, Noise, Reading};
use misfit_core::fit::{self, Options, Status};
use misfit_core::model::Model;
use misfit_core::plan::criterion::{Apart, Criterion, Determinant, Variances};
use misfit_core::plan::exchange::{draw, exchange, information};
use misfit_core::plan::observability::indices;
use misfit_core::plan::{self, Aim, Outlook, PlanError, Protocol, Task, precise, separate};
use nalgebra::{DMatrix, Quaternion, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::{Rng, RngExt};
use rand_distr::StandardNormal;

/// A random matrix of normal numbers.
fn normal(rows: usize, columns: usize, random: &mut impl Rng) -> DMatrix<f64> {
    DMatrix::from_fn(rows, columns, |_, _| random.sample(StandardNormal))
}

/// Information matrices of candidates with a few rows each, unlike in size, as those of postures are.
fn candidates(count: usize, parameters: usize, seed: u64) -> Vec<DMatrix<f64>> {
    let mut random = random(seed);
    (0..count)
        .map(|_| {
            let size = 10f64.powf(random.random_range(-0.5..0.5));
            let rows = normal(3, parameters, &mut random) * size;
            rows.transpose() * rows
        })
        .collect()
}

/// One of each criterion over six parameters.
fn criteria() -> Vec<(&'static str, Box<dyn Criterion>)> {
    let tests = normal(9, 6, &mut random(9));
    let theta = normal(2, 1, &mut random(10));
    vec![
        ("D", Box::new(Determinant::of(&[0, 1, 2, 3, 4, 5], 6))),
        ("D_s", Box::new(Determinant::of(&[1, 4], 6))),
        (
            "A",
            Box::new(Variances {
                weight: DMatrix::identity(6, 6),
            }),
        ),
        (
            "test poses",
            Box::new(Variances {
                weight: tests.transpose() * tests,
            }),
        ),
        (
            "T",
            Box::new(Apart {
                base: 2,
                effects: [2..4, 4..6],
                sizes: [DMatrix::identity(2, 2), &theta * theta.transpose()],
            }),
        ),
    ]
}

/// Every choice of `count` out of `of`.
fn choices(of: usize, count: usize) -> Vec<Vec<usize>> {
    match (of, count) {
        (_, 0) => vec![Vec::new()],
        (0, _) => Vec::new(),
        _ => {
            let mut all = choices(of - 1, count);
            for mut with in choices(of - 1, count - 1) {
                with.push(of - 1);
                all.push(with);
            }
            all
        }
    }
}

#[test]
fn exchange_finds_the_best_of_all_designs() {
    let nothing = DMatrix::zeros(6, 6);
    for (name, criterion) in criteria() {
        let mut best_of_all = 0;
        for seed in 0..20 {
            let candidates = candidates(11, 6, seed);
            let value =
                |taken: &[usize]| criterion.value(&information(&nothing, &candidates, taken));
            let all: Vec<f64> = choices(11, 4).iter().map(|taken| value(taken)).collect();
            assert_eq!(all.len(), 330);
            let best = all.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let mut draws = random(seed);
            let found = (0..5)
                .map(|_| {
                    let start = draw(11, 4, &mut draws);
                    let from = value(&start);
                    let taken = exchange(criterion.as_ref(), &nothing, &candidates, start);
                    assert!(taken.windows(2).all(|pair| pair[0] < pair[1]));
                    assert_eq!(taken.len(), 4);
                    let reached = value(&taken);
                    assert!(reached >= from, "{name}: exchange made it worse");
                    // no single exchange is left that helps
                    for place in 0..4 {
                        for other in (0..11).filter(|k| !taken.contains(k)) {
                            let mut changed = taken.clone();
                            changed[place] = other;
                            assert!(value(&changed) <= reached + 1e-9 * reached.abs(), "{name}");
                        }
                    }
                    reached
                })
                .fold(f64::NEG_INFINITY, f64::max);
            assert!(found <= best + 1e-9 * best.abs());
            best_of_all += usize::from(found >= best - 1e-9 * best.abs());
        }
        // exchange ends where no single exchange helps; from five starts that is the best of all nearly always
        assert!(best_of_all >= 19, "{name}: {best_of_all} of 20");
    }
}

#[test]
fn gradients_are_differences_and_bound_what_more_readings_bring() {
    let candidates = candidates(12, 6, 3);
    let nothing = DMatrix::zeros(6, 6);
    for (name, criterion) in criteria() {
        for count in [0, 2, 7] {
            let here = information(&nothing, &candidates, &(0..count).collect::<Vec<_>>());
            let (value, gradient) = (criterion.value(&here), criterion.gradient(&here).unwrap());
            for more in &candidates[count..] {
                let slope = gradient.dot(more);
                // forward, extrapolated to second order: with less than no information there is no design; the
                // step is small beside the prior
                let difference = |h: f64| (criterion.value(&(&here + more * h)) - value) / h;
                let rate = 2.0 * difference(1e-6) - difference(2e-6);
                assert!(
                    (slope - rate).abs() < 1e-4 * (1.0 + slope.abs()),
                    "{name}: {slope} {rate}"
                );
                let gain = criterion.value(&(&here + more)) - value;
                assert!(gain <= slope + 1e-9 * (1.0 + slope.abs()), "{name}");
                assert!(
                    gain >= -1e-9 * (1.0 + value.abs()),
                    "{name}: more readings made it worse"
                );
            }
        }
    }
}

#[test]
fn what_tells_apart_is_what_a_projection_leaves() {
    // by QR of the columns to be removed, with the prior as rows
    let mut random = random(5);
    let jacobian = normal(40, 7, &mut random);
    let criterion = Apart {
        base: 3,
        effects: [3..5, 5..7],
        sizes: [DMatrix::identity(2, 2), DMatrix::identity(2, 2)],
    };
    let found = criterion
        .lambdas(&(jacobian.transpose() * &jacobian))
        .unwrap();
    for (own, other, lambda) in [(3..5, 5..7, found[0]), (5..7, 3..5, found[1])] {
        let removed: Vec<usize> = (0..3).chain(other).collect();
        let mut stacked = DMatrix::zeros(40 + 5, 5);
        stacked
            .view_mut((0, 0), (40, 5))
            .copy_from(&jacobian.select_columns(&removed));
        for k in 0..5 {
            stacked[(40 + k, k)] = fit::solve::WEAK;
        }
        let q = stacked.qr().q();
        let mut left = 0.0;
        for column in own {
            let mut x = jacobian
                .column(column)
                .into_owned()
                .resize_vertically(45, 0.0);
            x -= &q * (q.transpose() * &x);
            left += x.norm_squared();
        }
        assert!((left - lambda).abs() < 1e-10 * left);
    }
}

#[test]
fn observability_indices_are_those_of_the_singular_values() {
    // by hand: singular values 6, 3, 2 from 9 rows; the fourth is too small to count
    let information = DMatrix::from_diagonal(&nalgebra::dvector![9.0, 36.0, 0.01, 4.0]);
    let found = indices(&information, 9, 10);
    assert_eq!((found.directions, found.over), (3, 3));
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    close(found.o1, 36f64.cbrt() / 3.0);
    close(found.o2, 1.0 / 3.0);
    close(found.o3, 2.0);
    close(found.o4, 2.0 / 3.0);
    close(found.o5, 1.0);
    // the two strongest alone
    let two = indices(&information, 9, 2);
    assert_eq!((two.directions, two.over), (3, 2));
    close(two.o1, 18f64.sqrt() / 3.0);
    close(two.o3, 3.0);
    // other formulas: a determinant, operator norms, the trace of a covariance's root
    let jacobian = normal(30, 5, &mut random(1));
    let information = jacobian.transpose() * &jacobian;
    let found = indices(&information, 30, 5);
    let inverse = information.clone().try_inverse().unwrap();
    let norm = |m: &DMatrix<f64>| {
        // power iteration
        let mut x = nalgebra::DVector::from_element(5, 1.0);
        for _ in 0..5000 {
            x = (m * x).normalize();
        }
        (m * x).norm()
    };
    let (largest, least) = (norm(&information).sqrt(), norm(&inverse).sqrt().recip());
    let near = |a: f64, b: f64| assert!((a / b - 1.0).abs() < 1e-9, "{a} {b}");
    near(found.o1, information.determinant().powf(0.1) / 30f64.sqrt());
    near(found.o2, least / largest);
    near(found.o3, least);
    near(found.o4, least * least / largest);
    // the root of the inverse by Denman and Beavers
    let (mut y, mut z) = (inverse.clone(), DMatrix::identity(5, 5));
    for _ in 0..40 {
        let next = (&y + z.clone().try_inverse().unwrap()) * 0.5;
        z = (&z + y.try_inverse().unwrap()) * 0.5;
        y = next;
    }
    near(found.o5, 1.0 / y.trace());
    assert_eq!(indices(&DMatrix::zeros(2, 2), 0, 2).directions, 0);
}

/// One arm of the SDA5F whose links weigh nothing: what a load does is then a deflection, with no sag beside it.
fn weightless() -> Setup {
    let mut robot = Robot::load(&common::file("models/sda5f/sda5f.urdf"), None).unwrap();
    for body in &mut robot.bodies {
        body.mass = 0.0;
    }
    setup(robot, &["r1_flange"])
}

/// Strain-wave springs of one arm, N·m/rad.
const SPRINGS: [f64; 8] = [6e4, 3.5e4, 3.5e4, 1.8e4, 1.8e4, 0.8e4, 0.8e4, 0.6e4];

/// A tracker a few metres away, and joints that repeat to 10 µrad. A deflection is a difference of two readings.
fn deflection_noise() -> Noise {
    let twice = 2f64.sqrt();
    Noise {
        joint: 1e-5 * twice,
        ..fit::noise::isotropic(1.6e-5 * twice, 5e-5 * twice)
    }
}

/// Deflections under 5 kg, 50 mm off the axis.
fn deflections<'a>(model: &'a Model, values: &'a [f64], poses: usize, seed: u64) -> Task<'a> {
    let mut space = Space::within_limits(&model.setup.robot, 0.05);
    space.park(&model.setup, &[0], None);
    space.least_height = -10.0;
    Task {
        model,
        values,
        noise: deflection_noise(),
        measured: &[],
        protocol: Protocol {
            targets: vec![0],
            loads: vec![Some(misfit_campaign::Payload {
                mass: 5.0,
                com: Vector3::new(0.05, 0.0, 0.05),
            })],
            directions: vec![None],
            repeats: 1,
            orientation: true,
            wrench: false,
        },
        space,
        poses,
        candidates: 600,
        seed,
    }
}

#[test]
fn chosen_poses_gain_what_the_study_of_seven_springs_found() {
    let setup = weightless();
    let mut model = Model::new(setup.clone(), &[effect("joint_compliance")]);
    // no weight loads the waist; columns in relative sizes, as in the study
    for (parameter, k) in model.terms[0].parameters.iter_mut().zip(SPRINGS) {
        parameter.typical = 1.0 / k;
    }
    model.terms[0].parameters[0].vary = false;
    let values = SPRINGS.map(|k| 1.0 / k);
    let mut gains = [Vec::new(), Vec::new()];
    for seed in 1..6 {
        let task = deflections(&model, &values, 8, seed);
        for (aim, gains) in [Aim::D, Aim::A].into_iter().zip(&mut gains) {
            let found = precise(&task, aim, &["joint_compliance".to_owned()], |_| {}).unwrap();
            let rms = |std: &[Option<f64>]| {
                let relative = std[1..].iter().zip(&SPRINGS[1..]);
                let squares = relative.map(|(std, k)| (std.unwrap() * k).powi(2));
                (squares.sum::<f64>() / 7.0).sqrt()
            };
            gains.push(rms(&found.random.std) / rms(&found.proposed.std));
            // the study's relative deviations of eight random poses: 0.031 to 0.33, rms 0.13
            let random = rms(&found.random.std);
            assert!((0.06..0.3).contains(&random), "{random}");
            assert_eq!(found.proposed.observability.directions, 7);
            assert!(found.proposed.observability.o1 > found.random.observability.o1);
            let accuracies: Vec<f64> = found.curve.iter().map(|step| step.accuracy_m).collect();
            assert!(
                accuracies.windows(2).all(|pair| pair[1] < pair[0]),
                "{accuracies:?}"
            );
        }
    }
    let mean = |gains: &[f64]| gains.iter().sum::<f64>() / gains.len() as f64;
    let [d, a] = [mean(&gains[0]), mean(&gains[1])];
    println!(
        "rms gain of 8 poses: D {d:.2} {:?}, A {a:.2} {:?}",
        gains[0], gains[1]
    );
    // the study found 1.47 and 1.68, on other limits and another tracker
    assert!((1.3..1.9).contains(&d), "D {d}");
    assert!((1.4..2.2).contains(&a), "A {a}");
    assert!(a >= d);
}

#[test]
fn chosen_poses_tell_apart_what_random_ones_hardly_do() {
    let setup = weightless();
    let model = Model::new(setup.clone(), &[effect("joint_compliance")]);
    let values = SPRINGS.map(|k| 1.0 / k);
    // pairs of the study: their gains over random poses there, each way round
    for (a, b, gains) in [
        ("joint_hardening", "gravity_backlash", [4.1, 15.0]),
        ("bearing_tilt", "link_flexibility", [2.9, 5.4]),
        ("base_compliance", "bearing_tilt", [4.8, f64::NAN]),
    ] {
        let task = deflections(&model, &values, 15, 1);
        let found = separate(&task, [&effect(a), &effect(b)], [None, None]).unwrap();
        assert_eq!(found.poses.len(), 15);
        for (way, gain) in found.ways.iter().zip(gains) {
            let reached = way.proposed / way.random;
            println!("{way:?}, gain {reached:.1} ({gain})");
            assert!(way.measured == 0.0 && way.proposed <= way.alone);
            // other limits, tracker and typical sizes, and both ways at once: several-fold is what is asked
            assert!(reached > 2.0, "{way:?}");
        }
    }
}

#[test]
fn some_effects_no_poses_can_tell_apart() {
    // without sag a heavier payload is softer springs, whatever the pose
    let setup = weightless();
    let model = Model::new(setup.clone(), &[effect("joint_compliance")]);
    let values = SPRINGS.map(|k| 1.0 / k);
    let task = deflections(&model, &values, 15, 2);
    let pair = [effect("payload_mass"), effect("joint_compliance")];
    let tenth = Some(&[0.1][..]);
    let found = separate(&task, [&pair[0], &pair[1]], [tenth, None]).unwrap();
    let [mass, springs] = found.ways;
    assert!(mass.alone > 50.0 && mass.proposed < 0.05, "{mass:?}");
    assert_eq!(mass.outlook(), Outlook::Never);
    // the other way round one number for the mass does not make up for seven springs
    assert_eq!(springs.outlook(), Outlook::Decisive, "{springs:?}");
    // what is not loaded from two sides does not show
    let pair = [effect("backlash"), effect("joint_hardening")];
    let found = separate(&task, [&pair[0], &pair[1]], [None, None]).unwrap();
    assert_eq!(found.ways[0].outlook(), Outlook::Unseen);
}

#[test]
fn sizes_found_weigh_the_parameters() {
    let setup = weightless();
    let model = Model::new(setup.clone(), &[effect("joint_compliance")]);
    let values = SPRINGS.map(|k| 1.0 / k);
    let task = deflections(&model, &values, 10, 2);
    let (a, b) = (effect("joint_hardening"), effect("gravity_backlash"));
    let typical: Vec<f64> = a.parameters(&setup).iter().map(|p| p.typical).collect();
    let of = |k: usize| {
        let mut sizes = vec![0.0; typical.len()];
        sizes[k] = 2.0 * typical[k];
        let found = separate(&task, [&a, &b], [Some(&sizes), None]).unwrap();
        found.ways[0].clone()
    };
    // twice a typical size of one joint: four times its λ, which no other joint adds to
    let (third, last) = (of(3), of(7));
    assert!(third.proposed > 0.0 && last.proposed > 0.0);
    let whole = separate(&task, [&a, &b], [None, None]).unwrap().ways[0].clone();
    let one_by_one: f64 = (0..8).map(|k| of(k).alone / 4.0).sum();
    // the designs differ; the order of size does not
    assert!(
        (0.3..3.0).contains(&(one_by_one / whole.alone)),
        "{one_by_one} {whole:?}"
    );
}

#[test]
fn readings_measured_already_count() {
    let setup = weightless();
    let model = Model::new(setup.clone(), &[effect("joint_compliance")]);
    let values = SPRINGS.map(|k| 1.0 / k);
    let first = deflections(&model, &values, 6, 1);
    let chosen = precise(&first, Aim::D, &[], |_| {}).unwrap();
    let measured = plan::visits(&first, &chosen.poses);
    let measured: Vec<&Reading> = measured.iter().collect();
    let then = Task {
        measured: &measured,
        seed: 2,
        ..deflections(&model, &values, 6, 2)
    };
    let found = precise(&then, Aim::D, &[], |_| {}).unwrap();
    let before = found.measured.as_ref().unwrap();
    for (k, (own, then)) in chosen.proposed.std.iter().zip(&before.std).enumerate() {
        match (own, then) {
            (Some(a), Some(b)) => assert!((a / b - 1.0).abs() < 1e-9, "{k}: {a} {b}"),
            (a, b) => assert_eq!(a, b),
        }
    }
    // a label means one pose, in whatever campaign
    let next = plan::visits(&then, &found.poses);
    assert_eq!(measured[5].pose.as_deref(), Some("plan006"));
    assert_eq!(next[0].pose.as_deref(), Some("plan007"));
    for (before, after) in before.std.iter().zip(&found.proposed.std) {
        assert!(before.is_none() || after.unwrap() < before.unwrap());
    }
}

/// A task on the six-axis arm: frames, offsets and springs unknown, no load and 40 kg.
fn whole<'a>(model: &'a Model, values: &'a [f64], poses: usize) -> Task<'a> {
    Task {
        model,
        values,
        noise: fit::noise::isotropic(2e-5, 5e-5),
        measured: &[],
        protocol: Protocol {
            targets: vec![0],
            loads: vec![None, Some(payload(40.0))],
            directions: vec![None],
            repeats: 2,
            orientation: true,
            wrench: false,
        },
        space: Space::within_limits(&model.setup.robot, 0.05),
        poses,
        candidates: 100,
        seed: 4,
    }
}

fn six_axis_model() -> (Model, Vec<f64>) {
    let setup = six_axis();
    let ids = [
        "tracker_frame",
        "target_offset",
        "joint_offset",
        "joint_compliance",
    ];
    let model = Model::new(setup.clone(), &ids.map(effect));
    let mut values = model.start();
    for (place, value) in [2.5, 0.5, 1.0, 0.0, 0.0, 2.5].into_iter().enumerate() {
        values[place] = value;
    }
    let offsets = about_typical(&setup, "joint_offset", 1.0, &mut random(3));
    let springs = [1e-6, 1e-6, 2e-6, 5e-6, 5e-6, 8e-6];
    let first = model.term("joint_offset").unwrap().first;
    values[first..first + 6].copy_from_slice(&offsets.values);
    let first = model.term("joint_compliance").unwrap().first;
    values[first..first + 6].copy_from_slice(&springs);
    (model, values)
}

#[test]
fn a_planned_design_is_worth_what_simulated_campaigns_say() {
    const CAMPAIGNS: usize = 60;
    let (model, values) = six_axis_model();
    let task = whole(&model, &values, 8);
    let found = precise(&task, Aim::A, &[], |_| {}).unwrap();
    let future = plan::visits(&task, &found.poses);
    assert_eq!(future.len(), 8 * task.protocol.readings_a_pose());
    let mut random = random(8);
    let (mut squares, mut count) = (0.0, 0);
    for _ in 0..CAMPAIGNS {
        let mut normal = || Vector3::from_fn(|_, _| random.sample::<f64, _>(StandardNormal));
        let mut readings = future.clone();
        for reading in &mut readings {
            reading.position += normal() * 2e-5;
            let turn = UnitQuaternion::from_scaled_axis(normal() * 5e-5);
            reading.orientation = reading.orientation.map(|seen| turn * seen);
        }
        let campaign = Campaign {
            noise: Some(task.noise),
            ..common::campaign(&model.setup, readings)
        };
        let options = Options {
            cross_validate: false,
        };
        let fit = fit::fit(&campaign, &model, &options, |_| {}).unwrap();
        assert!(fit.converged);
        for (k, std) in found.proposed.std.iter().enumerate() {
            let physical = ["joint_offset", "joint_compliance"]
                .contains(&model.parameters().nth(k).unwrap().0);
            if let (Some(std), Status::Estimated, true) = (std, fit.status[k], physical) {
                squares += ((fit.values[k] - values[k]) / std).powi(2);
                count += 1;
            }
        }
    }
    // six springs and all offsets but the first, which turns with the tracker, or two of them
    assert!(count >= 8 * CAMPAIGNS, "{count}");
    // mean of z²: one, but for chance of √(2 / 600) = 0.06 and more where parameters move together
    let mean = squares / count as f64;
    println!("mean z² {mean:.3} of {count}");
    assert!((0.8..1.2).contains(&mean), "{mean}");
}

#[test]
fn enough_poses_are_as_many_as_the_curve_needs() {
    let (model, values) = six_axis_model();
    let error = |step: &plan::Step, noise: f64| step.accuracy_m.hypot(noise) / noise;
    // asked for few or many, the answer is about the same, and lies where the error passes 5 % above the noise
    let mut answers = Vec::new();
    for poses in [6, 40] {
        let found = precise(&whole(&model, &values, poses), Aim::A, &[], |_| {}).unwrap();
        let enough = found.enough.unwrap();
        let passed = |step: &&plan::Step| error(step, found.noise) <= 1.05;
        let first = found.curve.iter().find(passed).unwrap();
        let before = found.curve.iter().rfind(|step| !passed(step)).unwrap();
        assert!(
            before.poses < enough && enough <= first.poses,
            "{enough} {:?}",
            found.curve
        );
        answers.push(enough as f64);
    }
    assert!((answers[0] / answers[1] - 1.0).abs() < 0.5, "{answers:?}");
}

#[test]
fn the_same_seed_gives_the_same_plan_another_another() {
    let (model, values) = six_axis_model();
    let task = whole(&model, &values, 5);
    let plan = |seed: u64| {
        let task = Task {
            seed,
            ..task.clone()
        };
        precise(&task, Aim::D, &[], |_| {}).unwrap()
    };
    let first = plan(1);
    assert_eq!(first, plan(1));
    assert_ne!(first.poses, plan(2).poses);
    let one = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert_eq!(first, one.install(|| plan(1)));
}

#[test]
fn what_cannot_be_planned_is_an_error() {
    let (model, values) = six_axis_model();
    let task = whole(&model, &values, 5);
    let found = |task: &Task<'_>| precise(task, Aim::D, &[], |_| {}).unwrap_err();
    let mut high = task.clone();
    high.space.least_height = 100.0;
    assert!(matches!(found(&high), PlanError::NoPosture { .. }));
    let mut forbidden = task.clone();
    forbidden.space.forbidden.push(vec![(0, -10.0, 10.0)]);
    assert!(matches!(found(&forbidden), PlanError::NoPosture { .. }));
    let mut still = task.clone();
    for range in &mut still.space.ranges {
        *range = (0.1, 0.1);
    }
    assert!(matches!(found(&still), PlanError::NoFreedom { .. }));
    let mut heavy = task.clone();
    heavy.protocol.loads = vec![Some(payload(1e300))];
    assert!(matches!(
        found(&heavy),
        PlanError::Collapses { held: 0, .. }
    ));
    let unknown = precise(&task, Aim::D, &["backlash".to_owned()], |_| {});
    assert_eq!(
        unknown,
        Err(PlanError::Nothing {
            effect: "backlash".to_owned()
        })
    );
}

#[test]
fn a_protocol_is_read_off_a_campaign() {
    let setup = sda5f();
    let mut readings = Vec::new();
    for pose in 0..5 {
        let joints = vec![0.1 * f64::from(pose); setup.robot.joints.len()];
        for mass in [0.0, 5.0] {
            for sign in [-1.0, 1.0] {
                for _ in 0..3 {
                    let mut reading = common::reading(1, joints.clone());
                    reading.payload = Some(payload(mass));
                    reading.approach = Some(vec![sign; joints.len()]);
                    reading.orientation =
                        Some(UnitQuaternion::new_normalize(Quaternion::identity()));
                    readings.push(reading);
                }
            }
        }
    }
    let all: Vec<&Reading> = readings.iter().collect();
    let found = Protocol::of(&setup, &all);
    let expected = Protocol {
        targets: vec![1],
        loads: vec![Some(payload(0.0)), Some(payload(5.0))],
        directions: vec![Some(-1.0), Some(1.0)],
        repeats: 3,
        orientation: true,
        wrench: false,
    };
    assert_eq!(found, expected);
    // a load that only the wrist sensor knows: 5 kg, turned with the link
    for reading in &mut readings {
        let weight = common::link_pose(&setup, 1, &reading.joints)
            .rotation
            .inverse_transform_vector(&(setup.gravity * reading.payload.unwrap().mass));
        reading.wrench = Some(misfit_campaign::Wrench {
            force: weight,
            torque: payload(5.0).com.cross(&weight),
        });
        reading.payload = None;
    }
    let all: Vec<&Reading> = readings.iter().collect();
    let loads = Protocol::of(&setup, &all).loads;
    assert_eq!(loads.len(), 2);
    assert!(loads[0].is_none() && (loads[1].unwrap().mass - 5.0).abs() < 1e-9);
    // a campaign with a payload of its own in every pose: the lightest and the heaviest
    for (k, reading) in readings.iter_mut().enumerate() {
        reading.payload = Some(payload(k as f64));
    }
    let all: Vec<&Reading> = readings.iter().collect();
    let loads = Protocol::of(&setup, &all).loads;
    assert_eq!(loads, [Some(payload(0.0)), Some(payload(59.0))]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn proposed_poses_keep_to_limits_heights_and_forbidden_postures(
        seed in 0u64..1000,
        margin in 0.0..0.3,
        height in -0.2..0.6,
        fixed in -1.0..1.0,
        low in -1.5..0.0,
        wide in 0.5..1.5,
    ) {
        let setup = six_axis();
        let mut space = Space::within_limits(&setup.robot, margin);
        space.least_height = height;
        space.ranges[3] = (fixed, fixed);
        space.forbidden.push(vec![(0, low, low + wide), (1, -0.5, 2.0)]);
        space.forbidden.push(vec![(4, low, low + wide)]);
        let model = Model::new(setup.clone(), &[effect("joint_compliance")]);
        let values = vec![1e-6; 6];
        let task = Task { space, candidates: 12, seed, ..whole(&model, &values, 4) };
        let found = precise(&task, Aim::D, &[], |_| {}).unwrap();
        prop_assert_eq!(found.poses.len(), 4);
        for pose in &found.poses {
            for (joint, q) in setup.robot.joints.iter().zip(pose) {
                let (lower, upper) = joint.limits.unwrap();
                let spare = margin * (upper - lower);
                let still = joint.name == setup.robot.joints[3].name;
                prop_assert!(still || (*q >= lower + spare && *q <= upper - spare));
            }
            prop_assert_eq!(pose[3], fixed);
            let inside = |joint: usize, low: f64, high: f64| (low..=high).contains(&pose[joint]);
            prop_assert!(!(inside(0, low, low + wide) && inside(1, -0.5, 2.0)));
            prop_assert!(!inside(4, low, low + wide));
            let link = common::link_pose(&setup, 0, pose);
            prop_assert!(link.translation.z >= height);
        }
    }
}
