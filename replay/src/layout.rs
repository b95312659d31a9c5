//! The blueprint: what stands where when the viewer opens.
//!
//! Rerun's builder has no eye, no bounds and no hidden entities, so the same archetypes are logged here by hand, with names
//! that are the same each time.

use crate::log::{READING, TIME, text};
use crate::plots::{joint_folder, torque_folder};
use crate::robots::{FITTED, magnified};
use crate::scale::eye;
use crate::{APPLICATION, Opening, Scene, charts, words};
use nalgebra::Point3;
use rerun::datatypes::{Range1D, Range2D, TimeRange, TimeRangeBoundary, Uuid};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, ContainerBlueprint, EntityBehavior, EyeControls3D, LineGrid3D, PanelBlueprint,
    PlotLegend, TimeAxis, TimePanelBlueprint, ViewBlueprint, ViewContents, ViewportBlueprint,
    VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{
    BackgroundKind, ContainerKind, Corner2D, PanelState, PlayState,
};
use rerun::{RecordingStream, RecordingStreamBuilder, RecordingStreamResult};

/// Sends the layout as the application's own.
///
/// # Errors
/// What Rerun says.
pub fn send(
    stream: &RecordingStream,
    scene: &Scene,
    opening: &Opening,
) -> RecordingStreamResult<()> {
    let (blueprint, storage) = RecordingStreamBuilder::new(APPLICATION)
        .recording_id("misfit_layout")
        .blueprint()
        .memory()?;
    blueprint.set_time_sequence("blueprint", 0);
    let mut layout = Layout {
        stream: &blueprint,
        made: 0,
    };
    let root = layout.whole(scene, opening)?;
    let viewport = ViewportBlueprint::new()
        .with_root_container(Uuid { bytes: root })
        .with_auto_layout(false)
        .with_auto_views(false);
    blueprint.log("viewport", &viewport)?;
    let panel = |state| PanelBlueprint::new().with_state(state);
    blueprint.log("blueprint_panel", &panel(PanelState::Collapsed))?;
    blueprint.log("selection_panel", &panel(PanelState::Collapsed))?;
    let usual = if scene.process() { TIME } else { READING };
    let timeline = opening.timeline.as_deref().unwrap_or(usual);
    let time = TimePanelBlueprint::new()
        .with_state(PanelState::Collapsed)
        .with_timeline(timeline)
        .with_play_state(PlayState::Paused)
        .with_fps(5.0);
    blueprint.log("time_panel", &time)?;
    let messages = storage.take();
    if let Some(id) = messages.first().map(|message| message.store_id().clone()) {
        stream.send_blueprint(messages, BlueprintActivationCommand::make_active(id));
    }
    Ok(())
}

type Id = [u8; 16];

struct Layout<'a> {
    stream: &'a RecordingStream,
    made: u8,
}

/// A view or a container in its place.
struct Placed {
    id: Id,
    path: String,
    name: String,
}

