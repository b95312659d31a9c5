//! The truth: a robot with springs, displaced bodies and instruments, realised in MuJoCo.
//!
//! The plant shares the nominal robot with the model, as data, and nothing else: kinematics, statics
//! and wrist wrenches are MuJoCo's, the instruments' geometry is nalgebra's.
//!
//! A state is the static equilibrium under a command, always sought from the commanded angles: it depends
//! on the command alone, not on what was asked before, and comes out the same to the last bit on any
//! thread.

mod expansion;
pub mod instruments;
pub mod mjcf;
pub mod mujoco;
mod statics;
mod windup;

use crate::mujoco::{Data, JointAddress, Kind, Model, MujocoError};
use expansion::Growing;
use misfit_arm::robot::JointKind;
use misfit_campaign::Wrench;
pub use misfit_truth::{
    Carried, Command, CommandLaw, Drive, Flexure, Load, LoadLaw, PlantSpec, SensorLaw, SpecError,
    TorqueLaw, TrackerLaw, WindupLaw,
};
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;
use statics::Spring;
use std::sync::Arc;

/// The robot at rest under a command.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Actual angle of every moving joint, rad or m.
    pub joints: Vec<f64>,
    /// By target: pose of its link.
    pub base_from_link: Vec<Isometry3<f64>>,
    /// By target: wrench of the load on the arm at the target link's origin, in that link's frame.
    pub wrenches: Vec<Wrench>,
    /// What gravity and pulls put on each joint, rigid ones too, N·m (N); positive turns it forward.
    /// A linear spring deflects by this over its stiffness.
    pub joint_torques: Vec<f64>,
}

/// Why there is no plant, or no state of it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// MuJoCo is missing, or raised an error.
    #[error(transparent)]
    Mujoco(#[from] MujocoError),
    /// A specification that cannot be built.
    #[error(transparent)]
    Spec(#[from] SpecError),
    /// A command that does not fit the plant.
    #[error("the plant cannot be commanded: {0}")]
    Command(String),
    /// A joint that does not hold what it carries.
    #[error(
        "{joint} gives way under its load: it turns or slides by {deflection:.3} (rad or m) from its command"
    )]
    GivesWay {
        /// Its name.
        joint: String,
        /// How far it was from its command when the search was given up, rad (m).
        deflection: f64,
    },
    /// Equilibrium, but the slightest touch would end it.
    #[error("the arm is balanced, not held: {joint} is too soft for what it carries")]
    Unstable {
        /// The joint with the softest spring against what it carries.
        joint: String,
    },
    /// The search for equilibrium did not come to an end.
    #[error(
        "no equilibrium was found in {iterations} iterations; {joint} is left with a torque or force of \
         {residual:.3e} (N·m or N)"
    )]
    NoEquilibrium {
        /// The joint with the largest torque left.
        joint: String,
        /// That torque, N·m (N).
        residual: f64,
        /// How many were tried.
        iterations: usize,
    },
}

/// A robot in MuJoCo. [`Plant::fork`] one for each thread.
pub struct Plant {
    data: Data,
    layout: Arc<Layout>,
}

/// What does not change between states, shared by all forks.
struct Layout {
    /// Joints, then drives.
    joints: Vec<JointAddress>,
    /// How many of them are joints.
    moving: usize,
    springs: Vec<Spring>,
    targets: Vec<TargetIds>,
    command_laws: Vec<CommandLaw>,
    torque_laws: Vec<TorqueLaw>,
    windup_laws: Vec<WindupLaw>,
    load_laws: Vec<LoadLaw>,
    growing: Vec<Growing>,
}

struct TargetIds {
    load: usize,
    force: usize,
    torque: usize,
}

/// All that hangs on one target in one command.
#[derive(Default)]
struct Hanging {
    mass: f64,
    com: Vector3<f64>,
    /// Point in the link's frame, force and moment in the base frame.
    pulls: Vec<(Vector3<f64>, Vector3<f64>, Vector3<f64>)>,
}

