//! The contract that every effect of the catalogue keeps, run over all of it on three robots.

use crate::common::{LAWS, Part, Twins, about_typical, apart, effect_on, file, payload, pose_of};
use crate::common::{pose_seen, posture, random, reading, sda5f, six_axis, sliding};
use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Frame, Noise, Payload, Reading, Wrench};
use misfit_core::effects::{CATALOGUE, Place, Stage};
use misfit_core::fit::{Fit, Options, Status, fit};
use misfit_core::model::{Model, Prediction, ROWS, Row, Rows, Workspace};
use misfit_plant::instruments::Seen;
use nalgebra::{DMatrix, Isometry3, Vector3, Vector6};
use rand::{Rng, RngExt};
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Effects that the others are tried beside.
const BASE: [&str; 4] = [
    "tracker_frame",
    "target_offset",
    "geometry",
    "joint_compliance",
];
const SPRINGS: &str = "joint_compliance";
const FRAMES: [&str; 2] = ["tracker_frame", "target_offset"];

fn robots() -> [(&'static str, Setup); 3] {
    [
        ("sda5f", sda5f()),
        ("six_axis", six_axis()),
        ("sliding", sliding()),
    ]
}

/// What the contract is run over: an effect of the catalogue, or a law of a user's own.
struct Case {
    id: &'static str,
}

/// The kind of effect that is a law of a user's own: [`LAWS`] stand for it.
const OWN: &str = "expression";

fn cases() -> impl Iterator<Item = Case> {
    let catalogue = CATALOGUE.iter().map(|entry| entry.id);
    let laws = LAWS.iter().map(|law| law.name);
    let all = catalogue.filter(|id| *id != OWN).chain(laws);
    all.map(|id| Case { id })
}

/// Calls a check for every effect on every robot.
fn for_all(check: impl Fn(&Case, &str, &Setup)) {
    let mut failed = Vec::new();
    for (name, setup) in robots() {
        for entry in &cases().collect::<Vec<_>>() {
            // every effect is tried, whatever becomes of the others
            let what = format!("{} on {name}", entry.id);
            let case = || check(entry, &what, &setup);
            if catch_unwind(AssertUnwindSafe(case)).is_err() {
                failed.push(what);
            }
        }
    }
    assert!(failed.is_empty(), "failed: {}", failed.join(", "));
}

/// A reading with all that an effect may depend on: a load that is known and measured, direction, temperature,
/// time.
fn full_reading(setup: &Setup, target: usize, random: &mut impl Rng) -> Reading {
    let directions = setup.robot.joints.iter();
    Reading {
        payload: Some(payload(5.0)),
        wrench: Some(Wrench {
            force: Vector3::zeros(),
            torque: Vector3::zeros(),
        }),
        approach: Some(
            directions
                .map(|_| if random.random() { 1.0 } else { -1.0 })
                .collect(),
        ),
        temperature: Some(random.random_range(5.0..25.0)),
        time: Some(random.random_range(0.0..5000.0)),
        ..reading(target, posture(&setup.robot, random))
    }
}

/// Sizes of the effects in the base, in typical sizes: springs that a heavy arm bends by milliradians.
fn base(setup: &Setup, without: &str, random: &mut impl Rng) -> Vec<Part> {
    let others = BASE.into_iter().filter(|id| *id != without);
    others
        .map(|id| {
            about_typical(
                setup,
                id,
                if id == "joint_compliance" { 0.1 } else { 1.0 },
                random,
            )
        })
        .collect()
}

/// In the order of the catalogue, as every model has it.
fn sorted(mut parts: Vec<Part>) -> Vec<Part> {
    parts.sort_by_key(|part| {
        CATALOGUE
            .iter()
            .position(|entry| entry.id == part.effect.kind())
    });
    parts
}

/// What the model and the plant say of a wrist wrench, N and N·m.
fn wrench_of(prediction: &Prediction) -> Vector6<f64> {
    prediction.wrench
}

fn wrench_seen(seen: &Seen) -> Vector6<f64> {
    let (f, t) = (seen.wrench.force, seen.wrench.torque);
    Vector6::new(f.x, f.y, f.z, t.x, t.y, t.z)
}

/// How far apart two predictions are: m, rad, and N or N·m.
fn predictions_apart(a: &Prediction, b: &Prediction) -> (f64, f64, f64) {
    let (position, angle) = apart(&pose_of(a), &pose_of(b));
    (position, angle, (a.wrench - b.wrench).amax())
}

fn neutral(setup: &Setup, id: &str) -> Part {
    let effect = effect_on(setup, id);
    let values = vec![0.0; effect.parameters(setup).len()];
    Part { effect, values }
}

#[test]
fn neutral_changes_nothing_in_model_and_plant() {
    for_all(|entry, what, setup| {
        let random = &mut random(11);
        let parts = || base(setup, entry.id, &mut crate::common::random(12));
        let mut without = Twins::new(setup, &sorted(parts()));
        let with = parts().into_iter().chain([neutral(setup, entry.id)]);
        let mut with = Twins::new(setup, &sorted(with.collect()));
        for round in 0..10 {
            let reading = full_reading(setup, round % setup.targets.len(), random);
            let model = predictions_apart(&without.predict(&reading), &with.predict(&reading));
            let (one, other) = (without.measure(&reading).0, with.measure(&reading).0);
            let (position, angle) = apart(&pose_seen(&one), &pose_seen(&other));
            let wrench = (wrench_seen(&one) - wrench_seen(&other)).amax();
            let plant = (position, angle, wrench);
            for (side, (position, angle, wrench)) in [("model", model), ("plant", plant)] {
                // nothing: not even the order of a sum may change by more than its rounding
                let same = position < 1e-14 && angle < 1e-14 && wrench < 1e-12;
                assert!(
                    same,
                    "{what}, {side}: {position:e} m, {angle:e} rad, {wrench:e} N"
                );
            }
        }
    });
}

/// Readings that differ in time and temperature alone are taken for repeats, unless an effect needs either.
#[test]
fn what_does_not_need_the_clock_does_not_read_it() {
    use misfit_core::effects::Need;
    for_all(|entry, what, setup| {
        let random = &mut random(41);
        let mut parts = base(setup, entry.id, random);
        let own = about_typical(setup, entry.id, 1.0, random);
        let reads = |need: &Need| matches!(need, Need::Time | Need::Temperature);
        let needs = own.effect.needs().iter().any(reads);
        parts.push(own);
        let mut twins = Twins::new(setup, &sorted(parts));
        let mut moved = 0;
        for target in 0..setup.targets.len() {
            let reading = full_reading(setup, target, random);
            let mut later = reading.clone();
            later.time = reading.time.map(|time| time + 7e3);
            later.temperature = reading.temperature.map(|warmth| warmth + 3.0);
            for (_, warmth) in &mut later.link_temperatures {
                *warmth += 3.0;
            }
            assert!(later.time.is_some() && later.temperature.is_some());
            let (one, other) = (twins.predict(&reading), twins.predict(&later));
            let same = one.position == other.position
                && one.orientation == other.orientation
                && one.wrench == other.wrench;
            moved += usize::from(!same);
        }
        // both ways: a need that nothing reads would only cost time, but be no need
        assert_eq!(moved > 0, needs, "{what}");
    });
}

#[test]
fn held_is_applied() {
    for_all(|entry, what, setup| {
        let random = &mut random(21);
        let mut parts = base(setup, entry.id, random);
        parts.push(about_typical(setup, entry.id, 1.0, random));
        let parts = sorted(parts);
        let mut free = Twins::new(setup, &parts);
        let mut held = Twins::new(setup, &parts);
        hold(&mut held.model, entry.id, &parts);
        let off = parts.iter().map(|part| match part.effect.id() == entry.id {
            true => neutral(setup, entry.id),
            false => Part {
                effect: part.effect.clone(),
                values: part.values.clone(),
            },
        });
        let mut off = Twins::new(setup, &off.collect::<Vec<_>>());
        let mut moved = 0.0f64;
        for round in 0..10 {
            let reading = full_reading(setup, round % setup.targets.len(), random);
            let here = held.predict(&reading);
            let there = free.predict(&reading);
            assert_eq!(pose_of(&here), pose_of(&there), "{what}");
            assert_eq!(wrench_of(&here), wrench_of(&there), "{what}");
            let (position, angle, wrench) = predictions_apart(&here, &off.predict(&reading));
            moved = moved.max(position).max(angle).max(1e-4 * wrench);
        }
        // a typical size that moves no reading by a micrometre, a microradian or 10 mN is no typical size
        assert!(moved > 1e-6, "{what} does nothing: {moved:e}");
    });
}

/// Holds an effect's parameters at their values.
fn hold(model: &mut Model, id: &str, parts: &[Part]) {
    let part = parts.iter().find(|part| part.effect.id() == id).unwrap();
    let term = model
        .terms
        .iter_mut()
        .find(|term| term.effect.id() == id)
        .unwrap();
    for (parameter, value) in term.parameters.iter_mut().zip(&part.values) {
        parameter.value = *value;
        parameter.vary = false;
    }
}

#[test]
fn derivatives_are_those_of_the_prediction() {
    for_all(|entry, what, setup| {
        let random = &mut random(31);
        let mut parts = base(setup, entry.id, random);
        parts.push(about_typical(setup, entry.id, 1.0, random));
        let twins = Twins::new(setup, &sorted(parts));
        let (model, p) = (&twins.model, &twins.p);
        let mut workspace = Workspace::new(setup);
        let mut jacobian = Rows::zeros(p.len());
        let typical: Vec<f64> = model.parameters().map(|(_, x)| x.typical).collect();
        for round in 0..3 {
            let mut reading = full_reading(setup, round % setup.targets.len(), random);
            if round == 2 {
                // a load that turns with the arm
                reading.payload = None;
                reading.wrench = Some(Wrench {
                    force: crate::common::vector(random) * 50.0,
                    torque: crate::common::vector(random) * 5.0,
                });
            }
            let wanted = vec![true; p.len()];
            workspace.sensitivity(model, p, &wanted, &reading, &mut jacobian);
            for (k, &typical) in typical.iter().enumerate() {
                let analytic = jacobian.column(k) * typical;
                // fourth-order differences; frames have sizes of metres and radians, and a smaller step
                let (id, _) = model.parameters().nth(k).unwrap();
                let largest = if FRAMES.contains(&id) { 1e-3 } else { f64::MAX };
                let step = (1e-2 * typical).min(largest);
                let found = differences(&mut workspace, model, p, &reading, k, step) * typical;
                // Rounding of 1e-15 m over 1e-2 typical sizes, grown by levers and the soft arm's own answer.
                let off = (analytic - found).amax();
                let limit = 1e-11 + 1e-9 * found.amax();
                let name = &model.parameters().nth(k).unwrap().1.name;
                assert!(
                    off < limit,
                    "{what}, {name}: {off:e} beside {:e}",
                    found.amax()
                );
            }
            let none = vec![false; p.len()];
            workspace.sensitivity(model, p, &none, &reading, &mut jacobian);
            assert_eq!(
                jacobian.amax(),
                0.0,
                "{what}: columns not asked for are zero"
            );
        }
    });
}

/// A workspace leaves bodies where they last stood: what it says does not depend on what it was asked before.
#[test]
fn a_used_workspace_says_what_a_fresh_one_does() {
    for_all(|entry, what, setup| {
        let random = &mut random(37);
        let mut parts = base(setup, entry.id, random);
        parts.push(about_typical(setup, entry.id, 1.0, random));
        let twins = Twins::new(setup, &sorted(parts));
        let (model, p) = (&twins.model, &twins.p);
        let wanted = vec![true; p.len()];
        let mut used = Workspace::new(setup);
        let (mut a, mut b) = (Rows::zeros(p.len()), Rows::zeros(p.len()));
        let mut reading = full_reading(setup, 0, random);
        for round in 0..6 {
            // one joint alone, the load alone, all of it, nothing
            match round % 4 {
                0 => reading.joints[round % setup.robot.joints.len()] += 0.3,
                1 => reading.payload = Some(payload(2.0)),
                2 => reading = full_reading(setup, round % setup.targets.len(), random),
                _ => {}
            }
            let found = used.sensitivity(model, p, &wanted, &reading, &mut a);
            let fresh = Workspace::new(setup).sensitivity(model, p, &wanted, &reading, &mut b);
            assert_eq!(found.position, fresh.position, "{what}, {round}");
            assert_eq!(found.orientation, fresh.orientation, "{what}, {round}");
            assert_eq!(found.wrench, fresh.wrench, "{what}, {round}");
            assert_eq!(a, b, "{what}, {round}");
        }
        // from an equilibrium that is near it is the same to rounding
        let near = used.deviations().to_vec();
        reading.joints[0] += 1e-3;
        let far = Workspace::new(setup).predict(model, p, &reading);
        let found = used.prepare(model, p, &reading, &near);
        assert!((found.position - far.position).norm() < 1e-13, "{what}");
    });
}

/// Fourth-order central differences of position, orientation and wrench by one parameter.
fn differences(
    workspace: &mut Workspace,
    model: &Model,
    p: &[f64],
    reading: &Reading,
    k: usize,
    step: f64,
) -> Row {
    let middle = workspace.predict(model, p, reading).orientation;
    let mut at = |steps: f64| {
        let mut p = p.to_vec();
        p[k] += steps * step;
        let there = workspace.predict(model, &p, reading);
        let turn = (there.orientation * middle.inverse()).scaled_axis();
        let x = there.position;
        let mut row = Row::zeros();
        row.fixed_rows_mut::<3>(0).copy_from(&x);
        row.fixed_rows_mut::<3>(3).copy_from(&turn);
        row.fixed_rows_mut::<6>(6).copy_from(&there.wrench);
        row
    };
    ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * step)
}

