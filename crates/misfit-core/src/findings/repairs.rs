//! Single mistakes that people make in tables, each with the repair that takes it back.

use super::table::{Table, turns};
use crate::campaign::{Campaign, Frame};
use crate::robot::Robot;
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

/// One repair of a table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Repair {
    /// Positions are in this unit, not in that of their header.
    PositionUnit(&'static str, f64),
    /// Angles of all joints that turn (or of one) are in this unit.
    JointUnit(Option<usize>, &'static str, f64),
    /// Positions of joints that slide are in this unit.
    SlideUnit(&'static str, f64),
    /// A joint counts the other way, or all do.
    Sign(Option<usize>),
    /// Two columns of joints are exchanged.
    JointsSwapped(usize, usize),
    /// Coordinates stand in this order.
    Axes([usize; 3]),
    /// A coordinate counts the other way.
    Mirrored(usize),
    /// The zero of a joint that turns is off by this, rad.
    Zero(usize, f64),
    /// A joint is measured against the one before: its angle and that of the other, times this sign.
    Coupled(usize, usize, f64),
    /// Joints belong to the positions so many rows below.
    Shifted(isize),
    /// A target sits on another body.
    OtherBody(usize, usize),
    /// Names of two targets are exchanged.
    TargetsSwapped(usize, usize),
    /// The quaternion's numbers stand in this order: index of the column that holds w, x, y, z.
    QuaternionOrder([usize; 4], &'static str),
    /// Orientations are those of the tracker as the target sees it.
    QuaternionInverse,
    /// The known frame of the tracker is that of the base in the tracker's frame.
    TrackerInverse,
    /// The known frame of the tracker is wrong.
    TrackerUnknown,
}

/// Units of positions and what they are in the unit m; the first that explains is named.
const LENGTHS: [(&str, f64); 5] = [
    ("mm", 1e-3),
    ("in", 0.0254),
    ("cm", 1e-2),
    ("um", 1e-6),
    ("ft", 0.3048),
];

/// All repairs that a table of this robot could need, the likely ones first.
pub fn catalogue(robot: &Robot, table: &Table) -> Vec<Repair> {
    let moving = table.moving(robot);
    let turning: Vec<usize> = moving
        .iter()
        .copied()
        .filter(|&j| turns(robot, j))
        .collect();
    let sliding = moving.len() > turning.len();
    let mut all = Vec::new();
    for (unit, size) in LENGTHS {
        all.push(Repair::PositionUnit(unit, size));
        // the header says this unit, the numbers are m
        all.push(Repair::PositionUnit("m", size.recip()));
    }
    let angles = [("deg", PI / 180.0), ("rad", 180.0 / PI)];
    for (unit, size) in angles {
        all.push(Repair::JointUnit(None, unit, size));
    }
    if sliding {
        all.extend([("mm", 1e-3), ("m", 1e3)].map(|(unit, size)| Repair::SlideUnit(unit, size)));
    }
    all.extend(moving.iter().map(|&joint| Repair::Sign(Some(joint))));
    all.push(Repair::Sign(None));
    for (place, &a) in moving.iter().enumerate() {
        let others = moving[place + 1..].iter();
        all.extend(others.map(|&b| Repair::JointsSwapped(a, b)));
    }
    all.extend([[1, 0, 2], [2, 1, 0], [0, 2, 1], [1, 2, 0], [2, 0, 1]].map(Repair::Axes));
    all.extend([0, 1, 2].map(Repair::Mirrored));
    for &joint in &turning {
        all.extend([FRAC_PI_2, -FRAC_PI_2, PI].map(|zero| Repair::Zero(joint, zero)));
    }
    for pair in turning.windows(2).skip(1).take(1) {
        all.extend([1.0, -1.0].map(|sign| Repair::Coupled(pair[1], pair[0], sign)));
    }
    all.extend([1, -1].map(Repair::Shifted));
    for (target, &body) in table.bodies.iter().enumerate() {
        let others = (1..robot.bodies.len()).filter(|&other| other != body);
        all.extend(others.map(|other| Repair::OtherBody(target, other)));
        let others = target + 1..table.bodies.len();
        all.extend(others.map(|other| Repair::TargetsSwapped(target, other)));
    }
    if table.orientations.iter().any(Option::is_some) {
        all.push(Repair::QuaternionOrder([3, 0, 1, 2], "xyzw"));
        all.push(Repair::QuaternionOrder([1, 2, 3, 0], "wxyz"));
        all.push(Repair::QuaternionInverse);
    }
    for &joint in &turning {
        all.extend(angles.map(|(unit, size)| Repair::JointUnit(Some(joint), unit, size)));
    }
    if table.tracker != Frame::Estimate {
        all.extend([Repair::TrackerInverse, Repair::TrackerUnknown]);
    }
    all
}

impl Repair {
    /// The table as it would be without the mistake.
    pub fn apply(self, robot: &Robot, table: &Table) -> Table {
        let mut table = table.clone();
        let joints = |table: &mut Table, change: &dyn Fn(&mut Vec<f64>)| {
            table.joints.iter_mut().for_each(change);
        };
        let positions = |table: &mut Table, change: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            table.positions.iter_mut().for_each(|p| *p = change(p));
        };
        let turn = |table: &mut Table, change: &dyn Fn(&UnitQuaternion<f64>) -> _| {
            let seen = table.orientations.iter_mut().flatten();
            seen.for_each(|q: &mut UnitQuaternion<f64>| *q = change(q));
        };
        match self {
            Self::PositionUnit(_, size) => positions(&mut table, &|p| p * size),
            Self::JointUnit(Some(joint), _, size) => joints(&mut table, &|q| q[joint] *= size),
            Self::JointUnit(None, _, size) => joints(&mut table, &|q| {
                let all = q.iter_mut().enumerate();
                all.filter(|(joint, _)| turns(robot, *joint))
                    .for_each(|(_, q)| *q *= size);
            }),
            Self::SlideUnit(_, size) => joints(&mut table, &|q| {
                let all = q.iter_mut().enumerate();
                all.filter(|(joint, _)| !turns(robot, *joint))
                    .for_each(|(_, q)| *q *= size);
            }),
            Self::Sign(Some(joint)) => joints(&mut table, &|q| q[joint] = -q[joint]),
            Self::Sign(None) => joints(&mut table, &|q| q.iter_mut().for_each(|q| *q = -*q)),
            Self::JointsSwapped(a, b) => joints(&mut table, &|q| q.swap(a, b)),
            Self::Axes([x, y, z]) => {
                positions(&mut table, &|p| Vector3::new(p[x], p[y], p[z]));
            }
            Self::Mirrored(axis) => positions(&mut table, &|p| {
                let mut mirrored = *p;
                mirrored[axis] = -p[axis];
                mirrored
            }),
            Self::Zero(joint, zero) => joints(&mut table, &|q| q[joint] += zero),
            Self::Coupled(joint, before, sign) => {
                joints(&mut table, &|q| q[joint] += sign * q[before]);
            }
            Self::Shifted(rows) => table = shifted(&table, rows),
            Self::OtherBody(target, body) => {
                table.bodies[target] = body;
                table.offsets[target] = Frame::Estimate;
            }
            Self::TargetsSwapped(a, b) => table.bodies.swap(a, b),
            Self::QuaternionOrder(order, _) => turn(&mut table, &|q| reordered(q, order)),
            Self::QuaternionInverse => turn(&mut table, &|q| q.inverse()),
            Self::TrackerInverse => {
                if let Frame::Known(pose) = table.tracker {
                    table.tracker = Frame::Known(pose.inverse());
                }
            }
            Self::TrackerUnknown => table.tracker = Frame::Estimate,
        }
        table
    }

    /// Must neighbouring rows stay neighbours for it?
    pub fn needs_order(self) -> bool {
        matches!(self, Self::Shifted(_))
    }

    /// What is wrong, as one clause.
    pub fn what(self, campaign: &Campaign) -> String {
        let name = |joint: usize| campaign.robot.joints[joint].name.as_str();
        match self {
            Self::PositionUnit(unit, size) => {
                format!(
                    "the positions are in {unit}, but read as {}",
                    stated(unit, size)
                )
            }
            Self::JointUnit(joint, unit, _) => {
                let stated = if unit == "deg" { "rad" } else { "deg" };
                let whose = joint.map_or("the joints".to_owned(), |j| format!("joint {}", name(j)));
                format!("the angles of {whose} are in {unit}, but read as {stated}")
            }
            Self::SlideUnit(unit, _) => {
                let stated = if unit == "mm" { "m" } else { "mm" };
                format!("the joints that slide are in {unit}, but read as {stated}")
            }
            Self::Sign(Some(joint)) => format!(
                "joint {} counts the other way than the robot file says",
                name(joint)
            ),
            Self::Sign(None) => "all joints count the other way than the robot file says".into(),
            Self::JointsSwapped(a, b) => {
                format!(
                    "the columns of joints {} and {} are exchanged",
                    name(a),
                    name(b)
                )
            }
            Self::Axes(order) => match swapped(order) {
                Some((a, b)) => format!("the columns of {} and {} are exchanged", axis(a), axis(b)),
                None => {
                    let order = order.map(axis);
                    format!("the columns x y z hold other axes: x is in {}", order[0])
                }
            },
            Self::Mirrored(k) => {
                format!(
                    "{} counts the other way: the tracker's axes are left-handed",
                    axis(k)
                )
            }
            Self::Zero(joint, zero) => format!(
                "the zero of joint {} is {:+.0}° from that of the robot file",
                name(joint),
                zero.to_degrees()
            ),
            Self::Coupled(joint, before, sign) => format!(
                "joint {} is not counted from the link before: its angle {} that of {} is (a parallelogram)",
                name(joint),
                if sign > 0.0 { "plus" } else { "minus" },
                name(before)
            ),
            Self::Shifted(rows) => format!(
                "joints and positions are out of step by one row: joints belong to the positions of the row {}",
                if rows > 0 { "below" } else { "above" }
            ),
            Self::OtherBody(target, body) => format!(
                "the target {} does not sit on link {}, but on {}",
                campaign.targets[target].name,
                campaign.robot.links[campaign.targets[target].link].name,
                campaign.robot.bodies[body].name
            ),
            Self::TargetsSwapped(a, b) => format!(
                "the names of the targets {} and {} are exchanged",
                campaign.targets[a].name, campaign.targets[b].name
            ),
            Self::QuaternionOrder(_, order) => {
                format!("the numbers of the quaternions stand in the order {order}")
            }
            Self::QuaternionInverse => {
                "the orientations are inverse: of the tracker as the target sees it".into()
            }
            Self::TrackerInverse => {
                "base_from_tracker is inverse: of the base in the tracker's frame".into()
            }
            Self::TrackerUnknown => "base_from_tracker does not agree with the readings".into(),
        }
    }

    /// What to change, as lines of the campaign file or words of the header.
    #[expect(
        clippy::too_many_lines,
        reason = "one procedure, still to be split by its steps"
    )]
    pub fn remedy(self, campaign: &Campaign) -> String {
        let robot = &campaign.robot;
        let name = |joint: usize| robot.joints[joint].name.as_str();
        let column = |joint: usize| {
            let unit = if turns(robot, joint) { "rad" } else { "m" };
            format!("{}_{unit}", name(joint))
        };
        match self {
            Self::PositionUnit(unit, size) => {
                let words = ['x', 'y', 'z'].map(|k| format!("\"{k}_{}\"", stated(unit, size)));
                let words = words.join(", ");
                in_columns(&format!(
                    "position = {{ columns = [{words}], unit = \"{unit}\" }}"
                ))
            }
            Self::JointUnit(joint, unit, _) => {
                let read = if unit == "deg" { "rad" } else { "deg" };
                let wanted = |j: usize| turns(robot, j) && joint.is_none_or(|own| own == j);
                each_joint(robot, wanted, read, &format!(", unit = \"{unit}\""))
            }
            Self::SlideUnit(unit, _) => {
                let read = if unit == "mm" { "m" } else { "mm" };
                each_joint(
                    robot,
                    |j| !turns(robot, j),
                    read,
                    &format!(", unit = \"{unit}\""),
                )
            }
            Self::Sign(joint) => {
                let unit = joint.map_or("rad", |j| if turns(robot, j) { "rad" } else { "m" });
                let wanted = |j: usize| joint.is_none_or(|own| own == j);
                each_joint(robot, wanted, unit, ", sign = -1")
            }
            Self::JointsSwapped(a, b) => in_columns(&format!(
                "{} = {{ column = \"{}\" }}; {} = {{ column = \"{}\" }}",
                name(a),
                column(b),
                name(b),
                column(a)
            )),
            Self::Axes(order) => {
                let words = order.map(|k| format!("\"{}_m\"", axis(k)));
                in_columns(&format!(
                    "position = {{ columns = [{}], unit = \"m\" }}",
                    words.join(", ")
                ))
            }
            Self::Mirrored(k) => format!(
                "change the sign of the column {}_m, or export the positions in right-handed axes",
                axis(k)
            ),
            Self::Zero(joint, zero) => in_columns(&format!(
                "{} = {{ column = \"{}\", unit = \"rad\", offset = {zero:.6} }}",
                name(joint),
                column(joint)
            )),
            Self::Coupled(joint, before, sign) => format!(
                "write {} {} {} into the column {}: the angle between the two links",
                name(joint),
                if sign > 0.0 { "+" } else { "-" },
                name(before),
                column(joint)
            ),
            Self::Shifted(_) => {
                "pair each position with the joints of its own row, and write the table again"
                    .into()
            }
            Self::OtherBody(target, body) => format!(
                "in the campaign file: [[target]] name = \"{}\", link = \"{}\"",
                campaign.targets[target].name, robot.bodies[body].name
            ),
            Self::TargetsSwapped(a, b) => format!(
                "in the campaign file exchange `link` of the targets {} and {}",
                campaign.targets[a].name, campaign.targets[b].name
            ),
            Self::QuaternionOrder(_, order) => in_columns(&format!(
                "orientation = {{ columns = [\"qw\", \"qx\", \"qy\", \"qz\"], convention = \"quaternion:{order}\" }}"
            )),
            Self::QuaternionInverse => {
                "change the signs of qx, qy and qz, or export tracker_from_target".into()
            }
            Self::TrackerInverse | Self::TrackerUnknown => {
                "in the campaign file: [frames] base_from_tracker = \"estimate\"".into()
            }
        }
    }
}

