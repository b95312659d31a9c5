//! The algebra: its axioms, nalgebra's isometries as an oracle, and virtual work.

use crate::common::{random, sda5f};
use misfit_arm::dual_quaternion::{DualQuaternion, Scalar, Vector8, rotation_exp, rotation_vector};
use misfit_core::posture::{Kind, Slots};
use misfit_core::statics::Statics;
use nalgebra::{Isometry3, Matrix6, Quaternion, SMatrix, SVector, Vector3, Vector6};
use num_dual::{Derivative, DualSVec64};
use proptest::prelude::*;
use std::f64::consts::PI;

type Motion = DualQuaternion<f64>;
type Dual<const N: usize> = DualSVec64<N>;

/// A dozen products of numbers below 5: some hundred roundings of 1e-16 each.
const ROUNDING: f64 = 1e-13;

fn vector(size: f64) -> impl Strategy<Value = Vector3<f64>> {
    [-size..size, -size..size, -size..size].prop_map(Vector3::from)
}

fn direction() -> impl Strategy<Value = Vector3<f64>> {
    let long_enough = |v: &Vector3<f64>| v.norm() > 0.1;
    vector(1.0)
        .prop_filter("a direction", long_enough)
        .prop_map(|v| v.normalize())
}

/// Angles from nothing to just short of a half turn, the extremes as often as the rest.
fn angle() -> impl Strategy<Value = f64> {
    let logarithmic = || (-9.0..-3.0).prop_map(|x: f64| 10f64.powf(x));
    prop_oneof![
        Just(0.0),
        logarithmic(),
        1e-3..3.1,
        logarithmic().prop_map(|x| PI - x),
    ]
}

fn twist() -> impl Strategy<Value = Vector6<f64>> {
    (vector(3.0), direction(), angle()).prop_map(|(v, axis, angle)| {
        let w = axis * angle;
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    })
}

fn isometry() -> impl Strategy<Value = Isometry3<f64>> {
    (vector(3.0), direction(), angle()).prop_map(|(v, axis, angle)| Isometry3::new(v, axis * angle))
}

fn motion() -> impl Strategy<Value = Motion> {
    isometry().prop_map(|isometry| Motion::from_isometry(&isometry))
}

/// Any dual quaternion, a rigid motion or not.
fn any() -> impl Strategy<Value = Motion> {
    proptest::array::uniform8(-2.0..2.0).prop_map(|x| Motion {
        real: Quaternion::new(x[0], x[1], x[2], x[3]),
        dual: Quaternion::new(x[4], x[5], x[6], x[7]),
    })
}

/// Largest difference of the eight numbers.
fn numbers_apart(a: &Motion, b: &Motion) -> f64 {
    (a.to_vector() - b.to_vector()).amax()
}

/// Largest difference of the matrix elements: q and -q are the same motion.
fn apart(a: &Motion, b: &Motion) -> f64 {
    (a.to_isometry().to_homogeneous() - b.to_isometry().to_homogeneous()).amax()
}

fn unit_error(q: &Motion) -> f64 {
    let (length, tangent) = q.unit_error();
    length.abs().max(tangent.abs())
}

/// Numbers with unit derivatives, one direction each.
fn seeded<const N: usize>(x: &SVector<f64, N>) -> SVector<Dual<N>, N> {
    let along = |k: usize| SVector::from_fn(|row, _| if row == k { 1.0 } else { 0.0 });
    SVector::from_fn(|k, _| Dual::new(x[k], Derivative::some(along(k))))
}

fn derivatives<const N: usize>(x: &Dual<N>) -> SVector<f64, N> {
    x.eps.unwrap_generic(nalgebra::Const, nalgebra::Const)
}

