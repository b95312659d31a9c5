//! Robots link by link: the nominal one, the fitted one, and the fitted one with its deviation magnified.

use crate::Scene;
use crate::log::{Logged, fixed, moving, path, quaternion, xyz};
use misfit_arm::robot::{Robot, Shape, Visual};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rerun::{
    Boxes3D, Capsules3D, Color, Cylinders3D, Ellipsoids3D, FillMode, RecordingStream,
    ViewCoordinates,
};

/// Entity of the nominal robot.
pub const NOMINAL: [&str; 2] = ["cell", "nominal"];
/// Entity of the fitted robot.
pub const FITTED: [&str; 2] = ["cell", "fitted"];
/// Colour of the fitted robot.
pub const ORANGE: [u8; 3] = [230, 159, 0];
/// Colour of the fitted robot, magnified.
pub const SKY: [u8; 3] = [86, 180, 233];

/// Last part of the name of the magnified robot.
pub fn magnified(scene: &Scene) -> String {
    format!("fitted_deviation_x{}", scene.robot_magnification)
}

/// Sends the robots.
pub fn send(stream: &RecordingStream, scene: &Scene) -> Logged {
    fixed(stream, "cell", &ViewCoordinates::RIGHT_HAND_Z_UP())?;
    let robot = &scene.recording.campaign.robot;
    let shapes = Shapes::of(robot, scene.radius);
    robot_of(stream, scene, &NOMINAL, &shapes, None, &scene.nominal)?;
    let Some(results) = &scene.recording.results else {
        return Ok(());
    };
    let translucent = |[r, g, b]: [u8; 3]| Color::from_unmultiplied_rgba(r, g, b, 120);
    let colour = Some(translucent(ORANGE));
    robot_of(stream, scene, &FITTED, &shapes, colour, &results.links)?;
    let pairs = results.links.iter().zip(&scene.nominal);
    let exaggerated: Vec<Vec<Isometry3<f64>>> = pairs
        .map(|(fitted, nominal)| {
            let links = fitted.iter().zip(nominal);
            links
                .map(|(fitted, nominal)| exaggerate(fitted, nominal, scene.robot_magnification))
                .collect()
        })
        .collect();
    let name = magnified(scene);
    let colour = Some(translucent(SKY));
    robot_of(
        stream,
        scene,
        &["cell", &name],
        &shapes,
        colour,
        &exaggerated,
    )
}

/// The nominal pose, moved on by a multiple of what the fitted one is off: a small motion, so turns add as vectors.
fn exaggerate(fitted: &Isometry3<f64>, nominal: &Isometry3<f64>, times: f64) -> Isometry3<f64> {
    let moved = fitted.translation.vector - nominal.translation.vector;
    let turned = (fitted.rotation * nominal.rotation.inverse()).scaled_axis();
    Isometry3::from_parts(
        Translation3::from(nominal.translation.vector + moved * times),
        UnitQuaternion::from_scaled_axis(turned * times) * nominal.rotation,
    )
}

fn robot_of(
    stream: &RecordingStream,
    scene: &Scene,
    entity: &[&str],
    shapes: &Shapes,
    colour: Option<Color>,
    poses: &[Vec<Isometry3<f64>>],
) -> Logged {
    for (index, link) in scene.recording.campaign.robot.links.iter().enumerate() {
        if shapes.links[index].is_empty() {
            continue;
        }
        let name = entity.iter().copied().chain([link.name.as_str()]);
        moving(
            stream,
            scene,
            &path(name.clone()),
            poses.iter().map(|links| links[index]),
        )?;
        shapes.send(stream, index, colour, |shape| {
            path(name.clone().chain([shape]))
        })?;
    }
    Ok(())
}

/// What each link looks like.
struct Shapes {
    links: Vec<Vec<Visual>>,
    /// Shapes made here for want of others: cylinders get round ends.
    sticks: bool,
}

impl Shapes {
    /// The robot file's primitive shapes; sticks between the joints where it has none.
    fn of(robot: &Robot, size: f64) -> Self {
        let sticks = robot.links.iter().all(|link| link.visuals.is_empty());
        let links = match sticks {
            false => robot
                .links
                .iter()
                .map(|link| link.visuals.clone())
                .collect(),
            true => sticks_of(robot, size),
        };
        Self { links, sticks }
    }

