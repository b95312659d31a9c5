//! Laws of a user's own: what the contract of the catalogue does not say of them. The formulas themselves are tested in
//! `formula.rs`, the contract in `effects.rs`.

use crate::common::{Part, Twins, campaign, effect, expression, payload, pose_of, posture};
use crate::common::{random, reading, sda5f, six_axis, sliding};
use misfit_arm::formula::Formula;
use misfit_campaign::setup::Setup;
use misfit_campaign::{Reading, Wrench};
use misfit_core::effects::{AnyEffect, Need, Stage, find};
use misfit_core::fit::{FitError, Options, fit};
use misfit_core::model::{Model, Rows, Workspace};
use misfit_plant::{Plant, PlantError, PlantSpec};
use nalgebra::Vector3;
use std::sync::Arc;

/// An expression with parameters `a` and `b`.
fn keys(acts_on: &str, law: &str) -> String {
    let of = |name: &str| format!("{name} = {{ unit = \"1\", typical = 1e-4 }}");
    let names = Formula::parse(law).unwrap().names;
    let used = ["a", "b"].into_iter();
    let used = used.filter(|name| names.iter().any(|mentioned| mentioned.text == *name));
    let used: Vec<String> = used.map(of).collect();
    format!(
        "name = \"own\"\nacts_on = \"{acts_on}\"\nlaw = \"{law}\"\nparameters = {{ {} }}",
        used.join(", ")
    )
}

fn own(setup: &Setup, acts_on: &str, law: &str) -> Arc<dyn AnyEffect> {
    expression(setup, &keys(acts_on, law))
}

/// Predictions and derivatives of two models, the same to rounding.
#[track_caller]
fn assert_same(setup: &Setup, one: &[Part], other: &[Part], columns: &[(usize, usize)]) {
    let random = &mut random(5);
    let (mut one, mut other) = (Twins::new(setup, one), Twins::new(setup, other));
    let mut largest = vec![0.0f64; columns.len()];
    for round in 0..10 {
        let mut reading = loaded(setup, round % setup.targets.len(), random);
        if round > 5 {
            reading.payload = None;
            reading.wrench = Some(Wrench {
                force: Vector3::new(20.0, -30.0, 40.0),
                torque: Vector3::new(3.0, 2.0, -1.0),
            });
        }
        let (a, b) = (
            pose_of(&one.predict(&reading)),
            pose_of(&other.predict(&reading)),
        );
        let (position, angle) = crate::common::apart(&a, &b);
        assert!(
            position < 1e-14 && angle < 1e-14,
            "{position:e} m, {angle:e} rad"
        );
        let jacobian = |twins: &Twins| {
            let mut jacobian = Rows::zeros(twins.p.len());
            let wanted = vec![true; twins.p.len()];
            let mut workspace = Workspace::new(setup);
            workspace.sensitivity(&twins.model, &twins.p, &wanted, &reading, &mut jacobian);
            jacobian
        };
        let (a, b) = (jacobian(&one), jacobian(&other));
        for (&(i, j), largest) in columns.iter().zip(&mut largest) {
            let (a, b) = (a.column(i), b.column(j));
            let off = (a - b).amax();
            *largest = largest.max(a.amax());
            assert!(off <= 1e-12 * a.amax(), "{off:e} of {:e}", a.amax());
        }
    }
    assert!(largest.iter().all(|x| *x > 0.0), "a column says nothing");
}

fn loaded(setup: &Setup, target: usize, random: &mut impl rand::Rng) -> Reading {
    Reading {
        payload: Some(payload(5.0)),
        approach: Some(vec![1.0; setup.robot.joints.len()]),
        temperature: Some(20.0),
        time: Some(100.0),
        ..reading(target, posture(&setup.robot, random))
    }
}

