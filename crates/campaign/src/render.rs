//! A campaign's table as text.

use super::columns::Role;
use super::{Campaign, Reading, Split};
use csv::WriterBuilder;
use std::collections::BTreeSet;
use std::io;

/// The table of a campaign, with only the columns that some reading fills.
///
/// Numbers have as many digits as it takes to read back the very same ones.
pub(super) fn render(campaign: &Campaign) -> io::Result<Vec<u8>> {
    columns(campaign, |_| true)
}

/// The same without what the instruments read: what is to be commanded, for readings still to be taken.
///
/// # Errors
/// If a number cannot be written.
pub fn render_commands(campaign: &Campaign) -> io::Result<Vec<u8>> {
    columns(campaign, |role| {
        !matches!(
            role,
            Role::Position(_) | Role::Orientation(_) | Role::Wrench(_)
        )
    })
}

/// The wanted columns that some reading fills.
fn columns(campaign: &Campaign, wanted: impl Fn(Role) -> bool) -> io::Result<Vec<u8>> {
    let robot = &campaign.robot;
    let roles: Vec<Role> = Role::all(robot)
        .into_iter()
        .filter(|role| wanted(*role))
        .filter(|role| match role {
            Role::Target => campaign.targets.len() > 1,
            Role::Split => campaign.readings.iter().any(|r| r.split != Split::Fit),
            Role::Joint(_) | Role::Position(_) => true,
            _ => campaign
                .readings
                .iter()
                .any(|reading| !cell(campaign, reading, *role).is_empty()),
        })
        .collect();
    let headers: Vec<String> = roles.iter().map(|role| role.header(robot)).collect();
    let mut seen = BTreeSet::new();
    if let Some(twice) = headers.iter().find(|header| !seen.insert(*header)) {
        return Err(io::Error::other(format!(
            "two columns would be called `{twice}`; rename the joint or link in the robot file"
        )));
    }
    let mut writer = WriterBuilder::new().from_writer(Vec::new());
    writer.write_record(&headers)?;
    for reading in &campaign.readings {
        writer.write_record(roles.iter().map(|role| cell(campaign, reading, *role)))?;
    }
    writer
        .into_inner()
        .map_err(|error| io::Error::other(error.to_string()))
}

/// What stands in one cell; empty if the reading has no such part.
fn cell(campaign: &Campaign, reading: &Reading, role: Role) -> String {
    let number = |x: f64| format!("{x:?}");
    let optional = |x: Option<f64>| x.map(number).unwrap_or_default();
    match role {
        Role::Pose => reading.pose.clone().unwrap_or_default(),
        Role::Repeat => reading.repeat.clone().unwrap_or_default(),
        Role::Target => campaign.targets[reading.target].name.clone(),
        Role::Split => match reading.split {
            Split::Fit => "fit".into(),
            Split::Heldout => "heldout".into(),
        },
        Role::Time => optional(reading.time),
        Role::Temperature => optional(reading.temperature),
        Role::LinkTemperature(link) => optional(
            reading
                .link_temperatures
                .iter()
                .find(|(index, _)| *index == link)
                .map(|(_, value)| *value),
        ),
        Role::Joint(joint) => number(reading.joints[joint]),
        Role::Approach(joint) => reading
            .approach
            .as_ref()
            .map(|approach| format!("{}", approach[joint]))
            .unwrap_or_default(),
        Role::Position(axis) => number(reading.position[axis]),
        // nalgebra keeps quaternions as (x, y, z, w).
        Role::Orientation(axis) => optional(
            reading
                .orientation
                .map(|q| q.coords[if axis == 0 { 3 } else { axis - 1 }]),
        ),
        Role::Wrench(axis) => optional(reading.wrench.map(|w| match axis {
            0..3 => w.force[axis],
            _ => w.torque[axis - 3],
        })),
        Role::PayloadMass => optional(reading.payload.map(|p| p.mass)),
        Role::PayloadCentre(axis) => optional(reading.payload.map(|p| p.com[axis])),
    }
}
