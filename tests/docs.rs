//! What the documents say is true: every command in them is run, and shown output is what it prints.
//!
//! In a fenced block a line `$ …` is a command, the lines below it are lines of its output as they stand there, and `…`
//! stands for lines left out. `$ echo $?` asks for the exit code of the command before; every other command ends with 0.
//! A block whose fence names a file (` ```toml limits.toml `) is that file: the reader is to write it, or has it. A page
//! is run from top to bottom in a folder of its own, with the folders of the sources that its commands name.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use tempfile::TempDir;

/// Commands that take long, or need what other programs make: `make figures` runs them, and compares, too.
const COSTLY: [(&str, &str); 6] = [
    ("docs/loop.md", "misfit run scenarios/control_loop.toml"),
    ("docs/maps.md", "misfit run scenarios/map.toml -o out/"),
    (
        "docs/drilling.md",
        "misfit drill scenarios/drill.toml -o out/",
    ),
    ("docs/blind.md", "misfit sweep scenarios/blind/rich.toml"),
    ("docs/ur10.md", "misfit ladder series_C.toml -o model.toml"),
    // of bags that `make bags` writes
    ("", "misfit import "),
];

/// Commands that another target of the Makefile runs: which one, in which file, by which words.
const ELSEWHERE: [(&str, &str, &str, &str); 1] = [
    // needs a program that is built apart
    (
        "misfit replay ",
        "viewer",
        ".ci/viewer",
        "\"$misfit\" replay",
    ),
];

/// Words by which lines of a shell begin that install or find something: nothing of this project is in them.
const OF_OTHERS: [&str; 5] = ["pip ", "git ", "cd ", "export ", "rerun "];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Files of a folder and those below it with this ending, by their path from the root.
fn files(folder: &str, ending: &str) -> Vec<String> {
    let mut entries: Vec<String> = fs::read_dir(root().join(folder))
        .unwrap()
        .map(|entry| format!("{folder}/{}", entry.unwrap().file_name().to_str().unwrap()))
        .collect();
    entries.sort();
    let mut found = Vec::new();
    for path in entries {
        if root().join(&path).is_dir() {
            found.extend(files(&path, ending));
        } else if path.ends_with(ending) {
            found.push(path);
        }
    }
    found
}

/// The guide's pages.
fn guide() -> Vec<String> {
    files("docs/guide", ".md")
}

/// The pages by subject whose commands are run: those of `docs/` itself that type any.
fn subjects() -> Vec<String> {
    let mut all = files("docs", ".md");
    all.retain(|path| Path::new(path).parent() == Some(Path::new("docs")));
    all.retain(|path| text(path).lines().any(|line| line.starts_with("$ misfit ")));
    all
}

/// All pages for readers except the changelog, which describes earlier versions.
fn pages() -> Vec<String> {
    let own = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(str::to_owned);
    let kept = ["scenarios/README.md", "recordings/README.md"].map(str::to_owned);
    let mut all = [own.to_vec(), kept.to_vec()].concat();
    all.extend(files("docs", ".md"));
    all
}

/// Something that a page asks its reader to do.
#[derive(Debug, PartialEq)]
enum Step {
    /// Write a file.
    Write { name: String, text: String },
    /// Type a command; these lines are shown of what it prints.
    Type {
        line: usize,
        command: String,
        shown: Vec<String>,
    },
}

/// A fenced block: the line of its fence, what stands behind the fence, the lines in it.
struct Block<'a> {
    line: usize,
    info: &'a str,
    lines: Vec<&'a str>,
}

fn blocks(page: &str) -> Vec<Block<'_>> {
    let mut all: Vec<Block> = Vec::new();
    let mut open = false;
    for (index, line) in page.lines().enumerate() {
        match line.strip_prefix("```") {
            Some(_) if open => open = false,
            Some(info) => {
                open = true;
                let (line, lines) = (index + 1, Vec::new());
                all.push(Block { line, info, lines });
            }
            None if open => all.last_mut().unwrap().lines.push(line),
            None => {}
        }
    }
    assert!(!open, "a block without an end");
    all
}

