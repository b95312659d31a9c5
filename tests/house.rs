//! The invariants of ARCHITECTURE.md that neither the compiler nor a lint holds.

use misfit_core::effects::CATALOGUE;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Folders of sources, each of one crate.
fn homes() -> Vec<PathBuf> {
    let crates = fs::read_dir("crates").unwrap();
    let mut homes: Vec<PathBuf> = crates
        .map(|entry| entry.unwrap().path().join("src"))
        .chain(["src", "replay/src"].map(PathBuf::from))
        .collect();
    homes.sort();
    homes
}

/// All Rust files under a folder, with their text.
fn sources_of(home: &Path) -> Vec<(PathBuf, String)> {
    let mut entries: Vec<PathBuf> = fs::read_dir(home)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    entries.sort();
    let mut found = Vec::new();
    for path in entries {
        if path.is_dir() {
            found.extend(sources_of(&path));
        } else if path.extension().is_some_and(|ending| ending == "rs") {
            let text = fs::read_to_string(&path).unwrap();
            found.push((path, text));
        }
    }
    found
}

fn sources() -> Vec<(PathBuf, String)> {
    let found: Vec<_> = homes().iter().flat_map(|home| sources_of(home)).collect();
    assert!(found.len() > 200, "the sources are not where they were");
    found
}

/// Lines that are code, not comment, and not a module of tests at the end of a file.
fn code(text: &str) -> impl Iterator<Item = &str> {
    let own = text.split("#[cfg(test)]\nmod ").next().unwrap();
    own.lines()
        .filter(|line| !line.trim_start().starts_with("//"))
}

/// The crates a package depends on, however far, without its tests.
fn tree(package: &str) -> BTreeSet<String> {
    let words = [
        "tree",
        "--offline",
        "--locked",
        "--edges=normal,build",
        "--prefix=none",
        "--format={p}",
        "--package",
    ];
    let output = Command::new(env!("CARGO"))
        .args(words)
        .arg(package)
        .output()
        .unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{error}");
    let text = String::from_utf8(output.stdout).unwrap();
    text.lines()
        .filter(|line| !line.is_empty())
        .map(|line| {
            let mut words = line.split(' ');
            format!("{} {}", words.next().unwrap(), words.next().unwrap())
        })
        .collect()
}

fn names(tree: &BTreeSet<String>) -> BTreeSet<&str> {
    tree.iter()
        .map(|line| line.split(' ').next().unwrap())
        .collect()
}

/// What each crate must be able to do without: with this the compiler holds that a fit never sees a truth, that plant
/// and model share no code, and that only one crate each speaks MuJoCo, MCAP and Rerun.
#[test]
fn crates_do_without_what_is_not_theirs() {
    const CRATES: [(&str, &[&str]); 7] = [
        ("misfit-arm", &["misfit-campaign", "mcap", "clap"]),
        (
            "misfit-campaign",
            &["misfit-core", "misfit-truth", "mcap", "calamine", "cc"],
        ),
        (
            "misfit-core",
            &[
                "misfit-plant",
                "misfit-cell",
                "mcap",
                "clap",
                "plotters",
                "cc",
            ],
        ),
        ("misfit-truth", &["misfit-core", "misfit-plant"]),
        ("misfit-plant", &["misfit-core", "mcap", "clap", "plotters"]),
        (
            "misfit-cell",
            &["misfit-report", "mcap", "clap", "plotters"],
        ),
        ("misfit-report", &["clap", "rerun"]),
    ];
    for (package, without) in CRATES {
        let tree = tree(package);
        let names = names(&tree);
        for name in without {
            assert!(!names.contains(name), "{package} depends on {name}");
        }
        let binding = names
            .iter()
            .find(|name| name.ends_with("-sys") && **name != "linux-raw-sys");
        assert!(
            binding.is_none() || package == "misfit-report",
            "{package} binds {binding:?}"
        );
    }
    // what only pictures of replays need is in no other program
    assert!(!names(&tree("misfit")).contains("rerun"));
}

/// The identification core is light enough to be put into anything.
#[test]
fn the_core_has_at_most_seventy_crates() {
    let tree = tree("misfit-core");
    let count = tree.len();
    assert!((20..=70).contains(&count), "{count} crates: {tree:#?}");
}

