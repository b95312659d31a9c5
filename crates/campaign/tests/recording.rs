//! Recordings: equal to the bit, the same bytes each time, and refused whole when damaged.

#![allow(clippy::unwrap_used)]

use crate::campaign::campaign;
use crate::measured::measured;
use crate::two_arms::{DH_TABLE, TWO_ARMS, assert_same};
use misfit_arm::robot::Robot;
use misfit_campaign::recording::{
    Beside, Holds, Progress, Results, Step, read_campaign, read_recording, write_campaign,
};
use misfit_campaign::{Campaign, Frame, Payload, Reading, RobotFile, Split, Target, Wrench};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

fn run() -> BTreeMap<String, String> {
    BTreeMap::from([("seed".into(), "1".into())])
}

/// Three readings of two targets with every optional part somewhere.
fn example() -> Campaign {
    let robot = Robot::parse("arm.urdf", TWO_ARMS, None).unwrap();
    let target = |name: &str, link: &str| Target {
        name: name.into(),
        link: robot.link(link).unwrap(),
    };
    let reading = |index: usize| Reading {
        line: index + 2,
        pose: Some(format!("p{index}")),
        repeat: None,
        target: index % 2,
        split: Split::Fit,
        time: Some(10.0 + index as f64 / 3.0),
        temperature: Some(20.0),
        link_temperatures: vec![(1, 25.0)],
        joints: vec![0.1 * index as f64, 0.2, -0.3],
        approach: Some(vec![1.0, 0.0, -1.0]),
        position: Vector3::new(1.0, 2.0, 3.0),
        orientation: (index > 0).then(|| UnitQuaternion::from_euler_angles(0.1, 0.2, 0.3)),
        wrench: (index > 1).then(|| Wrench {
            force: Vector3::new(1.0, 2.0, 3.0),
            torque: Vector3::new(4.0, 5.0, 6.0),
        }),
        payload: Some(Payload {
            mass: 3.0,
            com: Vector3::new(0.0, 0.0, 0.1),
        }),
        process: None,
    };
    Campaign {
        name: "example.toml".into(),
        robot_file: RobotFile {
            name: "arm.urdf".into(),
            text: TWO_ARMS.into(),
            base: None,
        },
        gravity: Vector3::new(0.0, 0.0, -9.81),
        targets: vec![
            target("left", "left_flange"),
            target("right", "right_flange"),
        ],
        base_from_tracker: Frame::Known(Isometry3::translation(3.0, 0.0, 1.0)),
        link_from_target: vec![Frame::Estimate; 2],
        noise: None,
        readings: (0..3).map(reading).collect(),
        warnings: vec!["first".into(), "second".into()],
        notes: Vec::new(),
        robot,
    }
}

fn written(folder: &TempDir, campaign: &Campaign) -> PathBuf {
    let path = folder.path().join("run.mcap");
    let beside = Beside {
        metadata: run(),
        attachments: vec![("truth.toml".into(), b"x = 1".to_vec())],
        ..Beside::default()
    };
    write_campaign(campaign, &path, &beside).unwrap();
    path
}

/// Messages by topic: (log time, schema, bytes).
fn messages(path: &Path) -> BTreeMap<String, Vec<(u64, String, Vec<u8>)>> {
    let bytes = fs::read(path).unwrap();
    let mut topics: BTreeMap<_, Vec<_>> = BTreeMap::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let channel = &message.channel;
        assert_eq!(channel.message_encoding, "cdr");
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!(schema.encoding, "ros2msg");
        let qos = &channel.metadata["offered_qos_profiles"];
        let latched =
            ["/robot_description", "/tf_static", "/verdict"].contains(&channel.topic.as_str());
        assert_eq!(qos.contains("durability: 1"), latched, "{qos}");
        topics.entry(channel.topic.clone()).or_default().push((
            message.log_time,
            schema.name.clone(),
            message.data.to_vec(),
        ));
    }
    topics
}

