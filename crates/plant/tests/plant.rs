//! The plant against closed forms, hand-written statics and MuJoCo's own inverse dynamics.

#![allow(clippy::unwrap_used)] // in a test it is an assertion

use misfit_arm::robot::{Body, Joint, JointKind, Link, Robot};
use misfit_plant::mujoco::{self, Data, Kind, Model, MujocoError};
use misfit_plant::{Carried, Command, Flexure, Load, Plant, PlantError, PlantSpec, State, mjcf};
use nalgebra::{Isometry3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::sync::Arc;

const G: f64 = 9.81;

fn gravity() -> Vector3<f64> {
    Vector3::new(0.0, 0.0, -G)
}

fn pose(x: f64, y: f64, z: f64, roll: f64, pitch: f64, yaw: f64) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(x, y, z),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    )
}

fn joint(name: &str, parent: usize, at: Isometry3<f64>, axis: [f64; 3]) -> Joint {
    Joint {
        name: name.to_owned(),
        kind: JointKind::Revolute,
        parent,
        parent_from_joint: at,
        axis: Unit::new_normalize(Vector3::from(axis)),
        limits: None,
        effort: None,
    }
}

fn body(name: &str, mass: f64, com: [f64; 3]) -> Body {
    Body {
        name: name.to_owned(),
        mass,
        com: Vector3::from(com),
    }
}

fn link(name: &str, body: usize, at: Isometry3<f64>) -> Link {
    Link {
        name: name.to_owned(),
        body,
        body_from_link: at,
        visuals: Vec::new(),
    }
}

/// A point mass of 2 kg, 0.5 m along x, on a hinge about y at the origin: positive angles lower it.
fn pendulum() -> Robot {
    Robot {
        name: "pendulum".to_owned(),
        joints: vec![joint("hinge", 0, Isometry3::identity(), [0.0, 1.0, 0.0])],
        bodies: vec![
            body("base", 0.0, [0.0; 3]),
            body("bob", 2.0, [0.5, 0.0, 0.0]),
        ],
        links: vec![link("tip", 1, pose(0.5, 0.0, 0.0, 0.0, 0.0, 0.0))],
    }
}

/// Fifteen joints like the two-armed robot that the project is about: a torso and seven on each arm, skew
/// axes; one joint slides, one body has no mass.
fn two_arms() -> Robot {
    let mut robot = Robot {
        name: "two arms".to_owned(),
        joints: vec![joint(
            "torso",
            0,
            pose(0.0, 0.0, 0.9, 0.02, 0.03, 0.0),
            [0.0, 0.0, 1.0],
        )],
        bodies: vec![
            body("base", 60.0, [0.0, 0.0, 0.4]),
            body("trunk", 35.0, [0.05, 0.0, 0.2]),
        ],
        links: Vec::new(),
    };
    let axes = [
        [0., 1., 0.],
        [1., 0., 0.2],
        [0., 0., 1.],
        [0., 1., 0.1],
        [0.3, 0., 1.],
        [0., 1., 0.],
        [1., 0., 0.],
    ];
    for (arm, side) in [("left", 1.0), ("right", -1.0)] {
        for (k, axis) in axes.iter().enumerate() {
            let parent = if k == 0 { 1 } else { robot.bodies.len() - 1 };
            let at = match k {
                0 => pose(0.15, side * 0.24, 0.1, 0.0, 0.1, 0.0),
                _ => pose(0.05, side * 0.06, 0.14, 0.1 * k as f64, -0.2, side * 0.3),
            };
            robot
                .joints
                .push(joint(&format!("{arm}{k}"), parent, at, *axis));
            let mass = if k == 3 { 0.0 } else { 6.0 - 0.7 * k as f64 };
            robot.bodies.push(body(
                &format!("{arm}_body{k}"),
                mass,
                [0.02, side * 0.03, 0.08],
            ));
        }
        let last = robot.bodies.len() - 1;
        robot.links.push(link(
            &format!("{arm}_flange"),
            last,
            pose(0.01, 0.02, 0.1, 0.3, -0.4, 0.5),
        ));
    }
    robot.joints[5].kind = JointKind::Prismatic;
    robot
}

