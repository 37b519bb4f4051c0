//! The architecture as a test: what Cargo cannot check. The page's table and picture of crates, names and dependencies that
//! are refused (`architecture/refusals.rs`), circles of files, and the length of files. A failure names the file, the line, the
//! rule and its reason.

#[path = "architecture/circles.rs"]
mod circles;
#[path = "architecture/picture.rs"]
mod picture;
#[path = "architecture/refusals.rs"]
mod refusals;
#[path = "architecture/scan.rs"]
mod scan;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use refusals::FOR_TESTS;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_owned()
}

/// Every file below `folder`, except for version control, build folders and runs of a cohort.
/// Cargo marks a build folder with a CACHEDIR.TAG only if it makes the folder itself.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder)
            .unwrap_or_else(|e| panic!("cannot read {}: {e}", folder.display()));
        for entry in entries {
            let path = entry.expect("an entry of a folder that can be read").path();
            let name = path
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned();
            if path.is_symlink() {
                continue;
            }
            if !path.is_dir() {
                found.push(path);
            } else if name != ".git"
                && path != root().join("target")
                && !path.join("CACHEDIR.TAG").exists()
                && !path.join("cardiotwin.db").exists()
            {
                folders.push(path);
            }
        }
    }
    found.sort();
    found
}

/// Files of a clone according to git; without git, all files of the working tree.
fn committed_files() -> Vec<PathBuf> {
    let listing = std::process::Command::new("git")
        .args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ])
        .current_dir(root())
        .output();
    let mut found: Vec<PathBuf> = match listing {
        Ok(listing) if listing.status.success() && !listing.stdout.is_empty() => {
            String::from_utf8_lossy(&listing.stdout)
                .split_terminator('\0')
                .map(|name| root().join(name))
                .filter(|file| file.is_file())
                .collect()
        }
        _ => files(&root()),
    };
    found.sort();
    found
}

fn rust_files(folder: &str) -> Vec<(String, String)> {
    let folder = root().join(folder);
    let mut found = Vec::new();
    for file in committed_files() {
        if file.starts_with(&folder) && file.extension().is_some_and(|e| e == "rs") {
            let text = std::fs::read_to_string(&file).expect("Rust source is UTF-8");
            let name = file
                .strip_prefix(root())
                .expect("a file of the workspace")
                .to_string_lossy()
                .into_owned();
            found.push((name, text));
        }
    }
    found
}

fn is_dev(dependency: &cargo_metadata::Dependency) -> bool {
    dependency.kind == cargo_metadata::DependencyKind::Development
}

fn none(problems: Vec<String>, what: &str) {
    assert!(problems.is_empty(), "{what}:\n  {}", problems.join("\n  "));
}

/// Name of a crate in the table: `cardiotwin-units` is `units`, `cardiotwin` is `cli`.
fn short(crate_name: &str) -> Option<&str> {
    if crate_name == "cardiotwin" {
        Some("cli")
    } else {
        crate_name.strip_prefix("cardiotwin-")
    }
}

fn page() -> String {
    std::fs::read_to_string(root().join("docs/architecture.md")).expect("docs/architecture.md")
}

/// Crates in the page's table, in its order, each with those that it may import.
fn table() -> Vec<(String, Vec<String>)> {
    let page = page();
    let (_, rows) = page
        .split_once("| crate | may import (of ours) | so that |\n|---|---|---|\n")
        .expect("the table of crates");
    let rows = rows.lines().take_while(|line| line.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        let [_, who, may, why, _] = cells[..] else {
            panic!("not a row of three cells: {row}");
        };
        assert!(why.len() > 5, "a row without its reason: {row}");
        let may = may.split(", ").filter(|name| *name != "nothing");
        (
            who.trim_matches('`').to_owned(),
            may.map(str::to_owned).collect(),
        )
    })
    .collect()
}

fn packages() -> Vec<cargo_metadata::Package> {
    cargo_metadata::MetadataCommand::new()
        .manifest_path(root().join("Cargo.toml"))
        .no_deps()
        .exec()
        .expect("cargo metadata describes the workspace")
        .packages
}

