//! Robot files: two descriptions of one arm agree, published poses are met, and bad files are refused by name.

#![allow(clippy::unwrap_used)]

use std::path::Path;

use misfit_arm::robot::{JointKind, Robot, Shape};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3, vector};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

/// Two descriptions of one arm differ by rounding only: a dozen products of matrices below 2 m.
const ROUNDING: f64 = 1.0e-12;

fn load(path: &str) -> Robot {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../..")).join(path);
    Robot::load(&path, None).unwrap()
}

fn sda5f() -> Robot {
    load("models/sda5f/sda5f.urdf")
}

/// Poses of all bodies in the base frame.
fn bodies(robot: &Robot, q: &[f64]) -> Vec<Isometry3<f64>> {
    let mut poses = vec![Isometry3::identity()];
    for (joint, &q) in robot.joints.iter().zip(q) {
        let motion = match joint.kind {
            JointKind::Prismatic => Translation3::from(joint.axis.into_inner() * q).into(),
            _ => Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_axis_angle(&joint.axis, q),
            ),
        };
        poses.push(poses[joint.parent] * joint.parent_from_joint * motion);
    }
    poses
}

fn link_pose(robot: &Robot, q: &[f64], name: &str) -> Isometry3<f64> {
    let link = &robot.links[robot.link(name).unwrap()];
    bodies(robot, q)[link.body] * link.body_from_link
}

/// Largest difference of any matrix element.
fn gap(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.to_homogeneous() - b.to_homogeneous()).amax()
}

fn postures(count: usize, joints: usize) -> impl Iterator<Item = Vec<f64>> {
    let mut random = Pcg64Mcg::seed_from_u64(1);
    (0..count).map(move |_| {
        (0..joints)
            .map(|_| random.random_range(-3.1..3.1))
            .collect()
    })
}

mod sda5f_model {
    use super::*;

    #[test]
    fn the_dh_tables_and_the_urdf_are_one_robot() {
        let urdf = sda5f();
        for arm in ["r1", "r2"] {
            let table = load(&format!("models/sda5f/{arm}_dh.toml"));
            assert_eq!(table.joints.len(), 8);
            for q in postures(1000, 8) {
                let mut all = vec![0.0; urdf.joints.len()];
                for (joint, &q) in table.joints.iter().zip(&q) {
                    all[urdf.joint(&joint.name).unwrap()] = q;
                }
                for link in &table.links {
                    let name = match link.name.as_str() {
                        "flange" => format!("{arm}_flange"),
                        name => name.to_owned(),
                    };
                    let there = link_pose(&urdf, &all, &name);
                    let here = link_pose(&table, &q, &link.name);
                    assert!(gap(&here, &there) < ROUNDING, "{name} at {q:?}");
                }
            }
            for joint in &table.joints {
                let other = &urdf.joints[urdf.joint(&joint.name).unwrap()];
                assert_eq!(joint.limits, other.limits, "{}", joint.name);
            }
        }
    }

    #[test]
    fn flanges_at_zero_are_where_they_were_published() {
        let robot = sda5f();
        let zero = [0.0; 15];
        for (flange, side) in [("r1_flange", 1.0), ("r2_flange", -1.0)] {
            let at = link_pose(&robot, &zero, flange).translation.vector;
            let published = vector![0.150, side * 0.573, 0.503 + 0.900];
            assert!((at - published).amax() < ROUNDING, "{flange} {at}");
        }
    }

    #[test]
    fn equal_angles_mirror_the_arms() {
        let robot = sda5f();
        let mirror = Vector3::new(1.0, -1.0, 1.0);
        for q in postures(200, 7) {
            let mut all = vec![0.0; 15];
            for (name, q) in ["s", "l", "e", "u", "r", "b", "t"].iter().zip(q) {
                for arm in ["r1", "r2"] {
                    all[robot.joint(&format!("{arm}_{name}")).unwrap()] = q;
                }
            }
            let poses = bodies(&robot, &all);
            for (body, pose) in robot.bodies.iter().zip(&poses) {
                let Some(rest) = body.name.strip_prefix("r1_") else {
                    continue;
                };
                let other = robot
                    .bodies
                    .iter()
                    .position(|b| b.name == format!("r2_{rest}"));
                let other = other.unwrap();
                let origins = pose.translation.vector.component_mul(&mirror)
                    - poses[other].translation.vector;
                assert!(origins.amax() < ROUNDING, "{}", body.name);
                let com = (pose * nalgebra::Point3::from(body.com)).coords;
                let theirs = &robot.bodies[other];
                let their_com = (poses[other] * nalgebra::Point3::from(theirs.com)).coords;
                assert!((com.component_mul(&mirror) - their_com).amax() < ROUNDING);
                assert_eq!(body.mass, theirs.mass);
            }
        }
    }

