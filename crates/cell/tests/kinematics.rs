//! Where the links are and how they move: four routes from one robot file must agree.

use crate::common::{apart, bodies, file, link_pose, posture, random, sda5f};
use misfit_arm::robot::Robot;
use misfit_campaign::setup::Setup;
use misfit_core::posture::{self, Slots};
use misfit_core::statics::Statics;
use misfit_plant::mujoco::{Data, Kind, Model};
use misfit_plant::{Command, Plant, PlantSpec, mjcf};

const POSTURES: usize = 1000;
/// Rounding of eight products of motions of up to 2 m, 1e-15 each, and as much again for MuJoCo's own.
const ROUNDING: f64 = 1e-12;

/// The model's kinematics of an undisplaced robot.
struct Placed {
    statics: Statics,
    still: Vec<f64>,
}

impl Placed {
    fn new(setup: &Setup) -> Self {
        Self {
            statics: Statics::new(setup),
            still: vec![0.0; Slots::of(setup).count],
        }
    }

    fn place(&mut self, setup: &Setup, joints: &[f64]) {
        self.statics.place(setup, joints, &self.still);
    }
}

fn spec(setup: &Setup) -> PlantSpec {
    let links = setup.targets.iter().map(|target| target.link).collect();
    PlantSpec::new(&setup.robot, links, setup.gravity)
}

/// MuJoCo's own reading of the URDF, with the coordinate of each of the robot's joints.
fn urdf(robot: &Robot) -> (Data, Vec<usize>) {
    let model = Model::from_xml_file(&file("models/sda5f/sda5f.urdf")).unwrap();
    let address = |joint: &misfit_arm::robot::Joint| {
        let id = model.find(Kind::Joint, &joint.name).unwrap();
        model.joint(id).unwrap().qpos
    };
    let addresses = robot.joints.iter().map(address).collect();
    (Data::new(model).unwrap(), addresses)
}

#[track_caller]
fn assert_same(a: &nalgebra::Isometry3<f64>, b: &nalgebra::Isometry3<f64>, what: &str) {
    let (position, angle) = apart(a, b);
    assert!(
        position < ROUNDING && angle < ROUNDING,
        "{what}: {position:e} m, {angle:e} rad"
    );
}

#[test]
fn dual_quaternions_mujoco_and_isometries_agree() {
    let setup = sda5f();
    let robot = &setup.robot;
    let mut placed = Placed::new(&setup);
    let (mut mujoco, addresses) = urdf(robot);
    let mut plant = Plant::build(&spec(&setup)).unwrap();
    // MuJoCo fuses what cannot move with its parent, so every body has the name of its first link
    let ids: Vec<usize> = robot.bodies[1..]
        .iter()
        .map(|body| mujoco.model().find(Kind::Body, &body.name).unwrap())
        .collect();
    let mut random = random(1);
    for _ in 0..POSTURES {
        let joints = posture(robot, &mut random);
        placed.place(&setup, &joints);
        for (&address, &q) in addresses.iter().zip(&joints) {
            mujoco.qpos_mut()[address] = q;
        }
        mujoco.update_position().unwrap();
        for (body, there) in bodies(robot, &joints).iter().enumerate() {
            let here = placed.statics.body[body].to_isometry();
            assert_same(&here, there, "isometries");
            if let Some(moved) = body.checked_sub(1) {
                let oracle = mujoco.body_pose(ids[moved]).unwrap();
                assert_same(&here, &oracle, "MuJoCo's URDF");
            }
        }
        let command = Command {
            approach: vec![0.0; joints.len()],
            joints,
            loads: Vec::new(),
            time: 0.0,
            temperature: 0.0,
        };
        let state = plant.state(&command).unwrap();
        for (target, flange) in state.base_from_link.iter().enumerate() {
            let here = link_pose(&setup, target, &command.joints);
            assert_same(flange, &here, "the plant");
        }
    }
}

#[test]
fn dh_tables_place_the_flanges_where_mujoco_does() {
    let whole = sda5f();
    let (mut mujoco, addresses) = urdf(&whole.robot);
    for (target, arm) in ["r1", "r2"].iter().enumerate() {
        let table = Robot::load(&file(&format!("models/sda5f/{arm}_dh.toml")), None).unwrap();
        let table = crate::common::setup(table, &["flange"]);
        let last = format!("{arm}_t_link");
        let flange = mujoco.model().find(Kind::Body, &last).unwrap();
        let mut placed = Placed::new(&table);
        let mut random = random(2);
        for _ in 0..POSTURES {
            let joints = posture(&whole.robot, &mut random);
            for (&address, &q) in addresses.iter().zip(&joints) {
                mujoco.qpos_mut()[address] = q;
            }
            mujoco.update_position().unwrap();
            let chain = whole.robot.chain(whole.target_body(target));
            let own: Vec<f64> = chain.iter().map(|&joint| joints[joint]).collect();
            placed.place(&table, &own);
            let link = &table.robot.links[table.targets[0].link];
            let here = placed.statics.body[link.body].to_isometry() * link.body_from_link;
            assert_same(&here, &mujoco.body_pose(flange).unwrap(), arm);
        }
    }
}

#[test]
fn screws_are_mujocos_jacobian() {
    let setup = sda5f();
    let spec = spec(&setup);
    let mut placed = Placed::new(&setup);
    let mut mujoco = Data::new(Model::from_xml_string(&mjcf::write(&spec)).unwrap()).unwrap();
    let names = ["load_0_r1_flange", "load_1_r2_flange"];
    let sites = names.map(|name| mujoco.model().find(Kind::Site, name).unwrap());
    let addresses: Vec<_> = setup
        .robot
        .joints
        .iter()
        .enumerate()
        .map(|(index, joint)| {
            let name = format!("joint_{index}_{}", joint.name);
            let id = mujoco.model().find(Kind::Joint, &name).unwrap();
            mujoco.model().joint(id).unwrap()
        })
        .collect();
    let mut random = random(3);
    for _ in 0..POSTURES {
        let joints = posture(&setup.robot, &mut random);
        placed.place(&setup, &joints);
        for (address, &q) in addresses.iter().zip(&joints) {
            mujoco.qpos_mut()[address.qpos] = q;
        }
        mujoco.update_position().unwrap();
        for (target, &site) in sites.iter().enumerate() {
            let point = link_pose(&setup, target, &joints).translation.vector;
            let (translation, rotation) = mujoco.site_jacobian(site).unwrap();
            for (joint, address) in addresses.iter().enumerate() {
                let screw =
                    placed
                        .statics
                        .screw(&setup, posture::Kind::Joint(joint), &placed.still);
                let screw = screw.unwrap();
                let carried = placed.statics.carries(joint + 1, setup.target_body(target));
                let share = if carried { 1.0 } else { 0.0 };
                let linear = screw.at(&point) * share - translation.column(address.dof);
                let angular = screw.angular * share - rotation.column(address.dof);
                let worst = linear.amax().max(angular.amax());
                // differences of points 2 m away, rounded to 1e-15: levers lose little
                assert!(worst < 1e-12, "joint {joint}, target {target}: {worst:e}");
            }
        }
    }
}
