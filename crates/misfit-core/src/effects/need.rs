//! What a campaign must have for an effect to be seen in it.

use crate::campaign::{Campaign, Reading};
use nalgebra::Vector3;

/// Something that a campaign may lack.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Need {
    /// Directions of approach, more than one.
    Approach,
    /// Times of the readings.
    Time,
    /// Temperatures that vary.
    Temperature,
    /// Weights or wrenches on the joints.
    Load,
    /// Gravity: it pulls at the links or at a payload.
    Gravity,
    /// A payload of known mass.
    Payload,
    /// Wrist wrenches in readings whose payload is known too.
    WrenchBesidePayload,
    /// Orientations of the target.
    Orientation,
    /// A known length among the readings.
    ScaleBar,
}

impl Need {
    /// The end of a sentence that begins "cannot be seen: ".
    pub fn sentence(self) -> &'static str {
        match self {
            Need::Approach => {
                "needs poses approached from both sides, in columns approach_<joint> (-1, 0, +1)"
            }
            Need::Time => "needs the time of each reading, in a column time_s",
            Need::Temperature => {
                "needs temperatures that vary, in columns temperature_degC or temperature_<link>_degC"
            }
            Need::Load => "needs a load: masses of the links, a payload or a wrench",
            Need::Gravity => {
                "needs gravity, and masses of the links or a payload for it to pull at"
            }
            Need::Payload => "needs readings with a payload, in the columns payload_*",
            Need::WrenchBesidePayload => {
                "needs wrist wrenches of a known weight: wrench and payload columns in the same readings"
            }
            Need::Orientation => "needs the orientation of the target, in columns qw qx qy qz",
            Need::ScaleBar => {
                "needs a known length among the readings (a scale bar): free geometry imitates it exactly"
            }
        }
    }

    /// Does a reading say it? Of loads nothing said is no load.
    pub fn is_said(self, reading: &Reading) -> bool {
        match self {
            Need::Approach => reading.approach.is_some(),
            Need::Time => reading.time.is_some(),
            Need::Temperature => {
                reading.temperature.is_some() || !reading.link_temperatures.is_empty()
            }
            _ => true,
        }
    }

    /// Does a campaign have it?
    pub fn is_met(self, campaign: &Campaign) -> bool {
        let any = |has: fn(&Reading) -> bool| campaign.readings.iter().any(has);
        let heavy = campaign.robot.bodies.iter().any(|body| body.mass > 0.0);
        let weight = |reading: &Reading| reading.payload.is_some_and(|payload| payload.mass > 0.0);
        let pulled = campaign.gravity != Vector3::zeros();
        match self {
            Need::Approach => {
                let from = |side: f64| {
                    let approach = campaign.readings.iter().filter_map(|r| r.approach.as_ref());
                    approach.flatten().any(|&s| s * side > 0.0)
                };
                from(1.0) && from(-1.0)
            }
            Need::Time => varies(campaign.readings.iter().filter_map(|r| r.time)),
            Need::Temperature => {
                let of_links = |r: &Reading| r.link_temperatures.clone();
                varies(campaign.readings.iter().filter_map(|r| r.temperature))
                    || (0..campaign.robot.links.len()).any(|link| {
                        let all = campaign.readings.iter().flat_map(of_links);
                        varies(all.filter(|(of, _)| *of == link).map(|(_, t)| t))
                    })
            }
            Need::Load => pulled && (heavy || any(weight)) || any(|r| r.wrench.is_some()),
            Need::Gravity => pulled && (heavy || any(weight)),
            Need::Payload => any(weight),
            Need::WrenchBesidePayload => any(crate::campaign::wrench_is_measured),
            Need::Orientation => any(|r| r.orientation.is_some()),
            // the format knows no such reading
            Need::ScaleBar => false,
        }
    }
}

fn varies(mut values: impl Iterator<Item = f64>) -> bool {
    let first = values.next();
    values.any(|value| Some(value) != first)
}