fn stiff(robot: &Robot) -> Vec<Option<f64>> {
    (0..robot.joints.len())
        .map(|j| Some(6e3 + 3e3 * (j % 5) as f64))
        .collect()
}

fn two_arms_spec() -> PlantSpec {
    let robot = two_arms();
    let mut spec = PlantSpec::new(&robot, vec![0, 1], gravity());
    spec.stiffness = stiff(&robot);
    spec
}

fn command(joints: Vec<f64>, loads: Vec<Load>) -> Command {
    Command {
        approach: vec![0.0; joints.len()],
        joints,
        loads,
        time: 0.0,
        temperature: 0.0,
    }
}

fn load(target: usize, mass: f64, com: [f64; 3]) -> Load {
    Load {
        target,
        mass,
        com: Vector3::from(com),
        pull: Vector3::zeros(),
        moment: Vector3::zeros(),
    }
}

/// Fifteen angles, other ones for each seed; the sliding joint stays within a decimetre.
fn angles(seed: usize) -> Vec<f64> {
    let angle =
        |j: usize| ((seed * 37 + j * 11) as f64 * 0.73).sin() * if j == 5 { 0.1 } else { 1.2 };
    (0..15).map(angle).collect()
}

fn both_loads(seed: usize) -> Vec<Load> {
    vec![
        load(0, 5.0, [0.02, -0.01, 0.1]),
        load(1, 1.0 + seed as f64 * 0.1, [0.0, 0.05, 0.0]),
    ]
}

/// Frames of all bodies: the recursion written out, without MuJoCo.
fn frames(robot: &Robot, angles: &[f64]) -> Vec<Isometry3<f64>> {
    let mut frames = vec![Isometry3::identity()];
    for (joint, &angle) in robot.joints.iter().zip(angles) {
        let motion = match joint.kind {
            JointKind::Prismatic => Translation3::from(joint.axis.into_inner() * angle).into(),
            _ => Isometry3::from_parts(
                Translation3::identity(),
                UnitQuaternion::from_axis_angle(&joint.axis, angle),
            ),
        };
        frames.push(frames[joint.parent] * joint.parent_from_joint * motion);
    }
    frames
}

/// Torques of weights and pulls on all joints, from levers, without MuJoCo.
fn torques(robot: &Robot, angles: &[f64], loads: &[Load]) -> Vec<f64> {
    let frames = frames(robot, angles);
    let mut forces: Vec<(usize, Point3<f64>, Vector3<f64>)> = Vec::new();
    for (index, body) in robot.bodies.iter().enumerate() {
        forces.push((
            index,
            frames[index] * Point3::from(body.com),
            gravity() * body.mass,
        ));
    }
    for load in loads {
        let link = &robot.links[load.target];
        let point = frames[link.body] * link.body_from_link * Point3::from(load.com);
        forces.push((link.body, point, gravity() * load.mass + load.pull));
    }
    let hangs_on = |mut body: usize, joint: usize| {
        while body > joint + 1 {
            body = robot.joints[body - 1].parent;
        }
        body == joint + 1
    };
    (0..robot.joints.len())
        .map(|j| {
            let axis = frames[j + 1].rotation * robot.joints[j].axis.into_inner();
            let origin = frames[j + 1] * Point3::origin();
            let on_joint = forces.iter().filter(|(body, ..)| hangs_on(*body, j));
            on_joint
                .map(|(_, point, force)| match robot.joints[j].kind {
                    JointKind::Prismatic => axis.dot(force),
                    _ => axis.dot(&(point - origin).cross(force)),
                })
                .sum()
        })
        .collect()
}

#[track_caller]
fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!(
        (found - expected).abs() <= tolerance,
        "{found:e} is not {expected:e} within {tolerance:e}"
    );
}

fn distance(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    (a.translation.vector - b.translation.vector)
        .norm()
        .max(a.rotation.angle_to(&b.rotation))
}