fn holds(bytes: &[u8], text: &str) -> bool {
    bytes
        .windows(text.len())
        .any(|window| window == text.as_bytes())
}

#[test]
fn standard_topics_with_one_log_time_for_each_reading() {
    let folder = TempDir::new().unwrap();
    let campaign = example();
    let topics = messages(&written(&folder, &campaign));
    let expected = [
        ("/campaign/reading", "misfit_msgs/msg/Reading", 3),
        ("/joint_states", "sensor_msgs/msg/JointState", 3),
        ("/robot_description", "std_msgs/msg/String", 1),
        ("/temperature", "sensor_msgs/msg/Temperature", 3),
        ("/tf", "tf2_msgs/msg/TFMessage", 3),
        ("/tf_static", "tf2_msgs/msg/TFMessage", 1),
        ("/tracker/pose", "geometry_msgs/msg/PoseStamped", 3),
        ("/wrist_ft/wrench", "geometry_msgs/msg/WrenchStamped", 1),
    ];
    let found: Vec<(&str, &str, usize)> = topics
        .iter()
        .map(|(topic, list)| (topic.as_str(), list[0].1.as_str(), list.len()))
        .collect();
    assert_eq!(found, expected);
    let times: Vec<u64> = topics["/tf"].iter().map(|(time, ..)| *time).collect();
    assert_eq!(times, [10_000_000_000, 10_333_333_333, 10_666_666_667]);
    for topic in ["/joint_states", "/tracker/pose", "/campaign/reading"] {
        let same: Vec<u64> = topics[topic].iter().map(|(time, ..)| *time).collect();
        assert_eq!(times, same, "{topic}");
    }
    assert!(holds(
        &topics["/robot_description"][0].2,
        "<robot name=\"two_arms\">"
    ));
    // Every link is placed once: what moves in /tf, the rest and the tracker in /tf_static.
    let place = |name: &str| ["/tf", "/tf_static"].map(|topic| holds(&topics[topic][0].2, name));
    for name in ["left_flange", "tracker"] {
        assert_eq!(place(name), [false, true], "{name}");
    }
    // the arms' joints are not turned
    assert!(place("trunk")[0]);
    for name in ["left_arm", "right_flange"] {
        assert!(place(name)[1], "{name}");
    }
}

#[test]
fn without_increasing_times_readings_are_a_second_apart() {
    let folder = TempDir::new().unwrap();
    for times in [
        [None; 3],
        [Some(1.0), Some(1.0), Some(2.0)],
        [Some(-1.0), Some(0.0), Some(1.0)],
    ] {
        let mut campaign = example();
        for (reading, time) in campaign.readings.iter_mut().zip(times) {
            reading.time = time;
        }
        let path = written(&folder, &campaign);
        let times: Vec<u64> = messages(&path)["/tf"].iter().map(|m| m.0).collect();
        assert_eq!(times, [0, 1_000_000_000, 2_000_000_000]);
        assert_same(&campaign, &read_campaign(&path).unwrap());
    }
}

#[test]
fn a_dh_robot_has_a_description_too() {
    let robot = Robot::parse("table.toml", DH_TABLE, None).unwrap();
    let mut campaign = example();
    campaign.targets.truncate(1);
    campaign.targets[0].link = robot.links.len() - 1;
    campaign.link_from_target.truncate(1);
    campaign.readings.truncate(1);
    campaign.readings[0].joints = vec![0.1, 0.2];
    campaign.readings[0].approach = None;
    campaign.robot_file.name = "table.toml".into();
    campaign.robot_file.text = DH_TABLE.into();
    campaign.robot = robot;
    let folder = TempDir::new().unwrap();
    let path = written(&folder, &campaign);
    assert_same(&campaign, &read_campaign(&path).unwrap());
    assert!(holds(
        &messages(&path)["/robot_description"][0].2,
        "<robot name=\"dh\">"
    ));
}

