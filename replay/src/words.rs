//! Texts: what is shown and what its colours are; the verdict.

use crate::Scene;
use crate::log::Logged;
use misfit_campaign::Split;
use rerun::{RecordingStream, TextDocument};
use std::fmt::Write;

/// A length with its unit, three digits.
pub fn millimetres(metres: f64) -> String {
    let value = metres * 1e3;
    if value == 0.0 {
        return "0 mm".to_owned();
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(0, 6) as usize;
    let text = format!("{value:.decimals$}");
    let text = match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.'),
        false => &text,
    };
    format!("{text} mm")
}

/// Sends the texts.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    let about = TextDocument::from_markdown(about(scene));
    stream.log_static("about", &about)?;
    if let Some(verdict) = verdict(scene) {
        stream.log_static("verdict", &TextDocument::from_markdown(verdict))?;
    }
    Ok(())
}

/// The verdict, if there is one.
pub fn verdict<'a>(scene: &'a Scene<'_>) -> Option<&'a str> {
    let results = scene.recording.results.as_ref()?;
    (!results.verdict.trim().is_empty()).then_some(&results.verdict)
}

#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
fn about(scene: &Scene) -> String {
    let campaign = &scene.recording.campaign;
    let count = campaign.readings.len();
    let heldout = campaign.readings.iter();
    let heldout = heldout.filter(|r| r.split == Split::Heldout).count();
    let targets: Vec<String> = scene
        .targets()
        .map(|(_, name, link)| format!("{name} on {}", campaign.robot.links[link].name))
        .collect();
    let what = if scene.commands() {
        "commands"
    } else {
        "readings"
    };
    let mut text = format!(
        "# {}\n\nrobot **{}** · {count} {what}{} · {}\n\n",
        campaign.name,
        campaign.robot.name,
        match heldout {
            0 => String::new(),
            some => format!(", {some} held out"),
        },
        targets.join(", ")
    );
    // writing to a string cannot fail
    let mut line = |words: String| {
        let _ = writeln!(text, "{words}");
    };
    let fitted = scene.recording.results.is_some();
    if fitted {
        line("| step | fitted, rms | held out, rms |\n|---|---|---|".to_owned());
        for step in &scene.steps {
            let heldout = step.rms.1.map_or("—".to_owned(), millimetres);
            line(format!(
                "| {} | {} | {heldout} |",
                step.name,
                millimetres(step.rms.0)
            ));
        }
        line(String::new());
    }
    line("## Time\n".to_owned());
    line("- `reading`, `time`: reading by reading, their numbers and their seconds; robots, loads and curves move.".to_owned());
    if scene.steps.len() > 1 {
        line("- `step`: the ladder's steps; colours, arrows and charts follow. The scale stays that of step 0.".to_owned());
    }
    line("\n## In the cell\n".to_owned());
    line("- In the robot file's colours: the nominal robot at its encoder angles.".to_owned());
    if fitted {
        line(format!(
            "- Orange: the fitted robot; hidden at first: `{}`, its deviation from the nominal one {} times as large, sky blue.",
            crate::robots::magnified(scene),
            scene.robot_magnification
        ));
    }
    match scene.steps.first() {
        Some(_) => {
            line(format!(
                "- Points: where the targets were measured, coloured by position error, 0 to {}.",
                millimetres(scene.worst)
            ));
            line(format!(
                "- Arrows: measured less predicted, **{} times** as large.",
                scene.magnification
            ));
            line(
                "- Of the current reading: measured (green), by the nominal robot (grey)"
                    .to_owned()
                    + if fitted { ", fitted (orange)." } else { "." },
            );
        }
        None if scene.commands() => {
            line("- Nothing was measured: these are commands.".to_owned());
        }
        None => line(
            "- Readings are not drawn: their few postures do not tell where the tracker stands."
                .to_owned(),
        ),
    }
    if !fitted && !scene.steps.is_empty() {
        line("- There is no fit in this recording: the tracker stands where the nominal robot and the readings put it, \
              in closed form, and errors are of that."
            .to_owned());
    }
    line("- At the wrists: measured force (vermilion, N) and torque (purple, N·m), weight of the payload (yellow, N), in \
          the nominal link's frame.".to_owned());
    line("\nPositions are drawn in single precision, 0.1 µm at 1 m.".to_owned());
    text
}

#[cfg(test)]
mod tests {
    use super::millimetres;

    #[test]
    fn lengths_have_three_digits() {
        for (metres, text) in [
            (0.0, "0 mm"),
            (2.27e-3, "2.27 mm"),
            (2e-3, "2 mm"),
            (2.443e-5, "0.0244 mm"),
            (0.5, "500 mm"),
        ] {
            assert_eq!(millimetres(metres), text);
        }
    }
}