    #[test]
    fn it_weighs_110_kg_and_is_made_as_named() {
        let robot = sda5f();
        let mass: f64 = robot.bodies.iter().map(|body| body.mass).sum();
        assert!((mass - 110.0).abs() < 1.0e-9, "{mass}");
        assert_eq!(robot.joints.len(), 15);
        assert_eq!(robot.bodies.len(), 16);
        let chain = |link: &str| -> Vec<&str> {
            let body = robot.links[robot.link(link).unwrap()].body;
            let chain = robot.chain(body).into_iter();
            chain.map(|j| robot.joints[j].name.as_str()).collect()
        };
        assert_eq!(
            chain("r2_flange"),
            [
                "torso", "r2_s", "r2_l", "r2_e", "r2_u", "r2_r", "r2_b", "r2_t"
            ]
        );
        assert!(chain("base").is_empty());
        assert!(robot.chain(99).is_empty());
        let effort = |name: &str| robot.joints[robot.joint(name).unwrap()].effort;
        assert_eq!(effort("r1_b"), Some(14.7));
        assert_eq!(effort("r2_t"), Some(7.35));
        assert!(robot.joint("elbow").is_none() && robot.link("elbow").is_none());
    }

    #[test]
    fn one_arm_can_be_taken_alone() {
        let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
            .join("models/sda5f/sda5f.urdf");
        let arm = Robot::load(&path, Some("r1_s_link")).unwrap();
        let whole = sda5f();
        assert_eq!(arm.joints.len(), 6);
        for q in postures(50, 6) {
            let mut all = vec![0.0; 15];
            for (joint, &q) in arm.joints.iter().zip(&q) {
                all[whole.joint(&joint.name).unwrap()] = q;
            }
            let shoulder = link_pose(&whole, &all, "r1_s_link");
            let flange = shoulder.inv_mul(&link_pose(&whole, &all, "r1_flange"));
            assert!(gap(&link_pose(&arm, &q, "r1_flange"), &flange) < ROUNDING);
        }
    }

    #[test]
    fn every_moving_link_can_be_drawn() {
        for robot in [sda5f(), load("models/six_axis/six_axis.urdf")] {
            for body in 0..robot.bodies.len() {
                let mut links = robot.links.iter().filter(|link| link.body == body);
                assert!(links.any(|link| !link.visuals.is_empty()), "body {body}");
            }
        }
    }
}

mod dh {
    use super::*;

    /// Universal Robots UR10, nominal: rows are (alpha after, a after, d), standard convention.
    const UR10: [(i32, f64, f64); 6] = [
        (90, 0.0, 0.1273),
        (0, -0.612, 0.0),
        (0, -0.5723, 0.0),
        (90, 0.0, 0.163941),
        (-90, 0.0, 0.1157),
        (0, 0.0, 0.0922),
    ];

    fn ur10(convention: &str) -> Robot {
        let mut text = format!("name = \"ur10\"\nconvention = \"{convention}\"\n");
        let mut before = (0, 0.0);
        for (row, &(alpha, a, d)) in UR10.iter().enumerate() {
            let (alpha_here, a_here) = match convention {
                "modified" => before,
                _ => (alpha, a),
            };
            text += &format!(
                "[[joint]]\nname = \"j{row}\"\nalpha_deg = {alpha_here}\na_m = {a_here}\nd_m = {d}\n"
            );
            before = (alpha, a);
        }
        Robot::parse("ur10.toml", &text, None).unwrap()
    }

    #[test]
    fn standard_and_modified_tables_of_one_robot_agree() {
        let (standard, modified) = (ur10("standard"), ur10("modified"));
        for q in postures(1000, 6) {
            let a = link_pose(&standard, &q, "flange");
            let b = link_pose(&modified, &q, "flange");
            assert!(gap(&a, &b) < ROUNDING);
        }
        // The pose the maker's own kinematics give at zero.
        let at = link_pose(&standard, &[0.0; 6], "flange").translation.vector;
        assert!((at - vector![-1.1843, -0.256141, 0.0116]).amax() < ROUNDING);
    }

