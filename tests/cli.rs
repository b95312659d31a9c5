//! The command line as its users and their scripts see it: files, streams, exit codes, messages.

use assert_cmd::Command;
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::LazyLock;
use tempfile::TempDir;

const SIX_AXIS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/six_axis/six_axis.urdf");
const SDA5F: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/sda5f/sda5f.urdf");

/// What a compliant six-axis arm hides. The weights of its links make every joint but the first sag.
const TRUTH: &str = "[[truth]]\nkind = \"joint_compliance\"\n\
    values = { a1 = 1e-6, a2 = 1e-6, a3 = 2e-6, a4 = 5e-6, a5 = 5e-6, a6 = 8e-6 }\n\
    [[truth]]\nkind = \"tracker_frame\"\nvalues = { x = 2.5, y = 0.5, z = 1.0, rz = 2.5 }\n";
const DESIGN: &str = "poses = 14\nheldout_poses = 4\nrepeats = 2\n\
    loads = [{ mass_kg = 0.0 }, { mass_kg = 40.0, com_m = [0.1, 0.0, 0.1] }]\n";
const NOISE: &str = "position_m = 1e-5\norientation_rad = 8.7e-5\n";

/// A scenario of the six-axis arm: keys before the tables, the design, and tables after it.
fn scenario(top: &str, design: &str, tail: &str) -> String {
    format!(
        "robot = {SIX_AXIS:?}\nseed = 3\n{top}\n[[target]]\nname = \"flange\"\nlink = \"flange\"\n\
         [noise]\n{NOISE}[design]\n{design}\n{tail}\n"
    )
}

fn cell() -> String {
    scenario("", DESIGN, TRUTH)
}

/// The program, run in a folder.
pub fn misfit(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    command.current_dir(folder).env_remove("RUST_BACKTRACE");
    command
}

/// How a run ended.
struct Ran {
    code: Option<i32>,
    out: String,
    err: String,
}

/// Runs the program; whatever it is asked, it does not panic, keeps to 100 columns, and colours nothing.
#[track_caller]
fn run(folder: &Path, words: &[&str]) -> Ran {
    let output = misfit(folder).args(words).output().unwrap();
    let ran = Ran {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    };
    assert!(!ran.err.contains("panicked"), "{words:?}: {}", ran.err);
    assert!(!ran.out.contains('\x1b'), "{words:?}: {}", ran.out);
    assert!(!ran.err.contains('\x1b'), "{words:?}: {}", ran.err);
    ran
}

/// A run that ends with this code and says nothing on stderr: its stdout.
#[track_caller]
fn ends(code: i32, folder: &Path, words: &[&str]) -> String {
    let ran = run(folder, words);
    assert_eq!(ran.code, Some(code), "{words:?}: {}{}", ran.out, ran.err);
    assert_eq!(ran.err, "", "{words:?}");
    if !words.contains(&"--json") {
        assert_width(&ran.out);
    }
    ran.out
}

#[track_caller]
fn done(folder: &Path, words: &[&str]) -> String {
    ends(0, folder, words)
}

/// A run that could not do it: exit code 1, nothing on stdout, and every one of `parts` in the message.
#[track_caller]
pub fn refused(folder: &Path, words: &[&str], parts: &[&str]) {
    let ran = run(folder, words);
    assert_eq!(ran.code, Some(1), "{words:?}: {}{}", ran.out, ran.err);
    assert_eq!(ran.out, "", "{words:?}");
    // what is found about the data may be said before
    let (before, _) = ran
        .err
        .split_at(ran.err.find("misfit: ").unwrap_or(ran.err.len()));
    let said = |line: &str| line.starts_with("warning: ") || line.starts_with("note: ");
    assert!(before.lines().all(said), "{words:?}: {}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "no {part:?} in: {}", ran.err);
    }
    // a cause that the message holds is not said again
    if let Some(at) = ran.err.find("(os error") {
        assert_eq!(
            ran.err.matches(&ran.err[at..at + 9]).count(),
            1,
            "{}",
            ran.err
        );
    }
}

#[track_caller]
fn assert_width(text: &str) {
    for line in text.lines() {
        assert!(line.chars().count() <= 100, "too wide: {line}");
        assert_eq!(line, line.trim_end(), "trailing blanks");
    }
}

#[track_caller]
fn json(folder: &Path, words: &[&str]) -> Value {
    serde_json::from_str(&done(folder, words)).unwrap()
}

/// Names of the files in a folder.
fn files(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).unwrap();
    entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

fn write(folder: &Path, name: &str, text: &str) {
    fs::write(folder.join(name), text).unwrap();
}

/// A folder with a simulated campaign: cell.toml (scenario), cell.mcap, cell/ (the same as CSV).
static LAB: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = TempDir::new().unwrap();
    write(folder.path(), "cell.toml", &cell());
    let words = ["simulate", "cell.toml", "-o", "cell.mcap", "--csv", "cell"];
    done(folder.path(), &words);
    folder
});

fn lab() -> &'static Path {
    LAB.path()
}

/// The campaign's CSV folder, copied to be spoilt.
fn copy() -> TempDir {
    let folder = TempDir::new().unwrap();
    for name in files(&lab().join("cell")) {
        fs::copy(lab().join("cell").join(&name), folder.path().join(&name)).unwrap();
    }
    folder
}

/// Replaces a piece of a file, which must be in it.
#[track_caller]
fn replace(path: PathBuf, from: &str, to: &str) {
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "no {from:?} in {}", path.display());
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

/// A fit of `document`: value, standard deviation and status of a parameter.
fn parameter<'a>(document: &'a Value, effect: &str, name: &str) -> &'a Value {
    let rows = document["parameters"].as_array().unwrap();
    let mut found = rows
        .iter()
        .filter(|row| row["effect"] == effect && row["name"] == name);
    let row = found.next().expect("no such parameter");
    assert!(found.next().is_none());
    row
}

// ---- simulate

#[test]
fn simulate_writes_a_recording_by_the_scenarios_name() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "small.toml", &scenario("", "poses = 3", ""));
    let said = done(at, &["simulate", "small.toml"]);
    assert_eq!(
        said,
        "small.mcap · 3 readings\nsmall.truth.toml · the truth, for scoring\n\n\
         next     misfit fit small.mcap     or     misfit diagnose small.mcap\n"
    );
    let expected = ["small.mcap", "small.toml", "small.truth.toml"];
    assert_eq!(files(at), expected.map(str::to_owned).into());
}

#[test]
fn simulate_writes_where_it_is_told_and_the_truth_beside_it() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "s.toml", &scenario("", "poses = 3", TRUTH));
    fs::create_dir(at.join("out")).unwrap();
    done(at, &["simulate", "s.toml", "-o", "out/x.1.mcap"]);
    let expected = ["x.1.mcap", "x.1.truth.toml"];
    assert_eq!(files(&at.join("out")), expected.map(str::to_owned).into());

    // two folders that differ after a point keep a truth each
    done(at, &["simulate", "s.toml", "--csv", "deep/cell.1"]);
    done(at, &["simulate", "s.toml", "--csv", "deep/cell.2/"]);
    let expected = ["cell.1", "cell.1.truth.toml", "cell.2", "cell.2.truth.toml"];
    assert_eq!(files(&at.join("deep")), expected.map(str::to_owned).into());
    let expected = ["campaign.toml", "readings.csv", "six_axis.urdf"];
    assert_eq!(
        files(&at.join("deep/cell.1")),
        expected.map(str::to_owned).into()
    );

    // `.` has a name, too
    let here = at.join("here");
    fs::create_dir(&here).unwrap();
    done(&here, &["simulate", "../s.toml", "--csv", "."]);
    assert_eq!(files(&here), expected.map(str::to_owned).into());
    assert!(at.join("here.truth.toml").exists());
}

#[test]
fn the_truth_is_in_its_own_file_alone() {
    let truth = fs::read_to_string(lab().join("cell.truth.toml")).unwrap();
    assert!(truth.contains("kind = \"joint_compliance\"\n[effect.values]\n\"a1\" = 1e-6\n"));
    assert!(truth.contains("\"rz\" = 2.5\n"));
    for name in files(&lab().join("cell")) {
        let text = fs::read_to_string(lab().join("cell").join(&name)).unwrap();
        for word in ["compliance", "truth", "2.5e0", "seed"] {
            assert!(!text.contains(word), "{word} in {name}");
        }
    }
    let recording = fs::read(lab().join("cell.mcap")).unwrap();
    for word in ["joint_compliance", "truth", "[expect"] {
        let holds = recording.windows(word.len()).any(|w| w == word.as_bytes());
        assert!(!holds, "{word} in the recording");
    }
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "cell.toml", &cell());
    let campaign = |name: &str, threads: Option<&str>, seed: Option<&str>| {
        let mut command = misfit(at);
        if let Some(threads) = threads {
            command.env("RAYON_NUM_THREADS", threads);
        }
        let recording = format!("{name}.mcap");
        command.args(["simulate", "cell.toml", "-o", &recording, "--csv", name]);
        if let Some(seed) = seed {
            command.args(["--seed", seed]);
        }
        command.assert().success();
        let read = |file: PathBuf| fs::read(file).unwrap();
        [
            read(at.join(&recording)),
            read(at.join(name).join("readings.csv")),
            read(at.join(name).join("campaign.toml")),
            read(at.join(format!("{name}.truth.toml"))),
        ]
    };
    let first = campaign("a", None, None);
    for (name, threads) in [("b", "1"), ("c", "2"), ("d", "8")] {
        assert!(
            campaign(name, Some(threads), None) == first,
            "{threads} threads"
        );
    }
    assert!(
        campaign("e", None, Some("3")) == first,
        "the scenario's own seed"
    );
    let other = campaign("f", None, Some("4"));
    assert!(other[0] != first[0] && other[1] != first[1]);
    assert!(other[2] == first[2], "the campaign file holds no seed");
}

// ---- fit

#[test]
fn the_recording_and_the_table_give_the_same_result() {
    let recording = done(lab(), &["fit", "cell.mcap", "--json"]);
    let table = done(lab(), &["fit", "cell/campaign.toml", "--json"]);
    assert_eq!(recording, table);
}

#[test]
fn what_is_said_is_the_same_on_any_number_of_threads() {
    let commands = [
        "fit cell.mcap --json",
        "diagnose cell.mcap --json",
        "ladder cell.mcap --json",
        "plan cell.mcap --json --poses 5",
    ];
    for command in commands {
        let said = |threads: &str| {
            let words = command.split(' ');
            let mut misfit = misfit(lab());
            let output = misfit
                .env("RAYON_NUM_THREADS", threads)
                .args(words)
                .output();
            let output = output.unwrap();
            let complaint = String::from_utf8_lossy(&output.stderr);
            assert_eq!(output.status.code(), Some(0), "{command}: {complaint}");
            assert!(output.stdout.len() > 100, "{command}: {complaint}");
            output.stdout
        };
        let one = said("1");
        for threads in ["2", "8"] {
            assert!(said(threads) == one, "{command}: {threads} threads");
        }
    }
}

/// Checks `E` of the contract.
#[track_caller]
fn assert_errors(errors: &Value) {
    for key in [
        "position_rms_m",
        "position_mean_m",
        "position_max_m",
        "whitened_rms",
    ] {
        assert!(errors[key].as_f64().unwrap() > 0.0, "{key} of {errors}");
    }
    let orientation = &errors["orientation_rms_rad"];
    assert!(orientation.is_null() || orientation.as_f64().unwrap() > 0.0);
    // mean ≤ root mean square ≤ maximum, whatever the readings
    let of = |key: &str| errors[key].as_f64().unwrap();
    assert!(of("position_mean_m") <= of("position_rms_m"));
    assert!(of("position_rms_m") <= of("position_max_m"));
}

