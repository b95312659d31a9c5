//! Drilling: cutting forces against their source in its own units, contact by statics, holes by what must come out.

use misfit_campaign::Noise;
use misfit_cell::scenario::drill::cutting::{Drill, Layer};
use misfit_cell::scenario::drill::summary::{summary, tare, without};
use misfit_cell::scenario::drill::{Bored, Drilling, Mode, bore};
use misfit_cell::scenario::{Job, Scenario};
use nalgebra::Vector3;
use proptest::prelude::*;
use std::path::Path;

const DRILL: Drill = Drill {
    diameter: 0.5 * 0.0254,
    point_angle: 2.06,
    length: 0.1,
    speed: 5.0,
};

/// Half an inch in steel of 200 kgf/mm² at 0.009 inches a revolution: pounds, inches and psi, as Shaw and Oxford have it.
#[test]
fn thrust_and_torque_are_those_of_the_source_in_pounds_and_inches() {
    let psi = 200.0 * 1422.334;
    let (d, f) = (0.5_f64, 0.009_f64);
    let thrust = 0.195 * psi * f.powf(0.8) * d.powf(0.8) + 0.0022 * psi * d * d;
    let torque = 0.087 * psi * f.powf(0.8) * d.powf(1.8);
    // what tables of drilling give for that drill: 900 lbf and 165 lbf in
    assert!((thrust - 890.0).abs() < 10.0 && (torque - 163.0).abs() < 3.0);
    let block = [Layer {
        thickness: 0.1,
        hardness: 200.0 * 9.80665e6,
    }];
    let need = DRILL.need(&block, 0.05, f * 0.0254);
    assert!((need.thrust / (thrust * 4.448222) - 1.0).abs() < 1e-5);
    assert!((need.torque / (torque * 4.448222 * 0.0254) - 1.0).abs() < 1e-5);
}

/// A cantilever of carbide, by the formula of any handbook: half a millimetre thick, 10 mm long, half of it flutes.
#[test]
fn a_drill_bends_like_a_beam() {
    let drill = Drill {
        diameter: 5e-4,
        length: 1e-2,
        ..DRILL
    };
    let stiffness = 3.0 * 600e9 * 0.5 * std::f64::consts::PI * 5e-4_f64.powi(4) / 64.0 / 1e-6;
    assert!((drill.lateral_stiffness(0.0) / stiffness - 1.0).abs() < 1e-12);
    assert!((drill.lateral_stiffness(5e-3) / (8.0 * stiffness) - 1.0).abs() < 1e-12);
}

proptest! {
    /// The board is what it is, however its layers are cut; nothing is needed outside of it; more feed needs more.
    #[test]
    fn what_a_drill_needs(
        depth in -0.02..0.15_f64,
        feed in 1e-6..1e-3_f64,
        at in 0.01..0.99_f64,
        hard in 1e8..1e10_f64,
        soft in 1e8..1e10_f64,
    ) {
        let layer = |thickness, hardness| Layer { thickness, hardness };
        let board = [layer(0.03, hard), layer(0.05, soft)];
        let cut = [layer(0.03 * at, hard), layer(0.03 * (1.0 - at), hard), layer(0.05, soft)];
        let (a, b) = (DRILL.need(&board, depth, feed), DRILL.need(&cut, depth, feed));
        prop_assert!((a.thrust - b.thrust).abs() <= 1e-9 * a.thrust.max(1.0));
        prop_assert!((a.torque - b.torque).abs() <= 1e-9 * a.torque.max(1.0));
        if depth <= 0.0 || depth >= 0.08 + DRILL.cone() {
            prop_assert_eq!((a.thrust, a.torque), (0.0, 0.0));
        } else {
            let more = DRILL.need(&board, depth, 1.5 * feed);
            prop_assert!(a.thrust >= 0.0 && a.torque >= 0.0);
            prop_assert!(more.thrust >= a.thrust && more.torque >= a.torque);
        }
        prop_assert_eq!(DRILL.need(&board, depth, 0.0).thrust, 0.0);
    }
}

