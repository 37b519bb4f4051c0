//! Simulations in 3D on a site that gives whole nodes: several nodes in one job, with a driver on
//! each.

use std::fs;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK};

/// Nodes of one core, so that one patient fills a node.
const WHOLE_NODES: &str = r#"
name = "whole-nodes"
description = "deploy/one-machine-slurm.sh, whole nodes"
scheduler = "slurm"
[node]
cores = 1
memory_mib = 256000
unit = "node"
[arrays]
allowed = false
[poll]
shortest_s = 1
longest_s = 2
[[queue]]
name = "taskfarm"
partition = "standard"
qos = "taskfarm"
uses = ["simulations", "chunks"]
walltime = "12:00:00"
max_nodes_per_job = 2
max_running = 1
"#;

/// Three patients on two nodes: the node that is free first takes the third patient.
pub fn several_whole_nodes_in_one_job(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &["01-CoA", "02-CoA", "05-CoA"], QUICK)
        .set("solver.fidelity=finite-element")
        .set("solver.finite_element.mesh_nodes=500")
        // Chains this short share places. With an hour each, every patient would have a node of its
        // own.
        .set("executor.slurm.simulation_s=1");
    fs::write(cohort.site(), WHOLE_NODES).expect("a profile");
    assert_eq!(cohort.advance().code, 8);
    let script = cohort.script(0);
    assert!(
        cohort.jobs().len() == 1 && script.contains("--nodes=2") && script.contains("--exclusive"),
        "{script}"
    );
    let job = cohort.jobs()[0].clone();
    cluster.wait("a driver on each node", || {
        (0..2).all(|node| job.join(format!("started-0-{node}.json")).exists())
    });
    cluster.wait("two workers at once", || cohort.workers().len() == 2);
    assert_eq!(cohort.finish(), 0);
    cohort.assert_done();
    assert_eq!(
        cohort.jobs().len(),
        1,
        "one wait in the queue for all of them"
    );
    let tally = cohort.tally();
    assert_eq!(tally.repeated, 0, "{tally:?}");
    println!("three patients in 3D in one job of two whole nodes: {tally:?}");
}