/// Checks a whole document `misfit.fit/1`.
#[track_caller]
fn assert_fit_document(document: &Value) {
    assert_eq!(document["schema"], "misfit.fit/1");
    let effects = document["effects"].as_array().unwrap();
    assert!(effects.iter().all(Value::is_string));
    for key in ["fit", "heldout", "rejected"] {
        assert!(document["readings"][key].is_u64(), "{key}");
    }
    assert_errors(&document["fit"]);
    let object = document.as_object().unwrap();
    assert!(object.contains_key("heldout"));
    if !document["heldout"].is_null() {
        assert_errors(&document["heldout"]);
    }
    let noise = &document["noise"];
    let source = noise["source"].as_str().unwrap();
    assert!(["replicates", "campaign", "residual"].contains(&source));
    assert!(noise["position_sigma_m"].as_f64().unwrap() > 0.0);
    let sigma = &noise["orientation_sigma_rad"];
    assert!(sigma.is_null() || sigma.as_f64().unwrap() > 0.0);
    for row in document["parameters"].as_array().unwrap() {
        assert!(effects.contains(&row["effect"]), "{row}");
        assert!(row["name"].is_string() && row["value"].is_f64(), "{row}");
        assert!(!row["unit"].as_str().unwrap().is_empty(), "{row}");
        let status = row["status"].as_str().unwrap();
        assert!(
            ["estimated", "held", "unobservable", "at_bound"].contains(&status),
            "{row}"
        );
        // what is estimated has a standard deviation, and nothing else has
        match status {
            "estimated" => assert!(row["std"].as_f64().unwrap() > 0.0, "{row}"),
            _ => assert!(row["std"].is_null(), "{row}"),
        }
    }
    for row in document["unobservable"].as_array().unwrap() {
        assert!(row["what"].is_string() && row["why"].is_string(), "{row}");
    }
    assert!(document["converged"].is_boolean());
}

#[test]
fn the_json_of_a_fit_keeps_the_contract() {
    let document = json(lab(), &["fit", "cell.mcap", "--json"]);
    assert_fit_document(&document);
    let expected = [
        "tracker_frame",
        "target_offset",
        "geometry",
        "joint_compliance",
    ];
    assert_eq!(document["effects"], Value::from(&expected[..]));
    assert_eq!(document["readings"]["fit"], 40);
    assert_eq!(document["readings"]["heldout"], 16);
    assert_eq!(document["noise"]["source"], "replicates");
    assert_eq!(document["converged"], true);
    // the springs that the plant had, within 5 of the fit's own standard deviations
    for (joint, compliance) in [("a2", 1e-6), ("a3", 2e-6), ("a4", 5e-6), ("a5", 5e-6)] {
        let row = parameter(&document, "joint_compliance", joint);
        let (value, std) = (row["value"].as_f64().unwrap(), row["std"].as_f64().unwrap());
        assert_eq!(row["unit"], "rad/(N·m)");
        assert!((value - compliance).abs() < 5.0 * std, "{row}");
    }
    // no weight turns an axis along gravity
    let row = parameter(&document, "joint_compliance", "a1");
    assert_eq!(row["status"], "unobservable");

    // a campaign without orientations, repeats, held-out poses and stated noise keeps it, too
    let folder = copy();
    let at = folder.path();
    replace(
        at.join("campaign.toml"),
        "[split]\ncolumn = \"split\"\n",
        "",
    );
    let text = fs::read_to_string(at.join("campaign.toml")).unwrap();
    let (start, _) = text.split_once("[noise]").unwrap();
    write(at, "campaign.toml", start);
    let table = fs::read_to_string(at.join("readings.csv")).unwrap();
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let keep = |word: &str| !matches!(word, "qw" | "qx" | "qy" | "qz" | "split" | "repeat");
    let repeat = header.iter().position(|word| *word == "repeat").unwrap();
    let rows: Vec<String> = table
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|cells| cells[repeat] != "2")
        .map(|cells| {
            let kept = cells.iter().zip(&header).filter(|(_, word)| keep(word));
            kept.map(|(cell, _)| *cell).collect::<Vec<_>>().join(",")
        })
        .collect();
    write(at, "readings.csv", &(rows.join("\n") + "\n"));
    let document = json(at, &["fit", "campaign.toml", "--json"]);
    assert_fit_document(&document);
    assert_eq!(document["noise"]["source"], "residual");
    assert!(document["fit"]["orientation_rms_rad"].is_null());
    // cross-validated, as nothing is held out
    assert!(document["heldout"].is_object());
    let words = ["fit", "campaign.toml", "--json", "--no-cross-validation"];
    assert!(json(at, &words)["heldout"].is_null());
    // noise from what is left makes every whitened rms one: then it is not shown
    assert!(!done(at, &["fit", "campaign.toml"]).contains("rms / noise"));
}

#[test]
fn the_text_of_a_fit_names_what_matters() {
    let text = done(lab(), &["fit", "cell.mcap"]);
    for part in [
        "cell · robot six_axis · 40 readings fitted · 16 held out",
        "frames alone, held out",
        "from 20 groups of repeats",
        "K = 1/c",
        "joint_compliance.a1 · no reading loads the a1 axis",
        "converged in",
    ] {
        assert!(text.contains(part), "no {part:?} in:\n{text}");
    }
    assert!(!text.contains("a3.rx"));
    assert!(done(lab(), &["fit", "cell.mcap", "--all"]).contains("a3.rx"));
}

#[test]
fn effects_are_chosen_or_added() {
    let effects = |words: &[&str]| {
        let document = json(lab(), &[&["fit", "cell.mcap", "--json"], words].concat());
        assert_fit_document(&document);
        let ids = document["effects"].as_array().unwrap();
        let ids: Vec<&str> = ids.iter().map(|id| id.as_str().unwrap()).collect();
        ids.join(" ")
    };
    let frames = "tracker_frame target_offset";
    assert_eq!(effects(&["--effects", ""]), frames);
    assert_eq!(
        effects(&["--effects", "joint_compliance,joint_offset"]),
        format!("{frames} joint_offset joint_compliance")
    );
    assert_eq!(
        effects(&["--effects", "+joint_offset"]),
        format!("{frames} joint_offset geometry joint_compliance")
    );
    write(
        lab(),
        "one.toml",
        "[[effect]]\nkind = \"joint_compliance\"\n",
    );
    assert_eq!(
        effects(&["--model", "one.toml"]),
        format!("{frames} joint_compliance")
    );
    assert_eq!(
        effects(&["--model", "one.toml", "--effects", "+joint_offset"]),
        format!("{frames} joint_offset joint_compliance")
    );
}

#[test]
fn a_held_parameter_is_applied_and_not_changed() {
    let fit = |name: &str, compliance: f64| {
        let text = format!(
            "[[effect]]\nkind = \"joint_compliance\"\nhold = [\"a2\", \"a3\"]\n\
             values = {{ a2 = {compliance:e}, a3 = 2e-6 }}\n"
        );
        write(lab(), name, &text);
        let document = json(lab(), &["fit", "cell.mcap", "--json", "--model", name]);
        assert_fit_document(&document);
        let row = parameter(&document, "joint_compliance", "a2");
        assert_eq!(row["status"], "held");
        assert_eq!(row["value"].as_f64(), Some(compliance));
        let row = parameter(&document, "joint_compliance", "a4");
        assert_ne!(row["status"], "held");
        document["fit"]["whitened_rms"].as_f64().unwrap()
    };
    let (right, none, wrong) = (
        fit("right.toml", 1e-6),
        fit("none.toml", 0.0),
        fit("wrong.toml", 5e-6),
    );
    // 1 is noise alone; frames and the other springs cannot hide millimetres of sag behind 10 µm of noise
    assert!((0.8..1.2).contains(&right), "{right}");
    assert!(none > 3.0 * right && wrong > 3.0 * none, "{none}, {wrong}");

    // nothing left to estimate is no trouble
    let all = "[[effect]]\nkind = \"joint_compliance\"\nhold = true\n\
        [[effect]]\nkind = \"tracker_frame\"\nhold = true\nvalues = { x = 2.5, y = 0.5, z = 1, rz = 2.5 }\n\
        [[effect]]\nkind = \"target_offset\"\nhold = true\n";
    write(lab(), "all.toml", all);
    let document = json(
        lab(),
        &["fit", "cell.mcap", "--json", "--model", "all.toml"],
    );
    let rows = document["parameters"].as_array().unwrap();
    assert!(rows.iter().all(|row| row["status"] == "held"));
    done(lab(), &["fit", "cell.mcap", "--model", "all.toml"]);
}

#[test]
fn held_out_readings_are_only_shown() {
    let folder = copy();
    let at = folder.path();
    let before = json(at, &["fit", "campaign.toml", "--json"]);
    // every held-out reading a metre and a radian off, and another payload
    let table = fs::read_to_string(at.join("readings.csv")).unwrap();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: &str| header.iter().position(|word| *word == name).unwrap();
    let (split, x, q, mass) = (
        column("split"),
        column("x_m"),
        column("qw"),
        column("payload_kg"),
    );
    let mut changed = vec![header.join(",")];
    for line in lines {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        if cells[split] == "heldout" {
            let value: f64 = cells[x].parse().unwrap();
            cells[x] = (value + 1.0).to_string();
            cells[mass] = "3.0".to_owned();
            for (cell, value) in cells[q..q + 4].iter_mut().zip(["0.6", "0", "0.8", "0"]) {
                *cell = value.to_owned();
            }
        }
        changed.push(cells.join(","));
    }
    write(at, "readings.csv", &(changed.join("\n") + "\n"));
    let after = json(at, &["fit", "campaign.toml", "--json"]);
    for key in [
        "effects",
        "readings",
        "fit",
        "noise",
        "parameters",
        "unobservable",
        "converged",
    ] {
        assert_eq!(before[key], after[key], "{key}");
    }
    assert!(before["heldout"]["position_rms_m"].as_f64().unwrap() < 1e-4);
    assert!(after["heldout"]["position_rms_m"].as_f64().unwrap() > 0.9);
}

#[test]
fn the_papers_estimator_is_a_method() {
    let text = done(lab(), &["fit", "cell.mcap", "--method", "paper"]);
    assert!(
        text.contains("10 loaded poses beside their unloaded ones"),
        "{text}"
    );
    let document = json(lab(), &["fit", "cell.mcap", "--method", "paper", "--json"]);
    assert_eq!(document["schema"], "misfit.paper/1");
    assert_eq!(
        parameter(&document, "joint_compliance", "a1")["status"],
        "unobservable"
    );
    let row = parameter(&document, "joint_compliance", "a2");
    // three of its own standard deviations of 7 %
    assert!(
        (row["value"].as_f64().unwrap() / 1e-6 - 1.0).abs() < 0.2,
        "{row}"
    );
}

#[test]
fn one_wrong_number_is_found_by_its_line() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let hidden = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/hidden.toml");
    done(at, &["simulate", hidden, "--csv", "d"]);
    let table = at.join("d/readings.csv");
    let mut rows: Vec<Vec<String>> = fs::read_to_string(&table)
        .unwrap()
        .lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let x = rows[0].iter().position(|name| name == "x_m").unwrap();
    let write = |rows: &[Vec<String>]| {
        let rows: Vec<String> = rows.iter().map(|row| row.join(",")).collect();
        fs::write(&table, rows.join("\n") + "\n").unwrap();
    };
    let quick = |command| [command, "d/campaign.toml", "--no-cross-validation"];
    let json = [&quick("fit")[..], &["--json"]].concat();
    // the fit is that of the table without the row
    let without: Vec<Vec<String>> = [&rows[..7], &rows[8..]].concat();
    write(&without);
    let expected: Value = serde_json::from_str(&done(at, &json)).unwrap();
    rows[7][x] = "-3".to_owned();
    write(&rows);
    // the line is said before anything is fitted
    let said = |code: i32, words: &[&str]| {
        let ran = run(at, words);
        assert_eq!(ran.code, Some(code), "{words:?}: {}", ran.err);
        assert!(ran.err.contains("(line 8)"), "{}", ran.err);
        ran.out
    };
    let found: Value = serde_json::from_str(&said(0, &json)).unwrap();
    assert_eq!(found["parameters"], expected["parameters"]);
    assert_eq!(found["readings"]["rejected"], 1);
    assert_eq!(expected["readings"]["rejected"], 0);
    let text = said(0, &quick("diagnose"));
    assert!(
        text.contains("239 readings · 1 rejected (lines 8)"),
        "{text}"
    );
    let page = [&quick("report")[..], &["-o", "page.html"]].concat();
    for text in [said(0, &quick("ladder")), said(0, &page)] {
        let title = text.lines().next().unwrap();
        assert!(title.contains(" · 1 rejected (lines 8)"), "{text}");
    }
}

