//! Speeds: `cargo bench`.
//!
//! fit_300x25: 300 readings of the UR10 geometry sized as FIGAROH's problem; fit_12000x45: 12,000 readings and the
//! default model; kinematics: forward and Jacobian of the 15-joint SDA5F; statics: MuJoCo static readings of the 15-joint SDA5F; diagnose: all families on 240 readings with a
//! hidden effect and without; ladder: the 600 fitted readings of UR10 series C, left out unless
//! ../shared/data/ur10_tracker/series_C.toml is there.

#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{BatchSize, BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use misfit_campaign::space::Space;
use misfit_campaign::{Campaign, Reading, Split};
use misfit_cell::scenario::{Job, Scenario, design, planned, simulate};
use misfit_core::compensation::{Reach, Robot, solve};
use misfit_core::diagnosis::diagnose;
use misfit_core::effects::{EffectList, Role};
use misfit_core::fit::{Options, fit};
use misfit_core::ladder;
use misfit_core::map;
use misfit_core::model::{Model, Rows, Workspace};
use misfit_core::model_file;
use misfit_core::plan::{Aim, Task, precise, separate};
use misfit_plant::{Command, Plant};
use std::path::Path;

const OPTIONS: Options = Options {
    cross_validate: false,
};

/// A campaign of so many readings of the six-axis arm: random geometry, springs, no load and 20 kg.
fn campaign(readings: usize) -> Campaign {
    let mut scenario = Scenario::load(Path::new("benches/six_axis.toml")).unwrap();
    scenario.design.poses = readings / 2;
    simulate::simulate(&scenario, || {}).unwrap()
}

fn fits(c: &mut Criterion) {
    let mut group = c.benchmark_group("fit");
    group.sample_size(10);
    // frames, offsets and compliances of six joints with one target: 12 + 6 + 6, and the geometry of one more
    for (readings, effects) in [
        (300, "joint_offset,joint_compliance"),
        (300, "geometry"),
        (1_200, "geometry,joint_compliance"),
        (12_000, "geometry,joint_compliance"),
    ] {
        let campaign = campaign(readings);
        let model = model_file::model(
            &campaign,
            &EffectList::parse("benchmark", effects).unwrap(),
            None,
        )
        .unwrap();
        let name = format!("{effects} ({} parameters)", model.start().len());
        group.throughput(Throughput::Elements(readings as u64));
        group.bench_function(BenchmarkId::new(name, readings), |b| {
            b.iter(|| fit(&campaign, &model, &OPTIONS, |_| {}).unwrap());
        });
    }
    group.finish();
}

/// The unloaded arm with errors of its geometry: postures of both targets in turns.
fn kinematics(c: &mut Criterion) {
    let mut scenario = Scenario::load(Path::new("scenarios/springs.toml")).unwrap();
    scenario.design.poses = 8;
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    let model = model_file::model(&campaign, &EffectList::only(Role::Geometry), None).unwrap();
    let p = true_values(&scenario, &model);
    let mut workspace = Workspace::new(&model.setup);
    let mut jacobian = Rows::zeros(model.setup.robot.joints.len());
    let readings = &campaign.readings;
    let mut group = c.benchmark_group("kinematics of sda5f, both arms");
    group.throughput(Throughput::Elements(readings.len() as u64));
    group.bench_function("forward, nominal, all bodies", |b| {
        b.iter(|| {
            for reading in readings {
                std::hint::black_box(campaign.robot.body_poses(&reading.joints));
            }
        });
    });
    group.bench_function("forward, with geometry, the target", |b| {
        b.iter(|| {
            for reading in readings {
                std::hint::black_box(workspace.predict(&model, &p, reading));
            }
        });
    });
    group.bench_function("the same with the Jacobian of the joints", |b| {
        b.iter(|| {
            for reading in readings {
                workspace.joint_jacobian(&model, &p, reading, &mut jacobian);
            }
        });
    });
    group.finish();
}

