//! How makers and libraries write an orientation as three or four numbers, and its way to a rotation and back.
//!
//! Conventions of the makers after the pose formats that Roboception and Basler publish (docs.baslerweb.com,
//! `pose_format_kuka`, `_fanuc`, `_yaskawa`, `_abb`, `_ur`) and RoboDK's `robomath` (6.0.2: `KUKA_2_Pose`,
//! `Fanuc_2_Pose`, `Motoman_2_Pose`, `Staubli_2_Pose`, `UR_2_Pose`); the tests hold both against scipy.

use nalgebra::{Quaternion, Unit, UnitQuaternion, Vector3};
use std::fmt;

/// How far a quaternion's norm may be from 1 before it is taken for a mistake.
const NORM_TOLERANCE: f64 = 1e-3;

/// What stands in the columns of an orientation. Angles are in rad; a rotation turns target axes into tracker axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Convention {
    /// Three turns, each about an axis of the frame so far (`intrinsic`) or of the first one.
    Euler {
        /// 0, 1, 2 for x, y, z, in the order of the columns.
        axes: [usize; 3],
        /// About the axes that were turned along.
        intrinsic: bool,
        /// The maker's word, if one was used.
        name: Option<&'static str>,
    },
    /// Axis times angle.
    RotationVector {
        /// The maker's word, if one was used.
        name: Option<&'static str>,
    },
    /// Four numbers of norm 1.
    Quaternion {
        /// The scalar stands last instead of first.
        scalar_last: bool,
        /// The maker's word, if one was used.
        name: Option<&'static str>,
    },
}

/// Makers' words and what they stand for; angles in the order of the columns.
const NAMED: [(&str, Convention); 9] = [
    // A about z, B about the new y, C about the new x: Rz(A) Ry(B) Rx(C)
    ("kuka_abc", euler("kuka_abc", [2, 1, 0], true)),
    // W, P, R about the fixed x, y, z: Rz(R) Ry(P) Rx(W)
    ("fanuc_wpr", euler("fanuc_wpr", [0, 1, 2], false)),
    // the same: Rz(Rz) Ry(Ry) Rx(Rx)
    ("yaskawa_rxryrz", euler("yaskawa_rxryrz", [0, 1, 2], false)),
    // Rx(rx) Ry(ry) Rz(rz)
    ("staubli", euler("staubli", [0, 1, 2], true)),
    // roll, pitch, yaw about the fixed x, y, z, as in a URDF
    ("rpy", euler("rpy", [0, 1, 2], false)),
    (
        "abb_quaternion",
        Convention::Quaternion {
            scalar_last: false,
            name: Some("abb_quaternion"),
        },
    ),
    (
        "ur_rotvec",
        Convention::RotationVector {
            name: Some("ur_rotvec"),
        },
    ),
    ("rotvec", Convention::RotationVector { name: None }),
    (
        "quaternion:wxyz",
        Convention::Quaternion {
            scalar_last: false,
            name: None,
        },
    ),
];

/// What may stand as a convention, for messages.
pub const ACCEPTED: &str = "kuka_abc, abb_quaternion, fanuc_wpr, yaskawa_rxryrz, staubli, ur_rotvec, rpy, \
    rotvec, quaternion:wxyz, quaternion:xyzw, or euler: with three axes (euler:ZYX about the axes turned along, \
    euler:zyx about the fixed ones)";

const fn euler(name: &'static str, axes: [usize; 3], intrinsic: bool) -> Convention {
    Convention::Euler {
        axes,
        intrinsic,
        name: Some(name),
    }
}

