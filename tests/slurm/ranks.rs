//! Simulations in 3D on MPI ranks: steps of a job, each on the nodes of its place.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK};

/// Lines that Open MPI needs in a job of root's.
const OPEN_MPI_AS_ROOT: &str =
    r#"setup = ["export OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1"]"#;

/// Reason why no ranks can be started here; `None` if they can.
pub fn hindrance(cluster: &Cluster) -> Option<String> {
    let worker = crate::cohort::binary("cardiotwin-worker").with_file_name("cardiotwin-worker-mpi");
    if !worker.is_file() {
        return Some(format!("{} is not there", worker.display()));
    }
    let plugins = cluster.slurm("srun", &["--mpi=list"]);
    (!plugins.contains("pmix")).then(|| format!("srun has no pmix: {plugins}"))
}

/// A quick cohort in 3D whose simulations have `threads` ranks, at most `ranks_per_node` on a node.
fn in_3d<'a>(
    cluster: &'a Cluster,
    patients: &[&str],
    launcher: &str,
    threads: u32,
    ranks_per_node: u32,
) -> Cohort<'a> {
    Cohort::of(cluster, patients, QUICK)
        .set("solver.fidelity=finite-element")
        .set("solver.finite_element.mesh_nodes=500")
        .set("solver.time_step_ms=2")
        .set("step1.max_iterations=1")
        .set("verification.enabled=false")
        .set(&format!("executor.launcher=[{launcher:?}]"))
        .set(&format!("executor.threads={threads}"))
        .set(&format!("executor.ranks_per_node={ranks_per_node}"))
        // Chains this short share places. With an hour each, every patient would have a place of
        // its own.
        .set("executor.slurm.simulation_s=1")
}

/// A quick cohort in 3D on ARCHER2's profile, each simulation on two ranks, one on each of two nodes.
pub fn over_two_nodes<'a>(cluster: &'a Cluster, patients: &[&str]) -> Cohort<'a> {
    let cohort = in_3d(cluster, patients, "srun", 2, 1).set("executor.slurm.account=t01");
    archer2(&cohort, "");
    cohort
}

/// The profile of ARCHER2 as it is shipped, with further lines before its first table.
fn archer2(cohort: &Cohort, lines: &str) {
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("../deploy/sites/archer2.toml");
    let text = fs::read_to_string(shipped).expect("the profile");
    let text = match lines {
        "" => text,
        _ => {
            let (begin, rest) = text.split_once("setup = [").expect("lines of set-up");
            let (_, rest) = rest.split_once("]\n").expect("their end");
            format!("{begin}{lines}\n{rest}")
        }
    };
    fs::write(cohort.site(), text).expect("a profile");
}

/// A step of a job, as Slurm's accounting has it.
#[derive(Debug)]
struct Step {
    nodes: String,
    n_tasks: u32,
}

fn steps(cluster: &Cluster, job: &str) -> Vec<Step> {
    let told = cluster.slurm(
        "sacct",
        &["-n", "-P", "-j", job, "--format=JobID,NodeList,NTasks"],
    );
    let step = |line: &str| {
        let mut cells = line.split('|');
        let (_, number) = cells.next()?.split_once('.')?;
        number.parse::<u32>().ok()?;
        Some(Step {
            nodes: cells.next()?.to_owned(),
            n_tasks: cells.next()?.parse().ok()?,
        })
    };
    told.lines().filter_map(step).collect()
}

fn number_of(cohort: &Cohort, n: usize) -> String {
    let claim = cohort.jobs()[n].join("started-0-0.json");
    let claim: Value =
        serde_json::from_str(&fs::read_to_string(claim).expect("a driver's claim")).expect("JSON");
    claim["job"].as_str().expect("a number").to_owned()
}

/// Number of ranks of each outcome.
fn ranks(cohort: &Cohort) -> Vec<Option<u64>> {
    let of = |path: &PathBuf| {
        let text = fs::read_to_string(path.join("outcome.json")).expect("an outcome");
        let outcome: Value = serde_json::from_str(&text).expect("JSON");
        outcome["provenance"]["ranks"].as_u64()
    };
    cohort
        .attempts_with("outcome.json")
        .iter()
        .map(of)
        .collect()
}

/// Four patients on two nodes of ARCHER2's, as its profile is shipped, with srun and with mpirun:
/// two simulations side by side on each node, each a step on one node.
pub fn four_patients_share_two_nodes_of_archer2(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    for (launcher, lines) in [("srun", ""), ("mpirun", OPEN_MPI_AS_ROOT)] {
        // A launcher may fail to start ranks, once in hundreds of starts: another job then tries
        // again, as "a faulty srun is tried again" asserts. Twice is no accident.
        if let Err(story) = on_two_nodes(cluster, launcher, lines) {
            println!("a launch failed and was tried again: {story}");
            let again = on_two_nodes(cluster, launcher, lines);
            again.unwrap_or_else(|story| panic!("{launcher}: {story}"));
        }
    }
}

