//! Input that fights back: what is too large, too deep, endless, or leads elsewhere is refused with one clear message,
//! soon and without much memory. The limits, with the tests that hold them, stand in `docs/faults.md`.

use crate::cli::{misfit, refused};
use crate::two_arms::{DH_TABLE, TWO_ARMS, assert_same};
use mcap::records::MessageHeader;
use misfit_arm::formula::Formula;
use misfit_arm::input::{InputError, LARGEST_TABLE, LARGEST_TOML, LARGEST_URDF};
use misfit_arm::robot::{Robot, RobotError};
use misfit_campaign::recording::{self, Beside, RecordingError, read_bag, read_recording};
use misfit_campaign::{Campaign, CampaignError, LoadError};
use misfit_cell::scenario::Scenario;
use misfit_core::diagnosis::diagnose;
use misfit_core::effects::{self, EffectList, table::MOST_EFFECTS};
use misfit_core::fit::{self, Options};
use misfit_core::ladder;
use misfit_core::model_file;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::error::Error;
use std::fs::{self, File};
use std::io::Write;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use tempfile::TempDir;

const CAMPAIGN: &str = "robot = \"arm.urdf\"\ntable = \"t.csv\"\n[[target]]\nname = \"left\"\nlink = \"left_flange\"\n\
    [frames]\nbase_from_tracker = \"estimate\"\n[noise]\nposition_m = 1e-5\n[split]\nfraction = 0.3\nseed = 1\n";
const TABLE: &str = "torso_rad,slide_m,wrist_deg,x_m,y_m,z_mm,payload_kg\n0,0.1,0,1,2,30,1\n0.5,0.2,0,1.1,2,40,\n\
    1.0,0.3,10,1.2,2.1,30,2\n-0.5,0.4,0,1.3,2.2,50,1\n-1.0,0.9,0,1.4,2,60,0\n0.3,0.6,-10,0.9,2.3,30,1\n";
const MODEL: &str = "[[effect]]\nkind = \"joint_offset\"\nhold = [\"torso\"]\n\
    [[effect]]\nkind = \"gear_ripple\"\ncycles = [1, 2]\n\
    [[effect]]\nkind = \"expression\"\nname = \"pull\"\nacts_on = \"q1\"\nlaw = \"a*sin(q1) + a*tau1\"\n\
    parameters = { a = { unit = \"rad\", typical = 1e-4 } }\n";
const SCENARIO: &str = "robot = \"arm.urdf\"\nseed = 3\n[[target]]\nname = \"left\"\nlink = \"left_flange\"\n[noise]\n\
    position_m = 1e-5\n[design]\nposes = 3\nloads = [{ mass_kg = 1.0 }]\n[[truth]]\n\
    kind = \"joint_offset\"\nrandom = 1.0\n\
    [expect]\nconverged = true\n";