#[test]
fn plant_and_model_agree_to_second_order() {
    for_all(|entry, what, setup| {
        let gap = |size: f64| {
            // the same random numbers for every size
            let random = &mut random(41);
            let mut parts = vec![about_typical(setup, entry.id, size, random)];
            if entry.id != "joint_compliance" {
                parts.push(about_typical(setup, "joint_compliance", 0.1, random));
            }
            let mut twins = Twins::new(setup, &sorted(parts));
            let gaps = (0..12).map(|round| {
                let reading = full_reading(setup, round % setup.targets.len(), random);
                let (position, angle) = twins.gap(&reading);
                let wrench = wrench_seen(&twins.measure(&reading).0);
                let wrench = wrench - wrench_of(&twins.predict(&reading));
                position.max(angle).max(1e-3 * wrench.amax())
            });
            gaps.fold(0.0, f64::max)
        };
        let (whole, half) = (gap(1.0), gap(0.5));
        // below 1 nm (1 nrad) there is nothing left to halve; a fifth is allowed for terms of third order
        assert!(
            half < 1e-9 || half < whole / 4.0 * 1.2,
            "{what}: {whole:e} at typical size, {half:e} at half of it"
        );
    });
}

/// Twelve poses of each target, without and with 5 kg.
fn design(setup: &Setup, random: &mut impl Rng) -> Vec<Reading> {
    let mut readings = Vec::new();
    for target in 0..setup.targets.len() {
        for pose in 0..12 {
            let reading = full_reading(setup, target, random);
            for mass in [0.0, 5.0] {
                readings.push(Reading {
                    pose: Some(format!("{pose}")),
                    payload: Some(Payload {
                        mass,
                        ..payload(mass)
                    }),
                    ..reading.clone()
                });
            }
        }
    }
    readings
}

