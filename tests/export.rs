//! Exported files: is the robot in them the one that was measured? Read back by the robot reader and by MuJoCo, against the
//! model without load and against the plant; and what the command line makes of them.

use crate::common::{
    Part, Twins, about_typical, apart, campaign, effect, expression, file, motion, pose_of,
    posture, random, reading, sda5f, setup, six_axis, sliding, springs,
};
use assert_cmd::Command;
use misfit_arm::robot::{JointKind, Robot};
use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Reading, RobotFile};
use misfit_core::effects::{EffectList, Role};
use misfit_core::export::{Calibrated, ExportError, dh, urdf};
use misfit_core::fit::{self, Options};
use misfit_core::model::{Model, Workspace, pose_numbers};
use misfit_core::model_file;
use misfit_plant::mujoco::{Data, Kind};
use nalgebra::{Isometry3, Vector3};
use proptest::prelude::*;
use rand::{Rng, RngExt};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use tempfile::TempDir;

/// Chains of a dozen motions of up to 2 m, 1e-15 each. Asked for: 1e-9.
const ROUNDING: f64 = 1e-12;

/// A robot file's text.
fn text_of(path: &str) -> (String, String) {
    let text = fs::read_to_string(file(path)).unwrap();
    let name = Path::new(path).file_name().unwrap().to_str().unwrap();
    (name.to_owned(), text)
}

/// A campaign without readings of a robot in this file.
fn empty(setup: &Setup, (name, text): (String, String)) -> Campaign {
    let mut campaign = campaign(setup, Vec::new());
    campaign.robot_file = RobotFile {
        name,
        text,
        base: None,
    };
    campaign
}

/// A model of these parts with all their values.
fn model(setup: &Setup, parts: &[Part]) -> (Model, Vec<f64>) {
    let effects: Vec<_> = parts.iter().map(|part| part.effect.clone()).collect();
    let values = parts.iter().flat_map(|part| part.values.clone()).collect();
    (Model::new(setup.clone(), &effects), values)
}

/// Frames anywhere, and every rigid error.
fn rigid(setup: &Setup, random: &mut impl Rng) -> Vec<Part> {
    let tracker = pose_numbers(&motion(random)).to_vec();
    let targets = setup.targets.iter();
    let targets = targets
        .flat_map(|_| {
            pose_numbers(&Isometry3::new(
                crate::common::vector(random) * 0.1,
                crate::common::vector(random),
            ))
        })
        .collect();
    vec![
        Part {
            effect: effect("tracker_frame"),
            values: tracker,
        },
        Part {
            effect: effect("target_offset"),
            values: targets,
        },
        about_typical(setup, "joint_offset", 3.0, random),
        about_typical(setup, "geometry", 1.0, random),
    ]
}

/// Pose of a link in the base frame.
fn link_at(robot: &Robot, name: &str, joints: &[f64]) -> Isometry3<f64> {
    let link = &robot.links[robot.link(name).unwrap_or_else(|| panic!("no link {name}"))];
    robot.body_poses(joints)[link.body] * link.body_from_link
}

/// Angles of a robot's joints by their names in another.
fn named(robot: &Robot, other: &Robot, joints: &[f64]) -> Vec<f64> {
    let own = robot.joints.iter();
    own.map(|joint| joints[other.joint(&joint.name).unwrap()])
        .collect()
}

#[track_caller]
fn assert_same(a: &Isometry3<f64>, b: &Isometry3<f64>, most: f64, what: &str) {
    let (position, angle) = apart(a, b);
    assert!(
        position < most && angle < most,
        "{what}: {position:e} m, {angle:e} rad"
    );
}

/// Robots of the tests that are URDFs, each with its text.
fn urdfs() -> Vec<(Setup, (String, String))> {
    let urdf = |setup, path| (setup, text_of(path));
    vec![
        urdf(sda5f(), "models/sda5f/sda5f.urdf"),
        urdf(six_axis(), "models/six_axis/six_axis.urdf"),
    ]
}