/// A folder with a small campaign, a scenario and a model.
fn cell() -> TempDir {
    let folder = TempDir::new().unwrap();
    for (name, text) in [
        ("arm.urdf", TWO_ARMS),
        ("arm.toml", DH_TABLE),
        ("c.toml", CAMPAIGN),
        ("t.csv", TABLE),
        ("m.toml", MODEL),
        ("s.toml", SCENARIO),
    ] {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// A refusal's message, which must hold all parts, be short, and show nothing but text.
#[track_caller]
fn says(error: &dyn Error, parts: &[&str]) {
    let message = error.to_string();
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
    assert!(
        message.len() < 4000,
        "{} bytes: {message:.300}",
        message.len()
    );
    assert!(!message.trim().is_empty());
}

/// What is done soon: well before anyone would take it for a hang, on a slow machine too.
#[track_caller]
fn soon<T>(what: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = what();
    let took = start.elapsed();
    assert!(took < Duration::from_secs(30), "took {took:?}");
    result
}

/// A file of nothing but holes: it takes no room on the disk, and reading it would take some.
fn sparse(path: &Path, bytes: u64) {
    File::create(path).unwrap().set_len(bytes).unwrap();
}

// ---- robots

#[test]
fn an_xml_bomb_is_refused() {
    let mut entities = "<!ENTITY a0 \"ha\">".to_owned();
    for level in 1..30 {
        let below = format!("&a{};", level - 1).repeat(10);
        entities += &format!("<!ENTITY a{level} \"{below}\">");
    }
    let bomb = format!(
        "<?xml version=\"1.0\"?><!DOCTYPE robot [{entities}]><robot name=\"&a29;\"></robot>"
    );
    let error = soon(|| Robot::parse("bomb.urdf", &bomb, None)).unwrap_err();
    says(
        &error,
        &[
            "bomb.urdf",
            "line 1",
            "document type declaration",
            "entities are not expanded",
        ],
    );
    // files of the disk are not taken in by entities either
    let text = TWO_ARMS.replace(
        "<robot",
        "<!DOCTYPE r [<!ENTITY e SYSTEM \"file:///etc/hostname\">]><robot",
    );
    let error = Robot::parse("entity.urdf", &text, None).unwrap_err();
    says(&error, &["document type declaration"]);
}

#[test]
fn deeply_nested_xml_is_refused() {
    for tag in ["link", "gazebo", "a"] {
        let (open, close) = (format!("<{tag}>"), format!("</{tag}>"));
        let text = format!(
            "<robot name=\"r\">{}{}</robot>",
            open.repeat(400_000),
            close.repeat(400_000)
        );
        let error = soon(|| Robot::parse("deep.urdf", &text, None)).unwrap_err();
        says(
            &error,
            &["deep.urdf", "line 1", "nested 33 deep", "at most 32 levels"],
        );
        let text = format!("<robot name=\"r\">{}", open.repeat(100_000));
        let error = soon(|| Robot::parse("deep.urdf", &text, None)).unwrap_err();
        says(&error, &["deep.urdf", "more than 32", "never closed"]);
    }
}

#[test]
fn a_tag_of_a_million_attributes_is_refused() {
    let many: String = (0..1_000_000).map(|k| format!(" a{k}=\"\"")).collect();
    let text = format!("<robot name=\"r\"><link name=\"a\"{many}/></robot>");
    let error = soon(|| Robot::parse("wide.urdf", &text, None)).unwrap_err();
    says(
        &error,
        &[
            "wide.urdf",
            "line 1",
            "a tag of 1000001 attributes",
            "at most 64 attributes",
        ],
    );
}

/// Below each declaration a parser looks through all above it, and copies them.
#[test]
fn many_namespaces_are_refused() {
    let nested: String = (0..100_000)
        .map(|k| format!("<a xmlns:n{k}='u'>"))
        .collect();
    let text = format!("<robot>{nested}{}</robot>", "</a>".repeat(100_000));
    let error = soon(|| Robot::parse("names.urdf", &text, None)).unwrap_err();
    says(&error, &["names.urdf", "100000 namespaces", "at most 64"]);
}

#[test]
fn a_million_joints_are_refused() {
    let many = "<joint/>".repeat(1_000_000);
    let error = soon(|| Robot::parse("x.urdf", &format!("<robot name=\"r\">{many}</robot>"), None));
    says(
        &error.unwrap_err(),
        &["x.urdf", "1000003 tags and attributes", "at most 1000000"],
    );
    let joints = "<joint name=\"j\"/>".repeat(400_000);
    let error = soon(|| {
        Robot::parse(
            "x.urdf",
            &format!("<robot name=\"r\">{joints}</robot>"),
            None,
        )
    });
    says(
        &error.unwrap_err(),
        &["x.urdf", "400000 joints", "at most 1000"],
    );
    let links = "<link name=\"l\"/>".repeat(400_000);
    let error = soon(|| {
        Robot::parse(
            "x.urdf",
            &format!("<robot name=\"r\">{links}</robot>"),
            None,
        )
    });
    says(
        &error.unwrap_err(),
        &["x.urdf", "400000 links", "at most 1000"],
    );
    let rows = "[[joint]]\nname=\"j\"\n".repeat(200_000);
    let table = format!("name = \"r\"\nconvention = \"standard\"\n{rows}");
    let error = soon(|| Robot::parse("x.toml", &table, None));
    says(
        &error.unwrap_err(),
        &["x.toml", "200000 joints", "at most 1000"],
    );
}

// ---- sizes

#[test]
fn files_larger_than_their_limit_are_not_read() {
    let folder = cell();
    let at = folder.path();
    for (name, bytes, limit) in [
        ("c.toml", LARGEST_TOML, "4 MB"),
        ("arm.urdf", LARGEST_URDF, "16 MB"),
        ("t.csv", LARGEST_TABLE, "2 GB"),
        ("t.csv", 10_000_000_000, "2 GB"),
    ] {
        let folder = cell();
        let at = folder.path();
        sparse(&at.join(name), bytes + 1);
        let parts = [
            name,
            "cannot be read",
            "found more than",
            limit,
            "accepted: at most",
        ];
        refused(at, &["fit", "c.toml"], &parts);
    }
    let large = |name: &str| sparse(&at.join(name), LARGEST_TOML + 1);
    large("large.toml");
    refused(at, &["run", "large.toml"], &["large.toml", "4 MB"]);
    refused(
        at,
        &["fit", "c.toml", "--model", "large.toml"],
        &["large.toml", "4 MB"],
    );
    refused(
        at,
        &["plan", "c.toml", "--poses", "5", "--limits", "large.toml"],
        &["large.toml", "4 MB"],
    );
    refused(
        at,
        &["import", "x.mcap", "--spec", "large.toml"],
        &["large.toml", "4 MB"],
    );
    sparse(&at.join("x.mcap"), 2_000_000_001);
    refused(at, &["fit", "x.mcap"], &["x.mcap", "2 GB"]);
    let dh = format!("{DH_TABLE}#{}", " ".repeat(4_000_000));
    says(
        &Robot::parse("large.toml", &dh, None).unwrap_err(),
        &["large.toml", "4 MB"],
    );
}

#[test]
fn a_row_without_an_end_is_not_read_whole() {
    // two of them would not fit into the memory that the program is given here
    for (name, text) in [("no line break", ""), ("an open quote", "a,\"b\nc")] {
        let folder = cell();
        let at = folder.path();
        let mut file = File::create(at.join("t.csv")).unwrap();
        file.write_all(format!("{}\n{text}", TABLE.lines().next().unwrap()).as_bytes())
            .unwrap();
        file.set_len(1_900_000_000).unwrap();
        let program = misfit(at).get_program().to_owned();
        let mut command = assert_cmd::Command::new("sh");
        command
            .current_dir(at)
            .arg("-c")
            .arg("ulimit -v 1000000; exec \"$0\" fit c.toml")
            .arg(program);
        let output = soon(|| command.timeout(Duration::from_secs(60)).output().unwrap());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{name}: {message}");
        for part in [
            "t.csv, line 2",
            "longer than 1 MB",
            "a quote that is not closed",
        ] {
            assert!(message.contains(part), "{name}: {message}");
        }
    }
}

#[test]
fn blank_lines_and_line_ends_of_all_kinds_leave_line_numbers_right() {
    let folder = cell();
    let head = TABLE.lines().next().unwrap();
    for (rows, line) in [
        ("\n0,0.1,0,1,2,30,1\n0,0.1,0,1,2,30,1\n0,0,0,1,2,x,1\n", 4),
        ("\r\n0,0.1,0,1,2,30,1\r\n\r\n\r\n0,0,0,1,2,x,1\r\n", 5),
        ("\n\n\n\n0,0,0,1,2,x,1", 5),
        ("\n0,0.1,0,1,2,30,\"\n\n1\"\n0,0,0,1,2,x,1\n", 5),
    ] {
        fs::write(folder.path().join("t.csv"), format!("{head}{rows}")).unwrap();
        let error = Campaign::load(&folder.path().join("c.toml")).unwrap_err();
        says(&error, &[&format!("line {line}"), "`z_mm`"]);
    }
    // a table that is mostly blank is a table
    let text = format!("{head}\n{}0,0,0,1,2,x,1", "\n".repeat(3_000_000));
    fs::write(folder.path().join("t.csv"), text).unwrap();
    let error = Campaign::load(&folder.path().join("c.toml")).unwrap_err();
    says(&error, &["line 3000002", "`z_mm`"]);
}

#[test]
fn more_than_a_million_readings_are_refused() {
    let folder = cell();
    let table = format!("torso_rad,x_m,y_m,z_m\n{}", "0,1,2,3\n".repeat(1_000_001));
    fs::write(folder.path().join("t.csv"), table).unwrap();
    let error = Campaign::load(&folder.path().join("c.toml")).unwrap_err();
    says(
        &error,
        &[
            "t.csv, line 1000002",
            "more than 1000000 readings",
            "at most 1000000",
        ],
    );
    let design = SCENARIO.replace("poses = 3", "poses = 3\nrepeats = 1000000");
    fs::write(folder.path().join("s.toml"), design).unwrap();
    let error = Scenario::load(&folder.path().join("s.toml")).unwrap_err();
    says(&error, &["s.toml", "3000000 readings", "at most 1000000"]);
}

#[test]
fn a_diagnosis_that_would_fill_the_memory_is_refused() {
    let folder = cell();
    let mut campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
    let model = model_file::model(&campaign, &EffectList::DEFAULT, None).unwrap();
    // many columns by many rows, each of them allowed: a law of one's own with 50 parameters, a thousand times
    let names: Vec<String> = (0..50).map(|k| format!("p{k}")).collect();
    let parameters: Vec<String> = (names.iter())
        .map(|name| format!("{name} = {{ unit = \"rad\", typical = 1e-4 }}"))
        .collect();
    let law = |number: usize| {
        let table = toml::from_str(&format!(
            "name = \"own{number}\"\nacts_on = \"q1\"\nlaw = \"{}\"\nparameters = {{ {} }}",
            names.join("+"),
            parameters.join(", ")
        ));
        let expression = effects::find("expression").unwrap();
        expression.make(table.unwrap()).unwrap()
    };
    let own: Vec<_> = (0..1000).map(law).collect();
    let readings = campaign.readings.clone();
    campaign.readings = readings.iter().cycle().take(6000).cloned().collect();
    let options = Options {
        cross_validate: false,
    };
    let parts = [
        "readings of up to 500",
        "GB of memory",
        "accepted: about",
        "split",
    ];
    let early = |step: &str| panic!("{step} before the size is looked at");
    let refused = diagnose(&campaign, &model, &own, &options, early);
    says(&refused.unwrap_err(), &parts);
    let refused = ladder::climb(&campaign, &EffectList::DEFAULT, &own, None, &options, early);
    says(&refused.unwrap_err(), &parts);
}

// ---- depths and numbers

#[test]
fn toml_nested_too_deeply_is_refused() {
    // each part within what the parser of TOML allows: 80 parts of a key, 80 brackets; together they fill a stack
    let key = vec!["a"; 80].join(".");
    let deep = format!(
        "[{key}]\n{key} = {}1{}\n",
        format!("{{{key} = ").repeat(79),
        "}".repeat(79)
    );
    let folder = cell();
    let at = folder.path();
    fs::write(at.join("deep.toml"), &deep).unwrap();
    let parts = [
        "deep.toml",
        "line 1",
        "more than 64 deep",
        "at most 64 levels",
    ];
    refused(at, &["fit", "deep.toml"], &parts);
    refused(at, &["run", "deep.toml"], &parts);
    refused(at, &["fit", "c.toml", "--model", "deep.toml"], &parts);
    refused(
        at,
        &["plan", "c.toml", "--poses", "5", "--limits", "deep.toml"],
        &parts,
    );
    refused(at, &["import", "x.mcap", "--spec", "deep.toml"], &parts);
    says(&Robot::parse("deep.toml", &deep, None).unwrap_err(), &parts);
    for nest in ["[", "{a=", "[[", "a."] {
        let text = format!("x = {}", nest.repeat(100_000));
        assert!(Robot::parse("deep.toml", &text, None).is_err());
        assert!(Robot::parse("deep.toml", &nest.repeat(100_000), None).is_err());
    }
}

#[test]
fn a_formula_nested_too_deeply_is_refused() {
    for nest in ["(", "-", "sin(", "2^", "min(1,"] {
        let text = nest.repeat(100);
        says(
            &Formula::parse(&text).unwrap_err(),
            &["nested too deeply", "up to 64 levels"],
        );
        says(
            &Formula::parse(&nest.repeat(1_000_000)).unwrap_err(),
            &["bytes long", "up to 1000"],
        );
    }
    let folder = cell();
    let law = MODEL.replace(
        "a*sin(q1)",
        &format!("{}q1{}", "(".repeat(100), ")".repeat(100)),
    );
    fs::write(folder.path().join("m.toml"), law).unwrap();
    let campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
    let error = model_file::read(&folder.path().join("m.toml"), &campaign).unwrap_err();
    says(&error, &["m.toml", "nested too deeply", "up to 64 levels"]);
}

#[test]
fn powers_have_a_value_by_both_ways_or_by_none() {
    for (text, values) in [
        ("x^y", [1.0, f64::INFINITY]),
        ("x^y", [f64::INFINITY, 0.0]),
        // found by fuzzing: infinity to a power that underflows
        (
            "((-t)^(-(3)^22)^3-t)^(-(-t)^(-(3)^2)^2-t)^(-(-33)^2)^2",
            [0.3, 0.0],
        ),
        // and 1 to a power that has no value
        ("x-1^-0^y", [0.3, 1.0]),
        ("x^y", [1.0, f64::NAN]),
        ("x^1.5 + 0*y", [f64::NEG_INFINITY, 0.0]),
        ("x^0.5 + 0*y", [f64::NEG_INFINITY, 0.0]),
        ("x^65 + 0*y", [-1.1, 0.0]),
        ("x^66 + 0*y", [-1.1, 0.0]),
        ("x^-65 + 0*y", [-1.1, 0.0]),
    ] {
        let formula = Formula::parse(text).unwrap();
        let (one, other) = (formula.evaluate(&values), formula.value(&values));
        let same = (one - other).abs() <= 1e-12 * other.abs();
        assert!(
            same || (one.is_nan() && other.is_nan()),
            "{text}: {one} and {other}"
        );
    }
}

#[test]
fn too_many_effects_and_numbers_are_refused() {
    let folder = cell();
    let path = folder.path().join("m.toml");
    let campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
    let refuses = |text: String, parts: &[&str]| {
        fs::write(&path, text).unwrap();
        says(
            &soon(|| model_file::model(&campaign, &EffectList::DEFAULT, Some(&path))).unwrap_err(),
            parts,
        );
    };
    let many = "[[effect]]\nkind=\"geometry\"\n".repeat(100_000);
    refuses(
        many,
        &[
            "m.toml",
            "100000 effects",
            &format!("at most {MOST_EFFECTS}"),
        ],
    );
    let cycles: Vec<String> = (1..=300_000).map(|k| k.to_string()).collect();
    let ripple = format!(
        "[[effect]]\nkind = \"gear_ripple\"\ncycles = [{}]\n",
        cycles.join(",")
    );
    refuses(
        ripple,
        &["m.toml", "cycles names 300000 numbers", "at most 100"],
    );
}

#[test]
fn messages_about_long_lines_and_names_are_short() {
    let long = "x".repeat(1_000_000);
    let folder = cell();
    let at = folder.path();
    for text in [
        format!("{long} = 1\n{CAMPAIGN}"),
        format!("a = \"{long}\n"),
        format!("{CAMPAIGN}[[target]]\nname = \"{long}\"\nlink = \"{long}\"\n"),
    ] {
        fs::write(at.join("long.toml"), &text).unwrap();
        says(
            &Campaign::load(&at.join("long.toml")).unwrap_err(),
            &["long.toml"],
        );
        says(
            &Scenario::load(&at.join("long.toml")).unwrap_err(),
            &["long.toml"],
        );
        says(
            &Robot::parse("long.toml", &text, None).unwrap_err(),
            &["long.toml"],
        );
        let campaign = Campaign::load(&at.join("c.toml")).unwrap();
        says(
            &model_file::read(&at.join("long.toml"), &campaign).unwrap_err(),
            &["long.toml"],
        );
    }
}

#[test]
fn what_a_file_says_does_not_move_the_terminal() {
    let folder = cell();
    let at = folder.path();
    let robot = DH_TABLE.replace("\"dh\"", "\"\\u001b[2J\\u001b[31mred\"");
    fs::write(at.join("arm.toml"), robot).unwrap();
    let campaign = CAMPAIGN
        .replace("arm.urdf", "arm.toml")
        .replace("left_flange", "flange");
    fs::write(at.join("c.toml"), &campaign).unwrap();
    let table = TABLE
        .replace("torso_rad", "j1_rad")
        .replace("slide_m", "j2_rad");
    fs::write(at.join("t.csv"), table.replace(",wrist_deg", ",time_s")).unwrap();
    let output = misfit(at)
        .args(["fit", "c.toml", "--effects", "joint_offset"])
        .output()
        .unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(text.contains("red") && !text.contains('\x1b'), "{text}");
    fs::write(at.join("c.toml"), format!("\u{1b}[2J = 1\n{campaign}")).unwrap();
    refused(at, &["fit", "c.toml"], &["c.toml"]);
}

// ---- recordings and bags

/// One topic of messages that hold nothing, packed.
fn packed(path: &Path, compression: mcap::Compression, messages: usize, bytes: usize) {
    let options = mcap::WriteOptions::new().compression(Some(compression));
    let mut writer = options.create(File::create(path).unwrap()).unwrap();
    let schema = writer
        .add_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        .unwrap();
    let channel = writer
        .add_channel(schema, "/other", "cdr", &BTreeMap::new())
        .unwrap();
    let data = vec![0; bytes];
    for sequence in 0..messages {
        let header = MessageHeader {
            channel_id: channel,
            sequence: sequence as u32,
            log_time: sequence as u64,
            publish_time: sequence as u64,
        };
        writer.write_to_known_channel(&header, &data).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn what_unpacks_to_too_much_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    for compression in [mcap::Compression::Zstd, mcap::Compression::Lz4] {
        packed(&path, compression, 300, 1_000_000);
        assert!(fs::metadata(&path).unwrap().len() < 2_000_000);
        let parts = [
            "x.mcap",
            "found more than",
            "of records",
            "200 times its size",
        ];
        says(&soon(|| read_recording(&path)).unwrap_err(), &parts);
        says(&soon(|| read_bag(&path, |_| true)).unwrap_err(), &parts);
    }
}

#[test]
fn sizes_that_a_recording_claims_cost_no_memory() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    packed(&path, mcap::Compression::Zstd, 3, 1000);
    let whole = fs::read(&path).unwrap();
    // magic, then the header's record and the chunk's: opcode, length, two times, size when unpacked
    let length = |at: usize| u64::from_le_bytes(whole[at..at + 8].try_into().unwrap()) as usize;
    let chunk = 8 + 9 + length(9);
    assert_eq!(whole[chunk], 6, "a chunk");
    for at in [chunk + 1, chunk + 9 + 16, 9] {
        for size in [u64::MAX, 1 << 40, 1 << 33, 250_000_000] {
            let mut bytes = whole.clone();
            bytes[at..at + 8].copy_from_slice(&size.to_le_bytes());
            fs::write(&path, bytes).unwrap();
            says(&soon(|| read_recording(&path)).unwrap_err(), &["x.mcap"]);
            says(
                &soon(|| read_bag(&path, |_| true)).unwrap_err(),
                &["x.mcap"],
            );
        }
    }
}

/// A file of these records, each behind its opcode and its length, without checksums.
fn records(path: &Path, records: &[(u8, Vec<u8>)]) {
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    for (opcode, body) in records {
        bytes.push(*opcode);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
    }
    bytes.extend(b"\x89MCAP0\r\n");
    fs::write(path, bytes).unwrap();
}

#[test]
fn records_that_claim_more_than_they_hold_are_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
    let claim = 0xff00_0000_u32.to_le_bytes().to_vec();
    let (id, ids) = (vec![1, 0], vec![1, 0, 1, 0]);
    let times = vec![0; 16];
    for (opcode, parts) in [
        // a header is passed over, whatever it claims; the end is missing
        (1, vec![claim.clone()]),
        // a schema: its name, its encoding, its text
        (3, vec![id.clone(), claim.clone()]),
        (3, vec![id.clone(), text(b"a"), claim.clone()]),
        (3, vec![id, text(b"a"), text(b"b"), claim.clone()]),
        // a channel: its topic, its encoding, and pairs of texts
        (4, vec![ids.clone(), claim.clone()]),
        (4, vec![ids.clone(), text(b"a"), text(b"b"), claim.clone()]),
        (4, vec![ids, text(b"a"), text(b"b"), text(&claim)]),
        // a message without its times
        (5, vec![times.clone()]),
        // an attachment: its name, its type, its bytes, and one that ends before its checksum
        (9, vec![times.clone(), claim.clone()]),
        (
            9,
            vec![
                times.clone(),
                text(b"a"),
                text(b"b"),
                vec![255; 8],
                vec![0; 4],
            ],
        ),
        (9, vec![times.clone(), text(b"a"), text(b""), vec![0; 8]]),
        (
            9,
            vec![times, text(b"a"), text(b"b"), vec![0; 8], vec![0; 1]],
        ),
        // metadata: its name, and pairs of texts
        (12, vec![claim.clone()]),
        (12, vec![text(b"a"), text(&[text(b"b"), claim].concat())]),
    ] {
        records(&path, &[(opcode, parts.concat())]);
        let part = match opcode {
            1 => "not a whole MCAP file",
            _ => "claims more than it holds",
        };
        says(&read_recording(&path).unwrap_err(), &["x.mcap", part]);
        says(&read_bag(&path, |_| true).unwrap_err(), &["x.mcap", part]);
    }
}

#[test]
fn a_record_longer_than_its_chunk_is_refused() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("x.mcap");
    // a chunk that is not packed, of one message on no channel; its size is told right
    let message = |claimed: u64| [&[5][..], &claimed.to_le_bytes(), &[0; 22]].concat();
    let chunk = |claimed: u64, size: u64| {
        let body = message(claimed);
        [&[0; 28][..], &[0; 4], &size.to_le_bytes(), &body].concat()
    };
    let size = message(22).len() as u64;
    records(&path, &[(6, chunk(22, size))]);
    says(
        &read_bag(&path, |_| true).unwrap_err(),
        &["unknown channel"],
    );
    for claimed in [23, 1 << 20, u64::MAX, u64::MAX - 8] {
        records(&path, &[(6, chunk(claimed, size)), (5, vec![0; 4000])]);
        let part = "longer than the chunk that it stands in";
        says(&read_recording(&path).unwrap_err(), &["x.mcap", part]);
        says(&read_bag(&path, |_| true).unwrap_err(), &["x.mcap", part]);
    }
    for size in [size + 1, u64::MAX] {
        records(&path, &[(6, chunk(22, size))]);
        says(
            &read_bag(&path, |_| true).unwrap_err(),
            &["a chunk is longer than its record"],
        );
    }
}