#[test]
fn errors_in_the_data_end_commands_and_a_flag_goes_on() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let hidden = concat!(env!("CARGO_MANIFEST_DIR"), "/scenarios/hidden.toml");
    done(at, &["simulate", hidden, "--csv", "d"]);
    let clean = done(at, &["check", "d/campaign.toml"]);
    assert!(clean.contains("findings 0 errors · 0 warnings"), "{clean}");
    let table = at.join("d/readings.csv");
    let text = fs::read_to_string(&table).unwrap();
    // metres in columns of millimetres
    let header = text.lines().next().unwrap();
    let wrong = header.replace("x_m,y_m,z_m", "x_mm,y_mm,z_mm");
    assert_ne!(wrong, header);
    fs::write(&table, text.replacen(header, &wrong, 1)).unwrap();
    let document = json_of(&run(at, &["check", "d/campaign.toml", "--json"]), 1);
    let finding = &document["findings"][0];
    assert_eq!(finding["severity"], "error");
    let what = finding["what"].as_str().unwrap();
    assert!(
        what.contains("the positions are in m, but read as mm"),
        "{what}"
    );
    for command in ["fit", "diagnose", "ladder"] {
        let document = json_of(&run(at, &[command, "d/campaign.toml", "--json"]), 1);
        assert_eq!(document["verdict"], "check_data");
        assert_eq!(document["converged"], false);
        assert_eq!(document["findings"][0]["what"], what);
    }
    let export = ["export", "d/campaign.toml", "-o", "x.json"];
    let ran = run(at, &export);
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("nothing was written"), "{}", ran.err);
    assert!(!at.join("x.json").exists());
    let forced = [&export[..], &["--despite-findings"]].concat();
    assert_ne!(run(at, &forced).code, Some(1));
    assert!(at.join("x.json").exists());
}

fn json_of(ran: &Ran, code: i32) -> Value {
    assert_eq!(ran.code, Some(code), "{}{}", ran.out, ran.err);
    serde_json::from_str(&ran.out).unwrap()
}

#[test]
fn a_fit_that_does_not_converge_says_so_and_ends_with_3() {
    // a start so soft that no step leads out of it
    write(
        lab(),
        "soft.toml",
        "[[effect]]\nkind = \"joint_compliance\"\nvalues = { a2 = 1.0 }\n",
    );
    let text = ends(3, lab(), &["fit", "cell.mcap", "--model", "soft.toml"]);
    assert!(text.contains("NOT CONVERGED after"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
    // what it found is written all the same, and marked in the file
    let words = [
        "export",
        "cell.mcap",
        "--model",
        "soft.toml",
        "-o",
        "soft.urdf",
    ];
    let text = ends(3, lab(), &words);
    assert!(text.contains("NOT CONVERGED after"), "{text}");
    assert!(!text.contains("NaN"), "{text}");
    let file = fs::read_to_string(lab().join("soft.urdf")).unwrap();
    assert!(file.contains("had NOT converged"), "{file}");
}

#[test]
fn few_readings_are_a_result() {
    let folder = copy();
    let at = folder.path();
    let table = fs::read_to_string(at.join("readings.csv")).unwrap();
    for rows in [1, 3] {
        let kept: Vec<&str> = table
            .lines()
            .filter(|line| !line.contains(",heldout,"))
            .take(1 + rows)
            .collect();
        write(at, "readings.csv", &(kept.join("\n") + "\n"));
        let document = json(at, &["fit", "campaign.toml", "--json"]);
        assert_fit_document(&document);
        assert_eq!(document["readings"]["fit"], rows);
        let rows_of = document["parameters"].as_array().unwrap();
        let unobservable = rows_of.iter().filter(|row| row["status"] == "unobservable");
        // 54 parameters, and at most 6 numbers a reading
        assert!(unobservable.count() >= 54 - 6 * rows);
        let text = done(at, &["fit", "campaign.toml"]);
        assert!(text.contains("not seen"), "{text}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
    }
}

// ---- effects

#[test]
fn the_catalogue_and_its_pages() {
    let list = done(lab(), &["effects"]);
    let ids = [
        "tracker_frame",
        "target_offset",
        "joint_offset",
        "geometry",
        "joint_compliance",
        "expression",
    ];
    for id in ids {
        let line = list
            .lines()
            .filter(|line| line.starts_with(&format!("  {id} ")));
        assert_eq!(line.count(), 1, "{id} in:\n{list}");
        let page = done(lab(), &["effects", "show", id]);
        assert!(page.starts_with(&format!("{id}\n\n")), "{page}");
        for heading in [
            "## Law",
            "## Signature",
            "## Confused with",
            "## Plant",
            "## Sources",
            "## At hand",
        ] {
            assert!(
                page.lines().any(|line| line == heading),
                "{heading} of {id}"
            );
        }
        // paragraphs are filled: no line is broken before the next word's place is used up
        let lines: Vec<&str> = page.lines().collect();
        for pair in lines.windows(2) {
            let word = pair[1].split(' ').next().unwrap();
            let prose =
                |line: &str| !line.is_empty() && !line.starts_with(['#', '|', '-', '*', ' ']);
            if prose(pair[0]) && prose(pair[1]) {
                let used = pair[0].chars().count() + 1 + word.chars().count();
                assert!(used > 100, "broken early: {}", pair[0]);
            }
        }
    }
    refused(
        lab(),
        &["effects", "show", "nothing"],
        &["\"nothing\"", "tracker_frame, target_offset, joint_offset"],
    );
}

// ---- run

const EXPECT: &str = "[expect]\nconverged = true\nfit_position_rms_mm = 0.05\n\
    heldout_position_rms_mm = 0.1\nwhitened_rms = [0.5, 1.5]\n\
    [[expect.parameter]]\nname = \"joint_compliance.a1\"\nstatus = \"unobservable\"\n\
    [[expect.parameter]]\nname = \"joint_compliance.a2\"\nrelative_error = 0.05\nsigmas = 5\n";

#[test]
fn run_with_expectations_met() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let text = scenario("title = \"a title\"", DESIGN, &format!("{TRUTH}{EXPECT}"));
    write(at, "good.toml", &text);
    let text = done(at, &["run", "good.toml"]);
    assert!(text.starts_with("scenario good · a title\n"), "{text}");
    assert!(text.ends_with("expect   7 of 7 met\n"), "{text}");
    assert_eq!(
        files(at),
        ["good.toml".to_owned()].into(),
        "nothing is kept"
    );

    let document = json(at, &["run", "good.toml", "--json", "-o", "kept/deep"]);
    assert_eq!(document["schema"], "misfit.run/1");
    assert_eq!(document["scenario"], "good");
    assert_eq!(document["seed"], 3);
    assert_eq!(document["passed"], true);
    assert_fit_document(&document["fit"]);
    assert_eq!(document["expect"].as_array().unwrap().len(), 7);
    for check in document["expect"].as_array().unwrap() {
        assert_eq!(check["met"], true, "{check}");
        for key in ["what", "found", "accepted"] {
            assert!(check[key].is_string(), "{check}");
        }
    }
    let kept = at.join("kept/deep");
    let expected = ["good.mcap", "good.result.json", "good.truth.toml"];
    assert_eq!(files(&kept), expected.map(str::to_owned).into());
    let result = fs::read_to_string(kept.join("good.result.json")).unwrap();
    assert_eq!(serde_json::from_str::<Value>(&result).unwrap(), document);
    // what `run` fits is what `fit` makes of the recording it keeps
    let mut alone = json(&kept, &["fit", "good.mcap", "--json"]);
    let findings = alone.as_object_mut().unwrap().remove("findings");
    assert_eq!(findings, Some(Value::Array(Vec::new())));
    assert_eq!(alone, document["fit"]);
}

#[test]
fn run_with_an_expectation_missed() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let tail = format!("{TRUTH}{EXPECT}").replace("relative_error = 0.05", "relative_error = 1e-9");
    write(at, "bad.toml", &scenario("", DESIGN, &tail));
    let text = ends(3, at, &["run", "bad.toml"]);
    assert!(text.contains("expect   6 of 7 met\n"), "{text}");
    let missed = "  MISSED relative error of joint_compliance.a2: found ";
    let line = text.lines().find(|line| line.starts_with(missed));
    assert!(
        line.unwrap().contains("; accepted: at most 1.00e-9"),
        "{text}"
    );
    let document: Value =
        serde_json::from_str(&ends(3, at, &["run", "bad.toml", "--json", "-o", "out"])).unwrap();
    assert_eq!(document["passed"], false);
    // the result is kept all the more
    assert!(at.join("out/bad.result.json").exists());
}

#[test]
fn run_says_that_nothing_is_expected() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "any.toml", &scenario("", "poses = 3", ""));
    let text = done(at, &["run", "any.toml"]);
    assert!(text.contains("nothing is expected"), "{text}");
    assert!(!text.contains("\n\n\n"), "{text}");
    let other = done(at, &["run", "any.toml", "--seed", "4"]);
    assert_ne!(text, other);
}

#[test]
fn run_studies_many_campaigns() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "study.toml", &scenario("campaigns = 4", DESIGN, TRUTH));
    let text = done(at, &["run", "study.toml", "-o", "out"]);
    assert!(text.contains("4 campaigns: variance"), "{text}");
    assert_eq!(
        files(&at.join("out")),
        ["study.result.json".to_owned()].into()
    );
    let document = json(at, &["run", "study.toml", "--campaigns", "2", "--json"]);
    assert_eq!(document["study"]["campaigns"], 2);
    assert!(document["fit"].is_null());
}

// ---- usage and streams

#[test]
fn wrong_usage_ends_with_2() {
    for words in [
        &[][..],
        &["nothing"],
        &["fit"],
        &["fit", "a.toml", "--nothing"],
        &["fit", "a.toml", "--method", "nothing"],
        &["fit", "a.toml", "b.toml"],
        &[
            "fit",
            "cell.mcap",
            "--method",
            "paper",
            "--effects",
            "geometry",
        ],
        &["run"],
        &["run", "cell.toml", "--campaigns", "0"],
        &["run", "cell.toml", "--seed", "x"],
        &["simulate"],
        &["simulate", "cell.toml", "-o", "cell.toml"],
        &["simulate", "cell.toml", "-o", "cell"],
        &["effects", "nothing"],
        &["effects", "show"],
    ] {
        let ran = run(lab(), words);
        assert_eq!(ran.code, Some(2), "{words:?}: {}", ran.err);
        assert_eq!(ran.out, "", "{words:?}");
        assert!(
            ran.err.contains("--help") || ran.err.contains("Usage: misfit"),
            "{}",
            ran.err
        );
    }
    let scenario = fs::read_to_string(lab().join("cell.toml")).unwrap();
    assert_eq!(scenario, cell(), "the scenario is no recording's place");
}

#[test]
fn help_fits_the_page_and_tells_the_exit_codes() {
    let help = done(lab(), &["--help"]);
    assert!(help.contains("Exit codes: 0 done; 1 could not do it; 2 wrong usage; 3"));
    for command in ["simulate", "fit", "run", "effects"] {
        assert!(help.contains(&format!("\n  {command} ")), "{help}");
        // clap leaves blanks on empty lines between possible values
        let ran = run(lab(), &[command, "--help"]);
        assert_eq!(ran.code, Some(0));
        assert!(ran.out.lines().all(|line| line.chars().count() <= 100));
        assert!(ran.out.contains("Examples:\n  misfit "), "{}", ran.out);
    }
    assert!(done(lab(), &["--version"]).starts_with("misfit "));
}

