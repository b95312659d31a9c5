//! What `urdf-rs`, a reader that is not ours, makes of the same files: every link stands where it says, and weighs that.

use misfit_arm::robot::{JointKind, Robot};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// A dozen products of matrices below 2 m.
const ROUNDING: f64 = 1.0e-12;

/// Every URDF of the repository, and one with what files of others have: a quaternion-free 1.0 tree of fixed, sliding
/// and endless joints, axes that are no unit vectors, inertias with an origin.
fn files() -> Vec<(String, String)> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    let kept = ["models/sda5f/sda5f.urdf", "models/six_axis/six_axis.urdf"];
    let mut files: Vec<(String, String)> = kept
        .iter()
        .map(|name| {
            (
                (*name).to_owned(),
                fs::read_to_string(root.join(name)).unwrap(),
            )
        })
        .collect();
    files.push(("mixed".to_owned(), MIXED.to_owned()));
    files
}

const MIXED: &str = r#"<robot name="mixed">
  <link name="base"><inertial><origin xyz="0.1 0 0.2" rpy="0 0 1"/><mass value="7"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="carriage"><inertial><origin xyz="0 0.3 0"/><mass value="2.5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="bracket"><inertial><origin xyz="0.05 0 0" rpy="1 0 0"/><mass value="0.5"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="turret"/><link name="probe"/>
  <joint name="rail" type="prismatic"><parent link="base"/><child link="carriage"/><origin xyz="0 0 0.4" rpy="0.3 -0.2 0.1"/><axis xyz="0 2 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="mount" type="fixed"><parent link="carriage"/><child link="bracket"/><origin xyz="0.2 0 0.1" rpy="0 1.2 -0.7"/></joint>
  <joint name="pan" type="continuous"><parent link="bracket"/><child link="turret"/><origin xyz="0 0.1 0" rpy="2 0 0"/><axis xyz="1 1 0"/></joint>
  <joint name="tip" type="fixed"><parent link="turret"/><child link="probe"/><origin xyz="0 0 0.3"/></joint>
</robot>"#;

fn pose(origin: &urdf_rs::Pose) -> Isometry3<f64> {
    let [roll, pitch, yaw] = origin.rpy.0;
    // fixed axes x, y, z: the axes of the format's specification, one after another
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    let rotation = about(Vector3::z_axis(), yaw)
        * about(Vector3::y_axis(), pitch)
        * about(Vector3::x_axis(), roll);
    Isometry3::from_parts(
        Translation3::from(Vector3::from(origin.xyz.0)),
        UnitQuaternion::from_rotation_matrix(&rotation),
    )
}

/// Poses of all links in the base frame, by name.
fn links(robot: &urdf_rs::Robot, angles: &BTreeMap<&str, f64>) -> BTreeMap<String, Isometry3<f64>> {
    let children: Vec<&str> = robot
        .joints
        .iter()
        .map(|joint| joint.child.link.as_str())
        .collect();
    let roots = robot.links.iter().map(|link| link.name.clone());
    let roots = roots.filter(|name| !children.contains(&name.as_str()));
    let mut placed: BTreeMap<String, Isometry3<f64>> =
        roots.map(|name| (name, Isometry3::identity())).collect();
    assert_eq!(placed.len(), 1);
    while placed.len() < robot.links.len() {
        for joint in &robot.joints {
            let Some(parent) = placed.get(&joint.parent.link) else {
                continue;
            };
            let angle = angles.get(joint.name.as_str()).copied().unwrap_or(0.0);
            let axis = Vector3::from(joint.axis.xyz.0).normalize();
            let motion = match joint.joint_type {
                urdf_rs::JointType::Fixed => Isometry3::identity(),
                urdf_rs::JointType::Prismatic => Translation3::from(axis * angle).into(),
                _ => Isometry3::rotation(axis * angle),
            };
            let child = parent * pose(&joint.origin) * motion;
            placed.insert(joint.child.link.clone(), child);
        }
    }
    placed
}

#[test]
fn links_stand_and_weigh_what_another_reader_says() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Pcg64Mcg::seed_from_u64(7);
    for (name, text) in files() {
        let theirs = urdf_rs::read_from_string(&text).unwrap();
        let path = folder.path().join("robot.urdf");
        fs::write(&path, &text).unwrap();
        let ours = Robot::load(&path, None).unwrap();
        assert_eq!(ours.links.len(), theirs.links.len(), "{name}");
        let moving = theirs.joints.iter();
        let moving = moving.filter(|joint| joint.joint_type != urdf_rs::JointType::Fixed);
        assert_eq!(ours.joints.len(), moving.clone().count(), "{name}");
        for joint in moving.filter(|joint| joint.joint_type != urdf_rs::JointType::Continuous) {
            let own = ours
                .joints
                .iter()
                .find(|own| own.name == joint.name)
                .unwrap();
            assert_eq!(
                own.limits,
                Some((joint.limit.lower, joint.limit.upper)),
                "{name}"
            );
        }
        for _ in 0..5 {
            let q: Vec<f64> = ours
                .joints
                .iter()
                .map(|_| random.random_range(-1.0..1.0))
                .collect();
            let angles = ours.joints.iter().map(|joint| joint.name.as_str());
            let angles: BTreeMap<&str, f64> = angles.zip(q.iter().copied()).collect();
            let placed = links(&theirs, &angles);
            let mut bodies = vec![Isometry3::identity()];
            for (joint, &q) in ours.joints.iter().zip(&q) {
                let motion = match joint.kind {
                    JointKind::Prismatic => Translation3::from(joint.axis.into_inner() * q).into(),
                    _ => Isometry3::rotation(joint.axis.into_inner() * q),
                };
                bodies.push(bodies[joint.parent] * joint.parent_from_joint * motion);
            }
            for link in &ours.links {
                let own = bodies[link.body] * link.body_from_link;
                let gap = own.to_homogeneous() - placed[&link.name].to_homogeneous();
                assert!(gap.amax() < ROUNDING, "{name}: {}: {gap}", link.name);
            }
            // mass, and mass times place, of the whole arm
            let weigh = |(mass, at): (f64, Point3<f64>)| (mass, at.coords * mass);
            let sum = |parts: Vec<(f64, Point3<f64>)>| {
                let parts = parts.into_iter().map(weigh);
                parts.fold((0.0, Vector3::zeros()), |(m, c), (mass, moment)| {
                    (m + mass, c + moment)
                })
            };
            let own = sum(ours
                .bodies
                .iter()
                .zip(&bodies)
                .map(|(body, pose)| (body.mass, pose * Point3::from(body.com)))
                .collect());
            let their = sum(theirs
                .links
                .iter()
                .map(|link| {
                    let centre =
                        placed[&link.name] * pose(&link.inertial.origin) * Point3::origin();
                    (link.inertial.mass.value, centre)
                })
                .collect());
            assert!(
                (own.0 - their.0).abs() < 1e-12 * (1.0 + their.0),
                "{name}: {} kg",
                own.0
            );
            assert!(
                (own.1 - their.1).amax() < ROUNDING * (1.0 + their.0),
                "{name}: {}",
                own.1
            );
        }
    }
}