// ---- files that are none

#[cfg(unix)]
#[test]
fn pipes_folders_and_devices_are_refused() {
    let folder = cell();
    let at = folder.path();
    for name in ["p.toml", "p.mcap", "p.urdf", "p.csv"] {
        let made = std::process::Command::new("mkfifo")
            .arg(at.join(name))
            .status();
        assert!(made.unwrap().success());
        fs::create_dir(at.join(name.replacen('p', "d", 1))).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at.join(name.replacen('p', "z", 1))).unwrap();
    }
    for (letter, found) in [("p", "a pipe"), ("d", "a folder"), ("z", "a device")] {
        let toml = format!("{letter}.toml");
        let parts = [
            &*toml,
            "cannot be read",
            &*format!("found {found}"),
            "accepted: a regular file",
        ];
        let program = |words: &[&str]| {
            let output = misfit(at)
                .args(words)
                .timeout(Duration::from_secs(60))
                .output()
                .unwrap();
            let message = String::from_utf8(output.stderr).unwrap();
            assert_eq!(output.status.code(), Some(1), "{words:?}: {message}");
            parts
                .iter()
                .for_each(|part| assert!(message.contains(part), "{words:?}: {message}"));
        };
        program(&["fit", &toml]);
        program(&["run", &toml]);
        program(&["fit", "c.toml", "--model", &toml]);
        program(&["plan", "c.toml", "--poses", "5", "--limits", &toml]);
        program(&["import", "x.mcap", "--spec", &toml]);
        let found = format!("found {found}");
        for (from, to) in [("arm.urdf", "urdf"), ("t.csv", "csv")] {
            let name = format!("{letter}.{to}");
            fs::write(at.join("other.toml"), CAMPAIGN.replace(from, &name)).unwrap();
            says(
                &Campaign::load(&at.join("other.toml")).unwrap_err(),
                &[&name, &found],
            );
        }
        let recording = at.join(format!("{letter}.mcap"));
        says(&Campaign::load(&recording).unwrap_err(), &[&found]);
        if letter != "d" {
            // a folder of .mcap files is a bag
            says(&read_bag(&recording, |_| true).unwrap_err(), &[&found]);
        }
    }
}