/// The committed scenario without noise, corrected by the plant's own truth: nothing is fitted.
fn quiet(change: impl FnOnce(&mut Scenario, &mut Drilling)) -> (Scenario, Drilling) {
    let mut scenario = Scenario::load(Path::new("scenarios/drill.toml")).unwrap();
    scenario.noise = Noise::default();
    scenario.design.poses = 2;
    let Job::Drill(mut wanted) = scenario.job.clone() else {
        panic!("drill.toml drills nothing");
    };
    wanted.model = "true".to_owned();
    // a thinner board is sooner through
    wanted.layer[1].thickness_mm = 0.5;
    change(&mut scenario, &mut wanted);
    scenario.job = Job::Drill(wanted.clone());
    (scenario, wanted)
}

fn holes(scenario: &Scenario, wanted: &Drilling) -> Vec<Bored> {
    bore(scenario, wanted, || {}).unwrap()
}

/// Newton's third law at every tick, as both MuJoCo sensors have it: what one arm feels of the cut the other feels too.
#[test]
fn both_sensors_are_in_equilibrium() {
    let (scenario, wanted) = quiet(|_, _| {});
    for hole in holes(&scenario, &wanted) {
        let weights = tare(&wanted, &hole);
        let mut cutting = 0;
        for sample in &hole.samples {
            let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
            let both = [
                without(&sample.board, &weights[0]),
                without(&sample.tool, &weights[1]),
            ];
            for (link, wrench) in sample.links.iter().zip(both) {
                let pull = link.rotation * wrench.force;
                force += pull;
                moment += link.rotation * wrench.torque + link.translation.vector.cross(&pull);
            }
            cutting += usize::from(sample.need.thrust > 0.1);
            // the tools turn with the arms that give way: by some 20 µrad of 12 N and 1 N·m
            assert!(
                force.norm() < 1e-3,
                "{:?} at {} s: {force}",
                hole.mode,
                sample.time
            );
            assert!(
                moment.norm() < 1e-3,
                "{:?} at {} s: {moment}",
                hole.mode,
                sample.time
            );
        }
        assert!(cutting > 300, "{cutting}");
    }
}

/// The arms give way, but in the long run the drill goes where it is fed.
#[test]
fn in_the_steady_cut_the_drill_advances_as_it_is_fed() {
    let (scenario, mut wanted) = quiet(|_, _| {});
    wanted.modes = vec![Mode::Corrected];
    let hole = &holes(&scenario, &wanted)[0];
    let steady: Vec<_> = hole
        .samples
        .iter()
        .filter(|s| s.depth > 3e-4 && s.depth < 5e-4)
        .collect();
    let (first, last) = (steady[0], steady[steady.len() - 1]);
    let rate = (last.depth - first.depth) / (last.time - first.time);
    assert!((rate / wanted.feed_rate() - 1.0).abs() < 1e-3, "{rate}");
    let need = wanted
        .drill()
        .need(&wanted.layers(), 4e-4, wanted.feed_um * 1e-6);
    assert!((first.need.thrust / need.thrust - 1.0).abs() < 1e-3);
    // what they give way by is the thrust's: the tip is behind its command
    let commanded = wanted.feed_rate() * (last.time - wanted.approach_s);
    let behind = commanded - last.depth;
    assert!((1e-6..1e-4).contains(&behind), "{behind}");
}

/// Rigid arms without errors: the hole is where it is to be, square, and nothing pushes sideways.
#[test]
fn a_perfect_robot_drills_a_perfect_hole() {
    let (scenario, mut wanted) = quiet(|scenario, _| {
        scenario
            .truth
            .retain(|t| ["tracker_frame", "target_offset"].contains(&t.effect.id()));
    });
    wanted.modes = vec![Mode::Nominal];
    let hole = &holes(&scenario, &wanted)[0];
    let found = summary(&wanted, hole);
    assert!(found.hole_error_m.unwrap() < 1e-9, "{found:?}");
    assert!(
        found.tilt_rad < 1e-9 && found.lateral_peak_N < 1e-6,
        "{found:?}"
    );
    assert!(found.touch_m.abs() < 1e-9, "{found:?}");
    assert_eq!(found.unreached, 0);
}

