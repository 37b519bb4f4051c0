//! Endings that Slurm decides by its own clock. They are tested together, because Slurm checks only
//! every half minute.

use std::fs;
use std::path::{Path, PathBuf};

use rustix::process::Signal;
use serde_json::Value;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, SLOW, is_revoked, lives, pid_of, signal};

/// Times that an attempt has reported while simulating, ms.
fn reports(attempt: &Path) -> Vec<f64> {
    let text = fs::read_to_string(attempt.join("progress.jsonl")).unwrap_or_default();
    let reports = text
        .lines()
        .filter_map(|line| serde_json::from_str::<Value>(line).ok());
    reports
        .filter(|report| report["phase"] == "simulating")
        .filter_map(|report| report["done"].as_f64())
        .collect()
}

/// The beat that a second job continues: its attempts in the first and in the second job, once the
/// latter has reported.
fn goes_on(cohort: &Cohort) -> Option<(PathBuf, PathBuf)> {
    cohort
        .attempts_with("progress.jsonl")
        .into_iter()
        .find_map(|second| {
            let name = second.file_name()?.to_string_lossy().into_owned();
            let first = second.with_file_name(name.replace("-g2", "-g1"));
            let begun = name.ends_with("-g2") && first.is_dir() && !reports(&second).is_empty();
            begun.then_some((first, second))
        })
}

/// Directory of the present attempt at a 3D beat that is under way.
fn beat(cohort: &Cohort) -> Option<PathBuf> {
    let begun = cohort.attempts_with("progress.jsonl").into_iter();
    begun
        .filter(|path| !path.join("outcome.json").exists())
        .find(|path| reports(path).last().is_some_and(|ms| *ms > 5.0))
}

/// A beat in 3D is warned by Slurm before its walltime, writes a checkpoint and continues in
/// another job. A job that ignores the warning is ended by Slurm, and its work continues from its
/// checkpoint. A job whose slurmd is killed (fault recipe c) is declared lost while it lives on,
/// and publishes nothing.
pub fn walltimes_and_a_killed_slurmd(cluster: &Cluster) {
    let orphan = Cohort::of(cluster, &["01-CoA"], SLOW).set("executor.slurm.queue=standard");
    let lost = orphan.running_job();
    // The time steps are so short that the beat takes about a minute.
    let warned = Cohort::of(cluster, &["02-CoA"], SLOW)
        .set("solver.fidelity=finite-element")
        .set("solver.finite_element.mesh_nodes=500")
        .set("solver.time_step_ms=0.02")
        .set("solver.shortest_step_ms=0.01");
    let warned_job = warned.running_job();
    let late = Cohort::of(cluster, &["03-CoA"], SLOW);
    let late_job = late.running_job();

    let worker = orphan.wait_for_checkpoint();
    let node = cluster
        .slurm("squeue", &["-h", "-j", &lost, "-o", "%N"])
        .trim()
        .to_owned();
    cluster.kill(&node);

    late.wait_for_checkpoint();
    // Neither script nor driver receives the warning.
    signal(&late.jobs()[0].join("started-0-0.json"), Signal::STOP);
    cluster.slurm(
        "scontrol",
        &["update", &format!("jobid={late_job}"), "endtime=now+1"],
    );
    cluster.wait("a beat under way", || beat(&warned).is_some());
    // Later than Slurm's next check, but sooner than the time of the warning and that check
    // together.
    cluster.slurm(
        "scontrol",
        &["update", &format!("jobid={warned_job}"), "endtime=now+80"],
    );

    let all = [&orphan, &warned, &late];
    cluster.wait("another job of each", || {
        all.iter()
            .filter(|cohort| cohort.jobs().len() < 2)
            .for_each(|cohort| drop(cohort.advance()));
        all.iter().all(|cohort| cohort.jobs().len() == 2)
    });

    let word = fs::read_to_string(warned.jobs()[0].join("ended-0-0.json"))
        .expect("the driver's last word");
    assert!(word.contains("out-of-time"), "{word}");
    // On a fast machine this is a later beat than the one seen above.
    cluster.wait("the beat that goes on", || goes_on(&warned).is_some());
    let (first, second) = goes_on(&warned).expect("it was there");
    let left_at_ms = *reports(&first).last().expect("it reported");
    let goes_on_at_ms = reports(&second)[0];
    assert!(
        goes_on_at_ms + 1.0 >= left_at_ms,
        "it left at {left_at_ms} ms and went on at {goes_on_at_ms} ms"
    );

    let told = late.call(&["explain", "03-CoA"]).out;
    assert!(told.contains("walltime"), "{told}");
    let state = cluster.slurm("sacct", &["-X", "-n", "-P", "-j", &late_job, "-o", "State"]);
    assert!(state.contains("TIMEOUT"), "{state}");

    let told = orphan.call(&["explain", "01-CoA"]).out;
    assert!(told.contains("node failure"), "{told}");
    assert!(
        orphan.script(1).contains(&format!("--exclude={node}")),
        "{}",
        orphan.script(1)
    );
    // The orphan was revoked: it leaves by itself and has published nothing.
    cluster.wait("the end of the orphan", || !lives(worker));
    let claimed = |path: &PathBuf| pid_of(&path.join("started.json")) == Some(worker);
    let attempt = orphan
        .attempts_with("started.json")
        .into_iter()
        .find(claimed)
        .expect("its attempt");
    assert!(is_revoked(&attempt));
    for cohort in [&late, &orphan] {
        let twice = || {
            cohort
                .attempts_with("started.json")
                .into_iter()
                .filter(|p| p.to_string_lossy().ends_with("-g2"))
        };
        cluster.wait("the attempt that goes on", || twice().count() == 1);
    }
    all.iter()
        .for_each(|cohort| drop(cohort.call(&["cancel", "--all"])));
}