/// All that a page asks for, in order.
fn steps(page: &str) -> Vec<Step> {
    let mut all = Vec::new();
    for block in blocks(page) {
        if let Some((_, name)) = block.info.split_once(' ') {
            let (name, text) = (name.to_owned(), block.lines.join("\n") + "\n");
            all.push(Step::Write { name, text });
            continue;
        }
        let mut inside = false;
        for (offset, line) in block.lines.iter().enumerate() {
            let typed = match block.info {
                "sh" => Some(line.trim()).filter(|line| !line.is_empty() && !line.starts_with('#')),
                _ => line.strip_prefix("$ "),
            };
            if let Some(command) = typed {
                inside = true;
                all.push(Step::Type {
                    line: block.line + 1 + offset,
                    command: command.to_owned(),
                    shown: Vec::new(),
                });
            } else if let (true, Some(Step::Type { shown, .. })) =
                (inside && block.info != "sh", all.last_mut())
            {
                shown.push(line.trim_end().to_owned());
            }
        }
    }
    all
}

/// Are the lines shown those that were printed, in their order and one below the other? `…` stands for any number.
/// If not: the first group of lines that is not there.
fn compare(shown: &[String], printed: &str) -> Result<(), String> {
    let printed: Vec<&str> = printed.lines().map(str::trim_end).collect();
    let mut from = 0;
    for group in shown.split(|line| line.trim() == "…") {
        let first = group.iter().position(|line| !line.is_empty());
        let Some(first) = first else { continue };
        let last = group.iter().rposition(|line| !line.is_empty()).unwrap();
        let group = &group[first..=last];
        let here = printed[from..]
            .windows(group.len())
            .position(|lines| lines == group);
        match here {
            Some(at) => from += at + group.len(),
            None => return Err(group.join("\n")),
        }
    }
    Ok(())
}

#[test]
fn shown_lines_are_looked_for_in_order_and_one_below_the_other() {
    let printed = "a\nb\n\nc  \nd\n";
    let ok = |shown: &str| {
        let shown: Vec<String> = shown.lines().map(str::to_owned).collect();
        compare(&shown, printed).is_ok()
    };
    for shown in [
        "",
        "a",
        "a\nb",
        "b\n\nc\nd",
        "a\n  …\nc",
        "…\nd\n",
        "a\nb\n\n…\nd",
    ] {
        assert!(ok(shown), "{shown:?}");
    }
    for shown in ["e", "a\nc", "c\n…\na", "a\n…\na", "b\nc", " a"] {
        assert!(!ok(shown), "{shown:?}");
    }
}

#[test]
fn a_page_is_read_as_its_reader_does() {
    let page = "text\n```toml a.toml\nx = 1\n```\n```\n$ misfit fit a.toml\none\n…\n$ echo $?\n3\n```\n\
        ```rust\nno command\n```\n```sh\nmake run     # all\n\nmisfit effects\n```\n";
    let step = |line, command: &str, shown: &[&str]| Step::Type {
        line,
        command: command.to_owned(),
        shown: shown.iter().map(|&line| line.to_owned()).collect(),
    };
    let file = Step::Write {
        name: "a.toml".to_owned(),
        text: "x = 1\n".to_owned(),
    };
    let read = [
        file,
        step(6, "misfit fit a.toml", &["one", "…"]),
        step(9, "echo $?", &["3"]),
        step(16, "make run     # all", &[]),
        step(18, "misfit effects", &[]),
    ];
    assert_eq!(steps(page), read);
}

/// Is it one of the costly ones?
fn costly(page: &str, command: &str) -> bool {
    let mut known = COSTLY.iter();
    known.any(|(of, words)| page.ends_with(of) && command.starts_with(words))
}

/// The target that runs it instead, if there is one.
fn elsewhere(command: &str) -> Option<&'static str> {
    let found = ELSEWHERE.iter().find(|row| command.starts_with(row.0));
    found.map(|row| row.1)
}