fn model(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/springs.toml")).unwrap();
    let mut scenario = scenario;
    scenario.design.poses = 8;
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
    let p = true_values(&scenario, &model);
    let wanted = vec![true; p.len()];
    let mut workspace = Workspace::new(&model.setup);
    let mut jacobian = Rows::zeros(p.len());
    let mut group = c.benchmark_group("sda5f, both arms, default model");
    let readings = &campaign.readings;
    group.throughput(Throughput::Elements(readings.len() as u64));
    group.bench_function("loaded equilibrium and pose", |b| {
        b.iter(|| {
            for reading in readings {
                std::hint::black_box(workspace.predict(&model, &p, reading));
            }
        });
    });
    group.bench_function("the same with all derivatives", |b| {
        b.iter(|| {
            for reading in readings {
                workspace.sensitivity(&model, &p, &wanted, reading, &mut jacobian);
            }
        });
    });
    group.finish();
}

fn true_values(scenario: &Scenario, model: &Model) -> Vec<f64> {
    misfit_cell::scenario::efficiency::true_values(scenario, model)
}

fn statics(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/springs.toml")).unwrap();
    let spec = simulate::plant_spec(&scenario).unwrap();
    let mut plant = Plant::build(&spec).unwrap();
    let commands: Vec<Command> = design::visits(&scenario)
        .unwrap()
        .iter()
        .map(|visit| visit.command(&scenario.design.loads[visit.load]))
        .collect();
    let mut group = c.benchmark_group("mujoco");
    group.throughput(Throughput::Elements(commands.len() as u64));
    group.bench_function("static states of the 15-joint sda5f", |b| {
        b.iter(|| {
            for command in &commands {
                std::hint::black_box(plant.state(command).unwrap());
            }
        });
    });
    group.finish();
}

fn recording(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/springs.toml")).unwrap();
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    assert!(campaign.readings.iter().all(|r| r.split == Split::Fit));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.mcap");
    let mut group = c.benchmark_group("recording");
    group.throughput(Throughput::Elements(campaign.readings.len() as u64));
    group.bench_function("write MCAP", |b| {
        b.iter_batched(
            || (),
            |()| misfit_campaign::recording::write_campaign(&campaign, &path, &Default::default()),
            BatchSize::PerIteration,
        );
    });
    group.bench_function("read MCAP", |b| {
        b.iter(|| misfit_campaign::recording::read_campaign(&path).unwrap());
    });
    group.finish();
}

/// Plans on one core, as a study that plans many of them at once has it.
fn plans(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/hidden.toml")).unwrap();
    let (protocol, campaign) = planned(&scenario).unwrap();
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
    let values = true_values(&scenario, &model);
    let task = Task {
        model: &model,
        values: &values,
        noise: scenario.noise,
        measured: &[],
        protocol,
        space: scenario.design.space.clone(),
        poses: 15,
        candidates: 200,
        seed: 1,
    };
    let effect = |id: &str| {
        misfit_core::effects::find(id)
            .unwrap()
            .make(toml::Table::new())
    };
    let pair = ["joint_hardening", "gravity_backlash"].map(|id| effect(id).unwrap());
    let one = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let mut group = c.benchmark_group("plan, 15 of 200 poses of sda5f's r1, 2 loads, 2 directions");
    group.sample_size(10);
    group.bench_function("tell two effects apart", |b| {
        b.iter(|| one.install(|| separate(&task, [&pair[0], &pair[1]], [None, None]).unwrap()));
    });
    group.bench_function("D-optimal, with the curve", |b| {
        b.iter(|| one.install(|| precise(&task, Aim::D, &[], |_| {}).unwrap()));
    });
    group.finish();
}

/// What is missing in the README's campaign, and in the same without its hidden effect.
fn diagnoses(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/hidden.toml")).unwrap();
    let mut plain = scenario.clone();
    plain
        .truth
        .retain(|truth| truth.effect.id() != "transmission_error");
    let mut group = c.benchmark_group("diagnose, all families, default model");
    group.sample_size(10);
    for (name, scenario) in [("a hidden effect", scenario), ("nothing hidden", plain)] {
        let campaign = simulate::simulate(&scenario, || {}).unwrap();
        let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
        let readings = campaign.readings.len();
        group.bench_function(BenchmarkId::new(name, readings), |b| {
            b.iter(|| diagnose(&campaign, &model, &[], &OPTIONS, |_| {}).unwrap());
        });
    }
    group.finish();
}

