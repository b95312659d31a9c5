//! Maps of the workspace: grids, postures, the model against MuJoCo, files and refusals.

use assert_cmd::Command;
use misfit_campaign::Payload;
use misfit_cell::scenario::mapped::{agreement, last_load, map};
use misfit_cell::scenario::{Scenario, efficiency, simulate};
use misfit_core::compensation::{Reach, Robot};
use misfit_core::effects::EffectList;
use misfit_core::map::{By, Map, Request, Which, postures};
use misfit_core::model_file;
use std::path::Path;

fn scenario() -> Scenario {
    let mut scenario = Scenario::load(Path::new("scenarios/map.toml")).unwrap();
    scenario.noise = misfit_campaign::Noise::default();
    scenario.design.poses = 2;
    scenario
}

fn load(scenario: &Scenario) -> Payload {
    last_load(scenario).unwrap()
}

fn request(points: usize, by: &[By]) -> Request {
    Request {
        points: Some(points),
        by: Some(by.to_vec()),
        model: Some("true".to_owned()),
        plane: Some("yz".to_owned()),
        at_m: Some(0.3),
        ..Request::default()
    }
}

/// The nominal robot stands where the map says that it does, in reach of every point that is not far out.
#[test]
fn postures_are_at_their_points() {
    let scenario = scenario();
    let setup = &scenario.setup;
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    let model = model_file::model(&campaign, &EffectList::FRAMES, None).unwrap();
    let values = efficiency::true_values(&scenario, &model);
    let robot = Robot::new(&model, &values);
    let spec = simulate::plant_spec(&scenario).unwrap();
    let space = &scenario.design.space;
    let mut wanted = request(300, &[By::Plant]);
    for plane in ["yz", "xz", "yx", "xyz"] {
        wanted.plane = Some(plane.to_owned());
        wanted.at_m = None;
        for (target, hold) in [(0, false), (1, false), (0, true)] {
            let posture = wanted.posture(setup, space);
            let reach = Reach {
                moving: setup.robot.chain(setup.target_body(target)),
                ranges: space.ranges.clone(),
            };
            let grid = wanted.grid(setup, target, &posture, &reach).unwrap();
            let found = postures(&robot, target, &grid, &posture, (&reach, hold));
            assert_eq!(found.len(), grid.len());
            let link = &setup.robot.links[setup.targets[target].link];
            let home = setup.robot.body_poses(&posture)[link.body] * link.body_from_link;
            let mut reached = 0;
            for (index, joints) in found.iter().enumerate() {
                let Some(joints) = joints else { continue };
                reached += 1;
                let poses = setup.robot.body_poses(joints);
                let pose = poses[link.body] * link.body_from_link * spec.targets[target].1;
                let off = (pose.translation.vector - grid.point(index)).norm();
                assert!(off < 1e-8, "{plane} {target}: {off} m");
                if hold {
                    let link = poses[link.body] * link.body_from_link;
                    let turned = link.rotation.angle_to(&home.rotation);
                    assert!(turned < 1e-8, "{turned} rad");
                }
                let inside = joints.iter().zip(&space.ranges);
                for (q, (least, most)) in inside {
                    assert!(q >= least && q <= most);
                }
            }
            let least = if hold { 0.02 } else { 0.2 };
            let share = f64::from(reached) / grid.len() as f64;
            assert!(share > least, "{plane} {target} {hold}: {share} reached");
        }
    }
}

/// What one computes by dual quaternions and the other by MuJoCo is one map, for a load and for all errors.
#[test]
fn model_and_plant_draw_the_same_map() {
    let scenario = scenario();
    for which in [Which::Load, Which::Total] {
        let mut wanted = request(200, &[By::Plant, By::Model]);
        wanted.error = which;
        let maps = map(&scenario, &wanted, load(&scenario), || {}).unwrap();
        assert_eq!(maps.maps.len(), 4);
        let most = maps.maps[0].summary(&scenario.setup).position_max_m;
        match which {
            // 5 kg at the end of a metre of springs like these
            Which::Load => assert!((5e-4..5e-3).contains(&most), "{most}"),
            Which::Total => assert!((2e-3..2e-2).contains(&most), "{most}"),
        }
        for pair in agreement(&scenario.setup, &maps) {
            assert!(pair.position_max_m < 1e-11, "{which:?}: {pair:?}");
        }
    }
}

