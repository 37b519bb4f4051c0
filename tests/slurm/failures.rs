//! Classes of failure, each on the real Slurm.

use rustix::process::{Pid, Signal};

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK, SLOW};

pub fn a_job_that_a_person_cancels_stays_cancelled(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    cluster.slurm("scancel", &[&job]);
    assert_eq!(cohort.finish(), 1);
    let status = cohort.status();
    assert_eq!(status["patients"][0]["state"], "cancelled", "{status:#}");
    assert_eq!(cohort.advance().code, 1, "it stays so");
    assert_eq!(cohort.jobs().len(), 1);
    // Until it is asked for again.
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
    let left = cluster.slurm("squeue", &["--me", "-h", "-j", &job]);
    assert!(left.is_empty(), "the job is still there: {left}");
    assert_eq!(cohort.status()["patients"][0]["state"], "cancelled");
}

pub fn a_lost_node_is_avoided(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    cohort.wait_for_checkpoint();
    let node = cluster.slurm("squeue", &["-h", "-j", &job, "-o", "%N"]).trim().to_owned();
    cluster.slurm("scontrol", &["update", &format!("nodename={node}"), "state=down", "reason=test"]);
    cluster.wait("a job elsewhere", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    assert!(cohort.script(1).contains(&format!("--exclude={node}")), "{}", cohort.script(1));
    // What it had done is not done again, and its last step goes on from the checkpoint.
    let begun = cohort.attempts_with("started.json");
    let again = begun.iter().filter(|path| path.to_string_lossy().ends_with("-g2")).count();
    cluster.wait("the second attempt", || {
        cohort.attempts_with("started.json").iter().any(|path| path.to_string_lossy().ends_with("-g2"))
    });
    assert!(again <= 1);
    assert!(
        cohort.call(&["explain", "01-CoA"]).out.contains("node failure"),
        "{:?}",
        cohort.call(&["explain", "01-CoA"])
    );
    cohort.call(&["cancel", "--all"]);
}

pub fn a_warning_leaves_a_checkpoint_and_another_job_goes_on(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], SLOW);
    let job = cohort.running_job();
    cohort.wait_for_checkpoint();
    // As Slurm does before the walltime: the warning goes to the script, which hands it on.
    cluster.slurm("scancel", &["--signal=USR1", "--batch", &job]);
    cluster.wait("the job's last word", || cohort.jobs()[0].join("ended-0-0.json").exists());
    let said = std::fs::read_to_string(cohort.jobs()[0].join("ended-0-0.json")).expect("it is there");
    assert!(said.contains("out-of-time"), "{said}");
    cluster.wait("a job that goes on", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    cluster.wait("the attempt that goes on", || {
        let second =
            cohort.attempts_with("checkpoint").into_iter().find(|path| path.to_string_lossy().ends_with("-g2"));
        second.is_some_and(|path| {
            let log = std::fs::read_to_string(path.join("stderr.log")).unwrap_or_default();
            let journal = path.join("checkpoint/told-costs");
            journal.metadata().is_ok_and(|m| m.len() > 2000) || log.contains("goes on")
        })
    });
    let begun = cohort.attempts_with("started.json");
    assert_eq!(begun.iter().filter(|path| path.to_string_lossy().ends_with("-g2")).count(), 1, "one step goes on");
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
        let line = script.lines().find_map(|line| line.strip_prefix("#SBATCH --mem=")).expect("a demand").to_owned();
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
    // ARCHER2's `serial` takes 32 jobs of a user; held ones count.
    let filler = ["--hold", "--partition=serial", "--qos=serial", "--array=0-31", "--time=1", "--wrap=true"];
    cluster.slurm("sbatch", &filler);
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK).set("executor.slurm.queue=serial");
    assert_eq!(cohort.advance().code, 8);
    let status = cohort.status();
    let note = status["patients"][0]["note"].as_str().unwrap_or_default().to_owned();
    let holds = status["cluster"]["holds"].as_str().unwrap_or_default().to_owned();
    assert!(holds.contains("the queue takes no more"), "{status:#}");
    assert!(!note.is_empty(), "{status:#}");
    assert!(cohort.attempts_with("started.json").is_empty());
    cluster.slurm("scancel", &["--me"]);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
}

pub fn what_slurm_never_takes_is_told(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA"], QUICK).set("executor.slurm.account=nobody");
    assert_eq!(cohort.finish(), 1);
    let status = cohort.status();
    let patient = &status["patients"][0];
    assert_eq!(patient["state"], "failed", "{status:#}");
    assert!(patient["note"].as_str().is_some_and(|note| note.contains("Invalid account")), "{status:#}");
    assert_eq!(cohort.jobs().len(), 1, "never tried again as it is");
    assert_eq!(cohort.call(&["retry", "--failed", "--class", "refused"]).code, 0);
    let repaired = cohort.set("executor.slurm.account=t01");
    assert_eq!(repaired.finish(), 0);
    repaired.assert_done();
}