#[test]
fn a_pendulum_rests_where_its_spring_balances_its_weight() {
    let mut spec = PlantSpec::new(&pendulum(), vec![0], gravity());
    for stiffness in [2e4, 500.0, 40.0, 20.0] {
        spec.stiffness = vec![Some(stiffness)];
        let mut plant = Plant::build(&spec).unwrap();
        for commanded in [0.0, 0.3, -0.7, 2.0] {
            let state = plant.state(&command(vec![commanded], vec![])).unwrap();
            // k (q - commanded) = m g l cos q, by bisection.
            let moment = |q: f64| stiffness * (q - commanded) - 2.0 * G * 0.5 * q.cos();
            let (mut low, mut high) = (commanded - 1.0, commanded + 1.0);
            for _ in 0..100 {
                let middle = 0.5 * (low + high);
                if moment(middle) > 0.0 {
                    high = middle
                } else {
                    low = middle
                }
            }
            assert_near(state.joints[0], low, 1e-14);
        }
    }
}

#[test]
fn joints_deflect_by_torque_over_stiffness() {
    let spec = two_arms_spec();
    let mut plant = Plant::build(&spec).unwrap();
    for seed in 0..20 {
        let mut loads = both_loads(seed);
        loads[0].pull = Vector3::new(20.0, -30.0, 10.0);
        let state = plant.state(&command(angles(seed), loads.clone())).unwrap();
        let torques = torques(&spec.robot, &state.joints, &loads);
        for (j, torque) in torques.iter().enumerate() {
            assert_near(state.joint_torques[j], *torque, 1e-11);
            assert_near(
                state.joints[j] - angles(seed)[j],
                torque / spec.stiffness[j].unwrap(),
                1e-14,
            );
        }
        // Inverse dynamics is a second route to the same statement.
        assert!(plant.equilibrium_error().unwrap() < 1e-10);
    }
}

#[test]
fn links_are_where_the_chain_of_frames_puts_them() {
    let spec = two_arms_spec();
    let mut plant = Plant::build(&spec).unwrap();
    let state = plant.state(&command(angles(3), both_loads(3))).unwrap();
    let frames = frames(&spec.robot, &state.joints);
    for (target, link) in spec.robot.links.iter().enumerate() {
        assert!(
            distance(
                &state.base_from_link[target],
                &(frames[link.body] * link.body_from_link)
            ) < 1e-14
        );
    }
}

#[test]
fn wrenches_are_the_weight_pull_and_moment_at_the_links_origin() {
    let mut plant = Plant::build(&two_arms_spec()).unwrap();
    let mut loads = both_loads(1);
    loads[1].pull = Vector3::new(3.0, 40.0, -7.0);
    loads[1].moment = Vector3::new(0.4, -0.2, 0.9);
    // A second load on the same target.
    loads.push(Load {
        target: 0,
        mass: 0.7,
        com: Vector3::new(0.3, 0.0, 0.0),
        pull: Vector3::new(0.0, 9.0, 0.0),
        moment: Vector3::zeros(),
    });
    let state = plant.state(&command(angles(1), loads.clone())).unwrap();
    for target in 0..2 {
        let pose = state.base_from_link[target];
        let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
        for load in loads.iter().filter(|load| load.target == target) {
            let local = pose.rotation.inverse() * (gravity() * load.mass + load.pull);
            force += local;
            torque += load.com.cross(&local) + pose.rotation.inverse() * load.moment;
        }
        assert!((state.wrenches[target].force - force).norm() < 1e-12);
        assert!((state.wrenches[target].torque - torque).norm() < 1e-12);
    }
    let bare = plant.state(&command(angles(1), vec![])).unwrap();
    for wrench in bare.wrenches {
        assert_eq!((wrench.force.norm(), wrench.torque.norm()), (0.0, 0.0));
    }
}

#[test]
fn rigid_joints_stay_at_their_command() {
    let mut spec = two_arms_spec();
    for j in [0, 3, 5, 9] {
        spec.stiffness[j] = None;
    }
    let state = Plant::build(&spec)
        .unwrap()
        .state(&command(angles(2), both_loads(2)))
        .unwrap();
    for (j, stiffness) in spec.stiffness.iter().enumerate() {
        assert_eq!(
            state.joints[j] == angles(2)[j],
            stiffness.is_none(),
            "joint {j}"
        );
    }
    spec.stiffness.fill(None);
    let state = Plant::build(&spec)
        .unwrap()
        .state(&command(angles(2), both_loads(2)))
        .unwrap();
    assert_eq!(state.joints, angles(2));
    let torques = torques(&spec.robot, &state.joints, &both_loads(2));
    for (j, torque) in torques.iter().enumerate() {
        assert_near(state.joint_torques[j], *torque, 1e-11);
    }
}