fn run(campaign: &Campaign, model: &Model) -> Fit {
    let found = try_run(campaign, model);
    assert!(
        found.converged,
        "not converged in {} steps",
        found.iterations
    );
    found
}

/// A fit that may be of a wrong model, and then need not come to an end.
fn try_run(campaign: &Campaign, model: &Model) -> Fit {
    let options = Options {
        cross_validate: false,
    };
    fit(campaign, model, &options, |_| {}).unwrap()
}

/// A campaign without noise, with the effect in the plant; the instruments' stated noise says how well it is meant.
///
/// An effect on loads also has springs to work through.
fn campaign_with(setup: &Setup, id: &str, random: &mut impl Rng) -> (Campaign, Vec<Part>) {
    let mut parts = FRAMES
        .map(|id| about_typical(setup, id, 1.0, random))
        .into();
    if !FRAMES.contains(&id) {
        // a third of its size: what plant and model differ by at second order stays below a micrometre, even on
        // an arm of a ton that typical springs bend by centimetres
        Vec::push(&mut parts, about_typical(setup, id, 0.3, random));
    }
    if effect_on(setup, id).stage() == Stage::Load {
        parts.push(about_typical(setup, SPRINGS, 0.1, random));
    }
    let parts = sorted(parts);
    let readings = design(setup, random);
    let mut campaign = Twins::new(setup, &parts).campaign(readings);
    campaign.noise = Some(Noise {
        force: 1e-4,
        torque: 1e-5,
        ..misfit_core::fit::noise::isotropic(1e-6, 1e-6)
    });
    (campaign, parts)
}

