//! What several modules of tests share: robots, random postures, readings, effects.

use misfit_arm::robot::{JointKind, Robot};
use misfit_campaign::setup::Setup;
use misfit_campaign::{Campaign, Frame, Payload, Reading, RobotFile, Target};
use misfit_core::effects::{self, AnyEffect};
use misfit_core::model::Prediction;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rand::{Rng, RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A file of the repository: the tests of each crate, and of the program, look from its root.
pub fn file(path: &str) -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = own
        .ancestors()
        .find(|folder| folder.join("Cargo.lock").exists());
    root.unwrap().join(path)
}

pub fn random(seed: u64) -> Pcg64Mcg {
    Pcg64Mcg::seed_from_u64(seed)
}

pub fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -9.81)
}

/// A robot with targets at the origins of these links.
pub fn setup(robot: Robot, links: &[&str]) -> Setup {
    let targets = links.iter().map(|link| Target {
        name: link.split('_').next().unwrap().to_owned(),
        link: robot.link(link).unwrap(),
    });
    let targets = targets.collect();
    Setup::new(robot, targets, gravity())
}

/// Both arms of the SDA5F, a target `r1` and a target `r2` on their flanges.
pub fn sda5f() -> Setup {
    let robot = Robot::load(&file("models/sda5f/sda5f.urdf"), None).unwrap();
    setup(robot, &["r1_flange", "r2_flange"])
}

/// An ordinary arm of six joints.
pub fn six_axis() -> Setup {
    let robot = Robot::load(&file("models/six_axis/six_axis.urdf"), None).unwrap();
    setup(robot, &["flange"])
}

/// A small arm, one joint of which slides, and not along gravity.
pub fn sliding() -> Setup {
    let joints = [
        ("turn", "revolute", "0 0 0.4", "0.1 0 0", "0 0 1", 2.5, 4.0),
        (
            "lift",
            "revolute",
            "0.1 0 0.2",
            "0 0.3 0",
            "0 1 0",
            1.2,
            3.0,
        ),
        (
            "slide",
            "prismatic",
            "0.2 0 0.1",
            "0.2 -0.4 0",
            "1 0 0",
            0.3,
            2.0,
        ),
        (
            "wrist",
            "revolute",
            "0.3 0.05 0",
            "0 0 0.5",
            "0 1 0",
            2.0,
            1.0,
        ),
        (
            "roll",
            "continuous",
            "0.1 0 0.02",
            "0 0 0",
            "1 0 0",
            3.0,
            0.5,
        ),
    ];
    let mut urdf = "<robot name='sliding'><link name='base'/>".to_owned();
    let mut parent = "base".to_owned();
    for (name, kind, xyz, rpy, axis, limit, mass) in joints {
        urdf += &format!(
            "<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{name}_link'/>\
             <origin xyz='{xyz}' rpy='{rpy}'/><axis xyz='{axis}'/>\
             <limit lower='-{limit}' upper='{limit}' effort='1' velocity='1'/></joint>\
             <link name='{name}_link'><inertial><origin xyz='0.05 0.02 0.03'/><mass value='{mass}'/>\
             <inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>"
        );
        parent = format!("{name}_link");
    }
    urdf += "<joint name='mount' type='fixed'><parent link='roll_link'/><child link='tip'/>\
             <origin xyz='0.08 0.01 0.02' rpy='0.3 -0.2 0.1'/></joint><link name='tip'/></robot>";
    setup(Robot::parse("sliding.urdf", &urdf, None).unwrap(), &["tip"])
}

/// Random angles within the limits, a full turn where there are none.
pub fn posture(robot: &Robot, random: &mut impl Rng) -> Vec<f64> {
    let angle = |joint: &misfit_arm::robot::Joint| {
        let (lower, upper) = joint.limits.unwrap_or((-PI, PI));
        random.random_range(lower..upper)
    };
    robot.joints.iter().map(angle).collect()
}

