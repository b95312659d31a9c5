//! Two arms drill: one holds a board, the other drills it, both give way.
//!
//! Each tick the plant is at rest under the commands and the wrench of that moment: MuJoCo's static states, no inertia, no
//! vibration. Thrust and torque are those of the feed that is left when both arms have given way (`cutting.rs`,
//! `contact.rs`). Both wrist sensors are read with their noise. The commands are those of the nominal robot, or corrected by
//! a fitted model for geometry and tools, or corrected besides, in the loop, for what the sensors feel.
//!
//! Source: Appl. Sci. 2019, 9, 65, sec. 5 and Fig. 6, 10 and 11.

mod arms;
mod commands;
pub mod contact;
pub mod cutting;
mod spec;
pub mod summary;

pub use spec::{Drilling, LayerEntry, Mode};

use super::compensated::learn;
use super::design::{from_below, stream};
use super::{Scenario, ScenarioError, simulate};
use crate::campaign::{Reading, Wrench};
use crate::compensation::Robot;
use crate::compensation::filter::Law;
use crate::model::Model;
use crate::plant::instruments::{Draws, read};
use crate::plant::{Command, Plant, PlantError, PlantSpec};
use crate::space::generator;
use arms::{Arm, Stand};
use commands::Commands;
use contact::{Contact, Hole, Moment};
use cutting::Need;
use nalgebra::{Isometry3, Vector2, Vector3};
use rayon::prelude::*;

/// One moment of a hole.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// From the start, s; the command touches the board after `approach_s`.
    pub time: f64,
    /// Commanded angles, rad (m).
    pub joints: Vec<f64>,
    /// Depth of the tip in the board, m; negative before it touches.
    pub depth: f64,
    /// Thrust and torque on the drill.
    pub need: Need,
    /// Lateral force on the drill, board's x and y, N.
    pub lateral: Vector2<f64>,
    /// Angle between the drill's axis and the board's normal, rad.
    pub tilt: f64,
    /// What the board's wrist sensor says, in its link's frame.
    pub board: Wrench,
    /// The same of the drill's.
    pub tool: Wrench,
    /// Where the links of board and drill are.
    pub links: [Isometry3<f64>; 2],
    /// Poses of board and drill, tracker's frame, as the instruments would see them without noise.
    pub seen: [Isometry3<f64>; 2],
}

/// A hole.
#[derive(Debug, Clone, PartialEq)]
pub struct Bored {
    /// How its commands were made.
    pub mode: Mode,
    /// Every tick.
    pub samples: Vec<Sample>,
    /// Where it is, from where it is to be, board's x and y, m; none if the drill did not get in.
    pub miss: Option<Vector2<f64>>,
    /// How far the command had to be moved along the feed to touch the board, m.
    pub touch: f64,
    /// Ticks whose command was not found: the one before stood.
    pub unreached: usize,
    /// Joints loaded beyond their rating: index, largest torque and rating, N·m (N).
    pub overloaded: Vec<(usize, f64, f64)>,
}

/// Drills a hole in each mode.
///
/// # Errors
/// If plant or model cannot be built, no posture holds the board or reaches it, or the plant collapses.
pub fn bore(
    scenario: &Scenario,
    wanted: &Drilling,
    on_hole: impl Fn() + Sync,
) -> Result<Vec<Bored>, ScenarioError> {
    let of_plant = |source| scenario.plant_error(source);
    let campaign = simulate::simulate(scenario, || {})?;
    let (model, values, _) = learn(scenario, &campaign, "[drill] model", &wanted.model)?;
    let spec = simulate::plant_spec(scenario).map_err(of_plant)?;
    let cell = Cell::new(scenario, wanted, &spec, &model, &values)?;
    let plant = Plant::build(&spec).map_err(of_plant)?;
    let forks: Vec<(Mode, Plant)> = wanted
        .modes
        .iter()
        .map(|&mode| Ok((mode, plant.fork()?)))
        .collect::<Result<_, PlantError>>()
        .map_err(of_plant)?;
    forks
        .into_par_iter()
        .map(|(mode, mut plant)| {
            let hole = cell.bore(&mut plant, mode).map_err(of_plant)?;
            on_hole();
            Ok(hole)
        })
        .collect()
}

/// All that the holes share.
struct Cell<'a> {
    wanted: &'a Drilling,
    spec: &'a PlantSpec,
    model: &'a Model,
    /// The model's parameters, without those of joints that both arms hang on.
    values: Vec<f64>,
    robot: Robot<'a>,
    board: Arm,
    tool: Arm,
    /// Direction of the feed, tracker's frame.
    feed: Vector3<f64>,
    law: Law,
    draws: Vec<Draws>,
    noise: crate::campaign::Noise,
}

