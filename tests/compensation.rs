//! Corrected commands: do they arrive in MuJoCo, as near to the reference as can be, within limits; and what the command
//! line makes of them.

use crate::common::{
    Twins, about_typical, apart, file, payload, posture, random, sda5f, sliding, springs,
};
use assert_cmd::Command;
use misfit_campaign::setup::Setup;
use misfit_campaign::space::Space;
use misfit_campaign::{Reading, Wrench};
use misfit_core::compensation::{End, Reach, Robot, error, solve};
use misfit_core::model::{Prediction, Workspace};
use nalgebra::{DMatrix, Isometry3, Translation3, UnitQuaternion, Vector3, Vector6};
use rand::RngExt;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use tempfile::TempDir;

const STRAIN_WAVE: [f64; 8] = [6e4, 3.5e4, 3.5e4, 1.8e4, 1.8e4, 8e3, 8e3, 6e3];

/// All joints of a target's chain, within their limits.
fn reach(setup: &Setup, target: usize) -> Reach {
    Reach {
        moving: setup.robot.chain(setup.target_body(target)),
        ranges: Space::within_limits(&setup.robot, 0.0).ranges,
    }
}

/// A task: the pose that the nominal robot has at a posture away from every limit.
fn task(setup: &Setup, target: usize, random: &mut impl rand::Rng) -> Reading {
    let ranges = Space::within_limits(&setup.robot, 0.1).ranges;
    let joints: Vec<f64> = ranges
        .iter()
        .map(|&(least, most)| least + (most - least) * random.random::<f64>())
        .collect();
    let pose = crate::common::link_pose(setup, target, &joints);
    Reading {
        position: pose.translation.vector,
        orientation: Some(pose.rotation),
        payload: Some(payload(5.0)),
        ..crate::common::reading(target, joints)
    }
}

fn at(reading: &Reading, joints: &[f64]) -> Reading {
    Reading {
        joints: joints.to_vec(),
        ..reading.clone()
    }
}

/// The error twist against what it is by nalgebra's isometries: the translation between the origins, and the rotation
/// vector of the turn between the axes. 1e-12: rounding at 3 m.
#[test]
fn the_error_is_the_motion_from_the_pose_reached_to_the_pose_wanted() {
    let mut random = random(1);
    let setup = sda5f();
    for _ in 0..200 {
        let reached = crate::common::motion(&mut random);
        let turn = Vector3::from_fn(|_, _| random.random_range(-1e-2..1e-2));
        let moved = Vector3::from_fn(|_, _| random.random_range(-1e-2..1e-2));
        let wanted = Isometry3::from_parts(
            Translation3::from(reached.translation.vector + moved),
            UnitQuaternion::from_scaled_axis(turn) * reached.rotation,
        );
        let prediction = Prediction {
            position: reached.translation.vector,
            orientation: reached.rotation,
            wrench: Vector6::zeros(),
            settled: true,
        };
        let mut task = crate::common::reading(0, posture(&setup.robot, &mut random));
        task.position = wanted.translation.vector;
        task.orientation = Some(wanted.rotation);
        let found = error(&prediction, &task);
        let (linear, angular) = (found.fixed_rows::<3>(0), found.fixed_rows::<3>(3));
        assert!((angular - turn).norm() < 1e-12, "{angular} for {turn}");
        // a screw that turns by φ moves the origin by φ/2 × the way more: second order
        let second = turn.norm() * moved.norm();
        assert!((linear - moved).norm() <= second + 1e-12);
        task.orientation = None;
        let found = error(&prediction, &task);
        assert!((found.fixed_rows::<3>(0) - moved).norm() < 1e-12);
        assert_eq!(found.fixed_rows::<3>(3).norm(), 0.0);
    }
}

