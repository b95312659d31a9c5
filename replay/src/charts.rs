//! Charts that a plot over time cannot show: errors against angles, the falling ladder, the fit's progress.
//!
//! Drawn as points and lines in two dimensions, y downwards, in boxes of [`WIDTH`] by [`HEIGHT`].

use crate::log::{Logged, beginning, fixed, path, steps};
use crate::plots::COLOURS;
use crate::readings::{GREY, colour_of};
use crate::scene::{quantile, round_up};
use crate::words::millimetres;
use crate::{Drawn, Scene};
use misfit_arm::robot::JointKind;
use nalgebra::Vector3;
use rerun::{Color, LineStrips2D, Points2D, Radius, RecordingStream};

/// Of a chart's box.
pub const WIDTH: f64 = 100.0;
/// Of a chart's box.
pub const HEIGHT: f64 = 60.0;
/// Between the boxes of angles.
const GAP: [f64; 2] = [14.0, 22.0];
/// Above the boxes of angles: what they show.
const ABOVE: f64 = 26.0;
/// Readings shown against angles, at most.
const MOST: usize = 1500;
/// Lever below which a turn of the joint moves the target too little to be told, m.
const SHORTEST: f64 = 0.02;
/// Colour of frames and words.
const FRAME: [u8; 3] = [110, 115, 120];

/// Sends the charts.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    angles(stream, scene)?;
    ladder(stream, scene)?;
    progress(stream, scene)
}

/// Joints that move a target, and boxes in a row for them.
pub fn angle_boxes(scene: &Scene) -> (Vec<usize>, usize) {
    if scene.steps.is_empty() {
        return (Vec::new(), 1);
    }
    let campaign = &scene.recording.campaign;
    let mut joints: Vec<usize> = Vec::new();
    for target in &campaign.targets {
        let chain = campaign.robot.chain(campaign.robot.links[target.link].body);
        joints.extend(chain);
    }
    joints.sort_unstable();
    joints.dedup();
    joints.retain(|joint| {
        let mut angles = campaign.readings.iter().map(|r| r.joints[*joint]);
        let first = angles.next().unwrap_or_default();
        angles.any(|angle| (angle - first).abs() > 1e-3)
    });
    let columns = match joints.len() {
        0..=2 => 1,
        3..=4 => 2,
        5..=9 => 3,
        _ => 4,
    };
    (joints, columns)
}

/// Width and height of all boxes of angles with their words.
pub fn angle_size(scene: &Scene) -> (f64, f64) {
    let (joints, columns) = angle_boxes(scene);
    let rows = joints.len().div_ceil(columns).max(1);
    (
        columns as f64 * (WIDTH + GAP[0]),
        rows as f64 * (HEIGHT + GAP[1]) + ABOVE,
    )
}

/// A joint's angle, and the errors along the joint's motion, of up to [`MOST`] readings that it moves.
struct Along {
    joint: usize,
    /// rad (m).
    angles: Vec<f64>,
    /// By step, m.
    errors: Vec<Vec<f64>>,
}

impl Along {
    fn of(scene: &Scene, joint: usize) -> Self {
        let campaign = &scene.recording.campaign;
        let mut found = Self {
            joint,
            angles: Vec::new(),
            errors: vec![Vec::new(); scene.steps.len()],
        };
        let stride = campaign.readings.len().div_ceil(MOST).max(1);
        for (index, reading) in campaign.readings.iter().enumerate().step_by(stride) {
            let body = campaign.robot.links[campaign.targets[reading.target].link].body;
            if !campaign.robot.chain(body).contains(&joint) {
                continue;
            }
            let moving = &campaign.robot.joints[joint];
            let bodies = campaign.robot.body_poses(&reading.joints);
            let frame = bodies[moving.parent] * moving.parent_from_joint;
            let axis = frame.rotation * *moving.axis;
            let Some(first) = scene.steps.first() else {
                continue;
            };
            let lever = first.predicted[index].translation.vector - frame.translation.vector;
            let motion: Vector3<f64> = match moving.kind {
                JointKind::Prismatic => axis,
                JointKind::Revolute | JointKind::Continuous => axis.cross(&lever),
            };
            if motion.norm() < SHORTEST {
                continue;
            }
            let along = motion.normalize();
            found.angles.push(reading.joints[joint]);
            for (errors, step) in found.errors.iter_mut().zip(&scene.steps) {
                errors.push(along.dot(&step.errors[index]));
            }
        }
        found
    }
}

