//! Classes of failure, each on the real Slurm.

use std::path::Path;

use rustix::process::{Pid, Signal};
use serde_json::Value;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, SLOW};

/// The only patient's status.
fn patient(cohort: &Cohort) -> Value {
    cohort.status()["patients"][0].clone()
}

pub fn a_job_that_a_person_cancels_stays_cancelled(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    // In accounting, root's `scancel` before the driver has begun looks like a cancellation by
    // Slurm (`cancelled.rs`).
    cohort.wait_for_checkpoint();
    cluster.slurm("scancel", &[&job]);
    assert_eq!(cohort.finish(), 1);
    let status = cohort.status();
    assert_eq!(status["patients"][0]["state"], "cancelled", "{status:#}");
    assert_eq!(cohort.advance().code, 1, "it stays so");
    assert_eq!(cohort.jobs().len(), 1);
    // It stays so until it is requested again.
    cohort.make_quick();
    assert_eq!(cohort.call(&["retry", "01-CoA"]).code, 0);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
}

pub fn cancel_ends_the_job_and_waits_for_it(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    let said = cohort.call(&["cancel", "--all"]);
    assert_eq!(said.code, 0, "{said:?}");
    // The driver may report its end before Slurm has cleaned up its node (COMPLETING).
    let left = cluster.slurm(
        "squeue",
        &["--me", "-h", "-j", &job, "-t", "pending,running,suspended"],
    );
    assert!(left.is_empty(), "the job is still there: {left}");
    assert_eq!(cohort.status()["patients"][0]["state"], "cancelled");
}

pub fn a_lost_node_is_avoided(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    cohort.wait_for_checkpoint();
    let node = cluster
        .slurm("squeue", &["-h", "-j", &job, "-o", "%N"])
        .trim()
        .to_owned();
    cluster.slurm(
        "scontrol",
        &[
            "update",
            &format!("nodename={node}"),
            "state=down",
            "reason=test",
        ],
    );
    cluster.wait("a job elsewhere", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    assert!(
        cohort.script(1).contains(&format!("--exclude={node}")),
        "{}",
        cohort.script(1)
    );
    // Finished work is not repeated, and the last step continues from the checkpoint.
    let begun = cohort.attempts_with("started.json");
    let again = begun
        .iter()
        .filter(|path| path.to_string_lossy().ends_with("-g2"))
        .count();
    cluster.wait("the second attempt", || {
        cohort
            .attempts_with("started.json")
            .iter()
            .any(|path| path.to_string_lossy().ends_with("-g2"))
    });
    assert!(again <= 1);
    assert!(
        cohort
            .call(&["explain", "01-CoA"])
            .out
            .contains("node failure"),
        "{:?}",
        cohort.call(&["explain", "01-CoA"])
    );
    cohort.call(&["cancel", "--all"]);
}

pub fn a_warning_leaves_a_checkpoint_and_another_job_goes_on(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    cohort.wait_for_checkpoint();
    // As Slurm does before the walltime: the script receives the warning and passes it on.
    cluster.slurm("scancel", &["--signal=USR1", "--batch", &job]);
    cluster.wait("the job's last word", || {
        cohort.jobs()[0].join("ended-0-0.json").exists()
    });
    let said =
        std::fs::read_to_string(cohort.jobs()[0].join("ended-0-0.json")).expect("it is there");
    assert!(said.contains("out-of-time"), "{said}");
    cluster.wait("a job that goes on", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    cluster.wait("the attempt that goes on", || {
        let second = cohort
            .attempts_with("checkpoint")
            .into_iter()
            .find(|path| path.to_string_lossy().ends_with("-g2"));
        second.is_some_and(|path| {
            let log = std::fs::read_to_string(path.join("stderr.log")).unwrap_or_default();
            let journal = path.join("checkpoint/told-costs");
            journal.metadata().is_ok_and(|m| m.len() > 2000) || log.contains("goes on")
        })
    });
    let begun = cohort.attempts_with("started.json");
    assert_eq!(
        begun
            .iter()
            .filter(|path| path.to_string_lossy().ends_with("-g2"))
            .count(),
        1,
        "one step goes on"
    );
    cohort.call(&["cancel", "--all"]);
}

pub fn out_of_memory_asks_for_more(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW).set("executor.slurm.memory_MiB=3");
    cluster.wait("a job with more memory", || {
        cohort.advance();
        cohort.jobs().len() >= 2
    });
    let memory = |n: usize| {
        let script = cohort.script(n);
        let line = script
            .lines()
            .find_map(|line| line.strip_prefix("#SBATCH --mem="))
            .expect("a demand")
            .to_owned();
        line.trim_end_matches('M').parse::<u64>().expect("MiB")
    };
    assert_eq!((memory(0), memory(1)), (3, 6));
    let told = cohort.call(&["explain", "01-CoA"]).out;
    assert!(told.contains("out of memory"), "{told}");
    cohort.call(&["cancel", "--all"]);
}

pub fn a_killed_worker_is_tried_again(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    cohort.running_job();
    let pid = cohort.wait_for_checkpoint();
    let pid = Pid::from_raw(i32::try_from(pid).expect("a pid")).expect("a pid");
    rustix::process::kill_process(pid, Signal::KILL).expect("the worker is ours");
    cluster.wait("another job", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    let told = cohort.call(&["explain", "01-CoA"]).out;
    assert!(told.contains("killed by signal 9"), "{told}");
    cohort.call(&["cancel", "--all"]);
}

pub fn a_full_queue_is_waited_for(cluster: &Cluster) {
    // ARCHER2's `serial` takes 32 jobs of a user, and held jobs count.
    let filler = [
        "--hold",
        "--partition=serial",
        "--qos=serial",
        "--array=0-31",
        "--time=1",
        "--wrap=true",
    ];
    cluster.slurm("sbatch", &filler);
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK).set("executor.slurm.queue=serial");
    assert_eq!(cohort.advance().code, 8);
    let status = cohort.status();
    let note = status["patients"][0]["note"]
        .as_str()
        .unwrap_or_default()
        .to_owned();
    let holds = status["cluster"]["holds"]
        .as_str()
        .unwrap_or_default()
        .to_owned();
    assert!(holds.contains("the queue is full"), "{status:#}");
    assert!(!note.is_empty(), "{status:#}");
    assert!(cohort.attempts_with("started.json").is_empty());
    cluster.slurm("scancel", &["--me"]);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
}

/// With `serial` full, the cohort's job runs in the next queue that has room; one that is full as well is passed over.
pub fn a_full_queue_gives_way_to_the_next(cluster: &Cluster) {
    let filler = [
        "--hold",
        "--partition=serial",
        "--qos=serial",
        "--array=0-31",
        "--time=1",
        "--wrap=true",
    ];
    cluster.slurm("sbatch", &filler);
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK)
        .set("executor.slurm.queue=serial")
        .set("executor.slurm.fallback_queues=[\"serial\", \"standard\"]");
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    let script = cohort.script(0);
    assert!(script.contains("#SBATCH --qos=standard\n"), "{script}");
    cluster.slurm("scancel", &["--me"]);
}