#[test]
fn a_law_that_the_catalogue_has_too_does_the_same() {
    for (setup, joint) in [(six_axis(), "a2"), (sda5f(), "r2_e"), (sliding(), "slide")] {
        let place = setup.observed.iter();
        let place = place.map(|&j| setup.robot.joints[j].name.as_str());
        let place = place.clone().position(|name| name == joint).unwrap();
        let springs = effect("joint_compliance");
        let mut values = vec![1e-5; setup.observed.len()];
        let all = [Part {
            effect: springs.clone(),
            values: values.clone(),
        }];
        values[place] = 0.0;
        let law = own(&setup, &format!("q[{joint}]"), &format!("a*tau[{joint}]"));
        assert_eq!(law.stage(), Stage::Elastic);
        assert_eq!(law.distant(&setup), Vec::<usize>::new());
        let others = [
            Part {
                effect: springs,
                values,
            },
            Part {
                effect: law,
                values: vec![1e-5],
            },
        ];
        let mut columns: Vec<(usize, usize)> = vec![(place, setup.observed.len())];
        let moving = setup.observed.iter().enumerate();
        // springs that no reading loads have columns of zeros
        columns.extend(
            moving
                .filter(|(k, _)| *k != place && *k > 0)
                .map(|(k, _)| (k, k))
                .take(1),
        );
        assert_same(&setup, &all, &others, &columns);
    }
}

#[test]
fn the_sum_of_two_laws_is_one_law() {
    // the second law reads the torque of another joint: the same equilibrium by two ways of finding it
    let setup = six_axis();
    let split = |law: &str, name: &str| {
        let keys = keys("q[a3]", law).replace("\"own\"", &format!("\"{name}\""));
        Part {
            effect: expression(&setup, &keys),
            values: vec![2e-5],
        }
    };
    let both = Part {
        effect: own(&setup, "q[a3]", "a*tau[a3] + b*tau[a2]"),
        values: vec![2e-5, 2e-5],
    };
    assert_eq!(both.effect.distant(&setup), [1, 2]);
    let springs = || Part {
        effect: effect("joint_compliance"),
        values: vec![1e-5; 6],
    };
    let parts = [
        split("a*tau[a3]", "near"),
        split("b*tau[a2]", "far"),
        springs(),
    ];
    assert_same(
        &setup,
        &parts,
        &[both, springs()],
        &[(0, 0), (1, 1), (3, 3)],
    );
}

#[test]
fn a_soft_arm_is_solved_by_newtons_method() {
    // compliances at which the loads follow the motion by more than a tenth
    let setup = six_axis();
    let random = &mut random(7);
    let law = own(&setup, "q[a3]", "a*tau[a2] + b*tanh(tau[a5]/50)*q3");
    let parts = [
        Part {
            effect: effect("joint_compliance"),
            values: vec![0.0, 4e-5, 6e-5, 3e-4, 3e-4, 3e-4],
        },
        Part {
            effect: law,
            values: vec![5e-5, 1e-2],
        },
    ];
    let mut twins = Twins::new(&setup, &parts);
    let mut workspace = Workspace::new(&setup);
    let n = twins.p.len();
    let mut jacobian = Rows::zeros(n);
    for _ in 0..8 {
        let reading = loaded(&setup, 0, random);
        let (position, angle) = twins.gap(&reading);
        assert!(
            position < 1e-10 && angle < 1e-10,
            "{position:e} m, {angle:e} rad"
        );
        workspace.sensitivity(
            &twins.model,
            &twins.p,
            &vec![true; n],
            &reading,
            &mut jacobian,
        );
        for (k, typical) in [(6, 1e-6), (7, 1e-3), (2, 1e-6)] {
            let mut at = |steps: f64| {
                let mut p = twins.p.clone();
                p[k] += steps * typical;
                workspace.predict(&twins.model, &p, &reading).position
            };
            let found = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / 12.0;
            let exact = jacobian.column(k).fixed_rows::<3>(0) * typical;
            assert!(
                (found - exact).amax() < 1e-8 * exact.amax() + 1e-13,
                "{k}: {found} {exact}"
            );
        }
    }
}

#[test]
fn frames_move_as_they_are_told() {
    // by hand: behind a6 of the six-axis arm, in the frame that it moves
    let setup = six_axis();
    let reading = reading(0, vec![0.0; 6]);
    let bare = pose_of(&Twins::new(&setup, &[]).predict(&reading));
    let frame = setup.robot.body_poses(&[0.0; 6])[6];
    for (k, word) in ["tx", "ty", "tz", "rx", "ry", "rz"].into_iter().enumerate() {
        let part = Part {
            effect: own(&setup, &format!("{word}6"), "a*cos(q1)"),
            values: vec![1e-3],
        };
        let mut twins = Twins::new(&setup, &[part]);
        let mut motion = nalgebra::Vector6::zeros();
        motion[k] = 1e-3;
        let linear = Vector3::new(motion[0], motion[1], motion[2]);
        let angular = Vector3::new(motion[3], motion[4], motion[5]);
        let moved = frame * nalgebra::Isometry3::new(linear, angular) * frame.inverse() * bare;
        for pose in [
            pose_of(&twins.predict(&reading)),
            crate::common::pose_seen(&twins.measure(&reading).0),
        ] {
            let (position, angle) = crate::common::apart(&pose, &moved);
            assert!(
                position < 1e-13 && angle < 1e-13,
                "{word}: {position:e} {angle:e}"
            );
        }
        // and the plant tells of no more joints than the robot has
        let state = twins.measure(&reading).1;
        assert_eq!((state.joints.len(), state.joint_torques.len()), (6, 6));
    }
}