/// MuJoCo's own equilibrium under corrected commands, with every kind of error that moves a robot.
/// Asked for: 1 µm, 1 µrad; found: 6e-12 m.
#[test]
fn corrected_commands_arrive_in_mujoco() {
    let setup = sda5f();
    let mut random = random(2);
    let parts = vec![
        about_typical(&setup, "geometry", 1.0, &mut random),
        about_typical(&setup, "transmission_error", 1.0, &mut random),
        about_typical(&setup, "wrist_coupling", 1.0, &mut random),
        springs(&setup, &STRAIN_WAVE),
    ];
    let mut twins = Twins::new(&setup, &parts);
    let (model, values) = (twins.model.clone(), twins.p.clone());
    let robot = Robot::new(&model, &values);
    let mut workspace = Workspace::new(&setup);
    let mut reached = 0;
    for index in 0..120 {
        let target = index % 2;
        let task = task(&setup, target, &mut random);
        let near = (&task.joints[..], &task.joints[..]);
        let found = solve(
            &mut workspace,
            &model,
            &robot.values,
            &task,
            near,
            &reach(&setup, target),
        );
        if found.end != End::Reached {
            continue; // an arm stretched out, a little too short
        }
        reached += 1;
        let missed = |twins: &mut Twins, joints: &[f64]| {
            let (_, state) = twins.measure(&at(&task, joints));
            let wanted =
                Isometry3::from_parts(Translation3::from(task.position), task.orientation.unwrap());
            apart(&state.base_from_link[target], &wanted)
        };
        let before = missed(&mut twins, &task.joints);
        let after = missed(&mut twins, &found.joints);
        assert!(before.0 > 1e-4, "nothing was to be corrected: {before:?}");
        assert!(after.0 < 1e-9 && after.1 < 1e-9, "{index}: {after:?}");
    }
    assert!(reached >= 110, "{reached} of 120");
}

/// Of all commands that reach a pose, the one nearest to the reference: the way back to it has no part along the motion
/// of the joints that leaves the pose (from differences of the prediction, and an SVD of nalgebra's).
#[test]
fn of_all_commands_the_nearest_is_taken() {
    let setup = sda5f();
    let mut random = random(3);
    let twins = Twins::new(
        &setup,
        &[about_typical(&setup, "geometry", 1.0, &mut random)],
    );
    let (model, p) = (&twins.model, &twins.p);
    let mut workspace = Workspace::new(&setup);
    let reach = reach(&setup, 0);
    let mut tried = 0;
    while tried < 20 {
        let task = task(&setup, 0, &mut random);
        // a reference off the pose by tenths of a radian
        let reference: Vec<f64> = task
            .joints
            .iter()
            .map(|q| q + random.random_range(-0.1..0.1))
            .collect();
        let found = solve(
            &mut workspace,
            model,
            p,
            &task,
            (&reference, &reference),
            &reach,
        );
        let inside = |&joint: &usize| {
            let (least, most) = reach.ranges[joint];
            found.joints[joint] > least && found.joints[joint] < most
        };
        if found.end != End::Reached || !reach.moving.iter().all(inside) {
            continue;
        }
        tried += 1;
        const STEP: f64 = 1e-6;
        let mut jacobian = DMatrix::zeros(6, reach.moving.len());
        for (column, &joint) in reach.moving.iter().enumerate() {
            let mut aside = found.joints.clone();
            aside[joint] += STEP;
            let moved = workspace.predict(model, p, &at(&task, &aside));
            jacobian.set_column(column, &(error(&moved, &task) / -STEP));
        }
        let back: Vec<f64> = reach
            .moving
            .iter()
            .map(|&j| reference[j] - found.joints[j])
            .collect();
        let back = nalgebra::DVector::from_vec(back);
        let along = jacobian.clone().pseudo_inverse(1e-9).unwrap() * &jacobian;
        let idle = &back - along * &back;
        // differences of 1e-6; with springs, whose answer the search's Jacobian lacks, it is a thousandth
        assert!(
            idle.norm() < 1e-5 * back.norm(),
            "{} of {}",
            idle.norm(),
            back.norm()
        );
    }
}

