//! Maps of the workspace: on the terminal, as JSON, as a table of points, and as pictures.

use super::format::{angle, count, length, number, render, say, table, wrap};
use crate::plot::{Content, Figure, Map as Coloured, Panel};
use misfit_arm::robot::JointKind;
use misfit_campaign::recording::Cloud;
use misfit_campaign::setup::Setup;
use misfit_cell::scenario::mapped::{Agreement, Maps, agreement};
use misfit_core::map::{AXES, By, Map, MapSummary, Off, Request, Which};
use serde::Serialize;
use std::io;

/// Slices of a volume that are shown.
const SLICES: usize = 4;

/// Maps in numbers; the points stand in the CSV.
#[derive(Debug, Serialize)]
pub struct MapDocument {
    /// `load` or `total`.
    error: Which,
    /// The load, kg.
    load_kg: f64,
    /// Its centre in the target's link, m.
    com_m: [f64; 3],
    /// Axes of the slice or volume.
    axes: String,
    /// Where the points are, by target: ranges along the axes, m; and the third coordinate of a slice.
    grids: Vec<GridDocument>,
    /// Is the orientation of the posture of reference held?
    hold_orientation: bool,
    /// Stiffness by who tells and joint, N·m/rad (N/m); none is rigid or not known.
    springs: Vec<SpringsDocument>,
    /// By target and by who tells.
    maps: Vec<MapSummary>,
    /// Where both told of a load.
    agreement: Vec<Agreement>,
}

#[derive(Debug, Serialize)]
struct GridDocument {
    target: String,
    ranges_m: Vec<[f64; 2]>,
    counts: Vec<usize>,
    at_m: Option<f64>,
}

#[derive(Debug, Serialize)]
struct SpringsDocument {
    by: By,
    joints: Vec<(String, Option<f64>)>,
}

/// How far model and plant are apart, of what a load does. All that a target is off is against each one's own nominal robot,
/// and the fitted one stands elsewhere: no agreement is to be expected.
fn agreements(setup: &Setup, wanted: &Request, maps: &Maps) -> Vec<Agreement> {
    match wanted.error {
        Which::Load => agreement(setup, maps),
        Which::Total => Vec::new(),
    }
}

/// The document.
pub fn document(setup: &Setup, wanted: &Request, maps: &Maps) -> MapDocument {
    let first = maps.stiffness.first().map(|(by, _)| *by);
    let each = maps.maps.iter().filter(|map| Some(map.by) == first);
    let axes = maps.maps.first().map(|map| letters(map, ""));
    MapDocument {
        error: wanted.error,
        com_m: maps.load.com.into(),
        axes: axes.unwrap_or_default(),
        grids: each
            .map(|map| GridDocument {
                target: setup.targets[map.target].name.clone(),
                ranges_m: map.grid.ranges.iter().map(|(a, b)| [*a, *b]).collect(),
                counts: map.grid.counts.clone(),
                at_m: third(map).map(|axis| map.grid.at[axis]),
            })
            .collect(),
        hold_orientation: wanted.hold_orientation,
        springs: maps
            .stiffness
            .iter()
            .map(|(by, all)| SpringsDocument {
                by: *by,
                joints: setup
                    .robot
                    .joints
                    .iter()
                    .zip(all)
                    .map(|(joint, k)| (joint.name.clone(), *k))
                    .collect(),
            })
            .collect(),
        load_kg: maps.load.mass,
        maps: maps.maps.iter().map(|map| map.summary(setup)).collect(),
        agreement: agreements(setup, wanted, maps),
    }
}

/// The axis that a slice does not have.
fn third(map: &Map) -> Option<usize> {
    (0..3).find(|axis| !map.grid.axes.contains(axis))
}

/// The letters of a map's axes.
fn letters(map: &Map, between: &str) -> String {
    let letters: Vec<&str> = map.grid.axes.iter().map(|&axis| AXES[axis]).collect();
    letters.join(between)
}

/// What a user reads.
pub fn text(setup: &Setup, wanted: &Request, maps: &Maps) -> String {
    let head = format!(
        "map      {} by {} kg · {}",
        wanted.error.words(),
        number(maps.load.mass),
        where_(setup, &maps.maps),
    );
    let mut out = wrap(&head, 9) + "\n";
    for (by, stiffness) in &maps.stiffness {
        for line in springs(setup, &maps.maps, stiffness) {
            say(&mut out, &format!("springs  {}: {line}", by.words()));
        }
    }
    out.push('\n');
    out += &(summary_table(setup, maps) + "\n\n");
    for agreement in agreements(setup, wanted, maps) {
        let line = format!(
            "agree    {}: model and MuJoCo are at most {} apart, {} of the largest",
            agreement.target,
            length(agreement.position_max_m),
            super::format::percent(agreement.relative)
        );
        say(&mut out, &line);
    }
    for map in &maps.maps {
        let s = map.summary(setup);
        if s.collapsed > 0 {
            let line = format!(
                "load     {}: at {} the arm does not hold this load by {}",
                s.target,
                count(s.collapsed, "point"),
                s.by.words()
            );
            say(&mut out, &line);
        }
        if s.overloaded > 0 {
            let line = format!(
                "load     {}: at {} of {} a joint bears more than it is rated for, by {}",
                s.target,
                count(s.overloaded, "point"),
                s.reached,
                s.by.words()
            );
            say(&mut out, &line);
        }
        if s.reached == 0 && Some(map.by) == maps.stiffness.first().map(|(by, _)| *by) {
            let line = format!("far      {}: no point is in reach", s.target);
            say(&mut out, &line);
        }
    }
    out
}