impl<'a> Cell<'a> {
    fn new(
        scenario: &'a Scenario,
        wanted: &'a Drilling,
        spec: &'a PlantSpec,
        model: &'a Model,
        values: &[f64],
    ) -> Result<Self, ScenarioError> {
        let setup = &scenario.setup;
        let form = |message: String| scenario.form_error(message);
        let target = |name: &str| setup.targets.iter().position(|t| t.name == *name);
        let (Some(board), Some(tool)) = (target(&wanted.board), target(&wanted.tool)) else {
            return Err(form("[drill] board and tool must be targets".to_owned()));
        };
        let shared = arms::shared_joints(setup, [board, tool]);
        let values = arms::values_under_thrust(model, values, &shared);
        let robot = Robot::new(model, &values);
        let base_from = arms::poses(wanted, &-setup.gravity);
        let stand = Stand {
            scenario,
            wanted,
            robot: &robot,
            shared: &shared,
        };
        let mut random = generator(scenario.seed, stream::DRILL);
        let board = (board, &wanted.board_load, "board");
        let board = stand.arm(board, &base_from[0], &mut random)?;
        let tool = (tool, &wanted.tool_load, "drill");
        let tool = stand.arm(tool, &base_from[1], &mut random)?;
        let feed = Vector3::from(wanted.feed).normalize();
        let feed = robot.base_from_tracker().inverse().rotation * feed;
        let ticks = (wanted.duration() * wanted.rate_hz).round() as usize;
        let joints = setup.robot.joints.len();
        let draws = (0..2 * ticks).map(|_| Draws::new(joints, &mut random));
        let draws: Vec<Draws> = draws.collect();
        let law = wanted.law().map_err(form)?;
        Ok(Self {
            wanted,
            spec,
            model,
            values,
            board,
            tool,
            feed,
            robot,
            law,
            draws,
            noise: scenario.noise,
        })
    }

    /// All joints: the board's arm, the drill's, and the others where the board's posture has them.
    fn together(&self, board: &[f64], tool: &[f64]) -> Vec<f64> {
        let mut joints = board.to_vec();
        for &joint in &self.tool.reach.moving {
            joints[joint] = tool[joint];
        }
        joints
    }

    fn command(&self, board: &[f64], tool: &[f64]) -> Command {
        let loads = [&self.board, &self.tool].map(|arm| arm.load.on(arm.target));
        from_below(self.together(board, tool), loads.to_vec())
    }

    /// Pose of the drill's task with the tip so far along the feed, tracker's frame, m.
    fn along(&self, feed: f64) -> Vector3<f64> {
        self.tool.task.position + self.feed * feed
    }

    fn bore(&self, plant: &mut Plant, mode: Mode) -> Result<Bored, PlantError> {
        let mut commands = Commands::new(self, mode);
        let (drill, layers) = (self.wanted.drill(), self.wanted.layers());
        let tick = 1.0 / self.wanted.rate_hz;
        let contact = Contact::new(
            self.spec,
            (self.board.target, self.tool.target),
            (&drill, &layers),
            tick,
            plant,
            &commands.both(),
        )?;
        commands.touch(plant, &contact)?;
        let mut hole = Hole::default();
        let mut samples = Vec::with_capacity(self.draws.len() / 2);
        let mut borne = vec![0.0_f64; self.model.setup.robot.joints.len()];
        for (index, draws) in self.draws.chunks(2).enumerate() {
            let time = index as f64 * tick;
            commands.before(time);
            let moment = contact.advance(plant, &commands.both(), &mut hole)?;
            for (most, torque) in borne.iter_mut().zip(&moment.state.joint_torques) {
                *most = most.max(torque.abs());
            }
            let sample = self.sample(time, commands.both(), &moment, draws);
            commands.after(&sample, time + tick);
            samples.push(sample);
        }
        let place = Vector2::from(self.wanted.place_mm) * 1e-3;
        Ok(Bored {
            mode,
            samples,
            miss: hole.mouth.map(|mouth| mouth - place),
            touch: commands.touch,
            unreached: commands.unreached,
            overloaded: self.model.setup.robot.overloaded(&borne),
        })
    }

    fn sample(&self, time: f64, command: Command, moment: &Moment, draws: &[Draws]) -> Sample {
        let sense = |arm: &Arm, draws: &Draws| {
            let (spec, state) = (self.spec, &moment.state);
            read(spec, &command, state, arm.target, &self.noise, draws).wrench
        };
        let (board, tool) = (sense(&self.board, &draws[0]), sense(&self.tool, &draws[1]));
        let targets = [self.board.target, self.tool.target];
        let link = |target: usize| moment.state.base_from_link[target];
        let seen = |target: usize| {
            self.spec.base_from_tracker.inverse() * link(target) * self.spec.targets[target].1
        };
        Sample {
            time,
            joints: command.joints,
            depth: moment.geometry.depth,
            need: moment.need,
            lateral: moment.lateral,
            tilt: moment.geometry.tilt(),
            board,
            tool,
            links: targets.map(link),
            seen: targets.map(seen),
        }
    }
}

/// Readings of both wrist sensors as a campaign, to be recorded: by turns the board's and the drill's, half a tick apart.
pub fn recorded(scenario: &Scenario, wanted: &Drilling, hole: &Bored) -> crate::campaign::Campaign {
    let target = |name: &str| {
        let found = scenario.setup.targets.iter().position(|t| t.name == *name);
        found.unwrap_or(0)
    };
    let targets = [target(&wanted.board), target(&wanted.tool)];
    let mut readings = Vec::with_capacity(2 * hole.samples.len());
    for sample in &hole.samples {
        for (which, wrench) in [sample.board, sample.tool].into_iter().enumerate() {
            let pose = &sample.seen[which];
            readings.push(Reading {
                // the header of the table is line 1
                line: readings.len() + 2,
                time: Some(sample.time + which as f64 * 0.5 / wanted.rate_hz),
                wrench: Some(wrench),
                ..arms::task(targets[which], pose, sample.joints.clone())
            });
        }
    }
    crate::campaign::Campaign {
        noise: None,
        ..simulate::campaign(scenario, readings)
    }
}