/// A joint that slides, joints held, limits, and poses that no command reaches.
#[test]
fn limits_and_held_joints_are_kept_and_said() {
    let mut random = random(4);
    let setup = sda5f();
    let twins = Twins::new(&setup, &[springs(&setup, &STRAIN_WAVE)]);
    let (model, p) = (&twins.model, &twins.p);
    let mut workspace = Workspace::new(&setup);
    let mut at_limit = 0;
    for _ in 0..40 {
        let task = task(&setup, 0, &mut random);
        let near = (&task.joints[..], &task.joints[..]);
        let mut held = reach(&setup, 0);
        held.moving
            .retain(|joint| setup.robot.joints[*joint].name != "torso");
        let found = solve(&mut workspace, model, p, &task, near, &held);
        assert_eq!(found.joints[0], task.joints[0], "the torso moved");
        // a range that ends a milliradian off the posture: the elbow has to stay in it
        let mut narrow = reach(&setup, 0);
        let elbow = setup
            .robot
            .joints
            .iter()
            .position(|j| j.name == "r1_e")
            .unwrap();
        narrow.ranges[elbow] = (task.joints[elbow] + 0.05, task.joints[elbow] + 0.3);
        let found = solve(&mut workspace, model, p, &task, near, &narrow);
        for &joint in &narrow.moving {
            let (least, most) = narrow.ranges[joint];
            assert!((least..=most).contains(&found.joints[joint]));
        }
        // a metre further out than the arm is long
        let mut far = task.clone();
        far.position = far.position.normalize() * 3.0;
        let found = solve(&mut workspace, model, p, &far, near, &reach(&setup, 0));
        assert_ne!(found.end, End::Reached);
        assert!(found.joints.iter().all(|q| q.is_finite()));
        at_limit += usize::from(matches!(found.end, End::AtLimit(_)));
    }
    assert!(at_limit < 40, "never out of reach without a limit");
    let setup = sliding();
    let twins = Twins::new(&setup, &[springs(&setup, &STRAIN_WAVE)]);
    let mut workspace = Workspace::new(&setup);
    let task = Reading {
        orientation: None, // five joints cannot turn as they like
        ..task(&setup, 0, &mut random)
    };
    let near = (&task.joints[..], &task.joints[..]);
    let found = solve(
        &mut workspace,
        &twins.model,
        &twins.p,
        &task,
        near,
        &reach(&setup, 0),
    );
    assert_eq!(found.end, End::Reached);
}

/// An arm that its load folds up is said to collapse, not sent anywhere.
#[test]
fn an_arm_that_cannot_hold_its_load_is_said_to_collapse() {
    let setup = sda5f();
    let twins = Twins::new(&setup, &[springs(&setup, &[20.0; 8])]);
    let mut workspace = Workspace::new(&setup);
    let task = task(&setup, 0, &mut random(5));
    let near = (&task.joints[..], &task.joints[..]);
    let found = solve(
        &mut workspace,
        &twins.model,
        &twins.p,
        &task,
        near,
        &reach(&setup, 0),
    );
    assert_eq!(found.end, End::Collapsed);
}

/// What is wrong with the tracker alone moves no robot: the commands are the same with and without.
#[test]
fn errors_of_the_measurement_are_not_compensated() {
    let setup = sda5f();
    let mut random = random(6);
    for id in ["tracker_scale", "frame_drift", "timestamp_lag"] {
        let parts = [
            springs(&setup, &STRAIN_WAVE),
            about_typical(&setup, id, 10.0, &mut random),
        ];
        let twins = Twins::new(&setup, &parts);
        let robot = Robot::new(&twins.model, &twins.p);
        let term = twins.model.term(id).unwrap();
        assert!(term.of(&twins.p).iter().all(|x| *x != 0.0));
        assert!(term.of(&robot.values).iter().all(|x| *x == 0.0));
        let springs = twins.model.term("joint_compliance").unwrap();
        assert_eq!(springs.of(&twins.p), springs.of(&robot.values));
        assert!(springs.of(&robot.nominal).iter().all(|x| *x == 0.0));
    }
}

/// A process wrench beside the payload's weight: MuJoCo has it as a pull and a moment at the payload's centre.
#[test]
fn a_process_wrench_pulls_beside_the_weight() {
    let setup = sda5f();
    let mut random = random(7);
    let mut twins = Twins::new(&setup, &[springs(&setup, &STRAIN_WAVE)]);
    for _ in 0..20 {
        let mut reading = task(&setup, 0, &mut random);
        reading.payload = Some(payload(2.0));
        let pull = Vector3::from_fn(|_, _| random.random_range(-30.0..30.0));
        let moment = Vector3::from_fn(|_, _| random.random_range(-3.0..3.0));
        let state = twins
            .plant
            .state(&misfit_plant::Command {
                joints: reading.joints.clone(),
                approach: vec![0.0; reading.joints.len()],
                loads: vec![misfit_plant::Load {
                    target: 0,
                    mass: 2.0,
                    com: payload(2.0).com,
                    pull,
                    moment,
                }],
                time: 0.0,
                temperature: 0.0,
            })
            .unwrap();
        let reached = state.base_from_link[0];
        let force = reached.rotation.inverse() * pull;
        reading.process = Some(Wrench {
            force,
            torque: payload(2.0).com.cross(&force) + reached.rotation.inverse() * moment,
        });
        let predicted = twins.predict(&reading);
        let predicted = Isometry3::from_parts(
            Translation3::from(predicted.position),
            predicted.orientation,
        );
        let gap = apart(&predicted, &reached);
        assert!(gap.0 < 1e-12 && gap.1 < 1e-12, "{gap:?}");
        let without = twins.predict(&Reading {
            process: None,
            ..reading.clone()
        });
        assert!((without.position - reached.translation.vector).norm() > 1e-5);
    }
}

