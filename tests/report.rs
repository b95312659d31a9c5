//! The HTML report: made by every command that has one, well-formed, the same every time, saying what the JSON says.
//! How it looks in a browser is seen to by `make pages`.

use assert_cmd::Command;
use misfit_report::format::{angle, length, number, significant};
use roxmltree::{Document, Node, ParsingOptions};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;
use tempfile::TempDir;

const SECTIONS: [&str; 9] = [
    "verdict",
    "falling",
    "carrier",
    "places",
    "parameters",
    "correlations",
    "blind",
    "next",
    "origin",
];

fn misfit(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_misfit"));
    command.current_dir(folder);
    command
}

/// A run that succeeds: its stdout.
#[track_caller]
fn done(folder: &Path, words: &[&str]) -> String {
    let output = misfit(folder).args(words).output().unwrap();
    let err = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{words:?}: {err}");
    String::from_utf8(output.stdout).unwrap()
}

/// scenarios/hidden.toml with another hidden effect than its own.
fn scenario(truth: &str) -> String {
    let text = fs::read_to_string("scenarios/hidden.toml").unwrap();
    let from = text
        .find("[[truth]]\nkind   = \"transmission_error\"")
        .unwrap();
    let to = text.find("[design]").unwrap();
    let robot = concat!(env!("CARGO_MANIFEST_DIR"), "/models/sda5f/sda5f.urdf");
    let expect = text.find("[expect]").unwrap();
    format!("{}{truth}\n{}", &text[..from], &text[to..expect])
        .replace("../models/sda5f/sda5f.urdf", robot)
}

const TRUTHS: [(&str, &str); 4] = [
    (
        "named",
        "[[truth]]\nkind = \"transmission_error\"\nvalues = { \"r1_e.sin2\" = 1.5e-4, \"r1_e.cos2\" = -1.0e-4 }",
    ),
    ("nothing", ""),
    (
        "alias",
        "[[truth]]\nkind = \"ft_misalignment\"\nvalues = { rx = 0.02 }",
    ),
    (
        "unknown",
        "[[truth]]\nkind = \"expression\"\nname = \"odd\"\nacts_on = \"q[r1_e]\"\n\
         law = \"a*sin(2*q[r1_l] + q[r1_u])\"\n\
         parameters = { a = { unit = \"rad\", typical = 1e-4 } }\nvalues = { a = 3e-4 }",
    ),
];

/// A folder with a recording for each of [`TRUTHS`], and the first as a scenario and as CSV.
static LAB: LazyLock<TempDir> = LazyLock::new(|| {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    for (name, truth) in TRUTHS {
        fs::write(at.join(format!("{name}.toml")), scenario(truth)).unwrap();
        let (scenario, recording) = (format!("{name}.toml"), format!("{name}.mcap"));
        done(at, &["simulate", &scenario, "-o", &recording]);
    }
    done(at, &["simulate", "named.toml", "--csv", "named"]);
    folder
});

fn page(name: &str) -> String {
    fs::read_to_string(LAB.path().join(name)).unwrap()
}

#[track_caller]
fn parsed(text: &str) -> Document<'_> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options).unwrap()
}

/// All text in a node.
fn text(node: Node<'_, '_>) -> String {
    let texts = node.descendants().filter(Node::is_text);
    texts.filter_map(|node| node.text()).collect()
}

#[track_caller]
fn section<'a>(page: &'a Document<'_>, id: &str) -> Node<'a, 'a> {
    let mut found = page
        .descendants()
        .filter(|node| node.attribute("id") == Some(id));
    let node = found.next().unwrap_or_else(|| panic!("no {id}"));
    assert!(found.next().is_none(), "{id} stands twice");
    node
}

/// Rows of the tables in a section, cells as text.
fn rows(node: Node<'_, '_>) -> Vec<Vec<String>> {
    let rows = node.descendants().filter(|node| node.has_tag_name("tr"));
    let cells = |row: Node<'_, '_>| {
        let cells = row.children().filter(Node::is_element);
        cells.map(text).collect()
    };
    rows.map(cells).collect()
}