/// In the frame of the tracker that the file itself has, its targets are where the model says that the tracker sees them.
#[test]
fn a_urdf_stands_where_the_model_says_and_mujoco_reads_it_so() {
    let mut random = random(1);
    for (setup, (name, text)) in urdfs() {
        // MuJoCo keeps every link then
        let text = text.replace(
            "<material name=\"dark\">",
            "<mujoco><compiler fusestatic=\"false\"/></mujoco>\n  <material name=\"dark\">",
        );
        let campaign = empty(&setup, (name, text));
        let (model, p) = model(&setup, &rigid(&setup, &mut random));
        let calibrated = Calibrated::new(&model, &p, &[]);
        assert_eq!(calibrated.held.len(), 4);
        let made = urdf::write(&calibrated, &campaign, "out.urdf", "a note").unwrap();
        let read = Robot::parse("out.urdf", &made.text, None).unwrap();
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("out.urdf");
        fs::write(&path, &made.text).unwrap();
        let mujoco = misfit_plant::mujoco::Model::from_xml_file(&path).unwrap();
        let mut mujoco = Data::new(mujoco).unwrap();
        let mut workspace = Workspace::new(&setup);
        for _ in 0..100 {
            let joints = posture(&setup.robot, &mut random);
            for (joint, &q) in setup.robot.joints.iter().zip(&joints) {
                let id = mujoco.model().find(Kind::Joint, &joint.name).unwrap();
                let address = mujoco.model().joint(id).unwrap().qpos;
                mujoco.qpos_mut()[address] = q;
            }
            mujoco.update_position().unwrap();
            for (index, target) in setup.targets.iter().enumerate() {
                let wanted =
                    pose_of(&workspace.predict(&model, &p, &reading(index, joints.clone())));
                let probe = format!("{}_target", target.name);
                let own = named(&read, &setup.robot, &joints);
                let here = link_at(&read, "tracker", &own).inverse() * link_at(&read, &probe, &own);
                assert_same(&here, &wanted, ROUNDING, &probe);
                let body = |name: &str| {
                    let body = mujoco.model().find(Kind::Body, name).unwrap();
                    mujoco.body_pose(body).unwrap()
                };
                let there = body("tracker").inverse() * body(&probe);
                assert_same(&there, &wanted, ROUNDING, "MuJoCo's");
                // the target link's own name means the calibrated frame
                let link = &setup.robot.links[target.link].name;
                let calibrated = link_at(&calibrated.robot(), link, &joints);
                assert_same(&body(link), &calibrated, ROUNDING, link);
            }
        }
    }
}

/// The whole way: a plant with errors, its campaign, a fit, a file; and the plant again at other postures.
/// 1e-9: what a fit without noise leaves.
#[test]
fn files_made_from_a_fit_are_the_plant() {
    let mut random = random(2);
    for (setup, file) in urdfs() {
        let mut twins = Twins::new(&setup, &rigid(&setup, &mut random));
        let readings = |count: usize, random: &mut rand_pcg::Pcg64Mcg| -> Vec<Reading> {
            let targets = setup.targets.len();
            let one = |index: usize| reading(index % targets, posture(&setup.robot, random));
            (0..count).map(one).collect()
        };
        let own = readings(60, &mut random);
        let mut campaign = twins.campaign(own);
        (campaign.robot_file.name, campaign.robot_file.text) = file;
        let model = model_file::model(&campaign, &EffectList::only(Role::Geometry), None).unwrap();
        let options = Options {
            cross_validate: false,
        };
        let found = fit::fit(&campaign, &model, &options, |_| {}).unwrap();
        let calibrated = Calibrated::of(&found, &campaign);
        let made = urdf::write(&calibrated, &campaign, "out.urdf", "").unwrap();
        let read = Robot::parse("out.urdf", &made.text, None).unwrap();
        for reading in readings(40, &mut random) {
            let (seen, _) = twins.measure(&reading);
            let wanted = crate::common::pose_seen(&seen);
            let probe = format!("{}_target", setup.targets[reading.target].name);
            let own = named(&read, &setup.robot, &reading.joints);
            let here = link_at(&read, "tracker", &own).inverse() * link_at(&read, &probe, &own);
            assert_same(&here, &wanted, 1e-9, "URDF");
            let target = reading.target;
            let table = dh::write(&calibrated, &campaign, target, ("out.toml", ""), false).unwrap();
            let read = Robot::parse("out.toml", &table.text, None).unwrap();
            let own = named(&read, &setup.robot, &reading.joints);
            let here = found_frames(&calibrated, target, &link_at(&read, "flange", &own));
            assert_same(&here, &wanted, 1e-9, "DH table");
        }
    }
}

/// tracker_from_target with the frames of a fit.
fn found_frames(
    calibrated: &Calibrated,
    target: usize,
    base_from_link: &Isometry3<f64>,
) -> Isometry3<f64> {
    calibrated.base_from_tracker.unwrap().inverse()
        * base_from_link
        * calibrated.link_from_target[target].unwrap()
}

const STANDARD: &str = "name = \"arm\"\nconvention = \"standard\"\n\
    [base]\nxyz_m = [0.1, -0.2, 0.3]\nrpy_deg = [10, 20, 30]\nmass_kg = 4\n\
    [[joint]]\nname = \"one\"\nalpha_deg = 90\na_mm = 150\nd_mm = 243\ntheta_deg = 30\nmass_kg = 12\n\
    com_mm = [10, 20, 30]\nlower_deg = -170\nupper_deg = 160\n\
    [[joint]]\nname = \"two\"\nkind = \"continuous\"\na_mm = 700\nd_mm = -43\nmass_kg = 7\neffort_Nm = 90\n\
    [[joint]]\nname = \"three\"\nalpha_deg = -90\na_mm = 70\nd_mm = -43\ntheta_deg = 180\n\
    [[joint]]\nname = \"slide\"\nkind = \"prismatic\"\nalpha_deg = 20\na_mm = 30\ntheta_deg = -20\nlower_m = -0.3\n\
    upper_m = 0.4\neffort_N = 300\n\
    [[joint]]\nname = \"last\"\nalpha_deg = 70\na_mm = 30\nd_mm = 5\n\
    [tool]\nxyz_mm = [0, 100, 200]\nrpy_deg = [10, 20, 30]\nmass_kg = 2\ncom_mm = [1, 2, 3]\n";