#[test]
fn a_reader_that_leaves_is_no_fault() {
    for words in [
        &["fit", "cell.mcap", "--json"][..],
        &["fit", "cell.mcap"],
        &["run", "cell.toml"],
        &["effects"],
        &["effects", "show", "geometry"],
        &["--help"],
    ] {
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_misfit"))
            .args(words)
            .current_dir(lab())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // closed before anything is written
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{words:?}: {err}");
        assert_eq!(err, "", "{words:?}");
    }
}

// ---- bad input

#[test]
fn campaigns_that_are_refused() {
    /// File, what is replaced in it by what, and what the message must hold.
    type Case = (
        &'static str,
        &'static str,
        &'static str,
        &'static [&'static str],
    );
    let cases: [Case; 13] = [
        (
            "readings.csv",
            "x_m",
            "x_furlong",
            &["readings.csv", "x_furlong"],
        ),
        (
            "readings.csv",
            ",x_m",
            ",x_m,colour",
            &["readings.csv", "colour"],
        ),
        ("readings.csv", "y_m", "y_mm_", &["readings.csv", "y_m"]),
        (
            "readings.csv",
            "a3_rad",
            "a9_rad",
            &["readings.csv", "a9_rad", "a1"],
        ),
        (
            "readings.csv",
            "p009,1,fit,0.0,",
            "p009,1,fit,NaN,",
            &["line 2", "time_s", "NaN"],
        ),
        (
            "readings.csv",
            "p009,1,fit,0.0,",
            "p009,1,maybe,0.0,",
            &["line 2", "split", "maybe"],
        ),
        (
            "readings.csv",
            "p009,1,fit,0.0,",
            "p009,1,fit,",
            &["readings.csv", "line 2"],
        ),
        (
            "campaign.toml",
            "link = \"flange\"",
            "link = \"elbow\"",
            &["target.link", "a3_link"],
        ),
        (
            "campaign.toml",
            "= [0.0, 0.0, -9.81]",
            "= [0, 0, 1e999]",
            &["campaign.toml", "gravity"],
        ),
        (
            "campaign.toml",
            "base_from_tracker = \"estimate\"",
            "base_from_tracker = [0, 0, 0, 1, 1, 0, 0]",
            &["campaign.toml", "frames.base_from_tracker"],
        ),
        (
            "campaign.toml",
            "position_m = 1e-5",
            "position_m = -1",
            &["noise.position_m", "-1"],
        ),
        (
            "campaign.toml",
            "[split]",
            "typo = 1\n[split]",
            &["campaign.toml", "typo"],
        ),
        (
            "campaign.toml",
            "readings.csv",
            "nowhere.csv",
            &["nowhere.csv", "No such file"],
        ),
    ];
    for (file, from, to, parts) in cases {
        let folder = copy();
        replace(folder.path().join(file), from, to);
        refused(folder.path(), &["fit", "campaign.toml"], parts);
    }
    // a quaternion that is none, an empty table, nothing but a header
    let folder = copy();
    let at = folder.path();
    let table = fs::read_to_string(at.join("readings.csv")).unwrap();
    let mut lines: Vec<String> = table.lines().map(str::to_owned).collect();
    let column = lines[0].split(',').position(|word| word == "qw").unwrap();
    let mut cells: Vec<&str> = lines[4].split(',').collect();
    cells[column] = "0.9999";
    lines[4] = cells.join(",");
    write(at, "readings.csv", &lines.join("\n"));
    refused(
        at,
        &["fit", "campaign.toml"],
        &["readings.csv", "line 5", "q"],
    );
    write(at, "readings.csv", &lines[0]);
    refused(at, &["fit", "campaign.toml"], &["readings.csv"]);
    write(at, "readings.csv", "");
    refused(at, &["fit", "campaign.toml"], &["readings.csv"]);
    // all held out
    let all: Vec<String> = table
        .lines()
        .map(|line| line.replace(",fit,", ",heldout,"))
        .collect();
    write(at, "readings.csv", &all.join("\n"));
    refused(
        at,
        &["fit", "campaign.toml"],
        &["campaign.toml", "all 56 are held out"],
    );
}

#[test]
fn robots_that_are_refused() {
    let joint = |name: &str, parent: &str, child: &str| {
        format!(
            "<joint name=\"{name}\" type=\"revolute\"><parent link=\"{parent}\"/><child link=\"{child}\"/>\
             <axis xyz=\"0 0 1\"/><limit lower=\"-1\" upper=\"1\" effort=\"1\" velocity=\"1\"/></joint>"
        )
    };
    let robot = |body: &str| format!("<robot name=\"r\"><link name=\"a\"/>{body}</robot>");
    let link = "<link name=\"b\"/><link name=\"flange\"/>";
    let (one, two) = (joint("j1", "a", "b"), joint("j2", "b", "flange"));
    let cases = [
        (
            robot(&format!("{link}{one}{two}{}", joint("j3", "flange", "b"))),
            "j",
        ),
        (
            robot(&format!("{link}{one}{}", joint("j1", "b", "flange"))),
            "j1",
        ),
        (robot(&format!("{link}<link name=\"b\"/>{one}{two}")), "b"),
        ("<robot".to_owned(), ""),
        (String::new(), ""),
    ];
    for (text, part) in cases {
        let folder = copy();
        write(folder.path(), "six_axis.urdf", &text);
        refused(
            folder.path(),
            &["fit", "campaign.toml"],
            &["six_axis.urdf", part],
        );
    }
    // a mesh is not used, but a robot file that names a missing one is not the one that was meant
    let folder = copy();
    let mesh = "<link name=\"flange\"><visual><geometry><mesh filename=\"gone.stl\"/></geometry></visual></link>";
    replace(
        folder.path().join("six_axis.urdf"),
        "<link name=\"flange\"/>",
        mesh,
    );
    refused(
        folder.path(),
        &["fit", "campaign.toml"],
        &["six_axis.urdf", "flange", "gone.stl"],
    );
    let folder = copy();
    fs::remove_file(folder.path().join("six_axis.urdf")).unwrap();
    refused(
        folder.path(),
        &["fit", "campaign.toml"],
        &["six_axis.urdf", "No such file"],
    );
}

#[test]
fn files_that_are_no_campaigns_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let recording = fs::read(lab().join("cell.mcap")).unwrap();
    for share in [0, 3, recording.len() / 2, recording.len() - 1] {
        fs::write(at.join("cut.mcap"), &recording[..share]).unwrap();
        refused(
            at,
            &["fit", "cut.mcap"],
            &["cut.mcap", "not a whole MCAP file"],
        );
    }
    refused(at, &["fit", "gone.mcap"], &["gone.mcap", "No such file"]);
    refused(at, &["fit", "gone.toml"], &["gone.toml", "No such file"]);
    refused(at, &["fit", "a.csv"], &["a.csv", ".toml", ".mcap"]);
    refused(at, &["fit", "."], &["a folder", ".toml", ".mcap"]);
    fs::write(at.join("bytes.toml"), [0xff, 0xfe, 0x00]).unwrap();
    refused(at, &["fit", "bytes.toml"], &["bytes.toml"]);
    refused(at, &["run", "bytes.toml"], &["bytes.toml"]);
}

