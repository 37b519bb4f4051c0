//! Snapshots of every command's help and of the problems in a broken cohort.

use cardiotwin_input::{Options, Report, load};
use clap::CommandFactory as _;

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

/// Commands without subcommands, with their path.
fn leaves() -> Vec<(String, clap::Command)> {
    let mut commands = Vec::new();
    all(&super::Cli::command(), "", &mut commands);
    commands
        .into_iter()
        .filter(|(path, command)| {
            !path.is_empty() && !command.has_subcommands() && !command.is_hide_set()
        })
        .map(|(path, command)| (path.trim().to_owned(), command))
        .collect()
}

fn takes(command: &clap::Command, option: &str) -> bool {
    command
        .get_arguments()
        .any(|argument| argument.get_long() == Some(option))
}

/// Commands that print neither a table nor figures: a path, lines of another program, a sentence.
const WITHOUT_JSON: [&str; 12] = [
    "backup",
    "cancel",
    "completions",
    "dashboard",
    "logs",
    "man",
    "report",
    "rerun",
    "retry",
    "schemas",
    "sweep cancel",
    "sweep report",
];

#[test]
fn every_command_with_a_table_has_json() {
    let without: Vec<String> = leaves()
        .into_iter()
        .filter(|(_, command)| !takes(command, "json"))
        .map(|(path, _)| path)
        .collect();
    let mut without: Vec<&str> = without.iter().map(String::as_str).collect();
    without.sort_unstable();
    assert_eq!(
        without, WITHOUT_JSON,
        "a command that prints a table needs --json; one that does not is listed here"
    );
}

/// Commands that make a page for a browser.
const PAGES: [&str; 10] = [
    "dashboard",
    "discover",
    "init",
    "predict",
    "prepare",
    "report",
    "run",
    "sweep gsa",
    "sweep report",
    "sweep robustness",
];

#[test]
fn every_command_with_a_page_opens_it() {
    let mut with = Vec::new();
    for (path, command) in leaves() {
        if takes(&command, "open") {
            with.push(path);
            continue;
        }
        let about = command
            .get_about()
            .map(ToString::to_string)
            .unwrap_or_default();
        assert!(
            !["HTML", " page"].iter().any(|word| about.contains(word)) || path == "man",
            "{path} makes a page: it needs --open"
        );
    }
    with.sort_unstable();
    assert_eq!(with, PAGES);
}

#[test]
fn help_of_every_command() {
    let mut root = super::groups::grouped(super::Cli::command(), 100).term_width(100);
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
