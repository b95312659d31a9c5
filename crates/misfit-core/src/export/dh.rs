//! The calibrated arm of one target as a Denavit-Hartenberg table: exact parameters of its calibrated axes.
//!
//! Errors of geometry do not fit a table row by row: six numbers behind each joint, four in a row. But a table needs
//! the axes alone. Each row is computed from where two neighbouring axes are at zero, by their common normal; what is not
//! between axes goes to the mounts: `[base]` in front of the first axis, `[tool]` behind the last. Angles count from the
//! encoders' zeros.
//!
//! Where axes are nearly parallel their common normal is anywhere. There the plane across the first axis is taken in its
//! stead, with a fifth number (Hayati, Mirmirani 1985), and `d` stays what it was.
//!
//! Both conventions are one chain, `B X0 Z1 X1 Z2 X2 … Zn Xn T`: `Zi = RotZ(theta + q) TransZ(d)`,
//! `Xi = RotX(alpha) TransX(a) RotY(beta)`. A row of a modified table is `X(i-1) Zi`, and Xn is none; of a standard one
//! `Zi Xi`, and X0 is none.

use super::{Calibrated, ExportError, compare};
use crate::campaign::Campaign;
use crate::robot::{Convention, Ends, Joint, JointKind, Robot, ends, rpy};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::TAU;
use std::fmt::Write;

/// Sine of the angle between axes below which they count as nearly parallel.
const NEARLY: f64 = 0.05;
/// … and below which they are parallel; the same in m for axes that meet. Rounding.
const EXACTLY: f64 = 1e-11;

/// Offsets from here on no reader takes, m.
const LONGEST: f64 = 100.0;

/// What a refused table needs.
const ADVICE: &str = "write a .urdf or a .json file";

/// One row: rad and m.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// The joint.
    pub joint: Joint,
    /// Twist about x, rad.
    pub alpha: f64,
    /// Along x, m.
    pub a: f64,
    /// Turn about y, rad, zero but for nearly parallel axes.
    pub beta: f64,
    /// About z, rad, at encoder zero (revolute).
    pub theta: f64,
    /// Along z, m, at encoder zero (prismatic).
    pub d: f64,
    /// Mass of the body that the joint moves, kg, and its centre in the row's frame, m.
    pub mass: (f64, Vector3<f64>),
}

/// A table with its mounts.
#[derive(Debug, Clone, PartialEq)]
pub struct Table {
    /// Modified, or else standard.
    pub modified: bool,
    /// The first frame in the base frame.
    pub base: Isometry3<f64>,
    /// One row a joint, from the base on.
    pub rows: Vec<Row>,
    /// The target's link in the last frame.
    pub tool: Isometry3<f64>,
}

/// A file that was made.
#[derive(Debug, Clone)]
pub struct Written {
    /// Its text.
    pub text: String,
    /// Of the nominal robot.
    pub nominal: Table,
    /// Of the calibrated one.
    pub corrected: Table,
    /// Largest difference from the model without load, over random postures: m, rad.
    pub gap: (f64, f64),
    /// Joints of the robot that are not in it.
    pub others: usize,
}