/// The SDA5F's own tables, a standard one with a slide and parallel axes, and both arms of the SDA5F from the URDF.
#[test]
fn a_dh_table_stands_where_the_model_says() {
    let mut random = random(3);
    let mut cases: Vec<(Setup, (String, String))> = Vec::new();
    for arm in ["r1", "r2"] {
        let path = format!("models/sda5f/{arm}_dh.toml");
        let robot = Robot::load(&file(&path), None).unwrap();
        cases.push((setup(robot, &["flange"]), text_of(&path)));
    }
    let robot = Robot::parse("standard.toml", STANDARD, None).unwrap();
    let standard = ("standard.toml".to_owned(), STANDARD.to_owned());
    cases.push((setup(robot, &["flange"]), standard));
    cases.extend(urdfs());
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("out.toml");
    for (setup, source) in cases {
        let is_standard = source.0 == "standard.toml";
        let campaign = empty(&setup, source);
        let (model, p) = model(&setup, &rigid(&setup, &mut random));
        let calibrated = Calibrated::new(&model, &p, &[]);
        let mut workspace = Workspace::new(&setup);
        for target in 0..setup.targets.len() {
            let made = dh::write(&calibrated, &campaign, target, ("out.toml", "x"), false).unwrap();
            assert_eq!(made.corrected.modified, !is_standard);
            fs::write(&path, &made.text).unwrap();
            let read = Robot::load(&path, None).unwrap();
            for _ in 0..100 {
                let joints = posture(&setup.robot, &mut random);
                let own = named(&read, &setup.robot, &joints);
                let here = found_frames(&calibrated, target, &link_at(&read, "flange", &own));
                let seen = workspace.predict(&model, &p, &reading(target, joints));
                assert_same(&here, &pose_of(&seen), ROUNDING, "table");
            }
            // what is beside the kinematics
            for joint in &read.joints {
                let old = &setup.robot.joints[setup.robot.joint(&joint.name).unwrap()];
                assert_eq!(joint.kind, old.kind);
                assert_eq!(joint.effort, old.effort);
                let limits = |limits: Option<(f64, f64)>| limits.map(|(a, b)| [a, b]);
                assert_eq!(limits(joint.limits), limits(old.limits));
            }
        }
        // the same robot as a URDF
        let made = urdf::write(&calibrated, &campaign, "out.urdf", "").unwrap();
        let read = Robot::parse("out.urdf", &made.text, None).unwrap();
        let joints = posture(&setup.robot, &mut random);
        for (index, target) in setup.targets.iter().enumerate() {
            let own = named(&read, &setup.robot, &joints);
            let probe = format!("{}_target", target.name);
            let here = link_at(&read, "tracker", &own).inverse() * link_at(&read, &probe, &own);
            let seen = workspace.predict(&model, &p, &reading(index, joints.clone()));
            assert_same(&here, &pose_of(&seen), ROUNDING, "URDF of a table");
        }
    }
}

/// Masses go where the joints' axes have them: each body's centre, seen from the base.
#[test]
fn masses_stay_at_their_places_and_heavier_links_are_heavier() {
    let mut random = random(4);
    let robot = Robot::parse("standard.toml", STANDARD, None).unwrap();
    let standard = ("standard.toml".to_owned(), STANDARD.to_owned());
    let mut cases = urdfs();
    cases.push((setup(robot, &["flange"]), standard));
    for (setup, source) in cases {
        let campaign = empty(&setup, source);
        let mut parts = rigid(&setup, &mut random);
        parts.push(about_typical(&setup, "link_mass", 1.0, &mut random));
        let (model, p) = model(&setup, &parts);
        let added = parts[4].values.clone();
        let calibrated = Calibrated::new(&model, &p, &[]);
        let made = urdf::write(&calibrated, &campaign, "out.urdf", "").unwrap();
        let read = Robot::parse("out.urdf", &made.text, None).unwrap();
        let table = dh::write(&calibrated, &campaign, 0, ("out.toml", ""), false).unwrap();
        let table = Robot::parse("out.toml", &table.text, None).unwrap();
        // where the model has them
        let (moved, joints) = (calibrated.robot(), posture(&setup.robot, &mut random));
        let poses = moved.body_poses(&joints);
        for (place, &joint) in setup.observed.iter().enumerate() {
            let name = &setup.robot.joints[joint].name;
            let wanted = setup.robot.bodies[joint + 1].mass + added[place];
            // node motions by nalgebra's own exponential
            let d = &parts[3].values[6 * place..6 * place + 6];
            let motion = Isometry3::new(
                Vector3::new(d[0], d[1], d[2]),
                Vector3::new(d[3], d[4], d[5]),
            );
            let centre = motion * nalgebra::Point3::from(setup.robot.bodies[joint + 1].com);
            let centre = poses[joint + 1] * centre;
            for other in [&read, &table] {
                let Some(own) = other.joint(name) else {
                    continue;
                };
                let body = &other.bodies[own + 1];
                // one part in 1e12: shares of masses multiplied
                assert!(
                    (body.mass - wanted).abs() < 1e-12 * wanted.max(1.0),
                    "{name}"
                );
                let there = other.body_poses(&named(other, &setup.robot, &joints))[own + 1];
                let gap = there * nalgebra::Point3::from(body.com) - centre;
                assert!(gap.norm() < ROUNDING, "{name}: {}", gap.norm());
            }
        }
    }
}

