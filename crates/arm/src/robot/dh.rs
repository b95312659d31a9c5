//! A Denavit-Hartenberg table in TOML to tree.
//!
//! Row `i` of a modified table (Craig): `RotX(alpha) TransX(a) RotZ(theta) TransZ(d)`, where alpha and a are those
//! of the link before, α(i-1) and a(i-1), so the joint turns about the z axis of the row's own frame.
//! Row `i` of a standard table: `RotZ(theta) TransZ(d) TransX(a) RotX(alpha)`, so the joint turns about the z axis
//! of the frame before, and the rest of the row is rigid.
//! Either way link `<joint>_link` is the frame the row ends in.
//!
//! Where two axes are nearly parallel, four numbers a row need offsets without bound for a small tilt. A fifth, `beta`,
//! turns about y behind alpha: `RotX(alpha) TransX(a) RotY(beta)`; `d` may then stay what it is.
//! Source: Hayati, Mirmirani 1985, *Improving the absolute positioning accuracy of robot manipulators*, J. Robotic
//! Systems 2(4).

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::Deserialize;

use super::error::short;
use super::tree::{MAX_LINKS, Tree, TreeJoint, TreeLink, too_many_links};
use super::{JointKind, RobotError};
use crate::input;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    name: String,
    convention: Convention,
    base: Option<Mount>,
    #[serde(default)]
    joint: Vec<Row>,
    tool: Option<Mount>,
}

/// Order of the four motions of a row.
#[derive(Debug, Deserialize, Clone, Copy, PartialEq)]
#[serde(rename_all = "snake_case")]
pub enum Convention {
    /// Denavit and Hartenberg 1955: Rz(θ) Tz(d) Tx(a) Rx(α).
    Standard,
    /// Craig 1986: Rx(α) Tx(a) Rz(θ) Tz(d).
    Modified,
}

/// `[base]`: the table's first frame in link `base`. `[tool]`: link `flange` in the frame of the last row.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Mount {
    xyz_m: Option<[f64; 3]>,
    xyz_mm: Option<[f64; 3]>,
    rpy_rad: Option<[f64; 3]>,
    rpy_deg: Option<[f64; 3]>,
    mass_kg: Option<f64>,
    com_m: Option<[f64; 3]>,
    com_mm: Option<[f64; 3]>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    name: String,
    #[serde(default)]
    kind: Kind,
    alpha_deg: Option<f64>,
    alpha_rad: Option<f64>,
    beta_deg: Option<f64>,
    beta_rad: Option<f64>,
    a_mm: Option<f64>,
    a_m: Option<f64>,
    theta_deg: Option<f64>,
    theta_rad: Option<f64>,
    d_mm: Option<f64>,
    d_m: Option<f64>,
    lower_deg: Option<f64>,
    lower_rad: Option<f64>,
    lower_mm: Option<f64>,
    lower_m: Option<f64>,
    upper_deg: Option<f64>,
    upper_rad: Option<f64>,
    upper_mm: Option<f64>,
    upper_m: Option<f64>,
    #[serde(rename = "effort_Nm")]
    effort_nm: Option<f64>,
    #[serde(rename = "effort_N")]
    effort_n: Option<f64>,
    mass_kg: Option<f64>,
    com_mm: Option<[f64; 3]>,
    com_m: Option<[f64; 3]>,
}

#[derive(Deserialize, Default, Clone, Copy)]
#[serde(rename_all = "snake_case")]
enum Kind {
    #[default]
    Revolute,
    Continuous,
    Prismatic,
}

