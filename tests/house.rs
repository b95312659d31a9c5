//! The invariants of ARCHITECTURE.md that can be read off the sources.

use misfit_core::effects::CATALOGUE;
use std::fs;
use std::path::{Path, PathBuf};

/// All Rust files under `src`, with their text.
fn sources() -> Vec<(PathBuf, String)> {
    fn walk(folder: &Path, found: &mut Vec<(PathBuf, String)>) {
        let mut entries: Vec<PathBuf> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        entries.sort();
        for path in entries {
            if path.is_dir() {
                walk(&path, found);
            } else if path.extension().is_some_and(|ending| ending == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                found.push((path, text));
            }
        }
    }
    let mut found = Vec::new();
    walk(Path::new("src"), &mut found);
    assert!(found.len() > 40, "the sources are not where they were");
    found
}

/// Lines that are code, not comment.
fn code(text: &str) -> impl Iterator<Item = &str> {
    text.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
}

fn speaks_alone(word: &str, home: &str) {
    let mut speakers = 0;
    for (path, text) in sources() {
        let at_home = path.to_string_lossy().starts_with(home);
        for line in code(&text).filter(|line| line.contains(word)) {
            assert!(
                at_home,
                "{}: {line}: {word} belongs to {home}",
                path.display()
            );
            speakers += 1;
        }
    }
    assert!(speakers > 0, "nobody says {word}: is the test still right?");
}

#[test]
fn only_one_module_speaks_mcap() {
    speaks_alone("mcap::", "src/recording");
}

#[test]
fn nothing_here_speaks_to_the_viewer() {
    // what does is a program of its own, replay/, so that all else builds without its four hundred crates
    let words = ["rerun::", "re_sdk", "re_types", "re_log"];
    for (path, text) in sources() {
        for word in words {
            let found = code(&text).find(|line| line.contains(word));
            assert_eq!(
                found,
                None,
                "{}: only replay/ speaks to Rerun",
                path.display()
            );
        }
    }
    let manifest = fs::read_to_string("Cargo.toml").unwrap();
    let own = manifest.split("[dependencies]").nth(1).unwrap();
    let own = own.split("[profile").next().unwrap();
    assert!(!own.contains("rerun"), "the root package depends on Rerun");
    let replay = fs::read_to_string("replay/Cargo.toml").unwrap();
    assert!(replay.contains("rerun = { version = \"=0.36.3\""));
    assert!(
        !replay.contains("importers"),
        "see docs/decisions/0012-replay.md"
    );
}

#[test]
fn unsafe_code_lives_in_the_binding_alone() {
    speaks_alone("unsafe {", "src/mujoco");
}

#[test]
fn only_the_plant_uses_the_binding() {
    for (path, text) in sources() {
        let name = path.to_string_lossy().into_owned();
        let home = name.starts_with("src/mujoco") || name.starts_with("src/plant");
        let used = code(&text).any(|line| line.contains("crate::mujoco"));
        assert!(home || !used, "{name} speaks to MuJoCo past the plant");
    }
}

#[test]
fn plant_and_model_share_no_code() {
    let models = [
        "crate::dual_quaternion",
        "crate::statics",
        "crate::model",
        "crate::posture",
        "crate::fit",
    ];
    for (path, text) in sources() {
        if path.starts_with("src/plant") {
            for word in models {
                let found = code(&text).find(|line| line.contains(word));
                assert_eq!(found, None, "{}: the plant uses the model", path.display());
            }
        }
        let model = ["src/statics.rs", "src/model", "src/posture.rs", "src/fit"];
        if model.iter().any(|place| path.starts_with(place)) {
            let found = code(&text).find(|line| line.contains("crate::plant"));
            assert_eq!(found, None, "{}: the model uses the plant", path.display());
        }
    }
}

#[test]
fn a_fit_never_sees_a_truth() {
    // campaigns, models and fits know nothing of scenarios, where truths are
    for (path, text) in sources() {
        let name = path.to_string_lossy().into_owned();
        let blind = [
            "src/bag",
            "src/campaign",
            "src/fit",
            "src/model",
            "src/effects",
            "src/recording",
            "src/plan/",
        ];
        if blind.iter().any(|part| name.starts_with(part)) {
            let found = code(&text).find(|line| line.contains("crate::scenario"));
            assert_eq!(found, None, "{name} could see a truth");
        }
    }
}

