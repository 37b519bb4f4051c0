//! Snapshots of every command's help and of the problems in a broken cohort.

use cardiotwin_input::{Options, Report, load};

use super::command;
use crate::problems;

/// Collects all commands, including nested subcommands, with their path.
fn all(command: &clap::Command, path: &str, out: &mut Vec<(String, clap::Command)>) {
    out.push((path.to_owned(), command.clone()));
    for inner in command
        .get_subcommands()
        .filter(|inner| inner.get_name() != "help")
    {
        all(inner, &format!("{path} {}", inner.get_name()), out);
    }
}

#[test]
fn arguments_are_consistent() {
    command().debug_assert();
}

#[test]
fn help_of_every_command() {
    let mut root = command().term_width(100);
    root.build();
    let mut commands = Vec::new();
    all(&root, "cardiotwin", &mut commands);
    let mut text = String::new();
    for (path, mut command) in commands {
        text.push_str(&format!(
            "$ {path} --help\n{}\n",
            command.render_long_help()
        ));
    }
    let text: String = text
        .lines()
        .map(|line| format!("{}\n", line.trim_end()))
        .collect();
    insta::assert_snapshot!(text);
}

#[test]
fn problems_of_the_broken_cohort() {
    let directory = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/fixtures/broken-cohort"
    );
    let mut report = Report::default();
    load(directory.as_ref(), &Options::default(), &mut report);
    let text = problems::text(&report, false, true).replace(directory, "broken-cohort");
    insta::assert_snapshot!(text);
}

#[test]
fn completions_and_manual_pages_cover_every_command() {
    let mut bash = Vec::new();
    clap_complete::generate(
        clap_complete::Shell::Bash,
        &mut command(),
        "cardiotwin",
        &mut bash,
    );
    let bash = String::from_utf8(bash).unwrap();
    let folder = tempfile::tempdir().unwrap();
    clap_mangen::generate_to(command(), folder.path()).unwrap();
    for inner in command()
        .get_subcommands()
        .filter(|inner| !inner.is_hide_set())
    {
        let name = inner.get_name();
        assert!(
            bash.contains(&format!("cardiotwin__subcmd__{name}"))
                || bash.contains(&format!("cardiotwin__{name}")),
            "{name}"
        );
        assert!(
            folder.path().join(format!("cardiotwin-{name}.1")).exists(),
            "{name}"
        );
    }
}
