//! A scenario that is another one but for a few keys.

use super::read_text;
use crate::input;
use crate::scenario::ScenarioError;
use std::path::Path;

/// A scenario with `like = "other.toml"` is the other one but for what it says itself: keys of its tables replace those
/// of the same table there. Both texts make its text.
pub(super) fn layered(
    path: &Path,
    mut own: toml::Table,
    text: String,
) -> Result<(toml::Table, String), ScenarioError> {
    let form = |message: String| ScenarioError::form(&path.display().to_string(), message);
    let like = match own.remove("like") {
        None => return Ok((own, text)),
        Some(toml::Value::String(like)) => like,
        Some(other) => {
            return Err(form(format!(
                "like is {other}; accepted: the name of another scenario in the same folder"
            )));
        }
    };
    if Path::new(&like).components().count() != 1 {
        return Err(form(format!(
            "like = \"{like}\"; accepted: the name of another scenario in the same folder"
        )));
    }
    let other = path.with_file_name(&like);
    let below = read_text(&other)?;
    let in_other = |message| ScenarioError::form(&other.display().to_string(), message);
    let mut all: toml::Table = input::toml(&below).map_err(in_other)?;
    if all.contains_key("like") {
        return Err(form(format!(
            "like = \"{like}\", which is like another one itself; accepted: one that is not"
        )));
    }
    for (key, value) in own {
        match (all.get_mut(&key), value) {
            (Some(toml::Value::Table(below)), toml::Value::Table(above)) => below.extend(above),
            (_, value) => {
                all.insert(key, value);
            }
        }
    }
    Ok((all, format!("{below}\n# but for:\n{text}")))
}