impl Plant {
    /// Compiles the robot in MuJoCo.
    ///
    /// # Errors
    /// If the specification is inconsistent, or MuJoCo cannot be used.
    pub fn build(spec: &PlantSpec) -> Result<Plant, PlantError> {
        mjcf::check(spec)?;
        let model = Model::from_xml_string(&mjcf::write(spec))?;
        let mut data = Data::new(model)?;
        // Exact masses, now that the compiler's lower bound on them is behind.
        for body in 1..data.model().bodies() {
            data.set_body_mass(body, 0.0)?;
        }
        for (index, body) in spec.robot.bodies.iter().enumerate() {
            let id = data
                .model()
                .find(Kind::Body, &mjcf::body_name(spec, index))?;
            data.set_body_mass(id, body.mass)?;
        }
        let layout = Layout::new(spec, data.model())?;
        Ok(Plant {
            data,
            layout: Arc::new(layout),
        })
    }

    /// A plant like this one, for another thread.
    ///
    /// # Errors
    /// If memory is short.
    pub fn fork(&self) -> Result<Plant, PlantError> {
        Ok(Plant {
            data: self.data.fork()?,
            layout: Arc::clone(&self.layout),
        })
    }

    /// Runs `visit` for every item, on forks of this plant in parallel; results in the items' order. States do
    /// not depend on what was solved before, so the results do not depend on the number of threads.
    ///
    /// # Errors
    /// The first error of a visit.
    pub fn visit_all<T: Sync, R: Send>(
        self,
        items: &[T],
        visit: impl Fn(&mut Plant, &T) -> Result<R, PlantError> + Sync,
    ) -> Result<Vec<R>, PlantError> {
        /// Items that one fork visits.
        const RUN: usize = 32;
        let original = std::sync::Mutex::new(self);
        let runs: Vec<Vec<R>> = items
            .par_chunks(RUN)
            .map(|run| {
                let fork = original
                    .lock()
                    .unwrap_or_else(std::sync::PoisonError::into_inner)
                    .fork();
                let mut plant = fork?;
                run.iter().map(|item| visit(&mut plant, item)).collect()
            })
            .collect::<Result<_, PlantError>>()?;
        Ok(runs.into_iter().flatten().collect())
    }

    /// The robot at rest under a command.
    ///
    /// # Errors
    /// If the command does not fit the robot, or the robot does not hold its load.
    pub fn state(&mut self, command: &Command) -> Result<State, PlantError> {
        let layout = Arc::clone(&self.layout);
        layout.check(command)?;
        let mut rest = command.joints.clone();
        rest.resize(layout.joints.len(), 0.0);
        for law in &layout.command_laws {
            law(command, &mut rest);
        }
        if let Some(angle) = rest.iter().find(|angle| !angle.is_finite()) {
            return Err(PlantError::Command(format!(
                "a law makes an angle of {angle}"
            )));
        }
        expansion::grow(&mut self.data, &layout.growing, command.temperature)?;
        let hanging = self.hang(command)?;
        let torques = if layout.windup_laws.is_empty() {
            self.settle(&rest, &rest, &hanging)?
        } else {
            self.wind_up(command, &rest, &hanging)?
        };
        self.read(&hanging, &torques)
    }

    /// Static equilibrium with the springs at rest at `at`; the torques of the laws for a command `rest`.
    fn settle(
        &mut self,
        at: &[f64],
        rest: &[f64],
        hanging: &[Hanging],
    ) -> Result<Vec<f64>, PlantError> {
        let layout = Arc::clone(&self.layout);
        // Flexures rest at zero, joints at their command.
        self.data.qpos_mut().fill(0.0);
        for (joint, &angle) in layout.joints.iter().zip(at) {
            self.data.qpos_mut()[joint.qpos] = angle;
            self.data.qpos_spring_mut()[joint.qpos] = angle;
        }
        let mut angles = rest.to_vec();
        let mut torques = vec![0.0; rest.len()];
        statics::solve(&mut self.data, &layout.springs, |data| {
            data.qfrc_applied_mut().fill(0.0);
            for (target, hanging) in layout.targets.iter().zip(hanging) {
                for (point, force, moment) in &hanging.pulls {
                    let point = data.body_pose(target.load)? * nalgebra::Point3::from(*point);
                    data.apply_force(target.load, &point.coords, force, moment)?;
                }
            }
            if !layout.torque_laws.is_empty() {
                for (angle, joint) in angles.iter_mut().zip(&layout.joints) {
                    *angle = data.qpos()[joint.qpos];
                }
                torques.fill(0.0);
                for law in &layout.torque_laws {
                    law(rest, &angles, &mut torques);
                }
                for (torque, joint) in torques.iter().zip(&layout.joints) {
                    data.qfrc_applied_mut()[joint.dof] += torque;
                }
            }
            Ok(())
        })?;
        Ok(torques)
    }