#[test]
fn an_effect_is_one_file_and_two_lines() {
    let list = fs::read_to_string("src/effects/mod.rs").unwrap();
    let shared = ["mod", "need", "options", "table"];
    let mut files: Vec<String> = fs::read_dir("src/effects")
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter_map(|path| Some(path.file_stem()?.to_string_lossy().into_owned()))
        .filter(|stem| !shared.contains(&stem.as_str()))
        .collect();
    files.sort();
    let mut ids: Vec<&str> = CATALOGUE.iter().map(|entry| entry.id).collect();
    ids.sort_unstable();
    assert_eq!(
        files, ids,
        "every file is an effect, every effect a file of its name"
    );
    for id in ids {
        let lines = list.lines().filter(|line| {
            line.trim() == format!("mod {id};") || line.contains(&format!("\"{id}.rs\""))
        });
        assert_eq!(
            lines.count(),
            2,
            "{id} takes two lines of src/effects/mod.rs"
        );
        // and no file outside its own knows what it does
        for (path, text) in sources() {
            let own = path.starts_with("src/effects");
            let word = format!("effects::{id}::");
            let found = code(&text).find(|line| line.contains(&word));
            assert!(own || found.is_none(), "{} knows {id}", path.display());
        }
    }
}

#[test]
fn no_clock_and_no_hash_order() {
    let forbidden = [
        "SystemTime",
        "Instant::now",
        "HashMap",
        "HashSet",
        "thread_rng",
    ];
    for (path, text) in sources() {
        for word in forbidden {
            let found = code(&text).find(|line| line.contains(word));
            assert_eq!(found, None, "{}: results would not repeat", path.display());
        }
    }
}

#[test]
fn documents_have_no_gaps() {
    let own = ["README.md", "ARCHITECTURE.md", "CHANGELOG.md"].map(PathBuf::from);
    let pages = fs::read_dir("docs").unwrap();
    let mut files: Vec<PathBuf> = pages.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    for file in own.into_iter().chain(files) {
        let text = fs::read_to_string(&file).unwrap();
        for line in text.lines() {
            let gap = line.len() > 3 && line.chars().all(|c| c.is_ascii_uppercase());
            assert!(!gap, "{}: \"{line}\" was to be filled in", file.display());
        }
    }
}

#[test]
fn inputs_are_opened_in_one_place() {
    // with its limits; what a sweep wrote itself is read where it is written
    let words = [
        "File::open",
        "read_to_string(",
        "fs::read(",
        "toml::from_str",
    ];
    for (path, text) in sources() {
        let home = ["src/input.rs", "src/sweep/store.rs"]
            .iter()
            .any(|home| path == Path::new(home));
        // messages about DH tables name the row: from the parser's own errors, behind the check of depth
        let rows = path == Path::new("src/robot/dh.rs");
        for word in words
            .iter()
            .filter(|word| !(rows && **word == "toml::from_str"))
        {
            let own = text.split("#[cfg(test)]").next().unwrap();
            let found = code(own).find(|line| line.contains(word));
            assert!(
                home || found.is_none(),
                "{}: {found:?} belongs to src/input.rs",
                path.display()
            );
        }
    }
}

#[test]
fn nothing_here_speaks_to_a_network() {
    let words = [
        "std::net",
        "TcpStream",
        "TcpListener",
        "UdpSocket",
        "UnixStream",
        "ToSocketAddrs",
        "reqwest",
        "ureq",
        "hyper",
        "curl",
        "tokio",
        "socket2",
    ];
    for (path, text) in sources() {
        for word in words {
            let found = code(&text).find(|line| line.contains(word));
            assert_eq!(found, None, "{}: speaks to a network", path.display());
        }
    }
    let manifest = fs::read_to_string("Cargo.toml").unwrap();
    let own = manifest.split("[dependencies]").nth(1).unwrap();
    let own = own.split("[build-dependencies]").next().unwrap();
    for word in words {
        assert!(!own.contains(word), "the package depends on {word}");
    }
}