#[test]
fn a_limit_is_an_error_of_its_own_kind() {
    let folder = cell();
    let path = folder.path().join("c.toml");
    sparse(&path, LARGEST_TOML + 1);
    let error = Campaign::load(&path).unwrap_err();
    let source = InputError::TooLarge {
        limit: "4 MB".into(),
    };
    assert!(
        matches!(&error, LoadError::Campaign(CampaignError::Read { source: InputError::TooLarge { limit }, .. }) if limit == "4 MB")
    );
    says(&source, &["4 MB"]);
    let error = Robot::load(&folder.path().join("gone.urdf"), None).unwrap_err();
    assert!(matches!(
        error,
        RobotError::Unreadable {
            source: InputError::System(_),
            ..
        }
    ));
    let error = read_bag(&folder.path().join("gone.mcap"), |_| true).unwrap_err();
    assert!(matches!(
        error,
        RecordingError::Read {
            source: InputError::System(_),
            ..
        }
    ));
}

// ---- paths

/// The arm with a mesh at its base.
fn with_mesh(address: &str) -> String {
    let mesh = format!(
        "<link name=\"base\"><visual><geometry><mesh filename=\"{address}\"/></geometry></visual></link>"
    );
    TWO_ARMS.replace("<link name=\"base\"/>", &mesh)
}