/// With the true model the loop takes out what the cut bends; without the foil at the back nothing peaks there.
#[test]
fn compensation_takes_out_the_lateral_force_and_the_foil_makes_the_peak() {
    let (scenario, mut wanted) = quiet(|_, _| {});
    let with = holes(&scenario, &wanted);
    let of = |holes: &[Bored], mode: Mode| {
        let hole = holes.iter().find(|hole| hole.mode == mode).unwrap();
        summary(&wanted, hole)
    };
    let (nominal, corrected, looped) = (
        of(&with, Mode::Nominal),
        of(&with, Mode::Corrected),
        of(&with, Mode::Loop),
    );
    assert!(nominal.hole_error_m.unwrap() > 1e-3);
    assert!(corrected.hole_error_m.unwrap() < 5e-6);
    assert!(looped.lateral_steady_N < 0.3 * corrected.lateral_steady_N);
    assert!(corrected.lateral_steady_N < 0.5 * nominal.lateral_steady_N);
    for hole in [nominal, corrected, looped] {
        let back = wanted.layer.iter().map(|l| l.thickness_mm).sum::<f64>() * 1e-3;
        assert!((hole.thrust_peak_depth_m - back).abs() < 5e-5, "{hole:?}");
    }
    wanted.modes = vec![Mode::Corrected];
    // twice as fast the copper at the front makes the higher peak
    let mut fast = wanted.clone();
    fast.feed_um = 2.0;
    let front = summary(&fast, &holes(&scenario, &fast)[0]);
    assert!(front.thrust_peak_depth_m < 1e-3, "{front:?}");
    wanted.layer = vec![wanted.layer[1].clone()];
    let bare = summary(&wanted, &holes(&scenario, &wanted)[0]);
    assert!(bare.thrust_peak_N < 1.03 * bare.thrust_steady_N, "{bare:?}");
}

#[test]
fn holes_are_the_same_for_any_number_of_threads() {
    let (scenario, wanted) = quiet(|scenario, _| {
        scenario.noise.force = 0.02;
        scenario.noise.torque = 1e-3;
    });
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| holes(&scenario, &wanted))
    };
    assert_eq!(by(1), by(3));
}

/// Runs `misfit` on the committed scenario with other keys in `[drill]`, or other text behind it.
fn misfit(command: &str, drill: &str, behind: &str, words: &[&str]) -> std::process::Output {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("changed.toml");
    let text = std::fs::read_to_string("scenarios/drill.toml").unwrap();
    let text = text.replace("../models", concat!(env!("CARGO_MANIFEST_DIR"), "/models"));
    let mut table: toml::Table = toml::from_str(&text).unwrap();
    let other: toml::Table = toml::from_str(drill).unwrap();
    if let Some(toml::Value::Table(own)) = table.get_mut("drill") {
        own.extend(other);
    }
    table.extend(toml::from_str::<toml::Table>(behind).unwrap());
    std::fs::write(&path, toml::to_string(&table).unwrap()).unwrap();
    assert_cmd::Command::cargo_bin("misfit")
        .unwrap()
        .arg(command)
        .arg(&path)
        .args(words)
        .output()
        .unwrap()
}