    #[test]
    fn a_standard_row_is_the_product_of_its_four_steps() {
        let text = "name='r'\nconvention='standard'\n[base]\nxyz_mm=[1,2,3]\nrpy_deg=[10,20,30]\n\
            [[joint]]\nname='a'\nalpha_deg=17\na_mm=120\ntheta_rad=0.3\nd_mm=-40\n\
            [[joint]]\nname='b'\nkind='prismatic'\nalpha_rad=-0.4\na_m=0.2\ntheta_deg=33\nd_m=0.1\n\
            lower_mm=-10\nupper_mm=250\neffort_N=70\nmass_kg=2\ncom_mm=[1,0,5]\n\
            [tool]\nxyz_m=[0,0,0.1]\nmass_kg=1\n";
        let robot = Robot::parse("r.toml", text, None).unwrap();
        let x =
            |angle: f64, by: f64| Isometry3::new(vector![by, 0.0, 0.0], vector![angle, 0.0, 0.0]);
        let z =
            |angle: f64, by: f64| Isometry3::new(vector![0.0, 0.0, by], vector![0.0, 0.0, angle]);
        let base = Isometry3::from_parts(
            Translation3::new(1.0e-3, 2.0e-3, 3.0e-3),
            UnitQuaternion::from_euler_angles(
                10f64.to_radians(),
                20f64.to_radians(),
                30f64.to_radians(),
            ),
        );
        let (qa, qb) = (0.7, 0.05);
        let first = base * z(0.3 + qa, -0.04) * x(17f64.to_radians(), 0.12);
        let second = first * z(33f64.to_radians(), 0.1 + qb) * x(-0.4, 0.2);
        let flange = second * Isometry3::translation(0.0, 0.0, 0.1);
        let q = [qa, qb];
        assert!(gap(&link_pose(&robot, &q, "a_link"), &first) < ROUNDING);
        assert!(gap(&link_pose(&robot, &q, "b_link"), &second) < ROUNDING);
        assert!(gap(&link_pose(&robot, &q, "flange"), &flange) < ROUNDING);
        assert_eq!(robot.joints[1].limits, Some((-0.01, 0.25)));
        assert_eq!(robot.joints[1].effort, Some(70.0));
        // The row's mass is given in the frame it ends in, the tool's in the flange: both are in the last body.
        let body = &robot.bodies[2];
        assert_eq!(body.mass, 3.0);
        let in_base = bodies(&robot, &q)[2] * nalgebra::Point3::from(body.com);
        let expected = (second * nalgebra::Point3::new(1.0e-3, 0.0, 5.0e-3)).coords * (2.0 / 3.0)
            + flange.translation.vector / 3.0;
        assert!((in_base.coords - expected).amax() < ROUNDING);
    }

    #[test]
    fn right_angles_in_degrees_are_exact() {
        let text = "name='r'\nconvention='modified'\n\
            [[joint]]\nname='a'\nalpha_deg=-90\nd_m=0.25\n[[joint]]\nname='b'\nalpha_deg=180\nd_m=0.5\n";
        let robot = Robot::parse("r.toml", text, None).unwrap();
        let origin = |j: usize| robot.joints[j].parent_from_joint.translation.vector;
        assert_eq!(origin(0), vector![0.0, 0.25, 0.0]);
        assert_eq!(origin(1), vector![0.0, 0.0, -0.5]);
    }
}

mod urdf {
    use super::*;

    fn urdf(inside: &str) -> String {
        format!("<robot name=\"r\">\n{inside}\n</robot>")
    }

    const FOLDED: &str = r#"
        <joint name="slide" type="prismatic">
          <parent link="plate"/><child link="carriage"/><axis xyz="0 2 0"/>
          <limit lower="-0.1" upper="0.4" effort="50" velocity="1"/>
        </joint>
        <joint name="turn" type="continuous">
          <origin xyz="0 0 0.5" rpy="1.5707963267948966 0 0"/>
          <parent link="world"/><child link="arm"/><axis xyz="0 0 1"/>
          <limit effort="9" velocity="1"/>
        </joint>
        <joint name="bolted" type="fixed">
          <origin xyz="1 0 0" rpy="0 0 3.141592653589793"/><parent link="arm"/><child link="plate"/>
        </joint>
        <link name="carriage"><inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
        <link name="world"/>
        <link name="arm">
          <inertial><origin xyz="0.5 0 0"/><mass value="3"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
        </link>
        <link name="plate">
          <visual><origin xyz="0 0 0.1"/><geometry><sphere radius="0.2"/></geometry><material name="red"/></visual>
          <inertial><origin xyz="-1 0 0"/><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
          <visual><geometry><capsule radius="0.1" length="1"/></geometry></visual>
        </link>
        <material name="red"><color rgba="1 0 0 1"/></material>"#;

