//! How time and memory grow: Markdown tables of processor time, on one thread, by readings, parameters, joints and
//! families, and of the largest memory that this process held.
//!
//! `cargo run --release --example growth > docs/speed.md`. Each figure is the least of some runs: what else the machine
//! does only adds to it.

#[path = "../peers/processor.rs"]
mod processor;

use anyhow::{Context, ensure};
use misfit_campaign::Campaign;
use misfit_cell::scenario::{Scenario, design, simulate};
use misfit_core::diagnosis::diagnose;
use misfit_core::effects::{self, AnyEffect, EffectList};
use misfit_core::fit::{Fit, Options, fit};
use misfit_core::model::{Model, Rows, Workspace};
use misfit_core::model_file;
use misfit_plant::{Command, Plant};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process;
use std::sync::Arc;
use std::time::Instant;

const OPTIONS: Options = Options {
    cross_validate: false,
};
const DEFAULT: &str = "geometry,joint_compliance";
/// Runs of a piece of work go on for so long, s.
const PATIENCE: f64 = 2.0;
/// Shortest piece of work that is timed as one, s: the kernel counts a thread's time by the tick, 4 ms.
const LEAST: f64 = 0.2;

/// The least of at least three runs, s.
fn seconds(mut work: impl FnMut() -> anyhow::Result<()>) -> anyhow::Result<f64> {
    let (begun, mut least, mut runs, mut times) = (Instant::now(), f64::INFINITY, 0, 1);
    while runs < 3 || begun.elapsed().as_secs_f64() < PATIENCE {
        let before = processor::seconds()?;
        for _ in 0..times {
            work()?;
        }
        let used = processor::seconds()? - before;
        if used < LEAST {
            times *= 2;
            continue;
        }
        least = least.min(used / f64::from(times));
        runs += 1;
    }
    Ok(least)
}

fn file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

/// So many readings of a scenario, under as many loads as it has.
fn campaign(scenario: &Scenario, readings: usize) -> anyhow::Result<Campaign> {
    let mut scenario = scenario.clone();
    let each = scenario.design.readings(1) / scenario.design.poses;
    scenario.design.poses = readings / each;
    Ok(simulate::simulate(&scenario, || {})?)
}

/// A model, its fit and the time of that.
fn fitted(campaign: &Campaign, words: &str) -> anyhow::Result<(Model, Fit, f64)> {
    let model = model_file::model(campaign, &EffectList::parse("growth", words)?, None)?;
    let time = seconds(|| {
        fit(campaign, &model, &OPTIONS, |_| {})?;
        Ok(())
    })?;
    let found = fit(campaign, &model, &OPTIONS, |_| {})?;
    ensure!(found.converged, "the fit did not converge");
    Ok((model, found, time))
}

/// Time of a fit by the number of readings.
fn by_readings() -> anyhow::Result<()> {
    println!("## Readings\n\nFit of the six-axis arm of `benches/six_axis.toml`, default model.\n");
    println!("| readings | parameters | steps | fit | per reading |\n|---|---|---|---|---|");
    let scenario = Scenario::load(&file("benches/six_axis.toml"))?;
    let mut entries = Vec::new();
    for readings in [150, 300, 600, 1_200, 2_400, 4_800, 9_600] {
        let campaign = campaign(&scenario, readings)?;
        let (_, found, time) = fitted(&campaign, DEFAULT)?;
        let (count, steps) = (found.values.len(), found.iterations);
        let each = text(time / readings as f64);
        println!(
            "| {readings} | {count} | {steps} | {} | {each} |",
            text(time)
        );
        entries.push((readings, time));
    }
    say_power("readings", &entries);
    Ok(())
}

/// Time of a fit by the number of parameters.
fn by_parameters() -> anyhow::Result<()> {
    println!("\n## Parameters\n\nThe same arm, 1200 readings, models of more and more effects.\n");
    println!("| model | parameters | steps | fit | per parameter |\n|---|---|---|---|---|");
    let campaign = campaign(&Scenario::load(&file("benches/six_axis.toml"))?, 1_200)?;
    let (mut words, mut entries) = (String::new(), Vec::new());
    for (effect, shown) in [
        ("", "frames"),
        ("joint_compliance", "+ joint_compliance"),
        ("joint_offset", "+ joint_offset"),
        ("geometry", "geometry in place of joint_offset"),
        ("transmission_error", "+ transmission_error"),
        ("bearing_tilt", "+ bearing_tilt"),
        ("link_flexibility", "+ link_flexibility"),
    ] {
        words = match effect {
            "geometry" => words.replace("joint_offset", effect),
            _ if words.is_empty() => effect.to_owned(),
            _ => format!("{words},{effect}"),
        };
        let (_, found, time) = fitted(&campaign, &words)?;
        let (count, steps) = (found.values.len(), found.iterations);
        let each = text(time / count as f64);
        println!("| {shown} | {count} | {steps} | {} | {each} |", text(time));
        entries.push((count, time));
    }
    say_power("parameters", &entries);
    Ok(())
}

