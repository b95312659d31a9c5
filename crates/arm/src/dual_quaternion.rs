//! Unit dual quaternions: rigid motions and twists. Algebra only, no robot in it.
//!
//! A rigid motion with rotation `r` and translation `p` is `q = r + ε ½ p r`, `r` a unit quaternion and `p` a
//! pure one; `ε² = 0`. Products compose: `a_from_c = a_from_b * b_from_c`. Twists and wrenches are 6-vectors
//! with the linear part first: `ξ = [v; ω]`, `w = [f; m]`, so that `w · ξ` is power.
//!
//! Generic over the scalar, so that derivatives by dual numbers pass through.
//!
//! Source: the algebra of Appl. Sci. 2019, 9, 65, eq. 1 to 11 and 36 to 45, with its eq. 12, 37, 38 and 45
//! corrected: the error of a motion is `2 log(p q*)`, and a motion is moved by `exp`, never by addition.

use nalgebra::{
    Isometry3, Matrix6, Quaternion, RealField, SMatrix, SVector, Translation3, UnitQuaternion,
    Vector3, Vector6,
};
use std::ops::Mul;

/// What the algebra computes with: `f64`, or dual numbers over it.
pub trait Scalar: RealField + Copy {}
impl<T: RealField + Copy> Scalar for T {}

/// A constant of any scalar.
pub fn constant<S: Scalar>(x: f64) -> S {
    nalgebra::convert(x)
}

/// The 8 numbers of a dual quaternion: real w x y z, then dual w x y z.
pub type Vector8<S> = SVector<S, 8>;
/// Maps twists to rates of the 8 numbers.
pub type Matrix8x6<S> = SMatrix<S, 8, 6>;

/// A dual quaternion; a rigid motion if it is of unit norm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DualQuaternion<S: Scalar> {
    /// Rotation.
    pub real: Quaternion<S>,
    /// Half the translation times the rotation.
    pub dual: Quaternion<S>,
}

impl<S: Scalar> DualQuaternion<S> {
    /// No motion.
    pub fn identity() -> Self {
        Self {
            real: Quaternion::identity(),
            dual: zero(),
        }
    }

    /// First turns by `rotation`, then moves by `translation` (m).
    pub fn from_parts(translation: Vector3<S>, rotation: Quaternion<S>) -> Self {
        let p = Quaternion::from_imag(translation);
        Self {
            real: rotation,
            dual: (p * rotation) * constant::<S>(0.5),
        }
    }

    /// A translation (m).
    pub fn from_translation(translation: Vector3<S>) -> Self {
        Self::from_parts(translation, Quaternion::identity())
    }

    /// A rotation by `angle` (rad) about a unit `axis` through the origin.
    pub fn from_axis_angle(axis: Vector3<S>, angle: S) -> Self {
        let (sin, cos) = (angle * constant(0.5)).sin_cos();
        Self {
            real: Quaternion::from_parts(cos, axis * sin),
            dual: zero(),
        }
    }

    /// The same motion as an isometry.
    pub fn from_isometry(isometry: &Isometry3<f64>) -> Self {
        Self::from_parts(
            isometry.translation.vector.map(constant),
            Quaternion::from(isometry.rotation.coords.map(constant)),
        )
    }

    /// Rotation part.
    pub fn rotation(&self) -> UnitQuaternion<S> {
        UnitQuaternion::new_unchecked(self.real)
    }

    /// Translation part, m.
    pub fn translation(&self) -> Vector3<S> {
        (self.dual * self.real.conjugate()).imag() * constant::<S>(2.0)
    }

    /// `q*`: conjugates both quaternions; the inverse of a unit dual quaternion.
    pub fn conjugate(&self) -> Self {
        Self {
            real: self.real.conjugate(),
            dual: self.dual.conjugate(),
        }
    }

    /// Changes the sign of `ε` alone.
    pub fn dual_conjugate(&self) -> Self {
        Self {
            real: self.real,
            dual: -self.dual,
        }
    }

    /// Both conjugations at once; `q p q⁺` moves the point `p = 1 + ε (x i + y j + z k)`.
    pub fn point_conjugate(&self) -> Self {
        self.conjugate().dual_conjugate()
    }