/// Reads a DH table.
pub(super) fn read(file: &str, text: &str) -> Result<Tree, RobotError> {
    let table = parse(file, text)?;
    if table.joint.is_empty() {
        return Err(RobotError::refused(
            file,
            "joint",
            "the table has no row",
            "a DH table has one [[joint]] for each joint",
        ));
    }
    // Base and flange come on top of the rows.
    if table.joint.len() + 2 > MAX_LINKS {
        return Err(too_many_links(file, 0, table.joint.len()));
    }
    let base_place = Place::new(file, "[base]");
    let tool_place = Place::new(file, "[tool]");
    let base = table.base.as_ref();
    let mut links = vec![mount_link(&base_place, "base", base)?];
    let mut joints: Vec<TreeJoint> = Vec::new();
    let mut parent_from_next = mount_pose(&base_place, base)?;
    for (index, row) in table.joint.iter().enumerate() {
        let place = Place::new(file, format!("joint \"{}\" (row {})", row.name, index + 1));
        if row.name.trim().is_empty() {
            return Err(place.refuse("its name is empty", "every joint needs a name of its own"));
        }
        let (before, after) = row.transforms(&place, table.convention)?;
        row.check_units(&place)?;
        let parent = &links[links.len() - 1].name;
        let child = format!("{}_link", row.name);
        joints.push(TreeJoint {
            name: row.name.clone(),
            kind: Some(match row.kind {
                Kind::Revolute => JointKind::Revolute,
                Kind::Continuous => JointKind::Continuous,
                Kind::Prismatic => JointKind::Prismatic,
            }),
            unsupported: None,
            parent: parent.clone(),
            child: child.clone(),
            parent_from_joint: parent_from_next * before,
            joint_from_child: after,
            axis: Vector3::z(),
            limits: row.limits(&place)?,
            effort: row.effort_nm.or(row.effort_n),
        });
        parent_from_next = Isometry3::identity();
        links.push(TreeLink {
            name: child,
            mass: row.mass_kg.unwrap_or(0.0),
            com: lengths(&place, "com", row.com_m, row.com_mm)?,
            visuals: Vec::new(),
        });
    }
    let tool = table.tool.as_ref();
    joints.push(TreeJoint {
        name: unused_name(&joints),
        kind: None,
        unsupported: None,
        parent: links[links.len() - 1].name.clone(),
        child: "flange".to_owned(),
        parent_from_joint: mount_pose(&tool_place, tool)?,
        joint_from_child: Isometry3::identity(),
        axis: Vector3::z(),
        limits: None,
        effort: None,
    });
    links.push(mount_link(&tool_place, "flange", tool)?);
    Ok(Tree {
        name: table.name,
        links,
        joints,
    })
}

/// What the frames of a table do not tell: conventions, mounts, and the numbers of its ends that are free to choose.
#[derive(Debug, Clone, Copy)]
pub struct Ends {
    /// Of all rows.
    pub convention: Convention,
    /// The first frame in link `base`.
    pub base: Isometry3<f64>,
    /// Link `flange` in the last frame.
    pub tool: Isometry3<f64>,
    /// alpha (rad) and a (m) of the first row of a modified table, of the last row of a standard one.
    pub free: (f64, f64),
}

/// Reads that of a table that was accepted before.
///
/// # Errors
/// As for any DH table.
pub fn ends(file: &str, text: &str) -> Result<Ends, RobotError> {
    let text = text.strip_prefix('\u{feff}').unwrap_or(text);
    let table = parse(file, text)?;
    let place = Place::new(file, "joint");
    let row = match table.convention {
        Convention::Modified => table.joint.first(),
        Convention::Standard => table.joint.last(),
    };
    let free = match row {
        None => (0.0, 0.0),
        Some(row) => {
            let alpha = row.alpha_rad.or(row.alpha_deg.map(f64::to_radians));
            let a = length(&place, "a", row.a_m, row.a_mm)?;
            (alpha.unwrap_or(0.0), a)
        }
    };
    Ok(Ends {
        convention: table.convention,
        base: mount_pose(&Place::new(file, "[base]"), table.base.as_ref())?,
        tool: mount_pose(&Place::new(file, "[tool]"), table.tool.as_ref())?,
        free,
    })
}

fn parse(file: &str, text: &str) -> Result<Table, RobotError> {
    let accepted = "a DH table has name, convention and [[joint]] rows";
    input::toml_depth(text).map_err(|found| RobotError::refused(file, "TOML", found, accepted))?;
    toml::from_str(text).map_err(|error| located(file, text, &error))
}

/// A message of the TOML parser with the line it is about, and the row if it is in one.
fn located(file: &str, text: &str, error: &toml::de::Error) -> RobotError {
    // Up to the end of the line, so that an error of a whole row counts its own header.
    let before = error.span().and_then(|span| {
        let rest = text.get(span.start..)?;
        let line = rest.find('\n').unwrap_or(rest.len());
        text.get(..span.start + line)
    });
    let place = match before {
        None => "TOML".to_owned(),
        Some(before) => {
            let line = before.matches('\n').count() + 1;
            let mut headers = before.lines().rev().map(str::trim_start);
            let section = headers.find(|line| line.starts_with('['));
            match section.is_some_and(|header| header.starts_with("[[joint]]")) {
                true => format!("line {line} (row {})", before.matches("[[joint]]").count()),
                false => format!("line {line}"),
            }
        }
    };
    RobotError::refused(
        file,
        place,
        short(error.message()),
        "a DH table has name, convention and [[joint]] rows",
    )
}

/// A name for the fixed joint of the flange that no row has taken.
fn unused_name(joints: &[TreeJoint]) -> String {
    let mut name = "flange".to_owned();
    while joints.iter().any(|joint| joint.name == name) {
        name.push('_');
    }
    name
}

