//! Variables of Slurm in the caller's shell: no submission sees them, and they are named.

use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use crate::support::{Cohort, command};

/// Programs with Slurm's names: each appends its name and the options that it finds in its environment
/// to a file; sbatch accepts every script.
fn scheduler(folder: &Path) {
    let log = folder.join("seen");
    for (name, answer) in [
        ("sbatch", "echo 4711"),
        // An empty queue: the header of the format that the program asks for.
        (
            "squeue",
            "echo 'ctq|ARRAY_JOB_ID|ARRAY_TASK_ID|JOBID|STATE|REASON|PARTITION|QOS|ACCOUNT|NODES|CPUS|NODELIST|SUBMIT_TIME|START_TIME|END_TIME|TIME_LIMIT|NAME|ctq.'",
        ),
        ("sacct", ":"),
        ("scancel", ":"),
        ("scontrol", "echo 'SLURM_VERSION = 24.05.0'"),
        ("sacctmgr", ":"),
    ] {
        let file = folder.join(name);
        let script = format!(
            "#!/bin/sh\necho {name} >> {log}\nenv | grep -E '^(SBATCH|SQUEUE|SACCT|SLURM)_' >> {log}\n{answer}\n",
            log = log.display()
        );
        std::fs::write(&file, script).unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).unwrap();
    }
}

#[test]
fn no_variable_of_the_caller_reaches_a_submission() {
    let cohort = Cohort::quick();
    let programs = tempfile::tempdir().unwrap();
    scheduler(programs.path());
    let search = format!(
        "{}:{}",
        programs.path().display(),
        std::env::var("PATH").unwrap()
    );
    let arguments = [
        "run",
        ".",
        "--executor",
        "slurm",
        "--set",
        "executor.slurm.site=generic",
    ];
    let said = command(cohort.path(), &arguments)
        .env("PATH", &search)
        .env("SBATCH_ACCOUNT", "otherbudget")
        .env("SBATCH_PARTITION", "scavenge")
        .env("SBATCH_RESERVATION", "old")
        .env("SLURM_CLUSTERS", "elsewhere")
        .env("SLURM_JOB_ID", "1")
        .env("SLURM_CONF", "/etc/slurm.conf")
        .output()
        .unwrap();
    let err = String::from_utf8_lossy(&said.stderr).into_owned();
    assert_eq!(said.status.code(), Some(8), "{err}");
    assert!(
        err.contains("SBATCH_ACCOUNT=otherbudget, SBATCH_PARTITION=scavenge, SBATCH_RESERVATION=old, SLURM_CLUSTERS=elsewhere of this shell: no effect"),
        "{err}"
    );
    let seen = std::fs::read_to_string(programs.path().join("seen")).unwrap();
    assert!(seen.lines().any(|line| line == "sbatch"), "{seen}");
    for line in seen.lines().filter(|line| line.contains('=')) {
        let known = ["SLURM_CONF=/etc/slurm.conf", "SLURM_TIME_FORMAT=%s"].contains(&line);
        assert!(known, "{line}\n{seen}");
    }
}