    /// Moves a point.
    pub fn transform_point(&self, point: &Vector3<S>) -> Vector3<S> {
        self.transform_vector(point) + self.translation()
    }

    /// Turns a free vector.
    pub fn transform_vector(&self, vector: &Vector3<S>) -> Vector3<S> {
        let u = self.real.imag();
        let t = u.cross(vector) * constant::<S>(2.0);
        vector + t * self.real.scalar() + u.cross(&t)
    }

    /// How far from a rigid motion: `(|r|² - 1, 2 r·d)`, both zero on the unit manifold.
    pub fn unit_error(&self) -> (S, S) {
        (
            self.real.norm_squared() - S::one(),
            self.real.dot(&self.dual) * constant::<S>(2.0),
        )
    }

    /// The nearest rigid motion: unit real part, dual part made perpendicular to it.
    pub fn normalized(&self) -> Self {
        let norm = self.real.norm();
        let real = self.real / norm;
        let dual = self.dual / norm;
        Self {
            real,
            dual: dual - real * real.dot(&dual),
        }
    }

    /// The motion reached by following the constant twist `[v; ω]` for unit time.
    pub fn exp(twist: &Vector6<S>) -> Self {
        let half: S = constant(0.5);
        let v = twist.fixed_rows::<3>(0) * half;
        let w = twist.fixed_rows::<3>(3) * half;
        // exp(w + ε v): with φ = |w|, derivative of (cos φ, w sin φ / φ) along v
        let phi2 = w.norm_squared();
        let dot = w.dot(&v);
        let (cos, sinc, dsinc) = sinc_series(phi2);
        Self {
            real: Quaternion::from_parts(cos, w * sinc),
            dual: Quaternion::from_parts(-sinc * dot, v * sinc + w * (dsinc * dot)),
        }
    }

    /// The twist `[v; ω]` with `exp(log(q)) = q` and `|ω| ≤ π`.
    pub fn log(&self) -> Vector6<S> {
        // of q and -q, the same motion, take the one with the smaller angle
        let sign = if self.real.scalar() < S::zero() {
            -S::one()
        } else {
            S::one()
        };
        let real = self.real * sign;
        let dual = self.dual * sign;
        let u = real.imag();
        let sin2 = u.norm_squared();
        let two: S = constant(2.0);
        let (w, v);
        if sin2 < constant(1e-12) {
            // asin(s)/s = 1 + s²/6 + 3 s⁴/40; its derivative by s², 1/6 + 3 s²/20
            let ratio = S::one() + sin2 / constant(6.0) + sin2 * sin2 * constant(0.075);
            let slope = constant::<S>(1.0 / 6.0) + sin2 * constant(0.15);
            w = u * ratio;
            v = dual.imag() * ratio + u * (slope * two * u.dot(&dual.imag()));
        } else {
            let sin = sin2.sqrt();
            let phi = sin.atan2(real.scalar());
            let axis = u / sin;
            // r = (cos φ, n sin φ), d its derivative along v: v = n φ' + n' φ
            let along = axis.dot(&dual.imag());
            let phi_rate = along * real.scalar() - sin * dual.scalar();
            w = axis * phi;
            v = axis * phi_rate + (dual.imag() - axis * along) * (phi / sin);
        }
        let (v, w) = (v * two, w * two);
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    /// Screw linear interpolation: from `self` at `t = 0` to `other` at `t = 1` along one screw.
    pub fn interpolate(&self, other: &Self, t: S) -> Self {
        *self * Self::exp(&((self.conjugate() * *other).log() * t))
    }

    /// The 8 numbers: real w x y z, dual w x y z.
    pub fn to_vector(&self) -> Vector8<S> {
        let (r, d) = (self.real, self.dual);
        Vector8::from([r.w, r.i, r.j, r.k, d.w, d.i, d.j, d.k])
    }

    /// `G` (8×6) with `dq = G ξ`, `ξ = [dp; ω]`: velocity of the moved origin and angular velocity, both in
    /// the frame moved into. A row Jacobian of 8 is `G J` of the 6-row twist Jacobian `J`.
    ///
    /// Source: corrected form of Appl. Sci. 2019, 9, 65, eq. 10 to 18.
    pub fn rate_from_twist(&self) -> Matrix8x6<S> {
        let half: S = constant(0.5);
        let p = Quaternion::from_imag(self.translation());
        let mut g = Matrix8x6::zeros();
        for k in 0..3 {
            let e = Quaternion::from_imag(Vector3::ith(k, S::one()));
            let turned = (e * self.real) * half;
            let linear = turned;
            let swept = (p * turned) * half;
            for (row, value) in [linear.w, linear.i, linear.j, linear.k]
                .into_iter()
                .enumerate()
            {
                g[(4 + row, k)] = value;
                g[(row, 3 + k)] = value;
            }
            for (row, value) in [swept.w, swept.i, swept.j, swept.k].into_iter().enumerate() {
                g[(4 + row, 3 + k)] = value;
            }
        }
        g
    }

    /// The twist `[dp; ω]` that makes the rates `dq` of the 8 numbers: the inverse of `G` on its range.
    pub fn twist_from_rate(&self, rate: &Vector8<S>) -> Vector6<S> {
        let real = Quaternion::new(rate[0], rate[1], rate[2], rate[3]);
        let dual = Quaternion::new(rate[4], rate[5], rate[6], rate[7]);
        let two: S = constant(2.0);
        let omega = (real * self.real.conjugate()).imag() * two;
        // p = 2 d r*, so dp = 2 (d' r* + d r'*)
        let velocity = (dual * self.real.conjugate() + self.dual * real.conjugate()).imag() * two;
        Vector6::new(
            velocity.x, velocity.y, velocity.z, omega.x, omega.y, omega.z,
        )
    }
}

impl DualQuaternion<f64> {
    /// The same motion as an isometry.
    pub fn to_isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::from(self.translation()),
            UnitQuaternion::from_quaternion(self.real),
        )
    }

    /// The 8-row force that does the same work as the wrench `w = [f; m]` at the moved origin:
    /// `Gᵀ F₈ = w`, of all solutions the shortest.
    ///
    /// Source: what eq. 14 to 18 of Appl. Sci. 2019, 9, 65 intend.
    pub fn force_from_wrench(&self, wrench: &Vector6<f64>) -> Vector8<f64> {
        let g = self.rate_from_twist();
        let gram: Matrix6<f64> = g.transpose() * g;
        // G has full column rank for every unit dual quaternion
        match gram.cholesky() {
            Some(factor) => g * factor.solve(wrench),
            None => Vector8::from_element(f64::NAN),
        }
    }
}

