//! Runs the commands of the book's first chapters exactly as printed. It takes minutes: `.ci/parts.sh`
//! runs it last.

mod built;

use std::path::{Path, PathBuf};
use std::process::Command;

use built::binary;

/// Fenced blocks that begin with "```sh tested", in their order.
fn commands(page: &str) -> Vec<String> {
    let file = root().join("docs").join(page);
    let text = std::fs::read_to_string(&file)
        .unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let mut blocks = Vec::new();
    let mut lines = text.lines();
    while let Some(line) = lines.next() {
        if line.trim() == "```sh tested" {
            let block: Vec<&str> = lines
                .by_ref()
                .take_while(|line| line.trim() != "```")
                .collect();
            blocks.push(block.join("\n"));
        }
    }
    blocks
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_owned()
}

/// Runs a chapter in a folder that has the examples, and returns its output.
fn run(page: &str, folder: &Path) -> String {
    std::os::unix::fs::symlink(root().join("examples"), folder.join("examples")).expect("a link");
    let programs = binary("cardiotwin").parent().expect("a folder").to_owned();
    let path = std::env::join_paths(std::iter::once(programs).chain(std::env::split_paths(
        &std::env::var_os("PATH").unwrap_or_default(),
    )));
    let blocks = commands(page);
    assert!(blocks.len() >= 3, "{page} shows commands that are tested");
    let script = blocks.join("\n");
    let output = Command::new("bash")
        .args(["-eu", "-c", &script])
        .env("PATH", path.expect("a path"))
        .current_dir(folder)
        .output()
        .expect("bash starts");
    let words = String::from_utf8_lossy(&output.stdout).into_owned()
        + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{page}:\n{script}\n\n{words}");
    words
}

#[test]
fn a_first_cohort_in_ten_minutes() {
    let folder = tempfile::tempdir().expect("a folder");
    run("first-cohort.md", folder.path());
    for made in [
        "prepared/P001/prepared/beats.svg",
        "my-cohort/run/report.html",
        "my-cohort/run/export/ro-crate",
    ] {
        assert!(folder.path().join(made).exists(), "{made}");
    }
}

#[test]
fn a_patients_own_mesh() {
    let folder = tempfile::tempdir().expect("a folder");
    run("own-anatomy.md", folder.path());
}