#[test]
fn a_users_own_paths_lead_where_they_say() {
    let folder = cell();
    let elsewhere = TempDir::new().unwrap();
    let whole = Campaign::load(&folder.path().join("c.toml")).unwrap();
    let absolute = CAMPAIGN
        .replace("arm.urdf", folder.path().join("arm.urdf").to_str().unwrap())
        .replace("t.csv", folder.path().join("t.csv").to_str().unwrap());
    fs::write(elsewhere.path().join("c.toml"), absolute).unwrap();
    assert_same(
        &whole,
        &Campaign::load(&elsewhere.path().join("c.toml")).unwrap(),
    );
    fs::create_dir(folder.path().join("below")).unwrap();
    let upwards = CAMPAIGN
        .replace("arm.urdf", "../arm.urdf")
        .replace("t.csv", "../t.csv");
    fs::write(folder.path().join("below/c.toml"), upwards).unwrap();
    assert_same(
        &whole,
        &Campaign::load(&folder.path().join("below/c.toml")).unwrap(),
    );
}

#[test]
fn what_a_recording_names_is_not_looked_for() {
    let folder = cell();
    let path = folder.path().join("x.mcap");
    for address in [
        "gone.stl",
        "file:///gone/gone.stl",
        "package://below/gone.stl",
        "../../gone.stl",
    ] {
        // where the robot is a file of the user's own, a missing mesh is said
        fs::create_dir_all(folder.path().join("below")).unwrap();
        fs::write(folder.path().join("arm.urdf"), TWO_ARMS).unwrap();
        let mut campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
        fs::write(folder.path().join("arm.urdf"), with_mesh(address)).unwrap();
        says(
            &Campaign::load(&folder.path().join("c.toml")).unwrap_err(),
            &["gone.stl", "not found"],
        );
        // in a recording, whose sender had it, nothing is asked of this disk
        campaign.robot_file.text = with_mesh(address);
        recording::write_campaign(&campaign, &path, &Beside::default()).unwrap();
        assert_same(&campaign, &Campaign::load(&path).unwrap());
    }
}