/// The error is the story of a step that was repeated because its ranks never started.
fn on_two_nodes(cluster: &Cluster, launcher: &str, lines: &str) -> Result<(), String> {
    let patients = ["01-CoA", "02-CoA", "05-CoA", "06-CoA"];
    let cohort = in_3d(cluster, &patients, launcher, 2, 4).set("executor.slurm.account=t01");
    archer2(&cohort, lines);
    assert_eq!(cohort.advance().code, 8);
    let script = cohort.script(0);
    assert!(
        cohort.jobs().len() == 1 && script.contains("--nodes=2") && script.contains("--exclusive"),
        "{script}"
    );
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    let tally = cohort.tally();
    if tally.repeated > 0 {
        return Err(format!("{tally:?}\n{}", cohort.story()));
    }
    assert_eq!(cohort.jobs().len(), 1, "{launcher}: {}", cohort.story());
    let on_two = ranks(&cohort).iter().filter(|n| **n == Some(2)).count();
    assert!(on_two >= 8, "step 0 and a beat of each: {on_two}");
    if launcher == "srun" {
        let steps = steps(cluster, &number_of(&cohort, 0));
        let pairs: Vec<&Step> = steps.iter().filter(|step| step.n_tasks == 2).collect();
        let mut nodes: Vec<&str> = pairs.iter().map(|step| step.nodes.as_str()).collect();
        nodes.sort_unstable();
        nodes.dedup();
        assert!(
            pairs.len() == on_two
                && nodes.len() == 2
                && nodes.iter().all(|node| !node.contains(['[', ','])),
            "each simulation on one of two nodes: {steps:?}"
        );
    }
    Ok(())
}

/// Four patients share two nodes, on ranks of MPICH, which srun starts through PMI-2. The programs are
/// those that `make test-mpich` builds.
pub fn ranks_of_mpich_start_through_pmi2(cluster: &Cluster) {
    let release = crate::cohort::binary("cardiotwin-worker");
    let worker = release
        .ancestors()
        .nth(2)
        .expect("the target folder")
        .join("mpich/release/cardiotwin-worker");
    let of_ranks = worker.with_file_name("cardiotwin-worker-mpi");
    if !of_ranks.is_file() {
        crate::not_tested("mpich", &format!("{} is not there", of_ranks.display()));
        return;
    }
    let patients = ["01-CoA", "02-CoA", "05-CoA", "06-CoA"];
    let cohort = in_3d(cluster, &patients, "srun", 2, 4)
        .set("executor.launcher=[\"srun\",\"--mpi=pmi2\"]")
        .set("executor.slurm.account=t01")
        .with_worker(&worker);
    archer2(&cohort, "");
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    assert_eq!(cohort.tally().repeated, 0);
    let on_two = ranks(&cohort).iter().filter(|n| **n == Some(2)).count();
    assert!(on_two >= 8, "step 0 and a beat of each: {on_two}");
}

/// Ranks whose MPI does not understand the launcher take themselves for single ones, as Open MPI
/// behind Cray's plugin does: the simulation ends before it begins, and says which options help.
pub fn a_launcher_of_another_mpi_is_told(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let plugins = cluster.slurm("srun", &["--mpi=list"]);
    let foreign = ["cray_shasta", "none"]
        .into_iter()
        .find(|plugin| plugins.contains(plugin))
        .expect("a plugin");
    let cohort = in_3d(cluster, &["06-CoA"], "srun", 2, 4)
        .set(&format!("executor.launcher=[\"srun\",\"--mpi={foreign}\"]"))
        .set("executor.slurm.account=t01");
    archer2(&cohort, "");
    assert_eq!(cohort.finish(), 1, "{:#}", cohort.status());
    let told = cohort.call(&["explain", "06-CoA"]).out;
    assert!(told.contains("launcher"), "{told}");
}

/// Script in place of srun: its first call fails, its second is killed together with srun, the others are srun's.
const FAULTY_SRUN: &str = r#"#!/bin/bash
calls=$0.calls
echo call >>"$calls"
case $(wc -l <"$calls") in
1) echo "srun: error: Unable to create step for job: Socket timed out on send/recv operation" >&2; exit 1 ;;
2) srun "$@" & sleep 0.5; kill -KILL $!; kill -KILL $$ ;;
*) exec srun "$@" ;;
esac
"#;

