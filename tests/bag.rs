//! Bags of a simulated cell, written byte by byte as ROS 2 would: are clocks, stops and means those of the simulation?

use crate::common::{bodies, file, random, vector};
use mcap::records::MessageHeader;
use misfit_arm::robot::Robot;
use misfit_campaign::bag::{self, Import, Spec, clock};
use misfit_campaign::recording::{RecordingError, Samples, read_bag};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use rand::RngExt;
use rand_distr::StandardNormal;
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

/// CDR by its own rules: numbers stand at multiples of their size after the header of four bytes.
struct Cdr {
    bytes: Vec<u8>,
    big: bool,
}

impl Cdr {
    fn new(big: bool) -> Self {
        Self {
            bytes: vec![0, u8::from(!big), 0, 0],
            big,
        }
    }

    fn align(&mut self, size: usize) {
        while !(self.bytes.len() - 4).is_multiple_of(size) {
            self.bytes.push(0);
        }
    }

    fn u32(&mut self, x: u32) {
        self.align(4);
        let bytes = if self.big {
            x.to_be_bytes()
        } else {
            x.to_le_bytes()
        };
        self.bytes.extend(bytes);
    }

    fn f64(&mut self, x: f64) {
        self.align(8);
        let bytes = if self.big {
            x.to_be_bytes()
        } else {
            x.to_le_bytes()
        };
        self.bytes.extend(bytes);
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    fn header(&mut self, ns: i64, frame: &str) {
        self.u32(ns.div_euclid(1_000_000_000) as u32);
        self.u32(ns.rem_euclid(1_000_000_000) as u32);
        self.text(frame);
    }

    fn vector(&mut self, v: &Vector3<f64>) {
        v.iter().for_each(|x| self.f64(*x));
    }

    fn numbers(&mut self, all: &[f64]) {
        self.u32(all.len() as u32);
        all.iter().for_each(|x| self.f64(*x));
    }
}

/// What is recorded and how.
#[derive(Clone)]
struct Cell {
    /// Tracker stamps less joint stamps at one instant, s.
    offset: f64,
    /// s/s.
    drift: f64,
    /// The recorder has one clock; else its log times are the stamps.
    log_times: bool,
    /// Stamps of the tracker are zero.
    no_stamps: bool,
    /// Postures, each visited twice; none: the arm stands.
    postures: usize,
    joint_hz: f64,
    tracker_hz: f64,
    /// Type of the tracker's topic: pose, point, transform, tf.
    tracker: &'static str,
    /// The tracker writes NaN in this share of the record.
    lost: Option<(f64, f64)>,
    wrench: bool,
    big_endian: bool,
    /// Joints in another order, others among them, and messages of a gripper.
    shuffled: bool,
    compression: Option<mcap::Compression>,
    /// Geometry is off by this, m, and four times that in rad: what a calibration is for.
    crooked: f64,
    /// To and fro between two postures, always as fast.
    repetitive: bool,
}

impl Default for Cell {
    fn default() -> Self {
        Self {
            offset: 0.0,
            drift: 0.0,
            log_times: false,
            no_stamps: false,
            postures: 8,
            joint_hz: 125.0,
            tracker_hz: 100.0,
            tracker: "pose",
            lost: None,
            wrench: false,
            big_endian: false,
            shuffled: false,
            compression: Some(mcap::Compression::Zstd),
            crooked: 0.0,
            repetitive: false,
        }
    }
}

const JOINT_NOISE: f64 = 1e-5;
const POSITION_NOISE: f64 = 1e-5;
const ORIENTATION_NOISE: f64 = 5e-5;
const FORCE_NOISE: f64 = 0.2;
/// Time of a stop, s; joints' clock, from the first message.
const STOP: f64 = 2.0;
/// ns since 1970 of the first message.
const START: i64 = 1_700_000_000_000_000_000;

/// A simulated stop.
struct Visit {
    posture: usize,
    joints: Vec<f64>,
    from: f64,
    to: f64,
    approach: Vec<f64>,
}

struct Recorded {
    folder: tempfile::TempDir,
    path: PathBuf,
    /// As it is.
    robot: Robot,
    visits: Vec<Visit>,
    tracker_from_base: Isometry3<f64>,
    link_from_target: Isometry3<f64>,
}

fn smooth(s: f64) -> f64 {
    let s = s.clamp(0.0, 1.0);
    s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
}

impl Cell {
    fn record(&self, seed: u64) -> Recorded {
        let mut random = random(seed);
        let mut robot = Robot::load(&file("models/six_axis/six_axis.urdf"), None).unwrap();
        let count = robot.joints.len();
        let postures: Vec<Vec<f64>> = (0..self.postures.max(1))
            .map(|_| (0..count).map(|_| random.random_range(-0.9..0.9)).collect())
            .collect();
        // forth, then back: each posture from two sides
        let order: Vec<usize> = match self.postures {
            0 => vec![0],
            n if self.repetitive => (0..n).map(|k| k % 2).collect(),
            n => (0..n).chain((0..n - 1).rev()).chain(1..n).collect(),
        };
        let mut visits: Vec<Visit> = Vec::new();
        let mut time = 0.0;
        for posture in order {
            let joints = postures[posture].clone();
            let (mut approach, mut from) = (vec![0.0; count], time);
            if let Some(last) = visits.last() {
                from += match self.repetitive {
                    true => 2.0,
                    false => random.random_range(1.0..2.5),
                };
                let moved = joints.iter().zip(&last.joints);
                approach = moved.map(|(a, b)| (a - b).signum()).collect();
            }
            time = from + if self.postures == 0 { 30.0 } else { STOP };
            visits.push(Visit {
                posture,
                joints,
                from,
                to: time,
                approach,
            });
        }
        let tracker_from_base = crate::common::motion(&mut random);
        let link_from_target = Isometry3::new(
            Vector3::new(0.05, -0.12, 0.08),
            Vector3::new(0.2, 0.1, -0.4),
        );
        for joint in &mut robot.joints {
            let off = Isometry3::new(
                vector(&mut random) * self.crooked,
                vector(&mut random) * (self.crooked / 0.25),
            );
            joint.parent_from_joint *= off;
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cell.mcap");
        let recorded = Recorded {
            folder,
            path,
            robot,
            visits,
            tracker_from_base,
            link_from_target,
        };
        self.write(&recorded, time, &mut random);
        recorded
    }

    fn write(&self, recorded: &Recorded, length: f64, random: &mut Pcg64Mcg) {
        let mut writer = mcap::WriteOptions::new()
            .profile("ros2")
            .compression(self.compression)
            .chunk_size(Some(100_000))
            .create(std::fs::File::create(&recorded.path).unwrap())
            .unwrap();
        let mut channel = |topic: &str, kind: &str| {
            let schema = writer.add_schema(kind, "ros2msg", b"# see ROS").unwrap();
            writer
                .add_channel(schema, topic, "cdr", &BTreeMap::new())
                .unwrap()
        };
        let kind = match self.tracker {
            "pose" => "geometry_msgs/msg/PoseStamped",
            "point" => "geometry_msgs/msg/PointStamped",
            "transform" => "geometry_msgs/msg/TransformStamped",
            _ => "tf2_msgs/msg/TFMessage",
        };
        let joints = channel("/joint_states", "sensor_msgs/msg/JointState");
        let tracker = channel("/tracker", kind);
        let wrench = channel("/wrench", "geometry_msgs/msg/WrenchStamped");
        let other = channel("/rosout", "rcl_interfaces/msg/Log");
        let mut messages: Vec<(u64, u16, Vec<u8>)> = Vec::new();
        let ns = |seconds: f64| START + (seconds * 1e9).round() as i64;
        let normal = |random: &mut Pcg64Mcg| -> f64 { random.sample(StandardNormal) };
        messages.push((ns(0.0) as u64, other, vec![1, 2, 3]));
        // joints: 2 ms of jitter in their arrival, none in their stamps
        for k in 0..(length * self.joint_hz) as usize {
            let t = k as f64 / self.joint_hz;
            let q: Vec<f64> = recorded
                .at(t)
                .iter()
                .map(|q| q + JOINT_NOISE * normal(random))
                .collect();
            let names: Vec<&str> = recorded
                .robot
                .joints
                .iter()
                .map(|j| j.name.as_str())
                .collect();
            let mut pairs: Vec<(&str, f64)> = names.into_iter().zip(q).collect();
            if self.shuffled {
                pairs.reverse();
                pairs.insert(2, ("gripper", 0.02));
                pairs.push(("rail", 1.5));
            }
            let mut cdr = Cdr::new(self.big_endian);
            cdr.header(ns(t), "base");
            cdr.u32(pairs.len() as u32);
            pairs.iter().for_each(|(name, _)| cdr.text(name));
            cdr.numbers(&pairs.iter().map(|(_, q)| *q).collect::<Vec<f64>>());
            cdr.numbers(&[]);
            cdr.numbers(&[]);
            let late = if self.log_times {
                random.random_range(0.0..2e-3)
            } else {
                0.0
            };
            messages.push((ns(t + late) as u64, joints, cdr.bytes));
            if self.shuffled && k % 3 == 0 {
                let mut cdr = Cdr::new(self.big_endian);
                cdr.header(ns(t), "hand");
                cdr.u32(1);
                cdr.text("gripper");
                cdr.numbers(&[0.02]);
                cdr.numbers(&[]);
                cdr.numbers(&[]);
                messages.push((ns(t + late) as u64, joints, cdr.bytes));
            }
        }
        for k in 0..(length * self.tracker_hz) as usize {
            // every thirtieth sample is lost on its way
            if random.random_range(0..30) == 0 {
                continue;
            }
            let t = k as f64 / self.tracker_hz + random.random_range(0.0..1e-3);
            let pose = recorded.seen(t);
            let mut place =
                pose.translation.vector + Vector3::from_fn(|_, _| POSITION_NOISE * normal(random));
            if self
                .lost
                .is_some_and(|(a, b)| (a..b).contains(&(t / length)))
            {
                place = Vector3::repeat(f64::NAN);
            }
            let turn = Vector3::from_fn(|_, _| ORIENTATION_NOISE * normal(random));
            let q = UnitQuaternion::from_scaled_axis(turn) * pose.rotation;
            // of both signs, as trackers do
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let q = q.coords * sign;
            let stamp = ns(t + self.offset + self.drift * t);
            let mut cdr = Cdr::new(self.big_endian);
            if self.tracker == "tf" {
                cdr.u32(2);
                cdr.header(stamp, "world");
                cdr.text("elsewhere");
                [9.0, 9.0, 9.0, 0.0, 0.0, 0.0, 1.0]
                    .iter()
                    .for_each(|x| cdr.f64(*x));
            }
            cdr.header(if self.no_stamps { 0 } else { stamp }, "tracker");
            if ["tf", "transform"].contains(&self.tracker) {
                cdr.text("probe");
            }
            cdr.vector(&place);
            if self.tracker != "point" {
                q.iter().for_each(|x| cdr.f64(*x));
            }
            let log = if self.log_times || self.no_stamps {
                ns(t + 3e-3)
            } else {
                stamp
            };
            messages.push((log as u64, tracker, cdr.bytes));
        }
        for k in 0..(length * 50.0) as usize {
            if !self.wrench {
                break;
            }
            let t = k as f64 / 50.0;
            let (force, torque) = recorded.wrench(t);
            let force = force + Vector3::from_fn(|_, _| FORCE_NOISE * normal(random));
            let mut cdr = Cdr::new(self.big_endian);
            cdr.header(ns(t - self.offset / 2.0), "flange");
            cdr.vector(&force);
            cdr.vector(&torque);
            messages.push((ns(t) as u64, wrench, cdr.bytes));
        }
        messages.sort_by_key(|m| m.0);
        for (sequence, (time, channel_id, bytes)) in messages.iter().enumerate() {
            let header = MessageHeader {
                channel_id: *channel_id,
                sequence: sequence as u32,
                log_time: *time,
                publish_time: *time,
            };
            writer.write_to_known_channel(&header, bytes).unwrap();
        }
        writer.finish().unwrap();
    }
}

impl Recorded {
    /// Joints at a time.
    fn at(&self, t: f64) -> Vec<f64> {
        let next = self.visits.partition_point(|visit| visit.from <= t);
        let last = &self.visits[next.max(1) - 1];
        match self.visits.get(next) {
            Some(to) if t > last.to => {
                let s = smooth((t - last.to) / (to.from - last.to));
                let pairs = last.joints.iter().zip(&to.joints);
                pairs.map(|(a, b)| a + (b - a) * s).collect()
            }
            _ => last.joints.clone(),
        }
    }