/// Arms that mirror each other have maps that do.
#[test]
fn mirrored_arms_have_mirrored_maps() {
    let mut scenario = scenario();
    scenario.truth.retain(|t| t.effect.id() != "geometry");
    for truth in &mut scenario.truth {
        if truth.effect.id() == "target_offset" {
            truth.values.iter_mut().for_each(|(_, value)| *value = 0.0);
        }
    }
    if let Some(load) = scenario.design.loads.last_mut() {
        load.com = nalgebra::Vector3::zeros();
    }
    let maps = map(
        &scenario,
        &request(400, &[By::Plant]),
        load(&scenario),
        || {},
    )
    .unwrap();
    let [left, right] = &maps.maps[..] else {
        panic!()
    };
    let width = left.grid.counts[0];
    let mut both = 0;
    for index in 0..left.grid.len() {
        let mirrored = index / width * width + (width - 1 - index % width);
        let sum = left.grid.point(index).y + right.grid.point(mirrored).y;
        assert!(sum.abs() < 1e-12);
        if let (Some(a), Some(b)) = (&left.off[index], &right.off[mirrored]) {
            // the same posture, mirrored; where two are equally near, one arm may take the other
            both += usize::from((a.position - b.position).abs() < 1e-6);
        }
    }
    let reached = left.off.iter().flatten().count();
    assert!(both as f64 > 0.9 * reached as f64, "{both} of {reached}");
}

#[test]
fn maps_are_the_same_for_any_number_of_threads() {
    let scenario = scenario();
    let by = |threads: usize| -> Vec<Map> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let wanted = request(300, &[By::Model]);
        pool.unwrap().install(|| {
            map(&scenario, &wanted, load(&scenario), || {})
                .unwrap()
                .maps
        })
    };
    assert_eq!(by(1), by(3));
}

fn misfit(words: &[&str]) -> std::process::Output {
    Command::cargo_bin("misfit")
        .unwrap()
        .args(words)
        .output()
        .unwrap()
}

#[test]
fn a_map_is_written_as_pictures_table_and_points() {
    let folder = tempfile::tempdir().unwrap();
    let stem = folder.path().join("slice");
    let stem = stem.to_str().unwrap();
    let words = [
        "map",
        "scenarios/map.toml",
        "--by",
        "plant",
        "--points",
        "200",
        "-o",
        stem,
    ];
    let out = misfit(&words);
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let svg = std::fs::read_to_string(format!("{stem}.svg")).unwrap();
    for text in ["deflection under 5.00 kg", "y, mm", "z, mm", "mrad", "35.0"] {
        assert!(svg.contains(text), "{text}");
    }
    let png = std::fs::read(format!("{stem}.png")).unwrap();
    assert!(png.starts_with(b"\x89PNG"));
    let table = std::fs::read_to_string(format!("{stem}.csv")).unwrap();
    let mut lines = table.lines();
    assert!(
        lines
            .next()
            .unwrap()
            .starts_with("target,by,x_m,y_m,z_m,position_error_mm")
    );
    let found = lines.filter(|line| !line.contains(",,")).count();
    // each arm's points as a cloud of 24 bytes a point, beside the robot
    let bytes = std::fs::read(format!("{stem}.mcap")).unwrap();
    let mut clouds = 0;
    let mut others = Vec::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        match &message.channel.topic[..] {
            "/map/r1_plant" | "/map/r2_plant" => clouds += message.data.len() / 24,
            topic => others.push(topic.to_owned()),
        }
    }
    assert_eq!(others, ["/robot_description", "/tf_static", "/tf"]);
    // headers and field names are less than 20 points' worth
    assert!(clouds > found && clouds < found + 20, "{clouds} {found}");
    let again = folder.path().join("again");
    let words = [&words[..7], &[again.to_str().unwrap()]].concat();
    assert!(misfit(&words).status.success());
    assert_eq!(
        bytes,
        std::fs::read(folder.path().join("again.mcap")).unwrap()
    );
}

#[test]
fn what_makes_no_map_is_refused() {
    let table: [(&[&str], i32, &str); 13] = [
        (&["--load-kg", "0"], 1, "the load is 0 kg"),
        (&["--targets", "r1,r1"], 1, "targets has \"r1\" twice"),
        (&["--load-kg=-1"], 2, "accepted: 0 or more"),
        (&["--plane", "xx"], 1, "plane is \"xx\"; accepted"),
        (&["--plane", "w"], 1, "plane is \"w\"; accepted"),
        (&["--plane", "xyz", "--at-m", "1"], 1, "at_m is of a slice"),
        (&["--at-m", "NaN"], 1, "at_m is NaN; accepted"),
        (&["--points", "0"], 1, "points is 0; accepted"),
        (
            &["--targets", "nobody"],
            1,
            "no target is called \"nobody\"; known: r1, r2",
        ),
        (&["--load-kg", "-1"], 2, ""),
        (&["--load-kg", "inf"], 2, "accepted: 0 or more"),
        (&["--com-m", "1,2"], 2, "accepted: three numbers"),
        (&["--effects", "geometry"], 2, "go with a campaign"),
    ];
    for (words, code, message) in table {
        let out = misfit(&[&["map", "scenarios/map.toml"], words].concat());
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{words:?}: {said}");
        assert!(said.contains(message), "{words:?}: {said}");
    }
}
