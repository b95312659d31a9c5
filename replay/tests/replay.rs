//! What is sent to the viewer: entities, rows, components; and what becomes of files.

#![allow(clippy::unwrap_used, clippy::too_many_lines, missing_docs)]

use assert_cmd::Command;
use misfit_arm::robot::Robot;
use misfit_campaign::recording::{
    Beside, Holds, Progress, Recording, Results, Step, read_recording, write_campaign,
};
use misfit_campaign::{Campaign, Frame, Payload, Reading, RobotFile, Target, Wrench};
use misfit_replay::{Opening, Scene, draw, save, stream};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use tempfile::TempDir;

const READINGS: usize = 20;

/// What one entity was sent.
#[derive(Debug, Default)]
struct Sent {
    /// Rows by timeline; "static" is one.
    rows: BTreeMap<String, usize>,
    components: BTreeSet<String>,
    /// Values in the first batch of a component, by rows.
    instances: BTreeMap<String, usize>,
}

/// All that is sent of a recording.
fn sent(recording: &Recording) -> BTreeMap<String, Sent> {
    let (stream, storage) = stream(recording).memory().unwrap();
    draw(&stream, recording, &Opening::default()).unwrap();
    let mut entities: BTreeMap<String, Sent> = BTreeMap::new();
    for message in storage.take() {
        let rerun::log::LogMsg::ArrowMsg(id, arrow) = message else {
            continue;
        };
        if !id.is_recording() {
            continue;
        }
        let chunk = rerun::log::Chunk::from_arrow_msg(&arrow).unwrap();
        let entity = entities.entry(chunk.entity_path().to_string()).or_default();
        let mut timelines: Vec<String> = chunk
            .timelines()
            .keys()
            .map(|name| name.to_string())
            .collect();
        if chunk.is_static() {
            timelines.push("static".to_owned());
        }
        for timeline in timelines {
            *entity.rows.entry(timeline).or_default() += chunk.num_rows();
        }
        for component in chunk.component_descriptors() {
            let name = component.component.to_string();
            let batch = chunk.component_batch_raw(component.component, 0);
            if let Some(Ok(batch)) = batch {
                entity.instances.insert(name.clone(), batch.len());
            }
            entity.components.insert(name);
        }
    }
    entities
}

#[track_caller]
fn rows(entities: &BTreeMap<String, Sent>, entity: &str, timeline: &str) -> usize {
    let Some(sent) = entities.get(entity) else {
        let names: Vec<&String> = entities.keys().collect();
        panic!("{entity} was not sent, but {names:?}");
    };
    sent.rows.get(timeline).copied().unwrap_or_default()
}

#[track_caller]
fn holds(entities: &BTreeMap<String, Sent>, entity: &str, components: &[&str]) {
    let found = &entities[entity].components;
    for component in components {
        assert!(
            found.contains(*component),
            "{entity} has no {component}, but {found:?}"
        );
    }
}

fn robot(name: &str) -> (Robot, RobotFile) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../models")
        .join(name);
    let text = fs::read_to_string(path).unwrap();
    let name = name.rsplit('/').next().unwrap().to_owned();
    let robot = Robot::parse(&name, &text, None).unwrap();
    (
        robot,
        RobotFile {
            name,
            text,
            base: None,
        },
    )
}

fn tracker() -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(3.0, 0.5, 1.0),
        UnitQuaternion::from_euler_angles(0.0, 0.0, 2.9),
    )
}