impl Layout<'_> {
    /// The cell at the left, plots in tabs at the right, words below them.
    fn whole(&mut self, scene: &Scene, opening: &Opening) -> RecordingStreamResult<Id> {
        let cell = self.cell(scene)?;
        let mut tabs = Vec::new();
        tabs.extend(self.charts(scene)?);
        tabs.extend(self.curves(scene)?);
        let asked = opening.tab.as_deref();
        let open = tabs.iter().position(|tab: &Placed| {
            let name = tab.name.to_lowercase();
            asked.is_some_and(|asked| name.starts_with(&asked.to_lowercase()))
        });
        let tabs = self.tabs("plots", &tabs, open.unwrap_or(0))?;
        let mut texts = Vec::new();
        if words::verdict(scene).is_some() {
            texts.push(self.view("TextDocument", "Verdict", "verdict", &["$origin"])?);
        }
        texts.push(self.view("TextDocument", "About", "about", &["$origin"])?);
        let texts = self.tabs("words", &texts, 0)?;
        let right = self.container(
            ContainerKind::Vertical,
            "beside",
            &[tabs, texts],
            &[3.0, 2.0],
        )?;
        let whole = self.container(
            ContainerKind::Horizontal,
            "all",
            &[cell, right],
            &[3.0, 2.0],
        )?;
        Ok(whole.id)
    }

    fn cell(&mut self, scene: &Scene) -> RecordingStreamResult<Placed> {
        let name = match scene.steps.is_empty() {
            true => "Cell".to_owned(),
            false => format!("Cell · arrows: position error × {}", scene.magnification),
        };
        let view = self.view("3D", &name, "cell", &["$origin/**"])?;
        let point = |p: Point3<f64>| [p.x as f32, p.y as f32, p.z as f32];
        let eye = EyeControls3D::new()
            .with_position(point(eye(scene)))
            .with_look_target(point(scene.focus))
            .with_eye_up([0.0, 0.0, 1.0f32]);
        self.stream
            .log(format!("{}/EyeControls3D", view.path), &eye)?;
        let dark = Background::new(BackgroundKind::SolidColor).with_color([26u8, 29, 34, 255]);
        self.stream
            .log(format!("{}/Background", view.path), &dark)?;
        let grid = LineGrid3D::new().with_visible(true);
        self.stream
            .log(format!("{}/LineGrid3D", view.path), &grid)?;
        for hidden in [FITTED[1].to_owned(), magnified(scene)] {
            let entity = text(["cell", &hidden]);
            let path = format!("{}/ViewContents/overrides{entity}/visualizers", view.path);
            let hidden = EntityBehavior::new().with_visible(false);
            if scene.recording.results.is_some() {
                self.stream.log(path, &hidden)?;
            }
        }
        Ok(view)
    }

    fn charts(&mut self, scene: &Scene) -> RecordingStreamResult<Vec<Placed>> {
        let mut made = Vec::new();
        let both = (charts::WIDTH, charts::HEIGHT);
        if scene.steps.len() > 1 {
            made.push(self.flat(
                "Ladder",
                "charts/ladder",
                (-22.0, -10.0),
                both,
                (34.0, 28.0),
            )?);
        }
        if !charts::angle_boxes(scene).0.is_empty() {
            let size = charts::angle_size(scene);
            made.push(self.flat(
                "Error by angle",
                "charts/angles",
                (-6.0, -2.0),
                size,
                (0.0, 4.0),
            )?);
        }
        let results = scene.recording.results.as_ref();
        if results.is_some_and(|results| !results.progress.is_empty()) {
            made.push(self.flat("Fit", "charts/progress", (-22.0, -10.0), both, (46.0, 22.0))?);
        }
        Ok(made)
    }

    fn curves(&mut self, scene: &Scene) -> RecordingStreamResult<Vec<Placed>> {
        let campaign = &scene.recording.campaign;
        let mut made = Vec::new();
        let wrenches = scene.targets().any(|(target, _, _)| {
            let mut readings = campaign.readings.iter();
            readings.any(|reading| reading.target == target && reading.wrench.is_some())
        });
        let kinds = campaign.robot.joints.iter().map(|joint| joint.kind);
        let mut folders: Vec<(&str, &str)> = Vec::new();
        if !scene.steps.is_empty() {
            folders.push(("Position error, mm", "error_mm"));
        }
        if scene.process() {
            folders.push(("Thrust and lateral force since the start, N", "thrust_N"));
        }
        let turned = scene
            .steps
            .iter()
            .any(|s| s.turns.iter().any(Option::is_some));
        if turned {
            folders.push(("Orientation error, mrad", "error_mrad"));
        }
        if wrenches {
            folders.push(("Force, N", "force_N"));
            folders.push(("Torque, N·m", "torque_Nm"));
        }
        for kind in kinds {
            let angle = match joint_folder(kind).0 {
                "joints_mm" => ("Slides, mm", "joints_mm"),
                folder => ("Joint angles, °", folder),
            };
            let torque = match torque_folder(kind) {
                "joint_forces_N" => ("Joint forces, N", "joint_forces_N"),
                folder => ("Joint torques, N·m", folder),
            };
            for folder in [angle, torque] {
                if !folders.contains(&folder)
                    && (folder == angle || scene.recording.results.is_some())
                {
                    folders.push(folder);
                }
            }
        }
        for (name, folder) in folders {
            let apart = matches!(folder, "thrust_N" | "force_N" | "torque_Nm");
            if !apart {
                let query = format!("/plots/{folder}/**");
                made.push(self.plot(name, &format!("/plots/{folder}"), &query)?);
                continue;
            }
            let mut stacked = Vec::new();
            for (target, target_name, _) in scene.targets() {
                let mut readings = campaign.readings.iter();
                if readings.any(|r| r.target == target && r.wrench.is_some()) {
                    let origin = text(["plots", folder, target_name]);
                    let title = format!("{name}: {target_name}");
                    stacked.push(self.plot(&title, &origin, &format!("{origin}/**"))?);
                }
            }
            made.push(self.container(ContainerKind::Vertical, name, &stacked, &[])?);
        }
        Ok(made)
    }

    fn plot(&mut self, name: &str, origin: &str, query: &str) -> RecordingStreamResult<Placed> {
        let view = self.view("TimeSeries", name, origin, &[query])?;
        let legend = PlotLegend::new().with_corner(Corner2D::RightTop);
        self.stream
            .log(format!("{}/PlotLegend", view.path), &legend)?;
        // all of it, not a window about the cursor
        let axis = TimeAxis::new().with_view_range(TimeRange {
            start: TimeRangeBoundary::Infinite,
            end: TimeRangeBoundary::Infinite,
        });
        self.stream.log(format!("{}/TimeAxis", view.path), &axis)?;
        Ok(view)
    }

    /// A chart, seen as a whole; `more` is room at its right and below.
    fn flat(
        &mut self,
        name: &str,
        origin: &str,
        (x, y): (f64, f64),
        (width, height): (f64, f64),
        more: (f64, f64),
    ) -> RecordingStreamResult<Placed> {
        let view = self.view("2D", name, origin, &["$origin/**"])?;
        let range = Range2D {
            x_range: Range1D([x, x + width + more.0]),
            y_range: Range1D([y, y + height + more.1]),
        };
        let bounds = VisualBounds2D::new(range);
        self.stream
            .log(format!("{}/VisualBounds2D", view.path), &bounds)?;
        Ok(view)
    }

    fn view(
        &mut self,
        class: &str,
        name: &str,
        origin: &str,
        contents: &[&str],
    ) -> RecordingStreamResult<Placed> {
        let id = self.next();
        let path = format!("view/{}", hyphened(&id));
        let contents = ViewContents::new(contents.iter().copied());
        self.stream.log(format!("{path}/ViewContents"), &contents)?;
        let view = ViewBlueprint::new(class)
            .with_display_name(name)
            .with_space_origin(origin);
        self.stream.log(path.as_str(), &view)?;
        let name = name.to_owned();
        Ok(Placed { id, path, name })
    }

    fn tabs(
        &mut self,
        name: &str,
        contents: &[Placed],
        open: usize,
    ) -> RecordingStreamResult<Placed> {
        let tabs = self.container(ContainerKind::Tabs, name, contents, &[])?;
        if let Some(open) = contents.get(open) {
            let open = ContainerBlueprint::update_fields().with_active_tab(open.path.as_str());
            self.stream.log(tabs.path.as_str(), &open)?;
        }
        Ok(tabs)
    }

    fn container(
        &mut self,
        kind: ContainerKind,
        name: &str,
        contents: &[Placed],
        shares: &[f32],
    ) -> RecordingStreamResult<Placed> {
        let id = self.next();
        let path = format!("container/{}", hyphened(&id));
        let mut container = ContainerBlueprint::new(kind)
            .with_display_name(name)
            .with_contents(contents.iter().map(|placed| placed.path.as_str()));
        match kind {
            ContainerKind::Horizontal if !shares.is_empty() => {
                container = container.with_col_shares(shares.iter().copied());
            }
            ContainerKind::Vertical if !shares.is_empty() => {
                container = container.with_row_shares(shares.iter().copied());
            }
            _ => {}
        }
        self.stream.log(path.as_str(), &container)?;
        let name = name.to_owned();
        Ok(Placed { id, path, name })
    }

    /// Names by counting: the same layout each time.
    fn next(&mut self) -> Id {
        self.made += 1;
        let mut id = *b"misfit-layout-00";
        id[15] = self.made;
        id
    }
}

/// 8-4-4-4-12 hexadecimal digits.
fn hyphened(id: &Id) -> String {
    let mut digits = String::new();
    for (index, byte) in id.iter().enumerate() {
        if matches!(index, 4 | 6 | 8 | 10) {
            digits.push('-');
        }
        digits += &format!("{byte:02x}");
    }
    digits
}
