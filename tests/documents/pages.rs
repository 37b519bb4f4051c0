//! Order of the book: every page is in its table of contents, and every measurement has a date.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use regex::Regex;

use super::{documents, lines, name_of, read, root};

/// Files to which a page's links lead.
fn linked(file: &Path) -> BTreeSet<PathBuf> {
    let link = Regex::new(r"\]\(([^)#\s]+)").expect("a regular expression");
    let folder = file.parent().expect("a page lies in a folder");
    link.captures_iter(&read(file))
        .filter_map(|found| folder.join(&found[1]).canonicalize().ok())
        .collect()
}

#[test]
fn every_page_is_in_the_book() {
    let docs = root()
        .join("docs")
        .canonicalize()
        .expect("docs/ is a folder");
    let listed = linked(&docs.join("SUMMARY.md"));
    let missing: Vec<String> = documents()
        .iter()
        .map(|page| page.canonicalize().expect("a page"))
        .filter(|page| page.starts_with(&docs) && !page.ends_with("docs/SUMMARY.md"))
        .filter(|page| !listed.contains(page))
        .map(|page| page.display().to_string())
        .collect();
    assert!(
        missing.is_empty(),
        "pages that docs/SUMMARY.md does not list:\n  {}",
        missing.join("\n  ")
    );
}

#[test]
fn every_measurement_has_a_date_and_a_page_that_leads_to_it() {
    let date = Regex::new(r"^## (20\d\d-[01]\d-[0-3]\d)(?: to 20\d\d-[01]\d-[0-3]\d)?: ")
        .expect("a regular expression");
    let folder = root()
        .join("docs/measurements")
        .canonicalize()
        .expect("docs/measurements is a folder");
    let (measurements, others): (Vec<PathBuf>, Vec<PathBuf>) = documents()
        .into_iter()
        .map(|page| page.canonicalize().expect("a page"))
        .filter(|page| name_of(page) != "SUMMARY.md")
        .partition(|page| page.starts_with(&folder));
    let led_to: BTreeSet<PathBuf> = others.iter().flat_map(|page| linked(page)).collect();
    let mut problems = Vec::new();
    for page in measurements
        .iter()
        .filter(|page| name_of(page) != "README.md")
    {
        if !led_to.contains(page) {
            problems.push(format!("{}: no other page leads to it", page.display()));
        }
        let text = read(page);
        let headings: Vec<&str> = lines(&text, false)
            .into_iter()
            .map(|(_, line)| line)
            .filter(|line| line.starts_with("## "))
            .collect();
        let dates: Vec<String> = headings
            .iter()
            .filter_map(|heading| date.captures(heading))
            .map(|found| found[1].to_owned())
            .collect();
        if dates.is_empty() || dates.len() < headings.len() {
            problems.push(format!(
                "{}: an entry without a date among {headings:?}",
                page.display()
            ));
        }
        // A span of days counts with its first day, as for the figures of the whole program.
        if !dates.is_sorted_by(|newer, older| newer >= older) {
            problems.push(format!("{}: the newest entry is not first", page.display()));
        }
    }
    assert!(
        problems.is_empty(),
        "measurements:\n  {}",
        problems.join("\n  ")
    );
    assert!(measurements.len() > 10, "the measurements were read");
}

/// Paths of this repository in inline code exist, including alternatives such as `{a,b}`.
#[test]
fn files_of_the_repository_exist() {
    let inline = Regex::new(r"`([^`]+)`").expect("a regular expression");
    let path = Regex::new(r"^(?:solver|coordinator|worker|schemas|tests|deploy|\.ci)/[\w./{},-]+$")
        .expect("a regular expression");
    let choice = Regex::new(r"\{([^{}]+)\}").expect("a regular expression");
    let mut n_paths = 0;
    let mut problems = Vec::new();
    for file in documents() {
        // Changelog, decisions and measurements describe the past.
        let history = ["docs/decisions", "docs/measurements"]
            .iter()
            .any(|folder| file.starts_with(root().join(folder)));
        if history || name_of(&file) == "CHANGELOG.md" {
            continue;
        }
        let text = read(&file);
        for (number, line) in lines(&text, false) {
            for found in inline.captures_iter(line) {
                if !path.is_match(&found[1]) {
                    continue;
                }
                let all: Vec<String> = match choice.captures(&found[1]) {
                    Some(choices) => choices[1]
                        .split(',')
                        .map(|one| found[1].replace(&choices[0], one))
                        .collect(),
                    None => vec![found[1].to_owned()],
                };
                for path in all {
                    n_paths += 1;
                    // The page of `make verify` names tests of the mechanics relative to their
                    // crates.
                    let is_there = ["", "solver/mechanics", "dev/solver"]
                        .iter()
                        .any(|folder| root().join(folder).join(&path).exists());
                    if !is_there {
                        problems.push(format!("{}:{number}: {path}", file.display()));
                    }
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "files that are not there:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_paths > 20, "only {n_paths} paths were found");
}

/// A block of `cardiotwin` commands, to be run as printed, is tested by `tests/book.rs`, or says what
/// a test machine lacks.
#[test]
fn commands_to_be_typed_are_tested_or_say_what_they_need() {
    let tests = read(&root().join("tests/book.rs"));
    let mut problems = Vec::new();
    for page in documents() {
        let text = read(&page);
        let mut open: Option<&str> = None;
        for line in text.lines() {
            let fence = line.trim().strip_prefix("```");
            match (open, fence) {
                (None, Some(info)) => open = Some(info),
                (Some(_), Some(_)) => open = None,
                (Some(info), None) if line.starts_with("cardiotwin ") => {
                    let is_tested = info == "sh tested";
                    if !is_tested && !info.starts_with("sh needs ") {
                        problems.push(format!("{}: `{line}`", page.display()));
                    }
                    let name = page.strip_prefix(root()).unwrap_or(&page);
                    if is_tested && !tests.contains(&format!("\"{}\"", name.display())) {
                        problems.push(format!("{}: not in tests/book.rs", name.display()));
                    }
                }
                _ => {}
            }
        }
    }
    assert!(
        problems.is_empty(),
        "commands in blocks that are neither `sh tested` nor `sh needs …`:\n  {}",
        problems.join("\n  ")
    );
}