fn campaign(model: &str, links: &[&str], readings: Vec<Reading>) -> Campaign {
    let (robot, robot_file) = robot(model);
    let targets: Vec<Target> = links
        .iter()
        .map(|link| Target {
            name: (*link).to_owned(),
            link: robot.link(link).unwrap(),
        })
        .collect();
    Campaign {
        name: "cell.toml".to_owned(),
        robot,
        robot_file,
        gravity: Vector3::new(0.0, 0.0, -9.81),
        link_from_target: vec![Frame::Estimate; targets.len()],
        targets,
        base_from_tracker: Frame::Estimate,
        noise: None,
        readings,
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}

fn link_poses(robot: &Robot, joints: &[f64]) -> Vec<Isometry3<f64>> {
    let bodies = robot.body_poses(joints);
    let links = robot.links.iter();
    links
        .map(|link| bodies[link.body] * link.body_from_link)
        .collect()
}

/// Twenty postures of the six-axis arm, 2 mm and less beside where the nominal robot is; every other one with a payload.
fn plain() -> Recording {
    let readings = (0..READINGS).map(|index| {
        let q = |joint: usize| 0.8 * (1.7 * index as f64 + 2.3 * joint as f64).sin();
        let mut reading = Reading::to_be(0, (0..6).map(q).collect());
        reading.line = index + 2;
        reading.time = Some(2.0 * index as f64);
        reading.payload = (index % 2 == 1).then_some(Payload {
            mass: 10.0,
            com: Vector3::new(0.0, 0.0, 0.1),
        });
        reading
    });
    let mut campaign = campaign("six_axis/six_axis.urdf", &["flange"], readings.collect());
    let link = campaign.targets[0].link;
    for (index, reading) in campaign.readings.iter_mut().enumerate() {
        let pose = tracker().inverse() * link_poses(&campaign.robot, &reading.joints)[link];
        let off = Vector3::new((index as f64).sin(), (2.0 * index as f64).cos(), 0.3) * 1.5e-3;
        reading.position = pose.translation.vector + off;
        reading.orientation = Some(pose.rotation);
    }
    recording(campaign, None)
}

fn recording(campaign: Campaign, results: Option<Results>) -> Recording {
    Recording {
        campaign,
        holds: Holds::Readings,
        results,
        metadata: BTreeMap::new(),
        attachments: BTreeMap::new(),
    }
}

/// The same with three steps: errors of 1, 0.3 and 0.01 of the first.
fn found() -> Recording {
    let mut whole = plain();
    let campaign = &whole.campaign;
    let link = campaign.targets[0].link;
    let nominal: Vec<Vec<Isometry3<f64>>> = campaign
        .readings
        .iter()
        .map(|reading| link_poses(&campaign.robot, &reading.joints))
        .collect();
    let step = |added: &str, left: f64| Step {
        added: added.to_owned(),
        fitted_rms_m: 2e-3 * left,
        heldout_rms_m: Some(2.2e-3 * left),
        base_from_tracker: tracker(),
        predicted: campaign
            .readings
            .iter()
            .zip(&nominal)
            .map(|(reading, links)| {
                let pose = tracker().inverse() * links[link];
                let off = reading.position - pose.translation.vector;
                Isometry3::from_parts((reading.position - off * left).into(), pose.rotation)
            })
            .collect(),
    };
    let steps = vec![
        step("nominal", 1.0),
        step("geometry", 0.3),
        step("joint_compliance", 0.01),
    ];
    let fitted = nominal.iter().map(|links| {
        let moved = links
            .iter()
            .map(|pose| Translation3::new(1e-3, 0.0, -2e-3) * pose);
        moved.collect()
    });
    let progress = (0..3).flat_map(|step| {
        (1..4).map(move |iteration| Progress {
            step,
            iteration,
            cost: 1e6 / f64::from(iteration).powi(4),
        })
    });
    whole.results = Some(Results {
        links: fitted.collect(),
        torques: vec![vec![1.0; 6]; READINGS],
        progress: progress.collect(),
        verdict: "# it is the springs".to_owned(),
        steps,
    });
    whole
}

/// Both wrists of the two-armed robot in turn, pressed against one another.
fn drilling() -> Recording {
    let readings = (0..40).map(|index| {
        let joints = (0..15)
            .map(|joint| 0.1 * f64::from(joint) + 1e-6 * f64::from(index))
            .collect();
        let mut reading = Reading::to_be(index as usize % 2, joints);
        reading.line = index as usize + 2;
        reading.time = Some(0.0025 * f64::from(index));
        let thrust = f64::from(index / 2);
        reading.wrench = Some(Wrench {
            force: Vector3::new(3.0, 4.0 + thrust, thrust),
            torque: Vector3::new(0.1, 0.0, 0.0),
        });
        reading.position = Vector3::new(1.0, 0.0, 1e-4 * thrust);
        reading
    });
    let links = ["r1_flange", "r2_flange"];
    recording(
        campaign("sda5f/sda5f.urdf", &links, readings.collect()),
        None,
    )
}

#[test]
fn a_campaign_without_results_is_drawn_beside_the_nominal_robot() {
    let recording = plain();
    let all = sent(&recording);
    // every link with a shape, at every reading; and once on the timeline of steps
    for link in &recording.campaign.robot.links {
        let entity = format!("/cell/nominal/{}", link.name);
        if link.visuals.is_empty() {
            assert!(!all.contains_key(&entity), "{entity}");
            continue;
        }
        assert_eq!(rows(&all, &entity, "reading"), READINGS, "{entity}");
        assert_eq!(rows(&all, &entity, "time"), READINGS, "{entity}");
        assert_eq!(rows(&all, &entity, "step"), 1, "{entity}");
        holds(
            &all,
            &entity,
            &["Transform3D:translation", "Transform3D:quaternion"],
        );
        let shapes = all
            .keys()
            .filter(|name| name.starts_with(&format!("{entity}/")));
        for shape in shapes.clone() {
            assert_eq!(rows(&all, shape, "static"), 1, "{shape}");
        }
        assert!(shapes.count() > 0, "{entity} looks like nothing");
    }
    let points = "/cell/readings/position_error_mm";
    holds(
        &all,
        points,
        &["Points3D:positions", "Points3D:colors", "Points3D:labels"],
    );
    assert_eq!(all[points].instances["Points3D:positions"], READINGS);
    assert_eq!(all[points].instances["Points3D:colors"], READINGS);
    assert_eq!(
        (rows(&all, points, "step"), rows(&all, points, "reading")),
        (1, 1)
    );
    let scene = Scene::of(&recording);
    let arrows = format!("/cell/readings/residuals_x{}", scene.magnification);
    assert_eq!(all[&arrows].instances["Arrows3D:vectors"], READINGS);
    for frame in ["measured", "nominal"] {
        assert_eq!(
            rows(&all, &format!("/cell/current/{frame}"), "reading"),
            READINGS
        );
    }
    assert!(!all.contains_key("/cell/current/fitted"));
    assert!(!all.keys().any(|name| name.starts_with("/cell/fitted")));
    assert!(!all.contains_key("/verdict"));
    holds(
        &all,
        "/about",
        &["TextDocument:text", "TextDocument:media_type"],
    );
    for joint in &recording.campaign.robot.joints {
        assert_eq!(
            rows(
                &all,
                &format!("/plots/joints_deg/{}", joint.name),
                "reading"
            ),
            READINGS
        );
    }
    assert_eq!(rows(&all, "/plots/error_mm/0_nominal", "time"), READINGS);
    assert_eq!(rows(&all, "/plots/error_mrad/0_nominal", "time"), READINGS);
    // weights without a sensor, zero where nothing hangs
    assert_eq!(
        rows(&all, "/cell/loads/flange/weight_N", "reading"),
        READINGS
    );
    assert!(!all.contains_key("/cell/loads/flange/force_N"));
    assert!(all.contains_key("/charts/angles/a1/after"));
    assert!(!all.contains_key("/charts/ladder/fitted"));
}

#[test]
fn the_tracker_is_placed_by_the_nominal_robot() {
    let recording = plain();
    let scene = Scene::of(&recording);
    let off = scene.base_from_tracker.unwrap().translation.vector - tracker().translation.vector;
    // 1.5 mm of errors in twenty postures
    assert!(off.norm() < 5e-3, "{off}");
    let worst = scene.steps[0].sizes().into_iter().fold(0.0, f64::max);
    assert!((3e-4..5e-3).contains(&worst), "{worst}");
    assert!(scene.worst >= 0.99 * worst && scene.worst <= 5.0 * worst);
}

#[test]
fn results_are_drawn_step_by_step() {
    let recording = found();
    let all = sent(&recording);
    let scene = Scene::of(&recording);
    let points = "/cell/readings/position_error_mm";
    assert_eq!(
        (rows(&all, points, "step"), rows(&all, points, "reading")),
        (3, 1)
    );
    let arrows = format!("/cell/readings/residuals_x{}", scene.magnification);
    assert_eq!(rows(&all, &arrows, "step"), 3);
    let magnified = format!("/cell/fitted_deviation_x{}/base", scene.robot_magnification);
    for robot in ["/cell/nominal/base", "/cell/fitted/base", &magnified] {
        assert_eq!(rows(&all, robot, "reading"), READINGS, "{robot}");
    }
    for frame in ["measured", "nominal", "fitted"] {
        assert_eq!(
            rows(&all, &format!("/cell/current/{frame}"), "reading"),
            READINGS
        );
    }
    for which in ["nominal", "fitted"] {
        let entity = format!("/cell/current/residual_{which}_x{}", scene.magnification);
        assert_eq!(rows(&all, &entity, "reading"), READINGS);
        holds(
            &all,
            &entity,
            &["Arrows3D:labels", "Arrows3D:vectors", "Arrows3D:origins"],
        );
    }
    for step in ["0_nominal", "1_geometry", "2_joint_compliance"] {
        assert_eq!(
            rows(&all, &format!("/plots/error_mm/{step}"), "reading"),
            READINGS
        );
        assert_eq!(
            rows(&all, &format!("/plots/error_mrad/{step}"), "reading"),
            READINGS
        );
        holds(
            &all,
            &format!("/charts/progress/{step}"),
            &["LineStrips2D:strips"],
        );
    }
    assert_eq!(rows(&all, "/plots/torques_Nm/a2", "reading"), READINGS);
    for chart in ["fitted", "held_out"] {
        let entity = format!("/charts/ladder/{chart}/points");
        assert_eq!(all[&entity].instances["Points2D:positions"], 3);
    }
    assert_eq!(rows(&all, "/charts/ladder/now", "step"), 3);
    for kind in ["before", "after"] {
        let entity = format!("/charts/angles/a3/{kind}");
        assert_eq!(
            (rows(&all, &entity, "step"), rows(&all, &entity, "reading")),
            (3, 1)
        );
    }
    holds(&all, "/verdict", &["TextDocument:text"]);
}

#[test]
fn errors_shrink_on_the_scale_of_the_first_step() {
    let recording = found();
    let scene = Scene::of(&recording);
    let largest: Vec<f64> = scene
        .steps
        .iter()
        .map(|step| step.sizes().into_iter().fold(0.0, f64::max))
        .collect();
    // errors are those that the steps were made with
    for (step, left) in largest.iter().zip([1.0, 0.3, 0.01]) {
        assert!((step - left * largest[0]).abs() < 1e-9, "{largest:?}");
    }
    assert!(
        scene.worst >= 0.95 * largest[0],
        "{} {largest:?}",
        scene.worst
    );
    let arrow = largest[0] * scene.magnification / scene.radius;
    assert!(
        (0.03..0.3).contains(&arrow),
        "an arrow of {arrow} of the scene"
    );
}

#[test]
fn a_drilled_hole_has_the_loads_of_both_wrists() {
    let recording = drilling();
    let all = sent(&recording);
    assert!(Scene::of(&recording).process());
    for wrist in ["r1_flange", "r2_flange"] {
        let entity = format!("/cell/loads/{wrist}");
        assert_eq!(rows(&all, &entity, "time"), 40);
        for kind in ["force_N", "torque_Nm"] {
            // its own twenty; the second one's first also stands at the start
            let expected = if wrist == "r1_flange" { 20 } else { 21 };
            let entity = format!("/cell/loads/{wrist}/{kind}");
            assert_eq!(rows(&all, &entity, "time"), expected, "{entity}");
            holds(&all, &entity, &["Arrows3D:vectors", "Arrows3D:labels"]);
        }
        for curve in ["fx", "fy", "fz"] {
            assert_eq!(
                rows(&all, &format!("/plots/force_N/{wrist}/{curve}"), "time"),
                20
            );
        }
        let thrusts = all
            .keys()
            .filter(|name| name.starts_with(&format!("/plots/thrust_N/{wrist}/")));
        assert_eq!(thrusts.count(), 2);
    }
    // one posture does not tell where the tracker stands
    assert!(!all.keys().any(|name| name.starts_with("/cell/readings")));
    assert!(all.contains_key("/cell/scale/force"));
}

#[test]
fn commands_are_not_shown_as_readings() {
    let mut recording = plain();
    recording.holds = Holds::Commands;
    let all = sent(&recording);
    assert!(!all.keys().any(|name| name.starts_with("/cell/readings")));
    assert!(!all.keys().any(|name| name.starts_with("/plots/error_mm")));
    assert_eq!(rows(&all, "/cell/nominal/base", "reading"), READINGS);
}

#[test]
fn a_robot_without_shapes_is_drawn_as_sticks() {
    let mut recording = plain();
    for link in &mut recording.campaign.robot.links {
        link.visuals.clear();
    }
    let all = sent(&recording);
    assert!(all.keys().any(|name| name.ends_with("/capsules")));
    assert!(all.keys().any(|name| name.ends_with("/spheres")));
}

fn replay(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit-replay"));
    command.current_dir(folder).env_remove("RUST_BACKTRACE");
    command
}

/// A recording in a folder of its own.
fn written() -> TempDir {
    let folder = TempDir::new().unwrap();
    let recording = found();
    let beside = Beside {
        results: recording.results.as_ref(),
        ..Beside::default()
    };
    write_campaign(&recording.campaign, &folder.path().join("x.mcap"), &beside).unwrap();
    folder
}

#[test]
fn a_recording_becomes_a_file_of_the_viewer() {
    let folder = written();
    replay(folder.path())
        .args(["x.mcap", "--save", "x.rrd"])
        .assert()
        .code(0)
        .stdout("x.rrd · open it with: rerun x.rrd\n");
    let bytes = fs::read(folder.path().join("x.rrd")).unwrap();
    assert_eq!(&bytes[..4], b"RRF2");
    assert!(bytes.len() > 50_000, "{}", bytes.len());
    // what was read back is what the library draws
    let read = read_recording(&folder.path().join("x.mcap")).unwrap();
    assert_eq!(sent(&read).len(), sent(&found()).len());
}

#[test]
fn bad_files_are_one_line_and_exit_1() {
    let folder = written();
    let whole = fs::read(folder.path().join("x.mcap")).unwrap();
    fs::write(folder.path().join("cut.mcap"), &whole[..whole.len() / 2]).unwrap();
    fs::write(folder.path().join("text.mcap"), "not a recording").unwrap();
    fs::write(folder.path().join("y.rrd"), "old").unwrap();
    for file in ["cut.mcap", "text.mcap", "missing.mcap", "."] {
        let output = replay(folder.path())
            .args([file, "--save", "y.rrd"])
            .output()
            .unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{file}: {said}");
        assert!(said.starts_with(&format!("misfit: {file}: ")), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
    assert_eq!(fs::read(folder.path().join("y.rrd")).unwrap(), b"old");
}

#[test]
fn wrong_usage_is_exit_2() {
    let folder = written();
    for words in [
        &["x.mcap", "--save", "x.png"][..],
        &[
            "x.mcap",
            "--save",
            "x.rrd",
            "--connect",
            "rerun+http://127.0.0.1:1/proxy",
        ],
        &["x.mcap", "--timeline", "log_time"],
        &[],
    ] {
        replay(folder.path()).args(words).assert().code(2);
    }
}

#[test]
fn without_a_viewer_it_is_one_line_and_exit_1() {
    let folder = written();
    for words in [
        &["x.mcap"][..],
        &["x.mcap", "--connect", "nonsense"],
        &["x.mcap", "--connect", "rerun+http://127.0.0.1:1/proxy"],
    ] {
        let mut command = replay(folder.path());
        command.env("PATH", "").env("RUST_LOG", "off");
        let output = command.args(words).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{words:?}: {said}");
        assert!(said.starts_with("misfit: "), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    }
}

/// A disk that is full, as far as the program can tell: no file may grow beyond 4 kB.
#[cfg(unix)]
#[test]
fn a_failed_save_leaves_the_old_file_whole() {
    let folder = written();
    fs::write(folder.path().join("x.rrd"), "old").unwrap();
    let before = fs::read_dir(folder.path()).unwrap().count();
    let script = format!(
        "trap '' XFSZ; ulimit -f 8; exec '{}' x.mcap --save x.rrd",
        env!("CARGO_BIN_EXE_misfit-replay")
    );
    let output = Command::new("sh")
        .current_dir(folder.path())
        .args(["-c", &script])
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(
        said.starts_with("misfit: x.rrd: cannot be written: "),
        "{said}"
    );
    assert_eq!(fs::read(folder.path().join("x.rrd")).unwrap(), b"old");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), before);
    // and from the library: a folder stands where the file should be
    let taken = folder.path().join("taken.rrd");
    fs::create_dir(&taken).unwrap();
    fs::write(taken.join("kept"), "x").unwrap();
    assert!(save(&found(), &Opening::default(), &taken).is_err());
    assert!(taken.join("kept").exists());
}
