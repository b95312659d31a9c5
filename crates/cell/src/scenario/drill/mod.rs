//! Two arms drill: one holds a board, the other drills it, both give way.
//!
//! Each tick the plant is at rest under the commands and the wrench of that moment: MuJoCo's static states, no inertia, no
//! vibration. Thrust and torque are those of the feed that is left when both arms have given way (`cutting.rs`,
//! `contact.rs`). Both wrist sensors are read with their noise. The commands are those of the nominal robot, or corrected by
//! a fitted model for geometry and tools, or corrected besides, in the loop, for what the sensors feel.
//!
//! Source: Appl. Sci. 2019, 9, 65, sec. 5 and Fig. 6, 10 and 11.

pub mod contact;
pub mod cutting;
mod spec;
pub mod summary;

pub use spec::{Drilling, LayerEntry, Mode};

use super::compensated::learn;
use super::control_loop::Tool;
use super::design::{DesignLoad, stream};
use super::{Scenario, ScenarioError, simulate};
use crate::campaign::{Payload, Reading, Wrench};
use crate::compensation::controller::Controller;
use crate::compensation::filter::Law;
use crate::compensation::{End, Reach, Robot, posture, solve};
use crate::effects::Role;
use crate::model::{Model, Workspace};
use crate::plant::instruments::{Draws, read};
use crate::plant::{Command, Plant, PlantError, PlantSpec};
use crate::space::{Space, generator};
use contact::{Contact, Hole};
use cutting::Need;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
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
    let of_plant = |source: PlantError| ScenarioError::Plant {
        file: scenario.file.clone(),
        source,
    };
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

