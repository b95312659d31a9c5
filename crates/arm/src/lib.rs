//! Robot arms as data: URDF and DH files, dual quaternions, formulas; files of others, opened with limits.
//!
//! [`robot::Robot`] is the nominal robot, read once and never changed. [`dual_quaternion`] has the algebra of rigid
//! motions and twists, [`formula`] turns text into numbers and slopes, and [`input`] is the one place where files that
//! others wrote are opened.

pub mod dual_quaternion;
pub mod formula;
pub mod input;
pub mod robot;
