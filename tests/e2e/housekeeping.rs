//! `du`, `clean` and `archive` on a real run, and a run whose scratch was purged.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::{Cohort, cardiotwin, published};

fn files(folder: &Path) -> BTreeMap<PathBuf, u64> {
    let mut found = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(at) = folders.pop() {
        for entry in fs::read_dir(at).unwrap().flatten() {
            let metadata = entry.metadata().unwrap();
            if metadata.is_dir() {
                folders.push(entry.path());
            } else {
                found.insert(
                    entry.path().strip_prefix(folder).unwrap().to_owned(),
                    metadata.len(),
                );
            }
        }
    }
    found
}

#[test]
fn clean_takes_scratch_alone_and_an_archive_is_a_run() {
    let cohort = Cohort::quick();
    cohort.call(&["run"]).expect(0);
    let run = cohort.run_dir();
    let attempt = fs::read_dir(run.join("attempts"))
        .unwrap()
        .flatten()
        .next()
        .unwrap();
    let attempt = fs::read_dir(attempt.path())
        .unwrap()
        .flatten()
        .next()
        .unwrap()
        .path();
    // Files of a checkpoint, and a file of a person.
    fs::create_dir_all(attempt.join("checkpoint")).unwrap();
    fs::write(attempt.join("checkpoint/state.bin"), vec![0; 5000]).unwrap();
    fs::write(run.join("notes.txt"), "mine").unwrap();
    let before = files(&run);
    let would = cohort.call(&["clean", "--dry-run", "--json"]).json();
    assert_eq!(files(&run), before, "a dry run removes nothing");
    let usage = cohort.call(&["du", "--json"]).json();
    let removable = usage["removable"]["bytes"].as_u64().unwrap();
    assert!(removable >= 5000, "{usage}");
    let cleaned = cohort.call(&["clean", "--json"]).json();
    assert_eq!(cleaned, would);
    let after = files(&run);
    let gone: Vec<&PathBuf> = before
        .keys()
        .filter(|file| !after.contains_key(*file))
        .collect();
    let bytes: u64 = gone.iter().map(|file| before[*file]).sum();
    assert_eq!(bytes, removable);
    assert!(
        gone.iter().all(|file| file.starts_with("attempts")),
        "{gone:?}"
    );
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(said.out.contains("nothing to do"), "{}", said.out);
    cohort.call(&["report"]).expect(0);

    let target = cohort.path().join("archive");
    cohort.call(&["archive", "--to", "archive"]).expect(0);
    let again = cohort.call(&["archive", "--to", "archive"]);
    assert!(
        again.code != 0 && again.err.contains("already exists"),
        "{}",
        again.err
    );
    let check = ["--check", "--quiet", "SHA256SUMS"];
    let check = std::process::Command::new("sha256sum")
        .args(check)
        .current_dir(&target)
        .status()
        .unwrap();
    assert!(check.success(), "every file of the archive is as listed");
    assert_eq!(
        fs::read_to_string(target.join("notes.txt")).unwrap(),
        "mine"
    );
    // The first run is moved away, because the copy must stand by itself.
    let expected: Vec<_> = ["01-CoA", "02-CoA"]
        .map(|id| published(&cohort.patient(id)))
        .into();
    fs::rename(&run, cohort.path().join("elsewhere")).unwrap();
    for (id, expected) in ["01-CoA", "02-CoA"].iter().zip(&expected) {
        let shown = cardiotwin(
            cohort.path(),
            &["show", id, "--cohort", "archive", "--json"],
        )
        .json();
        assert_eq!(&published(&shown), expected);
    }
    cardiotwin(cohort.path(), &["report", "archive"]).expect(0);
    let goes_on = cardiotwin(
        cohort.path(),
        &["run", ".", "--run-dir", "archive", "--no-report"],
    )
    .expect(0);
    assert!(goes_on.out.contains("nothing to do"), "{}", goes_on.out);
}

/// A run whose first simulation becomes the best, so that finished steps after step 1 are redone.
const ONE_SIMULATION: [&str; 5] = [
    "run",
    "--no-report",
    "--yes",
    "--set",
    "step1.max_iterations=1",
];