#[test]
fn needs_follow_from_the_law() {
    let setup = six_axis();
    let needs = |law: &str| own(&setup, "q3", law).needs().to_vec();
    assert_eq!(needs("a*q2"), []);
    assert_eq!(needs("a*tau2*tau3"), [Need::Load]);
    assert_eq!(
        needs("a*time + b*temperature"),
        [Need::Time, Need::Temperature]
    );
    assert_eq!(
        needs("a*approach1*payload"),
        [Need::Approach, Need::Payload]
    );
    assert_eq!(own(&setup, "q3", "a*q2").stage(), Stage::Rigid);
}

#[test]
fn joints_are_counted_along_a_chain_and_named_anywhere() {
    let chain = six_axis();
    let count = own(&chain, "q3", "a*tau2");
    let named = own(&chain, "q[a3]", "a*tau[a2]");
    let part = |effect| {
        [Part {
            effect,
            values: vec![1e-5],
        }]
    };
    assert_same(&chain, &part(count), &part(named), &[(0, 0)]);

    let refused = |setup: &Setup, acts_on: &str, law: &str| {
        let keys = toml::from_str(&keys(acts_on, law)).unwrap();
        find("expression")
            .unwrap()
            .make(keys)
            .unwrap()
            .check(setup)
            .unwrap_err()
    };
    let message = refused(&chain, "q7", "a*q1");
    assert!(
        message.contains("acts_on is \"q7\": there is no joint 7; known: 1 [a1], 2 [a2]"),
        "{message}"
    );
    let message = refused(&chain, "q0", "a*q1");
    assert!(message.contains("there is no joint 0"), "{message}");
    let message = refused(&chain, "q3", "a*q1 + b*tau99999999999999999999");
    assert!(
        message.contains("there is no joint 18446744073709551615"),
        "{message}"
    );
    assert!(
        message.ends_with("    a*q1 + b*tau99999999999999999999\n             ^"),
        "{message}"
    );
    let message = refused(&chain, "rx[a9]", "a*q1");
    assert!(
        message.contains("no joint before a target is called \"a9\"; known: 1 [a1]"),
        "{message}"
    );
    let message = refused(&sda5f(), "q3", "a*q1");
    assert!(
        message.contains("joints are not counted where arms branch; accepted: [torso], [r1_s]"),
        "{message}"
    );
    // one arm of it is a chain; the other arm's joints are none of a reading's
    let mut one = sda5f();
    one = Setup::new(one.robot.clone(), vec![one.targets[0].clone()], one.gravity);
    let third = own(&one, "q3", "a*q1");
    let named = own(&one, "q[r1_l]", "a*q[torso]");
    assert_same(&one, &part(third), &part(named), &[(0, 0)]);
    let message = refused(&one, "q[r2_s]", "a*q1");
    assert!(
        message.contains("\"r2_s\"; known: 1 [torso], 2 [r1_s]"),
        "{message}"
    );
}

#[test]
fn laws_that_are_not_neutral_are_refused() {
    let setup = six_axis();
    let check = |law: &str| {
        let made = find("expression")
            .unwrap()
            .make(toml::from_str(&keys("q3", law)).unwrap());
        made.unwrap().check(&setup)
    };
    for law in [
        "a*q1",
        "exp(a*q1) - 1",
        "q1*(1 + a) - q1",
        "sin(q1 + a) - sin(q1)",
        "a*sqrt(abs(tau3))",
        "a*ln(q1)",
        "a*tanh(q1*b)",
        "atan2(a, cos(b))",
    ] {
        assert_eq!(check(law), Ok(()), "{law}");
    }
    for (law, part) in [
        ("a + 1", "is 1; accepted: laws that are zero then"),
        ("a*q1 + q2", "at q1 = "),
        ("cos(a*q1)", "is 1 at q1 = "),
        ("a + max(0, tau3)", "at tau3 = "),
        ("a*tanh(q1/b)", "no slope by b"),
        ("a*q1/b", "has no value at any of 32 postures"),
        ("sqrt(a)*q1", "no slope by a"),
    ] {
        let message = check(law).expect_err(law);
        assert!(message.contains(part), "{law}: {message}");
        assert!(message.contains(law), "{law}: {message}");
    }
}