#[test]
fn every_row_of_the_faults_names_tests_that_exist() {
    let text = fs::read_to_string("docs/faults.md").unwrap();
    let tables = text
        .split("\n## ")
        .filter(|part| part.starts_with("Inputs") || part.starts_with("Faults"));
    let rows: Vec<&str> = tables
        .flat_map(|table| table.lines().filter(|line| line.starts_with('|')).skip(2))
        .collect();
    assert!(rows.len() > 40, "{} rows", rows.len());
    for row in rows {
        let cell = row
            .trim_end_matches([' ', '|'])
            .rsplit(" | ")
            .next()
            .unwrap();
        let names: Vec<&str> = cell.split('`').skip(1).step_by(2).collect();
        assert!(!names.is_empty(), "no test: {row}");
        for name in names {
            let (module, test) = name.rsplit_once("::").expect("module::test");
            let module = module.split("::").next().unwrap();
            let places = [
                format!("tests/{module}.rs"),
                format!("{module}/tests/{module}.rs"),
            ];
            let source = places
                .iter()
                .find_map(|place| fs::read_to_string(place).ok());
            let source = source.unwrap_or_else(|| panic!("{name}: no such file of tests"));
            let lines: Vec<&str> = source.lines().map(str::trim).collect();
            let at = lines
                .iter()
                .position(|line| line.starts_with(&format!("fn {test}(")));
            let at = at.unwrap_or_else(|| panic!("{name}: no such test"));
            let above = lines[..at]
                .iter()
                .rev()
                .take_while(|line| line.starts_with("#["));
            assert!(
                above.clone().any(|line| *line == "#[test]"),
                "{name} is no test"
            );
            assert!(
                !above.clone().any(|line| line.contains("ignore")),
                "{name} is not run"
            );
        }
    }
}

#[test]
fn every_parser_has_a_fuzz_target() {
    let manifest = fs::read_to_string("fuzz/Cargo.toml").unwrap();
    let script = fs::read_to_string(".ci/fuzz").unwrap();
    let mut targets: Vec<String> = fs::read_dir("fuzz/targets")
        .unwrap()
        .map(|entry| {
            entry
                .unwrap()
                .path()
                .file_stem()
                .unwrap()
                .to_string_lossy()
                .into_owned()
        })
        .collect();
    targets.sort();
    let known = [
        "bag",
        "campaign_csv",
        "campaign_toml",
        "dh",
        "formula",
        "model",
        "recording",
        "scenario",
        "urdf",
    ];
    assert_eq!(targets, known);
    for target in known {
        assert!(
            manifest.contains(&format!("name = \"{target}\"")),
            "{target} is not built"
        );
        assert!(
            script.split_whitespace().any(|word| word == target),
            "make fuzz does not run {target}"
        );
    }
}

#[test]
fn effects_are_known_by_their_role_outside_of_the_catalogue() {
    fn rust_files(folder: &Path) -> Vec<PathBuf> {
        let entries = fs::read_dir(folder).unwrap();
        let paths = entries.map(|entry| entry.unwrap().path());
        let below = |path: PathBuf| match path.is_dir() {
            true => rust_files(&path),
            false => vec![path],
        };
        let files = paths.flat_map(below);
        files
            .filter(|path| path.extension().is_some_and(|ending| ending == "rs"))
            .collect()
    }
    // there geometry is an element of a URDF
    let element = Path::new("crates/misfit-core/src/export/urdf.rs");
    let folders = [
        "crates/misfit-core/src",
        "crates/cell/src",
        "crates/report/src",
        "src",
    ];
    let files = folders.map(|folder| rust_files(Path::new(folder))).concat();
    assert!(files.len() > 150, "the sources are not where they were");
    for path in files
        .iter()
        .filter(|path| !path.starts_with("crates/misfit-core/src/effects"))
    {
        let text = fs::read_to_string(path).unwrap();
        for line in code(&text) {
            let named = CATALOGUE
                .iter()
                .find(|entry| line.contains(&format!("\"{}\"", entry.id)));
            let is_element = named.is_some_and(|entry| entry.id == "geometry") && path == element;
            assert!(
                named.is_none() || is_element,
                "{}: {line}: compare roles (effects::Role), not ids",
                path.display()
            );
            assert!(
                !line.contains("split_once('.')"),
                "{}: {line}: a parameter says its joint (Parameter::joint)",
                path.display()
            );
        }
    }
}