#[test]
fn a_displaced_body_carries_everything_with_it() {
    let mut spec = two_arms_spec();
    spec.body_from_displaced[0] = pose(0.01, 0.0, -0.02, 0.001, 0.02, 0.03);
    spec.body_from_displaced[4] = pose(0.001, -0.002, 0.0005, 0.003, -0.001, 0.002);
    spec.body_from_displaced[8] = pose(0.0, 0.1, 0.0, 0.5, 0.0, 0.0);
    let state = Plant::build(&spec)
        .unwrap()
        .state(&command(angles(4), both_loads(4)))
        .unwrap();
    // The same robot with the displacements composed into joints, links, centres of mass and base.
    let mut composed = two_arms();
    for (index, displaced) in spec.body_from_displaced.iter().enumerate() {
        composed.bodies[index].com = (displaced * Point3::from(composed.bodies[index].com)).coords;
        for joint in composed
            .joints
            .iter_mut()
            .filter(|joint| joint.parent == index)
        {
            joint.parent_from_joint = displaced * joint.parent_from_joint;
        }
        for link in composed.links.iter_mut().filter(|link| link.body == index) {
            link.body_from_link = displaced * link.body_from_link;
        }
    }
    let mut plain = PlantSpec::new(&composed, vec![0, 1], gravity());
    plain.stiffness = spec.stiffness.clone();
    let expected = Plant::build(&plain)
        .unwrap()
        .state(&command(angles(4), both_loads(4)))
        .unwrap();
    for j in 0..15 {
        assert_near(state.joints[j], expected.joints[j], 1e-14);
    }
    for target in 0..2 {
        assert!(
            distance(
                &state.base_from_link[target],
                &expected.base_from_link[target]
            ) < 1e-14
        );
        assert!((state.wrenches[target].torque - expected.wrenches[target].torque).norm() < 1e-12);
    }
}

#[test]
fn half_the_stiffness_doubles_the_deflection_to_first_order() {
    let mut spec = two_arms_spec();
    let deflection = |spec: &PlantSpec| {
        let state = Plant::build(spec)
            .unwrap()
            .state(&command(angles(6), both_loads(6)))
            .unwrap();
        state
            .joints
            .iter()
            .zip(angles(6))
            .map(|(q, rest)| q - rest)
            .collect::<Vec<_>>()
    };
    let once = deflection(&spec);
    spec.stiffness.iter_mut().flatten().for_each(|k| *k *= 0.5);
    let twice = deflection(&spec);
    let largest = once.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    assert!(largest > 1e-3);
    for (a, b) in once.iter().zip(twice) {
        // What is left goes with the square of the deflection.
        assert_near(b, 2.0 * a, 5.0 * largest * largest);
    }
}

#[test]
fn soft_joints_converge_to_the_same_law() {
    let mut spec = two_arms_spec();
    for j in (0..15).filter(|j| *j != 5) {
        spec.stiffness[j] = Some(250.0);
    }
    let mut plant = Plant::build(&spec).unwrap();
    for seed in 0..10 {
        let state = plant.state(&command(angles(seed), both_loads(0))).unwrap();
        let torques = torques(&spec.robot, &state.joints, &both_loads(0));
        let largest = state
            .joints
            .iter()
            .zip(angles(seed))
            .map(|(q, r)| (q - r).abs())
            .fold(0.0, f64::max);
        assert!(largest > 0.03, "seed {seed}: only {largest}");
        for (j, torque) in torques.iter().enumerate() {
            assert_near(
                state.joints[j] - angles(seed)[j],
                torque / spec.stiffness[j].unwrap(),
                1e-12,
            );
        }
    }
}