/// One arm: what it is to do.
struct Arm {
    target: usize,
    reach: Reach,
    load: DesignLoad,
    /// Pose in the tracker's frame at depth zero, and the posture found for it.
    task: Reading,
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
        let form = |message: String| ScenarioError::Form {
            file: scenario.file.clone(),
            message,
        };
        let target = |name: &str| setup.targets.iter().position(|t| t.name == *name);
        let (Some(board), Some(tool)) = (target(&wanted.board), target(&wanted.tool)) else {
            return Err(form("[drill] board and tool must be targets".to_owned()));
        };
        let chains = [board, tool].map(|target| setup.robot.chain(setup.target_body(target)));
        let shared: Vec<usize> = chains[0]
            .iter()
            .copied()
            .filter(|joint| chains[1].contains(joint))
            .collect();
        // Thrust on one arm is taken back by the other: a joint below both bears none of it. A model that sees one
        // arm's load alone would turn it.
        let mut values = values.to_vec();
        if let Some(term) = model.term_of(Role::Spring) {
            for index in shared.iter().filter_map(|&joint| term.of_joint(joint)) {
                values[index] = 0.0;
            }
        }
        let robot = Robot::new(model, &values);
        let tracker_from_base = robot.base_from_tracker().inverse();
        let feed = Vector3::from(wanted.feed).normalize();
        let up = -setup.gravity;
        let hole = Vector3::from(wanted.hole_m);
        let base_from_tool = Isometry3::from_parts(
            Translation3::from(hole),
            facing(&feed, &up, wanted.tool_turn_deg.to_radians()),
        );
        let turn = facing(&-feed, &up, wanted.board_turn_deg.to_radians());
        let place = Vector3::new(wanted.place_mm[0], wanted.place_mm[1], 0.0) * 1e-3;
        let base_from_board = Isometry3::from_parts(Translation3::from(hole - turn * place), turn);
        let mut random = generator(scenario.seed, stream::DRILL);
        let mut arm = |target: usize, tool: &Tool, pose: &Isometry3<f64>, word: &str| {
            let load = DesignLoad {
                mass: tool.mass_kg,
                com: Vector3::from(tool.com_m),
                pull: Vector3::zeros(),
            };
            let mut space = scenario.design.space.clone();
            space.least_height = f64::NEG_INFINITY;
            for &joint in &shared {
                let (least, most) = space.ranges[joint];
                let still = 0.0_f64.clamp(least, most);
                space.ranges[joint] = (still, still);
            }
            let chain = setup.robot.chain(setup.target_body(target));
            let reach = Reach {
                moving: chain.into_iter().filter(|j| !shared.contains(j)).collect(),
                ranges: Space::within_limits(&setup.robot, 0.0).ranges,
            };
            let joints: Vec<f64> = space.ranges.iter().map(|(a, b)| (a + b) / 2.0).collect();
            let mut task = task(target, &(tracker_from_base * pose), joints, &load);
            let mut workspace = Workspace::new(setup);
            let inside = Reach {
                ranges: space.ranges.clone(),
                ..reach.clone()
            };
            task.joints = posture(
                &mut workspace,
                &robot,
                &task,
                (&space, &inside),
                &mut random,
            );
            let near = (&task.joints[..], &task.joints[..]);
            let found = solve(&mut workspace, model, &robot.nominal, &task, near, &inside);
            if found.end != End::Reached {
                return Err(form(format!(
                    "[drill] no posture of {} brings the {word} to hole_m = {:?}; accepted: a place, feed, \
                     board_turn_deg and tool_turn_deg that the arm reaches within [design] margin",
                    setup.targets[target].name, wanted.hole_m
                )));
            }
            task.joints = found.joints;
            Ok(Arm {
                target,
                reach,
                load,
                task,
            })
        };
        let board = arm(board, &wanted.board_load, &base_from_board, "board")?;
        let tool = arm(tool, &wanted.tool_load, &base_from_tool, "drill")?;
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
            feed: tracker_from_base.rotation * feed,
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
        let joints = self.together(board, tool);
        Command {
            approach: vec![1.0; joints.len()],
            joints,
            loads: vec![
                self.board.load.on(self.board.target),
                self.tool.load.on(self.tool.target),
            ],
            time: 0.0,
            temperature: 0.0,
        }
    }

    /// Pose of the drill's task with the tip so far along the feed, tracker's frame, m.
    fn along(&self, feed: f64) -> Vector3<f64> {
        self.tool.task.position + self.feed * feed
    }

    fn bore(&self, plant: &mut Plant, mode: Mode) -> Result<Bored, PlantError> {
        let unreached = std::cell::Cell::new(0);
        let mut workspace = Workspace::new(&self.model.setup);
        let p = match mode {
            Mode::Nominal => &self.robot.nominal,
            _ => &self.robot.values,
        };
        let mut find = |arm: &Arm, start: &[f64], feed: Option<f64>| -> Vec<f64> {
            let mut task = arm.task.clone();
            if let Some(feed) = feed {
                task.position = self.along(feed);
            }
            let near = (start, &arm.task.joints[..]);
            let found = solve(&mut workspace, self.model, p, &task, near, &arm.reach);
            if found.end != End::Reached {
                unreached.set(unreached.get() + 1);
                return start.to_vec();
            }
            found.joints
        };
        let mut board = find(&self.board, &self.board.task.joints, None);
        let mut tool = find(&self.tool, &self.tool.task.joints, Some(0.0));
        let (drill, layers) = (self.wanted.drill(), self.wanted.layers());
        let tick = 1.0 / self.wanted.rate_hz;
        let contact = Contact::new(
            self.spec,
            (self.board.target, self.tool.target),
            (&drill, &layers),
            tick,
            plant,
            &self.command(&board, &tool),
        )?;
        // the feed begins where the tip touches, as an operator would set it
        let mut touch = 0.0;
        for _ in 0..3 {
            tool = find(&self.tool, &tool, Some(touch));
            let state = plant.state(&self.command(&board, &tool))?;
            touch -= contact.geometry(&state).depth;
        }
        let mut controllers = (mode == Mode::Loop).then(|| {
            [(&self.board, &board), (&self.tool, &tool)].map(|(arm, start)| {
                let near = (&start[..], &arm.task.joints[..]);
                let (law, reach) = (self.law.clone(), &arm.reach);
                Controller::new(self.model, &self.values, &arm.task, near, reach, law)
            })
        });
        let mut hole = Hole::default();
        let mut samples = Vec::with_capacity(self.draws.len() / 2);
        let mut borne = vec![0.0_f64; self.model.setup.robot.joints.len()];
        for (index, draws) in self.draws.chunks(2).enumerate() {
            let time = index as f64 * tick;
            let feed_at = |time: f64| {
                let feed = self.wanted.feed_rate() * (time - self.wanted.approach_s);
                touch + feed.min(self.wanted.depth())
            };
            if controllers.is_none() || index == 0 {
                tool = find(&self.tool, &tool, Some(feed_at(time)));
            }
            let command = self.command(&board, &tool);
            let moment = contact.advance(plant, &command, &mut hole)?;
            for (most, torque) in borne.iter_mut().zip(&moment.state.joint_torques) {
                *most = most.max(torque.abs());
            }
            let sense = |arm: &Arm, draws: &Draws| {
                read(
                    self.spec,
                    &command,
                    &moment.state,
                    arm.target,
                    &self.noise,
                    draws,
                )
                .wrench
            };
            let (on_board, on_tool) = (sense(&self.board, &draws[0]), sense(&self.tool, &draws[1]));
            let targets = [self.board.target, self.tool.target];
            let link = |target: usize| moment.state.base_from_link[target];
            let seen = |target: usize| {
                self.spec.base_from_tracker.inverse() * link(target) * self.spec.targets[target].1
            };
            samples.push(Sample {
                time,
                joints: command.joints,
                depth: moment.geometry.depth,
                need: moment.need,
                lateral: moment.lateral,
                tilt: moment.geometry.tilt(),
                board: on_board,
                tool: on_tool,
                links: targets.map(link),
                seen: targets.map(seen),
            });
            if let Some([of_board, of_tool]) = &mut controllers {
                let next = of_board.tick(&on_board);
                unreached.set(unreached.get() + usize::from(!next.found));
                board = next.command;
                of_tool.aim(self.along(feed_at(time + tick)));
                let next = of_tool.tick(&on_tool);
                unreached.set(unreached.get() + usize::from(!next.found));
                tool = next.command;
            }
        }
        let place = Vector2::from(self.wanted.place_mm) * 1e-3;
        Ok(Bored {
            mode,
            samples,
            miss: hole.mouth.map(|mouth| mouth - place),
            touch,
            unreached: unreached.get(),
            overloaded: self.model.setup.robot.overloaded(&borne),
        })
    }
}