    #[test]
    fn fixed_links_are_folded_into_their_body() {
        let robot = Robot::parse("r.urdf", &urdf(FOLDED), None).unwrap();
        let names: Vec<_> = robot.joints.iter().map(|j| j.name.as_str()).collect();
        assert_eq!(names, ["turn", "slide"], "parents first");
        assert_eq!(robot.joints[0].kind, JointKind::Continuous);
        assert_eq!(robot.joints[0].limits, None);
        assert_eq!(robot.joints[0].effort, Some(9.0));
        assert_eq!(robot.joints[1].limits, Some((-0.1, 0.4)));
        assert_eq!(robot.joints[1].axis.into_inner(), Vector3::y());
        let arm = &robot.bodies[1];
        assert_eq!((arm.name.as_str(), arm.mass), ("arm", 4.0));
        // The plate is turned half round, so its mass is a metre beyond its origin: (3 × 0.5 + 1 × 2) / 4.
        assert!((arm.com - vector![0.875, 0.0, 0.0]).amax() < 1.0e-15);
        let at = link_pose(&robot, &[0.0, 0.3], "carriage")
            .translation
            .vector;
        assert!((at - vector![1.0, 0.0, 0.5 - 0.3]).amax() < 1.0e-15, "{at}");
        let plate = &robot.links[robot.link("plate").unwrap()];
        assert_eq!(plate.body, 1);
        assert_eq!(plate.visuals[0].rgba, [1.0, 0.0, 0.0, 1.0]);
        assert_eq!(plate.visuals[1].shape, Shape::Cylinder(0.1, 1.0));
        assert_eq!(plate.visuals.len(), 4, "a capsule is three shapes");
    }

    /// Two links and a joint; the version of the format, and what is in the joint.
    fn hinge(version: &str, inside: &str) -> String {
        format!(
            "<robot name='r' version='{version}'><link name='a'/><link name='b'/>\
             <joint name='j' type='revolute'><parent link='a'/><child link='b'/>{inside}</joint></robot>"
        )
    }

    #[test]
    fn what_an_arm_does_not_need_is_not_asked_for() {
        let inside = FOLDED
            .replace(
                "<inertia ixx=\"1\" ixy=\"0\" ixz=\"0\" iyy=\"1\" iyz=\"0\" izz=\"1\"/>",
                "",
            )
            .replace(" velocity=\"1\"", "")
            .replace(
                "<color rgba=\"1 0 0 1\"/>",
                "<color rgba=\"1 0 0 1\"/><texture/>",
            );
        let whole = Robot::parse("r.urdf", &urdf(FOLDED), None).unwrap();
        assert_eq!(Robot::parse("r.urdf", &urdf(&inside), None).unwrap(), whole);
    }

    #[test]
    fn comments_and_foreign_elements_change_nothing() {
        let whole = Robot::parse("r.urdf", &urdf(FOLDED), None).unwrap();
        let inside = format!(
            "<!-- -- a <link name='w'/> ---><![CDATA[ <!-- ]]>{FOLDED}<!-- --><x:link name='arm'/>"
        );
        let text = urdf(&inside).replace("<robot", "<robot xmlns='u' xmlns:x='v'");
        assert_eq!(Robot::parse("r.urdf", &text, None).unwrap(), whole);
    }

    /// From version 1.1 of the format on a rotation may be a quaternion; before, the attribute means nothing.
    #[test]
    fn quaternions_are_read_from_version_1_1_on() {
        let origin = |version: &str, rotation: &str| {
            let text = hinge(version, &format!("<origin xyz='1 2 3' {rotation}/>"));
            Robot::parse("r.urdf", &text, None).unwrap().joints[0].parent_from_joint
        };
        let turned = origin("1.0", "rpy='1.5707963267948966 0 1.5707963267948966'");
        let quaternion = "quat_xyzw='-1 -1 -1 -1'";
        assert!(gap(&origin("1.1", quaternion), &turned) < ROUNDING);
        assert!(gap(&origin("1.10", quaternion), &turned) < ROUNDING);
        let straight = Translation3::new(1.0, 2.0, 3.0).into();
        for version in ["1.0", "", "one"] {
            assert_eq!(origin(version, quaternion), straight);
        }
    }

    #[test]
    fn limits_left_out_are_none_from_version_1_2_on_and_zero_before() {
        let limits = |version: &str, inside: &str| {
            let text = hinge(version, &format!("<limit {inside}/>"));
            let joint = Robot::parse("r.urdf", &text, None).map(|robot| robot.joints[0].clone());
            joint.map(|joint| (joint.limits, joint.effort))
        };
        for version in ["1.0", "1.2"] {
            assert_eq!(limits(version, "").unwrap(), (None, None));
            let both = "lower='-1' upper='2' effort='3'";
            assert_eq!(
                limits(version, both).unwrap(),
                (Some((-1.0, 2.0)), Some(3.0))
            );
        }
        assert_eq!(
            limits("1.1", "upper='2'").unwrap(),
            (Some((0.0, 2.0)), None)
        );
        let message = limits("1.2", "upper='2'").unwrap_err().to_string();
        assert!(message.contains("limits -inf to 2"), "{message}");
    }

    #[test]
    fn right_angles_are_accurate() {
        let robot = Robot::parse("r.urdf", &urdf(FOLDED), None).unwrap();
        let turned = robot.joints[0].parent_from_joint.rotation * Vector3::y();
        assert!((turned - Vector3::z()).amax() < 1.0e-15, "{turned}");
    }