/// The folder in which a page is followed: that of the sources, but for what the page's commands write.
fn folder() -> TempDir {
    let folder = TempDir::new().unwrap();
    for name in ["scenarios", "models", "recordings", "docs", "target"] {
        symlink(root().join(name), folder.path().join(name)).unwrap();
    }
    // what is measured on a real robot, and what `make bags` writes
    let data = std::env::var("MISFIT_DATA").unwrap_or("../shared/data".to_owned());
    let given = [format!("{data}/ur10_tracker"), "target/bags".to_owned()];
    for file in [
        "series_C.toml",
        "series_C.csv",
        "ur10.urdf",
        "foxglove.mcap",
        "import.toml",
        "three.urdf",
    ] {
        let found = given.iter().map(|from| root().join(from).join(file));
        if let Some(path) = found.into_iter().find(|path| path.exists()) {
            symlink(path.canonicalize().unwrap(), folder.path().join(file)).unwrap();
        }
    }
    folder
}

/// A command, typed in a shell that finds the program; `MISFIT` names another than this build's.
fn typed(folder: &Path, command: &str) -> Output {
    let program =
        std::env::var_os("MISFIT").map_or(env!("CARGO_BIN_EXE_misfit").into(), PathBuf::from);
    let path = std::env::var("PATH").unwrap();
    Command::new("sh")
        .args(["-c", command])
        .current_dir(folder)
        .env(
            "PATH",
            format!("{}:{path}", program.parent().unwrap().display()),
        )
        .env("HOME", folder)
        .env_remove("RUST_BACKTRACE")
        .output()
        .unwrap()
}