/// A vector with components from -1 to 1.
pub fn vector(random: &mut impl Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random_range(-1.0..1.0))
}

/// A rigid motion up to 3 m along each axis, turned anyhow.
pub fn motion(random: &mut impl Rng) -> Isometry3<f64> {
    Isometry3::new(
        vector(random) * 3.0,
        vector(random).normalize() * random.random_range(0.0..PI),
    )
}

/// Poses of all bodies in the base frame: nalgebra's isometries, one after the other.
pub fn bodies(robot: &Robot, q: &[f64]) -> Vec<Isometry3<f64>> {
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

/// Pose of a target's link in the base frame.
pub fn link_pose(setup: &Setup, target: usize, q: &[f64]) -> Isometry3<f64> {
    let link = &setup.robot.links[setup.targets[target].link];
    bodies(&setup.robot, q)[link.body] * link.body_from_link
}

/// How far apart two poses are: m, rad. Exact for small angles, where an arc cosine is not.
pub fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let turn = a.rotation.inverse() * b.rotation;
    (
        (a.translation.vector - b.translation.vector).norm(),
        2.0 * turn.imag().norm().min(1.0).asin(),
    )
}

/// A reading of nothing yet: only where the joints are.
pub fn reading(target: usize, joints: Vec<f64>) -> Reading {
    Reading {
        line: 2,
        ..Reading::to_be(target, joints)
    }
}

/// 5 kg, or another mass, with its centre off every axis.
pub fn payload(mass: f64) -> Payload {
    Payload {
        mass,
        com: Vector3::new(0.05, -0.02, 0.06),
    }
}

/// An effect of the catalogue with default options.
pub fn effect(id: &str) -> Arc<dyn AnyEffect> {
    let entry = effects::find(id).unwrap_or_else(|| panic!("no effect {id}"));
    entry.make(toml::Table::new()).unwrap_or_else(|error| {
        panic!("{id} needs options: give the contract some to run it with ({error})")
    })
}

/// A law of a user's own; `{k}` in it is the k-th joint that readings can depend on, counted from 0.
pub struct Law {
    pub name: &'static str,
    acts_on: &'static str,
    law: &'static str,
    /// Name, unit, typical size.
    parameters: &'static [(&'static str, &'static str, f64)],
}

/// Laws that keep the contract like the catalogue.
pub const LAWS: [Law; 5] = [
    Law {
        name: "own_angle",
        acts_on: "q{2}",
        law: "a*sin(q{1}) + b*q{3}*time/1000 + c*temperature*approach{2}",
        parameters: &[("a", "rad", 1e-4), ("b", "1/s", 1e-4), ("c", "rad/K", 1e-5)],
    },
    Law {
        name: "own_torque",
        acts_on: "q{2}",
        law: "c*tau{2} + k*tanh(tau{2}/200)",
        parameters: &[("c", "rad/(N·m)", 1e-6), ("k", "rad", 1e-4)],
    },
    // the torque of other joints
    Law {
        name: "own_distant",
        acts_on: "q{3}",
        law: "c*tau{1} + d*tau{3}*q{0} + m*payload",
        parameters: &[
            ("c", "rad/(N·m)", 1e-6),
            ("d", "1/(N·m)", 1e-6),
            ("m", "rad/kg", 1e-5),
        ],
    },
    Law {
        name: "own_tilt",
        acts_on: "rx{1}",
        law: "a*cos(q{3}) + b*q{1}^2 - a",
        parameters: &[("a", "rad", 1e-4), ("b", "1/rad", 1e-4)],
    },
    Law {
        name: "own_shift",
        acts_on: "ty{1}",
        law: "c*tau{2}*abs(tau{2})/100 + d*tau{1}",
        parameters: &[("c", "m/(N·m)", 2e-7), ("d", "m/(N·m)", 2e-7)],
    },
];