/// The first job waits for another one; a later call waits for nothing, and a job that Slurm has forgotten holds nothing up.
pub fn a_run_begins_after_another_job(cluster: &Cluster) {
    let copy = ["--parsable", "--hold", "--time=1", "--wrap=true"];
    let copy = cluster.slurm("sbatch", &copy).trim().to_owned();
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK).set("executor.slurm.queue=serial");
    let begun = cohort.call(&cohort.with_settings(&["run", "--after", &copy, "--after", "999999"]));
    assert_eq!(begun.code, 8, "{begun:?}");
    let directive = format!("--dependency=afterany:{copy}:999999");
    assert!(
        cohort.script(0).contains(&directive),
        "{}",
        cohort.script(0)
    );
    cluster.wait("the reason", || {
        cohort.advance();
        let note = cohort.status()["patients"][0]["note"].to_string();
        note.contains("waits for another job to end")
    });
    assert!(cohort.attempts_with("started.json").is_empty());
    cluster.slurm("scontrol", &["release", &copy]);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    let of_no_later_job =
        (1..cohort.jobs().len()).all(|n| !cohort.script(n).contains("--dependency"));
    assert!(of_no_later_job);
}

pub fn what_slurm_never_takes_is_told(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK).set("executor.slurm.account=nobody");
    assert_eq!(cohort.finish(), 1);
    let status = cohort.status();
    let patient = &status["patients"][0];
    assert_eq!(patient["state"], "failed", "{status:#}");
    assert!(
        patient["note"]
            .as_str()
            .is_some_and(|note| note.contains("Invalid account")),
        "{status:#}"
    );
    assert_eq!(cohort.jobs().len(), 1, "never tried again as it is");
    assert_eq!(
        cohort
            .call(&["retry", "--failed", "--class", "refused"])
            .code,
        0
    );
    let repaired = cohort.set("executor.slurm.account=t01");
    assert_eq!(repaired.finish(), 0);
    repaired.assert_done();
}