/// A line of `[columns]` for each joint that is wanted: its column in the unit `read`, and the rest.
fn each_joint(robot: &Robot, wanted: impl Fn(usize) -> bool, read: &str, rest: &str) -> String {
    let joints = robot.joints.iter().enumerate().filter(|(j, _)| wanted(*j));
    let lines =
        joints.map(|(_, joint)| format!("{0} = {{ column = \"{0}_{read}\"{rest} }}", joint.name));
    in_columns(&lines.collect::<Vec<_>>().join("; "))
}

/// The unit that positions were read in, where they are in `unit`.
fn stated(unit: &str, size: f64) -> &'static str {
    let is = |(_, known): &&(&str, f64)| unit == "m" && (known * size - 1.0).abs() < 1e-9;
    LENGTHS.iter().find(is).map_or("m", |(unit, _)| unit)
}

fn in_columns(line: &str) -> String {
    format!("in the campaign file, under [columns] (with the table's own header words): {line}")
}

fn axis(index: usize) -> char {
    ['x', 'y', 'z'][index]
}

/// The two axes that an order exchanges, if it exchanges two.
fn swapped(order: [usize; 3]) -> Option<(usize, usize)> {
    let moved: Vec<usize> = (0..3).filter(|&k| order[k] != k).collect();
    (moved.len() == 2).then(|| (moved[0], moved[1]))
}