fn summary_table(setup: &Setup, maps: &Maps) -> String {
    let header = [
        "target",
        "by",
        "points",
        "in reach",
        "position, median",
        "largest",
        "at x, y, z, m",
        "turned, median",
        "largest",
    ];
    let mut rows = table(&header, &[2, 3, 4, 5, 7, 8]);
    for map in &maps.maps {
        let s = map.summary(setup);
        let [x, y, z] = s.position_max_at_m;
        rows.add_row(vec![
            s.target.clone(),
            s.by.words().to_owned(),
            s.points.to_string(),
            s.reached.to_string(),
            length(s.position_median_m),
            length(s.position_max_m),
            match x.is_finite() {
                true => format!("{x:.2} {y:.2} {z:.2}"),
                false => "—".to_owned(),
            },
            angle(s.orientation_median_rad),
            angle(s.orientation_max_rad),
        ]);
    }
    render(&rows)
}

/// Which slices or volume.
fn where_(setup: &Setup, maps: &[Map]) -> String {
    let Some(first) = maps.first() else {
        return "nowhere".to_owned();
    };
    let Some(third) = third(first) else {
        return format!("volume {}", letters(first, "-"));
    };
    let own: Vec<&Map> = maps.iter().filter(|map| map.by == first.by).collect();
    let at = |map: &Map| format!("{} m", number(map.grid.at[third]));
    let same = own
        .iter()
        .all(|map| map.grid.at[third] == first.grid.at[third]);
    let places = match same {
        true => at(first),
        false => {
            let all: Vec<String> = own
                .iter()
                .map(|map| format!("{} ({})", at(map), setup.targets[map.target].name))
                .collect();
            all.join(", ")
        }
    };
    format!(
        "slice {} at {} = {places}",
        letters(first, "-"),
        AXES[third]
    )
}

/// Springs of the targets' chains from the base outwards: one line for all that have the same, else one for each target.
fn springs(setup: &Setup, maps: &[Map], stiffness: &[Option<f64>]) -> Vec<String> {
    let of = |target: usize| {
        let chain = setup.robot.chain(setup.target_body(target));
        let one = |&joint: &usize| {
            let unit = match setup.robot.joints[joint].kind {
                JointKind::Prismatic => " kN/m",
                _ => "",
            };
            stiffness[joint].map_or("—".to_owned(), |k| format!("{}{unit}", number(k / 1e3)))
        };
        let all: Vec<String> = chain.iter().map(one).collect();
        format!("{} kN·m/rad from the base outwards", all.join(", "))
    };
    let mut lines: Vec<(usize, String)> = Vec::new();
    for map in maps {
        if lines.iter().all(|(target, _)| *target != map.target) {
            lines.push((map.target, of(map.target)));
        }
    }
    let same = lines
        .iter()
        .all(|(_, line)| Some(line) == lines.first().map(|l| &l.1));
    match same {
        true => lines.into_iter().take(1).map(|(_, line)| line).collect(),
        false => lines
            .into_iter()
            .map(|(target, line)| format!("{} {line}", setup.targets[target].name))
            .collect(),
    }
}

/// Every point as a table: base frame, errors where it is in reach, the posture.
///
/// # Errors
/// What the writer says.
pub fn write_csv(setup: &Setup, maps: &[Map], out: impl io::Write) -> io::Result<()> {
    let mut table = csv::Writer::from_writer(out);
    let names = ["target", "by", "x_m", "y_m", "z_m"];
    let mut header: Vec<String> = names.map(str::to_owned).to_vec();
    header.extend(["position_error_mm", "orientation_error_mrad"].map(str::to_owned));
    for joint in &setup.robot.joints {
        let unit = match joint.kind {
            JointKind::Prismatic => "m",
            _ => "rad",
        };
        header.push(format!("{}_{unit}", joint.name));
    }
    table.write_record(&header)?;
    for map in maps {
        for (index, joints) in map.postures.iter().enumerate() {
            let point = map.grid.point(index);
            let by = match map.by {
                By::Model => "model",
                By::Plant => "plant",
            };
            let mut cells = vec![setup.targets[map.target].name.clone(), by.to_owned()];
            cells.extend(point.iter().map(f64::to_string));
            match &map.off[index] {
                Some(off) => cells.extend([
                    (off.position * 1e3).to_string(),
                    (off.orientation * 1e3).to_string(),
                ]),
                None => cells.extend([String::new(), String::new()]),
            }
            match joints {
                Some(joints) => cells.extend(joints.iter().map(f64::to_string)),
                None => cells.extend(setup.robot.joints.iter().map(|_| String::new())),
            }
            table.write_record(&cells)?;
        }
    }
    table.flush()
}