/// What holds of every page.
#[track_caller]
fn sound(page: &Document<'_>, name: &str) {
    for id in SECTIONS {
        let own = text(section(page, id));
        assert!(own.trim().len() > 40, "{name}: {id} is empty: {own}");
    }
    let all = || page.descendants().filter(Node::is_element);
    let ids: Vec<&str> = all().filter_map(|node| node.attribute("id")).collect();
    assert_eq!(
        ids.len(),
        ids.iter().collect::<BTreeSet<_>>().len(),
        "{name}: {ids:?}"
    );
    for node in all() {
        let tag = node.tag_name().name();
        assert!(
            !["script", "link", "img", "iframe", "object", "image", "use"].contains(&tag),
            "{name}: <{tag}>"
        );
        for attribute in node.attributes() {
            let (key, value) = (attribute.name(), attribute.value());
            assert!(!key.starts_with("on"), "{name}: {key}={value}");
            if key == "href" || key == "src" {
                let to = value
                    .strip_prefix('#')
                    .unwrap_or_else(|| panic!("{name}: {value}"));
                assert!(ids.contains(&to), "{name}: {value} leads nowhere");
            }
        }
    }
    let styles: String = all()
        .filter(|n| n.has_tag_name("style"))
        .map(text)
        .collect();
    assert!(
        !styles.contains("url(") && !styles.contains("@import"),
        "{name}"
    );
    let svgs: Vec<_> = all().filter(|n| n.tag_name().name() == "svg").collect();
    assert!(!svgs.is_empty(), "{name}: no picture");
    for svg in svgs {
        let marks = ["circle", "polyline", "path", "line", "rect"];
        let drawn = svg.descendants();
        let drawn = drawn.filter(|node| marks.contains(&node.tag_name().name()));
        assert!(drawn.count() > 8, "{name}: an empty picture");
        // and is said in words
        let holder = svg.parent().unwrap();
        assert!(holder.attribute("aria-label").unwrap().len() > 40, "{name}");
    }
}

#[track_caller]
fn headline(page: &Document<'_>) -> String {
    let verdict = section(page, "verdict");
    let mut all = verdict.descendants();
    text(
        all.find(|n| n.attribute("class") == Some("headline"))
            .unwrap(),
    )
}

#[test]
fn every_command_that_has_a_result_makes_a_page() {
    let at = LAB.path();
    for (words, name) in [
        (
            vec![
                "report",
                "named.mcap",
                "--no-cross-validation",
                "-o",
                "report.html",
            ],
            "report.html",
        ),
        (
            vec![
                "ladder",
                "named.mcap",
                "--stop-at",
                "geometry",
                "--no-cross-validation",
                "--report",
                "stopped.html",
            ],
            "stopped.html",
        ),
        (
            vec![
                "fit",
                "named.mcap",
                "--effects",
                "+backlash",
                "--no-cross-validation",
                "--report",
                "fit.html",
            ],
            "fit.html",
        ),
        (
            vec!["run", "named.toml", "--report", "run.html"],
            "run.html",
        ),
    ] {
        let said = done(at, &words);
        assert!(words[0] == "run" || said.contains(name), "{said}");
        let text_of = page(name);
        let page = parsed(&text_of);
        sound(&page, name);
        // the command that makes it again, but for where it goes
        let origin = rows_of_list(section(&page, "origin"));
        let command = &origin.iter().find(|row| row.0 == "command").unwrap().1;
        let plain: Vec<&str> = words
            .iter()
            .copied()
            .take_while(|word| !["-o", "--report"].contains(word))
            .collect();
        assert_eq!(*command, format!("misfit {}", plain.join(" ")));
    }
    assert!(headline(&parsed(&page("stopped.html"))).contains("told to stop"));
}

/// Names and values of a list.
fn rows_of_list(node: Node<'_, '_>) -> Vec<(String, String)> {
    let of = |tag: &'static str| {
        let all = node.descendants().filter(move |n| n.has_tag_name(tag));
        all.map(text)
    };
    of("dt").zip(of("dd")).collect()
}