    #[test]
    fn what_is_outside_the_part_kept_does_no_harm() {
        let inside = r#"<link name="map"/><link name="a"/><link name="b"/>
            <joint name="localise" type="floating"><parent link="map"/><child link="a"/></joint>
            <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>"#;
        let robot = Robot::parse("r.urdf", &urdf(inside), Some("a")).unwrap();
        assert_eq!(robot.joints.len(), 1);
        assert_eq!(robot.links.len(), 2);
        let message = refusal("r.urdf", &urdf(inside));
        assert!(message.contains("localise") && message.contains("floating"));
    }

    #[test]
    fn meshes_must_be_there_but_are_not_used() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("arm.urdf");
        let robot = |mesh: &str| {
            urdf(&format!(
                r#"<link name="a"/><link name="b"><visual><geometry><mesh filename="{mesh}"/></geometry></visual></link>
                <joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>"#
            ))
        };
        std::fs::write(&path, robot("parts/b.stl")).unwrap();
        let message = Robot::load(&path, None).unwrap_err().to_string();
        for word in ["arm.urdf", "link \"b\"", "parts/b.stl"] {
            assert!(message.contains(word), "{message}");
        }
        assert!(Robot::parse("arm.urdf", &robot("parts/b.stl"), None).is_ok());
        std::fs::create_dir(folder.path().join("parts")).unwrap();
        std::fs::write(folder.path().join("parts/b.stl"), "").unwrap();
        let loaded = Robot::load(&path, None).unwrap();
        assert!(loaded.links.iter().all(|link| link.visuals.is_empty()));
        // A package that is not installed says nothing about the mesh; one that is found can miss it.
        std::fs::write(&path, robot("package://elsewhere/b.stl")).unwrap();
        assert!(Robot::load(&path, None).is_ok());
        std::fs::write(&path, robot("package://parts/c.stl")).unwrap();
        let message = Robot::load(&path, None).unwrap_err().to_string();
        assert!(message.contains("package://parts/c.stl"), "{message}");
    }

    #[test]
    fn unreadable_files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("no.urdf");
        let message = Robot::load(&missing, None).unwrap_err().to_string();
        assert!(message.contains("no.urdf") && message.contains("cannot be read"));
        assert!(Robot::load(folder.path(), None).is_err());
        let binary = folder.path().join("binary.urdf");
        std::fs::write(&binary, [0xff, 0xfe, 0x00]).unwrap();
        let message = Robot::load(&binary, None).unwrap_err().to_string();
        assert!(message.contains("binary.urdf"), "{message}");
    }
}

fn refusal(file: &str, text: &str) -> String {
    match Robot::parse(file, text, None) {
        Ok(_) => panic!("accepted: {text}"),
        Err(error) => error.to_string(),
    }
}

/// Each case: the text, and words its message must hold beside the file's name.
fn assert_refused(file: &str, cases: &[(&str, &[&str])]) {
    for (text, words) in cases {
        let message = refusal(file, text);
        assert!(message.starts_with(file), "{message}");
        for word in *words {
            assert!(message.contains(word), "`{word}` is not in: {message}");
        }
    }
}

