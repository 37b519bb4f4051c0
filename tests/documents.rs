//! What the documents say exists: links lead to files and headings, `make` targets and `cardiotwin` commands are real.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_owned()
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("cannot read {}: {e}", path.display()))
}

/// README and its like, and everything under docs/.
fn documents() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for folder in [
        root(),
        root().join("docs"),
        root().join("docs/decisions"),
        root().join("docs/effects"),
    ] {
        for entry in std::fs::read_dir(folder).expect("a folder of the repository") {
            let path = entry.expect("an entry").path();
            if path.extension().is_some_and(|extension| extension == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Lines inside fenced code blocks, or outside of them.
fn lines(text: &str, fenced: bool) -> Vec<(usize, &str)> {
    let mut inside = false;
    let mut found = Vec::new();
    for (index, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            inside = !inside;
        } else if inside == fenced {
            found.push((index + 1, line));
        }
    }
    found
}

/// Anchors as GitHub makes them from headings, and explicit ones.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for (_, line) in lines(text, false) {
        if let Some(heading) = line
            .strip_prefix('#')
            .map(|rest| rest.trim_start_matches('#').trim())
        {
            let kept = heading
                .to_lowercase()
                .chars()
                .filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'))
                .collect::<String>();
            found.insert(kept.replace(' ', "-"));
        }
        if let Some(id) = line
            .strip_prefix("<a id=\"")
            .and_then(|rest| rest.split('"').next())
        {
            found.insert(id.to_owned());
        }
    }
    found
}

