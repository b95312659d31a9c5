//! Curves over the readings: joint angles, errors after each step, torques, wrenches.

use crate::Scene;
use crate::log::{Logged, at, everywhere, fixed, path};
use misfit_arm::robot::JointKind;
use misfit_campaign::Wrench;
use rerun::{Color, RecordingStream, Scalars, SeriesLines};

/// Okabe and Ito 2008, and their lighter and darker kin: told apart by people who confuse red and green.
pub const COLOURS: [[u8; 3]; 8] = [
    [86, 180, 233],
    [230, 159, 0],
    [0, 158, 115],
    [240, 228, 66],
    [204, 121, 167],
    [213, 94, 0],
    [0, 114, 178],
    [200, 200, 200],
];

/// Folder of joint angles and slides, by unit.
pub fn joint_folder(kind: JointKind) -> (&'static str, f64) {
    match kind {
        JointKind::Prismatic => ("joints_mm", 1e3),
        JointKind::Revolute | JointKind::Continuous => ("joints_deg", 180.0 / std::f64::consts::PI),
    }
}

/// Folder of torques and forces, by unit.
pub fn torque_folder(kind: JointKind) -> &'static str {
    match kind {
        JointKind::Prismatic => "joint_forces_N",
        JointKind::Revolute | JointKind::Continuous => "torques_Nm",
    }
}

/// Sends the curves.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    let campaign = &scene.recording.campaign;
    let all: Vec<usize> = (0..campaign.readings.len()).collect();
    for (index, joint) in campaign.robot.joints.iter().enumerate() {
        let (folder, factor) = joint_folder(joint.kind);
        let values = campaign.readings.iter().map(|r| r.joints[index] * factor);
        curve(
            stream,
            scene,
            [folder, &joint.name],
            index,
            &all,
            values.collect(),
        )?;
        if let Some(results) = &scene.recording.results {
            let values = results.torques.iter().map(|torques| torques[index]);
            let folder = torque_folder(joint.kind);
            curve(
                stream,
                scene,
                [folder, &joint.name],
                index,
                &all,
                values.collect(),
            )?;
        }
    }
    for (index, step) in scene.steps.iter().enumerate() {
        let errors = step.sizes().iter().map(|error| error * 1e3).collect();
        curve(stream, scene, ["error_mm", &step.name], index, &all, errors)?;
        let turned: Vec<(usize, f64)> = step
            .turns
            .iter()
            .enumerate()
            .filter_map(|(reading, turn)| Some((reading, (*turn)? * 1e3)))
            .collect();
        if !turned.is_empty() {
            let (readings, turns): (Vec<usize>, Vec<f64>) = turned.into_iter().unzip();
            curve(
                stream,
                scene,
                ["error_mrad", &step.name],
                index,
                &readings,
                turns,
            )?;
        }
    }
    for (target, name, _) in scene.targets() {
        wrenches(stream, scene, target, name)?;
    }
    Ok(())
}

fn wrenches(stream: &RecordingStream, scene: &Scene, target: usize, name: &str) -> Logged {
    let measured: Vec<(usize, Wrench)> = scene
        .recording
        .campaign
        .readings
        .iter()
        .enumerate()
        .filter(|(_, reading)| reading.target == target)
        .filter_map(|(index, reading)| Some((index, reading.wrench?)))
        .collect();
    if measured.is_empty() {
        return Ok(());
    }
    let indices: Vec<usize> = measured.iter().map(|(index, _)| *index).collect();
    let send = |folder: &str, curve_name: &str, colour: usize, value: &dyn Fn(&Wrench) -> f64| {
        let values = measured.iter().map(|(_, wrench)| value(wrench)).collect();
        let entity = ["plots", folder, name, curve_name];
        line(stream, scene, &entity, curve_name, colour, &indices, values)
    };
    for (axis, word) in ["x", "y", "z"].into_iter().enumerate() {
        send("force_N", &format!("f{word}"), axis, &|w| w.force[axis])?;
        send("torque_Nm", &format!("t{word}"), axis, &|w| w.torque[axis])?;
    }
    if !scene.process() {
        return Ok(());
    }
    // the weight of what the wrist carries is there from the start
    let start = measured[0].1.force;
    send("thrust_N", "thrust, along z of the link", 0, &|w| {
        w.force.z - start.z
    })?;
    send("thrust_N", "lateral, across it", 1, &|w| {
        (w.force - start).xy().norm()
    })
}

fn curve(
    stream: &RecordingStream,
    scene: &Scene,
    [folder, name]: [&str; 2],
    colour: usize,
    readings: &[usize],
    values: Vec<f64>,
) -> Logged {
    let entity = ["plots", folder, name];
    line(stream, scene, &entity, name, colour, readings, values)
}

#[expect(
    clippy::too_many_arguments,
    reason = "one procedure, still to be split by its steps"
)]
fn line(
    stream: &RecordingStream,
    scene: &Scene,
    entity: &[&str],
    name: &str,
    colour: usize,
    readings: &[usize],
    values: Vec<f64>,
) -> Logged {
    let entity = path(entity.iter().copied());
    let [r, g, b] = COLOURS[colour % COLOURS.len()];
    let look = SeriesLines::new()
        .with_names([name])
        .with_colors([Color::from_rgb(r, g, b)])
        .with_widths([1.5]);
    fixed(stream, entity.clone(), &look)?;
    let columns = Scalars::new(values).columns_of_unit_batches()?;
    match readings.len() == scene.times.len() {
        true => stream.send_columns(entity, everywhere(scene), columns),
        false => stream.send_columns(entity, at(scene, readings), columns),
    }
}
