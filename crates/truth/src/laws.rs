//! What effects hang into the plant beside springs, flexures and moved bodies: laws by command.

use crate::{Command, Load};
use misfit_campaign::Wrench;
use nalgebra::Isometry3;
use std::sync::Arc;

/// Adds to the joint angles that a command asks for: `law(command, angles)`, the positions of drives behind them.
pub type CommandLaw = Arc<dyn Fn(&Command, &mut [f64]) + Send + Sync>;

/// Adds to the torques on the joints, N·m (N): `law(rest, angles, torques)`, all by joint, where `rest` is
/// the command after its laws and `angles` where the joints are. On rigid joints it turns nothing.
pub type TorqueLaw = Arc<dyn Fn(&[f64], &[f64], &mut [f64]) + Send + Sync>;

/// Adds to where the joints' springs are at rest, for the torque that they bear in equilibrium:
/// `law(command, torques, angles)`, all by joint and then by drive, N·m and rad (N and m). Rigid joints move too.
pub type WindupLaw = Arc<dyn Fn(&Command, &[f64], &mut [f64]) + Send + Sync>;

/// Changes a load from what is stated of it to what hangs there: `law(command, load)`.
pub type LoadLaw = Arc<dyn Fn(&Command, &mut Load) + Send + Sync>;

/// Moves the tracker: `law(command, base_from_tracker)`.
pub type TrackerLaw = Arc<dyn Fn(&Command, &mut Isometry3<f64>) + Send + Sync>;

/// Changes the wrench on a wrist, in its link's frame, to what the sensor there says.
pub type SensorLaw = Arc<dyn Fn(&mut Wrench) + Send + Sync>;
