//! Reading a campaign from its files.

use super::delimited::Delimited;
use super::document::{Document, SplitRule};
use super::error::CampaignError;
use super::layout::Layout;
use super::mapping::Context;
#[cfg(feature = "xlsx")]
use super::workbook::Workbook;
use super::{Campaign, Reading, RobotFile, split, table};
use crate::input::{self, InputError, LARGEST_TABLE, LARGEST_TOML};
use crate::robot::Robot;
use std::fs::File;
use std::path::Path;

/// A campaign of its `.toml` file with its CSV table and robot; see [`Campaign::load`].
pub(super) fn load_toml(path: &Path) -> Result<Campaign, CampaignError> {
    let file = path.display().to_string();
    let folder = path.parent().unwrap_or(Path::new(""));
    let document = Document::parse(&file, &read_toml(path, &file)?)?;
    let robot_path = folder.join(&document.robot);
    let (robot, robot_text) = Robot::load_with_text(&robot_path, document.base.as_deref())?;
    let settings = document.settle(&file, &robot)?;

    let Some(layout) = &settings.layout else {
        return Err(CampaignError::Key {
            file,
            key: "table".into(),
            found: "nothing".into(),
            accepted: "the path of a CSV table, relative to this file".into(),
        });
    };
    let table_path = folder.join(&layout.file);
    let table_file = table_path.display().to_string();
    let context = Context {
        file: &table_file,
        robot: &robot,
        targets: &settings.targets,
        split_column: match &settings.split {
            SplitRule::Column(name) => Some(name),
            _ => None,
        },
        with_joints: true,
        layout,
        mapping: settings.mapping.as_ref(),
    };
    let table::Table {
        mut readings,
        warnings,
        notes,
        ..
    } = parse(&context, &table_path)?;
    if let SplitRule::Fraction(fraction, seed) = settings.split {
        split::draw(&mut readings, fraction, seed);
    }
    Ok(Campaign {
        name: file_name(path),
        robot_file: RobotFile {
            name: file_name(&robot_path),
            text: robot_text,
            base: document.base,
        },
        robot,
        gravity: settings.gravity,
        targets: settings.targets,
        base_from_tracker: settings.base_from_tracker,
        link_from_target: settings.link_from_target,
        noise: settings.noise,
        readings,
        warnings,
        notes,
    })
}

/// Reads a table in whatever it is written.
fn parse(context: &Context<'_>, path: &Path) -> Result<table::Table, CampaignError> {
    if context.layout.is_workbook() {
        return parse_workbook(context, path);
    }
    let input = open_table(path, context.file)?;
    table::parse(
        context,
        &mut Delimited::new(context.file, context.layout, input)?,
    )
}

#[cfg(feature = "xlsx")]
fn parse_workbook(context: &Context<'_>, path: &Path) -> Result<table::Table, CampaignError> {
    table::parse(
        context,
        &mut Workbook::open(path, context.file, context.layout)?,
    )
}

#[cfg(not(feature = "xlsx"))]
fn parse_workbook(context: &Context<'_>, _path: &Path) -> Result<table::Table, CampaignError> {
    Err(CampaignError::Key {
        file: context.file.into(),
        key: "table".into(),
        found: "a workbook".into(),
        accepted: "a CSV table: this program was built without the feature xlsx".into(),
    })
}

/// Tasks from a table with the columns of a campaign's: poses to be reached, and under which load. Joints, where they
/// have columns, are the posture to stay near. A wrench beside a payload pulls besides its weight.
///
/// # Errors
/// As [`Campaign::load`].
pub fn read_tasks(path: &Path, campaign: &Campaign) -> Result<Tasks, CampaignError> {
    let file = path.display().to_string();
    let layout = Layout::plain(&file);
    let context = Context {
        file: &file,
        robot: &campaign.robot,
        targets: &campaign.targets,
        split_column: None,
        with_joints: false,
        layout: &layout,
        mapping: None,
    };
    let table::Table {
        mut readings,
        has_joints,
        mut warnings,
        ..
    } = parse(&context, path)?;
    if !has_joints {
        // no posture is named at all: then none is taken to stay at zero
        warnings.retain(|warning| !warning.contains(table::NO_COLUMN));
    }
    for task in &mut readings {
        if task.payload.is_some() {
            task.process = task.wrench.take();
        }
    }
    Ok(Tasks {
        readings,
        has_joints,
        warnings,
    })
}

/// A table of tasks.
#[derive(Debug, Clone)]
pub struct Tasks {
    /// The poses, as if they were readings.
    pub readings: Vec<Reading>,
    /// Does the table name a posture?
    pub has_joints: bool,
    /// What the user has to be told.
    pub warnings: Vec<String>,
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default()
}

fn open_table(path: &Path, file: &str) -> Result<File, CampaignError> {
    input::open(path, LARGEST_TABLE).map_err(|source| unread(file, source))
}

/// Reads a campaign file or what is written like one; `file` names it in messages.
///
/// # Errors
/// If it cannot be read, is too large, or is not UTF-8.
pub fn read_toml(path: &Path, file: &str) -> Result<String, CampaignError> {
    input::text(path, LARGEST_TOML).map_err(|source| unread(file, source))
}

fn unread(file: &str, source: InputError) -> CampaignError {
    CampaignError::Read {
        file: file.into(),
        source,
    }
}
