//! The recordings kept in `recordings/`, made anew by the commands of its README: the same bytes. They were made by an
//! optimised program on all threads; here a debug build makes them, on 1, 2 and 8.

#![allow(clippy::unwrap_used)]

use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// Rows of the README's table: a file, and the command that makes it.
fn rows() -> Vec<(String, String)> {
    let text = fs::read_to_string("recordings/README.md").unwrap();
    let rows = text.lines().filter(|line| line.starts_with("| `"));
    rows.map(|line| {
        let quoted: Vec<&str> = line.split('`').skip(1).step_by(2).collect();
        (quoted[0].to_owned(), quoted[quoted.len() - 1].to_owned())
    })
    .collect()
}

#[test]
fn recordings_are_made_as_their_readme_says() {
    let folder = TempDir::new().unwrap();
    let at = folder.path();
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for name in ["scenarios", "models"] {
        std::os::unix::fs::symlink(root.join(name), at.join(name)).unwrap();
    }
    fs::create_dir(at.join("recordings")).unwrap();
    fs::copy("recordings/tasks.csv", at.join("recordings/tasks.csv")).unwrap();
    let rows = rows();
    assert_eq!(rows.len(), 7, "{rows:?}");
    for ((name, command), threads) in rows.into_iter().zip(["1", "2", "8"].iter().cycle()) {
        let words = command.strip_prefix("misfit ").unwrap().split(' ');
        let output = Command::new(env!("CARGO_BIN_EXE_misfit"))
            .current_dir(at)
            .env("RAYON_NUM_THREADS", threads)
            .args(words)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{command}: {said}");
        let made = fs::read(at.join("recordings").join(&name)).unwrap();
        let kept = fs::read(root.join("recordings").join(&name)).unwrap();
        assert!(
            made == kept,
            "recordings/{name} is not what `{command}` makes now on {threads} threads"
        );
    }
    // nothing is kept that nobody says how to make
    for entry in fs::read_dir("recordings").unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        let known = ["README.md", "tasks.csv"].contains(&name.as_str());
        assert!(
            known || at.join("recordings").join(&name).exists(),
            "{name}"
        );
        assert!(known || name.ends_with(".mcap"), "{name}");
    }
}