/// Makes the table of the arm that carries a target, reads it back, and compares it with the model; `file` names it, `note`
/// stands on top. With `four_numbers` no row has a fifth.
///
/// # Errors
/// If no joint moves the target, or the table is not accepted or not the calibrated robot.
pub fn write(
    calibrated: &Calibrated,
    campaign: &Campaign,
    target: usize,
    (file, note): (&str, &str),
    four_numbers: bool,
) -> Result<Written, ExportError> {
    let setup = &calibrated.setup;
    let (link, name) = (setup.targets[target].link, &setup.targets[target].name);
    let chain = setup.robot.chain(setup.robot.links[link].body);
    if chain.is_empty() {
        return Err(ExportError::Still {
            target: name.clone(),
        });
    }
    let unfit = |source| ExportError::Unfit {
        source,
        advice: ADVICE,
    };
    let own = &campaign.robot_file;
    let ends = match own.name.to_lowercase().ends_with(".toml") {
        true => Some(ends(&own.name, &own.text).map_err(unfit)?),
        false => None,
    };
    let robot = calibrated.robot();
    let (nominal, corrected) = tables(
        (&setup.robot, &robot),
        &chain,
        link,
        ends.as_ref(),
        four_numbers,
    );
    let longest = |row: &Row| row.d.abs().max(row.a.abs());
    if let Some(row) = corrected.rows.iter().find(|row| longest(row) > LONGEST) {
        return Err(ExportError::Parallel {
            joint: row.joint.name.clone(),
            offset: longest(row),
        });
    }
    let text = corrected.text(&robot.name, note, &frames(calibrated, target));
    let toml = format!(
        "{file}{}",
        if file.ends_with(".toml") { "" } else { ".toml" }
    );
    let read = Robot::parse(&toml, &text, None).map_err(unfit)?;
    let flange = read.links.len() - 1;
    let gap = compare(file, &read, &robot, &[(flange, link)], ADVICE)?;
    Ok(Written {
        text,
        nominal,
        corrected,
        gap,
        others: robot.joints.len() - chain.len(),
    })
}

/// What a table has no place for but a comment: where the tracker and the target are.
fn frames(calibrated: &Calibrated, target: usize) -> Vec<String> {
    let of = |what: String, pose: &Isometry3<f64>| {
        let t = &pose.translation.vector;
        let [r, p, y] = rpy(&pose.rotation);
        format!(
            "{what}: xyz_m = [{:?}, {:?}, {:?}], rpy_rad = [{r:?}, {p:?}, {y:?}]",
            t.x, t.y, t.z
        )
    };
    let tracker = calibrated.base_from_tracker.as_ref();
    let tracker = tracker.map(|pose| of("the tracker in link base".to_owned(), pose));
    let name = &calibrated.setup.targets[target].name;
    let probe = calibrated.link_from_target[target].as_ref();
    let probe = probe.map(|pose| of(format!("target {name} in link flange"), pose));
    tracker.into_iter().chain(probe).collect()
}

/// An axis at zero: a point on it and its direction.
#[derive(Clone, Copy)]
struct Axis {
    point: Vector3<f64>,
    along: Vector3<f64>,
}

impl Axis {
    /// The point of the axis next to another point.
    fn nearest(&self, to: &Vector3<f64>) -> Vector3<f64> {
        self.point + self.along * self.along.dot(&(to - self.point))
    }

    /// A direction across the axis near another one; any where that is along it.
    fn across(&self, x: &Vector3<f64>) -> Vector3<f64> {
        let flat = x - self.along * self.along.dot(x);
        if flat.norm() > 0.5 * x.norm() {
            return flat.normalize();
        }
        let least = self.along.iamin();
        let other = Vector3::ith(least, 1.0);
        (other - self.along * self.along.dot(&other)).normalize()
    }

    /// The frame on the axis next to another one.
    fn frame(&self, near: &Isometry3<f64>) -> Isometry3<f64> {
        frame(
            &self.nearest(&near.translation.vector),
            &self.across(&(near.rotation * Vector3::x())),
            &self.along,
        )
    }
}

/// A frame from its origin, x and z.
fn frame(origin: &Vector3<f64>, x: &Vector3<f64>, z: &Vector3<f64>) -> Isometry3<f64> {
    let axes = Matrix3::from_columns(&[*x, z.cross(x), *z]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    Isometry3::from_parts(Translation3::from(*origin), rotation)
}

/// `RotX(alpha) TransX(a) RotY(beta)`.
fn across((alpha, a, beta): (f64, f64, f64)) -> Isometry3<f64> {
    let about_x = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), alpha);
    let about_y = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), beta);
    Isometry3::from_parts(Translation3::new(a, 0.0, 0.0), about_x * about_y)
}