#[test]
fn files_and_run_record_are_carried_along() {
    let folder = TempDir::new().unwrap();
    let path = written(&folder, &example());
    let bytes = fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let names: BTreeSet<&str> = summary
        .attachment_indexes
        .iter()
        .map(|a| a.name.as_str())
        .collect();
    assert_eq!(
        names,
        BTreeSet::from(["arm.urdf", "campaign.toml", "truth.toml"])
    );
    let index = summary
        .metadata_indexes
        .iter()
        .find(|m| m.name == "run")
        .unwrap();
    assert_eq!(mcap::read::metadata(&bytes, index).unwrap().metadata, run());
}

#[test]
fn two_attachments_of_one_name_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("run.mcap");
    for name in ["campaign.toml", "arm.urdf"] {
        let attachments = [(name.to_owned(), Vec::new())];
        let beside = Beside {
            attachments: attachments.into(),
            ..Beside::default()
        };
        let message = write_campaign(&example(), &path, &beside)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains(name) && message.contains("run.mcap"),
            "{message}"
        );
        assert!(!path.exists());
    }
}

#[test]
fn the_measured_ur10_survives_recording() {
    let Some(path) = measured(
        "recording::the_measured_ur10_survives_recording",
        "series_C.toml",
    ) else {
        return;
    };
    let campaign = Campaign::load(&path).unwrap();
    let folder = TempDir::new().unwrap();
    let recording = written(&folder, &campaign);
    assert_same(&campaign, &Campaign::load(&recording).unwrap());
}

#[test]
fn a_failed_write_leaves_the_old_file_whole() {
    let folder = TempDir::new().unwrap();
    let mut campaign = example();
    let path = written(&folder, &campaign);
    let old = fs::read(&path).unwrap();
    campaign.readings[2].joints[0] = f64::INFINITY;
    let message = write_campaign(&campaign, &path, &Beside::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("run.mcap") && message.contains("reading 2"),
        "{message}"
    );
    assert_eq!(fs::read(&path).unwrap(), old);
    assert_eq!(
        fs::read_dir(folder.path()).unwrap().count(),
        1,
        "nothing is left lying about"
    );

    let nowhere = folder.path().join("no/such/folder/run.mcap");
    let message = write_campaign(&example(), &nowhere, &Beside::default())
        .unwrap_err()
        .to_string();
    assert!(message.contains("cannot be written"), "{message}");
}

#[test]
fn what_is_no_recording_of_a_campaign_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    let refused = |parts: &[&str]| {
        let message = Campaign::load(&path).unwrap_err().to_string();
        for part in [&["x.mcap"], parts].concat() {
            assert!(message.contains(part), "no {part:?} in {message}");
        }
    };
    refused(&["cannot be read"]);
    fs::write(&path, "not MCAP at all").unwrap();
    refused(&["not a whole MCAP file", "magic"]);
    fs::write(&path, "").unwrap();
    refused(&["not a whole MCAP file"]);

    // Another program's file: whole, but with nothing of ours in it.
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let channel = writer
        .add_channel(0, "/chat", "json", &BTreeMap::new())
        .unwrap();
    let header = |channel_id| mcap::records::MessageHeader {
        channel_id,
        sequence: 0,
        log_time: 0,
        publish_time: 0,
    };
    writer
        .write_to_known_channel(&header(channel), b"{}")
        .unwrap();
    writer.finish().unwrap();
    refused(&[
        "not a recording of a campaign",
        "no metadata record \"campaign\"",
        "misfit simulate",
    ]);

    // A topic of ours with another type.
    let mut writer = mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap();
    let schema = writer
        .add_schema("std_msgs/msg/String", "ros2msg", b"string data")
        .unwrap();
    let channel = writer
        .add_channel(schema, "/joint_states", "cdr", &BTreeMap::new())
        .unwrap();
    writer
        .write_to_known_channel(&header(channel), b"")
        .unwrap();
    writer.finish().unwrap();
    refused(&[
        "/joint_states",
        "found std_msgs/msg/String",
        "accepted: sensor_msgs/msg/JointState",
    ]);

    let file = fs::File::create(&path).unwrap();
    file.set_len(2_000_000_001).unwrap();
    refused(&["2 GB"]);
}