/// The paths that a use tree names, each as its words: `a::{b, c::d}` is `a::b` and `a::c::d`.
fn paths(tree: &str) -> Vec<Vec<&str>> {
    if let Some(group) = tree.strip_prefix('{') {
        let (mut depth, mut start, mut found) = (1, 0, Vec::new());
        for (at, letter) in group.char_indices() {
            depth += i32::from(letter == '{') - i32::from(letter == '}');
            if depth == 0 || (depth == 1 && letter == ',') {
                found.extend(paths(group[start..at].trim_start()));
                start = at + 1;
            }
            if depth == 0 {
                break;
            }
        }
        return found;
    }
    let end = tree.find(|letter: char| !letter.is_alphanumeric() && letter != '_');
    let (word, rest) = tree.split_at(end.unwrap_or(tree.len()));
    match rest.strip_prefix("::") {
        _ if word.is_empty() => Vec::new(),
        None => vec![vec![word]],
        Some(rest) => {
            let mut below = paths(rest);
            below.iter_mut().for_each(|path| path.insert(0, word));
            below
        }
    }
}

/// Paths by `crate::`, `super::` and `self::` in the code of the module `own`, from the crate's root on.
fn imports(text: &str, own: &[String]) -> BTreeSet<Vec<String>> {
    let text: String = code(text).flat_map(|line| [line, "\n"]).collect();
    let mut found = BTreeSet::new();
    for start in ["crate::", "super::", "self::"] {
        for (at, _) in text.match_indices(start) {
            if text[..at]
                .ends_with(|letter: char| letter.is_alphanumeric() || ":_".contains(letter))
            {
                continue;
            }
            for path in paths(&text[at..]) {
                let mut absolute = if start == "crate::" {
                    Vec::new()
                } else {
                    own.to_vec()
                };
                for word in path {
                    match word {
                        "crate" | "self" => {}
                        "super" => drop(absolute.pop()),
                        _ => absolute.push(word.to_owned()),
                    }
                }
                found.insert(absolute);
            }
        }
    }
    found
}

#[test]
fn imports_are_read_from_sources() {
    let own = ["m", "n"].map(str::to_owned);
    let table: [(&str, &[&str]); 7] = [
        ("use crate::a;\n", &["a"]),
        (
            "use crate::{a, b::{d, X}, c as e};\n",
            &["a", "b/X", "b/d", "c"],
        ),
        ("let x = crate::d::f(crate::b::g());\n", &["b/g", "d/f"]),
        ("// crate::a\nuse crate::Root;\n", &["Root"]),
        (
            "use crate::{\n    b::X,\n    a::{self, d},\n};\n",
            &["a", "a/d", "b/X"],
        ),
        (
            "use super::{o, p::q};\nuse super::super::s;\nself::r();\n",
            &["m/n/r", "m/o", "m/p/q", "s"],
        ),
        ("use other::super_::a;\n", &[]),
    ];
    for (text, expected) in table {
        let found = imports(text, &own);
        let found: Vec<String> = found.iter().map(|path| path.join("/")).collect();
        assert_eq!(found, expected, "{text}");
    }
}

/// A cycle of a graph, if it has one.
fn cycle<'a>(graph: &BTreeMap<&'a str, BTreeSet<&'a str>>) -> Option<Vec<&'a str>> {
    fn visit<'a>(
        node: &'a str,
        graph: &BTreeMap<&'a str, BTreeSet<&'a str>>,
        path: &mut Vec<&'a str>,
        done: &mut BTreeSet<&'a str>,
    ) -> bool {
        if let Some(at) = path.iter().position(|other| *other == node) {
            path.drain(..at);
            return true;
        }
        if done.contains(node) {
            return false;
        }
        path.push(node);
        for next in &graph[node] {
            if visit(next, graph, path, done) {
                return true;
            }
        }
        path.pop();
        done.insert(node);
        false
    }
    let mut done = BTreeSet::new();
    graph.keys().find_map(|node| {
        let mut path = Vec::new();
        visit(node, graph, &mut path, &mut done).then_some(path)
    })
}

#[test]
fn cycles_are_found() {
    let graph = |edges: &[(&'static str, &[&'static str])]| {
        let edges = edges.iter();
        edges
            .map(|(from, to)| (*from, to.iter().copied().collect()))
            .collect()
    };
    let free = graph(&[("a", &["b", "c"]), ("b", &["c"]), ("c", &[])]);
    assert_eq!(cycle(&free), None);
    let tied = graph(&[("a", &["b"]), ("b", &["c"]), ("c", &["d"]), ("d", &["b"])]);
    assert_eq!(cycle(&tied), Some(vec!["b", "c", "d"]));
}