/// One of [`LAWS`] for a robot.
pub fn law(setup: &Setup, name: &str) -> Arc<dyn AnyEffect> {
    let found = LAWS.iter().find(|law| law.name == name).unwrap();
    let named = |text: &str| {
        let mut text = text.to_owned();
        for (k, &joint) in setup.observed.iter().enumerate() {
            let joint = &setup.robot.joints[joint].name;
            text = text.replace(&format!("{{{k}}}"), &format!("[{joint}]"));
        }
        text
    };
    let size = |&(name, unit, typical): &(&str, &str, f64)| {
        format!("{name} = {{ unit = \"{unit}\", typical = {typical} }}")
    };
    let parameters: Vec<String> = found.parameters.iter().map(size).collect();
    let (acts_on, law) = (named(found.acts_on), named(found.law));
    expression(
        setup,
        &format!(
            "name = \"{name}\"\nacts_on = \"{acts_on}\"\nlaw = \"{law}\"\nparameters = {{ {} }}",
            parameters.join(", ")
        ),
    )
}

/// An expression from the keys of its table, checked against a robot.
pub fn expression(setup: &Setup, keys: &str) -> Arc<dyn AnyEffect> {
    let made = effects::find("expression")
        .unwrap()
        .make(toml::from_str(keys).unwrap());
    let effect = made.unwrap_or_else(|error| panic!("{keys}: {error}"));
    effect
        .check(setup)
        .unwrap_or_else(|error| panic!("{keys}: {error}"));
    effect
}

/// An effect of the catalogue, or one of [`LAWS`].
pub fn effect_on(setup: &Setup, id: &str) -> Arc<dyn AnyEffect> {
    if LAWS.iter().any(|law| law.name == id) {
        law(setup, id)
    } else {
        effect(id)
    }
}

/// An effect with values for all its parameters.
pub struct Part {
    pub effect: Arc<dyn AnyEffect>,
    pub values: Vec<f64>,
}

/// Springs of these stiffnesses (N·m/rad), the same on each target's chain from the base on.
pub fn springs(setup: &Setup, stiffness: &[f64]) -> Part {
    let effect = effect("joint_compliance");
    let mut compliance = vec![0.0; setup.robot.joints.len()];
    for target in 0..setup.targets.len() {
        let chain = setup.robot.chain(setup.target_body(target));
        for (joint, k) in chain.into_iter().zip(stiffness) {
            compliance[joint] = 1.0 / k;
        }
    }
    let values = setup
        .observed
        .iter()
        .map(|&joint| compliance[joint])
        .collect();
    Part { effect, values }
}

/// Values about the typical sizes of an effect's parameters, within their bounds.
pub fn about_typical(setup: &Setup, id: &str, size: f64, random: &mut impl Rng) -> Part {
    let effect = effect_on(setup, id);
    let values = effect.parameters(setup).into_iter().map(|parameter| {
        let sign = if random.random::<bool>() { 1.0 } else { -1.0 };
        let value = size * parameter.typical * random.random_range(0.5..1.5) * sign;
        let fits = value >= parameter.lower && value <= parameter.upper;
        if fits { value } else { -value }
    });
    let values = values.collect();
    Part { effect, values }
}

/// tracker_from_target as predicted.
pub fn pose_of(prediction: &Prediction) -> Isometry3<f64> {
    Isometry3::from_parts(prediction.position.into(), prediction.orientation)
}

/// Readings as a campaign that knows no frame and no noise.
pub fn campaign(setup: &Setup, readings: Vec<Reading>) -> Campaign {
    Campaign {
        name: "test".to_owned(),
        robot: setup.robot.clone(),
        robot_file: RobotFile {
            name: "robot.urdf".to_owned(),
            text: String::new(),
            base: None,
        },
        gravity: setup.gravity,
        targets: setup.targets.clone(),
        base_from_tracker: Frame::Estimate,
        link_from_target: vec![Frame::Estimate; setup.targets.len()],
        noise: None,
        readings,
        warnings: Vec::new(),
        notes: Vec::new(),
    }
}