#[test]
fn models_that_are_refused() {
    let known = "tracker_frame, target_offset, joint_offset, geometry";
    let fit = ["fit", "cell.mcap"];
    let with = |words: &[&'static str]| [&fit[..], words].concat();
    refused(
        lab(),
        &with(&["--effects", "nothing"]),
        &["--effects", "\"nothing\"", known],
    );
    refused(
        lab(),
        &with(&["--effects", "+nothing"]),
        &["\"nothing\"", known],
    );
    refused(
        lab(),
        &with(&["--effects", "geometry,geometry"]),
        &["\"geometry\" is named twice"],
    );
    refused(
        lab(),
        &with(&["--model", "gone.toml"]),
        &["gone.toml", "No such file"],
    );
    let cases: [(&str, &[&str]); 11] = [
        ("x = 1\n", &["unknown field `x`"]),
        ("[[effect]]\n", &["number 1", "kind"]),
        ("[[effect]]\nkind = \"nothing\"", &["\"nothing\"", known]),
        (
            "[[effect]]\nkind = \"geometry\"\noption = 1",
            &["geometry", "option"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\nhold = 3",
            &["geometry", "hold"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\nhold = [\"q\"]",
            &["\"q\"", "a1.x", "a6.rz"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\nvalues = { q = 1 }",
            &["\"q\"", "a1.x", "a6.rz"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\nvalues = { \"a1.x\" = nan }",
            &["a1.x", "nan"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\nvalues = { \"a1.x\" = \"1\" }",
            &["a1.x", "number"],
        ),
        (
            "[[effect]]\nkind = \"joint_compliance\"\nvalues = { a2 = -1e-6 }",
            &["a2", "accepted: 0"],
        ),
        (
            "[[effect]]\nkind = \"geometry\"\n[[effect]]\nkind = \"geometry\"",
            &["named twice"],
        ),
    ];
    for (index, (text, parts)) in cases.into_iter().enumerate() {
        let name = format!("model{index}.toml");
        write(lab(), &name, text);
        let words = [&fit[..], &["--model", &name]].concat();
        refused(lab(), &words, &[&[name.as_str()], parts].concat());
    }
}

// ---- laws of a user's own

/// Two effects that no catalogue has, as tables of a scenario or of a model file.
fn own(table: &str, values: bool) -> String {
    let given = |values_of: &str| {
        if values {
            format!("values = {{ {values_of} }}\n")
        } else {
            String::new()
        }
    };
    format!(
        "[[{table}]]\nkind = \"expression\"\nname = \"cable_pull\"\nacts_on = \"q3\"\n\
         law = \"a*sin(q3)*cos(q2) + b*q5*q4\"\n{}parameters = {{ a = {{ unit = \"rad\", typical = 1e-4 }}, \
         b = {{ unit = \"1/rad\", typical = 1e-4 }} }}\n\
         [[{table}]]\nkind = \"expression\"\nname = \"tilt\"\nacts_on = \"ry[a2]\"\n\
         law = \"c*tau[a3]\"\n{}parameters.c = {{ unit = \"rad/(N·m)\", typical = 1e-6 }}\n",
        given("a = 2e-4, b = -1e-4"),
        given("c = 5e-8"),
    )
}

#[test]
fn laws_of_a_users_own_are_simulated_fitted_and_diagnosed() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let design = "poses = 24\nrepeats = 2\nloads = [{ mass_kg = 0.0 }, { mass_kg = 40.0, com_m = [0.1, 0.0, 0.1] }]";
    let truth_tables = format!("{TRUTH}{}", own("truth", true));
    write(at, "s.toml", &scenario("", design, &truth_tables));
    done(at, &["simulate", "s.toml"]);
    let others = "[[effect]]\nkind = \"geometry\"\n[[effect]]\nkind = \"joint_compliance\"\n";
    write(at, "m.toml", &format!("{others}{}", own("effect", false)));

    // without them the model is not enough, and with them it is
    let without = json(at, &["fit", "s.mcap", "--json"]);
    let with = json(at, &["fit", "s.mcap", "--model", "m.toml", "--json"]);
    let rms = |document: &Value| document["heldout"]["whitened_rms"].as_f64().unwrap();
    assert!(
        rms(&without) > 2.0 && rms(&with) < 1.3,
        "{} {}",
        rms(&without),
        rms(&with)
    );
    let effects = with["effects"].as_array().unwrap();
    assert_eq!(
        effects[effects.len() - 2..],
        ["cable_pull", "tilt"],
        "one name everywhere"
    );
    for (effect, name, unit, truth) in [
        ("cable_pull", "a", "rad", 2e-4),
        ("cable_pull", "b", "1/rad", -1e-4),
        ("tilt", "c", "rad/(N·m)", 5e-8),
    ] {
        let row = parameter(&with, effect, name);
        assert_eq!(row["unit"], unit);
        assert_eq!(row["status"], "estimated", "{row}");
        let (value, std) = (row["value"].as_f64().unwrap(), row["std"].as_f64().unwrap());
        // 5 σ: one in two million by chance
        assert!(
            (value - truth).abs() < 5.0 * std && std < 0.2 * truth.abs(),
            "{row}"
        );
    }
    let text = done(at, &["fit", "s.mcap", "--model", "m.toml"]);
    assert!(
        text.lines().any(|line| line.starts_with("  cable_pull ")),
        "{text}"
    );
    assert!(
        text.ends_with("next     misfit diagnose s.mcap --model m.toml\n"),
        "{text}"
    );
    let document = json(at, &["diagnose", "s.mcap", "--model", "m.toml", "--json"]);
    assert_eq!(document["verdict"], "nothing");

    // what the plant had is a model file, options and all
    let truth = json(at, &["fit", "s.mcap", "--model", "s.truth.toml", "--json"]);
    assert!(
        (rms(&truth) - rms(&with)).abs() < 0.2,
        "{} {}",
        rms(&truth),
        rms(&with)
    );
    assert!(parameter(&truth, "tilt", "c")["value"].as_f64().unwrap() > 2e-8);

    // held, it is applied and not changed
    let held = own("effect", true).replace("kind =", "hold = true\nkind =");
    write(at, "held.toml", &format!("{others}{held}"));
    let held = json(at, &["fit", "s.mcap", "--model", "held.toml", "--json"]);
    assert!(rms(&held) < 1.3);
    assert_eq!(parameter(&held, "cable_pull", "a")["value"], 2e-4);
    assert_eq!(parameter(&held, "cable_pull", "a")["status"], "held");

    // a scenario may name the model file
    let expect = "[expect]\nwhitened_rms = [0.8, 1.2]\n[[expect.parameter]]\nname = \"tilt.c\"\nsigmas = 5\n";
    let tail = format!("{truth_tables}{expect}");
    let with_model = scenario("model = \"m.toml\"", design, &tail);
    write(at, "r.toml", &with_model);
    let text = done(at, &["run", "r.toml"]);
    assert!(text.ends_with("expect   2 of 2 met\n"), "{text}");
    write(at, "r.toml", &with_model.replace("m.toml", "gone.toml"));
    refused(at, &["run", "r.toml"], &["gone.toml", "No such file"]);
}

#[test]
fn a_law_of_a_users_own_is_tried_beside_the_catalogue() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let law = |table: &str, values: &str| {
        format!(
            "[[{table}]]\nkind = \"expression\"\nname = \"cable_pull\"\nacts_on = \"q3\"\n\
             law = \"a*sin(q3)*cos(q2)\"\n{values}\
             parameters = {{ a = {{ unit = \"rad\", typical = 1e-4 }} }}\n"
        )
    };
    let design = "poses = 20\nrepeats = 2\n\
                  loads = [{ mass_kg = 0.0 }, { mass_kg = 40.0, com_m = [0.1, 0.0, 0.1] }]";
    let truth = format!("{TRUTH}{}", law("truth", "values = { a = 3e-4 }\n"));
    write(at, "s.toml", &scenario("", design, &truth));
    write(at, "laws.toml", &law("effect", ""));
    done(at, &["simulate", "s.toml"]);
    let quick = "--no-cross-validation";
    // the catalogue does not hold it
    let without = json(at, &["diagnose", "s.mcap", quick, "--json"]);
    assert_eq!(without["verdict"], "unknown");
    let tried = ["--candidates", "laws.toml"];
    let words = [&["diagnose", "s.mcap", quick][..], &tried].concat();
    let with = json(at, &[&words[..], &["--json"]].concat());
    assert_eq!(with["verdict"], "named");
    assert_eq!(with["effects"], serde_json::json!(["cable_pull"]));
    let ids = |document: &Value| -> Vec<String> {
        let rows = document["candidates"].as_array().unwrap().iter();
        rows.map(|row| row["effect"].as_str().unwrap().to_owned())
            .collect()
    };
    assert_eq!(ids(&with)[0], "cable_pull");
    assert_eq!(ids(&with).len(), ids(&without).len() + 1);
    // no list of effects can name it: the next command makes the file that can
    let text = done(at, &words);
    let make = "misfit diagnose s.mcap --candidates laws.toml -o model.toml";
    let next = format!("next     {make}\n         misfit ladder s.mcap --candidates laws.toml\n");
    assert!(text.ends_with(&next), "{text}");
    let make: Vec<&str> = make.split_whitespace().skip(1).chain([quick]).collect();
    done(at, &make);
    let words = ["fit", "s.mcap", quick, "--model", "model.toml", "--json"];
    let fit = json(at, &words);
    let row = parameter(&fit, "cable_pull", "a");
    let (value, std) = (row["value"].as_f64().unwrap(), row["std"].as_f64().unwrap());
    // 5 σ: one in two million by chance
    assert!((value - 3e-4).abs() < 5.0 * std && std < 3e-5, "{row}");

    let words = [&["ladder", "s.mcap", quick][..], &tried].concat();
    let ladder = json(at, &[&words[..], &["--json"]].concat());
    let rungs = ladder["rungs"].as_array().unwrap();
    assert_eq!(rungs[rungs.len() - 1]["added"], "cable_pull");
    let text = done(at, &words);
    let next = "next     misfit ladder s.mcap --candidates laws.toml -o model.toml\n";
    assert!(text.ends_with(next), "{text}");

    let spoilt: [(&str, &[&str]); 4] = [
        ("[[effect]]\nkind = \"hose\"\n", &["\"hose\"", "geometry"]),
        (
            "[[effect]]\nkind = \"expression\"\n",
            &["expression", "name"],
        ),
        ("[[effects]]\n", &["`effects`", "`effect`"]),
        ("law", &["line 1"]),
    ];
    for command in ["diagnose", "ladder"] {
        for (text, parts) in &spoilt {
            write(at, "bad.toml", text);
            let parts = [&["bad.toml"], *parts].concat();
            let given = ["-o", "out.toml", "--candidates", "bad.toml"];
            refused(at, &[&[command, "s.mcap"][..], &given].concat(), &parts);
        }
        write(at, "bad.toml", &law("effect", "").repeat(2));
        let given = [command, "s.mcap", "--candidates", "bad.toml"];
        refused(at, &given, &["bad.toml", "cable_pull"]);
        let given = [command, "s.mcap", "--candidates", "gone.toml"];
        refused(at, &given, &["gone.toml", "No such file"]);
        // one law without a value would leave none to all others
        for (other, why) in [
            ("a*asin(q1)", "no value or no slope here"),
            ("a*temperature", "temperature_degC"),
        ] {
            write(
                at,
                "bad.toml",
                &law("effect", "").replace("a*sin(q3)*cos(q2)", other),
            );
            let given = [command, "s.mcap", "--candidates", "bad.toml"];
            refused(at, &given, &["line ", "cable_pull", why]);
        }
    }
    assert!(!at.join("out.toml").exists(), "nothing is written");
}

#[test]
fn a_model_that_collapses_is_not_diagnosed() {
    let folder = copy();
    let at = folder.path();
    // ten milliradian a newton metre: the arm falls over
    let soft = "[[effect]]\nkind = \"joint_compliance\"\n[effect.values]\na2 = 1e-2\na3 = 1e-2\n";
    write(at, "soft.toml", soft);
    let before = files(at);
    let words = ["diagnose", "campaign.toml", "--model", "soft.toml"];
    // the posture of line 2 carries itself even so, line 3 is not fitted
    let parts = ["campaign.toml: line 4", "no loaded equilibrium"];
    refused(at, &[&words[..], &["-o", "m.toml"]].concat(), &parts);
    refused(at, &[&words[..], &["--json"]].concat(), &parts);
    // a payload beyond all numbers, in the second reading of the table
    let table = fs::read_to_string(at.join("readings.csv")).unwrap();
    let header: Vec<&str> = table.lines().next().unwrap().split(',').collect();
    let column = header.iter().position(|word| *word == "payload_kg");
    let rows = table.lines().enumerate().map(|(index, line)| {
        let mut cells: Vec<&str> = line.split(',').collect();
        if index == 2 {
            cells[column.unwrap()] = "1e308";
        }
        cells.join(",")
    });
    let table = rows.collect::<Vec<_>>().join("\n");
    write(at, "readings.csv", &table);
    for command in ["diagnose", "ladder"] {
        let words = [command, "campaign.toml", "-o", "m.toml"];
        refused(at, &words, &["campaign.toml: line 3", "joint_compliance"]);
    }
    assert_eq!(files(at), before, "nothing is written");
}

#[test]
fn laws_that_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    fs::copy(lab().join("cell.mcap"), at.join("cell.mcap")).unwrap();
    let one = "parameters.a = { unit = \"rad\", typical = 1e-4 }";
    let law = |law: &str| format!("name = \"own\"\nacts_on = \"q3\"\nlaw = {law:?}\n{one}");
    let cases: Vec<(String, &[&str])> = vec![
        (
            String::new(),
            &["name is missing", "misfit effects show expression"],
        ),
        (
            law("a").replace("own", "o w n"),
            &["name is \"o w n\"; accepted: letters"],
        ),
        (
            law("a").replace("own", "geometry"),
            &["\"geometry\", which is an effect of the catalogue"],
        ),
        (
            law("a").replace("own", "expression"),
            &["\"expression\", which is an effect of the catalogue"],
        ),
        (
            law("a").replace("acts_on", "act_on"),
            &["unknown field `act_on`", "`acts_on`"],
        ),
        (
            law("a").replace("acts_on = \"q3\"\n", ""),
            &["own: acts_on is missing"],
        ),
        (
            law("a").replace("\"q3\"", "\"rw3\""),
            &["own: acts_on is \"rw3\"; accepted: q3 or q[joint]"],
        ),
        (
            law("a").replace("\"q3\"", "\"q\""),
            &["acts_on is \"q\"; accepted"],
        ),
        (
            law("a").replace("\"q3\"", "\"q7\""),
            &["acts_on is \"q7\": there is no joint 7; known: 1 [a1]"],
        ),
        (law("a").replace(one, ""), &["own: parameters is empty"]),
        (law("q1").replace(one, ""), &["own: parameters is empty"]),
        (
            law("a").replace("1e-4", "0"),
            &["typical size of a is 0; accepted: a number above 0"],
        ),
        (
            law("a").replace("1e-4", "nan"),
            &["typical size of a is NaN"],
        ),
        (
            law("a").replace(", typical = 1e-4", ""),
            &["the parameter a lacks unit or typical size"],
        ),
        (
            law("a").replace("\"rad\"", "\"\""),
            &["unit of a is \"\"; accepted: SI units"],
        ),
        (
            law("a + q3").replace("parameters.a", "parameters.q3"),
            &["a parameter is called q3, which means"],
        ),
        (
            law("sin").replace("parameters.a", "parameters.sin"),
            &["sin is a function; accepted: sin(…)", "\n    sin\n    ^"],
        ),
        (
            law("pi").replace("parameters.a", "parameters.pi"),
            &["a parameter is called pi"],
        ),
        (
            law("a") + "\nparameters.b = { unit = \"m\", typical = 1 }",
            &["the parameter b is not in the law \"a\""],
        ),
        (
            law("a*(q1 + "),
            &["own: law: the end; accepted here", "\n    a*(q1 +\n"],
        ),
        (
            law("a*sine(q3)"),
            &[
                "no function is called \"sine\"; known: sin, cos",
                "\n    a*sine(q3)\n      ^",
            ],
        ),
        (
            law("a*qq3"),
            &[
                "nothing is called \"qq3\"; known: a, q1 or q[joint]",
                "\n    a*qq3\n      ^",
            ],
        ),
        (
            law("a*tau9"),
            &[
                "own: law: there is no joint 9; known: 1 [a1], 2 [a2]",
                "\n    a*tau9\n      ^",
            ],
        ),
        (
            law("a*q[nothing]"),
            &[
                "called \"nothing\"; known: 1 [a1]",
                "\n    a*q[nothing]\n      ^",
            ],
        ),
        (law("a*atan2(q1)"), &["atan2 with 1 argument; accepted: 2"]),
        (
            law("a + 1"),
            &[
                "own: with all parameters at zero the law \"a + 1\" is 1; accepted: laws that are zero",
            ],
        ),
        (law("sqrt(a)*q1"), &["has no slope by a"]),
        (
            law(&("(".repeat(500) + "a")),
            &["nested too deeply; accepted: up to 64"],
        ),
        (
            law(&"a+".repeat(2000)),
            &["4000 bytes long; accepted: up to 1000"],
        ),
        // the campaign says no direction and no temperature
        (
            law("a*approach1"),
            &["line 2: the law of own", "approach_<joint>"],
        ),
        (
            law("a*temperature"),
            &["line 2: the law of own", "temperature_degC"],
        ),
        (law("a/(q1 - q1)"), &["has no value at any of 32 postures"]),
        (
            law("a*asin(q1)"),
            &["the law of own has no value or no slope here; accepted: laws that have both"],
        ),
    ];
    for (index, (keys, parts)) in cases.iter().enumerate() {
        let name = format!("m{index}.toml");
        write(
            at,
            &name,
            &format!("[[effect]]\nkind = \"expression\"\n{keys}\n"),
        );
        let mut words = vec!["fit", "cell.mcap", "--model", &name];
        // what only the readings show is told of the campaign
        let of_campaign = parts[0].contains("the law of own");
        let file = if of_campaign { "cell" } else { &name };
        refused(at, &words, &[&[file], *parts].concat());
        words[0] = "diagnose";
        refused(at, &words, &[&[file], *parts].concat());
        // and a truth is refused like a model
        if !of_campaign {
            let tail = format!("[[truth]]\nkind = \"expression\"\n{keys}\n");
            write(at, "s.toml", &scenario("", "poses = 3", &tail));
            refused(at, &["simulate", "s.toml"], &[&["s.toml"], *parts].concat());
        }
    }
    let fit = ["fit", "cell.mcap", "--effects"];
    refused(
        at,
        &[&fit[..], &["expression"]].concat(),
        &["--effects: expression: name is missing"],
    );
    write(at, "m.toml", &own("effect", false));
    let words = [&fit[..], &["+tilt", "--model", "m.toml"]].concat();
    refused(at, &words, &["\"tilt\" is named twice"]);
    write(
        at,
        "m.toml",
        &own("effect", false).replace("tilt", "cable_pull"),
    );
    refused(
        at,
        &["fit", "cell.mcap", "--model", "m.toml"],
        &["m.toml", "\"cable_pull\" is named twice"],
    );
}

#[test]
fn scenarios_that_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let check = |text: &str, parts: &[&str]| {
        write(at, "s.toml", text);
        for command in ["simulate", "run"] {
            refused(at, &[command, "s.toml"], &[&["s.toml"], parts].concat());
        }
        assert_eq!(
            files(at),
            ["s.toml".to_owned()].into(),
            "nothing is written"
        );
    };
    let top: [(&str, &[&str]); 4] = [
        ("typo = 1", &["`typo`", "`design`"]),
        ("gravity = [0, 0]", &["gravity"]),
        ("seed = 4", &["seed"]),
        ("base = \"nothing\"", &[]),
    ];
    for (text, parts) in top {
        let text = scenario(text, "poses = 3", "");
        if text.contains("nothing") {
            // a wrong base is the robot file's
            write(at, "s.toml", &text);
            refused(at, &["simulate", "s.toml"], &["six_axis.urdf", "nothing"]);
        } else {
            check(&text, parts);
        }
    }
    let designs: [(&str, &[&str]); 15] = [
        ("", &["poses"]),
        ("poses = 0", &["poses is 0"]),
        ("poses = -3", &["design.poses", "-3"]),
        ("poses = 3\nheldout_poses = 3", &["heldout_poses"]),
        ("poses = 3\nrepeats = 0", &["repeats is 0"]),
        ("poses = 3\ndirections = 3", &["directions"]),
        ("poses = 3\nmargin = 0.5", &["margin"]),
        ("poses = 3\norder = \"up\"", &["order"]),
        ("poses = 3\nleast_height_m = nan", &["least_height_m"]),
        (
            "poses = 3\nfixed_rad = { nothing = 1 }",
            &["fixed_rad", "nothing", "a1, a2"],
        ),
        ("poses = 3\nloads = [{ mass_kg = -1 }]", &["loads"]),
        ("poses = 3\nloads = [{ mass_kg = inf }]", &["loads"]),
        ("poses = 3\ntypo = 1", &["`typo`", "`poses`"]),
        ("poses = 2000000", &["2000000 readings", "1000000"]),
        (
            "poses = 4000000000000000000\nrepeats = 100",
            &["readings", "1000000"],
        ),
    ];
    for (design, parts) in designs {
        check(&scenario("", design, ""), parts);
    }
    let truths: [(&str, &[&str]); 10] = [
        (
            "kind = \"nothing\"",
            &["\"nothing\"", "joint_offset, geometry"],
        ),
        (
            "kind = \"joint_compliance\"\nvalues = { a9 = 1e-6 }",
            &["\"a9\"", "a1, a2"],
        ),
        (
            "kind = \"joint_compliance\"\nvalues = { a1 = -1e-6 }",
            &["a1", "-0.000001"],
        ),
        (
            "kind = \"joint_compliance\"\npreset = \"soft\"",
            &["soft", "strain_wave, paper"],
        ),
        (
            "kind = \"joint_compliance\"\npreset = \"paper\"",
            &["exponent"],
        ),
        (
            "kind = \"joint_compliance\"\npreset = \"paper\"\nexponent = 12",
            &["12", "0 to 9"],
        ),
        (
            "kind = \"joint_compliance\"\npreset = \"strain_wave\"",
            &["8 joints", "6"],
        ),
        (
            "kind = \"geometry\"\npreset = \"strain_wave\"",
            &["preset", "geometry"],
        ),
        ("kind = \"geometry\"\nrandom = -1", &["random", "-1"]),
        ("kind = \"geometry\"\nhold = true", &["hold"]),
    ];
    for (truth, parts) in truths {
        check(
            &scenario("", "poses = 3", &format!("[[truth]]\n{truth}")),
            parts,
        );
    }
    check(
        &scenario("", "poses = 3", "[expect]\ntypo = 1"),
        &["`typo`", "`converged`"],
    );
    let text = scenario("", "poses = 3", "");
    check(
        &text.replace(NOISE, "position_m = -1\n"),
        &["noise.position_m", "-1"],
    );
    check(
        &text.replace("link = \"flange\"", "link = \"hand\""),
        &["target.link", "hand", "flange"],
    );
    write(at, "s.toml", &text.replace(SIX_AXIS, "gone.urdf"));
    refused(at, &["run", "s.toml"], &["gone.urdf", "No such file"]);
    write(at, "s.toml", &text.replace(SIX_AXIS, "s.toml"));
    refused(at, &["run", "s.toml"], &["s.toml"]);
    refused(at, &["run", "gone.toml"], &["gone.toml", "No such file"]);
    // a model is the fit's: simulate does not ask for it
    write(
        at,
        "s.toml",
        &scenario("effects = [\"nothing\"]", "poses = 3", ""),
    );
    refused(at, &["run", "s.toml"], &["\"nothing\"", "geometry"]);
}

#[test]
fn scenarios_like_others_that_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "base.toml", &scenario("", "poses = 3", ""));
    write(at, "broken.toml", "seed = \n");
    write(at, "second.toml", "like = \"base.toml\"\n");
    fs::create_dir(at.join("deep")).unwrap();
    let before = files(at);
    let cases: [(&str, &[&str]); 9] = [
        ("like = \"gone.toml\"", &["gone.toml", "No such file"]),
        ("like = \"s.toml\"", &["s.toml", "like another one itself"]),
        (
            "like = \"second.toml\"",
            &["s.toml", "second.toml", "like another one itself"],
        ),
        (
            "like = \"deep/base.toml\"",
            &["deep/base.toml", "same folder"],
        ),
        ("like = \"\"", &["same folder"]),
        ("like = 3", &["like is 3", "same folder"]),
        ("like = \"broken.toml\"", &["broken.toml"]),
        (
            "like = \"base.toml\"\ntypo = 1",
            &["s.toml", "`typo`", "`design`"],
        ),
        (
            "like = \"base.toml\"\n[design]\ntypo = 1",
            &["s.toml", "`typo`", "`poses`"],
        ),
    ];
    for (text, parts) in cases {
        write(at, "s.toml", text);
        for command in ["simulate", "run", "sweep", "plan"] {
            refused(at, &[command, "s.toml"], parts);
        }
        fs::remove_file(at.join("s.toml")).unwrap();
        assert_eq!(files(at), before, "nothing is written");
    }
    // what it says itself stands, what it does not is the other's
    let own = "like = \"base.toml\"\n[design]\nrepeats = 2\n";
    write(at, "s.toml", own);
    done(at, &["simulate", "s.toml", "--csv", "s"]);
    let table = fs::read_to_string(at.join("s").join("readings.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + 3 * 2);
}

#[test]
fn sweeps_that_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let design = "poses = 14\ndirections = 2";
    let blind = |table: &str| scenario("", design, &format!("{TRUTH}[blind]\n{table}\n"));
    write(at, "s.toml", &scenario("", design, TRUTH));
    write(at, "b.toml", &blind("one = 2\nfamilies = [\"backlash\"]"));
    write(at, "file", "mine");
    // usage
    let wrong: [(&[&str], &str); 8] = [
        (&["--shard", "0/3", "-o", "out"], "K/N"),
        (&["--shard", "4/3", "-o", "out"], "K/N"),
        (&["--shard", "1", "-o", "out"], "K/N"),
        (&["--shard", "a/b", "-o", "out"], "K/N"),
        (&["--shard", "1/2"], "--output"),
        (&["--cases", "0"], "--cases"),
        (&["--cases", "some"], "--cases"),
        (&["--seed=-1"], "--seed"),
    ];
    for (words, part) in wrong {
        let ran = run(at, &[&["sweep", "b.toml"], words].concat());
        assert_eq!(ran.code, Some(2), "{words:?}: {}{}", ran.out, ran.err);
        assert_eq!(ran.out, "", "{words:?}");
        assert!(ran.err.contains(part), "{words:?}: {}", ran.err);
    }
    assert_eq!(run(at, &["sweep"]).code, Some(2));
    // scenarios that are no sweeps
    refused(
        at,
        &["sweep", "s.toml"],
        &["s.toml", "[blind]", "misfit run"],
    );
    refused(at, &["sweep", "gone.toml"], &["gone.toml", "No such file"]);
    let tables: [(&str, &[&str]); 7] = [
        ("one = 2\nfamilies = [\"hose\"]", &["\"hose\"", "backlash"]),
        (
            "one = 2\nfamilies = [\"geometry\"]",
            &["\"geometry\"", "backlash"],
        ),
        ("two = 2\none = 0\nfamilies = [\"backlash\"]", &["too few"]),
        ("one = 0", &["accepted: 1 to 1000000"]),
        ("one = 2\nlambda = [10.0, 3.0]", &["lambda", "larger last"]),
        ("one = 2\noutliers = 0.9", &["outliers", "0 to 0.5"]),
        ("one = 2\nkind = 3", &["`kind`", "`families`"]),
    ];
    for (table, parts) in tables {
        write(at, "t.toml", &blind(table));
        refused(at, &["sweep", "t.toml"], &[&["t.toml"], parts].concat());
    }
    fs::remove_file(at.join("t.toml")).unwrap();
    // places that cannot be written
    let before = files(at);
    for place in ["file", "file/deep"] {
        refused(at, &["sweep", "b.toml", "-o", place], &[place]);
    }
    assert_eq!(files(at), before);
    assert_eq!(fs::read_to_string(at.join("file")).unwrap(), "mine");
    // the folder of another sweep is left alone
    fs::create_dir(at.join("out")).unwrap();
    write(&at.join("out"), "sweep.toml", "another");
    refused(
        at,
        &["sweep", "b.toml", "--shard", "2/2", "-o", "out"],
        &["sweep.toml", "another sweep", "b.toml", "empty folder"],
    );
    assert_eq!(files(&at.join("out")), ["sweep.toml".to_owned()].into());
}

#[test]
fn an_arm_that_collapses_under_its_load_is_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    // the paper's tables read with an exponent two below the usual one: 5 kg is more than the joints hold
    let text = format!(
        "robot = {SDA5F:?}\nseed = 1\n[[target]]\nname = \"r1\"\nlink = \"r1_flange\"\n\
         [design]\nposes = 20\nloads = [{{ mass_kg = 5.0, com_m = [0.05, 0.0, 0.05] }}]\n\
         [[truth]]\nkind = \"joint_compliance\"\npreset = \"paper\"\nexponent = 2\n"
    );
    write(at, "soft.toml", &text);
    for command in ["simulate", "run"] {
        refused(at, &[command, "soft.toml"], &["soft", "joint `r1_", "load"]);
    }
    refused(at, &["run", "soft.toml", "-o", "out"], &["soft"]);
    assert_eq!(
        files(at),
        ["out".to_owned(), "soft.toml".to_owned()].into(),
        "the folder, and nothing in it"
    );
    assert!(files(&at.join("out")).is_empty());
}

#[test]
fn places_that_cannot_be_written_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "s.toml", &scenario("", "poses = 3", ""));
    write(at, "file", "mine");
    fs::create_dir(at.join("folder.mcap")).unwrap();
    let simulate = |words: &[&str], part: &str| {
        refused(at, &[&["simulate", "s.toml"], words].concat(), &[part]);
    };
    simulate(&["-o", "gone/x.mcap"], "gone/x.mcap: cannot be written");
    simulate(&["-o", "file/x.mcap"], "file/x.mcap: cannot be written");
    simulate(&["-o", "folder.mcap"], "folder.mcap: cannot be written");
    simulate(&["--csv", "file"], "file: cannot be written");
    simulate(&["--csv", "file/deep"], "file/deep: cannot be written");
    refused(
        at,
        &["run", "s.toml", "-o", "file"],
        &["file: cannot be made"],
    );
    refused(
        at,
        &["run", "s.toml", "-o", "file/deep"],
        &["file/deep: cannot be made"],
    );
    let campaign = lab().join("cell.mcap");
    let campaign = campaign.to_str().unwrap();
    for words in [
        &["report", campaign, "-o", "gone/x.html"][..],
        &["fit", campaign, "--report", "gone/x.html"],
        &["diagnose", campaign, "--report", "gone/x.html"],
        &["ladder", campaign, "-o", "gone/x.toml"],
        &["fit", campaign, "--record", "gone/x.mcap"],
    ] {
        // the folder is named, not the temporary file that would have been in it
        refused(
            at,
            words,
            &["gone/x.", "cannot be written: gone is no folder"],
        );
    }
    let expected = ["file", "folder.mcap", "s.toml"];
    assert_eq!(files(at), expected.map(str::to_owned).into());
    assert_eq!(fs::read_to_string(at.join("file")).unwrap(), "mine");
    assert!(files(&at.join("folder.mcap")).is_empty());
}

#[test]
fn diagnose_and_ladder_keep_their_contract() {
    let found = json(lab(), &["diagnose", "cell.mcap", "--json"]);
    assert_eq!(found["schema"], "misfit.diagnosis/2");
    let verdicts = ["nothing", "named", "named_incomplete", "alias", "unknown"];
    assert!(verdicts.contains(&found["verdict"].as_str().unwrap()));
    for key in [
        "effects",
        "where",
        "contrasts",
        "candidates",
        "cannot_see",
        "next_poses",
        "noise",
        "fit",
        "heldout",
    ] {
        assert!(found.get(key).is_some(), "diagnose --json has no {key}");
    }
    for contrast in ["pose", "load", "direction", "time", "repeat"] {
        assert!(
            found["contrasts"].get(contrast).is_some(),
            "no contrast {contrast}"
        );
    }
    for candidate in found["candidates"].as_array().unwrap() {
        for key in ["effect", "log_evidence", "lambda", "p_value", "explained"] {
            assert!(candidate.get(key).is_some(), "a candidate has no {key}");
        }
    }
    let found = json(lab(), &["ladder", "cell.mcap", "--json"]);
    assert_eq!(found["schema"], "misfit.ladder/1");
    assert_eq!(found["rungs"][0]["added"], "nominal");
    for key in ["left_out", "floor_m", "stopped_because"] {
        assert!(found.get(key).is_some(), "ladder --json has no {key}");
    }
    for key in ["waves", "refused"] {
        assert!(found["last"].get(key).is_some(), "a diagnosis has no {key}");
    }
    let ran = run(lab(), &["ladder", "cell.mcap", "--stop-at", "three"]);
    assert_eq!(ran.code, Some(2));
    assert!(ran.err.contains("0.3mm"), "{}", ran.err);
    assert_eq!(found["last"]["schema"], "misfit.diagnosis/2");
    for words in [["diagnose", "cell.mcap"], ["ladder", "cell.mcap"]] {
        for line in done(lab(), &words).lines() {
            assert!(line.chars().count() <= 100, "{line}");
        }
    }
}

/// Columns of a table by name.
fn table_of(path: &Path) -> (Vec<String>, Vec<Vec<String>>) {
    let mut reader = csv::Reader::from_path(path).unwrap();
    let words = |record: &csv::StringRecord| record.iter().map(str::to_owned).collect();
    let header = words(reader.headers().unwrap());
    let rows = reader.records().map(|row| words(&row.unwrap())).collect();
    (header, rows)
}

#[test]
fn a_plan_is_commands_for_the_next_campaign() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "cell.toml", &cell());
    // before anything is measured
    let words = ["plan", "cell.toml", "--poses", "6", "--csv", "first.csv"];
    let said = done(at, &words);
    for part in [
        "6 poses",
        "loads of 0, 40.0 kg",
        "24 readings",
        "O1",
        "enough",
        "next",
    ] {
        assert!(said.contains(part), "no {part} in {said}");
    }
    assert_eq!(said, done(at, &words), "the same again");
    let (header, rows) = table_of(&at.join("first.csv"));
    let expected = "pose repeat a1_rad a2_rad a3_rad a4_rad a5_rad a6_rad payload_kg payload_x_m payload_y_m payload_z_m";
    assert_eq!(header.join(" "), expected);
    assert_eq!(rows.len(), 24);
    // the load changes once
    let masses: Vec<f64> = rows.iter().map(|row| row[8].parse().unwrap()).collect();
    assert_eq!(masses, [[0.0; 12], [40.0; 12]].concat());
    assert_eq!(rows[0][2..8], rows[12][2..8]);
    // the table is a campaign's but for what is measured
    let robot = fs::read_to_string(SIX_AXIS).unwrap();
    write(at, "arm.urdf", &robot);
    let text = fs::read_to_string(at.join("first.csv")).unwrap();
    let mut lines = text.lines();
    let mut filled = format!("{},x_m,y_m,z_m\n", lines.next().unwrap());
    for line in lines {
        filled += &format!("{line},1,0,1\n");
    }
    write(at, "filled.csv", &filled);
    let campaign = "robot = \"arm.urdf\"\ntable = \"filled.csv\"\n[[target]]\nname = \"t\"\nlink = \"flange\"\n";
    write(at, "filled.toml", campaign);
    assert_eq!(
        misfit_campaign::Campaign::load(&at.join("filled.toml"))
            .unwrap()
            .readings
            .len(),
        24
    );
    // after a campaign: its readings count, its loads and repeats are taken over
    done(at, &["simulate", "cell.toml"]);
    let document = |words: &[&str]| -> Value {
        let all = [&["plan", "cell.mcap", "--json", "--poses", "5"], words].concat();
        serde_json::from_str(&done(at, &all)).unwrap()
    };
    let next = document(&[]);
    assert_eq!(next["schema"], "misfit.plan/1");
    assert_eq!(next["measured"], 40);
    assert_eq!(next["readings"], 20);
    assert_eq!(next["poses"].as_array().unwrap().len(), 5);
    assert!(next["separation"].is_null());
    let precision = &next["precision"];
    let accuracy = |of: &str| precision[of]["accuracy_m"].as_f64().unwrap();
    assert!(accuracy("proposed") < accuracy("measured"));
    let scratch = document(&["--from-scratch"]);
    assert_eq!(scratch["measured"], 0);
    assert!(scratch["precision"]["measured"].is_null());
    // two effects, the same pair as in the campaign's own diagnosis
    let apart = document(&[
        "--separate",
        "bearing_tilt,link_flexibility",
        "--loads",
        "0,20,60",
    ]);
    assert!(apart["precision"].is_null());
    assert_eq!(apart["separation"]["sizes"], "fitted");
    assert_eq!(apart["protocol"]["loads"][2]["mass_kg"], 60.0);
    assert_eq!(apart["readings"], 30);
    let way = &apart["separation"]["ways"][1];
    assert_eq!(way["effect"], "link_flexibility");
    assert!(way["lambda_proposed"].as_f64() >= way["lambda_measured"].as_f64());
    let said = done(
        at,
        &[
            "plan",
            "cell.toml",
            "--separate",
            "backlash,joint_hardening",
        ],
    );
    assert!(said.contains("approach_<joint>"), "{said}");
}

