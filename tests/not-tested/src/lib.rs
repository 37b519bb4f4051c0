//! Tests that cannot be run on this machine say so in one way.
//!
//! [`not_tested`] prints `not tested: NEED: WHY`. With `CARDIOTWIN_NOT_TESTED=FILE` it also appends
//! one JSON object to FILE: `{"test": …, "needs": …, "why": …}`. With `CI=true` the test fails
//! unless `.ci/allowed-skips` lists the need with a reason, so that a machine of CI which lost a
//! program does not pass with fewer tests.

use std::io::Write;
use std::path::Path;

/// Needs that a machine of CI may lack, each with its reason: `NEED<tab>REASON` a line, `#` starts
/// a comment.
const ALLOWED: &str = include_str!("../../../.ci/allowed-skips");

/// Says that the running test cannot be run here, because `needs` (such as `slurm`) is missing.
///
/// # Panics
/// With `CI=true`, where `.ci/allowed-skips` does not list `needs`.
pub fn not_tested(needs: &str, why: impl std::fmt::Display) {
    let why = why.to_string();
    eprintln!("not tested: {needs}: {why}");
    let thread = std::thread::current();
    let test = thread.name().unwrap_or_default();
    if let Some(list) = std::env::var_os("CARDIOTWIN_NOT_TESTED") {
        let row = serde_json::json!({ "test": test, "needs": needs, "why": why });
        append(Path::new(&list), &format!("{row}\n"));
    }
    let is_ci = std::env::var("CI").is_ok_and(|value| value == "true");
    assert!(
        !is_ci || is_allowed(ALLOWED, needs),
        "{test}: {needs} is missing, and CI=true: found {why}; expected a machine that has {needs}, \
         or a line with a reason in .ci/allowed-skips"
    );
}

/// One write a row: rows of tests that run at the same time do not mix.
fn append(list: &Path, row: &str) {
    let file = std::fs::OpenOptions::new()
        .create(true)
        .append(true)
        .open(list);
    if let Err(error) = file.and_then(|mut file| file.write_all(row.as_bytes())) {
        eprintln!("cannot write {}: {error}", list.display());
    }
}

/// Whether the list has a line for `needs` with a reason.
fn is_allowed(list: &str, needs: &str) -> bool {
    list.lines()
        .filter_map(|line| line.split_once('\t'))
        .any(|(need, reason)| need == needs && !reason.trim().is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_need_without_a_reason_is_not_allowed() {
        let list = "# needs\tno line\nslurm\tno network\nbrowser\t \nmpi";
        assert!(is_allowed(list, "slurm"));
        for need in ["browser", "mpi", "slur", "python", "no network"] {
            assert!(!is_allowed(list, need), "{need}");
        }
    }

    #[test]
    fn each_line_of_the_list_has_a_reason() {
        let lines = ALLOWED.lines().filter(|line| !line.is_empty());
        for line in lines.filter(|line| !line.starts_with('#')) {
            let need = line.split('\t').next().unwrap_or_default();
            assert!(is_allowed(ALLOWED, need), "{line}");
        }
    }

    #[test]
    fn rows_are_appended() {
        let folder = std::env::temp_dir().join(format!("not-tested-{}", std::process::id()));
        append(&folder, "1\n");
        append(&folder, "2\n");
        assert_eq!(std::fs::read_to_string(&folder).unwrap(), "1\n2\n");
        std::fs::remove_file(&folder).unwrap();
    }
}
