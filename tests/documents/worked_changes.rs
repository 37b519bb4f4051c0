//! The worked changes of CONTRIBUTING.md apply to this tree. `make worked-changes` builds and runs them.

use std::io::Write as _;
use std::process::{Command, Stdio};

use super::{read, root};

/// Diffs of CONTRIBUTING.md, each with its heading.
fn diffs() -> Vec<(String, String)> {
    let text = read(&root().join("CONTRIBUTING.md"));
    let (mut found, mut heading, mut diff) = (Vec::new(), String::new(), None::<String>);
    for line in text.lines() {
        match (&mut diff, line) {
            (None, "```diff") => diff = Some(String::new()),
            (None, _) => {
                if let Some(title) = line.strip_prefix("### ") {
                    title.clone_into(&mut heading);
                }
            }
            (Some(done), "```") => {
                found.push((heading.clone(), std::mem::take(done)));
                diff = None;
            }
            (Some(inside), _) => {
                inside.push_str(line);
                inside.push('\n');
            }
        }
    }
    found
}

#[test]
fn worked_changes_apply() {
    let found = diffs();
    let titles: Vec<&str> = found.iter().map(|(title, _)| title.as_str()).collect();
    let expected = [
        "A contraction model",
        "An effect",
        "A passive law",
        "A biomarker",
        "A setting",
    ];
    assert_eq!(titles, expected);
    for (title, diff) in &found {
        let mut git = Command::new("git")
            .args(["apply", "--check", "-"])
            .current_dir(root())
            .stdin(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .expect("git runs");
        let mut input = git.stdin.take().expect("a pipe");
        input.write_all(diff.as_bytes()).expect("git reads");
        drop(input);
        let done = git.wait_with_output().expect("git ends");
        assert!(
            done.status.success(),
            "CONTRIBUTING.md, \"{title}\" does not apply; make the change, and paste its `git diff -U2`:\n{}",
            String::from_utf8_lossy(&done.stderr)
        );
    }
}