/// Where in which file, for messages.
struct Place<'a> {
    file: &'a str,
    name: String,
}

impl<'a> Place<'a> {
    fn new(file: &'a str, name: impl Into<String>) -> Self {
        Place {
            file,
            name: name.into(),
        }
    }

    fn refuse(&self, found: impl Into<String>, accepted: impl Into<String>) -> RobotError {
        RobotError::refused(self.file, self.name.as_str(), found, accepted)
    }

    /// The one of two spellings of a quantity that is given, or neither.
    fn either<T>(
        &self,
        first: (&str, Option<T>),
        second: (&str, Option<T>),
    ) -> Result<Option<T>, RobotError> {
        match (first.1, second.1) {
            (Some(_), Some(_)) => Err(self.refuse(
                format!("both {} and {} are given", first.0, second.0),
                "give one of them",
            )),
            (one, other) => Ok(one.or(other)),
        }
    }
}

impl Row {
    /// What comes before the joint's motion and what comes after it.
    fn transforms(
        &self,
        place: &Place,
        convention: Convention,
    ) -> Result<(Isometry3<f64>, Isometry3<f64>), RobotError> {
        let alpha = Angle::read(place, "alpha", self.alpha_deg, self.alpha_rad)?;
        let theta = Angle::read(place, "theta", self.theta_deg, self.theta_rad)?;
        let beta = Angle::read(place, "beta", self.beta_deg, self.beta_rad)?;
        let a = length(place, "a", self.a_m, self.a_mm)?;
        let d = length(place, "d", self.d_m, self.d_mm)?;
        let (about_x, about_z) = (alpha.about(Vector3::x()), theta.about(Vector3::z()));
        let across = about_x * beta.about(Vector3::y());
        // z of the frame that the row's d is along: RotX(alpha) RotY(beta) z
        let along = Vector3::new(beta.sin, -alpha.sin * beta.cos, alpha.cos * beta.cos);
        Ok(match convention {
            Convention::Modified => (
                Isometry3::from_parts(
                    Translation3::from(Vector3::new(a, 0.0, 0.0) + along * d),
                    across * about_z,
                ),
                Isometry3::identity(),
            ),
            Convention::Standard => (
                Isometry3::from_parts(Translation3::identity(), about_z),
                Isometry3::from_parts(Translation3::new(a, 0.0, d), across),
            ),
        })
    }

    /// Refuses limits and efforts in units that do not go with the kind of joint.
    fn check_units(&self, place: &Place) -> Result<(), RobotError> {
        let slides = matches!(self.kind, Kind::Prismatic);
        let wrong = match slides {
            true => [
                ("lower_deg", self.lower_deg),
                ("lower_rad", self.lower_rad),
                ("upper_deg", self.upper_deg),
                ("upper_rad", self.upper_rad),
                ("effort_Nm", self.effort_nm),
            ],
            false => [
                ("lower_mm", self.lower_mm),
                ("lower_m", self.lower_m),
                ("upper_mm", self.upper_mm),
                ("upper_m", self.upper_m),
                ("effort_N", self.effort_n),
            ],
        };
        if let Some((key, _)) = wrong.iter().find(|(_, value)| value.is_some()) {
            return Err(match slides {
                true => place.refuse(
                    format!("{key} on a prismatic joint"),
                    "it takes _m or _mm limits and effort_N",
                ),
                false => place.refuse(
                    format!("{key} on a turning joint"),
                    "it takes _rad or _deg limits and effort_Nm",
                ),
            });
        }
        Ok(())
    }

    /// Lower and upper limit, rad or m.
    fn limits(&self, place: &Place) -> Result<Option<(f64, f64)>, RobotError> {
        // What is of the wrong kind is known to be absent, so turns and lengths cannot mix.
        let bound = |name: &str, deg: Option<f64>, rad, mm: Option<f64>, m| {
            let keys = |unit: &str| format!("{name}_{unit}");
            let turn = place.either(
                (&keys("deg"), deg.map(f64::to_radians)),
                (&keys("rad"), rad),
            )?;
            let slide = place.either((&keys("mm"), mm.map(|mm| mm * 1.0e-3)), (&keys("m"), m))?;
            Ok(turn.or(slide))
        };
        let lower = bound(
            "lower",
            self.lower_deg,
            self.lower_rad,
            self.lower_mm,
            self.lower_m,
        )?;
        let upper = bound(
            "upper",
            self.upper_deg,
            self.upper_rad,
            self.upper_mm,
            self.upper_m,
        )?;
        match (lower, upper) {
            (None, None) => Ok(None),
            (Some(_), Some(_)) if matches!(self.kind, Kind::Continuous) => Err(place.refuse(
                "limits on a continuous joint",
                "remove them or make it revolute",
            )),
            (Some(lower), Some(upper)) => Ok(Some((lower, upper))),
            _ => Err(place.refuse("only one of its limits", "give both or neither")),
        }
    }
}