impl<S: Scalar> Mul for DualQuaternion<S> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        Self {
            real: self.real * other.real,
            dual: self.real * other.dual + self.dual * other.real,
        }
    }
}

/// The rotation vector (rad) of a unit quaternion, of length ≤ π.
pub fn rotation_vector<S: Scalar>(rotation: &Quaternion<S>) -> Vector3<S> {
    let motion = DualQuaternion {
        real: *rotation,
        dual: zero(),
    };
    motion.log().fixed_rows::<3>(3).into_owned()
}

/// The unit quaternion that turns by a rotation vector (rad).
pub fn rotation_exp<S: Scalar>(vector: &Vector3<S>) -> Quaternion<S> {
    let w = vector * constant::<S>(0.5);
    let (cos, sinc, _) = sinc_series(w.norm_squared());
    Quaternion::from_parts(cos, w * sinc)
}

fn zero<S: Scalar>() -> Quaternion<S> {
    Quaternion::new(S::zero(), S::zero(), S::zero(), S::zero())
}

/// `cos φ`, `sin φ / φ` and `(cos φ - sin φ / φ) / φ²`, smooth through `φ² = 0`.
fn sinc_series<S: Scalar>(phi2: S) -> (S, S, S) {
    if phi2 < constant(1e-6) {
        // Taylor to φ⁴: the first term left out is below 1e-21
        let phi4 = phi2 * phi2;
        (
            S::one() - phi2 * constant(0.5) + phi4 / constant(24.0) - phi4 * phi2 / constant(720.0),
            S::one() - phi2 / constant(6.0) + phi4 / constant(120.0),
            constant::<S>(-1.0 / 3.0) + phi2 / constant(30.0) - phi4 / constant(840.0),
        )
    } else {
        let phi = phi2.sqrt();
        let (sin, cos) = phi.sin_cos();
        let sinc = sin / phi;
        (cos, sinc, (cos - sinc) / phi2)
    }
}
