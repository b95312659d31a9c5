//! Compensation in the loop: what MuJoCo's statics say must be left, and what the command line makes of it.

use crate::common::file;
use assert_cmd::Command;
use misfit_campaign::recording::read_campaign;
use misfit_cell::scenario::control_loop::{Looped, hold};
use misfit_cell::scenario::simulate::plant_spec;
use misfit_cell::scenario::{Job, Scenario};
use misfit_plant::{Load, Plant};
use nalgebra::{Matrix3, Vector3};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// A scenario of one arm with springs and an odd geometry, with this noise and these tables.
fn write(folder: &Path, noise: &str, more: &str) -> PathBuf {
    let robot = file("models/sda5f/sda5f.urdf");
    let text = format!(
        "robot = {:?}\nseed = 5\n[[target]]\nname = \"r1\"\nlink = \"r1_flange\"\n\
         [noise]\nposition_m = 1e-6\norientation_rad = 1e-6\n{noise}\n\
         [[truth]]\nkind = \"joint_compliance\"\npreset = \"strain_wave\"\n\
         [[truth]]\nkind = \"geometry\"\nrandom = 1.0\n\
         [design]\nposes = 2\n{more}\n",
        robot.to_str().unwrap()
    );
    let path = folder.join("held.toml");
    fs::write(&path, text).unwrap();
    path
}

fn held(noise: &str, more: &str) -> (Scenario, Looped) {
    let folder = TempDir::new().unwrap();
    let scenario = Scenario::load(&write(folder.path(), noise, more)).unwrap();
    let Job::Loop(wanted) = scenario.job.clone() else {
        panic!("no loop");
    };
    let mut all = hold(&scenario, &wanted, || {}).unwrap();
    assert_eq!(all.len(), 1);
    let looped = all.remove(0);
    assert_eq!(looped.left_out, 0);
    assert!(looped.filters.iter().all(|filter| filter.unreached == 0));
    (scenario, looped)
}

const FILTERS: &str = "
[[loop.filter]]
kind = \"none\"
[[loop.filter]]
kind     = \"moving_average\"
window_s = 0.05
[[loop.filter]]
kind      = \"low_pass\"
cutoff_hz = 10.0
order     = 1
[[loop.filter]]
kind      = \"low_pass\"
cutoff_hz = 10.0
";

/// The same, and each once more with a look ahead.
fn with_predictions() -> String {
    let ahead = FILTERS.replace("\n[[", "\npredict = true\n[[");
    // the first header comes before any keys
    let ahead = ahead.replacen("\npredict = true", "", 1);
    format!("{FILTERS}\n{ahead}\npredict = true\n")
}

