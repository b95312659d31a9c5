//! Linear torsional compliance of each joint: gear and drive wind up under the load's torque.
//!
//! ## Law
//! `dq_j = c_j τ_j`, `τ_j` the torque about joint `j` of link weights, payload and wrench **in the loaded
//! posture**. The parameter is the compliance `c_j = 1 / K_j` in rad/(N·m) (m/N for a prismatic joint), so
//! that zero is a rigid joint; reports print the stiffness `K_j` beside it.
//!
//! ## Signature
//! Proportional to the load and to `τ_j(q)`; zero between two readings of a pose under one load. A joint whose
//! axis is along gravity carries no weight, and a load on a joint's axis does not turn it: such a compliance
//! is in no reading.
//!
//! ## Confused with
//! Torsion of the link about the same axis (exactly), a uniform gain of the load. Under its own weight alone,
//! without a change of load, geometry takes up most of it.
//!
//! ## Plant
//! A hinge with `stiffness = 1 / c_j`, its spring at rest at the commanded angle; MuJoCo's own statics.
//!
//! ## Sources
//! Appl. Sci. 2019, 9, 65, eq. 19 to 35 and Tables 3 and 4; Chen, Kao 2000, *Conservative congruence
//! transformation*, IJRR 19(9).

use super::{Effect, Need, Parameter, Role, Stage, at_least_zero, by_joint};
use crate::dual_quaternion::Scalar;
use crate::plant::{PlantSpec, SpecError};
use crate::posture::Posture;
use crate::setup::Setup;
use serde::Deserialize;

/// Compliances of the observed joints.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointCompliance {}

impl Effect for JointCompliance {
    const ID: &'static str = "joint_compliance";
    const STAGE: Stage = Stage::Elastic;
    const ROLE: Option<Role> = Some(Role::Spring);
    const NEEDS: &'static [Need] = &[Need::Load];

    fn parameters(&self, setup: &Setup) -> Vec<Parameter> {
        by_joint(setup, ("rad/(N·m)", 1e-4), ("m/N", 1e-7))
            .into_iter()
            .map(|parameter| parameter.at_least(0.0))
            .collect()
    }

    fn perturb<S: Scalar>(&self, p: &[S], posture: &mut Posture<'_, S>) {
        for (&joint, &compliance) in posture.setup.observed.iter().zip(p) {
            let torque = posture.torque(joint);
            posture.move_joint(joint, compliance * torque);
        }
    }

    fn install(&self, p: &[f64], setup: &Setup, plant: &mut PlantSpec) -> Result<(), SpecError> {
        for (&joint, &compliance) in setup.observed.iter().zip(p) {
            at_least_zero(Self::ID, &setup.robot.joints[joint].name, compliance)?;
            // springs in series: their compliances add
            let before = plant.stiffness[joint].map_or(0.0, |k| 1.0 / k);
            let sum = before + compliance;
            plant.stiffness[joint] = (sum > 0.0).then(|| 1.0 / sum);
        }
        Ok(())
    }
}
