//! The contract that every effect of the catalogue keeps, run over all of it on three robots.

use crate::common::{Part, Twins, about_typical, apart, effect, file, payload, pose_of, pose_seen};
use crate::common::{posture, random, reading, sda5f, six_axis, sliding};
use misfit::campaign::{Campaign, Frame, Payload, Reading};
use misfit::effects::{AnyEffect, CATALOGUE, Entry};
use misfit::fit::{Fit, Options, Status, fit};
use misfit::model::{Model, Rows6, Workspace};
use misfit::setup::Setup;
use nalgebra::{DMatrix, Isometry3, Vector6};
use rand::{Rng, RngExt};
use std::sync::Arc;

/// Effects that the others are tried beside.
const BASE: [&str; 4] = [
    "tracker_frame",
    "target_offset",
    "geometry",
    "joint_compliance",
];
const FRAMES: [&str; 2] = ["tracker_frame", "target_offset"];

fn robots() -> [(&'static str, Setup); 3] {
    [
        ("sda5f", sda5f()),
        ("six_axis", six_axis()),
        ("sliding", sliding()),
    ]
}

/// Calls a check for every effect on every robot.
fn for_all(check: impl Fn(&Entry, &str, &Setup)) {
    for (name, setup) in robots() {
        for entry in CATALOGUE {
            check(entry, &format!("{} on {name}", entry.id), &setup);
        }
    }
}

/// A reading with all that an effect may depend on: load, direction, temperature, time.
fn full_reading(setup: &Setup, target: usize, random: &mut impl Rng) -> Reading {
    let directions = setup.robot.joints.iter();
    Reading {
        payload: Some(payload(5.0)),
        approach: Some(
            directions
                .map(|_| if random.random() { 1.0 } else { -1.0 })
                .collect(),
        ),
        temperature: Some(31.0),
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
            .position(|entry| entry.id == part.effect.id())
    });
    parts
}

