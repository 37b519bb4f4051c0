//! Pages of the repository, for tests that compare them with programs and sources.

use std::path::{Path, PathBuf};

/// Folder of the repository.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .expect("tests/ lies in the workspace")
        .to_owned()
}

/// Text of a file.
pub fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_else(|e| panic!("cannot read {}: {e}", path.display()))
}

/// Markdown pages of a folder and its subfolders.
fn pages_below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder of the repository") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            pages_below(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
}

/// Pages at the root such as README, everything under docs/, and the pages of the examples.
pub fn documents() -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root()).expect("the repository's folder") {
        let path = entry.expect("an entry").path();
        if path.extension().is_some_and(|extension| extension == "md") {
            found.push(path);
        }
    }
    pages_below(&root().join("docs"), &mut found);
    for entry in std::fs::read_dir(root().join("examples")).expect("examples/ is a folder") {
        let page = entry.expect("an entry").path().join("README.md");
        if page.exists() {
            found.push(page);
        }
    }
    found.sort();
    found
}

/// File name of a page.
pub fn name_of(page: &Path) -> &str {
    page.file_name()
        .and_then(std::ffi::OsStr::to_str)
        .expect("a page has a name")
}

/// Lines inside fenced code blocks, or outside of them.
pub fn lines(text: &str, fenced: bool) -> Vec<(usize, &str)> {
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
