//! Readings as points coloured by their error, residual arrows magnified, and the frames of the current reading.

use crate::Scene;
use crate::log::{Logged, beginning, everywhere, fixed, moving, path, steps, xyz};
use crate::robots::{ORANGE, SKY};
use misfit_campaign::Split;
use misfit_report::plot;
use rerun::{Arrows3D, Color, Points3D, Radius, RecordingStream, TransformAxes3D};

/// Colour of what was measured.
pub const GREEN: [u8; 3] = [0, 200, 140];
/// Colour of what the nominal robot says.
pub const GREY: [u8; 3] = [170, 175, 180];

/// Last part of the name of the residual arrows.
pub fn arrows(scene: &Scene) -> String {
    format!("residuals_x{}", scene.magnification)
}

/// Colour of a position error, m.
pub fn colour(scene: &Scene, error: f64) -> Color {
    // the darkest tenth of the scale is too dark for a dark background
    let share = (error / scene.worst).clamp(0.0, 1.0);
    let [r, g, b] = plot::colour(0.12 + 0.88 * share);
    Color::from_rgb(r, g, b)
}

/// Sends the readings, if it is known where they are.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    let Some(place) = &scene.base_from_tracker else {
        return Ok(());
    };
    let tracker = path(["cell", "tracker"]);
    fixed(
        stream,
        tracker.clone(),
        &rerun::Transform3D::from_translation_rotation(
            xyz(&place.translation.vector),
            crate::log::quaternion(place),
        ),
    )?;
    fixed(
        stream,
        tracker.clone(),
        &TransformAxes3D::new(0.1 * scene.radius as f32),
    )?;
    let here = Points3D::new([[0.0, 0.0, 0.0f32]])
        .with_labels(["tracker"])
        .with_radii([Radius::new_ui_points(4.0)])
        .with_colors([colour_of(GREY)]);
    fixed(stream, path(["cell", "tracker", "name"]), &here)?;
    if scene.steps.is_empty() {
        return Ok(());
    }
    all(stream, scene)?;
    current(stream, scene)
}

/// Every reading: on the steps' timeline with the errors of each step, on the readings' own with those of the first.
fn all(stream: &RecordingStream, scene: &Scene) -> Logged {
    let campaign = &scene.recording.campaign;
    let measured: Vec<[f32; 3]> = scene
        .measured()
        .iter()
        .map(|pose| xyz(&pose.translation.vector))
        .collect();
    let labels = campaign
        .readings
        .iter()
        .enumerate()
        .map(|(index, reading)| {
            let mut words = vec![format!("reading {index}")];
            words.extend(reading.pose.iter().map(|pose| format!("pose {pose}")));
            words.push(campaign.targets[reading.target].name.clone());
            if reading.split == Split::Heldout {
                words.push("held out".to_owned());
            }
            words.join(" · ")
        });
    let points = path(["cell", "readings", "position_error_mm"]);
    let arrow = path(["cell", "readings", &arrows(scene)]);
    let many = measured.len();
    let size = if many > 2000 { 1.5 } else { 3.0 };
    let fixed_points = Points3D::update_fields()
        .with_positions(measured.clone())
        .with_radii([Radius::new_ui_points(size)])
        .with_labels(labels)
        .with_show_labels(false);
    fixed(stream, points.clone(), &fixed_points)?;
    let fixed_arrows = Arrows3D::update_fields()
        .with_origins(measured)
        .with_radii([Radius::new_ui_points(size * 0.4)]);
    fixed(stream, arrow.clone(), &fixed_arrows)?;

    let colours = |step: &crate::Drawn| -> Vec<Color> {
        let sizes = step.sizes();
        sizes.iter().map(|error| colour(scene, *error)).collect()
    };
    let vectors = |step: &crate::Drawn| -> Vec<[f32; 3]> {
        let errors = step.errors.iter();
        errors
            .map(|error| xyz(&(error * scene.magnification)))
            .collect()
    };
    let count = scene.steps.len();
    for first in [true, false] {
        let shown = if first { 1 } else { count };
        let shown = &scene.steps[..shown];
        let hues: Vec<Color> = shown.iter().flat_map(colours).collect();
        let directions: Vec<[f32; 3]> = shown.iter().flat_map(vectors).collect();
        let lengths = vec![many; shown.len()];
        let hued = Points3D::update_fields()
            .with_colors(hues.clone())
            .columns(lengths.clone())?;
        let pointed = Arrows3D::update_fields()
            .with_vectors(directions)
            .with_colors(hues)
            .columns(lengths)?;
        match first {
            true => {
                stream.send_columns(points.clone(), beginning(scene), hued)?;
                stream.send_columns(arrow.clone(), beginning(scene), pointed)?;
            }
            false => {
                stream.send_columns(points.clone(), steps(count), hued)?;
                stream.send_columns(arrow.clone(), steps(count), pointed)?;
            }
        }
    }
    Ok(())
}

/// The current reading's target: where it was measured, where the nominal robot and the last step put it.
fn current(stream: &RecordingStream, scene: &Scene) -> Logged {
    let measured = scene.measured();
    let mut shown = vec![("measured", GREEN, measured.iter())];
    let mut errors = Vec::new();
    if let Some(first) = scene.steps.first() {
        shown.push(("nominal", GREY, first.predicted.iter()));
        errors.push(("nominal", GREY, first));
    }
    if let Some(last) = scene.steps.last().filter(|_| scene.steps.len() > 1) {
        shown.push(("fitted", ORANGE, last.predicted.iter()));
        errors.push(("fitted", SKY, last));
    }
    for (name, colour, all) in shown {
        let entity = path(["cell", "current", name]);
        moving(stream, scene, &entity, all.copied())?;
        fixed(
            stream,
            entity.clone(),
            &TransformAxes3D::new(0.09 * scene.radius as f32),
        )?;
        let dot = Points3D::new([[0.0, 0.0, 0.0f32]])
            .with_radii([Radius::new_ui_points(4.5)])
            .with_colors([colour_of(colour)]);
        fixed(stream, path(["cell", "current", name, "point"]), &dot)?;
    }
    for (name, colour, step) in errors {
        let name = format!("residual_{name}_x{}", scene.magnification);
        let entity = path(["cell", "current", &name]);
        let look = Arrows3D::update_fields()
            .with_radii([Radius::new_ui_points(2.5)])
            .with_colors([colour_of(colour)]);
        fixed(stream, entity.clone(), &look)?;
        let labels = step.sizes();
        let labels = labels.iter().map(|error| crate::words::millimetres(*error));
        let arrows = Arrows3D::update_fields()
            .with_origins(
                step.predicted
                    .iter()
                    .map(|pose| xyz(&pose.translation.vector)),
            )
            .with_vectors(
                step.errors
                    .iter()
                    .map(|error| xyz(&(error * scene.magnification))),
            )
            .with_labels(labels);
        stream.send_columns(entity, everywhere(scene), arrows.columns_of_unit_batches()?)?;
    }
    Ok(())
}

pub fn colour_of([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}
