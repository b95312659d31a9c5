//! Commands of both arms during a hole: solved along the feed, or by controllers from what the sensors feel.

use super::arms::Arm;
use super::contact::Contact;
use super::{Cell, Mode, Sample};
use crate::compensation::controller::Controller;
use crate::compensation::{End, solve};
use crate::model::Workspace;
use crate::plant::{Command, Plant, PlantError};

/// Commands in force.
pub(super) struct Commands<'c> {
    cell: &'c Cell<'c>,
    /// Parameters that commands are solved with.
    values: &'c [f64],
    workspace: Workspace,
    board: Vec<f64>,
    tool: Vec<f64>,
    /// Those of the loop; made when the tip touches.
    controllers: Option<[Controller<'c>; 2]>,
    mode: Mode,
    /// How far the command had to be moved along the feed to touch the board, m.
    pub(super) touch: f64,
    /// Commands not found: the one before stands.
    pub(super) unreached: usize,
}

impl<'c> Commands<'c> {
    pub(super) fn new(cell: &'c Cell<'c>, mode: Mode) -> Self {
        let mut commands = Self {
            cell,
            values: match mode {
                Mode::Nominal => &cell.robot.nominal,
                _ => &cell.robot.values,
            },
            workspace: Workspace::new(&cell.model.setup),
            board: cell.board.task.joints.clone(),
            tool: cell.tool.task.joints.clone(),
            controllers: None,
            mode,
            touch: 0.0,
            unreached: 0,
        };
        let start = commands.board.clone();
        commands.board = commands.find(&cell.board, &start, None);
        commands.feed(0.0);
        commands
    }

    /// Both as one command.
    pub(super) fn both(&self) -> Command {
        self.cell.command(&self.board, &self.tool)
    }

    /// The command for an arm's task, of the drill's with the tip so far along the feed, m.
    fn find(&mut self, arm: &Arm, start: &[f64], feed: Option<f64>) -> Vec<f64> {
        let mut task = arm.task.clone();
        if let Some(feed) = feed {
            task.position = self.cell.along(feed);
        }
        let near = (start, &arm.task.joints[..]);
        let (workspace, model) = (&mut self.workspace, self.cell.model);
        let found = solve(workspace, model, self.values, &task, near, &arm.reach);
        if found.end == End::Reached {
            return found.joints;
        }
        self.unreached += 1;
        start.to_vec()
    }

    fn feed(&mut self, feed: f64) {
        let start = std::mem::take(&mut self.tool);
        self.tool = self.find(&self.cell.tool, &start, Some(feed));
    }

    /// Begins the feed where the tip touches, as an operator would set it.
    pub(super) fn touch(
        &mut self,
        plant: &mut Plant,
        contact: &Contact<'_>,
    ) -> Result<(), PlantError> {
        for _ in 0..3 {
            self.feed(self.touch);
            let state = plant.state(&self.both())?;
            self.touch -= contact.geometry(&state).depth;
        }
        Ok(())
    }

    fn feed_at(&self, time: f64) -> f64 {
        let wanted = self.cell.wanted;
        let feed = wanted.feed_rate() * (time - wanted.approach_s);
        self.touch + feed.min(wanted.depth())
    }

    /// Moves the drill to where it is to be at a time, s; in the loop its controller has done so.
    pub(super) fn before(&mut self, time: f64) {
        if self.controllers.is_some() {
            return;
        }
        if self.mode == Mode::Loop {
            let cell = self.cell;
            let arms = [(&cell.board, &self.board), (&cell.tool, &self.tool)];
            self.controllers = Some(arms.map(|(arm, start)| {
                let near = (&start[..], &arm.task.joints[..]);
                let (law, reach) = (cell.law.clone(), &arm.reach);
                Controller::new(cell.model, &cell.values, &arm.task, near, reach, law)
            }));
        }
        self.feed(self.feed_at(time));
    }

    /// Corrects for what the sensors feel, for a time, s, if the controllers do.
    pub(super) fn after(&mut self, sample: &Sample, time: f64) {
        let along = self.cell.along(self.feed_at(time));
        if let Some([of_board, of_tool]) = &mut self.controllers {
            of_tool.aim(along);
            let (board, tool) = (of_board.tick(&sample.board), of_tool.tick(&sample.tool));
            self.unreached += usize::from(!board.found) + usize::from(!tool.found);
            (self.board, self.tool) = (board.command, tool.command);
        }
    }
}