/// Slurm takes `SBATCH_*` of the environment before the options of a script.
pub fn variables_of_the_caller_change_no_job(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW)
        .set("executor.slurm.account=t01")
        .set("executor.slurm.queue=main");
    let said = cohort
        .command(&cohort.with_settings(&["advance"]))
        .env("SBATCH_ACCOUNT", "otherbudget")
        .env("SBATCH_PARTITION", "scavenge")
        .env("SBATCH_QOS", "serial")
        .env("SBATCH_RESERVATION", "old")
        .env("SLURM_CLUSTERS", "elsewhere")
        .output()
        .expect("the program starts");
    let err = String::from_utf8_lossy(&said.stderr);
    assert_eq!(said.status.code(), Some(8), "{err}");
    assert!(
        err.contains("SBATCH_ACCOUNT=otherbudget") && err.contains("no effect"),
        "{err}"
    );
    let queue = cluster.slurm("squeue", &["--me", "-h", "-o", "%j|%P|%a|%q"]);
    let rows: Vec<&str> = queue.lines().collect();
    assert!(
        rows.len() == 1 && rows[0].ends_with("|main|t01|normal"),
        "{queue}"
    );
    cohort.call(&["cancel", "--all"]);
}

pub fn a_preempted_job_is_submitted_again(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW).set("executor.slurm.queue=scavenge");
    cohort.running_job();
    cohort.wait_for_checkpoint();
    // A job in a partition of higher priority takes all nodes.
    let urgent = [
        "--parsable",
        "--partition=main",
        "--nodes=4",
        "--exclusive",
        "--time=10",
        "--output=/dev/null",
        "--wrap=sleep 600",
    ];
    let urgent = cluster.slurm("sbatch", &urgent).trim().to_owned();
    cluster.wait("another job", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    let told = cohort.call(&["explain", "01-CoA"]).out;
    assert!(told.contains("preempted"), "{told}");
    assert!(
        !cohort.script(1).contains("--exclude"),
        "nothing is wrong with the node"
    );
    cluster.slurm("scancel", &[&urgent]);
    let again = || {
        cohort
            .attempts_with("started.json")
            .into_iter()
            .filter(|p| p.to_string_lossy().ends_with("-g2"))
    };
    cluster.wait("the attempt that goes on", || again().count() == 1);
    cohort.call(&["cancel", "--all"]);
}

pub fn a_divergence_is_the_sciences_and_no_job_is_repeated(cluster: &Cluster) {
    // With one Newton iteration and no shorter step, no beat can be simulated.
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK)
        .set("solver.newton_iterations=1")
        .set("solver.shortest_step_ms=1");
    assert_eq!(cohort.finish(), 1);
    let patient = patient(&cohort);
    assert_eq!(
        (&patient["state"], &patient["failure_class"]),
        (&"failed".into(), &"numerics".into()),
        "{patient:#}"
    );
    assert_eq!(cohort.advance().code, 1, "it stays so");
    assert_eq!(cohort.jobs().len(), 1);
    assert!(
        cohort
            .attempts_with("started.json")
            .iter()
            .all(|p| p.to_string_lossy().ends_with("-g1"))
    );
}

/// The walk through `examples/early-end` of docs/operations.md, in jobs.
pub fn a_simulation_in_3d_that_ends_early_is_gone_on_from(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["04-CoA"], "");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/early-end");
    let (settings, file) = ("cohort.toml", "patients/04-CoA/patient.toml");
    let settings = std::fs::read_to_string(example.join(settings)).expect("the example");
    // Steps 2 and 3 as short as possible: the walk is about step 1.
    let text = format!(
        "{settings}\n[step2]\n{QUICK}\n[verification]\nenabled = false\n\n[workflow]\n\
         until = \"step2-verification\"\n\n[executor]\nkind = \"slurm\"\n\n[executor.slurm]\nsite = {:?}\n",
        cohort.site()
    );
    std::fs::write(cohort.folder.path().join("cohort.toml"), text).expect("a cohort");
    std::fs::copy(example.join(file), cohort.folder.path().join(file)).expect("a patient");

    assert_eq!(cohort.finish(), 0);
    let status = cohort.call(&["status"]).out;
    assert!(status.contains("stalled: best iteration 2"), "{status}");
    let explained = cohort.call(&["explain", "04-CoA"]).out;
    let why = "step 1 stalled: simulation 3 failed [numerics]";
    assert!(explained.contains(why), "{explained}");
    let before = cohort.tally();
    assert_eq!(
        before.repeated, 0,
        "no job repeats a divergence: {before:?}"
    );

    let rerun = ["rerun", "04-CoA", "--from", "step1", "--damping", "0.5"];
    let said = cohort.call(&rerun);
    assert_eq!(said.code, 0, "{said:?}");
    assert_eq!(cohort.finish(), 0);
    let status = cohort.call(&["status"]).out;
    assert!(status.contains("converged"), "{status}");
    let after = cohort.tally();
    assert_eq!(after.twice + after.again + after.repeated, 0, "{after:?}");
    // Two simulations, and step 2 for the other selection.
    assert_eq!(
        after.published,
        before.published + 3,
        "{before:?}, {after:?}"
    );
}