fn neutral(setup: &Setup, id: &str) -> Part {
    let effect = effect(id);
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
            let model = apart(
                &pose_of(&without.predict(&reading)),
                &pose_of(&with.predict(&reading)),
            );
            let plant = apart(
                &pose_seen(&without.measure(&reading).0),
                &pose_seen(&with.measure(&reading).0),
            );
            for (side, (position, angle)) in [("model", model), ("plant", plant)] {
                // nothing: not even the order of a sum may change by more than its rounding
                let same = position < 1e-14 && angle < 1e-14;
                assert!(same, "{what}, {side}: {position:e} m, {angle:e} rad");
            }
        }
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
            let here = pose_of(&held.predict(&reading));
            assert_eq!(here, pose_of(&free.predict(&reading)), "{what}");
            let (position, angle) = apart(&here, &pose_of(&off.predict(&reading)));
            moved = moved.max(position).max(angle);
        }
        // a typical size that moves no reading by a micrometre or microradian is no typical size
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
        let mut jacobian = Rows6::zeros(p.len());
        let typical: Vec<f64> = model.parameters().map(|(_, x)| x.typical).collect();
        for round in 0..3 {
            let mut reading = full_reading(setup, round % setup.targets.len(), random);
            if round == 2 {
                // a load that turns with the arm
                reading.payload = None;
                reading.wrench = Some(misfit::campaign::Wrench {
                    force: crate::common::vector(random) * 50.0,
                    torque: crate::common::vector(random) * 5.0,
                });
            }
            let wanted = vec![true; p.len()];
            workspace.sensitivity(model, p, &wanted, &reading, &mut jacobian);
            for (k, &typical) in typical.iter().enumerate() {
                let analytic = jacobian.column(k) * typical;
                // fourth-order differences; frames have sizes of metres and radians, and a smaller step
                let step = (1e-2 * typical).min(1e-3);
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

/// Fourth-order central differences of position and orientation by one parameter.
fn differences(
    workspace: &mut Workspace,
    model: &Model,
    p: &[f64],
    reading: &Reading,
    k: usize,
    step: f64,
) -> Vector6<f64> {
    let middle = workspace.predict(model, p, reading).orientation;
    let mut at = |steps: f64| {
        let mut p = p.to_vec();
        p[k] += steps * step;
        let there = workspace.predict(model, &p, reading);
        let turn = (there.orientation * middle.inverse()).scaled_axis();
        let x = there.position;
        Vector6::new(x.x, x.y, x.z, turn.x, turn.y, turn.z)
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
                position.max(angle)
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

fn fitted(setup: &Setup, campaign: &Campaign, effects: &[Arc<dyn AnyEffect>]) -> Fit {
    let mut model = Model::new(setup.clone(), effects);
    model.hold_known_frames(campaign);
    run(campaign, &model)
}

fn run(campaign: &Campaign, model: &Model) -> Fit {
    let options = Options {
        cross_validate: false,
    };
    let found = fit(campaign, model, &options, |_| {}).unwrap();
    assert!(
        found.converged,
        "not converged in {} steps",
        found.iterations
    );
    found
}

/// A campaign without noise, with the effect in the plant; the tracker's stated noise says how well it is meant.
fn campaign_with(setup: &Setup, id: &str, random: &mut impl Rng) -> (Campaign, Vec<Part>) {
    let ids = FRAMES
        .iter()
        .copied()
        .chain((!FRAMES.contains(&id)).then_some(id));
    let parts: Vec<Part> = ids
        .map(|id| about_typical(setup, id, 1.0, random))
        .collect();
    let parts = sorted(parts);
    let readings = design(setup, random);
    let mut campaign = Twins::new(setup, &parts).campaign(readings);
    campaign.noise = Some(misfit::fit::noise::isotropic(1e-6, 1e-6));
    (campaign, parts)
}

#[test]
fn the_fit_finds_what_the_plant_has() {
    for_all(|entry, what, setup| {
        let (campaign, parts) = campaign_with(setup, entry.id, &mut random(51));
        let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
        let found = fitted(setup, &campaign, &effects);

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
        let without = without(setup, &campaign, entry.id);
        assert!(
            found.fit.whitened_rms < 0.1 * without.fit.whitened_rms,
            "{what}: {} with, {} without",
            found.fit.whitened_rms,
            without.fit.whitened_rms
        );
    });
}

/// The fit of the frames alone; of a frame, with that frame held where there is none.
fn without(setup: &Setup, campaign: &Campaign, id: &str) -> Fit {
    let mut campaign = campaign.clone();
    let nowhere = Frame::Known(Isometry3::identity());
    match id {
        "tracker_frame" => campaign.base_from_tracker = nowhere,
        "target_offset" => campaign.link_from_target.fill(nowhere),
        _ => {}
    }
    fitted(setup, &campaign, &FRAMES.map(effect))
}

#[test]
fn the_fit_leaves_what_is_held() {
    for_all(|entry, what, setup| {
        let (campaign, parts) = campaign_with(setup, entry.id, &mut random(61));
        let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
        let mut model = Model::new(setup.clone(), &effects);
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
    let mut all = Rows6::zeros(n);
    workspace.sensitivity(&twins.model, &twins.p, &vec![true; n], &reading, &mut all);
    let mut some = Rows6::zeros(n);
    let wanted: Vec<bool> = (0..n).map(|k| k % 3 == 1).collect();
    workspace.sensitivity(&twins.model, &twins.p, &wanted, &reading, &mut some);
    let expected = DMatrix::from_fn(6, n, |row, k| if wanted[k] { all[(row, k)] } else { 0.0 });
    assert_eq!(DMatrix::from_fn(6, n, |row, k| some[(row, k)]), expected);
}

#[test]
fn pages_are_complete() {
    for entry in CATALOGUE {
        let path = file(&format!("src/effects/{}.rs", entry.id));
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
        assert_eq!(effect(entry.id).id(), entry.id);
        assert_eq!(effect(entry.id).stage(), entry.stage);
    }
    let mut ids: Vec<&str> = CATALOGUE.iter().map(|entry| entry.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), CATALOGUE.len(), "an id twice");
}