#[test]
fn an_arm_that_collapses_is_an_error_that_names_the_joint() {
    let mut spec = PlantSpec::new(&pendulum(), vec![0], gravity());
    spec.stiffness = vec![Some(2.0)];
    let mut plant = Plant::build(&spec).unwrap();
    let error = plant
        .state(&command(vec![0.0], vec![load(0, 50.0, [0.0; 3])]))
        .unwrap_err();
    assert!(
        matches!(&error, PlantError::GivesWay { joint, .. } if joint.contains("hinge")),
        "{error}"
    );
    // Straight up: in equilibrium, but too soft to stay there.
    let error = plant
        .state(&command(vec![-std::f64::consts::FRAC_PI_2], vec![]))
        .unwrap_err();
    assert!(matches!(error, PlantError::Unstable { .. }), "{error}");
    // The plant lives on.
    assert!(
        plant
            .state(&command(vec![std::f64::consts::FRAC_PI_2], vec![]))
            .is_ok()
    );

    let mut spec = two_arms_spec();
    spec.stiffness.fill(Some(3.0));
    let mut plant = Plant::build(&spec).unwrap();
    for seed in 0..10 {
        assert!(plant.state(&command(angles(seed), both_loads(0))).is_err());
    }
}

#[test]
fn a_state_does_not_depend_on_what_was_asked_before_or_where() {
    let plant = Plant::build(&two_arms_spec()).unwrap();
    let ask = |plant: &mut Plant, seed: usize| {
        let loads = if seed.is_multiple_of(2) {
            both_loads(seed)
        } else {
            vec![]
        };
        plant.state(&command(angles(seed), loads)).unwrap()
    };
    let mut one = plant.fork().unwrap();
    let forward: Vec<State> = (0..12).map(|seed| ask(&mut one, seed)).collect();
    let backward: Vec<State> = (0..12).rev().map(|seed| ask(&mut one, seed)).collect();
    assert_eq!(forward, backward.into_iter().rev().collect::<Vec<_>>());
    std::thread::scope(|scope| {
        for start in 0..4 {
            let (plant, forward) = (&plant, &forward);
            scope.spawn(move || {
                let mut fork = plant.fork().unwrap();
                for seed in (start..12).step_by(4) {
                    assert_eq!(ask(&mut fork, seed), forward[seed]);
                }
            });
        }
    });
}

#[test]
fn masses_come_from_the_load_even_where_the_robot_has_none() {
    let mut robot = pendulum();
    robot.bodies[1].mass = 0.0;
    let mut spec = PlantSpec::new(&robot, vec![0], gravity());
    spec.stiffness = vec![Some(1e4)];
    let mut plant = Plant::build(&spec).unwrap();
    let bare = plant.state(&command(vec![0.4], vec![])).unwrap();
    assert_eq!((bare.joints[0], bare.joint_torques[0]), (0.4, 0.0));
    let loaded = plant
        .state(&command(vec![0.4], vec![load(0, 30.0, [0.1, 0.0, 0.0])]))
        .unwrap();
    assert_near(
        loaded.joint_torques[0],
        30.0 * G * 0.6 * loaded.joints[0].cos(),
        1e-12,
    );
    assert_near(loaded.joints[0] - 0.4, loaded.joint_torques[0] / 1e4, 1e-15);
}

#[test]
fn laws_of_commands_and_torques_act_within_the_solve() {
    let mut spec = PlantSpec::new(&pendulum(), vec![0], gravity());
    spec.stiffness = vec![Some(800.0)];
    spec.command_laws.push(Arc::new(|command, angles| {
        angles[0] += 1e-3 * command.approach[0]
    }));
    spec.torque_laws.push(Arc::new(|rest, angles, torques| {
        torques[0] -= 5e4 * (angles[0] - rest[0]).powi(3)
    }));
    let mut plant = Plant::build(&spec).unwrap();
    let state = plant
        .state(&Command {
            approach: vec![-1.0],
            ..command(vec![0.2], vec![])
        })
        .unwrap();
    let deflection = state.joints[0] - 0.199;
    assert_near(
        state.joint_torques[0],
        2.0 * G * 0.5 * state.joints[0].cos(),
        1e-12,
    );
    assert_near(
        800.0 * deflection + 5e4 * deflection.powi(3),
        state.joint_torques[0],
        1e-11,
    );
}