impl Convention {
    /// The convention of a word, or `None` if there is none.
    pub fn named(word: &str) -> Option<Self> {
        if word == "quaternion:xyzw" {
            return Some(Self::Quaternion {
                scalar_last: true,
                name: None,
            });
        }
        if let Some((_, convention)) = NAMED.iter().find(|(name, _)| *name == word) {
            return Some(*convention);
        }
        let letters = word.strip_prefix("euler:")?;
        let intrinsic = letters.chars().all(|c| c.is_ascii_uppercase());
        if !intrinsic && !letters.chars().all(|c| c.is_ascii_lowercase()) {
            return None;
        }
        let axes: Option<Vec<usize>> = letters
            .to_ascii_lowercase()
            .chars()
            .map(|letter| "xyz".find(letter))
            .collect();
        let axes: [usize; 3] = axes?.try_into().ok()?;
        // two turns about one axis, one after the other, are one
        let differ = axes[0] != axes[1] && axes[1] != axes[2];
        differ.then_some(Self::Euler {
            axes,
            intrinsic,
            name: None,
        })
    }

    /// How many columns it has.
    pub fn count(self) -> usize {
        match self {
            Self::Quaternion { .. } => 4,
            _ => 3,
        }
    }

    /// Do its columns hold angles, which have a unit?
    pub fn has_unit(self) -> bool {
        !matches!(self, Self::Quaternion { .. })
    }

    /// The rotation of numbers as they stand in the columns, angles in rad; of a quaternion that is none its norm.
    pub fn rotation(self, values: &[f64]) -> Result<UnitQuaternion<f64>, f64> {
        match (self, values) {
            (
                Self::Euler {
                    axes, intrinsic, ..
                },
                &[a, b, c],
            ) => {
                let turn = |axis: usize, angle: f64| {
                    UnitQuaternion::from_axis_angle(
                        &Unit::new_unchecked(Vector3::ith(axis, 1.0)),
                        angle,
                    )
                };
                let (first, second, third) = (turn(axes[0], a), turn(axes[1], b), turn(axes[2], c));
                Ok(match intrinsic {
                    true => first * second * third,
                    false => third * second * first,
                })
            }
            (Self::RotationVector { .. }, &[x, y, z]) => {
                Ok(UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z)))
            }
            (Self::Quaternion { scalar_last, .. }, &[a, b, c, d]) => match scalar_last {
                false => unit_quaternion([a, b, c, d]),
                true => unit_quaternion([d, a, b, c]),
            },
            _ => Err(f64::NAN),
        }
    }

    /// The numbers of a rotation as they stand in the columns, angles in rad: the middle one of Euler angles in
    /// −π/2..π/2, or 0..π where the first and last axis are one; a rotation vector of at most π.
    #[cfg(test)]
    pub fn values(self, rotation: &UnitQuaternion<f64>) -> Vec<f64> {
        match self {
            Self::Euler {
                axes, intrinsic, ..
            } => euler_angles(rotation, axes, intrinsic).to_vec(),
            Self::RotationVector { .. } => rotation.scaled_axis().iter().copied().collect(),
            Self::Quaternion { scalar_last, .. } => {
                let q: &Quaternion<f64> = rotation;
                match scalar_last {
                    false => vec![q.w, q.i, q.j, q.k],
                    true => vec![q.i, q.j, q.k, q.w],
                }
            }
        }
    }
}

/// A quaternion `[w, x, y, z]` made a unit one; its norm if that is too far from 1.
///
/// One that is a unit quaternion but for rounding is kept bit for bit, so that reading and
/// writing again changes nothing.
///
/// # Errors
/// The norm.
pub fn unit_quaternion(q: [f64; 4]) -> Result<UnitQuaternion<f64>, f64> {
    let quaternion = Quaternion::new(q[0], q[1], q[2], q[3]);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() <= 1e-12 {
        Ok(UnitQuaternion::new_unchecked(quaternion))
    } else if (norm - 1.0).abs() <= NORM_TOLERANCE {
        Ok(UnitQuaternion::new_normalize(quaternion))
    } else {
        Err(norm)
    }
}