    /// The largest torque, N·m (N), that MuJoCo's whole inverse dynamics finds missing from equilibrium at
    /// the last state: a check on the static solve by a second route.
    ///
    /// # Errors
    /// If MuJoCo raises one.
    pub fn equilibrium_error(&mut self) -> Result<f64, PlantError> {
        let applied = self.data.qfrc_applied().to_vec();
        let missing = self.data.inverse()?;
        let at = |spring: &Spring| (missing[spring.dof] - applied[spring.dof]).abs();
        Ok(self.layout.springs.iter().map(at).fold(0.0, f64::max))
    }

    /// Sets what hangs on every target, also where it is nothing.
    fn hang(&mut self, command: &Command) -> Result<Vec<Hanging>, PlantError> {
        let layout = Arc::clone(&self.layout);
        let mut loads = command.loads.clone();
        for load in &mut loads {
            for law in &layout.load_laws {
                law(command, load);
            }
        }
        layout.check_loads(&loads)?;
        let mut all = Vec::with_capacity(layout.targets.len());
        for (index, target) in layout.targets.iter().enumerate() {
            let mut hanging = Hanging::default();
            for load in loads.iter().filter(|load| load.target == index) {
                let mass = hanging.mass + load.mass;
                hanging.com = if mass > 0.0 {
                    (hanging.com * hanging.mass + load.com * load.mass) / mass
                } else {
                    load.com
                };
                hanging.mass = mass;
                if load.pull != Vector3::zeros() || load.moment != Vector3::zeros() {
                    hanging.pulls.push((load.com, load.pull, load.moment));
                }
            }
            self.data.set_body_mass(target.load, hanging.mass)?;
            self.data.set_body_ipos(target.load, hanging.com)?;
            all.push(hanging);
        }
        Ok(all)
    }

    fn read(&mut self, hanging: &[Hanging], law_torques: &[f64]) -> Result<State, PlantError> {
        let layout = Arc::clone(&self.layout);
        let mut base_from_link = Vec::with_capacity(layout.targets.len());
        for (target, hanging) in layout.targets.iter().zip(hanging) {
            let pose = self.data.body_pose(target.load)?;
            // The sensors know of forces on bodies, not of those put on joints.
            let com = self.data.body_com(target.load)?;
            let (mut force, mut torque) = (Vector3::zeros(), Vector3::zeros());
            for (point, pull, moment) in &hanging.pulls {
                let arm = (pose * nalgebra::Point3::from(*point)).coords - com;
                force += pull;
                torque += moment + arm.cross(pull);
            }
            self.data
                .set_external_wrench(target.load, &force, &torque)?;
            base_from_link.push(pose);
        }
        self.data.update_sensors()?;
        let mut wrenches = Vec::with_capacity(layout.targets.len());
        for target in &layout.targets {
            // MuJoCo gives what the arm exerts on the load.
            wrenches.push(Wrench {
                force: -vector(self.data.sensor(target.force)?),
                torque: -vector(self.data.sensor(target.torque)?),
            });
        }
        let (applied, bias) = (self.data.qfrc_applied(), self.data.qfrc_bias());
        Ok(State {
            joints: layout
                .joints
                .iter()
                .take(layout.moving)
                .map(|joint| self.data.qpos()[joint.qpos])
                .collect(),
            base_from_link,
            wrenches,
            joint_torques: layout
                .joints
                .iter()
                .take(layout.moving)
                .zip(law_torques)
                .map(|(joint, law)| applied[joint.dof] - law - bias[joint.dof])
                .collect(),
        })
    }
}