/// The page's table has a row for each crate, with exactly the imports of its manifest.
#[test]
fn the_page_lists_the_imports_of_every_crate() {
    let mut rows: BTreeMap<String, Vec<String>> = table().into_iter().collect();
    let mut problems = Vec::new();
    for package in packages() {
        let Some(name) = short(package.name.as_str()) else {
            problems.push(format!("crate {} is not called cardiotwin-…", package.name));
            continue;
        };
        let used: BTreeSet<String> = package
            .dependencies
            .iter()
            .filter_map(|dependency| {
                let used = short(&dependency.name)?;
                let is_free = FOR_TESTS.contains(&used) && (name == "tests" || is_dev(dependency));
                (!is_free).then(|| used.to_owned())
            })
            .collect();
        let row = rows.remove(name);
        if row.map(BTreeSet::from_iter).as_ref() != Some(&used) {
            let used: Vec<String> = used.into_iter().collect();
            problems.push(format!("{name}: its manifest says {}", used.join(", ")));
        }
    }
    problems.extend(
        rows.into_keys()
            .map(|name| format!("{name}: no such crate")),
    );
    none(
        problems,
        "the table of crates in docs/architecture.md differs from the manifests: give a new arrow its reason there",
    );
}

#[test]
fn crates_do_not_depend_on_what_is_refused_to_them() {
    let mut problems = Vec::new();
    for package in packages() {
        let is_solver = package.manifest_path.starts_with(root().join("solver"));
        for dependency in package
            .dependencies
            .iter()
            .filter(|dependency| !is_dev(dependency))
        {
            let name = dependency.name.as_str();
            let is_sql = name == "sqlx" && !refusals::WITH_SQL.contains(&package.name.as_str());
            if is_sql || is_solver && refusals::NOT_FOR_SOLVERS.contains(&name) {
                problems.push(format!("{} depends on {name}", package.name));
            }
        }
    }
    none(problems, "dependencies that are refused");
}

/// Developers' tools are another workspace, whose outputs lie in the same folder: profiles that differ would compile every
/// dependency twice.
#[test]
fn both_workspaces_have_the_same_lints_and_profiles() {
    let [ours, dev] = ["Cargo.toml", "dev/Cargo.toml"].map(|file| {
        let text = std::fs::read_to_string(root().join(file)).expect("a manifest");
        let manifest: toml::Table = text.parse().expect("a manifest is TOML");
        let mut profiles = manifest["profile"].clone();
        // Each workspace names those of its own members that the other lacks.
        let packages = profiles["release"]["package"]
            .as_table_mut()
            .expect("packages");
        packages.retain(|name, _| !["cardiotwin-dev", "cardiotwin-tests"].contains(&name));
        (manifest["workspace"]["lints"].clone(), profiles)
    });
    assert_eq!(ours, dev);
}

/// `solver/mesh/src/checks/mod.rs` in `solver/mesh/src` is the module `checks`.
fn module_in(source: &str, file: &str) -> Vec<String> {
    let path = file
        .trim_start_matches(source)
        .trim_start_matches('/')
        .trim_end_matches(".rs");
    path.split('/')
        .filter(|part| !matches!(*part, "mod" | "lib" | "main"))
        .map(str::to_owned)
        .collect()
}

/// Files that use each other can only be read together.
#[test]
fn files_of_a_crate_do_not_use_each_other_in_circles() {
    let mut problems = Vec::new();
    for package in packages() {
        let folder = package
            .manifest_path
            .parent()
            .expect("a manifest lies in a folder");
        let folder = folder
            .as_std_path()
            .strip_prefix(root())
            .expect("of the workspace");
        let source = folder.join("src").to_string_lossy().into_owned();
        let files = rust_files(&source).into_iter();
        // Programs use the library from outside.
        let of_library =
            files.filter(|(file, _)| !file.ends_with("src/main.rs") && !file.contains("/src/bin/"));
        let by_module = of_library.map(|(file, text)| (module_in(&source, &file), (file, text)));
        let found = circles::circles(by_module.collect());
        let name = short(package.name.as_str()).unwrap_or_default();
        problems.extend(
            found
                .iter()
                .map(|circle| format!("crate {name}: {}", circle.join(" "))),
        );
    }
    none(problems, "circles of files");
}