/// What a table is to be near to: frames at zero, in the base frame.
struct Near {
    /// Before the first row's Z.
    first: Isometry3<f64>,
    /// By joint, behind its Z; the last joint's decides what is the tool's.
    frames: Vec<Isometry3<f64>>,
    /// X0 and Xn: alpha and a.
    ends: [(f64, f64, f64); 2],
    modified: bool,
}

/// Tables of the nominal and of the calibrated robot, of the same kind.
fn tables(
    (nominal, robot): (&Robot, &Robot),
    chain: &[usize],
    link: usize,
    ends: Option<&Ends>,
    four_numbers: bool,
) -> (Table, Table) {
    let axes = |robot: &Robot| -> Vec<Axis> {
        let poses = robot.body_poses(&vec![0.0; robot.joints.len()]);
        chain
            .iter()
            .map(|&joint| Axis {
                point: poses[joint + 1].translation.vector,
                along: poses[joint + 1].rotation * *robot.joints[joint].axis,
            })
            .collect()
    };
    let end = |robot: &Robot| {
        let poses = robot.body_poses(&vec![0.0; robot.joints.len()]);
        let link = &robot.links[link];
        poses[link.body] * link.body_from_link
    };
    let (there, here) = (axes(nominal), axes(robot));
    // where the calibrated axes need a fifth number, the nominal ones are shown the same way
    let fifth: Vec<bool> = here
        .windows(2)
        .map(|pair| {
            let sine = pair[0].along.cross(&pair[1].along).norm();
            sine < if four_numbers { EXACTLY } else { NEARLY }
        })
        .collect();
    let last = end(nominal);
    let mut near = near(nominal, chain, &last, ends);
    let (table, frames) = table(nominal, chain, &there, &last, &near, &fifth);
    // the calibrated table shall be near the nominal one
    near.first = table.base * across(near.ends[0]);
    near.frames = frames;
    let end = end(robot);
    if let Some(frame) = near.frames.last_mut() {
        *frame = end * (across(near.ends[1]) * table.tool).inverse();
    }
    let (mut corrected, _) = self::table(robot, chain, &here, &end, &near, &fifth);
    for (row, old) in corrected.rows.iter_mut().zip(&table.rows) {
        row.theta = beside(row.theta, old.theta);
        row.alpha = beside(row.alpha, old.alpha);
    }
    (table, corrected)
}

/// The nominal robot's own table, or its frames where it has none; `last` is the target's link.
fn near(robot: &Robot, chain: &[usize], last: &Isometry3<f64>, ends: Option<&Ends>) -> Near {
    let none = (0.0, 0.0, 0.0);
    let poses = robot.body_poses(&vec![0.0; robot.joints.len()]);
    let mut near = Near {
        first: Isometry3::identity(),
        frames: chain.iter().map(|&joint| poses[joint + 1]).collect(),
        ends: [none; 2],
        modified: true,
    };
    let mut tool = Isometry3::identity();
    if let Some(ends) = ends {
        near.modified = ends.convention == Convention::Modified;
        let own = (ends.free.0, ends.free.1, 0.0);
        near.ends = if near.modified {
            [own, none]
        } else {
            [none, own]
        };
        near.first = ends.base * across(near.ends[0]);
        // The frame that the row ends in: its x is that of the frame behind Z.
        for (frame, &joint) in near.frames.iter_mut().zip(chain) {
            *frame *= robot.body_from_frame(joint + 1);
        }
        tool = across(near.ends[1]) * ends.tool;
    }
    if let Some(frame) = near.frames.last_mut() {
        *frame = match ends {
            Some(_) => last * tool.inverse(),
            None => *last,
        };
    }
    near
}

/// An angle, full turns away, next to another.
fn beside(angle: f64, other: f64) -> f64 {
    angle - TAU * ((angle - other) / TAU).round()
}