impl Layout {
    fn new(spec: &PlantSpec, model: &Model) -> Result<Layout, PlantError> {
        let mut joints = Vec::new();
        let mut springs = Vec::new();
        for (index, joint) in spec.robot.joints.iter().enumerate() {
            let address = model.joint(model.find(Kind::Joint, &mjcf::joint_name(spec, index))?)?;
            joints.push(address);
            if let Some(stiffness) = spec.stiffness[index] {
                let name = format!("joint `{}`", joint.name);
                let slides = joint.kind == JointKind::Prismatic;
                springs.push(Spring {
                    name,
                    stiffness,
                    slides,
                    qpos: address.qpos,
                    dof: address.dof,
                });
            }
        }
        for (index, flexure) in spec.flexures.iter().enumerate() {
            for (axis, stiffness) in flexure.stiffness.iter().enumerate() {
                if let &Some(stiffness) = stiffness {
                    let id = model.find(Kind::Joint, &mjcf::flexure_joint_name(index, axis))?;
                    let address = model.joint(id)?;
                    let name = format!("flexure {index} ({})", mjcf::FLEXURE_AXES[axis]);
                    let slides = axis >= 3;
                    springs.push(Spring {
                        name,
                        stiffness,
                        slides,
                        qpos: address.qpos,
                        dof: address.dof,
                    });
                }
            }
        }
        for index in 0..spec.drives.len() {
            joints.push(model.joint(model.find(Kind::Joint, &mjcf::drive_name(index))?)?);
        }
        let mut targets = Vec::new();
        for index in 0..spec.targets.len() {
            let name = mjcf::load_name(spec, index);
            targets.push(TargetIds {
                load: model.find(Kind::Body, &name)?,
                force: model.find(Kind::Sensor, &format!("force_{name}"))?,
                torque: model.find(Kind::Sensor, &format!("torque_{name}"))?,
            });
        }
        Ok(Layout {
            joints,
            moving: spec.robot.joints.len(),
            springs,
            targets,
            command_laws: spec.command_laws.clone(),
            torque_laws: spec.torque_laws.clone(),
            windup_laws: spec.windup_laws.clone(),
            load_laws: spec.load_laws.clone(),
            growing: expansion::find(spec, model)?,
        })
    }

    fn check(&self, command: &Command) -> Result<(), PlantError> {
        let wrong = |what: String| Err(PlantError::Command(what));
        let joints = self.moving;
        for (what, values) in [
            ("angles", &command.joints),
            ("approach directions", &command.approach),
        ] {
            if values.len() != joints {
                return wrong(format!("{} {what} for {joints} joints", values.len()));
            }
            if let Some(value) = values.iter().find(|value| !value.is_finite()) {
                return wrong(format!("{value} among the {what}"));
            }
        }
        for (what, value) in [("time", command.time), ("temperature", command.temperature)] {
            if !value.is_finite() {
                return wrong(format!("{what} is {value}"));
            }
        }
        self.check_loads(&command.loads)
    }

    fn check_loads(&self, loads: &[Load]) -> Result<(), PlantError> {
        let wrong = |what: String| Err(PlantError::Command(what));
        for load in loads {
            if load.target >= self.targets.len() {
                return wrong(format!(
                    "a load on target {} of {}",
                    load.target,
                    self.targets.len()
                ));
            }
            if !(load.mass >= 0.0 && load.mass.is_finite()) {
                return wrong(format!("a load of {} kg", load.mass));
            }
            if !load
                .com
                .iter()
                .chain(load.pull.iter())
                .chain(load.moment.iter())
                .all(|x| x.is_finite())
            {
                return wrong("a load with a centre, pull or moment that is not finite".to_owned());
            }
        }
        Ok(())
    }
}

fn vector(reading: &[f64]) -> Vector3<f64> {
    Vector3::new(reading[0], reading[1], reading[2])
}