/// Where nothing was found, no byte changes; where something was, only numbers do.
#[test]
fn a_users_file_stays_as_it_is() {
    let own = "<?xml version='1.0'?>\n<!-- mine -->\n<robot name='r' xmlns:x='y'>\n\
        <link name='base'/>\n<gazebo reference='a &amp; b'><material>Orange</material></gazebo>\n\
        <joint name='one' type='revolute'><parent link='base'/><child link='a &amp; b'></child>\
        <axis xyz='0 0 1'/><limit lower='-1' upper='1' effort='3' velocity='4'/>\
        <safety_controller k_velocity='2'/></joint>\n\
        <link name='a &amp; b'><visual><geometry><mesh filename='package://p/m.stl' scale='1 1 1'/></geometry></visual>\n\
        <collision name='c'><origin xyz='0.1 0 0'></origin><geometry><sphere radius='0.1'/></geometry></collision></link>\n\
        <joint name='two' type='prismatic'><origin rpy='0.1 0.2 0.3'/><parent link='a &amp; b'/><child link='tip'/>\
        <axis xyz='1 1 0'/><limit lower='-1' upper='1' effort='3' velocity='4'/></joint>\n\
        <link name='tip'><inertial><mass value='2'/><origin xyz='0 0 0.1'/>\
        <inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>\n\
        <link name='tracker'/><joint name='tracker_fixed' type='fixed'><parent link='base'/><child link='tracker'/></joint>\n\
        <transmission name='t'><joint name='one'><hardwareInterface>x</hardwareInterface></joint></transmission>\n</robot>\n";
    let robot = Robot::parse("own.urdf", own, None).unwrap();
    let setup = setup(robot, &["tip"]);
    let campaign = empty(&setup, ("own.urdf".to_owned(), own.to_owned()));
    let (nothing, none) = model(&setup, &[]);
    let made = urdf::write(
        &Calibrated::new(&nothing, &none, &[]),
        &campaign,
        "o.urdf",
        "a -- b",
    )
    .unwrap();
    let comment = "\n  <!-- a - - b -->";
    assert_eq!(made.text.replacen(comment, "", 1), own);
    let mut random = random(5);
    let mut parts = rigid(&setup, &mut random);
    parts.push(about_typical(&setup, "link_mass", 1.0, &mut random));
    let (model, p) = model(&setup, &parts);
    let made = urdf::write(&Calibrated::new(&model, &p, &[]), &campaign, "o.urdf", "").unwrap();
    for kept in [
        "<!-- mine -->",
        "<gazebo reference='a &amp; b'><material>Orange</material></gazebo>",
        "<mesh filename='package://p/m.stl' scale='1 1 1'/>",
        "<safety_controller k_velocity='2'/>",
        "<limit lower='-1' upper='1' effort='3' velocity='4'/>",
        "<transmission name='t'><joint name='one'><hardwareInterface>",
        "<child link='a &amp; b'></child>",
    ] {
        assert!(made.text.contains(kept), "{kept} is gone:\n{}", made.text);
    }
    // the target's link is moved by a joint itself: a link comes between, and names that are taken stay so
    assert_eq!(made.added, ["tip_axis", "tracker_", "tip_target"]);
    let read = Robot::parse("o.urdf", &made.text, None).unwrap();
    let mut workspace = Workspace::new(&setup);
    for _ in 0..20 {
        let joints = posture(&setup.robot, &mut random);
        let seen = pose_of(&workspace.predict(&model, &p, &reading(0, joints.clone())));
        let here =
            link_at(&read, "tracker_", &joints).inverse() * link_at(&read, "tip_target", &joints);
        assert_same(&here, &seen, ROUNDING, "through the link between");
    }
    // a body that weighed nothing weighs something now
    let added = parts[4].values[0];
    let own = read.bodies[1].mass;
    assert!(
        added > 0.0 && (own - added).abs() < 1e-15,
        "{own} for {added}"
    );
}