/// Follows a page from top to bottom, of the costly commands either all or none. How many were run.
fn follow(page: &str, with_costly: bool) -> usize {
    let text = text(page);
    let folder = folder();
    let at = folder.path();
    let mut wrong = String::new();
    let mut run = 0;
    let steps = steps(&text);
    for (k, step) in steps.iter().enumerate() {
        let (line, command, shown) = match step {
            Step::Write { name, text } => {
                // a file that is there already is only shown
                let path = at.join(name);
                if !path.exists() {
                    fs::write(path, text).unwrap();
                } else if fs::read_to_string(path).unwrap() != *text {
                    writeln!(wrong, "{page}: {name} is not as shown").unwrap();
                }
                continue;
            }
            Step::Type {
                line,
                command,
                shown,
            } => (line, command, shown),
        };
        let of_others = OF_OTHERS.iter().any(|word| command.starts_with(word));
        if command == "echo $?" || command.starts_with("make ") || of_others {
            continue;
        }
        let skipped = costly(page, command) && !with_costly;
        if skipped || elsewhere(command).is_some() {
            continue;
        }
        let output = typed(at, command);
        run += 1;
        let code = match steps.get(k + 1) {
            Some(Step::Type { command, shown, .. }) if command == "echo $?" => {
                shown[0].parse().unwrap()
            }
            _ => 0,
        };
        let out =
            String::from_utf8(output.stdout).unwrap() + &String::from_utf8(output.stderr).unwrap();
        let ended = output.status.code();
        if ended != Some(code) {
            writeln!(
                wrong,
                "{page}:{line}: {command}\nended with {ended:?}, not {code}:\n{out}"
            )
            .unwrap();
        } else if let Err(missing) = compare(shown, &out) {
            writeln!(
                wrong,
                "{page}:{line}: {command}\ndoes not print\n{missing}\nbut\n{out}"
            )
            .unwrap();
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
    run
}

#[test]
fn commands_of_the_guide_do_what_it_says() {
    use rayon::prelude::*;
    let runs: Vec<usize> = guide().par_iter().map(|page| follow(page, false)).collect();
    assert!(runs.iter().sum::<usize>() >= 40, "{runs:?}");
}

#[test]
fn commands_of_the_readme_do_what_it_says() {
    assert!(follow("README.md", false) >= 3);
}

#[test]
fn commands_of_the_pages_by_subject_do_what_they_say() {
    use rayon::prelude::*;
    let pages = subjects();
    let runs: Vec<usize> = pages.par_iter().map(|page| follow(page, false)).collect();
    assert!(runs.iter().sum::<usize>() >= 14, "{pages:?}: {runs:?}");
}

#[test]
#[ignore = "minutes, and needs the bags of `make bags`: `make figures` runs it"]
fn costly_commands_do_what_the_documents_say() {
    assert!(
        root().join("target/bags/foxglove.mcap").exists(),
        "make bags"
    );
    let test = "docs::costly_commands_do_what_the_documents_say";
    let measured = crate::measured::measured(test, "series_C.toml").is_some();
    for page in [vec!["README.md".to_owned()], subjects(), guide()].concat() {
        follow(&page, measured || page != "docs/ur10.md");
    }
}

#[test]
fn what_is_not_run_here_is_run_by_a_target() {
    let makefile = text("Makefile");
    let tested = makefile
        .lines()
        .find(|line| line.starts_with("test:"))
        .unwrap();
    let tested: BTreeSet<&str> = tested.split_whitespace().skip(1).collect();
    assert!(
        tested.contains("figures"),
        "`make test` compares no costly figures"
    );
    assert!(makefile.contains("docs::costly_commands_do_what_the_documents_say"));
    for (_, target, file, words) in ELSEWHERE {
        assert!(tested.contains(target), "`make test` does not {target}");
        assert!(
            makefile.contains(file) && text(file).contains(words),
            "{file}: {words}"
        );
    }
    // every exception is one: some page has it
    let all: Vec<(String, String)> = pages()
        .into_iter()
        .flat_map(|page| {
            let commands = steps(&text(&page))
                .into_iter()
                .filter_map(|step| match step {
                    Step::Type { command, .. } => Some(command),
                    Step::Write { .. } => None,
                });
            commands
                .map(|command| (page.clone(), command))
                .collect::<Vec<_>>()
        })
        .collect();
    for (page, words) in COSTLY {
        let used = all
            .iter()
            .any(|(of, command)| of.ends_with(page) && command.starts_with(words));
        assert!(used, "no page has `{words}`");
    }
    for (words, ..) in ELSEWHERE {
        assert!(
            all.iter().any(|(_, command)| command.starts_with(words)),
            "no page has `{words}`"
        );
    }
    // and whatever a page has make do is a target
    for (page, command) in &all {
        for target in command
            .split('#')
            .next()
            .unwrap()
            .split_whitespace()
            .skip(1)
        {
            let known = makefile
                .lines()
                .any(|line| line.starts_with(&format!("{target}:")));
            assert!(
                known || !command.starts_with("make "),
                "{page}: make {target}"
            );
        }
    }
}

#[test]
fn the_number_of_effects_is_that_of_the_catalogue() {
    // all but that which is a law of the user's own
    let count = misfit_core::effects::CATALOGUE.len() - 1;
    assert!(text("README.md").contains(&format!("one of {count} effects")));
    assert!(text("docs/guide/01-install.md").contains(&format!("{count} physical effects")));
}

/// Pages that repeat a figure: the page, the page from which it comes, the figures.
const REPEATED: [(&str, &str, &[&str]); 6] = [
    (
        "docs/guide/11-limits.md",
        "docs/efficiency.md",
        &["17 ms", "0.50 s", "0.19 s", "0.35 s of one core"],
    ),
    (
        "docs/guide/11-limits.md",
        "docs/report.md",
        &["4.5 to 5.0 s"],
    ),
    (
        "docs/guide/11-limits.md",
        "docs/blind.md",
        &[
            "588",
            "3.2 %",
            "26.7 %",
            "71.1 %",
            "95.6",
            "301 of 353",
            "31 of 780",
        ],
    ),
    (
        "docs/guide/11-limits.md",
        "README.md",
        &["at rest", "below λ 300"],
    ),
    (
        "docs/guide/04-read-the-fit.md",
        "docs/efficiency.md",
        &["2000", "95.8 %"],
    ),
    ("README.md", "docs/ur10.md", &["0.993", "0.121 mm"]),
];

#[test]
fn figures_that_a_page_repeats_are_those_of_their_source() {
    let flat = |page: &str| text(page).split_whitespace().collect::<Vec<_>>().join(" ");
    for (page, source, figures) in REPEATED {
        let (here, there) = (flat(page), flat(source));
        for figure in figures {
            assert!(there.contains(figure), "{source} no longer says {figure}");
            assert!(here.contains(figure), "{page} no longer says {figure}");
        }
    }
}

/// What stands between single backticks in the text of a page, outside its blocks; the line where its paragraph begins.
fn spans(page: &str) -> Vec<(usize, String)> {
    let mut paragraphs: Vec<(usize, String)> = Vec::new();
    let mut open = false;
    let mut inside = false;
    for (index, line) in page.lines().enumerate() {
        if line.starts_with("```") {
            open = !open;
        }
        // a row of a table is a paragraph of its own
        let text = !open && !line.starts_with("```") && !line.trim().is_empty();
        if text && inside && !line.starts_with('|') {
            let last = &mut paragraphs.last_mut().unwrap().1;
            last.push(' ');
            last.push_str(line.trim_start());
        } else if text {
            paragraphs.push((index + 1, line.to_owned()));
        }
        inside = text;
    }
    let mut all = Vec::new();
    for (line, paragraph) in &paragraphs {
        let parts = paragraph.split('`').skip(1).step_by(2);
        all.extend(parts.map(|span| (*line, span.to_owned())));
    }
    all
}

#[test]
fn commands_named_in_the_text_are_spelt_right() {
    // where nothing is to be found no command gets further than its words, but those that need nothing
    let folder = TempDir::new().unwrap();
    let mut seen = 0;
    let mut wrong = String::new();
    for page in pages() {
        let page_text = text(&page);
        for (line, span) in spans(&page_text) {
            let of_program =
                span.starts_with("misfit ") && !span.contains(['…', '<', '>', '|', '&', ';']);
            if !of_program {
                continue;
            }
            seen += 1;
            let said = String::from_utf8(typed(folder.path(), &span).stderr).unwrap();
            // a command that is only named lacks what it needs; a misspelt one is not known
            for word in [
                "unexpected argument",
                "unrecognized subcommand",
                "invalid value",
            ] {
                if said.contains(word) {
                    writeln!(wrong, "{page}:{line}: `{span}`: {said}").unwrap();
                }
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
    assert!(seen > 60, "{seen}");
}

#[test]
fn links_lead_somewhere() {
    let mut seen = 0;
    for page in pages() {
        let page_text = text(&page);
        let folder = root().join(&page).parent().unwrap().to_owned();
        for part in page_text.split("](").skip(1) {
            let target = part.split(')').next().unwrap();
            if target.contains("://") {
                continue;
            }
            let (file, section) = target.split_once('#').unwrap_or((target, ""));
            let path = folder.join(file);
            assert!(path.exists(), "{page} links to {target}");
            if !section.is_empty() {
                let there = if file.is_empty() {
                    page_text.clone()
                } else {
                    fs::read_to_string(path).unwrap()
                };
                let mut heads = there.lines().filter(|line| line.starts_with('#'));
                let known = heads.any(|head| anchor(head) == section);
                assert!(known, "{page} links to {target}: no such heading");
            }
            seen += 1;
        }
    }
    assert!(seen > 30, "{seen}");
}

/// The anchor that a heading has on the usual sites.
fn anchor(heading: &str) -> String {
    let words = heading.trim_start_matches('#').trim().to_lowercase();
    let kept = words
        .chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn the_readme_is_short() {
    let size = text("README.md").len();
    assert!(
        size <= 12_000,
        "README.md has {size} bytes: docs/ has the subjects"
    );
}

#[test]
fn every_page_by_subject_is_in_the_index() {
    let index = text("docs/README.md");
    for page in files("docs", ".md") {
        let name = page.strip_prefix("docs/").unwrap();
        if !name.contains('/') && name != "README.md" {
            assert!(
                index.contains(&format!("]({name})")),
                "{page} is not in docs/README.md"
            );
        }
    }
}

#[test]
fn the_guide_links_its_chapters_in_order() {
    let first = text("docs/guide/README.md");
    let listed: Vec<&str> = first
        .split("](")
        .skip(1)
        .map(|part| part.split(')').next().unwrap())
        .filter(|target| target.starts_with(|c: char| c.is_ascii_digit()))
        .collect();
    let chapters: Vec<String> = guide()
        .into_iter()
        .filter(|path| !path.ends_with("README.md"))
        .map(|path| path.rsplit('/').next().unwrap().to_owned())
        .collect();
    assert_eq!(listed, chapters, "in the order of their numbers, each once");
    for pair in chapters.windows(2) {
        let page = text(&format!("docs/guide/{}", pair[0]));
        let last = page.trim_end().lines().last().unwrap();
        assert!(
            last.contains(&format!("]({})", pair[1])),
            "{} does not end with the next",
            pair[0]
        );
    }
    assert!(text("README.md").contains("](docs/guide/README.md)"));
}

#[test]
fn pages_are_no_wider_than_the_sources() {
    let own = ["README.md", "docs/README.md", "docs/add-an-effect.md"].map(str::to_owned);
    for page in [own.to_vec(), subjects(), guide()].concat() {
        for (index, line) in text(&page).lines().enumerate() {
            let width = line.chars().count();
            assert!(
                width <= 120 || line.starts_with(['|', '!']),
                "{page}:{}: {width} columns",
                index + 1
            );
        }
    }
}

/// The page's code is tried by `make effect`; here, that it still is the whole of a commit, and applies.
#[test]
fn an_effect_is_added_as_its_page_says() {
    let page = text("docs/add-an-effect.md");
    let blocks = blocks(&page);
    let files: Vec<&str> = blocks
        .iter()
        .filter_map(|block| block.info.strip_prefix("rust "))
        .collect();
    let [file] = files[..] else {
        panic!("one file, not {files:?}");
    };
    assert!(
        !root().join(file).exists(),
        "{file} is in the catalogue: take another example"
    );
    let change = blocks.iter().find(|block| block.info == "diff").unwrap();
    let catalogue = text("crates/misfit-core/src/effects/mod.rs");
    let catalogue: Vec<&str> = catalogue.lines().collect();
    let mut added = 0;
    for hunk in change.lines[2..]
        .split(|line| line.starts_with("@@"))
        .skip(1)
    {
        assert!(
            hunk.iter().all(|line| line.starts_with([' ', '+'])),
            "{hunk:?}"
        );
        added += hunk.iter().filter(|line| line.starts_with('+')).count();
        let before: Vec<&str> = hunk
            .iter()
            .filter_map(|line| line.strip_prefix(' '))
            .collect();
        let places = catalogue
            .windows(before.len())
            .filter(|lines| *lines == before);
        assert_eq!(
            places.count(),
            1,
            "crates/misfit-core/src/effects/mod.rs has not {before:#?}"
        );
    }
    assert_eq!(added, 2, "one file and two lines");
    let makefile = text("Makefile");
    assert!(
        makefile.contains("sh .ci/effect") && text(".ci/effect").contains("docs/add-an-effect.md")
    );
    assert!(text(".ci/effect").contains(file));
}

/// Rows of the table under a heading, each its cells.
fn rows<'a>(page: &'a str, heading: &str) -> Vec<Vec<&'a str>> {
    let (_, rest) = page.split_once(&format!("\n## {heading}\n")).unwrap();
    let section = rest.split("\n## ").next().unwrap();
    let table = section.lines().filter(|line| line.starts_with('|')).skip(2);
    table
        .map(|line| line.trim_matches('|').split(" | ").map(str::trim).collect())
        .collect()
}

fn ticked(cell: &str) -> Vec<&str> {
    cell.split('`').skip(1).step_by(2).collect()
}

#[test]
fn files_of_the_code_map_are_there() {
    let page = text("ARCHITECTURE.md");
    let mut seen = BTreeSet::new();
    let mut map: BTreeMap<String, String> = BTreeMap::new();
    for row in rows(&page, "Code map") {
        // a name stands for a file of the row's crate, of its sources, or of the folder of an earlier name in the row
        let home = ticked(row[0])[0];
        let mut places = vec![root().join(home), root().join(home).join("src")];
        for cell in &row[1..] {
            map.entry(home.to_owned()).or_default().push_str(cell);
            for name in ticked(cell) {
                let of_file = name.ends_with(".rs") || name.ends_with('/');
                if !of_file || name.contains('<') {
                    continue;
                }
                let found = places.iter().map(|place| place.join(name));
                let found = found.rev().find(|path| path.exists());
                let Some(found) = found else {
                    panic!("ARCHITECTURE.md names {name} in {home}: there is no such file");
                };
                let own = if found.is_dir() {
                    found.as_path()
                } else {
                    found.parent().unwrap()
                };
                places.push(own.to_owned());
                seen.insert(found);
            }
        }
    }
    // and the other way: every file and folder at the root of each crate is on the map, but for its own root
    for home in crates().into_iter().chain(["src".to_owned()]) {
        let sources = [root().join(&home).join("src"), root().join(&home)];
        let sources = sources.into_iter().find(|folder| folder.is_dir()).unwrap();
        for entry in fs::read_dir(sources).unwrap() {
            let name = entry.unwrap().file_name().into_string().unwrap();
            let own = ["lib.rs", "main.rs"].contains(&name.as_str());
            // reports have a file per subject, the program one per command: their rows name the kind
            let alike = ["crates/report", "src"].contains(&home.as_str());
            let named = map.get(&home).is_some_and(|row| row.contains(&name));
            assert!(
                own || alike || named || home == "crates/truth",
                "ARCHITECTURE.md does not name {home}: {name}"
            );
        }
    }
    assert!(seen.len() > 70, "{}", seen.len());
}

/// Folders of the library crates.
fn crates() -> Vec<String> {
    let entries = fs::read_dir(root().join("crates")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.map(|name| format!("crates/{name}")).collect()
}

/// Names of the test functions of a module of the tests, here or in replay/; none if there is no such module.
fn tests_of(module: &str) -> Option<BTreeSet<String>> {
    let mut files = vec![format!("tests/{module}.rs")];
    files.extend(
        crates()
            .iter()
            .map(|home| format!("{home}/tests/{module}.rs")),
    );
    files.extend(files_of_replay().into_iter().filter(|_| module == "replay"));
    let mut known = None;
    for file in files.iter().filter(|file| root().join(file).exists()) {
        let source = text(file);
        let names = known.get_or_insert_with(BTreeSet::new);
        let mut marked = false;
        for line in source.lines().map(str::trim) {
            marked |= line.starts_with("#[test]");
            if let (true, Some(rest)) = (marked, line.strip_prefix("fn ")) {
                names.insert(rest.split('(').next().unwrap().to_owned());
                marked = false;
            }
        }
    }
    known
}

fn files_of_replay() -> Vec<String> {
    files("replay/tests", ".rs")
}

#[test]
fn tests_of_the_invariants_are_there() {
    let page = text("ARCHITECTURE.md");
    let makefile = text("Makefile");
    let mut named = 0;
    for row in rows(&page, "Invariants, and the tests that hold them") {
        let mut module = "";
        let held = ticked(row.last().unwrap());
        assert!(!held.is_empty(), "{}: held by nothing", row[0]);
        for word in held {
            if let Some(target) = word.strip_prefix("make ") {
                assert!(makefile.contains(&format!("\n{target}:")), "make {target}");
                continue;
            }
            if root().join(word).exists() {
                continue;
            }
            let name = match word.split_once("::") {
                Some((of, name)) => {
                    module = of;
                    name
                }
                // a module, all of it; or another test of the module before
                None if tests_of(word).is_some() => {
                    module = word;
                    ""
                }
                None => word,
            };
            let Some(tests) = tests_of(module) else {
                panic!("ARCHITECTURE.md: `{word}`: no module {module} of tests");
            };
            let known = match name.strip_suffix('…') {
                Some(start) => tests.iter().any(|test| test.starts_with(start)),
                None => name.is_empty() || tests.contains(name),
            };
            assert!(known, "ARCHITECTURE.md: `{word}`: no such test");
            named += 1;
        }
    }
    assert!(named > 30, "{named}");
}

/// Is a licence expression met by these licences? AND binds closer than OR, as in SPDX; `/` is an old way to write OR.
fn allowed(expression: &str, accepted: &dyn Fn(&str) -> bool) -> bool {
    let spaced = expression
        .replace('/', " OR ")
        .replace('(', " ( ")
        .replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    fn any<'a>(words: &mut &[&'a str], accepted: &dyn Fn(&str) -> bool) -> bool {
        let mut met = all(words, accepted);
        while words.first() == Some(&"OR") {
            *words = &words[1..];
            met |= all(words, accepted);
        }
        met
    }
    fn all<'a>(words: &mut &[&'a str], accepted: &dyn Fn(&str) -> bool) -> bool {
        let mut met = one(words, accepted);
        while words.first() == Some(&"AND") {
            *words = &words[1..];
            met &= one(words, accepted);
        }
        met
    }
    fn one<'a>(words: &mut &[&'a str], accepted: &dyn Fn(&str) -> bool) -> bool {
        let (first, rest) = words.split_first().expect("a licence");
        *words = rest;
        if *first == "(" {
            let met = any(words, accepted);
            assert_eq!(words[0], ")");
            *words = &words[1..];
            return met;
        }
        if words.first() == Some(&"WITH") {
            let name = format!("{first} WITH {}", words[1]);
            *words = &words[2..];
            return accepted(&name);
        }
        accepted(first)
    }
    let mut rest = words.as_slice();
    let met = any(&mut rest, accepted);
    assert!(rest.is_empty(), "{expression}");
    met
}

