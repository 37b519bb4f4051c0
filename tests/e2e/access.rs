//! Access rights of a run: its group may read it, and nobody else.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use crate::support::Cohort;

fn all_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    let mut next = 0;
    while next < found.len() {
        let at = found[next].clone();
        if at.is_dir() {
            found.extend(
                fs::read_dir(at)
                    .unwrap()
                    .flatten()
                    .map(|entry| entry.path()),
            );
        }
        next += 1;
    }
    found
}

/// A group to which this process may give files: any group for root, otherwise one of the process's
/// own. The last of several is used, because it is not the one that files get by default.
fn a_group_of_mine() -> u32 {
    if rustix::process::geteuid().is_root() {
        return 4242; // a number needs no entry in the group database
    }
    rustix::process::getgroups()
        .unwrap()
        .last()
        .copied()
        .unwrap_or_else(rustix::process::getegid)
        .as_raw()
}

#[test]
fn a_run_belongs_to_the_group_that_is_named() {
    let cohort = Cohort::quick_of("01-CoA");
    let group = a_group_of_mine();
    let setting = format!("executor.group=\"{group}\"");
    cohort
        .call(&["run", "--set", &setting, "--set", "executor.umask=\"027\""])
        .expect(0);
    let files = all_below(&cohort.run_dir());
    assert!(
        files.iter().any(|path| path.ends_with("outcome.json")),
        "workers' files are among them: {files:?}"
    );
    for path in files {
        let found = fs::symlink_metadata(&path).unwrap();
        assert_eq!(found.gid(), group, "{}", path.display());
        let mode = found.permissions().mode();
        assert_eq!(
            mode & 0o027,
            0,
            "{} is open to others, or the group may write ({mode:o})",
            path.display()
        );
        let wanted = if found.is_dir() { 0o050 } else { 0o040 };
        assert_eq!(
            mode & wanted,
            wanted,
            "{} is closed to the group ({mode:o})",
            path.display()
        );
    }
}

/// Copies and pages are no more open than the run, whatever the caller's own mask.
#[test]
fn copies_of_a_closed_run_are_closed() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort
        .call(&["run", "--no-report", "--set", "executor.umask=\"077\""])
        .expect(0);
    let at = |name: &str| cohort.path().join(name);
    let (copy, table) = (at("copy.db"), at("table"));
    let names = [&copy, &table].map(|path| path.to_string_lossy().into_owned());
    cohort.call(&["backup", "--to", &names[0]]).expect(0);
    cohort.call(&["export", "--out", &names[1]]).expect(0);
    cohort.call(&["report"]).expect(0);
    let files = [&copy, &table, &cohort.run_dir()]
        .map(|at| all_below(at))
        .concat();
    let has = |name: &str| files.iter().any(|path| path.ends_with(name));
    assert!(has("copy.db") && has("report.html"), "{files:?}");
    for path in files {
        let mode = fs::symlink_metadata(&path).unwrap().permissions().mode();
        assert_eq!(mode & 0o077, 0, "{} is open ({mode:o})", path.display());
    }
}

#[test]
fn a_group_that_is_not_there_is_refused_before_anything_runs() {
    let cohort = Cohort::quick_of("01-CoA");
    let said = cohort
        .call(&["run", "--set", "executor.group=no-such-group"])
        .expect(2);
    said.complains_of(&["executor.group", "no-such-group", "id -Gn"]);
    assert!(
        !cohort.run_dir().join("cardiotwin.db").exists()
            && !cohort.run_dir().join("attempts").exists()
    );
}