/// A campaign of one arm with a gear error, in a folder.
static CELL: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = TempDir::new().unwrap();
    let simulated = misfit(folder.path())
        .args([
            "simulate",
            file("scenarios/hidden.toml").to_str().unwrap(),
            "-o",
            "cell.mcap",
        ])
        .output()
        .unwrap();
    assert!(simulated.status.success());
    folder
});

const HEADER: &str =
    "pose,x_mm,y_mm,z_mm,qw,qx,qy,qz,payload_kg,payload_x_mm,payload_y_mm,payload_z_mm\n";
const GOOD: &str = "a,500,300,1100,0,1,0,0,5,50,0,50\nb,450,100,1000,0,1,0,0,5,50,0,50\n";

fn misfit(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    command.current_dir(folder);
    command
}

/// Exit code, stdout, stderr of `misfit compensate` with these tasks.
fn compensate(tasks: &str, more: &[&str]) -> (Option<i32>, String, String) {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("tasks.csv"), tasks).unwrap();
    let campaign = CELL.path().join("cell.mcap");
    let output = misfit(folder.path())
        .args([
            "compensate",
            campaign.to_str().unwrap(),
            "--tasks",
            "tasks.csv",
        ])
        .args(more)
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let err = text(output.stderr);
    assert!(!err.contains("panicked"), "{err}");
    let out = text(output.stdout);
    if !more.contains(&"--json") {
        assert!(out.lines().all(|line| line.chars().count() <= 100), "{out}");
    }
    (output.status.code(), out, err)
}

#[test]
fn commands_are_written_for_what_is_reached_and_the_rest_is_said() {
    let far =
        format!("{HEADER}{GOOD}far,5000,100,1000,0,1,0,0,5,50,0,50\nany,450,200,900,,,,,0,0,0,0\n");
    let written = CELL.path().join("commands.csv");
    let more = ["--frame", "base", "-o", written.to_str().unwrap()];
    let (code, out, _) = compensate(&far, &more);
    assert_eq!(code, Some(3), "{out}");
    assert!(
        out.contains("out of reach") && out.contains("3 of 4"),
        "{out}"
    );
    assert!(
        out.contains("note     tasks.csv: 1 of 4 readings leave the orientation"),
        "{out}"
    );
    assert!(!out.contains("no column for"), "no posture is named: {out}");
    let some = "x_m,y_m,z_m,r1_s_rad\n0.5,0.3,1.1,0.1\n";
    let (_, out, err) = compensate(some, &["--frame", "base"]);
    assert!(
        out.contains("no column for") && out.contains("r1_l"),
        "{out}{err}"
    );
    let commands = fs::read_to_string(&written).unwrap();
    let lines: Vec<&str> = commands.lines().collect();
    assert_eq!(lines.len(), 4);
    assert!(lines[0].contains("r1_s_rad") && !commands.contains("far"));
    let (code, out, _) = compensate(&format!("{HEADER}{GOOD}"), &["--frame", "base", "--json"]);
    assert_eq!(code, Some(0));
    let document: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(document["schema"], "misfit.compensate/1");
    let first = &document["tasks"][0];
    assert_eq!(first["status"], "corrected");
    let number = |value: &Value| value.as_f64().unwrap();
    assert!(number(&first["before"]["position_m"]) > 1e-3);
    assert!(number(&first["after"]["position_m"]) < 1e-9);
    assert!((1e-6..1e-4).contains(&number(&first["std"]["position_m"])));
}

/// The same command whichever way it is given, and any number of threads.
#[test]
fn the_same_tasks_give_the_same_commands() {
    let tasks = format!("{HEADER}{GOOD}");
    let once = compensate(&tasks, &["--frame", "base", "--json"]);
    let again = compensate(&tasks, &["--frame", "base", "--json"]);
    assert_eq!(once, again);
}