/// A model of these parts; springs that are there for another effect's sake are held.
fn model_of(setup: &Setup, parts: &[Part], id: &str) -> Model {
    let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
    let mut model = Model::new(setup.clone(), &effects);
    if id != SPRINGS && model.has(SPRINGS) {
        hold(&mut model, SPRINGS, parts);
    }
    model
}

#[test]
fn the_fit_finds_what_the_plant_has() {
    for_all(|entry, what, setup| {
        let (campaign, parts) = campaign_with(setup, entry.id, &mut random(51));
        let mut model = model_of(setup, &parts, entry.id);
        model.hold_known_frames(&campaign);
        let found = run(&campaign, &model);

        let mut estimated = 0;
        for part in &parts {
            let term = found.model.term(part.effect.id()).unwrap();
            for (k, truth) in part.values.iter().enumerate() {
                let index = term.first + k;
                if found.status[index] != Status::Estimated {
                    continue;
                }
                estimated += usize::from(part.effect.id() == entry.id);
                let parameter = &term.parameters[k];
                let std = found.std[index].unwrap();
                // There is no noise: what is left is the pull of the prior, less than a standard deviation in
                // each direction, and the share in directions that no reading fixes, which the standard
                // deviation counts as a typical size; the truth is up to 1.5 of those. Such directions are
                // curved: a typical milliradian along them takes microradians of the others along.
                let limit = 3.0 * std + 5e-3 * parameter.typical.min(1e-3);
                let off = (found.values[index] - truth).abs();
                assert!(
                    off < limit,
                    "{what}, {}: off by {off:e}, std {std:e}",
                    parameter.name
                );
            }
        }
        assert!(estimated > 0, "{what}: nothing is estimated");

        // what is not fixed by these readings at all does no harm: they are met to the noise stated
        assert!(
            found.fit.position_rms_m < 1e-6,
            "{what}: {:e} m",
            found.fit.position_rms_m
        );
        let without = without(setup, &campaign, &parts, entry.id);
        assert!(
            found.fit.whitened_rms < 0.1 * without.fit.whitened_rms,
            "{what}: {} with, {} without",
            found.fit.whitened_rms,
            without.fit.whitened_rms
        );
    });
}