/// All attempts are gone, as after a purge: no task is computed again until its files are read, and
/// then only the tasks that are read.
#[test]
fn a_purged_run_is_gone_on_with() {
    let cohort = Cohort::quick_of("01-CoA");
    cohort.call(&["run", "--no-report"]).expect(0);
    let before = published(&cohort.patient("01-CoA"));
    fs::remove_dir_all(cohort.run_dir().join("attempts")).unwrap();
    let said = cohort.call(&["run", "--no-report"]).expect(0);
    assert!(
        said.out.contains("nothing to do"),
        "nobody reads them: {}",
        said.out
    );
    // The first iteration becomes the best, so the targets read the traces of that beat.
    let said = cohort.call(&ONE_SIMULATION).expect(0);
    assert!(
        said.err
            .contains("is gone, but targets needs it: it is recomputed"),
        "{}",
        said.err
    );
    let after = published(&cohort.patient("01-CoA"));
    let generation =
        |tasks: &[(String, String, u64)], key: &str| tasks.iter().find(|t| t.1 == key).map(|t| t.2);
    for (step, key, now) in &after {
        match generation(&before, key) {
            Some(then) if step == "step-1 iteration 1" => {
                assert_eq!((then, *now), (1, 2), "{step}")
            }
            Some(then) => assert_eq!(then, *now, "{step} was made again though nobody reads it"),
            None => assert!(
                ["targets", "step-2", "verification"].contains(&step.as_str()),
                "{step}"
            ),
        }
    }
}

#[test]
fn a_plan_tells_what_room_it_takes() {
    let cohort = Cohort::quick();
    let plan = cohort.call(&["plan", "--json"]).json();
    let (bytes, inodes) = (
        plan["disk"]["bytes"].as_f64().unwrap(),
        plan["disk"]["inodes"].as_f64().unwrap(),
    );
    assert!(
        bytes > 1e5 && inodes > 20.0 && plan["disk"]["measured"] == serde_json::json!([]),
        "{plan}"
    );
    let said = cohort.call(&["plan"]).expect(0).out;
    assert!(
        said.contains("inodes to come (a guess from the bundled cohort)"),
        "{said}"
    );
}

/// Database, attempts and archive in folders of their own, as on three file systems: every command
/// that reads a run follows.
#[test]
fn attempts_lie_on_scratch_and_copies_in_the_archive() {
    let cohort = Cohort::quick_of("01-CoA");
    let (scratch, archive) = (
        cohort.path().join("scratch"),
        cohort.path().join("archives"),
    );
    let path = cohort.path().join("cohort.toml");
    let text = fs::read_to_string(&path).unwrap();
    let lines = format!(
        "\n[executor]\nscratch = {:?}\narchive = {:?}\n",
        scratch.display(),
        archive.display()
    );
    fs::write(&path, text + &lines).unwrap();
    cohort.call(&["run"]).expect(0);
    let link = fs::read_link(cohort.run_dir().join("attempts")).unwrap();
    assert!(
        link.starts_with(&scratch) && files(&link).len() > 10,
        "{}",
        link.display()
    );
    let usage = cohort.call(&["du", "--json"]).json();
    assert!(
        usage["classes"]["results"]["files"].as_u64().unwrap() > 0,
        "{usage}"
    );
    cohort.call(&["clean"]).expect(0);
    let findings = cohort.call(&["doctor", "--json"]).out;
    assert!(findings.contains(&*scratch.to_string_lossy()), "{findings}");
    cohort.call(&["archive"]).expect(0);
    let copy = fs::read_dir(&archive)
        .unwrap()
        .flatten()
        .next()
        .unwrap()
        .path();
    assert!(
        fs::symlink_metadata(copy.join("attempts"))
            .unwrap()
            .is_dir(),
        "the copy stands by itself"
    );
    // All of scratch is purged, including the run's folder.
    fs::remove_dir_all(&scratch).unwrap();
    let said = cohort.call(&ONE_SIMULATION).expect(0);
    assert!(said.err.contains("it is recomputed"), "{}", said.err);
    let name = copy.to_string_lossy().into_owned();
    let shown = cardiotwin(
        cohort.path(),
        &["show", "01-CoA", "--cohort", &name, "--json"],
    )
    .json();
    assert_eq!(shown["status"]["state"], "done");
    let other = format!("executor.scratch={}", cohort.path().join("other").display());
    cohort
        .call(&["run", "--no-report", "--set", &other])
        .expect(2)
        .complains_of(&["executor.scratch", "mv "]);
}