proptest! {
    // a failure prints its input; no file to keep
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn products_are_associative(a in any(), b in any(), c in any()) {
        prop_assert!(numbers_apart(&((a * b) * c), &(a * (b * c))) < ROUNDING);
    }

    #[test]
    fn conjugates_turn_products_round_or_keep_them(a in any(), b in any()) {
        let product = a * b;
        prop_assert!(numbers_apart(&product.conjugate(), &(b.conjugate() * a.conjugate())) < ROUNDING);
        prop_assert!(numbers_apart(&product.dual_conjugate(), &(a.dual_conjugate() * b.dual_conjugate())) < ROUNDING);
        prop_assert!(numbers_apart(&product.point_conjugate(), &(b.point_conjugate() * a.point_conjugate())) < ROUNDING);
        prop_assert_eq!(a.conjugate().conjugate(), a);
        prop_assert_eq!(a.dual_conjugate().dual_conjugate(), a);
    }

    #[test]
    fn the_conjugate_of_a_motion_undoes_it(q in motion()) {
        prop_assert!(numbers_apart(&(q * q.conjugate()), &Motion::identity()) < ROUNDING);
        prop_assert!(numbers_apart(&(q.conjugate() * q), &Motion::identity()) < ROUNDING);
    }

    #[test]
    fn motions_stay_motions(a in motion(), b in motion(), twist in twist()) {
        prop_assert!(unit_error(&(a * b)) < ROUNDING);
        prop_assert!(unit_error(&Motion::exp(&twist)) < ROUNDING);
    }

    #[test]
    fn the_nearest_motion_is_one_and_of_a_motion_itself(q in any(), m in motion()) {
        prop_assume!(q.real.norm() > 0.1);
        prop_assert!(unit_error(&q.normalized()) < ROUNDING);
        prop_assert!(numbers_apart(&m.normalized(), &m) < ROUNDING);
    }

    #[test]
    fn exp_undoes_log(q in motion()) {
        prop_assert!(apart(&Motion::exp(&q.log()), &q) < ROUNDING);
        // -q is the same motion: its logarithm is the same, not a turn the long way round
        let minus = Motion { real: -q.real, dual: -q.dual };
        prop_assert!(apart(&Motion::exp(&minus.log()), &q) < ROUNDING);
        prop_assert!(q.log().fixed_rows::<3>(3).norm() < PI + ROUNDING);
    }

    #[test]
    fn log_undoes_exp(twist in twist()) {
        prop_assert!((Motion::exp(&twist).log() - twist).amax() < ROUNDING);
    }

    /// The six-by-six matrix of derivatives, through every branch of both functions.
    #[test]
    fn dual_numbers_pass_through_exp_and_log(twist in twist()) {
        let back = DualQuaternion::exp(&seeded(&twist)).log();
        let derivative = Matrix6::from_fn(|row, column| derivatives(&back[row])[column]);
        // just above the half angle of 1e-6 where its series ends, log divides rounding of 3 m by the angle
        prop_assert!((derivative - Matrix6::identity()).amax() < 1e-9, "{}", derivative);
    }

    #[test]
    fn rotation_vectors_are_nalgebras(v in direction(), angle in angle()) {
        let oracle = nalgebra::UnitQuaternion::from_scaled_axis(v * angle);
        let turned = rotation_exp(&(v * angle));
        prop_assert!((turned.coords - oracle.coords).amax() < ROUNDING);
        prop_assert!((rotation_vector(&turned) - v * angle).amax() < ROUNDING);
    }

    #[test]
    fn isometries_compose_alike(a in isometry(), b in isometry(), point in vector(2.0)) {
        let (p, q) = (Motion::from_isometry(&a), Motion::from_isometry(&b));
        prop_assert!(apart(&(p * q), &Motion::from_isometry(&(a * b))) < ROUNDING);
        prop_assert!(apart(&p.conjugate(), &Motion::from_isometry(&a.inverse())) < ROUNDING);
        let moved = a * nalgebra::Point3::from(point);
        prop_assert!((p.transform_point(&point) - moved.coords).amax() < ROUNDING);
        prop_assert!((p.transform_vector(&point) - a * point).amax() < ROUNDING);
        prop_assert!((p.to_isometry().to_homogeneous() - a.to_homogeneous()).amax() < ROUNDING);
    }

    /// The paper's form: `1 + ε p' = q (1 + ε p) q⁺`.
    #[test]
    fn the_sandwich_product_moves_points(q in motion(), point in vector(2.0)) {
        let dual_point = Motion { real: Quaternion::identity(), dual: Quaternion::from_imag(point) };
        let moved = q * dual_point * q.point_conjugate();
        let expected = Motion {
            real: Quaternion::identity(),
            dual: Quaternion::from_imag(q.transform_point(&point)),
        };
        prop_assert!(numbers_apart(&moved, &expected) < ROUNDING);
    }

    #[test]
    fn interpolation_follows_one_screw(a in motion(), twist in twist(), t in 0.0..1.0) {
        // short of a half turn: there the way round is anybody's choice
        prop_assume!(twist.fixed_rows::<3>(3).norm() < 3.0);
        let b = a * Motion::exp(&twist);
        prop_assert!(apart(&a.interpolate(&b, 0.0), &a) < ROUNDING);
        prop_assert!(apart(&a.interpolate(&b, 1.0), &b) < ROUNDING);
        let half = a.conjugate() * a.interpolate(&b, 0.5);
        prop_assert!(apart(&(a * half * half), &b) < ROUNDING);
        let so_far = (a.conjugate() * a.interpolate(&b, t)).log();
        prop_assert!((so_far - twist * t).amax() < ROUNDING);
        let to_go = (a.interpolate(&b, t).conjugate() * b).log();
        prop_assert!((to_go - twist * (1.0 - t)).amax() < ROUNDING);
    }

    /// `G` against differences of the eight numbers while the pose moves by `[dp; ω]`.
    #[test]
    fn rates_are_those_of_the_eight_numbers(q in motion(), dp in vector(1.0), omega in vector(1.0)) {
        let p = q.translation();
        let v = dp - omega.cross(&p);
        let about_origin = Vector6::new(v.x, v.y, v.z, omega.x, omega.y, omega.z);
        let at = |t: f64| (Motion::exp(&(about_origin * t)) * q).to_vector();
        let h = 1e-4;
        let difference = ((at(h) - at(-h)) * 8.0 - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
        let twist = Vector6::new(dp.x, dp.y, dp.z, omega.x, omega.y, omega.z);
        let rate = q.rate_from_twist() * twist;
        // rounding of the differences, 1e-15 / 1e-4; what the fourth order leaves out is 1e-16
        prop_assert!((rate - difference).amax() < 1e-10);
        prop_assert!((q.twist_from_rate(&rate) - twist).amax() < ROUNDING);
        prop_assert!((q.twist_from_rate(&difference) - twist).amax() < 1e-9);
    }

    #[test]
    fn eight_forces_do_the_work_of_six(q in motion(), f in vector(50.0), m in vector(5.0)) {
        let wrench = Vector6::new(f.x, f.y, f.z, m.x, m.y, m.z);
        let eight = q.force_from_wrench(&wrench);
        // forces of 50 N, levers of 5 m
        prop_assert!((q.rate_from_twist().transpose() * eight - wrench).amax() < 1e3 * ROUNDING);
    }
}

/// The flange of arm R1 from its eight joint angles, by products alone.
fn flange<S: Scalar>(angles: &SVector<S, 8>) -> DualQuaternion<S> {
    let setup = sda5f();
    let link = &setup.robot.links[setup.targets[0].link];
    let mut pose = DualQuaternion::identity();
    for (&joint, &angle) in setup.robot.chain(link.body).iter().zip(angles.iter()) {
        let joint = &setup.robot.joints[joint];
        let axis = joint.axis.map(misfit_arm::dual_quaternion::constant);
        pose = pose
            * DualQuaternion::from_isometry(&joint.parent_from_joint)
            * DualQuaternion::from_axis_angle(axis, angle);
    }
    pose * DualQuaternion::from_isometry(&link.body_from_link)
}

/// Joint torques of a 50 N load by virtual work: the 8-row Jacobian by dual numbers through the products, the
/// 6-row one from the joints' screws. `F₈` with `Gᵀ F₈ = w` gives the same torques; `w` written into eight
/// rows as it stands, in either order, does not.
#[test]
fn virtual_work_needs_the_right_eight_forces() {
    let setup = sda5f();
    let mut random = random(4);
    let mut statics = Statics::new(&setup);
    let still = vec![0.0; Slots::of(&setup).count];
    let chain = setup.robot.chain(setup.target_body(0));
    let (mut worst, mut naive) = (0.0f64, [f64::INFINITY; 2]);
    for _ in 0..50 {
        let joints = crate::common::posture(&setup.robot, &mut random);
        let angles = SVector::<f64, 8>::from_fn(|k, _| joints[chain[k]]);
        let pose = flange(&angles);
        let moved = flange(&seeded(&angles)).to_vector();
        let eight_rows = SMatrix::<f64, 8, 8>::from_fn(|row, k| derivatives(&moved[row])[k]);
        statics.place(&setup, &joints, &still);
        let six_rows = SMatrix::<f64, 6, 8>::from_fn(|row, k| {
            let screw = statics.screw(&setup, Kind::Joint(chain[k]), &still);
            let screw = screw.unwrap();
            if row < 3 {
                screw.at(&pose.translation())[row]
            } else {
                screw.angular[row - 3]
            }
        });
        assert!((eight_rows - pose.rate_from_twist() * six_rows).amax() < ROUNDING);

        let wrench = Vector6::new(10.0, -20.0, -45.0, 1.0, 2.0, -3.0);
        let torques = six_rows.transpose() * wrench;
        let by_eight = eight_rows.transpose() * pose.force_from_wrench(&wrench);
        worst = worst.max((by_eight - torques).amax());
        let (f, m) = (wrench.fixed_rows::<3>(0), wrench.fixed_rows::<3>(3));
        let stacked = [
            Vector8::from([0.0, f[0], f[1], f[2], 0.0, m[0], m[1], m[2]]),
            Vector8::from([0.0, m[0], m[1], m[2], 0.0, f[0], f[1], f[2]]),
        ];
        for (least, force) in naive.iter_mut().zip(stacked) {
            *least = least.min((eight_rows.transpose() * force - torques).amax());
        }
    }
    // 50 N on levers of 2 m
    assert!(worst < 100.0 * ROUNDING, "{worst:e} N·m");
    // not a matter of rounding in any of the postures
    assert!(naive.iter().all(|&least| least > 1.0), "{naive:?} N·m");
}