/// The fit of the same without the effect; of a frame, with that frame held where there is none.
fn without(setup: &Setup, campaign: &Campaign, parts: &[Part], id: &str) -> Fit {
    let mut campaign = campaign.clone();
    let nowhere = Frame::Known(Isometry3::identity());
    match id {
        "tracker_frame" => campaign.base_from_tracker = nowhere,
        "target_offset" => campaign.link_from_target.fill(nowhere),
        _ => {}
    }
    let others = parts.iter().filter(|part| {
        let other = part.effect.id();
        other != id || FRAMES.contains(&other)
    });
    let others: Vec<Part> = others
        .map(|part| Part {
            effect: part.effect.clone(),
            values: part.values.clone(),
        })
        .collect();
    let mut model = model_of(setup, &others, id);
    model.hold_known_frames(&campaign);
    try_run(&campaign, &model)
}

#[test]
fn the_fit_leaves_what_is_held() {
    for_all(|entry, what, setup| {
        let (campaign, parts) = campaign_with(setup, entry.id, &mut random(61));
        let mut model = model_of(setup, &parts, entry.id);
        hold(&mut model, entry.id, &parts);
        let found = run(&campaign, &model);
        let part = parts
            .iter()
            .find(|part| part.effect.id() == entry.id)
            .unwrap();
        let first = found.model.term(entry.id).unwrap().first;
        for (k, truth) in part.values.iter().enumerate() {
            assert_eq!(found.values[first + k], *truth, "{what}");
            assert_eq!(found.status[first + k], Status::Held, "{what}");
        }
        // and applies it: with the truth held, nothing is left to the frames but themselves
        assert!(
            found.fit.position_rms_m < 1e-6,
            "{what}: {:e} m",
            found.fit.position_rms_m
        );
    });
}