    fn flange(&self, q: &[f64]) -> Isometry3<f64> {
        let link = &self.robot.links[self.robot.link("flange").unwrap()];
        bodies(&self.robot, q)[link.body] * link.body_from_link
    }

    fn seen(&self, t: f64) -> Isometry3<f64> {
        self.tracker_from_base * self.flange(&self.at(t)) * self.link_from_target
    }

    /// 3 kg at the flange, 0.1 m out.
    fn wrench(&self, t: f64) -> (Vector3<f64>, Vector3<f64>) {
        let turn = self.flange(&self.at(t)).rotation;
        let force = turn.inverse() * Vector3::new(0.0, 0.0, -9.81 * 3.0);
        (force, Vector3::new(0.0, 0.0, 0.1).cross(&force))
    }

    fn spec(&self, more: &str) -> PathBuf {
        let path = self.folder.path().join("import.toml");
        let robot = file("models/six_axis/six_axis.urdf");
        let text = format!(
            "robot = {:?}\n[[target]]\nname = \"ball\"\nlink = \"flange\"\ntracker = \"/tracker\"\n{more}",
            robot.display().to_string()
        );
        std::fs::write(&path, text).unwrap();
        path
    }

    fn import(&self, more: &str) -> Import {
        let spec = Spec::load(&self.spec(more)).unwrap();
        let bag = read_bag(&self.path, |topic| spec.wants(&topic.topic)).unwrap();
        bag::import(&bag, &spec).unwrap()
    }