/// What bends, slips or winds is left out with its size; constants of the user's own are in; the tracker's errors are neither.
#[test]
fn only_what_is_the_same_in_every_posture_is_rigid() {
    let setup = six_axis();
    let mut random = random(6);
    let law = |law: &str, name: &str, acts_on: &str| Part {
        effect: expression(
            &setup,
            &format!(
                "name = \"{name}\"\nacts_on = \"{acts_on}\"\nlaw = \"{law}\"\n\
                 parameters = {{ a = {{ unit = \"rad\", typical = 1e-3 }} }}"
            ),
        ),
        values: vec![2e-3],
    };
    let parts = vec![
        about_typical(&setup, "geometry", 1.0, &mut random),
        about_typical(&setup, "backlash", 1.0, &mut random),
        about_typical(&setup, "transmission_error", 1.0, &mut random),
        about_typical(&setup, "gravity_direction", 1.0, &mut random),
        about_typical(&setup, "payload_mass", 1.0, &mut random),
        about_typical(&setup, "thermal_expansion", 1.0, &mut random),
        about_typical(&setup, "tracker_scale", 1.0, &mut random),
        about_typical(&setup, "frame_drift", 1.0, &mut random),
        about_typical(&setup, "ft_bias", 1.0, &mut random),
        springs(&setup, &[1e5; 6]),
        law("a", "shift", "rx[a3]"),
        law("a*sin(q[a2])", "wave", "q[a3]"),
        law("a*payload", "weight", "q[a3]"),
    ];
    let (model, p) = model(&setup, &parts);
    let readings: Vec<Reading> = (0..20)
        .map(|_| Reading {
            payload: Some(crate::common::payload(5.0)),
            ..reading(0, posture(&setup.robot, &mut random))
        })
        .collect();
    let calibrated = Calibrated::new(&model, &p, &readings);
    assert_eq!(calibrated.held, ["geometry", "shift"]);
    let out: Vec<&str> = calibrated
        .left_out
        .iter()
        .map(|out| out.effect.as_str())
        .collect();
    assert_eq!(
        out,
        [
            "backlash",
            "transmission_error",
            "gravity_direction",
            "payload_mass",
            "thermal_expansion",
            "joint_compliance",
            "wave",
            "weight"
        ]
    );
    // 2 mrad of a3 times the payload's 5 kg, at an arm of 1 m: about 1 cm
    let weight = &calibrated.left_out[7];
    assert!((2e-3..3e-2).contains(&weight.rms), "{weight:?}");
    assert!(weight.most >= weight.rms);
    // in no reading does anything come from directions alone: none has a joint's approach
    assert_eq!(calibrated.left_out[0].rms, 0.0);
    let shift = &calibrated.motions[3];
    let geometry = &parts[0].values[12..18];
    let wanted = Isometry3::new(
        Vector3::new(geometry[0], geometry[1], geometry[2]),
        Vector3::new(geometry[3] + 2e-3, geometry[4], geometry[5]),
    );
    assert_same(shift, &wanted, 1e-15, "a constant beside geometry");
}

/// Nearly parallel axes: a fifth number keeps the others what they were; without it the table is refused where absurd.
#[test]
fn nearly_parallel_axes_have_a_fifth_number() {
    let setup = six_axis();
    let campaign = empty(&setup, text_of("models/six_axis/six_axis.urdf"));
    let made = |rx: f64, ry: f64, four: bool| {
        let geometry = effect("geometry");
        let mut values = vec![0.0; geometry.parameters(&setup).len()];
        (values[6 + 3], values[6 + 4], values[6]) = (rx, ry, 3e-4);
        let (model, p) = model(
            &setup,
            &[Part {
                effect: geometry,
                values,
            }],
        );
        dh::write(
            &Calibrated::new(&model, &p, &[]),
            &campaign,
            0,
            ("t.toml", ""),
            four,
        )
    };
    // a2 and a3 lie along y, 0.85 m apart along z: about x they part, about z they meet
    let both = made(1e-3, 2e-3, false).unwrap();
    assert_eq!(both.corrected.fifths(), ["a3"]);
    assert!(both.corrected.far_from(&both.nominal).is_empty());
    assert!(both.nominal.fifths().is_empty());
    let exact = made(0.0, 2e-3, true).unwrap();
    assert!(
        exact.corrected.fifths().is_empty() && exact.corrected.far_from(&exact.nominal).is_empty()
    );
    let refused = made(1e-3, 0.0, true).unwrap_err();
    assert!(matches!(refused, ExportError::Parallel { .. }), "{refused}");
    let words = refused.to_string();
    assert!(
        words.contains("--four-numbers") && words.contains(".urdf"),
        "{words}"
    );
    // 0.85 m at 40 mrad: four numbers are long ones, and exact
    let long = made(4e-2, 0.0, true).unwrap();
    assert_eq!(long.corrected.far_from(&long.nominal), ["a2", "a3"]);
    assert!(long.gap.0 < 1e-9);
}