#[test]
fn each_verdict_has_its_page() {
    let at = LAB.path();
    for (verdict, says, next) in [
        (
            "named",
            "transmission_error is missing",
            "--effects +transmission_error",
        ),
        ("nothing", "Nothing detectable is missing", "misfit ladder"),
        ("alias", "this campaign cannot tell which", "misfit plan"),
        (
            "unknown",
            "the catalogue does not hold",
            "--candidates laws.toml",
        ),
    ] {
        let (file, name) = (format!("{verdict}.mcap"), format!("{verdict}.html"));
        let words = [
            "diagnose",
            &file,
            "--no-cross-validation",
            "--json",
            "--report",
            &name,
        ];
        let json: Value = serde_json::from_str(&done(at, &words)).unwrap();
        assert_eq!(json["verdict"], verdict);
        let text_of = page(&name);
        let page = parsed(&text_of);
        sound(&page, &name);
        assert!(headline(&page).contains(says), "{}", headline(&page));
        let steps = text(section(&page, "next"));
        assert!(steps.contains(next), "{steps}");
        // as many proposed poses as the JSON has
        let poses = rows(section(&page, "next")).len().saturating_sub(1);
        assert_eq!(poses, json["next_poses"].as_array().unwrap().len());
        let blind = text(section(&page, "blind"));
        for row in json["cannot_see"].as_array().unwrap() {
            assert!(blind.contains(row["effect"].as_str().unwrap()), "{row}");
        }
    }
}

#[test]
fn its_numbers_are_those_of_the_json() {
    let at = LAB.path();
    let words = [
        "ladder",
        "named.mcap",
        "--no-cross-validation",
        "--json",
        "--report",
        "ladder.html",
    ];
    let json: Value = serde_json::from_str(&done(at, &words)).unwrap();
    let text_of = page("ladder.html");
    let page_of_ladder = parsed(&text_of);
    let table = rows(section(&page_of_ladder, "falling"));
    let rungs = json["rungs"].as_array().unwrap();
    for (row, rung) in table[1..].iter().zip(rungs) {
        let of = |key: &str| rung["fit"][key].as_f64().unwrap();
        let added = rung["added"].as_str().unwrap();
        assert!(row[0].contains(added) || added == "nominal", "{row:?}");
        assert_eq!(row[1], length(of("position_rms_m")));
        assert_eq!(row[3], length(of("position_max_m")));
        assert_eq!(row[4], angle(of("orientation_rms_rad")));
    }
    let without = json["left_out"].as_array().unwrap();
    for (row, left) in table[rungs.len() + 2..].iter().zip(without) {
        assert_eq!(
            row[1],
            length(left["fit"]["position_rms_m"].as_f64().unwrap())
        );
        let lost = number(left["evidence_lost"].as_f64().unwrap());
        assert_eq!(row[3], format!("{lost} nats"));
    }

    let words = [
        "fit",
        "named.mcap",
        "--no-cross-validation",
        "--json",
        "--report",
        "numbers.html",
    ];
    let json: Value = serde_json::from_str(&done(at, &words)).unwrap();
    let text_of = page("numbers.html");
    let page = parsed(&text_of);
    let table = rows(section(&page, "parameters"));
    let table: Vec<_> = table.iter().filter(|row| row[0] != "parameter").collect();
    let parameters = json["parameters"].as_array().unwrap();
    assert_eq!(table.len(), parameters.len(), "each stands once");
    for (row, parameter) in table.iter().zip(parameters) {
        assert_eq!(row[0], parameter["name"].as_str().unwrap());
        assert_eq!(row[3], parameter["unit"].as_str().unwrap());
        let status = parameter["status"].as_str().unwrap();
        assert_eq!(row.last().unwrap(), status);
        if status == "estimated" {
            assert_eq!(row[1], significant(parameter["value"].as_f64().unwrap(), 5));
            // an interval of 95 % is about two standard deviations
            let half: f64 = row[2].parse().unwrap();
            let std = parameter["std"].as_f64().unwrap();
            assert!((1.9..2.2).contains(&(half / std)), "{row:?}");
        }
    }
    let sigma = json["noise"]["position_sigma_m"].as_f64().unwrap();
    assert!(text(section(&page, "origin")).contains(&length(sigma)));
}

