//! Identify robot arms from measurements, and say which physical effect the model lacks.
//!
//! A reading is a pose `T` of a target on the arm, measured by a tracker at joint angles `q` under a load `w`. The model
//! is the nominal robot and effects with parameters `p`:
//!
//! ```text
//! T_i = tracker_from_base · F(q_i + δ(q_i, τ_i; p), w_i; p) · link_from_target + ε_i,    ε_i ~ N(0, Σ_i)
//!
//! p̂ = argmin Σ_i ‖ Σ_i^(-1/2) · log(T_i ⊖ T̂_i(p)) ‖²          cov p̂ = (Jᵀ Σ⁻¹ J)⁺
//! ```
//!
//! with `F` the loaded equilibrium: each elastic effect displaces its frame by what it carries there. A *fit* finds `p̂`
//! with its covariance and says which directions of it the readings leave open. A *diagnosis* asks of every effect of
//! the catalogue that the model has not: what would its columns explain of what is left, beyond what the model itself
//! could absorb?
//!
//! # Example
//!
//! A table of readings and a URDF, and the cause by its name:
//!
//! ```
//! use misfit_core::{Campaign, EffectList, Options, Verdict, diagnose, fit, model_file};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let campaign = Campaign::load("../../docs/example/arm.toml".as_ref())?;
//! let model = model_file::model(&campaign, &EffectList::DEFAULT, None)?;
//! let options = Options { cross_validate: true };
//!
//! let found = fit(&campaign, &model, &options, |_| {})?;
//! let heldout = found.heldout.ok_or("too few poses")?;
//! println!("fitted {:.1e} m, held out {:.1e} m", found.fit.position_rms_m, heldout.position_rms_m);
//!
//! let missing = diagnose(&campaign, &model, &[], &options, |_| {})?;
//! assert_eq!(missing.verdict, Verdict::Named);
//! assert_eq!(missing.named, ["backlash"]);
//! # Ok(())
//! # }
//! ```
//!
//! # Map
//!
//! | module | from | to |
//! |---|---|---|
//! | [`effects`] | | the catalogue: pages, parameters, laws |
//! | [`model_file`], [`model`] | robot, effects | a model that predicts readings and their derivatives |
//! | [`fit`](mod@fit) | campaign, model | parameters, covariance, what is not identifiable, errors fitted and held out |
//! | [`diagnosis`] | campaign, model | verdict, evidence for each effect, where in the design the error lies |
//! | [`ladder`] | campaign | diagnose, add, refit, until nothing is left |
//! | [`plan`] | model, candidates | which poses to measure next |
//! | [`compensation`], [`export`], [`map`] | fit | corrected commands, a corrected robot file, the error over the workspace |
//! | [`posture`], [`statics`] | | one loaded posture, what effects push and read |
//!
//! Readings and how they are read are the crate `misfit-campaign`; robots `misfit-arm`. Units are SI and radians.

pub mod compensation;
pub mod diagnosis;
pub mod effects;
pub mod export;
pub mod findings;
pub mod fit;
pub mod ladder;
pub mod map;
pub mod model;
pub mod model_file;
pub mod plan;
pub mod posture;
pub mod statics;

use misfit_arm::{dual_quaternion, formula, input, robot};
use misfit_campaign::{self as campaign, setup, space};
use misfit_truth as plant;

pub use diagnosis::{Diagnosis, Verdict, diagnose};
pub use effects::{CATALOGUE, Effect, EffectList};
pub use fit::{Fit, Options, fit};
pub use ladder::climb;
pub use misfit_arm::robot::Robot;
pub use misfit_campaign::{Campaign, Reading};
pub use model::Model;