/// A step that srun cannot create, and one whose srun is killed, are each tried again in another job;
/// no rank of the killed srun is left.
pub fn a_faulty_srun_is_tried_again(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let cohort = in_3d(cluster, &["06-CoA"], "srun", 2, 4).set("executor.slurm.account=t01");
    let faulty = cohort.folder.path().join("srun");
    fs::write(&faulty, FAULTY_SRUN).expect("a script");
    fs::set_permissions(&faulty, fs::Permissions::from_mode(0o700)).expect("its mode");
    let cohort = cohort.set(&format!("executor.launcher=[{faulty:?}]"));
    archer2(&cohort, "");
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    let tally = cohort.tally();
    assert_eq!(
        (tally.repeated, tally.again, cohort.jobs().len()),
        (2, 0, 3),
        "{tally:?}"
    );
    cluster.wait("the end of every rank", || n_workers(&cohort) == 0);
}

/// Waits until a beat in 3D is under way that has a checkpoint.
#[track_caller]
fn wait_for_beat(cohort: &Cohort) {
    cohort.cluster.wait("a checkpoint of a beat", || {
        cohort.attempts_with("checkpoint").iter().any(|path| {
            let spec = fs::read_to_string(path.join("spec.json")).unwrap_or_default();
            spec.contains("organ-beat") && !path.join("outcome.json").exists()
        })
    });
}

/// Number of live processes that work in the cohort's folder: workers, all ranks included.
fn n_workers(cohort: &Cohort) -> usize {
    let folder = cohort.folder.path().join("run");
    let processes = fs::read_dir("/proc").expect("Linux").flatten();
    let works_there = |process: &fs::DirEntry| {
        let command = fs::read(process.path().join("cmdline")).unwrap_or_default();
        let command = String::from_utf8_lossy(&command).into_owned();
        command.contains("cardiotwin-worker") && command.contains(&*folder.to_string_lossy())
    };
    processes.filter(works_there).count()
}

/// A simulation over two nodes loses one of them and continues elsewhere from its checkpoint; then a
/// person cancels it, and no rank stays behind.
pub fn a_simulation_over_nodes_loses_one_and_is_cancelled(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let cohort = over_two_nodes(cluster, &["06-CoA"])
        .set("solver.time_step_ms=0.2")
        .set("solver.finite_element.mesh_nodes=1500");
    assert_eq!(cohort.advance().code, 8);
    wait_for_beat(&cohort);
    // The driver runs on n1; n2 has a rank alone.
    let spread = steps(cluster, &number_of(&cohort, 0));
    let on_both = |step: &Step| step.n_tasks == 2 && step.nodes == "n[1-2]";
    assert!(spread.iter().any(on_both), "{spread:?}");
    // Without its slurmd, the node does not report back for duty.
    cluster.kill("n2");
    let down = ["update", "nodename=n2", "state=down", "reason=test"];
    cluster.slurm("scontrol", &down);
    cluster.wait("another job", || {
        cohort.advance();
        cohort.jobs().len() == 2
    });
    // The rank there ends with its node.
    cluster.crash("n2");
    cluster.wait("the beat's second attempt", || {
        let again = cohort.attempts_with("progress.jsonl");
        again
            .iter()
            .any(|path| path.to_string_lossy().ends_with("-g2"))
    });
    let told = cohort.call(&["explain", "06-CoA"]).out;
    assert!(told.contains("node failure"), "{told}");
    let second = number_of(&cohort, 1);
    cluster.wait("a step on other nodes in accounting", || {
        let on_others = |step: &Step| step.n_tasks == 2 && !step.nodes.contains('2');
        steps(cluster, &second).iter().any(on_others)
    });
    let tally = cohort.tally();
    assert_eq!((tally.repeated, tally.again), (1, 0), "{tally:?}");

    let said = cohort.call(&["cancel", "--all"]);
    assert_eq!(said.code, 0, "{said:?}");
    assert_eq!(cluster.slurm("squeue", &["--me", "-h"]), "");
    cluster.wait("the end of every rank", || n_workers(&cohort) == 0);
}

/// Two ranks run out of their share of a node's memory; then the node has half as many ranks.
pub fn ranks_that_run_out_of_memory_get_more(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let cohort = in_3d(cluster, &["06-CoA"], "srun", 2, 4)
        .set("executor.slurm.account=t01")
        .set("solver.finite_element.mesh_nodes=2500");
    archer2(&cohort, "");
    // Half a node of 128 cores gives a simulation 64 MiB.
    cohort.change_profile("memory_per_core_mib = 1500", "memory_per_core_mib = 1");
    assert_eq!(cohort.advance().code, 8);
    cluster.wait("the end of the first job", || {
        cohort.jobs()[0].join("ended-0-0.json").exists()
    });
    assert_eq!(cohort.advance().code, 8);
    let told = cohort.call(&["explain", "06-CoA"]).out;
    assert!(told.contains("out of memory"), "{told}");
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    let tally = cohort.tally();
    assert_eq!(
        (tally.again, cohort.jobs().len()),
        (0, 2),
        "half as many ranks are enough: {tally:?}"
    );
}