#[test]
fn places_do_not_use_the_foreign_names_refused_there() {
    let mut problems = Vec::new();
    for refusal in refusals::REFUSALS {
        for (file, text) in rust_files(refusal.folder) {
            // Tests, benchmarks and examples of a crate may measure time and read anything.
            let is_free = refusal
                .except
                .is_some_and(|except| file.starts_with(except));
            if is_free || !file.contains("/src/") {
                continue;
            }
            for path in scan::paths(&text).iter().filter(|path| !path.in_tests) {
                let name = path.names.join("::");
                let hit = refusal
                    .paths
                    .iter()
                    .find(|refused| name == **refused || name.starts_with(&format!("{refused}::")));
                if let Some(refused) = hit {
                    problems.push(format!(
                        "{file}:{}: `{name}`: {refused} is refused here, so that {}",
                        path.line, refusal.why
                    ));
                }
            }
        }
    }
    for (file, text) in rust_files("solver") {
        let calls = scan::paths(&text)
            .into_iter()
            .filter(|path| path.is_macro && !path.in_tests);
        for path in calls.filter(|_| file.contains("/src/")) {
            if refusals::SOLVER_MACROS.contains(&path.names[path.names.len() - 1].as_str()) {
                problems.push(format!(
                    "{file}:{}: {}! in a solver: numerics do not print",
                    path.line,
                    path.names.join("::")
                ));
            }
        }
    }
    none(problems, "foreign names where they are refused");
}

#[test]
fn no_code_is_unfinished_or_switched_off() {
    let mut problems = Vec::new();
    for (file, text) in rust_files("") {
        for path in scan::paths(&text) {
            if path.is_macro
                && matches!(
                    path.names[path.names.len() - 1].as_str(),
                    "todo" | "unimplemented"
                )
            {
                problems.push(format!("{file}:{}: {}!", path.line, path.names.join("::")));
            }
        }
        let tokens = scan::tokens(&text);
        for window in tokens.windows(3) {
            let [(line, hash), (_, bracket), (_, name)] = window else {
                unreachable!("windows of three")
            };
            if *hash == scan::Token::Sign('#')
                && *bracket == scan::Token::Sign('[')
                && *name == scan::Token::Name("ignore".into())
            {
                problems.push(format!(
                    "{file}:{line}: #[ignore]: a test that does not run proves nothing"
                ));
            }
        }
    }
    none(problems, "unfinished or switched-off code");
}

#[test]
fn files_keep_to_one_subject() {
    let mut problems = Vec::new();
    for (file, text) in rust_files("") {
        let n_lines = text.lines().count();
        if n_lines > refusals::LONGEST_FILE {
            problems.push(format!(
                "{file}: {n_lines} lines, more than {}: name its second half",
                refusals::LONGEST_FILE
            ));
        }
    }
    none(problems, "files that have outgrown one subject");
}

/// A clone must make sense anywhere: no absolute path of a single machine, and no folder next to the
/// repository.
#[test]
fn nothing_points_outside_the_repository() {
    // The words are split so that this file does not contain what it searches for.
    let refused = [
        concat!("/wo", "rk/"),
        concat!("../sha", "red/"),
        concat!("/ho", "me/"),
        concat!(".lib", "rary/"),
        concat!("farm", "-"),
    ];
    let mut problems = Vec::new();
    for file in committed_files() {
        if file.file_name().is_some_and(|name| name == "Cargo.lock") {
            continue;
        }
        let Ok(text) = std::fs::read_to_string(&file) else {
            continue;
        }; // a picture, or a deleted file
        for (index, line) in text.lines().enumerate() {
            for word in refused {
                let hit = line.match_indices(word).any(|(at, _)| {
                    // In the middle of a longer path the word is an ordinary folder; at the start
                    // it is a place on one machine.
                    !line[..at].ends_with(|c: char| {
                        c.is_alphanumeric() || matches!(c, '_' | '}' | '$' | '.' | '~')
                    })
                });
                if hit {
                    problems.push(format!(
                        "{}:{}: {word}",
                        file.strip_prefix(root()).expect("ours").display(),
                        index + 1
                    ));
                }
            }
        }
    }
    none(problems, "places that only one machine has");
}