const LOOP: &str = "[loop]
rate_hz    = 200
duration_s = 1.0
poses      = 2
payload    = { mass_kg = 1.5, com_m = [0.02, -0.01, 0.05] }
models     = [\"true\"]
";

/// A pull that stays, an exact model: once it is felt, nothing is left but that the hand, and with it the wrench in its
/// frame, turns by the first correction, and by the second no more. A sensor whose bias is known changes nothing (of a
/// scale the model keeps the first order).
#[test]
fn a_load_that_stays_is_corrected_wholly() {
    let pull = "[[loop.pull]]\nshape = \"step\"\nforce_N = [10.0, -20.0, -30.0]\nat_m = [0.0, 0.01, 0.1]\n";
    let sensor = "[[truth]]\nkind = \"ft_bias\"\nvalues = { fx = 2.0, fz = -1.0, ty = 0.2 }\n";
    for sensor in ["", sensor] {
        let filter = "[[loop.filter]]\nkind = \"none\"\n";
        let more = format!("{LOOP}{pull}{filter}{sensor}").replace("200", "20");
        let (_, looped) = held("", &more);
        assert_eq!(looped.traces.len(), 2);
        for trace in &looped.traces {
            let missed = |tick: usize| trace.moments[tick].after.norm();
            assert!(missed(0) > 1e-4, "nothing to correct: {}", missed(0));
            assert_eq!(trace.moments[0].after, trace.moments[0].before);
            assert!(missed(1) < 1e-2 * missed(0), "{}", missed(1));
            for tick in 2..20 {
                assert!(missed(tick) < 1e-9, "{tick}: {}", missed(tick));
            }
        }
        assert!(looped.at_once.most.position_m < 1e-10);
    }
}

/// m a N, of the target's position in the tracker's frame (here the base's) by a force at the link's origin (base frame):
/// differences of MuJoCo's own states under a command.
fn compliance(scenario: &Scenario, joints: &[f64], at: Vector3<f64>) -> Matrix3<f64> {
    let spec = plant_spec(scenario).unwrap();
    let mut plant = Plant::build(&spec).unwrap();
    let mut position = |pull: Vector3<f64>| {
        let tool = Load {
            target: 0,
            mass: 1.5,
            com: Vector3::new(0.02, -0.01, 0.05),
            pull: Vector3::zeros(),
            moment: Vector3::zeros(),
        };
        let pulled = Load {
            target: 0,
            mass: 0.0,
            com: at,
            pull,
            moment: Vector3::zeros(),
        };
        let state = plant.state(&misfit_plant::Command {
            joints: joints.to_vec(),
            approach: vec![1.0; joints.len()],
            loads: vec![tool, pulled],
            time: 0.0,
            temperature: 0.0,
        });
        state.unwrap().base_from_link[0].translation.vector
    };
    const PULL: f64 = 5.0;
    let mut columns = Matrix3::zeros();
    for axis in 0..3 {
        let mut pull = Vector3::zeros();
        pull[axis] = PULL;
        let moved = (position(pull) - position(-pull)) / (2.0 * PULL);
        columns.set_column(axis, &moved);
    }
    columns
}

/// A ramp is followed late: by the filter's delay and one tick. What is left is delay × rate of the pull × compliance, both
/// vectors and MuJoCo's; with the look ahead nothing. 2 %: the arm's compliance changes as it is pulled; a follower load's
/// own changes are of second order.
#[test]
fn a_ramp_leaves_its_delay_times_its_rate_times_the_compliance() {
    let pull = "[[loop.pull]]\nshape = \"ramp\"\nforce_N = [12.0, -8.0, -20.0]\nat_m = [0.0, 0.0, 0.1]\nover_s = 1.0\n";
    let (scenario, looped) = held("", &format!("{LOOP}{pull}{}", with_predictions()));
    let rate = Vector3::new(12.0, -8.0, -20.0);
    assert_eq!(looped.filters.len(), 8);
    for trace in &looped.traces {
        let filtered = &looped.filters[trace.filter];
        // by then the slowest filter has settled to a thousandth
        let moment = &trace.moments[180];
        let compliance = compliance(&scenario, &moment.command, Vector3::new(0.0, 0.0, 0.1));
        // the error is the way from the pose reached to the one wanted
        let late = -compliance * rate * filtered.delay_s;
        let found = moment.after.fixed_rows::<3>(0).into_owned();
        assert!(late.norm() > 1e-6, "{late}");
        if filtered.foreseen_s > 0.0 {
            assert!((filtered.foreseen_s - filtered.delay_s).abs() < 1e-12);
            assert!(
                found.norm() < 5e-3 * late.norm(),
                "{}: {}",
                filtered.filter,
                found.norm()
            );
        } else {
            let gap = (found - late).norm();
            assert!(
                gap < 0.02 * late.norm(),
                "{}: {gap} of {}",
                filtered.filter,
                late.norm()
            );
        }
    }
}

/// Noise of the force alone: the position's part from it is gain × compliance × noise, over 2 poses × 1000 ticks. 10 %: a
/// thousand ticks of a slow filter hold about a hundred independent ones, of three axes.
#[test]
fn noise_leaves_its_gain_times_the_compliance() {
    let more =
        format!("{LOOP}{}", with_predictions()).replace("duration_s = 1.0", "duration_s = 5.0");
    let (scenario, looped) = held("force_N = 0.5", &more);
    let start = |pose: usize| {
        let trace = looped.traces.iter().find(|t| t.pose == pose).unwrap();
        trace.moments[0].command.clone()
    };
    let squares: f64 = (0..2)
        .map(|pose| compliance(&scenario, &start(pose), Vector3::zeros()).norm_squared())
        .sum();
    let of_one = 0.5 * (squares / 2.0).sqrt();
    for filtered in &looped.filters {
        let wanted = filtered.noise_gain * of_one;
        let found = filtered.noise.position_m;
        assert!(
            (found / wanted - 1.0).abs() < 0.1,
            "{}: {found} for {wanted}",
            filtered.filter
        );
        // nothing moves: there is no delay, and the model is true
        assert!(filtered.lag.position_m < 1e-10);
        assert!((filtered.errors.rms.position_m / found - 1.0).abs() < 1e-6);
    }
}

fn misfit(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    command.current_dir(folder);
    command
}

/// The same bytes on one thread and on two: what is printed, the table and the recordings.
#[test]
fn loops_are_the_same_on_any_number_of_threads_and_kept() {
    let folder = TempDir::new().unwrap();
    let pull = "[[loop.pull]]\nshape = \"sine\"\nforce_N = [0.0, 0.0, 20.0]\nfrequency_hz = 3.0\nat_s = 0.2\nuntil_s = 0.8\n";
    let more = format!("{LOOP}{pull}{}", with_predictions());
    write(folder.path(), "force_N = 0.2\ntorque_Nm = 0.01", &more);
    let kept = |threads: &str| {
        let output = misfit(folder.path())
            .env("RAYON_NUM_THREADS", threads)
            .args(["run", "held.toml", "-o", threads])
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let mut names: Vec<String> = fs::read_dir(folder.path().join(threads))
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        let bytes: Vec<Vec<u8>> = names
            .iter()
            .map(|name| fs::read(folder.path().join(threads).join(name)).unwrap())
            .collect();
        (output.stdout, names, bytes)
    };
    let one = kept("1");
    assert!(one == kept("2"), "two threads give other bytes");
    let out = String::from_utf8(one.0).unwrap();
    assert!(out.lines().all(|line| line.chars().count() <= 100), "{out}");
    for words in ["no inertia", "WORSE", "best ", "moving average 50 ms"] {
        assert!(out.contains(words), "{words}: {out}");
    }
    assert_eq!(one.1.len(), 8 + 2, "{:?}", one.1);
    let table = fs::read_to_string(folder.path().join("1/held.loop.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 8 * 2 * 200);
    let header = table.lines().next().unwrap();
    for column in [
        "time_s",
        "measured_fz_N",
        "filtered_tx_Nm",
        "foreseen_fy_N",
        "command_r1_s_rad",
        "before_x_m",
        "after_rz_rad",
    ] {
        assert!(header.split(',').any(|word| word == column), "{column}");
    }
    let recording = folder
        .path()
        .join("1/held.loop_1_2_moving_average_50_ms.mcap");
    let campaign = read_campaign(&recording).unwrap();
    assert_eq!(campaign.readings.len(), 2 * 200);
    let (first, last) = (&campaign.readings[0], &campaign.readings[399]);
    assert_eq!(
        (first.time, last.time),
        (Some(0.0), Some(1.0 + 199.0 / 200.0))
    );
    assert!(last.wrench.is_some() && last.joints != first.joints);
    let result = fs::read_to_string(folder.path().join("1/held.result.json")).unwrap();
    let document: Value = serde_json::from_str(&result).unwrap();
    let filters = &document["loop"][0]["filters"];
    assert_eq!(filters.as_array().unwrap().len(), 8);
    let number = |value: &Value| value.as_f64().unwrap();
    // 10 ticks of 5 ms: 4.5 of its own, one until the command acts
    assert!((number(&filters[1]["delay_s"]) - 0.0275).abs() < 1e-12);
    assert!(number(&filters[1]["reduction"]) > 0.0);
}

/// What is wrong is refused by key, with what would be accepted; an expectation that is missed ends with exit code 3.
#[test]
fn loops_that_make_no_sense_are_refused() {
    let folder = TempDir::new().unwrap();
    let good = format!("{LOOP}{FILTERS}");
    let run = |more: &str| {
        write(folder.path(), "", more);
        let output = misfit(folder.path())
            .args(["run", "held.toml"])
            .output()
            .unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        (
            output.status.code(),
            text(output.stdout),
            text(output.stderr),
        )
    };
    let loop_with = |from: &str, to: &str| {
        assert!(good.contains(from), "{from}");
        good.replacen(from, to, 1)
    };
    let expect = |keys: &str| format!("{good}\n[[expect.loop]]\n{keys}\n");
    let pull = |keys: &str| format!("{good}\n[[loop.pull]]\nforce_N = [1.0, 0.0, 0.0]\n{keys}\n");
    let cases: [(String, &[&str]); 24] = [
        (loop_with("200", "0"), &["rate_hz is 0", "100000"]),
        (loop_with("= 1.0", "= 0.001"), &["duration_s is 0.001"]),
        (loop_with("= 1.0", "= 1e6"), &["ticks", "at most 1000000"]),
        (
            loop_with("poses      = 2", ""),
            &["poses = N", "posture_rad"],
        ),
        (loop_with("poses      = 2", "poses = 0"), &["poses is 0"]),
        (
            loop_with("poses      = 2", "posture_rad = { nose = 1.0 }"),
            &["nose", "r1_s"],
        ),
        (
            loop_with("poses      = 2", "posture_rad = { r1_s = 9.0 }"),
            &["r1_s is 9", "limits"],
        ),
        (
            loop_with("poses      = 2", "poses = 2\ntarget = \"r3\""),
            &["r3", "known: r1"],
        ),
        (loop_with("= 1.5", "= -1.5"), &["payload", "mass_kg"]),
        (loop_with("[\"true\"]", "[]"), &["models is empty"]),
        (LOOP.to_owned(), &["[[loop.filter]]", "none"]),
        (
            format!("{good}\n[[loop.filter]]\nkind = \"none\"\n"),
            &["none", "twice"],
        ),
        (loop_with("window_s = 0.05", ""), &["window_s is missing"]),
        (
            loop_with("window_s = 0.05", "window_s = 0.001"),
            &["0 ticks"],
        ),
        (
            loop_with("cutoff_hz = 10.0", "cutoff_hz = 120.0"),
            &["cutoff_hz is 120", "90"],
        ),
        (
            loop_with("order     = 1", "order = 3"),
            &["order is 3", "1, 2"],
        ),
        (
            loop_with("window_s = 0.05", "window_s = 0.05\norder = 2"),
            &["order", "another kind"],
        ),
        (pull("shape = \"ramp\""), &["over_s is missing"]),
        (
            pull("shape = \"step\"\nfrequency_hz = 2.0"),
            &["frequency_hz", "another shape"],
        ),
        (
            pull("shape = \"sine\"\nfrequency_hz = 2.0\nat_s = 1.0\nuntil_s = 0.5"),
            &["until_s is 0.5"],
        ),
        (
            expect("model = \"true\"\nfilter = \"none\""),
            &["expects nothing", "position_rms_um"],
        ),
        (
            expect("model = \"true\"\nfilter = \"low pass\"\nreduction = 0.1"),
            &["low pass", "low pass 10 Hz, order 1"],
        ),
        (
            expect("model = \"true\"\nfilter = \"none\"\nposition_rms_um = [9.0, 2.0]"),
            &["[9, 2] holds no number", "[least, most]"],
        ),
        (
            expect("model = \"default\"\nfilter = \"none\"\nreduction = 0.1"),
            &["default", "true"],
        ),
    ];
    for (more, words) in cases {
        let (code, out, err) = run(&more);
        assert_eq!(code, Some(1), "{words:?}: {out}{err}");
        let all = [&["held.toml"], words].concat();
        assert!(
            all.iter().all(|word| err.contains(word)),
            "{words:?}: {err}"
        );
    }
    for (more, word) in [
        (
            format!("{good}\n[expect]\nconverged = true\n"),
            "[[expect.loop]]",
        ),
        (format!("{good}\n[compensate]\nposes = 1\n"), "[compensate]"),
    ] {
        let (code, _, err) = run(&more);
        assert_eq!(code, Some(1));
        assert!(err.contains(word), "{word}: {err}");
    }
    let (code, _, err) =
        run("[[expect.loop]]\nmodel = \"true\"\nfilter = \"none\"\nreduction = 0.1\n");
    assert_eq!(code, Some(1));
    assert!(
        err.contains("that fits once") && err.contains("[[expect.loop]]"),
        "{err}"
    );
    // one job a scenario, and what belongs to a fit stands beside no other
    for (more, words) in [
        (
            format!("{good}\n[workspace]\npostures = 9\n"),
            ["[workspace]", "stands beside [loop]"],
        ),
        (
            format!("{good}\n[[instead]]\ntitle = \"more\"\n[instead.design]\nposes = 4\n"),
            ["[[instead]]", "stands beside [loop]"],
        ),
        (
            expect("model = \"true\"\nfilter = \"none\"\nreduction = 0.1")
                + "\n[[expect.drill]]\ncommands = \"nominal\"\n",
            ["[[expect.drill]]", "with [loop]"],
        ),
    ] {
        let (code, _, err) = run(&more);
        assert_eq!(code, Some(1), "{words:?}");
        assert!(
            words.iter().all(|word| err.contains(word)),
            "{words:?}: {err}"
        );
    }
    let (code, out, _) = run(&expect(
        "model = \"true\"\nfilter = \"none\"\nposition_max_um = 1e9\nreduction = 1.0",
    ));
    assert_eq!(code, Some(3), "{out}");
    assert!(
        out.contains("MISSED share") && out.contains("expect   2 of 3 met"),
        "{out}"
    );
    // a tool under which the arm folds up: no pose is held, which is not to be held well
    let heavy = expect("model = \"true\"\nfilter = \"none\"\nposition_max_um = 1e9");
    let (code, out, _) = run(&heavy.replace("mass_kg = 1.5", "mass_kg = 1e6"));
    assert_eq!(code, Some(3), "{out}");
    assert!(
        out.contains("2 poses left out") && !out.contains("0 mm"),
        "{out}"
    );
    assert!(out.contains("expect   0 of 3 met"), "{out}");
}