impl fmt::Display for Convention {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Euler { name: Some(n), .. }
            | Self::RotationVector { name: Some(n) }
            | Self::Quaternion { name: Some(n), .. } => out.write_str(n),
            Self::Euler {
                axes, intrinsic, ..
            } => {
                let letters = if *intrinsic { "XYZ" } else { "xyz" };
                out.write_str("euler:")?;
                axes.iter()
                    .try_for_each(|axis| out.write_str(&letters[*axis..=*axis]))
            }
            Self::RotationVector { name: None } => out.write_str("rotvec"),
            Self::Quaternion {
                scalar_last: false, ..
            } => out.write_str("quaternion:wxyz"),
            Self::Quaternion {
                scalar_last: true, ..
            } => out.write_str("quaternion:xyzw"),
        }
    }
}

/// Euler angles of a rotation, rad; where two axes fall together the last angle is zero.
///
/// Source: Bernardes and Viollet 2022, *Quaternion to Euler angles conversion: a direct, general and computationally
/// efficient method*, PLoS ONE 17, e0276302.
#[cfg(test)]
fn euler_angles(rotation: &UnitQuaternion<f64>, axes: [usize; 3], intrinsic: bool) -> [f64; 3] {
    use std::f64::consts::{FRAC_PI_2, PI};
    // their algorithm is for fixed axes: turned along, the order is the other way round
    let [mut i, j, mut k] = axes;
    if intrinsic {
        (i, k) = (k, i);
    }
    let proper = i == k;
    if proper {
        k = 3 - i - j;
    }
    let sign = if (i + 1) % 3 == j { 1.0 } else { -1.0 };
    let q = rotation.quaternion();
    let v = [q.i, q.j, q.k];
    let (a, b, c, d) = if proper {
        (q.w, v[i], v[j], v[k] * sign)
    } else {
        (
            q.w - v[j],
            v[i] + v[k] * sign,
            v[j] + q.w,
            v[k] * sign - v[i],
        )
    };
    let mut middle = 2.0 * c.hypot(d).atan2(a.hypot(b));
    let (plus, minus) = (b.atan2(a), d.atan2(c));
    const CLOSE: f64 = 1e-9;
    let (mut first, mut last) = if middle.abs() < CLOSE {
        (2.0 * plus, 0.0)
    } else if (middle - PI).abs() < CLOSE {
        (-2.0 * minus, 0.0)
    } else {
        (plus - minus, plus + minus)
    };
    if middle.abs() < CLOSE || (middle - PI).abs() < CLOSE {
        // the one that is left has to be the first of the columns
        if intrinsic {
            let turned_back = (middle - PI).abs() < CLOSE;
            (first, last) = (0.0, if turned_back { -first } else { first });
        }
    }
    if !proper {
        last *= sign;
        middle -= FRAC_PI_2;
    }
    let within = |angle: f64| {
        let turned = angle.rem_euclid(2.0 * PI);
        if turned > PI {
            turned - 2.0 * PI
        } else {
            turned
        }
    };
    let (first, last) = (within(first), within(last));
    match intrinsic {
        true => [last, middle, first],
        false => [first, middle, last],
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn turned(word: &str, values: &[f64], degrees: bool) -> UnitQuaternion<f64> {
        let convention = Convention::named(word).unwrap();
        let scale = |x: &f64| if degrees { x.to_radians() } else { *x };
        let values: Vec<f64> = values.iter().map(scale).collect();
        convention.rotation(&values).unwrap()
    }

    #[track_caller]
    fn is(rotation: UnitQuaternion<f64>, wxyz: [f64; 4], tolerance: f64) {
        let other =
            UnitQuaternion::new_normalize(Quaternion::new(wxyz[0], wxyz[1], wxyz[2], wxyz[3]));
        let angle = rotation.angle_to(&other);
        assert!(angle < tolerance, "{angle} rad: {rotation} {other}");
    }

    /// scipy 1.17.1, `Rotation.from_euler(AXES, [30, -40, 110], degrees=True).as_quat(scalar_first=True)`.
    const SCIPY: [(&str, [f64; 4]); 7] = [
        (
            "ZYX",
            [
                0.448107631723675,
                0.794296244782429,
                0.00973604843989426,
                0.41011978162033,
            ],
        ),
        (
            "xyz",
            [
                0.448107631723675,
                0.41011978162033,
                0.00973604843989426,
                0.794296244782429,
            ],
        ),
        (
            "XYZ",
            [
                0.593132483512549,
                -0.131120333615894,
                -0.38871645710979,
                0.692748750332114,
            ],
        ),
        (
            "zyz",
            [
                0.32139380484327,
                0.219846310392954,
                -0.262002630229385,
                0.883022221559489,
            ],
        ),
        (
            "ZYZ",
            [
                0.32139380484327,
                -0.219846310392954,
                -0.262002630229385,
                0.883022221559489,
            ],
        ),
        (
            "XZX",
            [
                0.32139380484327,
                0.883022221559489,
                -0.219846310392954,
                -0.262002630229385,
            ],
        ),
        (
            "yzx",
            [
                0.448107631723675,
                0.794296244782429,
                0.41011978162033,
                0.00973604843989426,
            ],
        ),
    ];

    #[test]
    fn euler_angles_are_those_of_scipy() {
        for (axes, wxyz) in SCIPY {
            let found = turned(&format!("euler:{axes}"), &[30.0, -40.0, 110.0], true);
            // as_quat's 15 digits, and the angle between two equal quaternions by an arc cosine
            is(found, wxyz, 3e-8);
        }
    }

    #[test]
    fn makers_words_are_the_axes_that_their_formats_say() {
        // RoboDK 6.0.2, pose_2_quaternion(X_2_Pose([0, 0, 0, 30, -40, 110])), has the same four numbers, to its ten
        // digits, for KUKA, Fanuc, Motoman and Staubli
        for (word, axes) in [
            ("kuka_abc", "ZYX"),
            ("fanuc_wpr", "xyz"),
            ("yaskawa_rxryrz", "xyz"),
            ("rpy", "xyz"),
            ("staubli", "XYZ"),
        ] {
            let wxyz = SCIPY.iter().find(|(a, _)| *a == axes).unwrap().1;
            is(turned(word, &[30.0, -40.0, 110.0], true), wxyz, 3e-8);
        }
        // scipy: Rotation.from_rotvec([0.4, -1.2, 2.1]).as_quat(scalar_first=True); RoboDK's UR_2_Pose the same
        let wxyz = [
            0.338226094707613,
            0.153547348579548,
            -0.460642045738645,
            0.806123580042628,
        ];
        for word in ["ur_rotvec", "rotvec"] {
            is(turned(word, &[0.4, -1.2, 2.1], false), wxyz, 3e-8);
        }
        for word in ["abb_quaternion", "quaternion:wxyz"] {
            is(turned(word, &wxyz, false), wxyz, 3e-8);
        }
        let [w, x, y, z] = wxyz;
        is(turned("quaternion:xyzw", &[x, y, z, w], false), wxyz, 3e-8);
    }

    #[test]
    fn published_examples_of_makers() {
        // ABB, RAPID Reference Manual, data type orient, example 1: z' along the base's x, y' along y:
        // q1 = 0.707, q2 = 0, q3 = 0.707, q4 = 0
        let tool = turned("abb_quaternion", &[0.707, 0.0, 0.707, 0.0], false);
        let axis = |v: Vector3<f64>| tool * v;
        assert!((axis(Vector3::z()) - Vector3::x()).norm() < 1e-9);
        assert!((axis(Vector3::y()) - Vector3::y()).norm() < 1e-9);
        assert!((axis(Vector3::x()) + Vector3::z()).norm() < 1e-9);
        // the quaternions of the formats of KUKA, Fanuc and Yaskawa as docs.baslerweb.com writes them out
        let half = |degrees: f64| (degrees.to_radians() / 2.0).sin_cos();
        let written_out = |about_z: f64, about_y: f64, about_x: f64| {
            let ((sz, cz), (sy, cy), (sx, cx)) = (half(about_z), half(about_y), half(about_x));
            [
                cz * cy * cx + sz * sy * sx,
                cz * cy * sx - sz * sy * cx,
                cz * sy * cx + sz * cy * sx,
                sz * cy * cx - cz * sy * sx,
            ]
        };
        let angles = [12.0, 56.0, -143.0];
        let kuka = written_out(angles[0], angles[1], angles[2]);
        is(turned("kuka_abc", &angles, true), kuka, 3e-8);
        let fixed = written_out(angles[2], angles[1], angles[0]);
        is(turned("fanuc_wpr", &angles, true), fixed, 3e-8);
        is(turned("yaskawa_rxryrz", &angles, true), fixed, 3e-8);
    }

    #[test]
    fn words_that_are_none() {
        for word in [
            "euler:",
            "euler:xy",
            "euler:xYz",
            "euler:xxy",
            "euler:abc",
            "euler:XYZX",
            "kuka",
            "",
            "quaternion",
            "euler:ΧΥΖ",
        ] {
            assert_eq!(Convention::named(word), None, "{word}");
        }
        for word in [
            "kuka_abc",
            "abb_quaternion",
            "fanuc_wpr",
            "yaskawa_rxryrz",
            "staubli",
            "ur_rotvec",
            "rpy",
            "rotvec",
            "quaternion:wxyz",
            "quaternion:xyzw",
            "euler:ZXZ",
            "euler:yzx",
        ] {
            assert_eq!(Convention::named(word).unwrap().to_string(), word);
        }
        assert!(
            Convention::named("kuka_abc")
                .unwrap()
                .rotation(&[0.1])
                .is_err()
        );
        let norm = Convention::named("abb_quaternion")
            .unwrap()
            .rotation(&[1.0, 1.0, 0.0, 0.0]);
        assert!((norm.unwrap_err() - 2f64.sqrt()).abs() < 1e-15);
    }

    /// Every convention there is.
    fn all() -> Vec<Convention> {
        let mut words: Vec<String> = NAMED.iter().map(|(name, _)| (*name).to_owned()).collect();
        words.push("quaternion:xyzw".into());
        for a in "xyz".chars() {
            for b in "xyz".chars().filter(|b| *b != a) {
                for c in "xyz".chars().filter(|c| *c != b) {
                    words.push(format!("euler:{a}{b}{c}"));
                    words.push(
                        format!("euler:{a}{b}{c}")
                            .to_uppercase()
                            .replace("EULER", "euler"),
                    );
                }
            }
        }
        words
            .iter()
            .map(|word| Convention::named(word).unwrap())
            .collect()
    }

    proptest! {
        #[test]
        fn a_rotation_comes_back_from_its_numbers(
            axis in prop::array::uniform3(-1.0..1.0f64), angle in -PI..PI,
        ) {
            let axis = Unit::try_new(Vector3::from(axis), 1e-3).unwrap_or(Vector3::x_axis());
            let rotation = UnitQuaternion::from_axis_angle(&axis, angle);
            for convention in all() {
                let values = convention.values(&rotation);
                prop_assert_eq!(values.len(), convention.count());
                let back = convention.rotation(&values).unwrap();
                let apart = (back.inverse() * rotation).imag().norm();
                prop_assert!(apart < 1e-7, "{}: {:?} {}", convention, values, apart);
            }
        }

        #[test]
        fn where_two_axes_fall_together_it_comes_back_too(
            first in -PI..PI, last in -PI..PI, quarter in -2..3i32,
        ) {
            for convention in all().into_iter().filter(|c| matches!(c, Convention::Euler { .. })) {
                let middle = f64::from(quarter) * PI / 2.0;
                let rotation = convention.rotation(&[first, middle, last]).unwrap();
                let back = convention.rotation(&convention.values(&rotation)).unwrap();
                let apart = (back.inverse() * rotation).imag().norm();
                prop_assert!(apart < 1e-7, "{}: {} {}", convention, middle, apart);
            }
        }
    }
}