#[test]
fn derivatives_are_independent_of_the_other_columns() {
    // more parameters than one pass of dual numbers carries, asked for in odd subsets
    let setup = sda5f();
    let random = &mut random(71);
    let twins = Twins::new(&setup, &base(&setup, "", random));
    let mut workspace = Workspace::new(&setup);
    let reading = full_reading(&setup, 1, random);
    let n = twins.p.len();
    let mut all = Rows::zeros(n);
    workspace.sensitivity(&twins.model, &twins.p, &vec![true; n], &reading, &mut all);
    let mut some = Rows::zeros(n);
    let wanted: Vec<bool> = (0..n).map(|k| k % 3 == 1).collect();
    workspace.sensitivity(&twins.model, &twins.p, &wanted, &reading, &mut some);
    let expected = DMatrix::from_fn(
        ROWS,
        n,
        |row, k| if wanted[k] { all[(row, k)] } else { 0.0 },
    );
    assert_eq!(DMatrix::from_fn(ROWS, n, |row, k| some[(row, k)]), expected);
}

#[test]
fn pages_are_complete() {
    for entry in CATALOGUE {
        let path = file(&format!("crates/misfit-core/src/effects/{}.rs", entry.id));
        let source = std::fs::read_to_string(&path);
        let source = source.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let page = entry.page();
        let first = page.lines().next().unwrap();
        assert!(
            source.starts_with(&format!("//! {first}\n")),
            "{}: another file's page",
            entry.id
        );
        assert!(
            entry.summary().ends_with('.'),
            "{}: {:?} is no sentence",
            entry.id,
            entry.summary()
        );
        let headings: Vec<&str> = page
            .lines()
            .filter_map(|line| line.strip_prefix("## "))
            .collect();
        let wanted = ["Law", "Signature", "Confused with", "Plant", "Sources"];
        assert_eq!(headings, wanted, "{}", entry.id);
        for section in page.split("\n## ").skip(1) {
            let (heading, text) = section.split_once('\n').unwrap();
            assert!(
                text.trim().len() > 20,
                "{}: nothing under {heading}",
                entry.id
            );
        }
        let own = entry.id == OWN;
        let example = effect_on(&six_axis(), if own { LAWS[0].name } else { entry.id });
        assert_eq!(example.kind(), entry.id);
        assert_eq!(example.id(), if own { LAWS[0].name } else { entry.id });
        assert_eq!(example.stage(), entry.stage);
        for alias in entry.aliases {
            let other = misfit_core::effects::find(alias).unwrap();
            assert!(
                other.aliases.contains(&entry.id),
                "{} imitates {alias}, but not the other way round",
                entry.id
            );
        }
    }
    let mut ids: Vec<&str> = CATALOGUE.iter().map(|entry| entry.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), CATALOGUE.len(), "an id twice");
}

#[test]
fn parameters_say_the_joint_or_target_that_their_names_begin_with() {
    for_all(|case, what, setup| {
        let effect = effect_on(setup, case.id);
        let entry = misfit_core::effects::find(effect.kind()).unwrap();
        for parameter in effect.parameters(setup) {
            let head = |name: &String| {
                let rest = parameter.name.strip_prefix(name.as_str());
                rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('.'))
            };
            let joint = setup
                .robot
                .joints
                .iter()
                .position(|joint| head(&joint.name));
            let target = setup.targets.iter().position(|target| head(&target.name));
            let place = match (joint, target) {
                (Some(joint), _) => Place::Joint(joint),
                (None, Some(target)) => Place::Target(target),
                (None, None) => Place::Whole,
            };
            assert_eq!(parameter.place, place, "{what}: {}", parameter.name);
            assert_eq!(parameter.joint(), joint, "{what}: {}", parameter.name);
            assert_eq!(parameter.role, entry.role, "{what}: {}", parameter.name);
        }
        // waves are those that the names of their parameters say
        let names = effect.waves(setup).into_iter().flat_map(|(joint, cycles)| {
            let joint = &setup.robot.joints[joint].name;
            ["sin", "cos"].map(|term| format!("{joint}.{term}{cycles}"))
        });
        let names: Vec<String> = names.collect();
        if !names.is_empty() {
            let all: Vec<String> = effect
                .parameters(setup)
                .into_iter()
                .map(|p| p.name)
                .collect();
            assert_eq!(names, all, "{what}");
        }
    });
    let waves = |(_, setup): &(&str, Setup)| effect_on(setup, "gear_ripple").waves(setup).len();
    let counted: usize = robots().iter().map(waves).sum();
    assert!(counted > 0, "no wave was looked at");
}