/// Errors against every angle: before a step in grey, after it in colour, on the scale of before.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
fn angles(stream: &RecordingStream, scene: &Scene) -> Logged {
    let (joints, columns) = angle_boxes(scene);
    if joints.is_empty() {
        return Ok(());
    }
    let robot = &scene.recording.campaign.robot;
    let mut titles: Vec<([f64; 2], String)> = Vec::new();
    let mut frames: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut heights: Vec<Vec<([f64; 2], String)>> = vec![Vec::new(); scene.steps.len()];
    for (place, along) in joints.iter().map(|j| Along::of(scene, *j)).enumerate() {
        let corner = [
            (place % columns) as f64 * (WIDTH + GAP[0]),
            (place / columns) as f64 * (HEIGHT + GAP[1]) + ABOVE,
        ];
        let joint = &robot.joints[along.joint];
        let (factor, unit) = match joint.kind {
            JointKind::Prismatic => (1e3, "mm"),
            JointKind::Revolute | JointKind::Continuous => (180.0 / std::f64::consts::PI, "°"),
        };
        let low = along.angles.iter().copied().fold(f64::INFINITY, f64::min);
        let high = along
            .angles
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        if low >= high {
            continue;
        }
        titles.push((
            [corner[0] + WIDTH / 2.0, corner[1] + HEIGHT + 6.0],
            format!(
                "{} {:.0}{unit} … {:.0}{unit}",
                joint.name,
                low * factor,
                high * factor
            ),
        ));
        frames.push(outline(corner));
        let middle = corner[1] + HEIGHT / 2.0;
        frames.push(vec![[corner[0], middle], [corner[0] + WIDTH, middle]]);
        let dots = |errors: &[f64], most: f64| -> Vec<[f32; 2]> {
            let pairs = along.angles.iter().zip(errors);
            pairs
                .map(|(angle, error)| {
                    let x = corner[0] + WIDTH * (angle - low) / (high - low);
                    let share = (error / most).clamp(-1.0, 1.0);
                    flat([x, middle - share * HEIGHT / 2.0])
                })
                .collect()
        };
        let mut before: Vec<Vec<[f32; 2]>> = Vec::new();
        let mut after: Vec<Vec<[f32; 2]>> = Vec::new();
        for (step, words) in heights.iter_mut().enumerate() {
            let old = &along.errors[step.saturating_sub(1)];
            let sizes = old.iter().map(|error| error.abs()).collect();
            let most = round_up(quantile(sizes, 0.99).max(1e-9));
            words.push((
                [corner[0] + 12.0, corner[1] + 3.5],
                format!("±{}", millimetres(most)),
            ));
            before.push(match step {
                0 => Vec::new(),
                _ => dots(old, most),
            });
            after.push(dots(&along.errors[step], most));
        }
        let kinds = [
            ("before", GREY, before, 1.2),
            ("after", COLOURS[0], after, 1.6),
        ];
        for (kind, colour, all, size) in kinds {
            let entity = path(["charts", "angles", &joint.name, kind]);
            let look = Points2D::update_fields()
                .with_radii([Radius::new_ui_points(size)])
                .with_colors([colour_of(colour)])
                .with_draw_order(if kind == "before" { 10.0 } else { 20.0 });
            fixed(stream, entity.clone(), &look)?;
            by_step(stream, scene, entity, &all)?;
        }
    }
    lines(stream, "charts/angles/frames", &frames, FRAME, 0.7)?;
    labels(stream, "charts/angles/joints", &titles)?;
    let entity = path(["charts", "angles", "scale"]);
    let all: Vec<Vec<[f32; 2]>> = heights
        .iter()
        .map(|row| row.iter().map(|(at, _)| flat(*at)).collect())
        .collect();
    let words: Vec<Vec<String>> = heights
        .into_iter()
        .map(|row| row.into_iter().map(|(_, word)| word).collect())
        .collect();
    named(stream, scene, entity, &all, &words)?;
    let (width, _) = angle_size(scene);
    let entity = path(["charts", "angles", "step"]);
    let all = vec![vec![flat([(width - GAP[0]) / 2.0, 4.0])]; scene.steps.len()];
    let words: Vec<Vec<String>> = (0..scene.steps.len())
        .map(|step| vec![heading(&scene.steps, step)])
        .collect();
    named(stream, scene, entity, &all, &words)
}

