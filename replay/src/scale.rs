//! Scales in the scene: colours of errors in mm, lengths of arrows.

use crate::Scene;
use crate::loads::{FORCE, Lengths, TORQUE, WEIGHT};
use crate::log::{Logged, fixed, path, xyz};
use crate::readings::{GREY, colour, colour_of};
use crate::scene::round;
use nalgebra::{Point3, Vector3};
use rerun::{Arrows3D, LineStrips3D, Points3D, Radius, RecordingStream};

/// Colours of the bar.
const SHADES: usize = 48;

/// Where the eye stands when the layout opens.
pub fn eye(scene: &Scene) -> Point3<f64> {
    scene.focus + Vector3::new(1.35, -1.3, 0.6) * scene.reach
}

/// Sends the scales, left of the scene as the eye sees it.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    let ahead = (scene.focus - eye(scene)).normalize();
    let right = ahead.cross(&Vector3::z()).normalize();
    let up = right.cross(&ahead);
    let mut foot = scene.focus - (right * 0.88 + up * 0.35) * scene.reach;
    if !scene.steps.is_empty() {
        bar(stream, scene, &foot, &up)?;
        // an arrow of a round error, as long as it is drawn
        let error = round(0.25 * scene.reach / scene.magnification);
        let name = format!("residual_x{}", scene.magnification);
        let label = format!(
            "{} × {}",
            crate::words::millimetres(error),
            scene.magnification
        );
        foot -= up * (0.11 * scene.reach);
        arrow(
            stream,
            &name,
            &foot,
            &(right * error * scene.magnification),
            GREY,
            &label,
        )?;
    }
    let lengths = Lengths::of(scene);
    let mut readings = scene.recording.campaign.readings.iter();
    let measured = readings.any(|reading| reading.wrench.is_some());
    let kinds = [
        (
            "force",
            lengths.force,
            if measured { FORCE } else { WEIGHT },
            "N",
        ),
        ("torque", lengths.torque, TORQUE, "N·m"),
    ];
    for (name, length, colour, unit) in kinds {
        if let Some(length) = length {
            let size = round(0.25 * scene.reach / length);
            foot -= up * (0.11 * scene.reach);
            let label = format!("{size} {unit}");
            arrow(
                stream,
                name,
                &foot,
                &(right * size * length),
                colour,
                &label,
            )?;
        }
    }
    Ok(())
}

/// A bar of colours with its values.
fn bar(stream: &RecordingStream, scene: &Scene, foot: &Point3<f64>, up: &Vector3<f64>) -> Logged {
    let height = up * (0.9 * scene.reach);
    let at = |share: f64| xyz(&(foot + height * share).coords);
    let shades = (0..SHADES).map(|i| i as f64 / SHADES as f64);
    let pieces: Vec<Vec<[f32; 3]>> = shades
        .clone()
        .map(|share| vec![at(share), at(share + 1.0 / SHADES as f64)])
        .collect();
    let colours: Vec<rerun::Color> = shades.map(|s| colour(scene, s * scene.worst)).collect();
    let bar = LineStrips3D::new(pieces)
        .with_radii([Radius::new_ui_points(7.0)])
        .with_colors(colours);
    fixed(stream, path(["cell", "scale", "position_error_mm"]), &bar)?;
    let ticks = [0.0, 0.25, 0.5, 0.75, 1.0, 1.07];
    let labels = ticks.map(|share| match share {
        share if share > 1.0 => "position error".to_owned(),
        share => crate::words::millimetres(scene.worst * share),
    });
    let ticks = Points3D::new(ticks.map(at))
        .with_radii([Radius::new_ui_points(1.0)])
        .with_colors([colour_of(GREY)])
        .with_labels(labels)
        .with_show_labels(true);
    fixed(
        stream,
        path(["cell", "scale", "position_error_mm", "ticks"]),
        &ticks,
    )
}

fn arrow(
    stream: &RecordingStream,
    name: &str,
    from: &Point3<f64>,
    along: &Vector3<f64>,
    colour: [u8; 3],
    label: &str,
) -> Logged {
    let arrow = Arrows3D::from_vectors([xyz(along)])
        .with_origins([xyz(&from.coords)])
        .with_radii([Radius::new_ui_points(2.5)])
        .with_colors([colour_of(colour)])
        .with_labels([label]);
    fixed(stream, path(["cell", "scale", name]), &arrow)
}