/// A random arm: any joints, axes and shapes, fixed links between, a branch; sometimes axes that meet or are parallel.
fn any_arm(random: &mut impl Rng) -> String {
    let mut urdf = "<robot name='any'><link name='l0'/>".to_owned();
    let joints = random.random_range(1..8);
    let numbers = |v: Vector3<f64>| format!("{:?} {:?} {:?}", v.x, v.y, v.z);
    let mut parent = "l0".to_owned();
    for index in 0..joints {
        let kind = ["revolute", "continuous", "prismatic"][random.random_range(0..3)];
        let whole = |random: &mut dyn FnMut() -> f64, size: f64| {
            Vector3::from_fn(|_, _| size * (random() * 2.0).round())
        };
        let mut draw = || random.random_range(-1.0..1.0);
        let (mut xyz, mut rpy) = (
            whole(&mut draw, 0.3),
            whole(&mut draw, std::f64::consts::FRAC_PI_4),
        );
        let mut axis = Vector3::z();
        if draw() > 0.0 {
            (xyz, rpy) = (
                Vector3::from_fn(|_, _| draw()),
                Vector3::from_fn(|_, _| 3.0 * draw()),
            );
            axis = Vector3::from_fn(|_, _| draw());
        }
        let child = format!("l{}", index + 1);
        urdf += &format!(
            "<joint name='j{index}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>\
             <origin xyz='{}' rpy='{}'/><axis xyz='{}'/><limit lower='-1.5' upper='1.2' effort='1' velocity='1'/></joint>\
             <link name='{child}'><inertial><origin xyz='0.1 0 0.2'/><mass value='{index}'/>\
             <inertia ixx='1' ixy='0' ixz='0' iyy='1' iyz='0' izz='1'/></inertial></link>",
            numbers(xyz),
            numbers(rpy),
            numbers(axis)
        );
        parent = child;
        if draw() > 0.3 {
            let fixed = format!("f{index}");
            urdf += &format!(
                "<joint name='{fixed}' type='fixed'><parent link='{parent}'/><child link='{fixed}'/>\
                 <origin xyz='{}' rpy='{}'/></joint><link name='{fixed}'/>",
                numbers(Vector3::from_fn(|_, _| draw())),
                numbers(Vector3::from_fn(|_, _| draw()))
            );
            if draw() > 0.0 {
                parent = fixed;
            }
        }
    }
    urdf + "</robot>"
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    /// Any arm with any errors comes back from a URDF and from a table, to 1e-9 (asked by the writer itself, too: what is
    /// written was read back), and again from the table's own URDF and table.
    #[test]
    fn any_rigid_robot_round_trips(seed: u64) {
        let mut random = random(seed);
        let text = any_arm(&mut random);
        let robot = Robot::parse("any.urdf", &text, None).unwrap();
        let last = robot.links.last().unwrap().name.clone();
        let links = [last.as_str()];
        let setup = setup(robot, &links);
        let mut source = ("any.urdf".to_owned(), text);
        let mut own = setup;
        let mut joints = None;
        // errors on errors: the second time on the table that the first one made
        for _ in 0..2 {
            let campaign = empty(&own, source.clone());
            let (model, p) = model(&own, &rigid(&own, &mut random));
            let calibrated = Calibrated::new(&model, &p, &[]);
            let probe = format!("{}_target", own.targets[0].name);
            let q = joints.get_or_insert_with(|| {
                own.robot.joints.iter().map(|_| random.random_range(-1.0..1.0)).collect::<Vec<f64>>()
            });
            let seen = pose_of(&Workspace::new(&own).predict(&model, &p, &reading(0, q.clone())));
            let made = urdf::write(&calibrated, &campaign, "o.urdf", "").unwrap();
            let read = Robot::parse("o.urdf", &made.text, None).unwrap();
            let here = link_at(&read, "tracker", q).inverse() * link_at(&read, &probe, q);
            let (position, angle) = apart(&here, &seen);
            prop_assert!(position < 1e-11 && angle < 1e-11, "URDF: {position:e}, {angle:e}");
            if own.robot.chain(own.target_body(0)).is_empty() {
                break;
            }
            let made = dh::write(&calibrated, &campaign, 0, ("o.toml", ""), false).unwrap();
            let read = Robot::parse("o.toml", &made.text, None).unwrap();
            let mine = named(&read, &own.robot, q);
            let here = found_frames(&calibrated, 0, &link_at(&read, "flange", &mine));
            let (position, angle) = apart(&here, &seen);
            prop_assert!(position < 1e-9 && angle < 1e-9, "table: {position:e}, {angle:e}");
            joints = Some(mine);
            source = ("o.toml".to_owned(), made.text);
            own = crate::common::setup(read, &["flange"]);
        }
    }
}

/// A slide between revolute joints, none along gravity: both forms.
#[test]
fn an_arm_that_slides_round_trips() {
    let setup = sliding();
    assert!(
        setup
            .robot
            .joints
            .iter()
            .any(|joint| joint.kind == JointKind::Prismatic)
    );
    let mut random = random(8);
    let (model, p) = model(&setup, &rigid(&setup, &mut random));
    let calibrated = Calibrated::new(&model, &p, &[]);
    // a campaign read from a recording has the robot's text; here a robot as a table stands for it
    let campaign = empty(&setup, ("sliding.urdf".to_owned(), String::new()));
    let lost = urdf::write(&calibrated, &campaign, "o.urdf", "").unwrap_err();
    assert!(lost.to_string().contains("sliding.urdf"), "{lost}");
    let made = dh::write(&calibrated, &campaign, 0, ("o.toml", ""), false).unwrap();
    assert!(
        made.gap.0 < ROUNDING && made.gap.1 < ROUNDING,
        "{:?}",
        made.gap
    );
}