#[test]
fn a_recording_names_no_file_outside_of_it() {
    let folder = cell();
    let path = folder.path().join("x.mcap");
    let campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
    recording::write_campaign(&campaign, &path, &Beside::default()).unwrap();
    let bytes = fs::read(&path).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    for name in [
        "../arm.urdf",
        "/tmp/arm.urdf",
        "a/../../arm.urdf",
        "..",
        "a\\arm.urdf",
    ] {
        let mut writer = mcap::Writer::new(File::create(&path).unwrap()).unwrap();
        for index in &summary.metadata_indexes {
            writer
                .write_metadata(&mcap::read::metadata(&bytes, index).unwrap())
                .unwrap();
        }
        for index in &summary.attachment_indexes {
            let mut attachment = mcap::read::attachment(&bytes, index).unwrap();
            if attachment.name == "arm.urdf" {
                attachment.name = name.into();
            } else {
                let text = String::from_utf8(attachment.data.to_vec()).unwrap();
                let own = format!("{:?}", name);
                attachment.data = text.replace("\"arm.urdf\"", &own).into_bytes().into();
            }
            writer.attach(&attachment).unwrap();
        }
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            writer.write(&message.unwrap()).unwrap();
        }
        writer.finish().unwrap();
        says(
            &Campaign::load(&path).unwrap_err(),
            &["x.mcap", "is not a plain file name"],
        );
    }
}