    fn refused(&self, more: &str) -> String {
        let spec = match Spec::load(&self.spec(more)) {
            Ok(spec) => spec,
            Err(error) => return error.to_string(),
        };
        let bag = match read_bag(&self.path, |topic| spec.wants(&topic.topic)) {
            Ok(bag) => bag,
            Err(error) => return error.to_string(),
        };
        bag::import(&bag, &spec).unwrap_err().to_string()
    }

    /// Every stop is found, none else, and its means are the simulation's.
    fn check(&self, import: &Import) {
        let campaign = import.campaign.as_ref().unwrap();
        assert_eq!(
            campaign.readings.len(),
            self.visits.len(),
            "{:?}",
            import.dwells
        );
        for (reading, visit) in campaign.readings.iter().zip(&self.visits) {
            let time = reading.time.unwrap();
            assert!(time > visit.from && time < visit.to, "{time} s");
            // at least 100 samples of independent noise: a tenth of it, six times
            let joints = reading.joints.iter().zip(&visit.joints);
            let off = joints.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 0.6 * JOINT_NOISE, "{off} rad");
            let seen = self.seen((visit.from + visit.to) / 2.0);
            let off = (reading.position - seen.translation.vector).norm();
            assert!(off < POSITION_NOISE, "{off} m");
            if let Some(orientation) = reading.orientation {
                let off = orientation.angle_to(&seen.rotation);
                assert!(off < ORIENTATION_NOISE, "{off} rad");
            }
            assert_eq!(reading.approach.as_ref().unwrap(), &visit.approach);
        }
        // one label a posture
        let mut labels = BTreeMap::new();
        for (reading, visit) in campaign.readings.iter().zip(&self.visits) {
            let label = reading.pose.clone().unwrap();
            assert_eq!(labels.entry(visit.posture).or_insert(label.clone()), &label);
        }
    }
}

/// Of a tracker's clock, s: the drift of a laboratory clock and a smooth motion leave less than this.
const CLOCK: f64 = 1e-3;

#[test]
fn offsets_of_clocks_are_found_whatever_the_log_times_say() {
    for (seed, offset) in [(1, -12.3), (2, 0.0), (3, 0.35), (4, 3.9)] {
        let cell = Cell {
            offset,
            log_times: seed % 2 == 0,
            ..Cell::default()
        };
        let recorded = cell.record(seed);
        let import = recorded.import("");
        let clock = &import.clocks[0];
        println!("{offset}: {clock:?}");
        assert_eq!(clock.status, clock::Status::Estimated);
        assert!((clock.offset_s - offset).abs() < CLOCK, "{clock:?}");
        assert!(
            (clock.offset_s - offset).abs() < 6.0 * clock.std_s.unwrap() + 1e-4,
            "{clock:?}"
        );
        assert!(clock.correlation.unwrap() > 0.98, "{clock:?}");
        assert!((clock.scale.unwrap() - 1.0).abs() < 0.01, "{clock:?}");
        recorded.check(&import);
        assert!(import.warnings.is_empty(), "{:?}", import.warnings);
    }
}

#[test]
fn a_robot_that_is_off_by_millimetres_tells_the_time_as_well() {
    let mut worst: f64 = 0.0;
    for seed in 50..56 {
        let cell = Cell {
            crooked: 2e-3,
            offset: 3.9,
            ..Cell::default()
        };
        let recorded = cell.record(seed);
        let import = recorded.import("");
        let clock = &import.clocks[0];
        let off = (clock.offset_s - 3.9).abs();
        println!(
            "{off:.2e} {:?} {:?} {:?}",
            clock.std_s, clock.correlation, clock.scale
        );
        assert!(off < 5.0 * clock.std_s.unwrap(), "{clock:?}");
        worst = worst.max(off);
        recorded.check(&import);
    }
    assert!(worst < CLOCK, "{worst}");
}

#[test]
fn clocks_of_other_years_meet_by_the_log_times() {
    // a tracker that counts from its start
    let cell = Cell {
        offset: -1.6e9,
        log_times: true,
        postures: 5,
        ..Cell::default()
    };
    let recorded = cell.record(5);
    let import = recorded.import("");
    assert!(
        (import.clocks[0].offset_s + 1.6e9).abs() < CLOCK,
        "{:?}",
        import.clocks
    );
    recorded.check(&import);
}

#[test]
fn a_drift_is_found_and_applied() {
    let cell = Cell {
        offset: 0.8,
        drift: 5e-4,
        postures: 12,
        ..Cell::default()
    };
    let recorded = cell.record(6);
    let import = recorded.import("");
    let clock = &import.clocks[0];
    println!("{clock:?}");
    assert!(clock.drift_applied, "{clock:?}");
    assert!((clock.drift.unwrap() - 5e-4).abs() < 1e-4, "{clock:?}");
    recorded.check(&import);
}

#[test]
fn all_types_of_trackers_byte_orders_and_packings() {
    let kinds = [
        ("point", false, None),
        ("transform", true, Some(mcap::Compression::Lz4)),
        ("tf", true, None),
        ("pose", true, Some(mcap::Compression::Zstd)),
    ];
    for (seed, (tracker, big_endian, compression)) in kinds.into_iter().enumerate() {
        let cell = Cell {
            tracker,
            big_endian,
            compression,
            offset: 0.2,
            postures: 4,
            ..Cell::default()
        };
        let recorded = cell.record(10 + seed as u64);
        let more = match tracker {
            "tf" => "frames = [\"tracker\", \"probe\"]",
            _ => "",
        };
        let import = recorded.import(more);
        recorded.check(&import);
        let campaign = import.campaign.unwrap();
        let turned = campaign.readings[0].orientation.is_some();
        assert_eq!(turned, tracker != "point");
    }
}

#[test]
fn joints_stand_in_any_order_among_others() {
    let cell = Cell {
        shuffled: true,
        postures: 4,
        ..Cell::default()
    };
    let recorded = cell.record(20);
    let import = recorded.import("");
    recorded.check(&import);
    let stream = &import.streams[0];
    assert!(stream.others[0].1 > 100, "{stream:?}");
    assert_eq!(stream.used + stream.others[0].1, stream.messages);
}

#[test]
fn zero_stamps_are_read_by_log_times() {
    let cell = Cell {
        no_stamps: true,
        postures: 4,
        ..Cell::default()
    };
    let recorded = cell.record(21);
    let import = recorded.import("");
    assert!(import.streams[1].log_time);
    // 3 ms on the way
    assert!(
        (import.clocks[0].offset_s - 3e-3).abs() < CLOCK,
        "{:?}",
        import.clocks
    );
    recorded.check(&import);
}

#[test]
fn wrenches_are_averaged_at_the_target_link() {
    let cell = Cell {
        wrench: true,
        offset: 1.0,
        ..Cell::default()
    };
    let recorded = cell.record(22);
    let import = recorded.import("wrench = \"/wrench\"");
    recorded.check(&import);
    let clock = &import.clocks[1];
    println!("{clock:?}");
    // 0.2 N of noise on 29 N that turn: the clock is half a second the other way
    assert!((clock.offset_s + 0.5).abs() < 0.02, "{clock:?}");
    // the mass that hangs there, kg; noise makes chords a little longer
    assert!((clock.scale.unwrap() - 3.0).abs() < 0.1, "{clock:?}");
    let campaign = import.campaign.unwrap();
    for (reading, visit) in campaign.readings.iter().zip(&recorded.visits) {
        let (force, torque) = recorded.wrench(visit.to);
        let wrench = reading.wrench.unwrap();
        assert!(
            (wrench.force - force).norm() < FORCE_NOISE,
            "{wrench:?} {force}"
        );
        assert!((wrench.torque - torque).norm() < 1e-9);
    }
    let noise = campaign.noise.unwrap();
    // 1.2 s at 50 a second: 60 independent samples
    assert!(noise.force > 0.3 * FORCE_NOISE / 60_f64.sqrt(), "{noise:?}");
    assert!(noise.force < 3.0 * FORCE_NOISE / 60_f64.sqrt(), "{noise:?}");
}

#[test]
fn where_nothing_moves_the_offset_is_unknown() {
    let cell = Cell {
        postures: 0,
        offset: 3.9,
        ..Cell::default()
    };
    let recorded = cell.record(23);
    let import = recorded.import("");
    let clock = &import.clocks[0];
    println!("{clock:?}");
    assert_eq!(clock.status, clock::Status::Unknown);
    assert!(!import.clocks_are_known());
    assert_eq!(import.campaign.unwrap().readings.len(), 1);
    let spec = recorded.spec("");
    misfit(
        &["import", text(&recorded.path), "--spec", text(&spec)],
        3,
        "OFFSET UNKNOWN",
    );
}

#[test]
fn a_motion_that_repeats_itself_leaves_the_offset_unknown() {
    let cell = Cell {
        postures: 20,
        repetitive: true,
        offset: 3.9,
        ..Cell::default()
    };
    let recorded = cell.record(27);
    let clock = &recorded.import("").clocks[0];
    println!("{clock:?}");
    assert_eq!(clock.status, clock::Status::Unknown);
    assert!(clock.why.as_ref().unwrap().contains("another offset"));
    // where the clocks cannot be a whole period apart it is known
    let clock = &recorded.import("[clock]\nmax_offset_s = 3.95").clocks[0];
    assert!((clock.offset_s - 3.9).abs() < CLOCK, "{clock:?}");
}

#[test]
fn where_the_tracker_loses_sight_stops_are_dropped() {
    let cell = Cell {
        lost: Some((0.4, 0.6)),
        offset: 3.9,
        ..Cell::default()
    };
    let recorded = cell.record(24);
    let import = recorded.import("");
    assert!((import.clocks[0].offset_s - 3.9).abs() < CLOCK);
    let length = recorded.visits.last().unwrap().to;
    let lost = |visit: &&Visit| {
        let (a, b) = (visit.from / length, visit.to / length);
        a > 0.4 && b < 0.6
    };
    let lost = recorded.visits.iter().filter(lost).count();
    let dropped: usize = import.dwells.dropped.iter().map(|d| d.stops).sum();
    // those at the edges are in sight for a part
    assert!(
        (lost..=lost + 2).contains(&dropped),
        "{lost} {:?}",
        import.dwells
    );
    assert_eq!(import.dwells.readings + dropped, recorded.visits.len());
    assert!(import.streams[1].not_finite > 500);
}

#[test]
fn a_given_offset_is_used_and_contradicted() {
    let cell = Cell {
        offset: 0.2,
        postures: 4,
        ..Cell::default()
    };
    let recorded = cell.record(25);
    let import = recorded.import("[clock]\ntracker_offset_s = 0.2");
    assert_eq!(import.clocks[0].status, clock::Status::Given);
    recorded.check(&import);
    let import = recorded.import("[clock]\ntracker_offset_s = 1.2");
    assert!(
        import.warnings[0].contains("the motion says"),
        "{:?}",
        import.warnings
    );
}

#[test]
fn a_wrong_unit_is_seen() {
    let cell = Cell {
        postures: 4,
        ..Cell::default()
    };
    let recorded = cell.record(26);
    let import = recorded.import("unit = \"mm\"");
    assert!(
        import.warnings[0].contains("times as far"),
        "{:?}",
        import.warnings
    );
}

#[test]
fn refusals_name_what_is_accepted() {
    let cell = Cell {
        postures: 2,
        ..Cell::default()
    };
    let recorded = cell.record(30);
    let of = |more: &str, words: &[&str]| {
        let message = recorded.refused(more);
        for word in words {
            assert!(message.contains(word), "{message}\nlacks {word:?}");
        }
    };
    of("wrensh = 1", &["import.toml", "wrensh", "wrench"]);
    of(
        "unit = \"inch\"",
        &["import.toml", "target.unit", "inch", "mm"],
    );
    of("[dwell]\nmin_s = -1", &["dwell.min_s", "-1", "3600"]);
    of("[dwell]\nmin = 1", &["import.toml", "min_s", "settle_s"]);
    of("[clock]\nmax_offset_s = nan", &["clock.max_offset_s"]);
    of("wrench_sign = 2", &["target.wrench_sign", "-1"]);
    of("wrench_link = \"base\"", &["target.wrench_link", "base"]);
    of(
        "wrench = \"/joint_states\"",
        &[
            "/joint_states",
            "sensor_msgs/msg/JointState",
            "WrenchStamped",
        ],
    );
    of(
        "wrench = \"/ft\"",
        &[
            "/ft",
            "/tracker (geometry_msgs/msg/PoseStamped",
            "/rosout",
            "messages",
        ],
    );
    let top = std::fs::read_to_string(recorded.spec("")).unwrap();
    std::fs::write(
        recorded.folder.path().join("import.toml"),
        format!("joints = \"/tracker\"\n{top}"),
    )
    .unwrap();
    let spec = Spec::load(&recorded.folder.path().join("import.toml")).unwrap();
    let bag = read_bag(&recorded.path, |t| spec.wants(&t.topic)).unwrap();
    let message = bag::import(&bag, &spec).unwrap_err().to_string();
    assert!(
        message.contains("accepted: sensor_msgs/msg/JointState"),
        "{message}"
    );
}

#[test]
fn transforms_need_a_pair_of_frames_that_is_there() {
    let cell = Cell {
        tracker: "tf",
        postures: 2,
        ..Cell::default()
    };
    let recorded = cell.record(31);
    for more in ["", "frames = [\"tracker\", \"prob\"]"] {
        let message = recorded.refused(more);
        assert!(message.contains("[\"tracker\", \"probe\"]"), "{message}");
    }
}

#[test]
fn a_bag_cut_off_or_damaged_anywhere_is_refused() {
    let cell = Cell {
        postures: 2,
        ..Cell::default()
    };
    let recorded = cell.record(32);
    let whole = std::fs::read(&recorded.path).unwrap();
    let mut random = random(32);
    for round in 0..60 {
        let mut bytes = whole.clone();
        if round % 2 == 0 {
            bytes.truncate(random.random_range(0..whole.len()));
        } else {
            for _ in 0..20 {
                let place = random.random_range(8..bytes.len());
                bytes[place] = random.random();
            }
        }
        std::fs::write(&recorded.path, &bytes).unwrap();
        match read_bag(&recorded.path, |_| true) {
            Err(RecordingError::Damaged { problem, .. }) => {
                assert!(problem.contains("mcap recover"))
            }
            // a byte may hit what has no checksum: names, times
            Err(_) => {}
            Ok(_) => assert!(round % 2 == 1, "cut off and not refused"),
        }
    }
}

#[test]
fn other_storages_are_refused_with_a_remedy() {
    let folder = tempfile::tempdir().unwrap();
    for (name, remedy) in [
        ("a.db3", "ros2 bag convert"),
        ("a.mcap.zstd", "zstd -d"),
        ("a.bag", "rosbags-convert"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, b"x").unwrap();
        for path in [path.as_path(), folder.path()] {
            let message = read_bag(path, |_| true).unwrap_err().to_string();
            assert!(message.contains(remedy), "{message}");
        }
        std::fs::remove_file(path).unwrap();
    }
    let message = read_bag(folder.path(), |_| true).unwrap_err().to_string();
    assert!(message.contains("without .mcap files"), "{message}");
}

#[test]
fn a_folder_is_one_bag_and_the_whole_way_recovers() {
    let cell = Cell {
        offset: 3.9,
        postures: 14,
        ..Cell::default()
    };
    let recorded = cell.record(40);
    let spec = recorded.spec("");
    let folder = recorded.folder.path().join("bag");
    std::fs::create_dir(&folder).unwrap();
    std::fs::copy(&recorded.path, folder.join("bag_0.mcap")).unwrap();
    // without a spec: topics, and one to start from
    misfit(&["import", text(&folder)], 0, "tracker = \"/tracker\"");
    let out = recorded.folder.path().join("campaign");
    let said = misfit(
        &[
            "import",
            text(&folder),
            "--spec",
            text(&spec),
            "-o",
            text(&out),
        ],
        0,
        "next     misfit fit",
    );
    println!("{said}");
    let campaign = out.join("campaign.toml");
    let fit = misfit(
        &[
            "fit",
            text(&campaign),
            "--effects",
            "joint_offset",
            "--json",
        ],
        0,
        "",
    );
    let fit: serde_json::Value = serde_json::from_str(&fit).unwrap();
    let rms = fit["fit"]["position_rms_m"].as_f64().unwrap();
    // means of 100 samples and more, three coordinates
    assert!(rms < POSITION_NOISE, "{rms}");
    let table = &fit["parameters"].as_array().unwrap().clone();
    let offsets = table.iter().filter(|p| p["effect"] == "joint_offset");
    for offset in offsets.filter(|p| p["status"] == "estimated") {
        let value = offset["value"].as_f64().unwrap();
        let std = offset["std"].as_f64().unwrap();
        assert!(value.abs() < 5.0 * std, "{offset}");
    }
    // and as a recording, which is not imported twice
    let out = recorded.folder.path().join("campaign.mcap");
    let json = misfit(
        &[
            "import",
            text(&folder),
            "--spec",
            text(&spec),
            "-o",
            text(&out),
            "--json",
        ],
        0,
        "",
    );
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json["schema"], "misfit.import/1");
    assert!((json["clocks"][0]["offset_s"].as_f64().unwrap() - 3.9).abs() < CLOCK);
    misfit(&["fit", text(&out), "--effects", "joint_offset"], 0, "");
    misfit(&["import", text(&out)], 1, "is a campaign already");
    // nothing that is read is written over
    misfit(
        &[
            "import",
            text(&recorded.path),
            "--spec",
            text(&spec),
            "-o",
            text(&recorded.path),
        ],
        1,
        "nothing was written",
    );
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs the program; its exit code must be this, and one of its outputs hold these words. Its stdout.
fn misfit(arguments: &[&str], code: i32, words: &str) -> String {
    let ran = Command::new(env!("CARGO_BIN_EXE_misfit"))
        .args(arguments)
        .output()
        .unwrap();
    let (out, err) = (
        String::from_utf8(ran.stdout).unwrap(),
        String::from_utf8(ran.stderr).unwrap(),
    );
    assert_eq!(ran.status.code(), Some(code), "{out}{err}");
    assert!(
        out.contains(words) || err.contains(words),
        "{words:?} is not in\n{out}{err}"
    );
    // paths of what comes next are as long as they are
    let json = arguments.contains(&"--json");
    let long = |line: &&str| !json && line.chars().count() > 100 && !line.starts_with("next");
    assert_eq!(out.lines().find(long), None, "{out}");
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Any offset, any motion, slow trackers: right to a tenth of the tracker's interval, or said to be unknown.
    #[test]
    fn an_offset_is_right_or_unknown(seed in 100u64..10_000, offset in -25.0..25.0, hz in 8.0..120.0) {
        let cell = Cell { offset, tracker_hz: hz, postures: 5, ..Cell::default() };
        let recorded = cell.record(seed);
        let import = recorded.import("");
        let clock = &import.clocks[0];
        if clock.status == clock::Status::Estimated {
            let off = (clock.offset_s - offset).abs();
            prop_assert!(off < 0.1 / hz + 1e-3, "{off} s at {hz} Hz: {clock:?}");
        }
    }
}

#[test]
fn stamps_that_are_years_off_cost_no_time() {
    let recorded = Cell {
        postures: 4,
        ..Cell::default()
    }
    .record(41);
    let spec = Spec::load(&recorded.spec("")).unwrap();
    let mut bag = read_bag(&recorded.path, |topic| spec.wants(&topic.topic)).unwrap();
    // the clock was set when the record ended
    let years = 20 * 365 * 86_400 * 1_000_000_000_i64;
    for samples in bag.samples.values_mut() {
        let last = match samples {
            Samples::Joints(all) => &mut all.last_mut().unwrap().0,
            Samples::Poses(all) => &mut all.last_mut().unwrap().0,
            other => panic!("{other:?}"),
        };
        last.header += years;
    }
    let start = std::time::Instant::now();
    let import = bag::import(&bag, &spec).unwrap();
    let took = start.elapsed();
    assert!(took < std::time::Duration::from_secs(60), "took {took:?}");
    assert!(
        import.dwells.stops >= recorded.visits.len(),
        "{:?}",
        import.dwells
    );
}

#[test]
fn positions_beyond_numbers_do_not_keep_the_clock_busy() {
    let recorded = Cell {
        postures: 4,
        ..Cell::default()
    }
    .record(42);
    let spec = Spec::load(&recorded.spec("")).unwrap();
    for size in [1e200, -1e308] {
        let mut bag = read_bag(&recorded.path, |topic| spec.wants(&topic.topic)).unwrap();
        let Some(Samples::Poses(all)) = bag.samples.get_mut("/tracker") else {
            panic!("no poses");
        };
        let middle = all.len() / 2;
        all[middle].1.x = size;
        let import = bag::import(&bag, &spec).unwrap();
        // one sample says nothing of the clock, and the others still do
        let offset = import.clocks[0].offset_s;
        assert!(offset.abs() < CLOCK, "{:?}", import.clocks);
    }
}