#[test]
fn a_reading_without_a_number_is_refused_with_its_line() {
    let setup = six_axis();
    let random = &mut random(9);
    let readings: Vec<Reading> = (0..20)
        .map(|k| Reading {
            line: k + 2,
            ..loaded(&setup, 0, random)
        })
        .collect();
    let frames = ["tracker_frame", "target_offset"]
        .map(|id| crate::common::about_typical(&setup, id, 1.0, random));
    let campaign = Twins::new(&setup, &frames).campaign(readings);
    let try_fit = |campaign: &misfit_campaign::Campaign, law: &str| {
        let effects: Vec<_> = ["tracker_frame", "target_offset"].map(effect).into();
        let effects = [effects, vec![own(&setup, "q3", law)]].concat();
        let model = Model::new(Setup::of(campaign), &effects);
        let options = Options {
            cross_validate: false,
        };
        fit(campaign, &model, &options, |_| {})
    };
    let refused = |campaign: &misfit_campaign::Campaign, law: &str| match try_fit(campaign, law)
        .expect_err(law)
    {
        FitError::NoNumber {
            line, effect, why, ..
        } => {
            assert_eq!(effect, "own");
            (line, why)
        }
        other => panic!("{law}: {other}"),
    };
    // outside of the logarithm's domain, and of the root's with its slope
    let first = campaign
        .readings
        .iter()
        .find(|r| r.joints[0] < 0.0)
        .unwrap()
        .line;
    assert_eq!(refused(&campaign, "a*ln(q1)").0, first);
    assert_eq!(refused(&campaign, "a*tau3*sqrt(q1)").0, first);
    let mut zero = campaign.clone();
    zero.readings[7].joints[1] = 0.0;
    assert_eq!(refused(&zero, "a*cos(q1)/q2").0, 9);
    // a value, but no slope
    assert_eq!(refused(&zero, "a*q1 + sqrt(q2^2 + b*q1) - abs(q2)").0, 9);
    // held-out readings are not predicted wrongly either
    zero.readings[7].split = misfit_campaign::Split::Heldout;
    assert_eq!(refused(&zero, "a*cos(q1)/q2").0, 9);
    // what the reading does not say
    for (law, part, spoil) in [
        (
            "a*time",
            "column time_s",
            (|r| r.time = None) as fn(&mut Reading),
        ),
        ("a*cos(time)", "column time_s", |r| r.time = None),
        ("a*approach2", "approach_<joint>", |r| r.approach = None),
        ("a*temperature", "temperature_degC", |r| {
            r.temperature = None
        }),
    ] {
        let mut silent = campaign.clone();
        spoil(&mut silent.readings[3]);
        let (line, why) = refused(&silent, law);
        assert_eq!(line, 5, "{law}");
        assert!(why.contains(part), "{law}: {why}");
    }
    // a reading without payload carries none
    let mut bare = campaign.clone();
    bare.readings[3].payload = None;
    assert!(try_fit(&bare, "a*payload").is_ok());
    assert!(try_fit(&campaign, "a*ln(q1 + 10)").is_ok());
}

#[test]
fn an_unchecked_law_predicts_nothing() {
    // a model built without the check that model files make
    let setup = six_axis();
    for (acts_on, law) in [("q9", "a*q1"), ("q3", "a*q9"), ("ry3", "a*tau9")] {
        let made = find("expression")
            .unwrap()
            .make(toml::from_str(&keys(acts_on, law)).unwrap());
        let model = Model::new(setup.clone(), &[made.unwrap()]);
        let reading = loaded(&setup, 0, &mut random(3));
        let found = Workspace::new(&setup).predict(&model, &[1e-4], &reading);
        assert!(!found.settled, "{acts_on} {law}");
    }
}