fn heading(steps: &[Drawn], step: usize) -> String {
    let what = "error along the joint's motion";
    match step.checked_sub(1) {
        None => format!("{what}: {}", steps[step].added),
        Some(before) => format!(
            "{what}: {} (grey), then {} (blue)",
            steps[before].name, steps[step].name
        ),
    }
}

/// Rms errors, fitted and held out, on a logarithmic scale.
#[expect(
    clippy::too_many_lines,
    reason = "one procedure, still to be split by its steps"
)]
fn ladder(stream: &RecordingStream, scene: &Scene) -> Logged {
    if scene.steps.len() < 2 {
        return Ok(());
    }
    let values = scene.steps.iter();
    let values: Vec<f64> = values
        .flat_map(|step| [Some(step.rms.0), step.rms.1])
        .flatten()
        .filter(|value| *value > 0.0)
        .collect();
    let Some(decades) = Decades::of(&values) else {
        return Ok(());
    };
    let x = |step: usize| WIDTH * (step as f64 + 0.5) / scene.steps.len() as f64;
    decades.send(stream, "charts/ladder", &|value| millimetres(value))?;
    let kinds = [
        (
            "fitted",
            COLOURS[0],
            scene
                .steps
                .iter()
                .map(|s| Some(s.rms.0))
                .collect::<Vec<_>>(),
        ),
        (
            "held_out",
            COLOURS[1],
            scene.steps.iter().map(|s| s.rms.1).collect(),
        ),
    ];
    for (kind, colour, rms) in kinds {
        let points: Vec<[f64; 2]> = rms
            .iter()
            .enumerate()
            .filter_map(|(step, value)| Some([x(step), decades.height((*value)?)?]))
            .collect();
        if points.is_empty() {
            continue;
        }
        let words = rms.iter().flatten().map(|value| millimetres(*value));
        lines(
            stream,
            &format!("charts/ladder/{kind}"),
            std::slice::from_ref(&points),
            colour,
            1.5,
        )?;
        let dots = Points2D::new(points.iter().map(|p| flat(*p)))
            .with_radii([Radius::new_ui_points(4.0)])
            .with_colors([colour_of(colour)]);
        fixed(stream, path(["charts", "ladder", kind, "points"]), &dots)?;
        // a label hangs below its point: those held out are moved above the line
        let up = if kind == "held_out" { 9.5 } else { 0.0 };
        let words = invisible()
            .with_positions(points.iter().map(|[x, y]| flat([*x, y - up])))
            .with_colors([colour_of(colour)])
            .with_labels(words);
        fixed(stream, path(["charts", "ladder", kind, "values"]), &words)?;
    }
    let names: Vec<([f64; 2], String)> = scene
        .steps
        .iter()
        .enumerate()
        .map(|(index, step)| {
            (
                [x(index), HEIGHT + 6.0 + 5.0 * (index % 2) as f64],
                step.name.clone(),
            )
        })
        .collect();
    labels(stream, "charts/ladder/steps", &names)?;
    let mut key = vec![([14.0, -5.0], "rms position error, fitted (blue)".to_owned())];
    if scene.steps.iter().any(|step| step.rms.1.is_some()) {
        key[0] = (
            [30.0, -5.0],
            "rms position error: fitted (blue), held out (orange)".to_owned(),
        );
    }
    labels(stream, "charts/ladder/key", &key)?;
    // a bar that goes along with the step
    let entity = path(["charts", "ladder", "now"]);
    let look = LineStrips2D::update_fields()
        .with_colors([Color::from_unmultiplied_rgba(255, 255, 255, 90)])
        .with_radii([Radius::new_ui_points(1.0)]);
    fixed(stream, entity.clone(), &look)?;
    let bars = |range: std::ops::Range<usize>| {
        let count = range.len();
        let strips = range.map(|step| vec![flat([x(step), 0.0]), flat([x(step), HEIGHT])]);
        LineStrips2D::new(strips).columns(vec![1; count])
    };
    stream.send_columns(
        entity,
        steps(scene.steps.len()),
        bars(0..scene.steps.len())?,
    )
}

