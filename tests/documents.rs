//! Claims of the documents: links lead to files and headings, and commands, flags, settings,
//! defaults, error messages and files are those of the program and the repository.

#[path = "documents/commands.rs"]
mod commands;
#[path = "documents/pages.rs"]
mod pages;
#[path = "documents/settings.rs"]
mod settings;
#[path = "documents/texts.rs"]
mod texts;
#[path = "documents/worked_changes.rs"]
mod worked_changes;

mod built;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

use texts::{documents, lines, name_of, read, root};

/// Anchors that GitHub makes from headings, and explicit ones.
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

/// Help of one of the project's programs, built next to this test.
fn help(program: &str, arguments: &[&str]) -> Option<String> {
    let output = Command::new(built::binary(program))
        .args(arguments)
        .arg("--help")
        .output()
        .expect("the program starts");
    output
        .status
        .success()
        .then(|| String::from_utf8(output.stdout).expect("help is UTF-8"))
}

/// The two programs of users have each command and flag that the documents show. A test of `dev/`
/// looks at developers' program in the same way.
#[test]
fn commands_and_their_flags_exist() {
    commands::assert_that_they_exist(&["cardiotwin", "cardiotwin-worker"], &help);
}

/// Help of a program, its commands and their subcommands.
fn helps_below(program: &str, words: &mut Vec<String>, found: &mut Vec<String>) {
    let arguments: Vec<&str> = words.iter().map(String::as_str).collect();
    let text = help(program, &arguments).expect("a listed command has a help");
    // Commands stand under one heading or several, before the options.
    let commands: Vec<String> = text
        .lines()
        .take_while(|line| *line != "Options:")
        .filter(|line| line.starts_with("  ") && line[2..].starts_with(|c: char| c.is_lowercase()))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|command| *command != "help")
        .map(str::to_owned)
        .collect();
    found.push(text);
    for command in commands {
        words.push(command);
        helps_below(program, words, found);
        words.pop();
    }
}

/// Whether a text contains a flag other than as the beginning of a longer one.
fn has_flag(text: &str, flag: &str) -> bool {
    text.match_indices(flag).any(|(at, _)| {
        text[at + flag.len()..]
            .chars()
            .next()
            .is_none_or(|next| !next.is_ascii_alphanumeric() && next != '-')
    })
}

/// Each flag in inline code belongs to one of the project's programs, or to a foreign program that
/// is listed here.
#[test]
fn flags_in_prose_exist() {
    // Calls of these programs have flags of their own. The list below has flags of MPI, Slurm and
    // openCARP that pages explain.
    const PROGRAMS: [&str; 3] = ["cargo ", "squeue ", "sbatch "];
    const FOREIGN: [&str; 13] = [
        // Of sbatch.
        "--exclude",
        "--reservation",
        "--exact",
        "--nodelist",
        "--host",
        "--bind-to",
        "--mca",
        "--mpi",
        "--kill-on-bad-exit",
        "--oversubscribe",
        "--duplicates",
        "--format",
        "--plugin-info",
    ];
    let mut helps = Vec::new();
    for program in ["cardiotwin", "cardiotwin-worker"] {
        helps_below(program, &mut Vec::new(), &mut helps);
    }
    // Programs that this build does not make: the worker on MPI ranks, scripts, developers' tools,
    // examples of the solver.
    let mut sources = vec![read(&root().join("worker/src/mpi_main.rs"))];
    for folder in ["worker/src/mpi", "deploy", "dev", "solver/models/examples"] {
        texts(&root().join(folder), &mut sources);
    }
    let inline = regex::Regex::new(r"`([^`]+)`").expect("a regular expression");
    let flag = regex::Regex::new(r"(?:^|[ \[])(--[a-z][a-z0-9-]+)").expect("a regular expression");
    let mut n_flags = 0;
    let mut problems = Vec::new();
    for file in documents() {
        if name_of(&file) == "CHANGELOG.md" {
            continue;
        }
        for (number, line) in lines(&read(&file), false) {
            for code in inline.captures_iter(line) {
                if PROGRAMS.iter().any(|program| code[1].contains(program)) {
                    continue;
                }
                for found in flag.captures_iter(&code[1]) {
                    n_flags += 1;
                    let flag = &found[1];
                    let field = format!("{}:", flag.trim_start_matches('-').replace('-', "_"));
                    if !FOREIGN.contains(&flag)
                        && !helps.iter().any(|help| has_flag(help, flag))
                        && !sources
                            .iter()
                            .any(|text| has_flag(text, flag) || text.contains(&field))
                    {
                        problems.push(format!("{}:{number}: {flag}", file.display()));
                    }
                }
            }
        }
    }
    assert!(
        problems.is_empty(),
        "flags that no program has:\n  {}",
        problems.join("\n  ")
    );
    assert!(n_flags > 100, "only {n_flags} flags were found");
}

