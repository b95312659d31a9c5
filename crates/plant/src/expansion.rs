//! Thermal expansion: bodies grow about the joint that moves them.
//!
//! What hangs on a body (joints, targets' links, its centre of mass) moves outwards by `α ΔT` of its distance,
//! in MuJoCo's own tree.

use super::{Carried, PlantError, PlantSpec, mjcf};
use crate::mujoco::{Data, Kind, Model, MujocoError};
use nalgebra::Vector3;

/// One place that moves when its body grows, per kelvin.
pub(super) struct Growing {
    /// MuJoCo's body.
    body: usize,
    /// Its place at the mean temperature, m.
    cold: Vector3<f64>,
    /// Movement per kelvin, m/K.
    rate: Vector3<f64>,
    /// How that rate changes, 1/K.
    curvature: f64,
    /// A centre of mass, or a body's origin.
    is_com: bool,
}

/// All places that move; none without expansion.
pub(super) fn find(spec: &PlantSpec, model: &Model) -> Result<Vec<Growing>, PlantError> {
    let mut all = Vec::new();
    if spec.expansion == 0.0 {
        return Ok(all);
    }
    let mut push = |name: &str, from_origin: Vector3<f64>, is_com: bool| {
        let body = model.find(Kind::Body, name)?;
        let cold = match is_com {
            true => from_origin,
            false => model.body_pos(body)?,
        };
        all.push(Growing {
            body,
            cold,
            rate: from_origin * spec.expansion,
            curvature: spec.expansion_curvature,
            is_com,
        });
        Ok::<(), MujocoError>(())
    };
    for (index, body) in spec.robot.bodies.iter().enumerate() {
        push(&mjcf::body_name(spec, index), body.com, true)?;
    }
    for (index, joint) in spec.robot.joints.iter().enumerate() {
        let before = |flexure: &super::Flexure| flexure.carries == Carried::Joint(index);
        let name = match spec.flexures.iter().position(before) {
            Some(flexure) => mjcf::flexure_name(flexure),
            None => mjcf::moved_name(spec, index + 1),
        };
        push(&name, joint.parent_from_joint.translation.vector, false)?;
    }
    for (target, (link, _)) in spec.targets.iter().enumerate() {
        let place = spec.robot.links[*link].body_from_link.translation.vector;
        push(&mjcf::load_name(spec, target), place, false)?;
    }
    Ok(all)
}

/// Moves everything to where it is at a temperature above the mean, K.
pub(super) fn grow(
    data: &mut Data,
    growing: &[Growing],
    temperature: f64,
) -> Result<(), MujocoError> {
    for place in growing {
        let warmth = temperature * (1.0 + place.curvature * temperature);
        let at = place.cold + place.rate * warmth;
        if place.is_com {
            data.set_body_ipos(place.body, at)?;
        } else {
            data.set_body_pos(place.body, at)?;
        }
    }
    Ok(())
}