fn misfit(folder: &Path, words: &[&str]) -> (Option<i32>, String, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    let output = command.current_dir(folder).args(words).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    let (out, err) = (text(output.stdout), text(output.stderr));
    assert!(!err.contains("panicked"), "{words:?}: {err}");
    let lines = out.lines().filter(|_| !words.contains(&"--json"));
    for line in lines {
        assert!(line.chars().count() <= 100, "too wide: {line}");
        assert_eq!(line, line.trim_end(), "trailing blanks");
    }
    (output.status.code(), out, err)
}

/// A campaign of one arm with a gear error, and one of two arms, in a folder.
static LAB: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = TempDir::new().unwrap();
    for (scenario, name) in [("hidden", "cell.mcap"), ("noise_free", "both.mcap")] {
        let scenario = file(&format!("scenarios/{scenario}.toml"));
        let words = ["simulate", scenario.to_str().unwrap(), "-o", name];
        let (code, _, err) = misfit(folder.path(), &words);
        assert_eq!(code, Some(0), "{err}");
    }
    folder
});

#[test]
fn the_command_writes_what_it_says() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    fs::copy(LAB.path().join("cell.mcap"), at.join("cell.mcap")).unwrap();
    let quiet = [
        "export",
        "cell.mcap",
        "--effects",
        "+transmission_error",
        "-o",
    ];
    let run = |name: &str| {
        let (code, out, err) = misfit(at, &[&quiet[..], &[name]].concat());
        assert_eq!((code, err.as_str()), (Some(0), ""), "{out}");
        for word in [
            "transmission_error",
            "joint_compliance",
            "misfit compensate cell.mcap",
            "wrote",
        ] {
            assert!(out.contains(word), "no {word}: {out}");
        }
        out
    };
    let out = run("found.json");
    assert!(out.contains("r1_e") && out.contains("mrad"), "{out}");
    let document: Value =
        serde_json::from_str(&fs::read_to_string(at.join("found.json")).unwrap()).unwrap();
    assert_eq!(document["schema"], "misfit.export/1");
    assert_eq!(document["robot"], "sda5f");
    assert_eq!(document["converged"], true);
    assert_eq!(document["rigid"].as_array().unwrap().len(), 3);
    let number = |value: &Value| value.as_f64().unwrap();
    // the scenario's truth: where the tracker stands, and the elbow's spring
    let tracker = &document["frames"]["base_from_tracker"]["xyz_m"];
    assert!((number(&tracker[2]) - 1.2).abs() < 5e-3, "{tracker}");
    let springs = document["stiffness"].as_array().unwrap();
    let spring = |name: &str| springs.iter().find(|row| row["joint"] == name).unwrap();
    let elbow = spring("r1_e");
    assert!(
        (number(&elbow["stiffness"]) - 18000.0).abs() < 500.0,
        "{elbow}"
    );
    assert!(
        number(&elbow["interval_95"][0]) < 18000.0 && number(&elbow["interval_95"][1]) > 18000.0
    );
    assert_eq!(spring("torso")["stiffness"], Value::Null);
    let left = document["not_rigid"].as_array().unwrap();
    assert_eq!(left[1]["effect"], "joint_compliance");
    assert!((1e-4..1e-2).contains(&number(&left[1]["rms_m"])));
    // the same robot three times
    run("cell.urdf");
    run("cell.table.toml");
    let urdf = Robot::load(&at.join("cell.urdf"), None).unwrap();
    let table = Robot::load(&at.join("cell.table.toml"), None).unwrap();
    let joints = posture(&urdf, &mut random(9));
    let flange = link_at(&urdf, "r1_flange", &joints);
    let other = link_at(&table, "flange", &named(&table, &urdf, &joints));
    assert_same(&other, &flange, 1e-9, "table and URDF");
    let tracker = link_at(&urdf, "tracker", &joints);
    assert!(
        (tracker.translation.z - number(&document["frames"]["base_from_tracker"]["xyz_m"][2]))
            .abs()
            < 1e-12
    );
    // the calibrated file in place of the robot's: what is left to fit leaves what the whole model left
    let scenario = file("scenarios/hidden.toml");
    let words = [
        "simulate",
        scenario.to_str().unwrap(),
        "-o",
        "c.mcap",
        "--csv",
        "csv",
    ];
    let (code, _, err) = misfit(at, &words);
    assert_eq!(code, Some(0), "{err}");
    let path = at.join("csv/campaign.toml");
    fs::copy(at.join("cell.urdf"), at.join("csv/cell.urdf")).unwrap();
    let campaign = fs::read_to_string(&path).unwrap();
    fs::write(&path, campaign.replace("\"sda5f.urdf\"", "\"cell.urdf\"")).unwrap();
    let effects = [
        "fit",
        "csv/campaign.toml",
        "--json",
        "--no-cross-validation",
        "--effects",
    ];
    let (code, out, err) = misfit(
        at,
        &[&effects[..], &["joint_compliance,transmission_error"]].concat(),
    );
    assert_eq!(code, Some(0), "{err}");
    let again: Value = serde_json::from_str(&out).unwrap();
    let (once, again) = (
        number(&document["position_rms_m"]),
        number(&again["fit"]["position_rms_m"]),
    );
    assert!((again / once - 1.0).abs() < 1e-3, "{again} after {once}");
}