/// An angle with sine and cosine exact at multiples of 90 degrees, which is what DH tables mostly hold.
struct Angle {
    sin: f64,
    cos: f64,
    half_sin: f64,
    half_cos: f64,
}

impl Angle {
    fn read(
        place: &Place,
        name: &str,
        deg: Option<f64>,
        rad: Option<f64>,
    ) -> Result<Self, RobotError> {
        let (deg_key, rad_key) = (format!("{name}_deg"), format!("{name}_rad"));
        place.either((&deg_key, deg), (&rad_key, rad))?;
        let angle = match (deg, rad) {
            (_, Some(rad)) => rad,
            (deg, None) => deg.unwrap_or(0.0),
        };
        if !angle.is_finite() {
            return Err(place.refuse(
                format!("{name} = {angle}"),
                "an angle is a finite number in _deg or _rad",
            ));
        }
        Ok(match rad {
            Some(rad) => Angle {
                sin: rad.sin(),
                cos: rad.cos(),
                half_sin: (rad / 2.0).sin(),
                half_cos: (rad / 2.0).cos(),
            },
            None => {
                let (sin, cos) = sin_cos_degrees(angle);
                let (half_sin, half_cos) = sin_cos_degrees(angle / 2.0);
                Angle {
                    sin,
                    cos,
                    half_sin,
                    half_cos,
                }
            }
        })
    }

    /// The rotation by this angle about a coordinate axis.
    fn about(&self, axis: Vector3<f64>) -> UnitQuaternion<f64> {
        UnitQuaternion::new_unchecked(Quaternion::from_parts(self.half_cos, axis * self.half_sin))
    }
}

/// Sine and cosine of an angle in degrees, rounded correctly at multiples of 45.
fn sin_cos_degrees(degrees: f64) -> (f64, f64) {
    use std::f64::consts::FRAC_1_SQRT_2 as H;
    let turned = degrees.rem_euclid(360.0);
    if turned % 45.0 != 0.0 {
        return degrees.to_radians().sin_cos();
    }
    match (turned / 45.0) as u8 {
        1 => (H, H),
        2 => (1.0, 0.0),
        3 => (H, -H),
        4 => (0.0, -1.0),
        5 => (-H, -H),
        6 => (-1.0, 0.0),
        7 => (-H, H),
        _ => (0.0, 1.0),
    }
}

fn length(place: &Place, name: &str, m: Option<f64>, mm: Option<f64>) -> Result<f64, RobotError> {
    let mm = mm.map(|mm| mm * 1.0e-3);
    let given = place.either((&format!("{name}_m"), m), (&format!("{name}_mm"), mm))?;
    Ok(given.unwrap_or(0.0))
}

fn lengths(
    place: &Place,
    name: &str,
    m: Option<[f64; 3]>,
    mm: Option<[f64; 3]>,
) -> Result<Vector3<f64>, RobotError> {
    let mm = mm.map(|mm| mm.map(|mm| mm * 1.0e-3));
    let given = place.either((&format!("{name}_m"), m), (&format!("{name}_mm"), mm))?;
    Ok(Vector3::from(given.unwrap_or_default()))
}

fn mount_pose(place: &Place, mount: Option<&Mount>) -> Result<Isometry3<f64>, RobotError> {
    let Some(mount) = mount else {
        return Ok(Isometry3::identity());
    };
    let xyz = lengths(place, "xyz", mount.xyz_m, mount.xyz_mm)?;
    let deg = mount.rpy_deg.map(|rpy| rpy.map(f64::to_radians));
    let rpy = place.either(("rpy_rad", mount.rpy_rad), ("rpy_deg", deg))?;
    let [roll, pitch, yaw] = rpy.unwrap_or_default();
    Ok(Isometry3::from_parts(
        Translation3::from(xyz),
        UnitQuaternion::from_euler_angles(roll, pitch, yaw),
    ))
}

fn mount_link(place: &Place, name: &str, mount: Option<&Mount>) -> Result<TreeLink, RobotError> {
    let (mass, com) = match mount {
        None => (0.0, Vector3::zeros()),
        Some(mount) => (
            mount.mass_kg.unwrap_or(0.0),
            lengths(place, "com", mount.com_m, mount.com_mm)?,
        ),
    };
    Ok(TreeLink {
        name: name.to_owned(),
        mass,
        com,
        visuals: Vec::new(),
    })
}