/// A real robot, from its frames to the waves of its gears.
fn ladders(c: &mut Criterion) {
    let path = Path::new("../shared/data/ur10_tracker/series_C.toml");
    if !path.exists() {
        eprintln!("ladder: needs the UR10 tracker data at {}", path.display());
        return;
    }
    let campaign = Campaign::load(path).unwrap();
    let fitted = campaign.readings.iter().filter(|r| r.split == Split::Fit);
    let readings = fitted.count();
    let mut group = c.benchmark_group("ladder");
    group.sample_size(10);
    group.bench_function(BenchmarkId::new("UR10 series C", readings), |b| {
        b.iter(|| {
            ladder::climb(&campaign, &EffectList::DEFAULT, &[], None, &OPTIONS, |_| {}).unwrap()
        });
    });
    group.finish();
}

/// One corrected command: the scenario's true model, 5 kg, from the nominal posture, as a controller has it set up.
fn compensation(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/compensate_exact.toml")).unwrap();
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    let words: Vec<&str> = scenario.truth.iter().map(|t| t.effect.id()).collect();
    let model = model_file::model(
        &campaign,
        &EffectList::parse("benchmark", &words.join(",")).unwrap(),
        None,
    )
    .unwrap();
    let values = true_values(&scenario, &model);
    let robot = Robot::new(&model, &values);
    let setup = &model.setup;
    let space = Space::within_limits(&setup.robot, 0.1);
    let mut random = misfit_campaign::space::generator(1, 1);
    let mut workspace = Workspace::new(setup);
    let reach = Reach {
        moving: setup.robot.chain(setup.target_body(0)),
        ranges: Space::within_limits(&setup.robot, 0.0).ranges,
    };
    let mut task = campaign
        .readings
        .iter()
        .find(|r| r.target == 0)
        .unwrap()
        .clone();
    task.payload = task.payload.map(|payload| misfit_campaign::Payload {
        mass: 5.0,
        ..payload
    });
    // poses of the nominal robot, which it reaches with the postures that they are of
    let tasks: Vec<Reading> = (0..100)
        .map(|_| {
            let joints = space.random_posture(setup, &mut random).unwrap();
            let there = Reading {
                joints,
                ..task.clone()
            };
            let pose = workspace.predict(&model, &robot.nominal, &there);
            Reading {
                position: pose.position,
                orientation: Some(pose.orientation),
                ..there
            }
        })
        .collect();
    let mut group = c.benchmark_group("compensation");
    group.throughput(Throughput::Elements(tasks.len() as u64));
    group.bench_function("100 poses of r1", |b| {
        b.iter(|| {
            for task in &tasks {
                let near = (&task.joints[..], &task.joints[..]);
                let found = solve(&mut workspace, &model, &robot.values, task, near, &reach);
                std::hint::black_box(found);
            }
        });
    });
    group.finish();
}

/// A slice of 10,000 points of one arm by the model: postures and deflections.
fn maps(c: &mut Criterion) {
    let scenario = Scenario::load(Path::new("scenarios/map.toml")).unwrap();
    let campaign = simulate::simulate(&scenario, || {}).unwrap();
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
    let values = true_values(&scenario, &model);
    let robot = Robot::new(&model, &values);
    let setup = &model.setup;
    let Job::Map(wanted) = scenario.job.clone() else {
        panic!("map.toml maps nothing");
    };
    let space = &scenario.design.space;
    let reach = Reach {
        moving: setup.robot.chain(setup.target_body(0)),
        ranges: space.ranges.clone(),
    };
    let posture = wanted.posture(setup, space);
    let grid = wanted.grid(setup, 0, &posture, &reach).unwrap();
    let load = misfit_campaign::Payload {
        mass: 5.0,
        com: nalgebra::Vector3::zeros(),
    };
    let mut group = c.benchmark_group("map");
    group.sample_size(10);
    group.throughput(Throughput::Elements(grid.len() as u64));
    group.bench_function(BenchmarkId::new("slice by the model", grid.len()), |b| {
        b.iter(|| {
            let found = map::postures(&robot, 0, &grid, &posture, (&reach, false));
            map::by_model(&robot, 0, &found, &load, map::Which::Load)
        });
    });
    group.finish();
}

criterion_group!(
    benches,
    kinematics,
    fits,
    model,
    statics,
    recording,
    plans,
    diagnoses,
    ladders,
    compensation,
    maps
);
criterion_main!(benches);