/// Copies a recording, changing or leaving out messages.
fn edited(from: &Path, to: &Path, edit: impl Fn(&str, u64, &mut Vec<u8>) -> bool) {
    let bytes = fs::read(from).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let mut writer = mcap::Writer::new(fs::File::create(to).unwrap()).unwrap();
    for index in &summary.metadata_indexes {
        writer
            .write_metadata(&mcap::read::metadata(&bytes, index).unwrap())
            .unwrap();
    }
    for index in &summary.attachment_indexes {
        writer
            .attach(&mcap::read::attachment(&bytes, index).unwrap())
            .unwrap();
    }
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        let mut data = message.data.to_vec();
        if edit(&message.channel.topic, message.log_time, &mut data) {
            message.data = data.into();
            writer.write(&message).unwrap();
        }
    }
    writer.finish().unwrap();
}

#[test]
fn messages_that_do_not_fit_one_another_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = written(&folder, &example());
    let copy = folder.path().join("copy.mcap");
    edited(&path, &copy, |_, _, _| true);
    assert_same(&example(), &read_campaign(&copy).unwrap());
    // What is only for viewers may go.
    edited(&path, &copy, |topic, _, _| {
        !topic.starts_with("/tf") && topic != "/temperature"
    });
    assert_same(&example(), &read_campaign(&copy).unwrap());
    for topic in ["/joint_states", "/tracker/pose", "/wrist_ft/wrench"] {
        edited(&path, &copy, |t, time, _| {
            t != topic || time != 10_666_666_667
        });
        let message = read_campaign(&copy).unwrap_err().to_string();
        for part in [
            "copy.mcap",
            topic,
            "10666666667 ns",
            "no message of its own",
        ] {
            assert!(message.contains(part), "no {part:?} in {message}");
        }
    }
    edited(&path, &copy, |topic, _, _| topic != "/campaign/reading");
    let message = read_campaign(&copy).unwrap_err().to_string();
    assert!(
        message.contains("no message on /campaign/reading"),
        "{message}"
    );
    // Cut short inside.
    edited(&path, &copy, |topic, _, data| {
        if topic == "/campaign/reading" {
            data.truncate(30);
        }
        true
    });
    let message = read_campaign(&copy).unwrap_err().to_string();
    assert!(message.contains("/campaign/reading"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(150) })]

    #[test]
    fn a_recording_reads_back_the_same_and_is_the_same_each_time(campaign in campaign()) {
        let folder = TempDir::new().unwrap();
        let path = written(&folder, &campaign);
        let again = read_campaign(&path).unwrap();
        assert_same(&campaign, &again);
        let second = TempDir::new().unwrap();
        prop_assert_eq!(fs::read(&path).unwrap(), fs::read(written(&second, &again)).unwrap());
    }

    #[test]
    fn a_recording_cut_off_anywhere_is_refused(cut in any::<prop::sample::Index>()) {
        let folder = TempDir::new().unwrap();
        let path = written(&folder, &example());
        let bytes = fs::read(&path).unwrap();
        fs::write(&path, &bytes[..cut.index(bytes.len())]).unwrap();
        let message = read_campaign(&path).unwrap_err().to_string();
        prop_assert!(message.contains("not a whole MCAP file"), "{}", message);
    }

    #[test]
    fn a_damaged_recording_never_panics(
        places in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let folder = TempDir::new().unwrap();
        let path = written(&folder, &example());
        let mut bytes = fs::read(&path).unwrap();
        for (place, byte) in places {
            let index = place.index(bytes.len());
            bytes[index] = byte;
        }
        fs::write(&path, &bytes).unwrap();
        let _ = read_campaign(&path);
    }

    #[test]
    fn damaged_messages_never_panic(
        which in any::<prop::sample::Index>(),
        place in any::<prop::sample::Index>(),
        byte in any::<u8>(),
        length in any::<prop::sample::Index>(),
    ) {
        let folder = TempDir::new().unwrap();
        let path = written(&folder, &example());
        let copy = folder.path().join("copy.mcap");
        let topics = ["/joint_states", "/tracker/pose", "/wrist_ft/wrench", "/campaign/reading"];
        let topic = topics[which.index(4)];
        edited(&path, &copy, |t, _, data| {
            if t == topic {
                let index = place.index(data.len());
                data[index] = byte;
                data.truncate(length.index(data.len()) + 1);
            }
            true
        });
        let _ = read_campaign(&copy);
    }
}