    fn send(
        &self,
        stream: &RecordingStream,
        link: usize,
        colour: Option<Color>,
        entity: impl Fn(&str) -> rerun::EntityPath,
    ) -> Logged {
        let mut boxes = Kind::default();
        let mut cylinders = Kind::default();
        let mut spheres = Kind::default();
        for visual in &self.links[link] {
            match visual.shape {
                Shape::Box(edges) => boxes.add(visual, colour, edges.map(|edge| edge / 2.0)),
                Shape::Cylinder(radius, length) => {
                    cylinders.add(visual, colour, [radius, length, 0.0])
                }
                Shape::Sphere(radius) => spheres.add(visual, colour, [radius; 3]),
            }
        }
        let solid = FillMode::Solid;
        if !boxes.sizes.is_empty() {
            let all = Boxes3D::from_centers_and_half_sizes(boxes.centres, boxes.sizes)
                .with_quaternions(boxes.turns)
                .with_colors(boxes.colours)
                .with_fill_mode(solid);
            fixed(stream, entity("boxes"), &all)?;
        }
        let (lengths, radii): (Vec<f32>, Vec<f32>) = cylinders
            .sizes
            .iter()
            .map(|size| (size[1], size[0]))
            .unzip();
        if !lengths.is_empty() && self.sticks {
            // A capsule begins at its origin, a cylinder has it in its middle.
            let starts = cylinders.centres.iter().zip(&cylinders.ends);
            let starts: Vec<[f32; 3]> = starts
                .map(|(c, half)| [0, 1, 2].map(|i| c[i] - half[i]))
                .collect();
            let all = Capsules3D::from_lengths_and_radii(lengths, radii)
                .with_translations(starts)
                .with_quaternions(cylinders.turns)
                .with_colors(cylinders.colours)
                .with_fill_mode(solid);
            fixed(stream, entity("capsules"), &all)?;
        } else if !lengths.is_empty() {
            let all = Cylinders3D::from_lengths_and_radii(lengths, radii)
                .with_centers(cylinders.centres)
                .with_quaternions(cylinders.turns)
                .with_colors(cylinders.colours)
                .with_fill_mode(solid);
            fixed(stream, entity("cylinders"), &all)?;
        }
        if !spheres.sizes.is_empty() {
            let all = Ellipsoids3D::from_centers_and_half_sizes(spheres.centres, spheres.sizes)
                .with_colors(spheres.colours)
                .with_fill_mode(solid);
            fixed(stream, entity("spheres"), &all)?;
        }
        Ok(())
    }
}

/// Shapes of one kind on one link.
#[derive(Default)]
struct Kind {
    centres: Vec<[f32; 3]>,
    /// Half of the length along each shape's z axis.
    ends: Vec<[f32; 3]>,
    turns: Vec<rerun::Quaternion>,
    sizes: Vec<[f32; 3]>,
    colours: Vec<Color>,
}

impl Kind {
    fn add(&mut self, visual: &Visual, colour: Option<Color>, size: [f64; 3]) {
        let pose = visual.link_from_shape;
        self.centres.push(xyz(&pose.translation.vector));
        let half = pose.rotation * Vector3::z() * (size[1] / 2.0);
        self.ends.push(xyz(&half));
        self.turns.push(quaternion(&pose));
        self.sizes.push(size.map(|x| x as f32));
        let own = visual
            .rgba
            .map(|share| (share.clamp(0.0, 1.0) * 255.0).round() as u8);
        let [r, g, b, a] = own;
        self.colours
            .push(colour.unwrap_or(Color::from_unmultiplied_rgba(r, g, b, a)));
    }
}

/// A stick from each joint to the next and to each end, on the first link of every body.
fn sticks_of(robot: &Robot, size: f64) -> Vec<Vec<Visual>> {
    let mut links = vec![Vec::new(); robot.links.len()];
    for body in 0..robot.bodies.len() {
        let own = || {
            robot
                .links
                .iter()
                .enumerate()
                .filter(move |(_, link)| link.body == body)
        };
        let Some((first, link)) = own().next() else {
            continue;
        };
        let onwards = robot.joints.iter().filter(|joint| joint.parent == body);
        let mut ends: Vec<Vector3<f64>> = onwards
            .map(|joint| joint.parent_from_joint.translation.vector)
            .collect();
        ends.extend(own().map(|(_, link)| link.body_from_link.translation.vector));
        let link_from_body = link.body_from_link.inverse();
        for end in ends {
            let length = end.norm();
            if length < 1e-3 {
                continue;
            }
            let turn = UnitQuaternion::rotation_between(&Vector3::z(), &end).unwrap_or_else(|| {
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI)
            });
            let middle = Point3::from(end / 2.0);
            links[first].push(Visual {
                link_from_shape: link_from_body * Isometry3::from_parts(middle.coords.into(), turn),
                shape: Shape::Cylinder(0.04 * size, length),
                rgba: [0.62, 0.64, 0.66, 1.0],
            });
        }
        links[first].push(Visual {
            link_from_shape: link_from_body,
            shape: Shape::Sphere(0.055 * size),
            rgba: [0.13, 0.30, 0.58, 1.0],
        });
    }
    links
}