/// One simulation over two and four nodes. A warning in the middle of a beat leaves a checkpoint,
/// from which another job continues, with other ranks on other nodes.
pub fn one_simulation_spans_nodes(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let cohort = in_3d(cluster, &["06-CoA"], "srun", 4, 1)
        .set("executor.slurm.account=t01")
        .set("solver.time_step_ms=0.5")
        .set("solver.finite_element.mesh_nodes=1500");
    archer2(&cohort, "");
    assert_eq!(cohort.advance().code, 8);
    assert!(
        cohort.script(0).contains("--nodes=4"),
        "{}",
        cohort.script(0)
    );
    wait_for_beat(&cohort);
    let job = number_of(&cohort, 0);
    cluster.slurm("scancel", &["--signal=USR1", "--batch", &job]);
    cluster.wait("the end of the job", || {
        cohort.jobs()[0].join("ended-0-0.json").exists()
    });
    let spread = steps(cluster, &job);
    assert!(
        spread
            .iter()
            .any(|step| step.n_tasks == 4 && step.nodes == "n[1-4]"),
        "{spread:?}"
    );
    let cohort = cohort
        .set("executor.threads=6")
        .set("executor.ranks_per_node=3");
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    let tally = cohort.tally();
    assert_eq!(
        (tally.repeated, tally.again, cohort.jobs().len()),
        (1, 0, 2),
        "{tally:?}"
    );
    let last = steps(cluster, &number_of(&cohort, 1));
    assert!(
        last.iter()
            .any(|step| step.n_tasks == 6 && step.nodes == "n[1-2]"),
        "{last:?}"
    );
}

/// The paper's run, in small: its seven patients on four nodes of ARCHER2's, each simulation a step
/// of two ranks, with the scripts that `plan` prints (docs/slurm.md#the-papers-run).
pub fn the_papers_run_is_rehearsed(cluster: &Cluster) {
    if let Some(why) = hindrance(cluster) {
        crate::not_tested("mpi", &why);
        return;
    }
    let patients: Vec<String> = (1..=7).map(|n| format!("0{n}-CoA")).collect();
    let patients: Vec<&str> = patients.iter().map(String::as_str).collect();
    let cohort = in_3d(cluster, &patients, "srun", 2, 2)
        .set("executor.slurm.account=t01")
        .set("executor.slurm.bundle_nodes=4")
        // An hour for each patient makes a place on a node of its own.
        .set("executor.slurm.simulation_s=600");
    archer2(&cohort, "");
    let planned = cohort
        .call(&cohort.with_settings(&["plan", "--script"]))
        .out;
    assert_eq!(cohort.advance().code, 8);
    let names: Vec<String> = cohort
        .jobs()
        .iter()
        .filter_map(|job| Some(job.file_name()?.to_string_lossy().into_owned()))
        .collect();
    let mut submitted: Vec<String> = Vec::new();
    for (n, name) in names.iter().enumerate() {
        let script = cohort.script(n);
        let has_four = script.contains("--nodes=4");
        assert!(has_four || script.contains("--nodes=3"), "{script}");
        submitted.push(script.trim_end().replace(name, "JOB"));
    }
    let number = regex::Regex::new("ct-plan-[0-9]+").expect("an expression");
    let planned = number.replace_all(&planned, "JOB").into_owned();
    for script in &submitted {
        assert!(
            planned.contains(script),
            "planned:\n{planned}\nsubmitted:\n{script}"
        );
    }
    assert_eq!(cohort.finish(), 0, "{:#}", cohort.status());
    cohort.assert_done();
    assert_eq!(cohort.tally().repeated, 0);
    let steps: Vec<Step> = (0..names.len())
        .flat_map(|n| steps(cluster, &number_of(&cohort, n)))
        .filter(|step| step.n_tasks == 2)
        .collect();
    let mut nodes: Vec<&str> = steps.iter().map(|step| step.nodes.as_str()).collect();
    nodes.sort_unstable();
    nodes.dedup();
    assert_eq!(nodes, ["n1", "n2", "n3", "n4"], "{steps:?}");
    assert!(
        steps.len() >= 14,
        "step 0 and a beat of each patient: {steps:?}"
    );
}