#[test]
fn bad_urdfs_are_refused_by_name() {
    /// A good robot with one thing replaced.
    fn with(old: &str, new: &str) -> String {
        const GOOD: &str = r#"<robot name="r">
<link name="a"/>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
  <visual><geometry><box size="1 1 1"/></geometry></visual></link>
<link name="c"/>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="1"/></joint>
<joint name="j2" type="fixed"><parent link="b"/><child link="c"/></joint>
</robot>"#;
        assert!(Robot::parse("good.urdf", GOOD, None).is_ok());
        assert!(GOOD.contains(old), "{old}");
        GOOD.replacen(old, new, 1)
    }
    let many = |count: usize| {
        let links: String = (0..count)
            .map(|i| format!("<link name=\"l{i}\"/>"))
            .collect();
        format!("<robot name=\"r\">{links}</robot>")
    };
    let cases: &[(String, &[&str])] = &[
        // XML
        (String::new(), &["no <robot>"]),
        ("hello".into(), &["no <robot>"]),
        ("<robot name=\"r\"/>".into(), &["line 1", "<robot/>"]),
        ("<robot name=\"r\"></robot>".into(), &["no link"]),
        ("<sdf></sdf>".into(), &["<sdf>", "<robot>"]),
        (with("</robot>", ""), &["<robot> of line 1", "never closed"]),
        (
            with("</inertial>", ""),
            &["line 4", "</link>", "<inertial> of line 3"],
        ),
        (
            with("<link name=\"a\"/>", "<link name=a/>"),
            &["line 2", "link name=a"],
        ),
        (
            with("<link name=\"a\"/>", "<!-- "),
            &["line 2", "never closed"],
        ),
        (
            with("<robot", "<!DOCTYPE r [<!ENTITY x \"xxxx\">]><robot"),
            &["document type"],
        ),
        (
            with(
                "<link name=\"a\"/>",
                "<xacro:macro name=\"m\"></xacro:macro>",
            ),
            &["xacro", "expand"],
        ),
        (
            with("</robot>", "</robot>\n</robot>"),
            &["line 10", "</robot>"],
        ),
        (
            with("<link name=\"a\"/>", "<link name=\"a\" name=\"b\"/>"),
            &["line 2", "'name'", "each attribute once"],
        ),
        (
            with("<link name=\"a\"/>", "<link name=\"a\"/>\n<x:tool/>"),
            &["line 3", "`x:`", "xmlns:x"],
        ),
        (
            with("</robot>", "<link name=\"d"),
            &["line 9", "<link name=\"d"],
        ),
        // Structure
        (
            with("<link name=\"c\"/>", "<link name=\"b\"/>"),
            &["link \"b\"", "two links"],
        ),
        (
            with("name=\"j2\"", "name=\"j1\""),
            &["joint \"j1\"", "name of its own"],
        ),
        (
            with("<link name=\"c\"/>", "<link/>"),
            &["link (line 5)", "name"],
        ),
        (
            with("parent link=\"b\"", "parent link=\"x\""),
            &["joint \"j2\"", "parent", "\"x\""],
        ),
        (
            with("child link=\"c\"", "child link=\"y\""),
            &["joint \"j2\"", "child", "\"y\""],
        ),
        (
            with("child link=\"c\"", "child link=\"b\""),
            &["joint \"j2\"", "already hangs on joint \"j1\""],
        ),
        (
            with("child link=\"c\"", "child link=\"a\""),
            &["joint \"j1\"", "loop"],
        ),
        (
            with(
                "<joint name=\"j2\" type=\"fixed\"><parent link=\"b\"/><child link=\"c\"/></joint>",
                "",
            ),
            &["\"a\", \"c\"", "2 links hang on no joint"],
        ),
        (
            with("revolute", "fixed"),
            &["base link \"a\"", "no moving joint"],
        ),
        (many(1001), &["1001 links", "1000"]),
        // Joints
        (
            with("revolute", "planar"),
            &["joint \"j1\"", "planar", "prismatic"],
        ),
        (
            with("<axis", "<axis xyz=\"1 0 0\"/><axis"),
            &["joint \"j1\" (line 6)", "second <axis> on line 7"],
        ),
        (
            with("<robot", "<robot version=\"1.1\"").replace("rpy=\"0", "quat_xyzw=\"0 0"),
            &["joint \"j1\" (line 6)", "length above zero"],
        ),
        (
            with("<robot", "<robot version=\"1.1\"").replace("rpy=", "quat_xyzw=\"0 0 0 1\" rpy="),
            &["joint \"j1\" (line 6)", "both rpy and quat_xyzw"],
        ),
        (
            with("<box size=\"1 1 1\"/>", "<cone/>"),
            &["link \"b\" (line 3)", "without a shape", "<box>"],
        ),
        (with("revolute", "floating"), &["joint \"j1\"", "floating"]),
        (
            with("revolute", "spherical"),
            &["joint \"j1\"", "spherical"],
        ),
        (
            with("revolute", "ball"),
            &["joint \"j1\" (line 6)", "ball", "revolute"],
        ),
        (
            with("<axis xyz=\"0 0 1\"/>", "<mimic joint=\"k\"/>"),
            &["joint \"j1\"", "mimics joint \"k\""],
        ),
        (
            with("<axis xyz=\"0 0 1\"", "<axis xyz=\"0 0 0\""),
            &["joint \"j1\"", "axis 0 0 0"],
        ),
        (
            with("<axis xyz=\"0 0 1\"", "<axis xyz=\"0 nan 1\""),
            &["joint \"j1\"", "NaN"],
        ),
        (
            with("<axis xyz=\"0 0 1\"", "<axis xyz=\"0 x 0 1\""),
            &["joint \"j1\"", "line 7", "0 x 0 1"],
        ),
        (
            with("<axis xyz=\"0 0 1\"", "<axis xyz=\"0 1\""),
            &["joint \"j1\" (line 6)", "line 7", "only 3 numbers"],
        ),
        (
            with("xyz=\"0 0 1\" rpy", "xyz=\"0 inf 1\" rpy"),
            &["joint \"j1\"", "origin", "inf"],
        ),
        (
            with("xyz=\"0 0 1\" rpy", "xyz=\"0 0 612\" rpy"),
            &["joint \"j1\"", "612", "in m"],
        ),
        (
            with("rpy=\"0 0 0\"", "rpy=\"0 nan 0\""),
            &["joint \"j1\"", "rotation"],
        ),
        (
            with("lower=\"-1\"", "lower=\"2\""),
            &["joint \"j1\"", "lower limit 2 above"],
        ),
        (
            with("lower=\"-1\"", "lower=\"nan\""),
            &["joint \"j1\"", "NaN"],
        ),
        (
            with("lower=\"-1\"", "lower=\"low\""),
            &["joint \"j1\" (line 6)", "lower=\"low\"", "only a number"],
        ),
        (
            with("effort=\"5\"", "effort=\"-5\""),
            &["joint \"j1\"", "effort -5"],
        ),
        // Links
        (
            with("mass value=\"1\"", "mass value=\"-1\""),
            &["link \"b\"", "mass -1"],
        ),
        (
            with("mass value=\"1\"", "mass value=\"nan\""),
            &["link \"b\"", "mass NaN"],
        ),
        (
            with("<mass value=\"1\"/>", ""),
            &["link \"b\" (line 3)", "mass"],
        ),
        (
            with("<inertial>", "<inertial><origin xyz=\"0 0 nan\"/>"),
            &["link \"b\"", "centre of mass"],
        ),
        (
            with("box size=\"1 1 1\"", "box size=\"1 -1 1\""),
            &["link \"b\"", "visual of size"],
        ),
        (
            with(
                "</visual>",
                "<material name=\"m\"><color rgba=\"1 2 1 1\"/></material></visual>",
            ),
            &["link \"b\"", "colour"],
        ),
    ];
    for (text, words) in cases {
        assert_refused("bad.urdf", &[(text, words)]);
    }
}