/// Cost of every fit, iteration by iteration, on a logarithmic scale.
fn progress(stream: &RecordingStream, scene: &Scene) -> Logged {
    let Some(results) = &scene.recording.results else {
        return Ok(());
    };
    let all = &results.progress;
    let costs: Vec<f64> = all
        .iter()
        .map(|p| p.cost)
        .filter(|cost| *cost > 0.0)
        .collect();
    let Some(decades) = Decades::of(&costs) else {
        return Ok(());
    };
    decades.send(stream, "charts/progress", &|cost| format!("{cost:e}"))?;
    let last = all
        .iter()
        .map(|p| p.iteration)
        .max()
        .unwrap_or_default()
        .max(1);
    let x = |iteration: u32| WIDTH * (0.02 + 0.96 * f64::from(iteration) / f64::from(last));
    for (step, drawn) in results.steps.iter().enumerate() {
        let points: Vec<[f64; 2]> = all
            .iter()
            .filter(|p| p.step == step)
            .filter_map(|p| Some([x(p.iteration), decades.height(p.cost)?]))
            .collect();
        let Some(end) = points.last().copied() else {
            continue;
        };
        let name = format!("{step}_{}", drawn.added);
        let colour = COLOURS[step % COLOURS.len()];
        let entity = format!(
            "charts/progress/{}",
            crate::log::text([name.as_str()]).trim_start_matches('/')
        );
        lines(stream, &entity, std::slice::from_ref(&points), colour, 1.5)?;
        let dots = points.iter().map(|p| flat(*p));
        let dots = Points2D::new(dots)
            .with_radii([Radius::new_ui_points(3.0)])
            .with_colors([colour_of(colour)]);
        fixed(stream, format!("{entity}/iterations"), &dots)?;
        let label = invisible()
            .with_positions([flat([end[0], end[1] + 0.5])])
            .with_colors([colour_of(colour)])
            .with_labels([name]);
        fixed(stream, format!("{entity}/name"), &label)?;
    }
    let ticks: Vec<([f64; 2], String)> = (0..=last)
        .step_by((last as usize).div_ceil(8).max(1))
        .map(|i| ([x(i), HEIGHT + 5.0], i.to_string()))
        .collect();
    labels(stream, "charts/progress/iterations", &ticks)?;
    let key: Vec<([f64; 2], String)> = vec![(
        [WIDTH / 2.0, -5.0],
        "cost of the fits (sum of squared residuals over their noise) against iteration".to_owned(),
    )];
    labels(stream, "charts/progress/key", &key)
}

/// A logarithmic axis.
struct Decades {
    low: f64,
    high: f64,
}

impl Decades {
    /// Whole decades around values above zero.
    fn of(values: &[f64]) -> Option<Self> {
        let low = values.iter().copied().fold(f64::INFINITY, f64::min);
        let high = values.iter().copied().fold(0.0, f64::max);
        (low.is_finite() && high.is_finite() && high > 0.0).then(|| Self {
            low: (low.log10() - 0.05).floor(),
            high: (high.log10() + 0.05).ceil(),
        })
    }