/// Results of two steps, none of whose numbers are equal.
fn results(campaign: &Campaign) -> Results {
    let pose = |k: f64| {
        let turn = UnitQuaternion::from_euler_angles(0.1 * k, 0.2, -0.3);
        Isometry3::from_parts(Vector3::new(k, 2.0 * k, -k).into(), turn)
    };
    let readings = campaign.readings.len();
    let step = |added: &str, k: f64, heldout| Step {
        added: added.to_owned(),
        fitted_rms_m: 1e-3 / k,
        heldout_rms_m: heldout,
        base_from_tracker: pose(0.1 * k),
        predicted: (0..readings).map(|i| pose(k + i as f64 / 7.0)).collect(),
    };
    let robot = &campaign.robot;
    let links = |i: usize| {
        let links = robot.links.iter();
        links
            .map(|link| pose((i + link.body) as f64) * link.body_from_link)
            .collect()
    };
    Results {
        steps: vec![
            step("nominal", 1.0, None),
            step("geometry", 2.0, Some(2e-3)),
        ],
        links: (0..readings).map(links).collect(),
        torques: (0..readings)
            .map(|i| {
                (0..robot.joints.len())
                    .map(|j| (i * 10 + j) as f64 / 3.0)
                    .collect()
            })
            .collect(),
        progress: vec![
            Progress {
                step: 0,
                iteration: 1,
                cost: 12.5,
            },
            Progress {
                step: 1,
                iteration: 1,
                cost: 2.5,
            },
        ],
        verdict: "**nothing** <more> & all".to_owned(),
    }
}