#[test]
fn bad_tables_are_refused_by_name() {
    let head = "name = \"r\"\nconvention = \"modified\"\n";
    let row = |keys: &str| format!("{head}[[joint]]\nname = \"j\"\n{keys}\n");
    let cases: &[(String, &[&str])] = &[
        ("name = ".into(), &["line 1"]),
        (head.to_owned(), &["no row", "[[joint]]"]),
        (
            head.replace("modified", "craig"),
            &["line 2", "craig", "standard", "modified"],
        ),
        (head.replace("name = \"r\"", ""), &["name"]),
        (format!("{head}[[joint]]\na_mm = 1\n"), &["row 1", "name"]),
        (
            row("alpa_deg = 1"),
            &["line 5 (row 1)", "alpa_deg", "alpha_deg"],
        ),
        (row("a_mm = \"1\""), &["line 5 (row 1)", "string"]),
        (
            row("alpha_deg = 1\nalpha_rad = 1"),
            &["joint \"j\" (row 1)", "both alpha_deg and alpha_rad"],
        ),
        (
            row("theta_deg = 1\ntheta_rad = 1"),
            &["both theta_deg and theta_rad"],
        ),
        (row("a_m = 1\na_mm = 1"), &["both a_m and a_mm"]),
        (row("d_m = 1\nd_mm = 1"), &["both d_m and d_mm"]),
        (
            row("com_m = [0,0,0]\ncom_mm = [0,0,0]"),
            &["both com_m and com_mm"],
        ),
        (
            row("lower_deg = 1\nlower_rad = 1"),
            &["both lower_deg and lower_rad"],
        ),
        (
            row("lower_deg = 1"),
            &["joint \"j\" (row 1)", "only one of its limits"],
        ),
        (
            row("lower_deg = 1\nupper_deg = -1"),
            &["joint \"j\"", "above upper limit"],
        ),
        (
            row("lower_m = -1\nupper_m = 1"),
            &["joint \"j\"", "lower_m on a turning joint"],
        ),
        (
            row("kind = 'prismatic'\nlower_deg = -1\nupper_deg = 1"),
            &["lower_deg on a prismatic"],
        ),
        (
            row("kind = 'continuous'\nlower_deg = -1\nupper_deg = 1"),
            &["continuous"],
        ),
        (row("kind = 'ball'"), &["ball", "revolute"]),
        (
            row("alpha_deg = nan"),
            &["joint \"j\" (row 1)", "alpha", "finite"],
        ),
        (row("theta_rad = inf"), &["joint \"j\" (row 1)", "theta"]),
        (row("a_m = inf"), &["joint \"j\"", "in m"]),
        (row("d_m = 270"), &["joint \"j\"", "270", "in m"]),
        (row("mass_kg = -1"), &["link \"j_link\"", "mass -1"]),
        (row("effort_Nm = 0"), &["joint \"j\"", "effort 0"]),
        (row("[[joint]]\nname = \"j\""), &["\"j_link\"", "two links"]),
        (row("[[joint]]\nname = \" \""), &["row 2", "empty"]),
        (
            row("[base]\nxyz_m = [0, 0, 0]\nxyz_mm = [0, 0, 0]"),
            &["[base]", "both xyz_m and xyz_mm"],
        ),
        (
            row("[tool]\nrpy_rad = [0, 0, 0]\nrpy_deg = [0, 0, 0]"),
            &["[tool]", "both rpy_rad and rpy_deg"],
        ),
        (row("[tool]\nxyz_m = [0, 0]"), &["line 6"]),
    ];
    for (text, words) in cases {
        assert_refused("bad.toml", &[(text, words)]);
    }
}