#[test]
fn the_plant_refuses_what_is_no_number() {
    let setup = six_axis();
    let part = Part {
        effect: own(&setup, "q3", "a*ln(q1)"),
        values: vec![1e-4],
    };
    let mut twins = Twins::new(&setup, &[part]);
    let command = |q1: f64| misfit_plant::Command {
        joints: vec![q1, 0.0, 0.0, 0.0, 0.0, 0.0],
        approach: vec![0.0; 6],
        loads: Vec::new(),
        time: 0.0,
        temperature: 0.0,
    };
    assert!(twins.plant.state(&command(0.5)).is_ok());
    let error = twins.plant.state(&command(-0.5)).unwrap_err();
    assert!(matches!(error, PlantError::Command(_)), "{error}");
}

#[test]
fn a_drive_of_nothing_is_refused() {
    let setup = six_axis();
    for (body, axis) in [(7, 0), (1, 6)] {
        let mut spec = PlantSpec::new(&setup.robot, vec![setup.targets[0].link], setup.gravity);
        assert_eq!(spec.add_drive(body, axis), 6, "behind the joints");
        let Err(error) = Plant::build(&spec) else {
            panic!("a drive of body {body} along {axis}")
        };
        assert!(matches!(error, PlantError::Spec(_)), "{error}");
    }
}

#[test]
fn temperatures_of_links_count_for_the_link_behind_the_joint() {
    let setup = six_axis();
    let link = |body: usize| {
        setup
            .robot
            .links
            .iter()
            .position(|l| l.body == body)
            .unwrap()
    };
    let model = Model::new(setup.clone(), &[own(&setup, "q3", "a*temperature")]);
    let at = |all: Option<f64>, of_link: Option<usize>| {
        let reading = Reading {
            temperature: all,
            link_temperatures: of_link.map(|body| (link(body), 8.0)).into_iter().collect(),
            ..loaded(&setup, 0, &mut random(3))
        };
        let mut workspace = Workspace::new(&setup);
        let found = workspace.predict(&model, &[1e-3], &reading);
        let bare = workspace.predict(&model, &[0.0], &reading);
        found
            .settled
            .then(|| (found.orientation * bare.orientation.inverse()).angle())
    };
    // a joint turns what it carries by its own angle
    assert!((at(Some(5.0), None).unwrap() - 5e-3).abs() < 1e-12);
    assert!((at(Some(5.0), Some(3)).unwrap() - 8e-3).abs() < 1e-12);
    assert!((at(Some(5.0), Some(2)).unwrap() - 5e-3).abs() < 1e-12);
    assert!((at(None, Some(3)).unwrap() - 8e-3).abs() < 1e-12);
    assert_eq!(at(None, Some(2)), None, "nobody measured it");
}

#[test]
fn several_laws_have_their_own_names() {
    let setup = six_axis();
    let random = &mut random(13);
    let made = |name: &str, acts_on: &str, law: &str, value: f64| {
        let keys = keys(acts_on, law).replace("\"own\"", &format!("\"{name}\""));
        Part {
            effect: expression(&setup, &keys),
            values: vec![value],
        }
    };
    let frames = ["tracker_frame", "target_offset"];
    let mut parts: Vec<Part> = frames
        .map(|id| crate::common::about_typical(&setup, id, 1.0, random))
        .into();
    parts.push(made("bent", "rz2", "a*sin(q3)*q4", 3e-4));
    parts.push(made("pulled", "q4", "a*tau3", -2e-6));
    let readings = (0..30).map(|_| loaded(&setup, 0, random)).collect();
    let mut twins = Twins::new(&setup, &parts);
    let mut campaign: misfit_campaign::Campaign = campaign(&setup, Vec::new());
    campaign.readings = twins.campaign(readings).readings;
    campaign.noise = Some(misfit_core::fit::noise::isotropic(1e-7, 1e-7));
    let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
    let options = Options {
        cross_validate: false,
    };
    let found = fit(
        &campaign,
        &Model::new(Setup::of(&campaign), &effects),
        &options,
        |_| {},
    )
    .unwrap();
    assert!(found.converged);
    for (name, truth) in [("bent", 3e-4), ("pulled", -2e-6)] {
        let index = found.index(name, "a").unwrap();
        // second order in the effect's size is what plant and model may differ by
        let off = (found.values[index] / truth - 1.0).abs();
        assert!(off < 2e-3, "{name}: {} for {truth}", found.values[index]);
    }
}