#[test]
fn results_come_back_beside_an_equal_campaign() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("found.mcap");
    let mut campaign = example();
    campaign.base_from_tracker = Frame::Estimate;
    let wanted = results(&campaign);
    let beside = Beside {
        results: Some(&wanted),
        metadata: run(),
        attachments: vec![("model.toml".into(), b"x = 1".to_vec())],
        ..Beside::default()
    };
    write_campaign(&campaign, &path, &beside).unwrap();
    let first = fs::read(&path).unwrap();
    write_campaign(&campaign, &path, &beside).unwrap();
    assert_eq!(first, fs::read(&path).unwrap(), "the same bytes");

    assert_same(&campaign, &read_campaign(&path).unwrap());
    let recording = read_recording(&path).unwrap();
    assert_same(&campaign, &recording.campaign);
    assert_eq!(recording.holds, Holds::Readings);
    assert_eq!(recording.metadata, run());
    assert_eq!(recording.attachments["model.toml"], b"x = 1");
    let found = recording.results.unwrap();
    let near = |a: &Isometry3<f64>, b: &Isometry3<f64>| {
        let gap = a.inverse() * b;
        assert!(
            gap.translation.vector.norm() + gap.rotation.angle() < 1e-14,
            "{gap}"
        );
    };
    for (a, b) in found
        .links
        .iter()
        .flatten()
        .zip(wanted.links.iter().flatten())
    {
        near(a, b);
    }
    assert_eq!(found.links.len(), wanted.links.len());
    for (a, b) in found.steps.iter().zip(&wanted.steps) {
        near(&a.base_from_tracker, &b.base_from_tracker);
        assert_eq!((&a.added, a.fitted_rms_m), (&b.added, b.fitted_rms_m));
        assert_eq!(
            (&a.predicted, a.heldout_rms_m),
            (&b.predicted, b.heldout_rms_m)
        );
    }
    assert_eq!(found.steps.len(), 2);
    assert_eq!(
        (&found.torques, &found.verdict),
        (&wanted.torques, &wanted.verdict)
    );
    assert_eq!(found.progress, wanted.progress);

    let topics = messages(&path);
    for (topic, schema, count) in [
        (
            "/prediction/nominal/pose",
            "geometry_msgs/msg/PoseStamped",
            3,
        ),
        (
            "/prediction/fitted/pose",
            "geometry_msgs/msg/PoseStamped",
            3,
        ),
        (
            "/residual/nominal/position",
            "geometry_msgs/msg/Vector3Stamped",
            3,
        ),
        (
            "/residual/fitted/position",
            "geometry_msgs/msg/Vector3Stamped",
            3,
        ),
        ("/residual/position_mm", "std_msgs/msg/Float64MultiArray", 3),
        (
            "/residual/orientation_mrad",
            "std_msgs/msg/Float64MultiArray",
            2,
        ),
        ("/ladder/rung", "misfit_msgs/msg/Rung", 2),
        ("/ladder/cloud", "sensor_msgs/msg/PointCloud2", 2),
        ("/ladder/error_mm", "std_msgs/msg/Float64MultiArray", 2),
        ("/fit/progress", "misfit_msgs/msg/FitProgress", 2),
        ("/verdict", "std_msgs/msg/String", 1),
    ] {
        assert_eq!(
            (topics[topic][0].1.as_str(), topics[topic].len()),
            (schema, count)
        );
    }
    // the fit says where the tracker stands
    assert!(holds(&topics["/tf_static"][0].2, "tracker"));
    // a body moves, a link on it stands where it is
    assert!(holds(&topics["/tf_static"][0].2, "fitted/left_flange"));
    assert!(!holds(&topics["/tf"][0].2, "fitted/left_flange"));
    assert!(holds(&topics["/tf"][0].2, "fitted/"));
}

#[test]
fn results_of_something_else_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("found.mcap");
    let campaign = example();
    let good = results(&campaign);
    let spoilt: [fn(&mut Results); 6] = [
        |r| r.steps.clear(),
        |r| r.steps[1].predicted.truncate(2),
        |r| r.links.truncate(1),
        |r| r.links[1].truncate(1),
        |r| r.torques[2].truncate(1),
        |r| r.progress[0].step = 7,
    ];
    for spoil in spoilt {
        let mut results = good.clone();
        spoil(&mut results);
        let beside = Beside {
            results: Some(&results),
            ..Beside::default()
        };
        let message = write_campaign(&campaign, &path, &beside)
            .unwrap_err()
            .to_string();
        assert!(
            message.contains("found.mcap: the campaign does not hold together"),
            "{message}"
        );
        assert!(!path.exists());
    }
}

#[test]
fn commands_are_no_readings() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("commands.mcap");
    let beside = Beside {
        holds: Holds::Commands,
        ..Beside::default()
    };
    write_campaign(&example(), &path, &beside).unwrap();
    let message = read_campaign(&path).unwrap_err().to_string();
    assert!(
        message.contains("commands.mcap") && message.contains("nobody measured"),
        "{message}"
    );
    let recording = read_recording(&path).unwrap();
    assert_eq!(
        (recording.holds, recording.results),
        (Holds::Commands, None)
    );
    assert_same(&example(), &recording.campaign);
}