#[test]
fn meshes_on_the_network_are_not_fetched() {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    server.set_nonblocking(true).unwrap();
    let port = server.local_addr().unwrap().port();
    let folder = cell();
    let address = format!("http://127.0.0.1:{port}/base.stl");
    fs::write(folder.path().join("arm.urdf"), with_mesh(&address)).unwrap();
    let campaign = Campaign::load(&folder.path().join("c.toml")).unwrap();
    let path = folder.path().join("x.mcap");
    recording::write_campaign(&campaign, &path, &Beside::default()).unwrap();
    assert_same(&campaign, &Campaign::load(&path).unwrap());
    let page = folder.path().join("page.html");
    let words = ["fit", "c.toml", "--effects", "joint_offset", "--report"];
    misfit(folder.path())
        .args(words)
        .arg(&page)
        .output()
        .unwrap();
    assert!(
        !fs::read_to_string(&page).unwrap().contains(&address),
        "the page asks for the mesh"
    );
    let asked = server.accept().map(|(_, who)| who);
    assert_eq!(asked.unwrap_err().kind(), std::io::ErrorKind::WouldBlock);
}

// ---- whole commands on mutated files

/// A change of a text, as an editor's slip or somebody's malice makes it.
#[derive(Debug, Clone)]
enum Change {
    Cut(usize, usize),
    Copy(usize, usize, usize),
    Put(usize, String),
    Number(usize, String),
}

