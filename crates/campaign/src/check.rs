//! Whether a campaign made by a program holds together, asked before it is written.

use super::{Campaign, Frame, Reading};
use std::collections::BTreeSet;

impl Campaign {
    /// What does not hold, so that the campaign could not be read back as it is.
    ///
    /// # Errors
    /// What does not hold, in words.
    pub fn check(&self) -> Result<(), String> {
        plain_file_name(&self.robot_file.name)?;
        if self.robot_file.name == "campaign.toml" || self.robot_file.name == "readings.csv" {
            return Err(format!(
                "the robot file is called {:?}, as one of the campaign's own files; rename it",
                self.robot_file.name
            ));
        }
        if let Some(base) = &self.robot_file.base {
            plain_word("base link", base)?;
        }
        if !self.gravity.iter().all(|x| x.is_finite()) {
            return Err("gravity is not finite".into());
        }
        if self.targets.is_empty() || self.readings.is_empty() {
            return Err("it has no target or no reading".into());
        }
        let mut names = BTreeSet::new();
        for target in &self.targets {
            plain_word("target name", &target.name)?;
            if !names.insert(&target.name) {
                return Err(format!("two targets are called {:?}", target.name));
            }
            if target.link >= self.robot.links.len() {
                return Err(format!("target {:?} is on no link", target.name));
            }
        }
        if self.link_from_target.len() != self.targets.len() {
            return Err("link_from_target does not have one frame for each target".into());
        }
        for frame in self
            .link_from_target
            .iter()
            .chain([&self.base_from_tracker])
        {
            if let Frame::Known(pose) = frame
                && !(pose.translation.vector.iter().all(|x| x.is_finite())
                    && is_unit(pose.rotation.coords.norm()))
            {
                return Err(format!("a frame is not a pose: {pose}"));
            }
        }
        if let Some(noise) = &self.noise
            && let Some((key, value)) = noise
                .by_key()
                .iter()
                .find(|(_, value)| !value.is_finite() || *value < 0.0)
        {
            return Err(format!("noise {key} is {value}, not zero or more"));
        }
        self.readings
            .iter()
            .enumerate()
            .try_for_each(|(index, reading)| {
                self.check_reading(reading)
                    .map_err(|problem| format!("reading {index}: {problem}"))
            })
    }

    fn check_reading(&self, reading: &Reading) -> Result<(), String> {
        for (what, label) in [("pose", &reading.pose), ("repeat", &reading.repeat)] {
            if let Some(label) = label {
                plain_word(what, label)?;
            }
        }
        if reading.target >= self.targets.len() {
            return Err("its target does not exist".into());
        }
        let joints = self.robot.joints.len();
        if reading.joints.len() != joints {
            return Err(format!(
                "{} joint angles for {joints} joints",
                reading.joints.len()
            ));
        }
        if let Some(approach) = &reading.approach
            && (approach.len() != joints || !approach.iter().all(|x| [-1.0, 0.0, 1.0].contains(x)))
        {
            return Err("approach is not -1, 0 or 1 for each joint".into());
        }
        let links: Vec<usize> = reading.link_temperatures.iter().map(|(l, _)| *l).collect();
        if !links.is_sorted_by(|a, b| a < b)
            || links.last().is_some_and(|l| *l >= self.robot.links.len())
        {
            return Err("link temperatures are not in the order of the robot's links".into());
        }
        if let Some(q) = &reading.orientation
            && !is_unit(q.coords.norm())
        {
            return Err("its orientation is not a unit quaternion".into());
        }
        if reading.payload.is_some_and(|p| p.mass < 0.0) {
            return Err("its payload is negative".into());
        }
        let numbers = reading
            .joints
            .iter()
            .chain(&reading.position)
            .chain(&reading.time)
            .chain(&reading.temperature)
            .chain(reading.link_temperatures.iter().map(|(_, value)| value));
        let wrench = reading.wrench.iter();
        let payload = reading.payload.iter();
        let finite = numbers.copied().all(f64::is_finite)
            && wrench
                .flat_map(|w| w.force.iter().chain(&w.torque))
                .chain(payload.flat_map(|p| p.com.iter().chain([&p.mass])))
                .copied()
                .all(f64::is_finite);
        if finite {
            Ok(())
        } else {
            Err("it holds a number that is not finite".into())
        }
    }
}

fn is_unit(norm: f64) -> bool {
    (norm - 1.0).abs() <= 1e-9
}

/// A name that stays inside its folder, so that a foreign recording writes nowhere else.
///
/// # Errors
/// Why it is none, in words.
pub fn plain_file_name(name: &str) -> Result<(), String> {
    let inside = !matches!(name, "" | "." | "..") && !name.contains(['/', '\\']);
    if inside && !name.chars().any(char::is_control) {
        Ok(())
    } else {
        Err(format!("{name:?} is not a plain file name"))
    }
}

/// A label that a table's cell keeps as it is.
fn plain_word(what: &str, word: &str) -> Result<(), String> {
    if word.is_empty() || word.trim() != word || word.chars().any(char::is_control) {
        return Err(format!(
            "{what} {word:?} is empty, or has outer blanks or control characters"
        ));
    }
    Ok(())
}