#[test]
fn what_cannot_be_drilled_is_refused() {
    let table = [
        (
            "board = 'nobody'",
            "",
            "board = \"nobody\" is no target; known: board, drill",
        ),
        ("board = 'drill'", "", "board and tool are one target"),
        ("hole_m = [0.4, nan, 1.0]", "", "accepted: finite numbers"),
        (
            "hole_m = [3.0, 0.0, 1.0]",
            "",
            "no posture of board brings the board to hole_m",
        ),
        ("feed = [0, 0, 0]", "", "accepted: a direction, any vector"),
        (
            "place_mm = [120, 0]",
            "",
            "place_mm[0] is 120, off the board",
        ),
        (
            "diameter_mm = 0",
            "",
            "diameter_mm is 0; accepted: 0.0500 to 20",
        ),
        ("length_mm = 1", "", "length_mm is 1; accepted: 2."),
        ("speed_rpm = -1", "", "speed_rpm is -1; accepted"),
        (
            "feed_um = 1e-3\nrate_hz = 10000",
            "",
            "accepted: at most 200000",
        ),
        ("rate_hz = 0", "", "rate_hz is 0; accepted"),
        ("layer = []", "", "accepted: one or more"),
        (
            "layer = [{ thickness_mm = 1, hardness_HB = -3 }]",
            "",
            "hardness_HB is -3",
        ),
        ("commands = []", "", "accepted: nominal, corrected, loop"),
        ("commands = ['sideways']", "", "unknown variant `sideways`"),
        ("depth = 3", "", "unknown field `depth`"),
        ("filter = { kind = 'low_pass' }", "", "cutoff_hz is missing"),
        ("model = 'nothing'", "", "[drill] model: nothing:"),
        (
            "tool_load = { mass_kg = -1 }",
            "",
            "tool_load: accepted are a finite mass_kg",
        ),
        (
            "commands = ['corrected']",
            "[[expect.drill]]\ncommands = 'loop'",
            "one of [drill] commands: corrected",
        ),
        (
            "",
            "[[expect.drill]]\ncommands = 'loop'",
            "loop expects nothing",
        ),
        (
            "",
            "[expect]\nconverged = true",
            "[expect] of a fit in a scenario with [drill]",
        ),
        ("", "[map]", "[drill] stands beside [map]"),
    ];
    for (drill, behind, message) in table {
        let out = misfit("drill", drill, behind, &[]);
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(1), "{drill} {behind}: {said}");
        assert!(said.contains(message), "{drill} {behind}: {said}");
        assert!(said.contains("changed.toml"), "{drill} {behind}: {said}");
    }
    let out = assert_cmd::Command::cargo_bin("misfit")
        .unwrap()
        .args(["drill", "scenarios/springs.toml"])
        .output()
        .unwrap();
    assert_eq!(out.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&out.stderr).contains("has no [drill]"));
}

/// Every file of a run, and the same from the other command; a missed expectation is exit code 3.
#[test]
fn ticks_curves_and_recordings_are_kept() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    let thin = "layer = [{ thickness_mm = 0.3, hardness_HB = 30 }]\nrate_hz = 50\nfilter = { kind = 'none' }";
    let run = misfit("drill", thin, "", &["-o", folder]);
    let said = String::from_utf8_lossy(&run.stdout).into_owned();
    // so thin a board is never cut steadily in all its expectations' words
    assert_eq!(run.status.code(), Some(3), "{said}");
    assert!(said.contains("MISSED"), "{said}");
    let table = std::fs::read_to_string(out.path().join("changed.drill.csv")).unwrap();
    let mut lines = table.lines();
    assert_eq!(
        lines.next().unwrap(),
        "commands,time_s,depth_mm,thrust_N,torque_Nm,lateral_x_N,lateral_y_N,tilt_mrad,board_fx_N,\
         board_fy_N,board_fz_N,board_tx_Nm,board_ty_Nm,board_tz_Nm,drill_fx_N,drill_fy_N,drill_fz_N,\
         drill_tx_Nm,drill_ty_Nm,drill_tz_Nm"
    );
    let ticks = lines.count();
    assert_eq!(ticks % 3, 0, "three holes");
    for arm in ["board", "drill"] {
        let svg = std::fs::read_to_string(out.path().join(format!("changed.{arm}.svg"))).unwrap();
        for curve in ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz", "loop"] {
            assert!(svg.contains(curve), "{arm}: {curve}");
        }
        assert!(out.path().join(format!("changed.{arm}.png")).exists());
    }
    for mode in ["nominal", "corrected", "loop"] {
        let path = out.path().join(format!("changed.{mode}.mcap"));
        let campaign = misfit_campaign::recording::read_campaign(&path).unwrap();
        // both sensors, by turns
        assert_eq!(campaign.readings.len(), 2 * ticks / 3, "{mode}");
        assert!(campaign.readings.iter().all(|r| r.wrench.is_some()));
        assert_eq!(campaign.readings[0].target, 0);
        assert_eq!(campaign.readings[1].target, 1);
    }
    let again = misfit("run", thin, "", &["--json"]);
    let document: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!(document["drill"]["holes"].as_array().unwrap().len(), 3);
    assert_eq!(document["drill"]["findings"].as_array().unwrap().len(), 4);
}