#[test]
fn one_arm_of_two_moves_its_own_joints() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let text = format!(
        "robot = {SDA5F:?}\nseed = 1\n[[target]]\nname = \"r1\"\nlink = \"r1_flange\"\n[[target]]\nname = \"r2\"\n\
         link = \"r2_flange\"\n[noise]\nposition_m = 1e-5\n[design]\nposes = 4\n"
    );
    write(at, "both.toml", &text);
    let one = [
        "plan",
        "both.toml",
        "--targets",
        "r2",
        "--csv",
        "r2.csv",
        "--candidates",
        "40",
    ];
    let said = done(at, &one);
    assert!(said.contains("target r2"), "{said}");
    let (header, rows) = table_of(&at.join("r2.csv"));
    assert_eq!(rows.len(), 4);
    for (place, word) in header.iter().enumerate() {
        let moves = rows.iter().any(|row| row[place] != rows[0][place]);
        let own = word == "pose" || word == "torso_rad" || word.starts_with("r2_");
        assert_eq!(moves, own, "{word}");
    }
    refused(
        at,
        &["plan", "both.toml", "--targets", "r3"],
        &["r3", "r1, r2"],
    );
}

#[test]
fn plans_that_cannot_be_made_are_refused() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "cell.toml", &cell());
    let plan = |words: &[&str], parts: &[&str]| {
        refused(at, &[&["plan", "cell.toml"], words].concat(), parts);
    };
    plan(
        &["--separate", "backlash,rust"],
        &["--separate", "\"rust\"", "bearing_tilt"],
    );
    plan(
        &["--of", "backlash"],
        &["--of", "\"backlash\"", "joint_compliance"],
    );
    plan(&["--loads", "0,heavy"], &["--loads", "\"heavy\"", "kg"]);
    plan(&["--loads", "-1"], &["--loads", "-1"]);
    plan(&["--loads", "1e300"], &["equilibrium"]);
    plan(&["--limits", "none.toml"], &["none.toml"]);
    plan(&["--csv", "gone/x.csv"], &["gone/x.csv: cannot be written"]);
    let before = fs::read(at.join("cell.toml")).unwrap();
    plan(&["--csv", "cell.toml"], &["cell.toml"]);
    assert_eq!(
        fs::read(at.join("cell.toml")).unwrap(),
        before,
        "its own input"
    );
    for words in [
        ["report", "cell.toml", "-o", "x.txt"],
        ["fit", "cell.toml", "--report", "x.txt"],
    ] {
        let ran = run(at, &words);
        assert_eq!(ran.code, Some(2), "{words:?}: {}", ran.err);
        assert!(
            ran.err.contains("ending in .html"),
            "{words:?}: {}",
            ran.err
        );
    }
    for (limits, parts) in [
        ("colour = 1", &["colour"][..]),
        ("margin = 0.5", &["margin", "0.5"]),
        ("least_height_m = nan", &["least_height_m"]),
        ("least_height_m = 50", &["50 m", "limits"]),
        ("[fixed]\na7_deg = 0", &["a7_deg", "a6"]),
        ("[fixed]\na1_mm = 0", &["a1_mm", "<joint>_deg"]),
        ("[fixed]\na1_deg = true", &["a1_deg", "true"]),
        (
            "[limits]\na1_deg = [10, -10]",
            &["a1_deg", "[least, greatest]"],
        ),
        ("[limits]\na1_deg = [-900, 10]", &["a1_deg", "robot's own"]),
        ("[[forbidden]]", &["number 1", "forbid everything"]),
        (
            "[[forbidden]]\na1_deg = [-360, 360]",
            &["none of 10000", "forbidden"],
        ),
        (
            "[fixed]\na1_deg = 0\na2_deg = 0\na3_deg = 0\na4_deg = 0\na5_deg = 0\na6_deg = 0",
            &["no posture to choose", "a1, a2"],
        ),
    ] {
        write(at, "limits.toml", limits);
        plan(&["--limits", "limits.toml"], parts);
    }
    write(at, "quiet.toml", &cell().replace("position_m = 1e-5\n", ""));
    refused(at, &["plan", "quiet.toml"], &["quiet.toml", "position_m"]);
    let pulled = cell().replace("mass_kg = 0.0", "pull_N = [1.0, 0.0, 0.0]");
    write(at, "pulled.toml", &pulled);
    refused(at, &["plan", "pulled.toml"], &["pulled.toml", "pull_N"]);
    refused(at, &["plan", "gone.toml"], &["gone.toml"]);
    write(at, "bad.toml", "robot = \n");
    refused(at, &["plan", "bad.toml"], &["bad.toml"]);
    // wrong usage
    for words in [
        &["--separate", "backlash"][..],
        &["--separate", "backlash,backlash"],
        &["--separate", "a,b", "--of", "geometry"],
        &["--poses", "0"],
        &["--directions", "3"],
        &["--criterion", "e"],
    ] {
        let ran = run(at, &[&["plan", "cell.toml"], words].concat());
        assert_eq!(ran.code, Some(2), "{words:?}: {}", ran.err);
    }
}

