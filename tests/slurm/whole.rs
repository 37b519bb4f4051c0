//! Cohorts from end to end.

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK};

pub fn a_cohort_is_done_after_one_wait_in_the_queue(cluster: &Cluster) {
    let patients = ["01-CoA", "02-CoA", "03-CoA", "05-CoA"];
    let cohort = Cohort::of(cluster, &patients, QUICK);
    let first = cohort.advance();
    assert_eq!(first.code, 8, "{first:?}");
    assert!(first.err.contains("cardiotwin advance"), "{first:?}");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    assert_eq!(cohort.jobs().len(), 1, "one array, whatever the number of iterations");
    let outcomes = cohort.attempts_with("outcome.json").len();
    assert!(outcomes > 5 * patients.len(), "{outcomes} simulations in one job");
    assert_eq!(outcomes, cohort.attempts_with("started.json").len(), "nothing was begun twice");
    let script = cohort.script(0);
    for part in ["--no-requeue", "--open-mode=append", "--export=NONE", "--array=0-3", "--signal=B:USR1@60"] {
        assert!(script.contains(part), "{part} is not in\n{script}");
    }
    // The same on this machine gives the same numbers.
    let there = cohort.call(&["run", "--executor", "local", "--run-dir", "here", "--no-report"]);
    assert_eq!(there.code, 0, "{there:?}");
    let compared = cohort.call(&["compare", "run", "here"]);
    assert_eq!(compared.code, 0, "{compared:?}");
    assert!(cohort.status()["cluster"]["node_hours"].as_f64().is_some());
}

pub fn a_tick_takes_two_commands(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], crate::cohort::SLOW);
    cohort.running_job();
    // A folder of programs before Slurm's own, which count and call them.
    let counting = tempfile::tempdir().expect("a folder");
    for program in ["squeue", "sacct", "sbatch", "scancel", "scontrol", "sacctmgr"] {
        let path = counting.path().join(program);
        let log = counting.path().join("log");
        let real = format!("#!/bin/sh\necho {program} >> {}\nexec /usr/bin/{program} \"$@\"\n", log.display());
        std::fs::write(&path, real).expect("a program");
        std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755)).expect("it is ours");
    }
    let path = format!("{}:{}", counting.path().display(), std::env::var("PATH").expect("a PATH"));
    let output = cohort.command(&["advance"]).env("PATH", path).output().expect("the program starts");
    assert_eq!(output.status.code(), Some(8));
    let asked = std::fs::read_to_string(counting.path().join("log")).expect("a log");
    assert_eq!(asked, "squeue\n");
}