/// A quaternion whose w, x, y, z stand in these columns of w, x, y, z.
fn reordered(q: &UnitQuaternion<f64>, order: [usize; 4]) -> UnitQuaternion<f64> {
    let columns = [q.w, q.i, q.j, q.k];
    let [w, x, y, z] = order.map(|column| columns[column]);
    UnitQuaternion::new_unchecked(Quaternion::new(w, x, y, z))
}

/// Joints of each row with the position so many rows below.
fn shifted(table: &Table, rows: isize) -> Table {
    let count = table.len();
    let by = rows.unsigned_abs().min(count);
    let (of_joints, of_positions) = match rows > 0 {
        true => (0..count - by, by..count),
        false => (by..count, 0..count - by),
    };
    let of_positions: Vec<usize> = of_positions.collect();
    let mut shifted = table.select(&of_positions);
    shifted.joints = table.joints[of_joints].to_vec();
    shifted
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let row = |k: u8| f64::from(k);
        Table {
            joints: (0..4).map(|k| vec![row(k)]).collect(),
            positions: (0..4).map(|k| Vector3::new(row(k), 0.0, 0.0)).collect(),
            orientations: vec![None; 4],
            targets: vec![0; 4],
            bodies: vec![1],
            tracker: Frame::Estimate,
            offsets: vec![Frame::Estimate],
        }
    }

    #[test]
    fn rows_are_shifted_against_each_other_both_ways() {
        for (rows, joints, positions) in [
            (1, [0.0, 1.0, 2.0], [1.0, 2.0, 3.0]),
            (-1, [1.0, 2.0, 3.0], [0.0, 1.0, 2.0]),
        ] {
            let shifted = shifted(&table(), rows);
            let q: Vec<f64> = shifted.joints.iter().map(|q| q[0]).collect();
            let x: Vec<f64> = shifted.positions.iter().map(|p| p.x).collect();
            assert_eq!((q, x), (joints.to_vec(), positions.to_vec()));
        }
    }

    #[test]
    fn numbers_of_a_quaternion_are_put_in_order() {
        // x, y, z, w written into the columns qw, qx, qy, qz
        let written = UnitQuaternion::new_unchecked(Quaternion::new(0.1, 0.2, 0.3, 0.9));
        let right = reordered(&written, [3, 0, 1, 2]);
        assert_eq!([right.w, right.i, right.j, right.k], [0.9, 0.1, 0.2, 0.3]);
        // and the other way round
        let again = reordered(&right, [1, 2, 3, 0]);
        assert_eq!(again.into_inner(), written.into_inner());
    }

    #[test]
    fn units_are_named_as_they_were_read() {
        for (unit, size, read) in [
            ("mm", 1e-3, "m"),
            ("m", 1e3, "mm"),
            ("m", 1.0 / 0.0254, "in"),
            ("m", 7.0, "m"),
        ] {
            assert_eq!(stated(unit, size), read);
        }
        assert_eq!(swapped([1, 0, 2]), Some((0, 1)));
        assert_eq!(swapped([1, 2, 0]), None);
        assert_eq!(swapped([0, 1, 2]), None);
    }
}