#[test]
fn what_cannot_be_exported_is_said_and_leaves_the_old_file_whole() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    for name in ["cell.mcap", "both.mcap"] {
        fs::copy(LAB.path().join(name), at.join(name)).unwrap();
    }
    fs::create_dir_all(at.join("folder.urdf")).unwrap();
    fs::write(at.join("old.toml"), "mine").unwrap();
    let before = fs::read_dir(at).unwrap().count();
    let cases: [(&[&str], i32, &[&str]); 9] = [
        (
            &["cell.mcap", "-o", "out.xml"],
            2,
            &["out.xml", ".urdf", ".toml", ".json"],
        ),
        (&["cell.mcap", "-o", "out"], 2, &[".urdf"]),
        (&["cell.mcap"], 2, &["--output"]),
        (&["both.mcap", "-o", "old.toml"], 2, &["--target", "r1, r2"]),
        (
            &["both.mcap", "-o", "old.toml", "--target", "r3"],
            2,
            &["r3", "r1, r2"],
        ),
        (
            &["both.mcap", "-o", "o.urdf", "--target", "r1"],
            2,
            &["--target", ".toml"],
        ),
        (
            &["cell.mcap", "-o", "none/out.urdf"],
            1,
            &["none/out.urdf", "cannot be written"],
        ),
        (
            &["cell.mcap", "-o", "folder.urdf"],
            1,
            &["folder.urdf", "cannot be written"],
        ),
        (
            &["cell.mcap", "--effects", "nose", "-o", "old.toml"],
            1,
            &["nose"],
        ),
    ];
    for (words, code, parts) in cases {
        let (found, out, err) = misfit(at, &[&["export"], words].concat());
        assert_eq!((found, out.as_str()), (Some(code), ""), "{words:?}: {err}");
        for part in parts {
            assert!(err.contains(part), "no {part:?} in: {err}");
        }
    }
    assert_eq!(fs::read_to_string(at.join("old.toml")).unwrap(), "mine");
    assert_eq!(
        fs::read_dir(at).unwrap().count(),
        before,
        "a file was left behind"
    );
    let (code, _, err) = misfit(
        at,
        &[
            "export",
            "both.mcap",
            "--target",
            "r2",
            "-o",
            "both.table.toml",
        ],
    );
    assert_eq!(code, Some(0), "{err}");
    let table = Robot::load(&at.join("both.table.toml"), None).unwrap();
    assert!(table.joint("r2_t").is_some() && table.joint("r1_t").is_none());
}

/// A model of one robot is not a model of another, even where the joints have the same names.
#[test]
fn a_model_file_knows_its_robot() {
    let at = TempDir::new().unwrap();
    let at = at.path();
    let campaign = LAB.path().join("cell.mcap");
    let cell = campaign.to_str().unwrap();
    let ladder = [
        "ladder",
        cell,
        "--stop-at",
        "2",
        "--no-cross-validation",
        "-o",
        "model.toml",
    ];
    let (code, _, err) = misfit(at, &ladder);
    assert_eq!(code, Some(0), "{err}");
    let model = fs::read_to_string(at.join("model.toml")).unwrap();
    assert!(model.starts_with("robot = \"sda5f\"\n"), "{model}");
    let export = |file: &str| misfit(at, &["export", cell, "--model", file, "-o", "o.json"]);
    let (code, _, err) = export("model.toml");
    assert_eq!(code, Some(0), "{err}");
    fs::remove_file(at.join("o.json")).unwrap();
    // another one, with the same joints
    fs::write(at.join("other.toml"), model.replace("sda5f", "sda10f")).unwrap();
    let candidates = ["diagnose", cell, "--candidates", "other.toml"];
    for (code, out, err) in [export("other.toml"), misfit(at, &candidates)] {
        assert_eq!((code, out.as_str()), (Some(1), ""));
        for part in [
            "other.toml",
            "\"sda10f\"",
            "\"sda5f\"",
            "sda5f.urdf",
            "accepted",
        ] {
            assert!(err.contains(part), "no {part} in: {err}");
        }
    }
    assert!(!at.join("o.json").exists());
    fs::write(
        at.join("plain.toml"),
        model.replace("robot = \"sda5f\"\n", ""),
    )
    .unwrap();
    assert_eq!(export("plain.toml").0, Some(0));
}
