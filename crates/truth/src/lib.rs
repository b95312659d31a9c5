//! What a simulated robot really is, as plain data: springs, displaced bodies, laws by command.
//!
//! Effects write their truth into a [`PlantSpec`]; the plant builds it in MuJoCo. Neither knows the other: the model and
//! the plant share the names, the parameters and their units that meet here, and no code.

mod laws;

pub use laws::{CommandLaw, LoadLaw, SensorLaw, TorqueLaw, TrackerLaw, WindupLaw};
use misfit_arm::robot::Robot;
use nalgebra::{Isometry3, Vector3};

/// The truth under construction; effects add themselves to it, then the plant makes it.
#[derive(Clone)]
pub struct PlantSpec {
    /// The robot as MuJoCo will have it: starts nominal, effects move joints and masses.
    pub robot: Robot,
    /// By body: where what the body carries (links, mass, further joints) really sits, in the frame that
    /// its joint moves.
    pub body_from_displaced: Vec<Isometry3<f64>>,
    /// By joint: torsional spring, N·m/rad (N/m for a slide); `None` is rigid.
    pub stiffness: Vec<Option<f64>>,
    /// Further places where the structure gives way.
    pub flexures: Vec<Flexure>,
    /// Further places that laws move, as they move joints: see [`PlantSpec::add_drive`].
    pub drives: Vec<Drive>,
    /// Added to the commanded angles before the springs' rest positions are set.
    pub command_laws: Vec<CommandLaw>,
    /// Torques beside the springs', re-evaluated within the static solve.
    pub torque_laws: Vec<TorqueLaw>,
    /// How joints wind up under the torque they bear, whether sprung or not.
    pub windup_laws: Vec<WindupLaw>,
    /// From the loads that a command states to those that hang there.
    pub load_laws: Vec<LoadLaw>,
    /// Linear expansion of every body, 1/K.
    pub expansion: f64,
    /// How the expansion itself grows, 1/K: `ΔT` above the mean counts as `ΔT (1 + b ΔT)`.
    pub expansion_curvature: f64,
    /// Gravity in the base frame, m/s².
    pub gravity: Vector3<f64>,
    /// By target: link index and the target's pose in it.
    pub targets: Vec<(usize, Isometry3<f64>)>,
    /// Where the tracker stands.
    pub base_from_tracker: Isometry3<f64>,
    /// How it moves while it stands there.
    pub tracker_laws: Vec<TrackerLaw>,
    /// By which share the tracker's distances are too long.
    pub tracker_scale: f64,
    /// From the wrench on a wrist to what its sensor says.
    pub sensor_laws: Vec<SensorLaw>,
}

/// A sprung connection where the nominal robot is rigid: three small rotations and three small
/// translations in the axes of a pivot frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Flexure {
    /// What it carries.
    pub carries: Carried,
    /// The pivot frame, in the frame that [`Carried`] names.
    pub pivot: Isometry3<f64>,
    /// About x, y, z in N·m/rad, then along x, y, z in N/m; `None` is rigid.
    pub stiffness: [Option<f64>; 6],
}

/// A motion where the nominal robot is rigid: a hinge or slide without spring between a body and the joint that moves
/// it, at zero but for the laws.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Drive {
    /// The body that it moves.
    pub body: usize,
    /// Along x, y, z (0 to 2, m) or about them (3 to 5, rad), in the frame that the body's joint moves.
    pub axis: usize,
}

/// Where a flexure sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carried {
    /// Behind the body's joint: carries the body whole, its mass too. The pivot is given in the frame that
    /// the joint moves. Body 0 is the base: its pivot is given in the base frame.
    Body(usize),
    /// Before the joint: carries what the joint moves, but not the body that the joint hangs on. The pivot
    /// is given in the joint's frame at rest.
    Joint(usize),
}

/// What the robot was told to do and carries: all that a plant's state depends on.
#[derive(Debug, Clone, PartialEq)]
pub struct Command {
    /// Commanded angle of every moving joint, rad or m.
    pub joints: Vec<f64>,
    /// Direction of each joint's last motion: -1, 0, +1.
    pub approach: Vec<f64>,
    /// What hangs on the targets' links.
    pub loads: Vec<Load>,
    /// Time from the middle of the campaign, s.
    pub time: f64,
    /// Temperature above the campaign's mean, K.
    pub temperature: f64,
}

/// A dead weight on a target's link, and a pull and a moment in the base frame at its centre.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Index into the plant's targets.
    pub target: usize,
    /// kg.
    pub mass: f64,
    /// Centre in the target link's frame, m.
    pub com: Vector3<f64>,
    /// Force at that centre, in the base frame, N (a rope over a pulley).
    pub pull: Vector3<f64>,
    /// Moment beside it, in the base frame, N·m (a tool that cuts).
    pub moment: Vector3<f64>,
}

/// Why an effect cannot be put into a plant.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpecError {
    /// A value the plant cannot realise.
    #[error("{effect}.{parameter}: the plant cannot realise {found}; accepted: {accepted}")]
    Value {
        /// Effect.
        effect: &'static str,
        /// Parameter.
        parameter: String,
        /// The value.
        found: f64,
        /// What would do.
        accepted: &'static str,
    },
    /// A specification that describes no robot.
    #[error("the plant cannot be built: {0}")]
    Spec(String),
}

impl PlantSpec {
    /// The nominal robot: rigid joints, nothing displaced, targets at the origins of these links
    /// (indices into `robot.links`), the tracker in the base; gravity in the base frame, m/s².
    pub fn new(robot: &Robot, targets: Vec<usize>, gravity: Vector3<f64>) -> PlantSpec {
        PlantSpec {
            robot: robot.clone(),
            body_from_displaced: vec![Isometry3::identity(); robot.bodies.len()],
            stiffness: vec![None; robot.joints.len()],
            flexures: Vec::new(),
            drives: Vec::new(),
            command_laws: Vec::new(),
            torque_laws: Vec::new(),
            windup_laws: Vec::new(),
            load_laws: Vec::new(),
            expansion: 0.0,
            expansion_curvature: 0.0,
            gravity,
            targets: targets
                .into_iter()
                .map(|link| (link, Isometry3::identity()))
                .collect(),
            base_from_tracker: Isometry3::identity(),
            tracker_laws: Vec::new(),
            tracker_scale: 0.0,
            sensor_laws: Vec::new(),
        }
    }

    /// Adds a drive; the place of its position in the angles that [`CommandLaw`]s and [`WindupLaw`]s add to, where
    /// the drives follow the joints.
    pub fn add_drive(&mut self, body: usize, axis: usize) -> usize {
        self.drives.push(Drive { body, axis });
        self.robot.joints.len() + self.drives.len() - 1
    }
}