/// The table, and by joint the frame behind its Z.
fn table(
    robot: &Robot,
    chain: &[usize],
    axes: &[Axis],
    end: &Isometry3<f64>,
    near: &Near,
    fifth: &[bool],
) -> (Table, Vec<Isometry3<f64>>) {
    let first = axes[0].frame(&near.first);
    let mut before = first;
    let mut frames = Vec::new();
    // X0, then what is between the axes, then Xn
    let mut xs = vec![near.ends[0]];
    let mut zs = Vec::new();
    for (index, axis) in axes.iter().enumerate() {
        let guess = &near.frames[index];
        let (here, x) = match axes.get(index + 1) {
            None => (axis.frame(guess), near.ends[1]),
            Some(next) if fifth[index] || axis.along.cross(&next.along).norm() < EXACTLY => {
                plane(axis, next, guess)
            }
            Some(next) => normal(axis, next, guess),
        };
        let moved = before.inverse() * here;
        let turned = moved.rotation * Vector3::x();
        zs.push((turned.y.atan2(turned.x), moved.translation.z));
        frames.push(here);
        xs.push(x);
        before = here * across(x);
    }
    let tool = before.inverse() * end;
    let poses = robot.body_poses(&vec![0.0; robot.joints.len()]);
    let rows = chain.iter().enumerate().map(|(index, &joint)| {
        let (alpha, a, beta) = xs[if near.modified { index } else { index + 1 }];
        let (theta, d) = zs[index];
        let row = match near.modified {
            true => frames[index],
            false => frames[index] * across(xs[index + 1]),
        };
        let body = &robot.bodies[joint + 1];
        let com = row.inverse() * poses[joint + 1] * Point3::from(body.com);
        Row {
            joint: robot.joints[joint].clone(),
            alpha,
            a,
            beta,
            theta,
            d,
            mass: (body.mass, com.coords),
        }
    });
    let table = Table {
        modified: near.modified,
        base: first * across(near.ends[0]).inverse(),
        rows: rows.collect(),
        tool,
    };
    (table, frames)
}

/// The frame on an axis whose x is along the common normal to the next one, and what is between them.
fn normal(axis: &Axis, next: &Axis, near: &Isometry3<f64>) -> (Isometry3<f64>, (f64, f64, f64)) {
    let cross = axis.along.cross(&next.along);
    let sine2 = cross.norm_squared();
    let guess = axis.across(&(near.rotation * Vector3::x()));
    let x = cross.normalize() * if cross.dot(&guess) < 0.0 { -1.0 } else { 1.0 };
    // the feet of the common normal
    let apart = next.point - axis.point;
    let foot = axis.point + axis.along * (apart.cross(&next.along).dot(&cross) / sine2);
    let a = apart.dot(&x);
    let alpha = cross.dot(&x).atan2(axis.along.dot(&next.along));
    (frame(&foot, &x, &axis.along), (alpha, a, 0.0))
}

/// The frame on an axis whose x leads across it to the next one, and what is between them: Hayati's five numbers.
fn plane(axis: &Axis, next: &Axis, near: &Isometry3<f64>) -> (Isometry3<f64>, (f64, f64, f64)) {
    let origin = axis.nearest(&near.translation.vector);
    let guess = axis.across(&(near.rotation * Vector3::x()));
    let along = axis.along.dot(&(origin - next.point)) / axis.along.dot(&next.along);
    let way = next.point + next.along * along - origin;
    let x = match way.norm() {
        meet if meet < EXACTLY => guess,
        _ => way.normalize() * if way.dot(&guess) < 0.0 { -1.0 } else { 1.0 },
    };
    let here = frame(&origin, &x, &axis.along);
    let z = here.rotation.inverse() * next.along;
    let beta = z.x.atan2(z.y.hypot(z.z));
    let alpha = (-z.y).atan2(z.z);
    let beta = if beta.abs() < EXACTLY { 0.0 } else { beta };
    (here, (alpha, way.dot(&x), beta))
}