#[test]
fn what_was_found_is_recorded() {
    use misfit_campaign::Split;
    use misfit_campaign::recording::{Results, read_recording};
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    write(at, "cell.toml", &cell());
    let recorded = |words: &[&str], file: &str| {
        let ran = run(at, words);
        assert_eq!(ran.code, Some(0), "{words:?}: {}{}", ran.out, ran.err);
        let recording = read_recording(&at.join(file)).unwrap();
        let results: Results = recording.results.unwrap();
        // what is recorded of each reading has the error that is said of all
        for step in &results.steps {
            let pairs = recording.campaign.readings.iter().zip(&step.predicted);
            let squares: Vec<f64> = pairs
                .filter(|(reading, _)| reading.split == Split::Fit)
                .map(|(r, p)| (r.position - p.translation.vector).norm_squared())
                .collect();
            let rms = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            assert!(
                (rms / step.fitted_rms_m - 1.0).abs() < 1e-9,
                "{}: {rms}",
                step.added
            );
        }
        let names: Vec<String> = results.steps.iter().map(|s| s.added.clone()).collect();
        (ran, names, recording.attachments, results)
    };
    let cell = lab().join("cell.mcap");
    let cell = cell.to_str().unwrap();

    let words = ["ladder", cell, "--record", "ladder.mcap", "--json"];
    let (ran, names, files, results) = recorded(&words, "ladder.mcap");
    let said: Value = serde_json::from_str(&ran.out).unwrap();
    let rungs: Vec<&str> = said["rungs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|rung| rung["added"].as_str().unwrap())
        .collect();
    assert_eq!(names, rungs);
    assert!(names.len() > 2 && names[0] == "nominal", "{names:?}");
    let kept: Value = serde_json::from_slice(&files["result.json"]).unwrap();
    assert_eq!(kept, said);
    assert!(
        results.verdict.contains("nothing more is detectable"),
        "{}",
        results.verdict
    );
    assert!(results.progress.iter().any(|p| p.step > 0));
    // the file is a campaign still, its model a model
    fs::write(at.join("m.toml"), &files["model.toml"]).unwrap();
    let (_, names, ..) = recorded(
        &[
            "fit",
            "ladder.mcap",
            "--model",
            "m.toml",
            "--record",
            "fit.mcap",
        ],
        "fit.mcap",
    );
    assert_eq!(names, ["nominal", "fitted"]);
    let words = ["diagnose", cell, "--record", "diagnosis.mcap"];
    let (ran, names, ..) = recorded(&words, "diagnosis.mcap");
    assert_eq!(names[..2], ["nominal", "model"]);
    assert!(
        ran.out.contains("misfit replay diagnosis.mcap"),
        "{}",
        ran.out
    );
    // nothing is written over what is read
    refused(
        at,
        &["fit", "fit.mcap", "--record", "fit.mcap"],
        &["fit.mcap", "read here"],
    );

    let (_, names, files, results) = recorded(&["run", "cell.toml", "-o", "out"], "out/cell.mcap");
    assert_eq!(names, ["nominal", "fitted"]);
    let scenario = String::from_utf8(files["scenario.toml"].clone()).unwrap();
    assert!(
        scenario.contains("[design]") && !scenario.contains("truth"),
        "{scenario}"
    );
    // commands for poses are recorded as such
    let words = [
        "compensate",
        "fit.mcap",
        "--tasks",
        "t.csv",
        "-o",
        "commands.mcap",
    ];
    let seen = &results.steps[0].predicted[0];
    let (t, q) = (seen.translation, seen.rotation);
    let row = [t.x, t.y, t.z, q.w, q.i, q.j, q.k].map(|x| x.to_string());
    write(
        at,
        "t.csv",
        &format!("x_m,y_m,z_m,qw,qx,qy,qz\n{}\n", row.join(",")),
    );
    let ran = run(at, &words);
    assert_eq!(ran.code, Some(0), "{}{}", ran.out, ran.err);
    refused(
        at,
        &["fit", "commands.mcap"],
        &["commands.mcap", "nobody measured"],
    );
}

#[test]
fn quiet_prints_nothing_but_what_is_asked_for() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let cell = lab().join("cell.mcap");
    let cell = cell.to_str().unwrap();
    let fit = [
        "fit",
        cell,
        "--effects",
        "joint_offset",
        "--no-cross-validation",
    ];
    let silent = run(at, &[&fit[..], &["--quiet"]].concat());
    assert_eq!((silent.code, silent.out.as_str()), (Some(0), ""));
    assert_eq!(silent.err, "");
    let asked = run(at, &[&fit[..], &["-q", "--json"]].concat());
    let document: Value = serde_json::from_str(&asked.out).unwrap();
    assert_eq!(document["schema"], "misfit.fit/1");
    refused(at, &["-q", "fit", "none.toml"], &["none.toml"]);
}