/// Modules beside each other, at the root of each crate and in each folder of it. What the root or a folder's `mod.rs`
/// itself holds is everyone's.
#[test]
fn no_modules_import_each_other() {
    let mut modules = 0;
    for home in homes() {
        let sources: Vec<(Vec<String>, String)> = sources_of(&home)
            .into_iter()
            .map(|(path, text)| (module(path.strip_prefix(&home).unwrap()), text))
            .collect();
        let known: BTreeSet<&[String]> = sources.iter().map(|(own, _)| own.as_slice()).collect();
        // by folder: who of its children imports whom
        let mut graphs: BTreeMap<Vec<String>, BTreeMap<&str, BTreeSet<&str>>> = BTreeMap::new();
        for (own, text) in &sources {
            for path in imports(text, own) {
                let ends = (0..=path.len()).rev();
                let Some(other) = ends.filter_map(|end| known.get(&path[..end])).next() else {
                    continue;
                };
                let common = own.iter().zip(*other).take_while(|(a, b)| a == b).count();
                if let (Some(from), Some(to)) = (own.get(common), other.get(common)) {
                    let graph = graphs.entry(own[..common].to_vec()).or_default();
                    graph.entry(from).or_default().insert(to);
                    graph.entry(to).or_default();
                }
            }
        }
        for (folder, graph) in &graphs {
            modules += graph.len();
            let place = home.join(folder.iter().collect::<PathBuf>());
            let found = cycle(graph);
            assert_eq!(found, None, "{}: modules know each other", place.display());
        }
    }
    assert!(modules > 150, "{modules} modules");
}

/// The words of a module's path, by its file.
fn module(file: &Path) -> Vec<String> {
    let mut words: Vec<String> = file
        .with_extension("")
        .iter()
        .map(|word| word.to_string_lossy().into_owned())
        .collect();
    if words
        .last()
        .is_some_and(|last| ["lib", "main", "mod"].contains(&last.as_str()))
    {
        words.pop();
    }
    words
}

/// The plant shares data of the robot with the model; its motions are MuJoCo's and nalgebra's.
#[test]
fn plant_and_model_share_no_code() {
    for (path, text) in sources_of(Path::new("crates/plant/src")) {
        for word in ["dual_quaternion", "formula"] {
            let found = code(&text).find(|line| line.contains(word));
            assert_eq!(found, None, "{}: algebra of the model", path.display());
        }
    }
}

#[test]
fn an_effect_is_one_file_and_two_lines() {
    let home = Path::new("crates/misfit-core/src/effects");
    let list = fs::read_to_string(home.join("mod.rs")).unwrap();
    let shared = ["list", "mod", "need", "options", "role", "table"];
    let mut files: Vec<String> = fs::read_dir(home)
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
        assert_eq!(lines.count(), 2, "{id} takes two lines of mod.rs");
        // and no file outside its own knows what it does
        for (path, text) in sources() {
            let own = path.starts_with(home);
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
        let home = ["crates/arm/src/input.rs", "crates/cell/src/sweep/store.rs"]
            .iter()
            .any(|home| path == Path::new(home));
        // messages about DH tables name the row: from the parser's own errors, behind the check of depth
        let rows = path == Path::new("crates/arm/src/robot/dh.rs");
        for word in words
            .iter()
            .filter(|word| !(rows && **word == "toml::from_str"))
        {
            let found = code(&text).find(|line| line.contains(word));
            assert!(
                home || found.is_none(),
                "{}: {found:?} belongs to crates/arm/src/input.rs",
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
    let tree = tree("misfit");
    let names = names(&tree);
    for word in words {
        assert!(!names.contains(word), "the program depends on {word}");
    }
}

/// The text of a module of tests, of whatever package.
fn tests_of(module: &str) -> Option<String> {
    let own = ["tests", "replay/tests"].map(PathBuf::from);
    let crates = fs::read_dir("crates").unwrap();
    let crates = crates.map(|entry| entry.unwrap().path().join("tests"));
    own.into_iter()
        .chain(crates)
        .find_map(|folder| fs::read_to_string(folder.join(format!("{module}.rs"))).ok())
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
            let source = tests_of(module);
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