/// One picture for each who tells: a row a target, position beside orientation; of a volume some slices.
pub fn figures(
    setup: &Setup,
    robot: &str,
    wanted: &Request,
    maps: &Maps,
) -> Vec<(&'static str, Figure)> {
    let of = |by: By, stiffness: &[Option<f64>]| {
        let own: Vec<&Map> = maps.maps.iter().filter(|map| map.by == by).collect();
        let shown: Vec<&&Map> = own
            .iter()
            .filter(|map| map.off.iter().any(Option::is_some))
            .collect();
        let panels: Vec<Panel> = shown.iter().flat_map(|map| panels(setup, map)).collect();
        let columns = match own.first().map(|map| map.grid.axes.len()) {
            Some(3) => panels.len() / (2 * shown.len()).max(1),
            _ => 2,
        };
        Figure {
            title: std::iter::once(format!(
                "{robot}: {} under {} kg, {}, by {}",
                wanted.error.words(),
                number(maps.load.mass),
                where_(setup, &maps.maps),
                by.words()
            ))
            .chain(
                springs(setup, &maps.maps, stiffness)
                    .into_iter()
                    .map(|line| format!("springs {line}")),
            )
            .collect(),
            panels,
            columns,
            panel_size: (520, 430),
        }
    };
    let all = maps.stiffness.iter().map(|(by, stiffness)| {
        let name = match by {
            By::Model => "model",
            By::Plant => "plant",
        };
        (name, of(*by, stiffness))
    });
    all.filter(|(_, figure)| !figure.panels.is_empty())
        .collect()
}

/// Position in mm and orientation in mrad.
fn panels(setup: &Setup, map: &Map) -> Vec<Panel> {
    let grid = &map.grid;
    let target = &setup.targets[map.target].name;
    let layer = grid.counts[0] * grid.counts[1];
    let layers = grid.len() / layer;
    // of the layers that have points
    let own: Vec<usize> = (0..layers)
        .filter(|slice| {
            map.off[slice * layer..(slice + 1) * layer]
                .iter()
                .any(Option::is_some)
        })
        .collect();
    let count = SLICES.min(own.len());
    let shown = (0..count).map(|k| own[(2 * k + 1) * own.len() / (2 * count)]);
    let shown: Vec<usize> = shown.collect();
    let size = |off: &Off, turned: bool| match turned {
        false => off.position * 1e3,
        true => off.orientation * 1e3,
    };
    let most = |turned: bool| {
        let all = map.off.iter().flatten().map(|off| size(off, turned));
        all.max_by(f64::total_cmp)
    };
    let mut panels = Vec::new();
    for turned in [false, true] {
        for &slice in &shown {
            let own = &map.off[slice * layer..(slice + 1) * layer];
            let values = own.iter().map(|off| off.map(|off| size(&off, turned)));
            let values: Vec<Option<f64>> = values.collect();
            if values.iter().all(Option::is_none) {
                continue;
            }
            let (quantity, unit) = match turned {
                false => ("position", "mm"),
                true => ("orientation", "mrad"),
            };
            let at = match grid.axes.get(2) {
                Some(&third) => format!(
                    ", {} = {} m",
                    AXES[third],
                    number(grid.point(slice * layer)[third])
                ),
                None => String::new(),
            };
            panels.push(Panel {
                title: format!("{target}: {quantity}{at}"),
                x: format!("{}, mm", AXES[grid.axes[0]]),
                y: format!("{}, mm", AXES[grid.axes[1]]),
                content: Content::Map(Coloured {
                    x: grid.along(0).iter().map(|x| x * 1e3).collect(),
                    y: grid.along(1).iter().map(|y| y * 1e3).collect(),
                    values,
                    unit: unit.to_owned(),
                    // slices are to be compared
                    top: most(turned),
                }),
            });
        }
    }
    panels
}

/// Points for the viewer.
pub fn clouds(setup: &Setup, maps: &[Map]) -> Vec<Cloud> {
    let one = |map: &Map| {
        let by = match map.by {
            By::Model => "model",
            By::Plant => "plant",
        };
        let points = map.off.iter().enumerate().filter_map(|(index, off)| {
            let off = off.as_ref()?;
            Some((map.grid.point(index), off.position, off.orientation))
        });
        Cloud {
            name: format!("{}_{by}", setup.targets[map.target].name),
            points: points.collect(),
        }
    };
    maps.iter().map(one).collect()
}