pub fn bad_input_is_never_tried_again(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK);
    // The trace is damaged after the planning and before any task reads it.
    let trace = cohort.folder.path().join("patients/01-CoA/pressure.csv");
    let sound = std::fs::read(&trace).expect("a trace");
    // The script runs in the folder of its job, run/slurm/NAME.
    let damage = "setup = [\"echo damaged >> ../../../patients/01-CoA/pressure.csv\"]\n[node]\n";
    cohort.change_profile("[node]\n", damage);
    assert_eq!(cohort.advance().code, 8);
    cluster.wait("the job's last word", || {
        cohort.jobs()[0].join("ended-0-0.json").exists()
    });
    // The trace is repaired, but the failure stays until a retry is requested.
    std::fs::write(&trace, &sound).expect("a trace");
    cohort.change_profile(damage, "[node]\n");
    assert_eq!(cohort.finish(), 1);
    let patient = patient(&cohort);
    assert_eq!(
        (&patient["state"], &patient["failure_class"]),
        (&"failed".into(), &"input".into()),
        "{patient:#}"
    );
    assert_eq!(
        (
            cohort.jobs().len(),
            cohort.attempts_with("started.json").len()
        ),
        (1, 1)
    );
    assert_eq!(
        cohort.call(&["retry", "--failed", "--class", "input"]).code,
        0
    );
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
}

pub fn a_worker_that_aborts_is_a_defect_and_stops(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    cohort.running_job();
    let pid = cohort.wait_for_checkpoint();
    let pid = Pid::from_raw(i32::try_from(pid).expect("a pid")).expect("a pid");
    rustix::process::kill_process(pid, Signal::ABORT).expect("the worker is ours");
    assert_eq!(cohort.finish(), 1);
    let patient = patient(&cohort);
    assert_eq!(
        (&patient["state"], &patient["failure_class"]),
        (&"failed".into(), &"bug".into()),
        "{patient:#}"
    );
    assert!(
        patient["note"]
            .as_str()
            .is_some_and(|note| note.contains("aborted")),
        "{patient:#}"
    );
    assert_eq!(cohort.jobs().len(), 1, "never tried again");
    let logs = cohort.call(&["logs", "01-CoA"]);
    assert_eq!(logs.code, 0, "{logs:?}");
    assert!(logs.out.contains("driver ended"), "{logs:?}");
}

/// Fault recipe (h): on a site that gives whole nodes a core is charged as a node, so nodes are
/// filled.
pub fn a_whole_node_is_filled(cluster: &Cluster) {
    let patients = ["01-CoA", "02-CoA", "03-CoA", "05-CoA"];
    let cohort = Cohort::of(cluster, &patients, QUICK).set("executor.slurm.queue=standard");
    assert_eq!(cohort.advance().code, 8);
    assert_eq!(cohort.jobs().len(), 1);
    assert!(
        !cohort.script(0).contains("--array"),
        "{}",
        cohort.script(0)
    );
    let id = cohort.status()["cluster"]["jobs"][0]["id"]
        .as_str()
        .expect("a number")
        .to_owned();
    assert_eq!(
        cluster
            .slurm("squeue", &["-h", "-j", &id, "-o", "%C %D"])
            .trim(),
        "128 1"
    );
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    // In sequence the attempts would not have overlapped.
    let claims = cohort.attempts_with("started.json");
    assert!(claims.len() > 5 * patients.len());
    assert_eq!(claims.len(), cohort.attempts_with("outcome.json").len());
}