/// A scenario of an arm of so many joints, axes across and along in turns, 6 kg and 0.25 m each.
fn arm(folder: &Path, joints: usize) -> anyhow::Result<PathBuf> {
    let mut robot = String::from("<robot name=\"arm\"><link name=\"base\"/>\n");
    let mut parent = "base".to_owned();
    for joint in 1..=joints {
        let axis = ["0 0 1", "0 1 0"][(joint + 1) % 2];
        write!(
            robot,
            "<joint name=\"j{joint}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"l{joint}\"/>\
             <origin xyz=\"0 0 0.25\"/><axis xyz=\"{axis}\"/>\
             <limit lower=\"-2\" upper=\"2\" effort=\"5000\" velocity=\"1\"/></joint>\n\
             <link name=\"l{joint}\"><inertial><origin xyz=\"0.02 0 0.12\"/><mass value=\"6\"/>\
             <inertia ixx=\"0.05\" ixy=\"0\" ixz=\"0\" iyy=\"0.05\" iyz=\"0\" izz=\"0.02\"/></inertial></link>\n"
        )?;
        parent = format!("l{joint}");
    }
    robot.push_str("</robot>\n");
    std::fs::write(folder.join("arm.urdf"), robot)?;
    let springs: Vec<String> = (2..=joints)
        .map(|joint| format!("j{joint} = 2e-6"))
        .collect();
    let scenario = folder.join("arm.toml");
    std::fs::write(
        &scenario,
        format!(
            "robot = \"arm.urdf\"\nseed = 1\n[[target]]\nname = \"tip\"\nlink = \"{parent}\"\n\
             [noise]\nposition_m = 1e-5\norientation_rad = 1e-4\n\
             [[truth]]\nkind = \"joint_compliance\"\nvalues = {{ {} }}\n\
             [[truth]]\nkind = \"geometry\"\nrandom = 1.0\n\
             [[truth]]\nkind = \"tracker_frame\"\nvalues = {{ x = 3.0, rz = 2.5 }}\n\
             [design]\nposes = 10\nloads = [{{ mass_kg = 0.0 }}, {{ mass_kg = 5.0, com_m = [0.05, 0.0, 0.05] }}]\n",
            springs.join(", ")
        ),
    )?;
    Ok(scenario)
}

