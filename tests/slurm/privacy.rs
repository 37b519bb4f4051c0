//! What the scheduler and other users can see of a patient: the pseudonym, and no other content of
//! `patient.toml`.

use std::fs;
use std::os::unix::fs::{MetadataExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use crate::cluster::Cluster;
use crate::cohort::{Cohort, SLOW};

/// A name, a hospital number and a date of birth, as they occur in the names of recordings and in
/// remarks.
const IDENTIFIERS: [&str; 3] = ["Lovelace", "MRN-0042-17", "1815-12-10"];

fn finds(text: &str) -> Option<&'static str> {
    IDENTIFIERS
        .into_iter()
        .find(|identifier| text.contains(identifier))
}

fn below(folder: &Path) -> Vec<PathBuf> {
    let mut found = vec![folder.to_owned()];
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
            found.extend(below(&entry.path()));
        } else {
            found.push(entry.path());
        }
    }
    found
}

/// Command lines of all processes, which other users can read in /proc. Environments are readable
/// by their owner only.
fn command_lines() -> Vec<String> {
    let processes = fs::read_dir("/proc").into_iter().flatten().flatten();
    processes
        .filter(|entry| {
            entry
                .file_name()
                .to_string_lossy()
                .chars()
                .all(|c| c.is_ascii_digit())
        })
        .filter_map(|entry| fs::read(entry.path().join("cmdline")).ok())
        .map(|bytes| String::from_utf8_lossy(&bytes).replace('\0', " "))
        .collect()
}

pub fn nothing_but_the_pseudonym_is_seen(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let patient = cohort.folder.path().join("patients/01-CoA");
    let [name, number, born] = IDENTIFIERS;
    // The identifiers are in the recordings' names and in a remark in the patient's file.
    let renamed = [
        ("pressure", format!("{name}_{number}.csv")),
        ("volume", format!("volume {born}.csv")),
    ];
    let file = patient.join("patient.toml");
    let mut text = fs::read_to_string(&file).expect("a patient");
    for (role, new) in &renamed {
        fs::rename(patient.join(format!("{role}.csv")), patient.join(new)).expect("a recording");
        text = text.replace(&format!("\"{role}.csv\""), &format!("{new:?}"));
    }
    fs::write(&file, format!("# {name}, born {born}\n{text}")).expect("a patient");
    let run = cohort.folder.path().join("run");
    assert_eq!(cohort.advance().code, 8);
    cluster.wait("a worker at step 2", || {
        !cohort.workers().is_empty() && cohort.attempts_with("outcome.json").len() > 3
    });

    // The job's files contain the recordings' paths, and must not be open to other users.
    let holds = below(&run)
        .into_iter()
        .filter(|path| fs::read(path).is_ok_and(|b| finds(&String::from_utf8_lossy(&b)).is_some()));
    assert!(
        holds.count() > 0,
        "specifications name the recordings, or this test looks for nothing"
    );
    for path in below(&run) {
        let shown = path
            .strip_prefix(cohort.folder.path())
            .unwrap_or(&path)
            .display()
            .to_string();
        assert_eq!(finds(&shown), None, "a name of a file: {shown}");
        let mode = fs::symlink_metadata(&path)
            .expect("a file")
            .permissions()
            .mode();
        assert_eq!(mode & 0o007, 0, "{shown} is open to other users ({mode:o})");
        let is_told = path.extension().is_some_and(|e| {
            ["sh", "sbatch", "log", "out", "err"]
                .iter()
                .any(|known| e == *known)
        });
        if is_told {
            let text = fs::read_to_string(&path).unwrap_or_default();
            assert_eq!(finds(&text), None, "{shown}: {text}");
        }
    }
    // Data that Slurm shows to every user: names, comments, folders, scripts, arrays, users'
    // fields.
    let me = fs::metadata(&run).expect("the run").uid().to_string();
    let everything = [
        cluster.slurm("squeue", &["--format=%all"]),
        cluster.slurm("squeue", &["--json"]),
        cluster.slurm("scontrol", &["--oneliner", "show", "jobs"]),
        cluster.slurm(
            "sacct",
            &["--allusers", "--parsable2", "--format=ALL", "--duplicates"],
        ),
        cluster.slurm(
            "sacct",
            &[
                "--parsable2",
                &format!("--uid={me}"),
                "--format=JobName%80,Comment%80,WorkDir%200,SubmitLine%300",
            ],
        ),
        cohort.script(0),
    ];
    assert!(
        everything[2].contains("JobName=ct-"),
        "the job is there: {}",
        everything[2]
    );
    for text in &everything {
        assert_eq!(finds(text), None, "{text}");
    }
    let lines = command_lines();
    assert!(
        lines.iter().any(|line| line.contains("cardiotwin-worker")),
        "a worker is at work"
    );
    for line in &lines {
        assert_eq!(finds(line), None, "a command line");
    }
    cohort.call(&["cancel", "--all"]);
}
