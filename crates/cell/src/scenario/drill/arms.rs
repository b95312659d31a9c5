//! The two arms before they drill: where board and drill are to be, and the postures that bring them there.

use super::Drilling;
use crate::campaign::Reading;
use crate::compensation::{End, Reach, Robot, posture, solve};
use crate::effects::Role;
use crate::model::{Model, Workspace};
use crate::scenario::design::DesignLoad;
use crate::scenario::{Scenario, ScenarioError, Tool};
use crate::setup::Setup;
use crate::space::Space;
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::Rng;

/// One arm: what it is to do.
pub(super) struct Arm {
    pub(super) target: usize,
    pub(super) reach: Reach,
    pub(super) load: DesignLoad,
    /// Pose in the tracker's frame at depth zero, and the posture found for it.
    pub(super) task: Reading,
}

/// Joints that both targets hang on.
pub(super) fn shared_joints(setup: &Setup, targets: [usize; 2]) -> Vec<usize> {
    let [mut first, second] = targets.map(|target| setup.robot.chain(setup.target_body(target)));
    first.retain(|joint| second.contains(joint));
    first
}

/// A model's parameters without the compliance of shared joints. Thrust on one arm is taken back by the other: a joint
/// below both bears none of it. A model that sees one arm's load alone would turn it.
pub(super) fn values_under_thrust(model: &Model, values: &[f64], shared: &[usize]) -> Vec<f64> {
    let mut values = values.to_vec();
    if let Some(term) = model.term_of(Role::Spring) {
        for index in shared.iter().filter_map(|&joint| term.of_joint(joint)) {
            values[index] = 0.0;
        }
    }
    values
}

/// Poses of board and drill at depth zero, base frame.
pub(super) fn poses(wanted: &Drilling, up: &Vector3<f64>) -> [Isometry3<f64>; 2] {
    let feed = Vector3::from(wanted.feed).normalize();
    let hole = Vector3::from(wanted.hole_m);
    let base_from_tool = Isometry3::from_parts(
        Translation3::from(hole),
        facing(&feed, up, wanted.tool_turn_deg.to_radians()),
    );
    let turn = facing(&-feed, up, wanted.board_turn_deg.to_radians());
    let place = Vector3::new(wanted.place_mm[0], wanted.place_mm[1], 0.0) * 1e-3;
    let base_from_board = Isometry3::from_parts(Translation3::from(hole - turn * place), turn);
    [base_from_board, base_from_tool]
}

/// Where the arms stand.
pub(super) struct Stand<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) wanted: &'a Drilling,
    pub(super) robot: &'a Robot<'a>,
    /// Joints that both arms hang on: they stay at zero.
    pub(super) shared: &'a [usize],
}

impl Stand<'_> {
    /// An arm with a posture that brings its target to a pose, base frame; `name` is what it holds, for messages.
    pub(super) fn arm(
        &self,
        (target, tool, name): (usize, &Tool, &str),
        base_from_target: &Isometry3<f64>,
        random: &mut impl Rng,
    ) -> Result<Arm, ScenarioError> {
        let (robot, setup) = (self.robot, &self.scenario.setup);
        let mut space = self.scenario.design.space.clone();
        space.least_height = f64::NEG_INFINITY;
        for &joint in self.shared {
            let (least, most) = space.ranges[joint];
            let still = 0.0_f64.clamp(least, most);
            space.ranges[joint] = (still, still);
        }
        let mut moving = setup.robot.chain(setup.target_body(target));
        moving.retain(|joint| !self.shared.contains(joint));
        let reach = Reach {
            moving,
            ranges: Space::within_limits(&setup.robot, 0.0).ranges,
        };
        let inside = Reach {
            ranges: space.ranges.clone(),
            ..reach.clone()
        };
        let load = tool.load();
        let joints: Vec<f64> = space.ranges.iter().map(|(a, b)| (a + b) / 2.0).collect();
        let tracker_from_target = robot.base_from_tracker().inverse() * base_from_target;
        let mut task = Reading {
            payload: Some(load.payload()),
            ..task(target, &tracker_from_target, joints)
        };
        let mut workspace = Workspace::new(setup);
        task.joints = posture(&mut workspace, robot, &task, (&space, &inside), random);
        let near = (&task.joints[..], &task.joints[..]);
        let (model, nominal) = (robot.model, &robot.nominal);
        let found = solve(&mut workspace, model, nominal, &task, near, &inside);
        if found.end != End::Reached {
            return Err(self.scenario.form_error(format!(
                "[drill] no posture of {} brings the {name} to hole_m = {:?}; accepted: a place, feed, \
                 board_turn_deg and tool_turn_deg that the arm reaches within [design] margin",
                setup.targets[target].name, self.wanted.hole_m
            )));
        }
        task.joints = found.joints;
        Ok(Arm {
            target,
            reach,
            load,
            task,
        })
    }
}

/// A task at a pose in the tracker's frame.
pub(super) fn task(target: usize, pose: &Isometry3<f64>, joints: Vec<f64>) -> Reading {
    Reading {
        position: pose.translation.vector,
        orientation: Some(pose.rotation),
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