#[test]
fn overload_and_uncertainty_are_said_with_figures() {
    let heavy = format!("{HEADER}e,450,200,1000,0,1,0,0,40,0,0,100\n");
    let (code, out, _) = compensate(&heavy, &["--frame", "base"]);
    assert_eq!(code, Some(0));
    assert!(out.contains("bears") && out.contains("rated 49.0"), "{out}");
    // springs alone, nothing geometric: a pull on the waist, whose spring no hanging weight could show
    let pulled = "pose,x_mm,y_mm,z_mm,qw,qx,qy,qz,fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm\n\
                  p,500,300,1100,0,1,0,0,0,300,0,0,0,0\n";
    let (code, out, _) = compensate(pulled, &["--frame", "base"]);
    assert_eq!(code, Some(0));
    let (_, json, _) = compensate(pulled, &["--frame", "base", "--json"]);
    let document: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(
        document["tasks"][0]["unseen"], "joint_compliance.torso",
        "{out}"
    );
}

#[test]
fn bad_tasks_are_refused_by_file_line_and_column() {
    let cases: [(&str, &[&str], i32, &[&str]); 6] = [
        (
            "a,nan,300,1100,0,1,0,0,5,50,0,50\n",
            &[],
            1,
            &["tasks.csv", "line 2", "x_mm", "nan"],
        ),
        (
            "a,500,300,1100,0,2,0,0,5,50,0,50\n",
            &[],
            1,
            &["tasks.csv", "line 2", "unit quaternion"],
        ),
        (
            "a,500,300,1100,0,1,0,0,-5,50,0,50\n",
            &[],
            1,
            &["payload_kg", "-5"],
        ),
        ("", &[], 1, &["tasks.csv", "header"]),
        (GOOD, &["--hold", "nose"], 2, &["nose", "torso"]),
        (GOOD, &["-o", "commands.txt"], 2, &[".csv", ".mcap"]),
    ];
    for (rows, more, code, words) in cases {
        let (found, out, err) = compensate(&format!("{HEADER}{rows}"), more);
        assert_eq!(found, Some(code), "{rows}: {out}{err}");
        assert!(
            words.iter().all(|word| err.contains(word)),
            "{words:?}: {err}"
        );
    }
}

/// A model file of another robot names joints that this one has not.
#[test]
fn a_model_file_of_another_robot_is_refused() {
    let folder = TempDir::new().unwrap();
    let model = folder.path().join("other.toml");
    fs::write(
        &model,
        "[[effect]]\nkind = \"joint_compliance\"\nhold = true\n[effect.values]\na2 = 1e-6\n",
    )
    .unwrap();
    let more = ["--model", model.to_str().unwrap()];
    let (code, _, err) = compensate(&format!("{HEADER}{GOOD}"), &more);
    assert_eq!(code, Some(1));
    assert!(
        err.contains("other.toml") && err.contains("a2") && err.contains("r1_s"),
        "{err}"
    );
}

/// A scenario that expects nothing of what it does, or of what it does not do, is refused.
#[test]
fn expectations_that_would_check_nothing_are_refused() {
    let folder = TempDir::new().unwrap();
    let text = fs::read_to_string(file("scenarios/compensate_exact.toml")).unwrap();
    let robot = file("models/sda5f/sda5f.urdf");
    let text = text.replace("../models/sda5f/sda5f.urdf", robot.to_str().unwrap());
    let cases = [
        (
            text.replace("[compensate]\nposes  = 500 ", "[other]\nposes  = 500 "),
            "unknown field",
        ),
        (
            text.replace("model                = \"true\"", "model = \"default\""),
            "one of [compensate] models",
        ),
        (
            text.replace("models = [\"true\"]", "models = []"),
            "models is empty",
        ),
        (text.replace("poses  = 500 ", "poses  = 0 "), "poses is 0"),
        (format!("{text}\n[expect]\nconverged = true\n"), "expect"),
        (
            text.replace("models = [\"true\"]", "models = [\"true\", \"+nothing\"]"),
            "+nothing",
        ),
    ];
    for (text, word) in cases {
        let path = folder.path().join("bad.toml");
        fs::write(&path, text).unwrap();
        let output = misfit(folder.path())
            .args(["run", "bad.toml"])
            .output()
            .unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{word}: {err}");
        assert!(err.contains(word), "{word}: {err}");
    }
}