#[test]
fn licence_expressions_are_read_as_spdx_does() {
    let mit = |name: &str| name == "MIT";
    for met in [
        "MIT",
        "MIT OR GPL-3.0",
        "GPL-3.0/MIT",
        "(MIT OR X) AND MIT",
        "X AND Y OR MIT",
    ] {
        assert!(allowed(met, &mit), "{met}");
    }
    for unmet in [
        "GPL-3.0",
        "MIT AND X",
        "(MIT OR X) AND Y",
        "MIT WITH Z",
        "X OR Y AND MIT",
    ] {
        assert!(!allowed(unmet, &mit), "{unmet}");
    }
}

/// What `cargo deny check licenses sources` asks, without it: of the packages for this platform.
#[test]
fn licences_of_all_packages_are_allowed() {
    let rules: toml::Table = text("deny.toml").parse().unwrap();
    let names = |list: &toml::Value| -> BTreeSet<String> {
        let names = list.as_array().unwrap().iter();
        names
            .map(|name| name.as_str().unwrap().to_owned())
            .collect()
    };
    let allow = names(&rules["licenses"]["allow"]);
    let exceptions = rules["licenses"]["exceptions"].as_array().unwrap();

    let rustc = Command::new("rustc").arg("-vV").output().unwrap().stdout;
    let rustc = String::from_utf8(rustc).unwrap();
    let host = rustc
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .unwrap();
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--locked"])
        .args(["--filter-platform", host])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    assert!(
        packages.len() > 300,
        "{}: are those of replay/ in it?",
        packages.len()
    );
    for package in packages {
        let name = package["name"].as_str().unwrap();
        let licence = package["license"].as_str();
        let licence = licence.unwrap_or_else(|| panic!("{name} says no licence"));
        let own = exceptions
            .iter()
            .find(|row| row["crate"].as_str() == Some(name));
        let own = own.map(|row| names(&row["allow"])).unwrap_or_default();
        let accepted = |licence: &str| allow.contains(licence) || own.contains(licence);
        assert!(
            allowed(licence, &accepted),
            "{name}: {licence} is not in deny.toml"
        );
        let source = package["source"].as_str();
        let known = source
            .is_none_or(|from| from == "registry+https://github.com/rust-lang/crates.io-index");
        assert!(known, "{name} is from {source:?}");
    }
    for member in ["misfit", "misfit-replay"] {
        let package = packages
            .iter()
            .find(|package| package["name"] == member)
            .unwrap();
        assert_eq!(package["license"], "MIT", "{member}");
    }
    assert!(text("LICENSE").starts_with("MIT License\n"));
    assert!(text("README.md").trim_end().ends_with("MIT licence"));
}