    fn height(&self, value: f64) -> Option<f64> {
        (value > 0.0 && value.is_finite())
            .then(|| HEIGHT * (self.high - value.log10()) / (self.high - self.low))
    }

    fn send(&self, stream: &RecordingStream, entity: &str, word: &dyn Fn(f64) -> String) -> Logged {
        let mut frames = vec![outline([0.0, 0.0])];
        let mut ticks = Vec::new();
        for decade in self.low as i32..=self.high as i32 {
            let value = 10f64.powi(decade);
            let Some(y) = self.height(value) else {
                continue;
            };
            frames.push(vec![[0.0, y], [WIDTH, y]]);
            ticks.push(([-9.0, y], word(value)));
        }
        lines(stream, &format!("{entity}/frame"), &frames, FRAME, 0.7)?;
        labels(stream, &format!("{entity}/scale"), &ticks)
    }
}

/// Points by step: all steps on their own timeline, the last on those of the readings.
fn by_step(
    stream: &RecordingStream,
    scene: &Scene,
    entity: rerun::EntityPath,
    all: &[Vec<[f32; 2]>],
) -> Logged {
    let columns = |rows: &[Vec<[f32; 2]>]| {
        Points2D::update_fields()
            .with_positions(rows.iter().flatten().copied())
            .columns(rows.iter().map(Vec::len).collect::<Vec<_>>())
            .map(Iterator::collect::<Vec<_>>)
    };
    stream.send_columns(entity.clone(), steps(all.len()), columns(all)?)?;
    let last = &all[all.len() - 1..];
    stream.send_columns(entity, beginning(scene), columns(last)?)
}

/// The same with words.
fn named(
    stream: &RecordingStream,
    scene: &Scene,
    entity: rerun::EntityPath,
    all: &[Vec<[f32; 2]>],
    words: &[Vec<String>],
) -> Logged {
    fixed(stream, entity.clone(), &invisible())?;
    by_step(stream, scene, entity.clone(), all)?;
    let columns = |rows: &[Vec<String>]| {
        Points2D::update_fields()
            .with_labels(rows.iter().flatten().cloned())
            .columns(rows.iter().map(Vec::len).collect::<Vec<_>>())
            .map(Iterator::collect::<Vec<_>>)
    };
    stream.send_columns(entity.clone(), steps(words.len()), columns(words)?)?;
    stream.send_columns(
        entity,
        beginning(scene),
        columns(&words[words.len() - 1..])?,
    )
}

/// Words without points.
fn labels(stream: &RecordingStream, entity: &str, words: &[([f64; 2], String)]) -> Logged {
    let all = invisible()
        .with_positions(words.iter().map(|(at, _)| flat(*at)))
        .with_labels(words.iter().map(|(_, word)| word.clone()));
    fixed(stream, entity, &all)
}

fn invisible() -> Points2D {
    Points2D::update_fields()
        .with_radii([Radius::new_ui_points(0.0)])
        .with_colors([colour_of([200, 205, 210])])
        .with_show_labels(true)
}

fn lines(
    stream: &RecordingStream,
    entity: &str,
    strips: &[Vec<[f64; 2]>],
    colour: [u8; 3],
    size: f32,
) -> Logged {
    let strips = strips
        .iter()
        .map(|strip| strip.iter().map(|p| flat(*p)).collect::<Vec<_>>());
    let all = LineStrips2D::new(strips)
        .with_radii([Radius::new_ui_points(size)])
        .with_colors([colour_of(colour)])
        .with_draw_order(0.0);
    fixed(stream, entity, &all)
}

fn outline([x, y]: [f64; 2]) -> Vec<[f64; 2]> {
    let (right, below) = (x + WIDTH, y + HEIGHT);
    vec![[x, y], [right, y], [right, below], [x, below], [x, y]]
}

fn flat([x, y]: [f64; 2]) -> [f32; 2] {
    [x as f32, y as f32]
}