/// The paper's ten poses as bars: each target without and with, and the drop.
#[test]
fn ten_poses_are_drawn() {
    let folder = TempDir::new().unwrap();
    let output = folder.path().to_str().unwrap();
    let out = Command::cargo_bin("misfit")
        .unwrap()
        .args(["run", "scenarios/ten_poses.toml", "-o", output])
        .output()
        .unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let svg = fs::read_to_string(folder.path().join("ten_poses.svg")).unwrap();
    for words in [
        "r1, without compensation",
        "r2, with compensation",
        "position, µm",
        "orientation, mrad",
        "drop of position errors",
        "under 5.00 kg",
    ] {
        assert!(svg.contains(words), "{words}");
    }
    // ten bars in each of eight panels, twenty in the two of the drop
    let bars = svg.matches("<rect").count();
    assert!(bars >= 8 * 10 + 2 * 20, "{bars}");
    assert!(folder.path().join("ten_poses.png").exists());
}

/// What a model goes by, a task must say; a fixed joint stands where the limits have it; what is forbidden is not written;
/// and nothing that is read is written over.
#[test]
fn tasks_keep_to_the_limits_and_to_what_the_model_needs() {
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let misfit = |words: &[&str]| {
        let out = Command::cargo_bin("misfit")
            .unwrap()
            .args(words)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&out.stdout).into_owned()
            + &String::from_utf8_lossy(&out.stderr);
        (out.status.code(), said)
    };
    let campaign = at("hidden.mcap");
    assert_eq!(
        misfit(&["simulate", "scenarios/hidden.toml", "-o", &campaign]).0,
        Some(0)
    );
    let tasks = at("tasks.csv");
    fs::write(&tasks, "x_m,y_m,z_m,payload_kg\n0.5,0.3,1.2,2.0\n").unwrap();
    let base = [
        "compensate",
        &campaign,
        "--tasks",
        &tasks,
        "--frame",
        "base",
    ];
    let with = |more: &[&str]| misfit(&[&base[..], more].concat());

    // any orientation will do: none is claimed
    let (code, said) = with(&["--json"]);
    assert_eq!(code, Some(0), "{said}");
    let document: Value = serde_json::from_str(&said).unwrap();
    assert_eq!(
        document["tasks"][0]["after"]["orientation_rad"],
        Value::Null
    );
    assert_eq!(document["campaign"], "hidden");

    let limits = at("limits.toml");
    fs::write(&limits, "[fixed]\ntorso_deg = 30\n").unwrap();
    let (code, said) = with(&["--limits", &limits, "--json"]);
    assert_eq!(code, Some(0), "{said}");
    let document: Value = serde_json::from_str(&said).unwrap();
    let torso = &document["tasks"][0]["joints"][0];
    assert_eq!(torso["joint"], "torso");
    let angle = torso["command"].as_f64().unwrap();
    assert!((angle - 30_f64.to_radians()).abs() < 1e-12, "{angle}");

    fs::write(&limits, "[[forbidden]]\nr1_l_deg = [-180, 180]\n").unwrap();
    let commands = at("commands.csv");
    let (code, said) = with(&["--limits", &limits, "-o", &commands]);
    assert_eq!(code, Some(3), "{said}");
    assert!(
        said.contains("forbidden") && said.contains("0 commands"),
        "{said}"
    );

    let (code, said) = with(&["--effects", "+backlash"]);
    assert_eq!(code, Some(1), "{said}");
    assert!(
        said.contains("tasks.csv, line 2: backlash is in the model"),
        "{said}"
    );
    assert!(said.contains("approach_<joint>"), "{said}");

    let before = fs::read(&campaign).unwrap();
    for words in [
        vec![
            "export",
            &campaign,
            "-o",
            &campaign.replace(".mcap", ".mcap.json"),
        ],
        vec!["compensate", &campaign, "--tasks", &tasks, "-o", &tasks],
        vec!["compensate", &campaign, "--tasks", &tasks, "-o", &campaign],
    ] {
        let (code, said) = misfit(&words);
        if words[0] == "export" {
            assert_eq!(code, Some(0), "{said}");
            continue;
        }
        assert_eq!(code, Some(1), "{words:?}: {said}");
        assert!(said.contains("which is read here"), "{said}");
    }
    assert_eq!(before, fs::read(&campaign).unwrap());
}