#[test]
fn the_same_page_every_time_and_for_any_number_of_threads() {
    let at = LAB.path();
    let pages: Vec<Vec<u8>> = ["1", "2", "2"]
        .iter()
        .enumerate()
        .map(|(k, threads)| {
            let name = format!("threads{k}.html");
            let words = ["report", "named.mcap", "--no-cross-validation", "-o", &name];
            let run = misfit(at)
                .env("RAYON_NUM_THREADS", threads)
                .args(words)
                .output()
                .unwrap();
            assert!(run.status.success());
            fs::read(at.join(name)).unwrap()
        })
        .collect();
    assert!(pages[0] == pages[1] && pages[1] == pages[2]);
}

#[test]
fn hostile_names_are_only_names() {
    let at = LAB.path();
    let joint = "<script>alert('1')</script>\"&amp;";
    let target = format!("</h1><b onclick='x()'>&{}", "W".repeat(150));
    let folder = at.join("hostile");
    fs::create_dir(&folder).unwrap();
    let read = |name: &str| fs::read_to_string(at.join("named").join(name)).unwrap();
    let escaped = joint
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;");
    let robot = read("sda5f.urdf")
        .replace("name=\"r1_e\"", &format!("name=\"{escaped}\""))
        .replace(
            "<robot name=\"sda5f\"",
            "<robot name=\"&lt;style>*{display:none}\"",
        );
    fs::write(folder.join("sda5f.urdf"), robot).unwrap();
    let in_csv =
        |before: &str, after: &str| format!("\"{before}{}{after}\"", joint.replace('"', "\"\""));
    let table = read("readings.csv")
        .replacen("approach_r1_e", &in_csv("approach_", ""), 1)
        .replacen("r1_e_rad", &in_csv("", "_rad"), 1);
    fs::write(folder.join("readings.csv"), table).unwrap();
    let campaign = read("campaign.toml").replace("\"r1\"", &format!("{target:?}"));
    fs::write(folder.join("<i>&'.toml"), campaign).unwrap();
    let words = [
        "fit",
        "hostile/<i>&'.toml",
        "--no-cross-validation",
        "--effects",
        "+transmission_error",
        "--report",
        "hostile.html",
    ];
    done(at, &words);
    let text_of = page("hostile.html");
    let page = parsed(&text_of);
    sound(&page, "hostile");
    // they are there, as text: in tables and in pictures
    assert!(text(section(&page, "parameters")).contains(joint));
    assert!(text(section(&page, "parameters")).contains(&target));
    assert!(text(section(&page, "origin")).contains("hostile/<i>&'.toml"));
    let svg = page.descendants().filter(|n| n.tag_name().name() == "svg");
    assert!(svg.map(text).any(|words| words.contains(joint)));
}

#[test]
fn a_page_that_cannot_be_written_is_said_and_the_old_one_stays() {
    let at = LAB.path();
    let fails = |run: std::process::Output, name: &str| {
        let err = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(1), "{err}");
        assert!(run.stdout.is_empty());
        assert!(err.contains(&format!("{name}: cannot be written")), "{err}");
    };
    let fit = ["fit", "named.mcap", "--no-cross-validation", "--report"];
    let run = misfit(at).args(fit).arg("gone/x.html").output().unwrap();
    fails(run, "gone/x.html");
    // no room for more than 16 kB a file: whole, or not at all
    let own = at.join("full");
    fs::create_dir(&own).unwrap();
    fs::write(own.join("old.html"), "what stood here").unwrap();
    let line = format!(
        "trap '' XFSZ; ulimit -f 32; exec '{}' fit ../named.mcap --no-cross-validation --report old.html",
        env!("CARGO_BIN_EXE_misfit")
    );
    let run = Command::new("sh")
        .current_dir(&own)
        .args(["-c", &line])
        .output()
        .unwrap();
    fails(run, "old.html");
    assert_eq!(
        fs::read_to_string(own.join("old.html")).unwrap(),
        "what stood here"
    );
    assert_eq!(
        fs::read_dir(&own).unwrap().count(),
        1,
        "nothing is left lying about"
    );
}