/// Time of everything by the number of joints.
fn by_joints() -> anyhow::Result<()> {
    println!(
        "\n## Joints\n\nSerial arms of equal links, 600 readings under two loads, default model.\n"
    );
    println!(
        "| joints | parameters | forward kinematics | loaded pose | with all derivatives | static state in MuJoCo \
              | steps | fit |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    let mut entries = Vec::new();
    for joints in [3, 6, 9, 12, 15] {
        let folder = tempfile::tempdir()?;
        let scenario = Scenario::load(&arm(folder.path(), joints)?)?;
        let campaign = campaign(&scenario, 600)?;
        let (model, found, whole) = fitted(&campaign, DEFAULT)?;
        let readings = &campaign.readings;
        let each = |time: f64| text(time / readings.len() as f64);
        let forward = seconds(|| {
            for reading in readings {
                std::hint::black_box(campaign.robot.body_poses(&reading.joints));
            }
            Ok(())
        })?;
        let mut workspace = Workspace::new(&model.setup);
        let loaded = seconds(|| {
            for reading in readings {
                std::hint::black_box(workspace.predict(&model, &found.values, reading));
            }
            Ok(())
        })?;
        let wanted = vec![true; found.values.len()];
        let mut rows = Rows::zeros(wanted.len());
        let derivatives = seconds(|| {
            for reading in readings {
                workspace.sensitivity(&model, &found.values, &wanted, reading, &mut rows);
            }
            Ok(())
        })?;
        let mut plant = Plant::build(&simulate::plant_spec(&scenario)?)?;
        let commands: Vec<Command> = design::visits(&scenario)?
            .iter()
            .map(|visit| visit.command(&scenario.design.loads[visit.load]))
            .collect();
        let statics = seconds(|| {
            for command in &commands {
                std::hint::black_box(plant.state(command)?);
            }
            Ok(())
        })?;
        println!(
            "| {joints} | {} | {} | {} | {} | {} | {} | {} |",
            found.values.len(),
            each(forward),
            each(loaded),
            each(derivatives),
            text(statics / commands.len() as f64),
            found.iterations,
            text(whole)
        );
        entries.push((joints, whole));
    }
    say_power("joints (with their parameters)", &entries);
    Ok(())
}

/// A law of the user's own: waves of two joints' angles, each of another number of cycles.
fn law(number: usize) -> anyhow::Result<Arc<dyn AnyEffect>> {
    let table = toml::from_str(&format!(
        "name = \"own{number}\"\nacts_on = \"q[r1_e]\"\nlaw = \"a*sin({}*q[r1_l])*sin({}*q[r1_u])\"\n\
         parameters = {{ a = {{ unit = \"rad\", typical = 1e-4 }} }}",
        1 + number % 4,
        1 + number / 4,
    ))?;
    let expression = effects::find("expression").context("the effect of laws of one's own")?;
    Ok(expression.make(table)?)
}

/// Time of a diagnosis by the number of families weighed.
fn by_families() -> anyhow::Result<()> {
    println!(
        "\n## Families\n\n`misfit diagnose` of `scenarios/hidden.toml`, 240 readings, without cross-validation: \
              the catalogue, and with user-defined laws.\n"
    );
    println!(
        "| families compared | user-defined laws among them | a hidden effect | nothing hidden |\n|---|---|---|---|"
    );
    let scenario = Scenario::load(&file("scenarios/hidden.toml"))?;
    let mut plain = scenario.clone();
    plain
        .truth
        .retain(|truth| truth.effect.id() != "transmission_error");
    let campaigns = [
        simulate::simulate(&scenario, || {})?,
        simulate::simulate(&plain, || {})?,
    ];
    for own in [0, 16, 64, 256] {
        let laws = (0..own).map(law).collect::<anyhow::Result<Vec<_>>>()?;
        let (mut weighed, mut cells) = (0, Vec::new());
        for campaign in &campaigns {
            let model = model_file::model(campaign, &EffectList::DEFAULT, None)?;
            cells.push(text(seconds(|| {
                weighed = diagnose(campaign, &model, &laws, &OPTIONS, |_| {})?
                    .candidates
                    .len();
                Ok(())
            })?));
        }
        println!("| {weighed} | {own} | {} |", cells.join(" | "));
    }
    Ok(())
}

/// Says with which power of a size the time grows, by its first and last entry.
fn say_power(of: &str, entries: &[(usize, f64)]) {
    if let [(small, short), .., (large, long)] = entries {
        let power = (long / short).ln() / (*large as f64 / *small as f64).ln();
        println!(
            "\nFrom {small} to {large} {of} the time of a fit grows with the power {power:.2} of their number."
        );
    }
}

/// Three digits.
fn text(seconds: f64) -> String {
    let (value, unit) = match seconds {
        s if s < 1e-6 => (1e9 * s, "ns"),
        s if s < 1e-3 => (1e6 * s, "µs"),
        s if s < 1.0 => (1e3 * s, "ms"),
        s => (s, "s"),
    };
    let digits = 2_usize.saturating_sub(value.log10().max(0.0) as usize);
    format!("{value:.digits$} {unit}")
}

/// The most memory that a process held which did this work, bytes: this program itself, called with `work` and `readings`.
fn peak(work: &str, readings: usize) -> anyhow::Result<f64> {
    let itself = std::env::current_exe()?;
    let output = process::Command::new(itself)
        .args([work, &readings.to_string()])
        .output()?;
    ensure!(
        output.status.success(),
        "{work} of {readings} readings failed"
    );
    Ok(String::from_utf8(output.stdout)?.trim().parse()?)
}

/// What `peak` calls: does some work and prints the most memory that was held, bytes. Linux only.
fn work(work: &str, readings: usize) -> anyhow::Result<()> {
    let campaign = campaign(&Scenario::load(&file("scenarios/large.toml"))?, readings)?;
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None)?;
    match work {
        "fit" => drop(fit(&campaign, &model, &OPTIONS, |_| {})?),
        _ => drop(diagnose(&campaign, &model, &[], &OPTIONS, |_| {})?),
    }
    let status = std::fs::read_to_string("/proc/self/status").context("Linux, with /proc")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let words = line.and_then(|line| line.split_whitespace().next());
    let kilobytes: f64 = words.context("no VmHWM in /proc/self/status")?.parse()?;
    println!("{}", 1024.0 * kilobytes);
    Ok(())
}

/// Memory by the number of readings, on all threads.
fn memory() -> anyhow::Result<()> {
    println!(
        "\n## Memory\n\nPeak memory of the process, campaign included: the arm of `scenarios/large.toml`, \
         poses and wrenches, default model; a fit and a diagnosis, both without cross-validation.\n"
    );
    println!("| readings | fit | diagnosis | per additional reading |\n|---|---|---|---|");
    let mut before: Option<(usize, [f64; 2])> = None;
    for readings in [6_000, 12_000, 50_000, 100_000] {
        let now = [peak("fit", readings)?, peak("diagnose", readings)?];
        let each = before.map(|(fewer, then)| {
            let each = |k: usize| 1e-3 * (now[k] - then[k]) / (readings - fewer) as f64;
            format!("{:.1}, {:.0} kB", each(0), each(1))
        });
        let each = each.unwrap_or_else(|| "—".to_owned());
        let [fitting, diagnosing] = now.map(|bytes| format!("{:.0} MB", 1e-6 * bytes));
        println!("| {readings} | {fitting} | {diagnosing} | {each} |");
        before = Some((readings, now));
    }
    Ok(())
}

fn main() -> anyhow::Result<()> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    if let [name, readings] = &words[..] {
        return work(name, readings.parse()?);
    }
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    one.install(|| {
        println!(
            "# How time and memory grow\n\nWritten by `make growth`: processor time on one thread of {} shared cores, the minimum \
             over the runs within {PATIENCE} s. A fit takes more steps where its problem is less linear.\n",
            std::thread::available_parallelism()?
        );
        by_readings()?;
        by_parameters()?;
        by_joints()?;
        by_families()
    })?;
    memory()
}
