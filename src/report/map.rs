//! Maps of the workspace: on the terminal, as JSON, as a table of points, and as pictures.

use super::format::{angle, count, length, number, render, table, wrap};
use crate::map::{AXES, By, Map, MapSummary, Off, Request};
use crate::plot::{Content, Figure, Map as Coloured, Panel};
use crate::recording::Cloud;
use crate::robot::JointKind;
use crate::scenario::mapped::{Agreement, Maps, agreement};
use crate::setup::Setup;
use serde::Serialize;
use std::io;

/// Slices of a volume that are shown.
const SLICES: usize = 4;

/// Maps in numbers; the points stand in the CSV.
#[derive(Debug, Serialize)]
pub struct MapDocument {
    /// The load, kg.
    load_kg: f64,
    /// By target and by who tells.
    maps: Vec<MapSummary>,
    /// Where both told.
    agreement: Vec<Agreement>,
}

/// The document.
pub fn document(setup: &Setup, maps: &Maps) -> MapDocument {
    MapDocument {
        load_kg: maps.load.mass,
        maps: maps.maps.iter().map(|map| map.summary(setup)).collect(),
        agreement: agreement(setup, maps),
    }
}

/// What a user reads.
pub fn text(setup: &Setup, wanted: &Request, maps: &Maps) -> String {
    let head = format!(
        "map      {} by {} kg · {}",
        wanted.error.words(),
        number(maps.load.mass),
        where_(maps.maps.first()),
    );
    let mut out = wrap(&head, 9) + "\n";
    for (by, stiffness) in &maps.stiffness {
        let target = maps.maps.first().map_or(0, |map| map.target);
        let line = format!(
            "springs  {}: {}",
            by.words(),
            springs(setup, target, stiffness)
        );
        out += &(wrap(&line, 9) + "\n");
    }
    out.push('\n');
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
            format!("{x:.2} {y:.2} {z:.2}"),
            angle(s.orientation_median_rad),
            angle(s.orientation_max_rad),
        ]);
    }
    out += &render(&rows);
    out += "\n\n";
    for agreement in agreement(setup, maps) {
        let line = format!(
            "agree    {}: model and MuJoCo are at most {} apart, {} of the largest",
            agreement.target,
            length(agreement.position_max_m),
            super::run::percent(agreement.relative)
        );
        out += &(wrap(&line, 9) + "\n");
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
            out += &(wrap(&line, 9) + "\n");
        }
        if s.reached == 0 {
            let line = format!("far      {}: no point is in reach", s.target);
            out += &(wrap(&line, 9) + "\n");
        }
    }
    out
}

/// Which slice or volume.
fn where_(map: Option<&Map>) -> String {
    let Some(Map { grid, .. }) = map else {
        return "nowhere".to_owned();
    };
    let letters: Vec<&str> = grid.axes.iter().map(|&axis| AXES[axis]).collect();
    match (0..3).find(|axis| !grid.axes.contains(axis)) {
        Some(third) => format!(
            "slice {} at {} = {} m",
            letters.join("-"),
            AXES[third],
            number(grid.at[third])
        ),
        None => format!("volume {}", letters.join("-")),
    }
}

/// Springs of a target's chain from the base outwards.
fn springs(setup: &Setup, target: usize, stiffness: &[Option<f64>]) -> String {
    let chain = setup.robot.chain(setup.target_body(target));
    let one = |&joint: &usize| {
        let unit = match setup.robot.joints[joint].kind {
            JointKind::Prismatic => " N/m",
            _ => "",
        };
        stiffness[joint].map_or("—".to_owned(), |k| format!("{}{unit}", number(k / 1e3)))
    };
    let all: Vec<String> = chain.iter().map(one).collect();
    format!("{} kN·m/rad from the base outwards", all.join(", "))
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
        let target = own.first().map_or(0, |map| map.target);
        let columns = match own.first().map(|map| map.grid.axes.len()) {
            Some(3) => panels.len() / (2 * shown.len()).max(1),
            _ => 2,
        };
        Figure {
            title: vec![
                format!(
                    "{robot}: {} under {} kg, {}, by {}",
                    wanted.error.words(),
                    number(maps.load.mass),
                    where_(own.first().copied()),
                    by.words()
                ),
                format!("springs {}", springs(setup, target, stiffness)),
            ],
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