fn change() -> impl Strategy<Value = Change> {
    let place = any::<prop::sample::Index>().prop_map(|index| index.index(100_000));
    let words = prop::sample::select(vec![
        "",
        "-",
        "nan",
        "inf",
        "-1",
        "0",
        "1e308",
        "-1e308",
        "1e-320",
        "1e999",
        "9223372036854775807",
        "1000001",
        "\"",
        "'",
        "[",
        "]",
        "{",
        "}",
        "\n",
        ",",
        "=",
        "<",
        ">",
        "\u{0}",
        "\u{1b}[2J",
        "é",
        "../",
        "/dev/zero",
        "[[target]]\n",
        "hold = true\n",
    ]);
    let words = words.prop_map(str::to_owned);
    prop_oneof![
        (place.clone(), 0usize..40).prop_map(|(at, n)| Change::Cut(at, n)),
        (place.clone(), 0usize..60, place.clone()).prop_map(|(at, n, to)| Change::Copy(at, n, to)),
        (place.clone(), words.clone()).prop_map(|(at, word)| Change::Put(at, word)),
        (place, words).prop_map(|(at, word)| Change::Number(at, word)),
    ]
}

fn mutated(text: &str, changes: &[Change]) -> String {
    let mut letters: Vec<char> = text.chars().collect();
    for change in changes {
        let size = letters.len().max(1);
        let end = |at: usize, n: usize| (at + n).min(letters.len());
        match change {
            Change::Cut(at, n) => {
                let at = (at % size).min(letters.len());
                letters.drain(at..end(at, *n));
            }
            Change::Copy(at, n, to) => {
                let at = (at % size).min(letters.len());
                let piece: Vec<char> = letters[at..end(at, *n)].to_vec();
                let to = (to % size).min(letters.len());
                letters.splice(to..to, piece);
            }
            Change::Put(at, word) => {
                let at = (at % size).min(letters.len());
                letters.splice(at..at, word.chars());
            }
            Change::Number(at, word) => {
                // the number that stands next
                let digit = |c: &char| c.is_ascii_digit() || matches!(c, '.' | '-' | 'e');
                let at = (at % size).min(letters.len());
                if let Some(from) = letters[at..].iter().position(|c| c.is_ascii_digit()) {
                    let from = at + from;
                    let length = letters[from..].iter().take_while(|c| digit(c)).count();
                    letters.splice(from..from + length, word.chars());
                }
            }
        }
    }
    letters.into_iter().collect()
}

fn changes() -> impl Strategy<Value = Vec<Change>> {
    prop::collection::vec(change(), 0..4)
}

fn put(folder: &Path, name: &str, text: &str) -> PathBuf {
    let path = folder.join(name);
    fs::write(&path, text).unwrap();
    path
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn mutated_campaigns_and_models_are_fitted_or_refused(
        document in changes(), table in changes(), robot in changes(), model in changes()
    ) {
        let folder = cell();
        let at = folder.path();
        let path = put(at, "c.toml", &mutated(CAMPAIGN, &document));
        put(at, "t.csv", &mutated(TABLE, &table));
        put(at, "arm.urdf", &mutated(TWO_ARMS, &robot));
        let model = put(at, "m.toml", &mutated(MODEL, &model));
        let whole = Options { cross_validate: true };
        match Campaign::load(&path) {
            Err(error) => says(&error, &[]),
            Ok(campaign) => match model_file::model(&campaign, &EffectList::DEFAULT, Some(&model)) {
                Err(error) => says(&error, &[]),
                Ok(model) => match fit::fit(&campaign, &model, &whole, |_| {}) {
                    Err(error) => says(&error, &[]),
                    Ok(fit) => prop_assert_eq!(fit.values.len(), model.parameters().count()),
                },
            },
        }
    }

    #[test]
    fn mutated_scenarios_are_read_or_refused(scenario in changes(), robot in changes()) {
        let folder = cell();
        let at = folder.path();
        let path = put(at, "s.toml", &mutated(SCENARIO, &scenario));
        put(at, "arm.urdf", &mutated(TWO_ARMS, &robot));
        match Scenario::load(&path) {
            Err(error) => says(&error, &[]),
            Ok(scenario) => if let Err(error) = scenario.redrawn(5) {
                says(&error, &[]);
            },
        }
    }

    #[test]
    fn mutated_dh_tables_are_read_or_refused(changes in changes()) {
        if let Err(error) = Robot::parse("x.toml", &mutated(DH_TABLE, &changes), None) {
            says(&error, &["x.toml"]);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn commands_on_mutated_files_end_with_0_1_or_3(document in changes(), table in changes(), robot in changes()) {
        let folder = cell();
        let at = folder.path();
        put(at, "c.toml", &mutated(CAMPAIGN, &document));
        put(at, "t.csv", &mutated(TABLE, &table));
        put(at, "arm.urdf", &mutated(TWO_ARMS, &robot));
        let output = misfit(at).args(["fit", "c.toml", "--effects", "joint_offset"]).output().unwrap();
        let message = String::from_utf8(output.stderr).unwrap();
        prop_assert!(!message.contains("panicked"), "{}", message);
        match output.status.code() {
            Some(0 | 3) => prop_assert!(!output.stdout.is_empty()),
            Some(1) => {
                prop_assert!(output.stdout.is_empty(), "{}", message);
                prop_assert!(message.starts_with("misfit: "), "{}", message);
                prop_assert_eq!(message.matches("misfit: ").count(), 1, "{}", message);
            }
            other => prop_assert!(false, "{:?}: {}", other, message),
        }
    }
}