#[test]
fn flexures_turn_and_shift_by_the_wrench_at_their_pivot() {
    let mut spec = PlantSpec::new(&pendulum(), vec![0], gravity());
    let k = 1e6;
    for carries in [Carried::Body(0), Carried::Joint(0), Carried::Body(1)] {
        let pivot = pose(0.0, 0.0, -0.7, 0.0, 0.0, 0.0);
        spec.flexures = vec![Flexure {
            carries,
            pivot,
            stiffness: [Some(k); 6],
        }];
        let state = Plant::build(&spec)
            .unwrap()
            .state(&command(vec![0.0], vec![]))
            .unwrap();
        let weight = 2.0 * G;
        // Lowered by its weight, turned about y by its moment about the pivot 0.7 m below.
        let turn = weight * 0.5 / k;
        let pose = state.base_from_link[0];
        assert_near(
            pose.translation.z,
            -weight / k - 0.5 * turn,
            10.0 * turn * turn,
        );
        assert_near(pose.translation.x, 0.5 + 0.7 * turn, 10.0 * turn * turn);
        assert_near(pose.rotation.scaled_axis().y, turn, 10.0 * turn * turn);
        assert_near(state.joints[0], 0.0, 0.0);
    }
}

#[test]
fn nonsense_is_refused_before_it_reaches_mujoco() {
    let mut plant = Plant::build(&two_arms_spec()).unwrap();
    let nan = |j: usize| {
        (0..15)
            .map(|k| if k == j { f64::NAN } else { 0.0 })
            .collect()
    };
    for bad in [
        command(vec![0.0; 3], vec![]),
        command(nan(4), vec![]),
        command(angles(0), vec![load(2, 1.0, [0.0; 3])]),
        command(angles(0), vec![load(0, -1.0, [0.0; 3])]),
        command(angles(0), vec![load(0, 1.0, [f64::INFINITY, 0.0, 0.0])]),
        Command {
            approach: vec![],
            ..command(angles(0), vec![])
        },
    ] {
        assert!(matches!(plant.state(&bad), Err(PlantError::Command(_))));
    }
    let breakages: [fn(&mut PlantSpec); 8] = [
        |spec| spec.stiffness[2] = Some(0.0),
        |spec| spec.stiffness[2] = Some(f64::NAN),
        |spec| spec.stiffness.truncate(3),
        |spec| spec.robot.bodies.truncate(3),
        |spec| spec.robot.bodies[3].mass = -1.0,
        |spec| spec.targets.push((9, Isometry3::identity())),
        |spec| spec.robot.joints[2].parent = 12,
        |spec| spec.gravity.x = f64::NAN,
    ];
    for breakage in breakages {
        let mut spec = two_arms_spec();
        breakage(&mut spec);
        assert!(matches!(Plant::build(&spec), Err(PlantError::Spec(_))));
    }
}

#[test]
fn odd_names_stay_names() {
    let mut spec = two_arms_spec();
    let expected = Plant::build(&spec)
        .unwrap()
        .state(&command(angles(1), both_loads(1)))
        .unwrap();
    let odd = "\"/></body><joint name='x&amp;' type=\"free\"/>\n\u{1}<!-- ä 関節 ";
    for joint in &mut spec.robot.joints {
        joint.name = odd.to_owned();
    }
    for body in &mut spec.robot.bodies {
        body.name = odd.repeat(40);
    }
    for link in &mut spec.robot.links {
        link.name = String::new();
    }
    spec.robot.name = odd.to_owned();
    let state = Plant::build(&spec)
        .unwrap()
        .state(&command(angles(1), both_loads(1)))
        .unwrap();
    assert_eq!(state, expected);
}

#[test]
fn what_mujoco_refuses_is_an_error_and_the_process_lives_on() {
    let texts = [
        "",
        "not xml",
        "<mujoco><worldbody><body><joint type='hinge'/></body></worldbody></mujoco>",
        "<mujoco><worldbody><body name='a'/><body name='a'/></worldbody></mujoco>",
        "<mujoco><nonsense/></mujoco>",
        "<mujoco><worldbody><body><freejoint/><geom size='0'/></body></worldbody></mujoco>",
        "<robot name='r'><link name='a'/><joint name='j' type='nonsense'/></robot>",
    ];
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                for text in texts {
                    let error = Model::from_xml_string(text).unwrap_err();
                    assert!(
                        matches!(&error, MujocoError::Model(why) if !why.is_empty()),
                        "{text}: {error}"
                    );
                }
                assert!(
                    Plant::build(&two_arms_spec())
                        .unwrap()
                        .state(&command(angles(0), vec![]))
                        .is_ok()
                );
            });
        }
    });
}