#[test]
fn colours_are_asked_for_and_taken_back() {
    let folder = TempDir::new().unwrap();
    let out = |always: bool, never: bool| {
        let mut command = misfit(folder.path());
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        if always {
            command.env("CLICOLOR_FORCE", "1");
        }
        if never {
            command.env("NO_COLOR", "1");
        }
        command.args(["fit", lab().join("cell.mcap").to_str().unwrap()]);
        String::from_utf8(command.output().unwrap().stdout).unwrap()
    };
    let (plain, coloured) = (out(false, false), out(true, false));
    assert!(!plain.contains('\x1b'));
    assert!(
        coloured.contains("\x1b[1mnext     \x1b[0m\x1b[36mmisfit diagnose"),
        "{coloured}"
    );
    assert_eq!(out(false, true), plain);
}

#[test]
fn shells_and_man_know_every_command() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let help = run(at, &["--help"]).out;
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| *line != "Commands:")
        .skip(1)
        .take_while(|line| !line.is_empty())
        .filter(|line| line.starts_with("  ") && !line.starts_with("   "))
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    assert!(commands.len() > 12, "{help}");
    for shell in ["bash", "zsh", "fish"] {
        let ran = run(at, &["completions", shell]);
        assert_eq!(ran.code, Some(0));
        for command in &commands {
            assert!(ran.out.contains(command), "{command} in {shell}");
        }
    }
    assert!(run(at, &["man"]).out.contains("misfit\\-diagnose(1)"));
    assert_eq!(run(at, &["man", "-o", "man1"]).code, Some(0));
    let pages = files(&at.join("man1"));
    for command in commands.iter().filter(|command| **command != "help") {
        assert!(
            pages.contains(&format!("misfit-{command}.1")),
            "{command}: {pages:?}"
        );
        // and each has an example
        let help = run(at, &[command, "--help"]).out;
        assert!(help.contains("Examples:"), "{command}");
    }
    assert_eq!(run(at, &["completions", "dos"]).code, Some(2));
    write(at, "file", "mine");
    refused(at, &["man", "-o", "file"], &["file", "cannot be made"]);
}

/// The program alone in a folder, with nothing on the PATH.
#[cfg(unix)]
fn alone(folder: &Path) -> Command {
    let own = folder.join("misfit");
    let built = env!("CARGO_BIN_EXE_misfit");
    if !own.exists() && fs::hard_link(built, &own).is_err() {
        fs::copy(built, &own).unwrap();
    }
    let mut command = Command::new(own);
    command.current_dir(folder).env("PATH", "");
    command
}

#[cfg(unix)]
#[test]
fn replay_without_its_program_says_how_to_get_it() {
    let folder = TempDir::new().unwrap();
    let output = alone(folder.path())
        .args(["replay", "x.mcap"])
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
    for word in [
        "misfit: misfit-replay",
        "cargo build --release -p misfit-replay",
        "cargo install --path replay",
    ] {
        assert!(said.contains(word), "{said}");
    }
}

#[cfg(unix)]
#[test]
fn replay_passes_words_on_and_exit_codes_back() {
    use std::os::unix::fs::PermissionsExt;
    let folder = TempDir::new().unwrap();
    let program = folder.path().join("misfit-replay");
    let script = "#!/bin/sh\nfor word; do echo \"$word\"; done\nexit ${CODE:-0}\n";
    fs::write(&program, script).unwrap();
    fs::set_permissions(&program, fs::Permissions::from_mode(0o755)).unwrap();
    let mut misfit = alone(folder.path());
    misfit.args(["replay", "-x.mcap", "--save", "a b.rrd"]);
    misfit.assert().code(2);
    for code in [0, 1, 2] {
        let mut misfit = alone(folder.path());
        misfit.args([
            "replay",
            "--save",
            "a b.rrd",
            "--timeline",
            "step",
            "--",
            "-x.mcap",
        ]);
        let ended = misfit.env("CODE", code.to_string()).assert().code(code);
        ended.stdout("--save\na b.rrd\n--timeline\nstep\n--\n-x.mcap\n");
    }
    let mut misfit = alone(folder.path());
    misfit.args(["--quiet", "replay", "x.mcap"]);
    misfit.assert().code(0).stdout("");
}