/// Texts of all files of a folder and its subfolders.
fn texts(folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder)
        .expect("a folder of the repository")
        .flatten()
    {
        let path = entry.path();
        if path.is_dir() {
            texts(&path, found);
        } else if let Ok(text) = std::fs::read_to_string(&path) {
            found.push(text);
        }
    }
}

/// Each of the project's environment variables in the documents is read by some source.
#[test]
fn environment_variables_exist() {
    let mut files = Vec::new();
    for folder in ["coordinator", "worker", "tests"] {
        sources(&root().join(folder), &mut files);
    }
    let known: String = files.iter().map(|file| read(file)).collect();
    let variable = regex::Regex::new("CARDIOTWIN_[A-Z_]+").expect("a regular expression");
    let mut n_variables = 0;
    for file in documents() {
        for found in variable.find_iter(&read(&file)) {
            n_variables += 1;
            assert!(
                known.contains(&format!("\"{}\"", found.as_str())),
                "{}: nothing reads {}",
                file.display(),
                found.as_str()
            );
        }
    }
    assert!(n_variables > 3, "the pages name variables");
}

/// Rust files of a folder and its subfolders.
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

/// The page of error messages lists every message of the programs' error types, with the cause and
/// the remedy.
#[test]
fn error_messages_have_their_remedies() {
    let page = read(&root().join("docs/errors.md"));
    let told: BTreeSet<&str> = page
        .lines()
        .filter_map(|line| line.strip_prefix("| `")?.split_once("` | "))
        .filter(|(_, rest)| {
            let cells: Vec<&str> = rest.trim_end_matches('|').split(" | ").collect();
            cells.len() == 2 && cells.iter().all(|cell| cell.trim().len() > 5)
        })
        .map(|(message, _)| message)
        .collect();
    let attribute =
        regex::Regex::new(r#"(?s)#\[error\(\s*"((?:[^"\\]|\\.)*)""#).expect("a regular expression");
    let continued = regex::Regex::new(r"\\\n\s*").expect("a regular expression");
    let mut files = Vec::new();
    for folder in ["coordinator", "worker", "schemas", "solver"] {
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
        "not on docs/errors.md, or not with what happened and what to do:\n  {}",
        missing.join("\n  ")
    );
    assert!(n_messages > 200, "the sources were read");
}

/// The table of formats is that of the code, row by row.
#[test]
fn formats_stand_with_their_versions() {
    use cardiotwin_schemas::formats::{ALL, ANSWERS};
    let page = read(&root().join("docs/formats.md"));
    let rows: Vec<&str> = page
        .lines()
        .skip_while(|line| !line.starts_with("| format | version |"))
        .skip(2)
        .take_while(|line| line.starts_with('|'))
        .collect();
    let row = |format: &cardiotwin_schemas::formats::Format| {
        let (name, version) = (format.name, format.version);
        let (place, writer, reader) = (format.place, format.writer, format.reader);
        format!("| {name} | {version} | {place} | {writer} | {reader} |")
    };
    let expected: Vec<String> = ALL.iter().chain(ANSWERS).map(row).collect();
    assert_eq!(rows, expected);
}