#[test]
fn links_lead_somewhere() {
    let link = regex::Regex::new(r"\]\(([^)\s]+)\)").expect("a regular expression");
    let mut problems = Vec::new();
    for file in documents() {
        let text = read(&file);
        for (number, line) in lines(&text, false) {
            for target in link.captures_iter(line).map(|found| found[1].to_owned()) {
                if target.contains("://") || target.starts_with("mailto:") {
                    continue;
                }
                let (path, anchor) = target.split_once('#').unwrap_or((&target, ""));
                let goal = if path.is_empty() {
                    file.clone()
                } else {
                    file.parent().expect("a folder").join(path)
                };
                let good =
                    goal.exists() && (anchor.is_empty() || anchors(&read(&goal)).contains(anchor));
                if !good {
                    problems.push(format!("{}:{number}: {target}", file.display()));
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "links that lead nowhere:\n  {}",
        problems.join("\n  ")
    );
}

#[test]
fn make_targets_exist() {
    let makefile = read(&root().join("Makefile"));
    let targets: BTreeSet<&str> = makefile
        .lines()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_lowercase()))
        .filter_map(|line| line.split_once(':').map(|(target, _)| target))
        .collect();
    let call =
        regex::Regex::new(r"(?:^|`|&& |time )make ([a-z][a-z-]*)").expect("a regular expression");
    let mut n_calls = 0;
    for file in documents() {
        for found in call.captures_iter(&read(&file)) {
            n_calls += 1;
            assert!(
                targets.contains(&found[1]),
                "{}: `make {}`, but the Makefile has {targets:?}",
                file.display(),
                &found[1]
            );
        }
    }
    assert!(
        n_calls > 3,
        "README and CONTRIBUTING show `make demo` and `make test`"
    );
}

/// Help of one of our programs, built beside this test.
fn help(program: &str, arguments: &[&str]) -> Option<String> {
    let this = std::env::current_exe().expect("this test has a path");
    let file = this
        .parent()
        .and_then(Path::parent)
        .expect("tests lie in deps/, programs above")
        .join(program);
    assert!(
        file.exists(),
        "{} is missing: cargo build --release --locked --workspace --bins",
        file.display()
    );
    let output = Command::new(&file)
        .args(arguments)
        .arg("--help")
        .output()
        .expect("the program starts");
    output
        .status
        .success()
        .then(|| String::from_utf8(output.stdout).expect("help is UTF-8"))
}

/// Each `cardiotwin COMMAND … --flag` of the documents is known to the program that is built from this tree.
#[test]
fn commands_and_their_flags_exist() {
    // In code, fenced or inline, where a placeholder like DIR or … ends what can be checked.
    let call = regex::Regex::new(
        r"(?m)(?:^|[`/ ])(cardiotwin(?:-worker)?) ([a-z][a-z-]+)((?: [^`\n#]*)?)",
    )
    .expect("a regular expression");
    let flag = regex::Regex::new(r"(?:^|[ \[])(--[a-z][a-z-]+)").expect("a regular expression");
    let inline = regex::Regex::new(r"`([^`]+)`").expect("a regular expression");
    let mut helps: BTreeMap<String, Option<String>> = BTreeMap::new();
    let mut problems = Vec::new();
    for file in documents() {
        let text = read(&file);
        let mut code: Vec<(usize, String)> = lines(&text, true)
            .into_iter()
            .map(|(number, line)| (number, line.to_owned()))
            .collect();
        for (number, line) in lines(&text, false) {
            code.extend(
                inline
                    .captures_iter(line)
                    .map(|found| (number, found[1].to_owned())),
            );
        }
        for (number, line) in code {
            for found in call.captures_iter(&line) {
                let (program, command, rest) = (&found[1], &found[2], &found[3]);
                let mut words = vec![command];
                let place = format!("{}:{number}", file.display());
                let mut known = helps
                    .entry(format!("{program} {command}"))
                    .or_insert_with(|| help(program, &words))
                    .clone();
                // `config show`: a command of commands.
                if let (Some(text), Some(second)) = (&known, rest.split_whitespace().next())
                    && text.contains("Commands:")
                {
                    words.push(second);
                    let key = format!("{program} {}", words.join(" "));
                    known = helps
                        .entry(key)
                        .or_insert_with(|| help(program, &words))
                        .clone();
                }
                let command = words.join(" ");
                let Some(known) = known else {
                    problems.push(format!("{place}: {program} has no command {command}"));
                    continue;
                };
                for flag in flag.captures_iter(rest) {
                    if !known.contains(&flag[1]) {
                        problems.push(format!("{place}: {program} {command} has no {}", &flag[1]));
                    }
                }
            }
        }
    }
    assert!(
        helps.len() > 8,
        "the documents show commands, but only {:?} were found",
        helps.keys()
    );
    assert!(
        problems.is_empty(),
        "commands that do not exist:\n  {}",
        problems.join("\n  ")
    );
}

/// Rust files of a folder.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder)
        .expect("a folder of the repository")
        .flatten()
    {
        let path = entry.path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Every message of an error type of the programs stands on the page of error messages, with its remedy.
#[test]
fn error_messages_have_their_remedies() {
    let page = read(&root().join("docs/errors.md"));
    // A row with a remedy, or an item of a list whose heading has one.
    let told: BTreeSet<&str> = page
        .lines()
        .filter_map(|line| match line.strip_prefix("| `") {
            Some(row) => row
                .split_once("` | ")
                .filter(|(_, remedy)| remedy.trim_end_matches('|').trim().len() > 5),
            None => line
                .strip_prefix("- `")
                .and_then(|item| item.split_once('`')),
        })
        .map(|(message, _)| message)
        .collect();
    let attribute =
        regex::Regex::new(r#"#\[error\(\s*"((?:[^"\\]|\\.)*)""#).expect("a regular expression");
    let continued = regex::Regex::new(r"\\\n\s*").expect("a regular expression");
    let mut files = Vec::new();
    for folder in [
        "coordinator/src",
        "coordinator/slurm/src",
        "worker/src",
        "solver",
    ] {
        sources(&root().join(folder), &mut files);
    }
    let mut missing = BTreeSet::new();
    let mut n_messages = 0;
    for file in files {
        for found in attribute.captures_iter(&read(&file)) {
            let message = continued
                .replace_all(&found[1], "")
                .replace("\\\"", "\"")
                .replace('`', "'")
                .replace('|', "\\|");
            n_messages += 1;
            if !told.contains(message.as_str()) {
                missing.insert(format!("{}: {message}", file.display()));
            }
        }
    }
    let missing: Vec<String> = missing.into_iter().collect();
    assert!(
        missing.is_empty(),
        "not on docs/errors.md, or without a remedy:\n  {}",
        missing.join("\n  ")
    );
    assert!(n_messages > 200, "the sources were read");
}
