//! Runs the commands of the README and of the book's first chapters exactly as printed. It takes
//! minutes: `.ci/parts.sh` runs it last.

mod built;
mod pictures;
mod report_picture;

use std::path::{Path, PathBuf};
use std::process::Command;

use built::binary;

/// Fenced blocks that begin with "```sh tested", in their order.
fn commands(page: &str) -> Vec<String> {
    let file = root().join(page);
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

/// Runs a page's commands in a folder, and returns their output.
fn run(page: &str, folder: &Path) -> String {
    let blocks = commands(page);
    assert!(!blocks.is_empty(), "{page} shows commands that are tested");
    shell(page, &blocks.join("\n"), folder)
}

/// Runs a script in a folder that gets a copy of the examples, and returns its output.
fn shell(page: &str, script: &str, folder: &Path) -> String {
    if !folder.join("examples").exists() {
        copy(&root().join("examples"), &folder.join("examples"));
    }
    let programs = binary("cardiotwin").parent().expect("a folder").to_owned();
    let path = std::env::join_paths(std::iter::once(programs).chain(std::env::split_paths(
        &std::env::var_os("PATH").unwrap_or_default(),
    )));
    // A page may show a run whose twin is off, which is done with the code 7.
    let script = format!(
        "cardiotwin() {{ command cardiotwin \"$@\" || {{ code=$?; [ $code = 7 ] || return $code; }}; }}\n{script}"
    );
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

fn copy(from: &Path, to: &Path) {
    let copied = Command::new("cp")
        .arg("-r")
        .args([from, to])
        .status()
        .expect("cp starts");
    assert!(copied.success(), "{} is copied", from.display());
}

#[test]
fn the_readme() {
    let folder = tempfile::tempdir().expect("a folder");
    run("README.md", folder.path());
    for made in [
        "my-cohort/run/report.html",
        "my-cohort/run/export/ro-crate",
        "my-cohort/sweeps/robustness-data/results/robustness.html",
        "my-cohort/patients/P001/prepared/beats.svg",
        "my-cohort/patients/01-CoA/model.toml",
        "gsa/results/step2.toml",
    ] {
        assert!(folder.path().join(made).exists(), "{made}");
    }
}

#[test]
fn the_readmes_picture_of_a_report() {
    let folder = tempfile::tempdir().expect("a folder");
    shell(
        "the README's picture",
        "cardiotwin run examples/coa-seven",
        folder.path(),
    );
    let report = folder.path().join("examples/coa-seven/run/report.html");
    let shown = root().join("docs/images/report.png");
    report_picture::assert_is_of(&report, "01-CoA", &shown);
}

#[test]
fn a_first_cohort_in_ten_minutes() {
    let folder = tempfile::tempdir().expect("a folder");
    run("docs/first-cohort.md", folder.path());
    for made in [
        "prepared/P001/prepared/beats.svg",
        "my-cohort/run/report.html",
        "my-cohort/run/export/ro-crate",
    ] {
        assert!(folder.path().join(made).exists(), "{made}");
    }
}

#[test]
fn a_users_own_traces() {
    let folder = tempfile::tempdir().expect("a folder");
    run("docs/own-traces.md", folder.path());
    for made in [
        "own-cohort/run/report.html",
        "own-cohort/patients/traces/prepared/understood.svg",
        "better-cohort/patients/traces/patient.toml",
    ] {
        assert!(folder.path().join(made).exists(), "{made}");
    }
}

#[test]
fn a_patients_own_mesh() {
    let folder = tempfile::tempdir().expect("a folder");
    run("docs/own-anatomy.md", folder.path());
}

/// How-tos, each with `my-cohort` of the README, after its first run.
const HOW_TOS: [&str; 22] = [
    "docs/afterload.md",
    "docs/external-solvers.md",
    "docs/good-fit.md",
    "docs/housekeeping.md",
    "docs/missing-effects.md",
    "docs/models.md",
    "docs/operations.md",
    "docs/predict.md",
    "docs/prepare.md",
    "docs/privacy.md",
    "docs/remembered.md",
    "docs/report.md",
    "docs/robustness.md",
    "docs/settings.md",
    "docs/step1.md",
    "docs/step2.md",
    "docs/step3.md",
    "docs/sweeps.md",
    "examples/afterload/README.md",
    "examples/calcium/README.md",
    "examples/external-solver/README.md",
    "examples/hidden-effect/README.md",
];

#[test]
fn the_how_tos() {
    let prepared = tempfile::tempdir().expect("a folder");
    let script = "cardiotwin init my-cohort --example\ncardiotwin run my-cohort --fidelity reduced";
    shell("prelude", script, prepared.path());
    for page in HOW_TOS {
        let folder = tempfile::tempdir().expect("a folder");
        copy(
            &prepared.path().join("my-cohort"),
            &folder.path().join("my-cohort"),
        );
        run(page, folder.path());
        if page == "examples/hidden-effect/README.md" {
            let shown = root().join("docs/images/hidden-effect.svg");
            pictures::assert_drawn(&shown, &folder.path().join("hidden-effect.svg"));
        }
    }
}