#[test]
fn the_binding_checks_indices_and_lengths() {
    let spec = two_arms_spec();
    let mut data = Data::new(Model::from_xml_string(&mjcf::write(&spec)).unwrap()).unwrap();
    let (zero, bodies) = (Vector3::zeros(), data.model().bodies());
    assert_eq!(
        (
            data.model().joints(),
            data.model().dofs(),
            data.model().coordinates()
        ),
        (15, 15, 15)
    );
    assert!(data.model().find(Kind::Body, "nobody").is_err());
    assert!(data.model().find(Kind::Body, "no\0body").is_err());
    assert!(data.model().joint(15).is_err());
    assert!(data.model().body_mass(bodies).is_err());
    assert!(data.model().body_parent(usize::MAX).is_err());
    assert!(data.set_body_mass(bodies, 1.0).is_err());
    assert!(data.set_body_mass(1, f64::NAN).is_err());
    assert!(data.set_body_ipos(bodies, zero).is_err());
    assert!(data.body_pose(bodies).is_err());
    assert!(data.body_com(bodies).is_err());
    assert!(data.apply_force(bodies, &zero, &zero, &zero).is_err());
    assert!(data.set_external_wrench(bodies, &zero, &zero).is_err());
    assert!(data.site_position(2).is_err());
    assert!(data.site_rotation(2).is_err());
    assert!(data.site_jacobian(2).is_err());
    assert!(data.sensor(4).is_err());
    assert!(data.static_residual(&mut [0.0; 14]).is_err());
    assert!(mujoco::take_warnings().is_empty());
}

#[test]
fn site_jacobians_are_the_derivatives_of_site_positions() {
    let spec = two_arms_spec();
    let mut data = Data::new(Model::from_xml_string(&mjcf::write(&spec)).unwrap()).unwrap();
    let site = data
        .model()
        .find(Kind::Site, "load_1_right_flange")
        .unwrap();
    data.qpos_mut().copy_from_slice(&angles(8));
    data.update_position().unwrap();
    let (translation, rotation) = data.site_jacobian(site).unwrap();
    let step = 1e-6;
    for j in 0..15 {
        let mut at = |offset: f64| {
            data.qpos_mut().copy_from_slice(&angles(8));
            data.qpos_mut()[j] += offset;
            data.update_position().unwrap();
            (
                data.site_position(site).unwrap(),
                data.site_rotation(site).unwrap(),
            )
        };
        let ((p1, r1), (p0, r0)) = (at(step), at(-step));
        assert!((translation.column(j) - (p1 - p0) / (2.0 * step)).norm() < 1e-9);
        let turn = r1 * r0.transpose();
        let twice = Vector3::new(
            turn.m32 - turn.m23,
            turn.m13 - turn.m31,
            turn.m21 - turn.m12,
        );
        assert!((rotation.column(j) - twice / (4.0 * step)).norm() < 1e-9);
    }
}

#[test]
fn urdf_is_read_too() {
    let urdf = "<robot name='r'><link name='a'/><link name='b'><inertial><mass value='1'/>\
        <inertia ixx='1' iyy='1' izz='1' ixy='0' ixz='0' iyz='0'/></inertial></link>\
        <joint name='j' type='revolute'><parent link='a'/><child link='b'/><origin xyz='0 0 1'/>\
        <axis xyz='0 1 0'/><limit lower='-1' upper='1' effort='1' velocity='1'/></joint></robot>";
    let mut data = Data::new(Model::from_xml_string(urdf).unwrap()).unwrap();
    data.update_position().unwrap();
    let body = data.model().find(Kind::Body, "b").unwrap();
    assert_near(data.body_pose(body).unwrap().translation.z, 1.0, 0.0);
}

/// Not a test of anything: `cargo test --release plant::speed -- --ignored --nocapture`.
#[test]
#[ignore = "prints a speed"]
fn speed() {
    let mut plant = Plant::build(&two_arms_spec()).unwrap();
    let commands: Vec<_> = (0..500)
        .map(|seed| command(angles(seed), both_loads(seed % 7)))
        .collect();
    let start = std::time::Instant::now();
    for _ in 0..10 {
        for command in &commands {
            plant.state(command).unwrap();
        }
    }
    println!(
        "{:.0} states per second",
        5000.0 / start.elapsed().as_secs_f64()
    );
}