/// The picture of the house is made from the table, and the map next to it names every crate's folder.
#[test]
fn the_document_draws_the_house_as_it_stands() {
    let document = page();
    let picture = picture::storeys(&table());
    assert!(
        document.contains(&picture),
        "docs/architecture.md lacks this picture:\n{picture}"
    );
    let (_, map) = document.split_once("## The map").expect("a map");
    let map: &str = map
        .split("```")
        .nth(1)
        .and_then(|block| block.strip_prefix("text"))
        .expect("a block with the map");
    let mut folder = String::new();
    let mut drawn = BTreeSet::new();
    for line in map.lines().filter(|line| !line.trim().is_empty()) {
        let name = line.split_whitespace().next().expect("a name");
        if line.starts_with(' ') {
            drawn.insert(format!("{folder}{}", name.trim_end_matches('/')));
        } else {
            name.clone_into(&mut folder);
            drawn.insert(name.trim_end_matches('/').to_owned());
        }
    }
    for path in &drawn {
        assert!(root().join(path).exists(), "the map names {path}");
    }
    let manifest = std::fs::read_to_string(root().join("Cargo.toml")).expect("Cargo.toml");
    let (_, members) = manifest.split_once("members = [").expect("members");
    for member in members
        .split(']')
        .next()
        .unwrap_or_default()
        .split('"')
        .skip(1)
        .step_by(2)
    {
        assert!(drawn.contains(member), "the map does not name {member}");
    }
}

/// Tests the reader of circles: it follows re-exports, `super`, groups and globs, and ignores tests.
#[test]
fn circles_are_seen_through_re_exports() {
    let file = |module: &str, text: &str| {
        let names = module.split("::").filter(|name| !name.is_empty());
        let module: Vec<String> = names.map(str::to_owned).collect();
        (module, (String::new(), text.to_owned()))
    };
    let found = circles::circles(
        [
            file(
                "",
                "mod a; pub mod b; mod c; mod d; #[cfg(test)] mod tests;",
            ),
            file("a", "mod inner; pub use inner::Thing; use crate::b::B;"),
            file(
                "a::inner",
                "pub struct Thing; #[cfg(test)] mod tests { use crate::b::B; }",
            ),
            file("b", "use crate::a::Thing as Other; pub struct B;"),
            file("c", "use super::{b::B, d::*};"),
            file("d", "fn f() { crate::c::g() }"),
            file("tests", "use crate::c::g; use crate::d::f;"),
        ]
        .into(),
    );
    assert_eq!(found, [["c", "d"]]);
}

/// Tests the reader of sources, on which every rule depends.
#[test]
fn the_reader_sees_through_groups_comments_literals_and_modules() {
    let source = r##"
        // crate::comment
        /* crate::block /* crate::nested */ */
        use crate::{engine::Loop, store::{self, Event}};
        const TEXT: &str = "crate::string \" crate::more";
        const RAW: &str = r#"crate::raw"#;
        fn f<'a>(x: &'a str) -> char { crate::report::draw(x); println!("{x}"); 'c' }
        #[cfg(test)]
        mod tests { use super::super::cli; fn g() { std::time::Instant::now(); } }
    "##;
    let paths = scan::paths(source);
    let module = vec!["machine".to_owned()];
    let reached: Vec<String> = paths
        .iter()
        .filter_map(|path| scan::absolute(path, &module))
        .map(|path| path.join("::"))
        .collect();
    assert_eq!(
        reached,
        [
            "engine::Loop",
            "store::self",
            "store::Event",
            "report::draw",
            "cli"
        ]
    );
    let names = |path: &scan::Path| path.names.join("::");
    assert!(
        paths.iter().any(|path| path.is_macro
            && names(path) == "println"
            && !path.in_tests
            && path.line == 7)
    );
    assert!(
        paths
            .iter()
            .any(|path| names(path) == "std::time::Instant::now"
                && path.in_tests
                && path.modules == ["tests"])
    );
}