#[test]
fn a_joint_may_be_called_flange() {
    let text = "name='r'\nconvention='modified'\n[[joint]]\nname='flange'\n";
    assert!(Robot::parse("r.toml", text, None).is_ok());
}

#[test]
fn unknown_endings_and_bases_say_what_would_do() {
    assert_refused("arm.sdf", &[("", &[".urdf", ".toml"])]);
    assert_refused("arm", &[("", &[".urdf", ".toml"])]);
    let text = "<robot name=\"r\"><link name=\"a\"/></robot>";
    let message = Robot::parse("r.URDF", text, Some("tool0"))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("tool0") && message.contains("\"a\""),
        "{message}"
    );
}

#[test]
fn hostile_files_neither_hang_nor_overflow() {
    let deep = |tag: &str| {
        let (open, close) = (format!("<{tag}>"), format!("</{tag}>"));
        format!(
            "<robot name=\"r\">{}{}</robot>",
            open.repeat(100_000),
            close.repeat(100_000)
        )
    };
    assert_refused(
        "deep.urdf",
        &[
            (&deep("link"), &["nested 33 deep"]),
            (&deep("gazebo"), &["nested 33 deep"]),
            (&"<a>".repeat(100_000), &["more than 32", "never closed"]),
        ],
    );
    for nest in ["[", "{a=", "[[", "a."] {
        let text = format!("x = {}", nest.repeat(100_000));
        assert!(Robot::parse("deep.toml", &text, None).is_err());
        assert!(Robot::parse("deep.toml", &nest.repeat(100_000), None).is_err());
    }
    let large = " ".repeat(16_000_001);
    assert_refused("large.urdf", &[(&large, &["16 MB"])]);
    // As many tags as fit in some megabytes are read once, not once for each of them.
    let wide = format!("<robot name=\"r\">{}</robot>", "<gazebo/>".repeat(900_000));
    assert_refused("wide.urdf", &[(&wide, &["no link"])]);
    let material = "<material name=\"m\"><color rgba=\"x\"/></material>";
    let wide = format!("<robot name=\"r\">{}</robot>", material.repeat(100_000));
    assert_refused("wide.urdf", &[(&wide, &["material \"m\""])]);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn garbage_never_panics(text in ".{0,400}") {
        let _ = Robot::parse("x.urdf", &text, None);
        let _ = Robot::parse("x.toml", &text, None);
        let _ = Robot::parse(&text, &text, None);
    }

    #[test]
    fn almost_robots_never_panic(words in prop::collection::vec(prop::sample::select(vec![
        "<robot name=\"r\">", "</robot>", "<link name=\"a\"/>", "<link name=\"b\">", "</link>", "<joint name=\"j\" type=\"revolute\">",
        "</joint>", "<parent link=\"a\"/>", "<child link=\"b\"/>", "<axis xyz=\"0 0 1\"/>", "<axis xyz=\"1e308 1e308 1e308\"/>",
        "<limit lower=\"1\" upper=\"1e999\" effort=\"0\" velocity=\"0\"/>", "<!--", "-->", "<![CDATA[", "]]>", "<", ">", "&lt;", "\"", "<?", "?>",
        "<visual>", "</visual>", "<geometry>", "</geometry>", "<sphere radius=\"nan\"/>", "<inertial>", "</inertial>", "<mass value=\"-0\"/>", "é",
    ]), 0..40)) {
        let text: String = words.concat();
        let _ = Robot::parse("x.urdf", &text, None);
        let _ = Robot::parse("x.urdf", &format!("<robot name=\"r\">{text}</robot>"), Some("a"));
    }

    #[test]
    fn damaged_robots_never_panic(at in 0usize..20_000, cut in 0usize..300, put in "[ -~]{0,6}") {
        for (file, text) in [
            ("x.urdf", include_str!("../../../models/sda5f/sda5f.urdf")),
            ("x.toml", include_str!("../../../models/sda5f/r1_dh.toml")),
        ] {
            let from = at % text.len();
            let to = (from + cut).min(text.len());
            if let (Some(head), Some(tail)) = (text.get(..from), text.get(to..)) {
                let _ = Robot::parse(file, &format!("{head}{put}{tail}"), None);
            }
        }
    }
}