/// A task at a pose in the tracker's frame.
fn task(target: usize, pose: &Isometry3<f64>, joints: Vec<f64>, load: &DesignLoad) -> Reading {
    Reading {
        position: pose.translation.vector,
        orientation: Some(pose.rotation),
        payload: Some(Payload {
            mass: load.mass,
            com: load.com,
        }),
        ..Reading::to_be(target, joints)
    }
}

/// The rotation whose z axis points along `z`, and whose x axis points up as far as that allows, then turned about z by
/// an angle, rad.
fn facing(z: &Vector3<f64>, up: &Vector3<f64>, turn: f64) -> UnitQuaternion<f64> {
    let up = match up.cross(z).norm() > 1e-6 * up.norm() {
        true => *up,
        // along gravity there is no up: the base's x axis serves
        false => Vector3::x(),
    };
    let y = z.cross(&up).normalize();
    let x = y.cross(z);
    let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, *z]));
    let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn);
    UnitQuaternion::from_rotation_matrix(&rotation) * about
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
            let load = DesignLoad {
                mass: 0.0,
                com: Vector3::zeros(),
                pull: Vector3::zeros(),
            };
            readings.push(Reading {
                // the header of the table is line 1
                line: readings.len() + 2,
                time: Some(sample.time + which as f64 * 0.5 / wanted.rate_hz),
                wrench: Some(wrench),
                payload: None,
                ..task(targets[which], pose, sample.joints.clone(), &load)
            });
        }
    }
    crate::campaign::Campaign {
        noise: None,
        ..simulate::campaign(scenario, readings)
    }
}