impl Table {
    /// The file: `notes` are comments at its end.
    fn text(&self, name: &str, note: &str, notes: &[String]) -> String {
        let quoted = |text: &str| toml::Value::from(text).to_string();
        let commented = |text: &str| text.replace(['\n', '\r'], " ");
        let mut text = String::new();
        // Writing to a string cannot fail.
        let _ = writeln!(text, "# {}", commented(note));
        let _ = writeln!(
            text,
            "# Angles count from the encoders' zeros. The target's link is link `flange`."
        );
        for note in notes {
            let _ = writeln!(text, "# {}", commented(note));
        }
        let convention = if self.modified {
            "modified"
        } else {
            "standard"
        };
        let _ = writeln!(text, "name = {}", quoted(name));
        let _ = writeln!(text, "convention = \"{convention}\"");
        let _ = write!(text, "\n[base]\n{}", mount(&self.base));
        for row in &self.rows {
            let _ = writeln!(text, "\n[[joint]]\nname = {}", quoted(&row.joint.name));
            let slides = row.joint.kind == JointKind::Prismatic;
            match row.joint.kind {
                JointKind::Revolute => {}
                JointKind::Continuous => text.push_str("kind = \"continuous\"\n"),
                JointKind::Prismatic => text.push_str("kind = \"prismatic\"\n"),
            }
            let mut number = |key: &str, value: f64| {
                let _ = writeln!(text, "{key} = {value:?}");
            };
            number("alpha_rad", row.alpha);
            number("a_m", row.a);
            if row.beta != 0.0 {
                number("beta_rad", row.beta);
            }
            number("theta_rad", row.theta);
            number("d_m", row.d);
            if let Some((lower, upper)) = row.joint.limits
                && row.joint.kind != JointKind::Continuous
            {
                let unit = if slides { "m" } else { "rad" };
                number(&format!("lower_{unit}"), lower);
                number(&format!("upper_{unit}"), upper);
            }
            if let Some(effort) = row.joint.effort {
                number(if slides { "effort_N" } else { "effort_Nm" }, effort);
            }
            let (mass, com) = &row.mass;
            if *mass > 0.0 {
                number("mass_kg", *mass);
                let _ = writeln!(text, "com_m = [{:?}, {:?}, {:?}]", com.x, com.y, com.z);
            }
        }
        let _ = write!(text, "\n[tool]\n{}", mount(&self.tool));
        text
    }

    /// Rows whose axis is nearly parallel to the one before (modified) or after (standard).
    pub fn fifths(&self) -> Vec<&str> {
        let rows = self.rows.iter().filter(|row| row.beta != 0.0);
        rows.map(|row| row.joint.name.as_str()).collect()
    }

    /// Rows that left those of another table far behind, though the axes are near: 50 mm, or 0.1 rad.
    pub fn far_from(&self, other: &Table) -> Vec<&str> {
        let far = |(row, old): &(&Row, &Row)| {
            (row.d - old.d).abs() > 0.05
                || (row.a - old.a).abs() > 0.05
                || (row.theta - old.theta).abs() > 0.1
        };
        let rows = self.rows.iter().zip(&other.rows).filter(far);
        rows.map(|(row, _)| row.joint.name.as_str()).collect()
    }
}

fn mount(pose: &Isometry3<f64>) -> String {
    let t = &pose.translation.vector;
    let [r, p, y] = rpy(&pose.rotation);
    format!(
        "xyz_m = [{:?}, {:?}, {:?}]\nrpy_rad = [{r:?}, {p:?}, {y:?}]\n",
        t.x, t.y, t.z
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn angles_are_shown_beside_each_other() {
        assert!((beside(-PI + 0.01, PI) - (PI + 0.01)).abs() < 1e-15);
        assert!((beside(3.0, -3.0) - (3.0 - TAU)).abs() < 1e-15);
    }
}
