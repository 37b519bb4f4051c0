//! Failures of the scheduler and the coordinator, which must not affect results.

use rustix::process::Signal;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, SLOW};

pub fn no_accounting_is_needed(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    cohort.call(&["advance"]); // the site's limits are remembered
    cluster.kill("slurmdbd");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    cluster.revive("slurmdbd");
}

pub fn a_frozen_controller_has_the_job_all_the_same(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    // A program in place of sbatch that freezes the controller first. squeue has been answered by
    // then.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sbatch");
    let pid_file = cluster
        .conf
        .parent()
        .and_then(|p| p.parent())
        .expect("its folder")
        .join("run/slurmctld.pid");
    let script = format!(
        "#!/bin/sh\nkill -STOP $(cat {})\nexec /usr/bin/sbatch \"$@\"\n",
        pid_file.display()
    );
    std::fs::write(&path, script).expect("a program");
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
        .expect("it is ours");
    let search = format!(
        "{}:{}",
        folder.path().display(),
        std::env::var("PATH").expect("a PATH")
    );
    let tick = cohort.command(&["advance"]).env("PATH", search).output();
    cluster.signal("slurmctld", Signal::CONT);
    assert_eq!(tick.expect("it starts").status.code(), Some(8));
    let jobs = cohort.status()["cluster"]["jobs"].clone();
    assert_eq!(jobs[0]["state"], "doubtful", "{jobs:#}");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    assert_eq!(cohort.jobs().len(), 1, "adopted, not submitted again");
    assert_eq!(
        cohort.attempts_with("started.json").len(),
        cohort.attempts_with("outcome.json").len()
    );
}

/// Of two simultaneous ticks only one works, and a killed tick does not delay the next.
pub fn of_two_ticks_at_once_one_works(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    assert_eq!(cohort.advance().code, 8);
    // A program in place of squeue that never ends, so that a tick which calls it holds the lease.
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("squeue");
    std::fs::write(
        &path,
        "#!/bin/sh\ntouch \"$(dirname \"$0\")/asked\"\nexec sleep 300\n",
    )
    .expect("a program");
    std::fs::set_permissions(&path, std::os::unix::fs::PermissionsExt::from_mode(0o755))
        .expect("it is ours");
    let search = format!(
        "{}:{}",
        folder.path().display(),
        std::env::var("PATH").expect("a PATH")
    );
    let quiet = std::process::Stdio::null;
    let mut first = cohort.command(&["advance"]);
    let mut first = first
        .env("PATH", search)
        .stdout(quiet())
        .stderr(quiet())
        .spawn()
        .expect("it starts");
    cluster.wait("a tick that asks", || folder.path().join("asked").exists());
    let second = cohort.advance();
    assert_eq!(second.code, 4, "{second:?}");
    assert!(
        second.err.contains(&first.id().to_string()),
        "it says who holds the run: {second:?}"
    );
    first.kill().expect("it is ours");
    first.wait().expect("it is ours");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
}

/// The coordinator is killed at each of its first crash points, with jobs on the real cluster.
pub fn a_killed_coordinator_is_continued(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA", "02-CoA"], QUICK);
    for point in 1..=20 {
        let tick = cohort
            .command(&["advance"])
            .env("CARDIOTWIN_CRASH_POINT", point.to_string())
            .output();
        assert!(tick.is_ok());
    }
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    assert_eq!(
        cohort.attempts_with("started.json").len(),
        cohort.attempts_with("outcome.json").len()
    );
    // A coordinator that keeps watching is killed as well, without any loss.
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let mut watching = cohort.watch();
    cluster.wait("its job", || {
        !cluster
            .slurm("squeue", &["--me", "-h", "-t", "R"])
            .is_empty()
    });
    watching.kill().expect("it is ours");
    watching.wait().expect("it is ours");
    cohort.wait_for_checkpoint();
    assert_eq!(cohort.advance().code, 8);
    let status = cohort.status();
    assert_eq!(status["patients"][0]["step"], "step-2", "{status:#}");
    assert_eq!(status["patients"][0]["state"], "running", "{status:#}");
}
