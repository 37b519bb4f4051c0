//! Figures of docs/benchmarks.md that need a real Slurm: the cost of a sweep beyond its arithmetic.

use std::fs;
use std::time::Instant;

use serde_json::Value;

use crate::cluster::Cluster;
use crate::cohort::{Cohort, QUICK};

/// Nodes of four cores, with jobs so short that each node gets one.
const FOUR_NODES: &str = r#"
name = "four-nodes"
description = "deploy/one-machine-slurm.sh, whole nodes"
scheduler = "slurm"
[node]
cores = 4
memory_mib = 256000
unit = "node"
[arrays]
allowed = true
[poll]
shortest_s = 1
longest_s = 2
[[queue]]
name = "standard"
partition = "standard"
qos = "standard"
uses = ["chunks", "simulations"]
walltime = "00:08:00"
"#;

/// Processor time of child processes that have ended and been waited for, s.
fn children_cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").expect("a process knows itself");
    let fields: Vec<&str> = stat
        .rsplit(')')
        .next()
        .unwrap_or_default()
        .split_whitespace()
        .collect();
    let ticks = |i: usize| fields[i].parse::<f64>().expect("clock ticks");
    (ticks(13) + ticks(14)) / 100.0
}

/// Reads sacct's processor time, `[[DD-]HH:]MM:SS.mmm`, s.
fn seconds(text: &str) -> f64 {
    text.trim().split([':', '-']).fold(0.0, |total, part| {
        total * 60.0 + part.parse::<f64>().unwrap_or(0.0)
    })
}

/// 45,056 samples of the sensitivity analysis on four nodes: processor time per sample of all of
/// the project's processes.
pub fn a_sensitivity_analysis_on_four_nodes(cluster: &Cluster) {
    let cohort = Cohort::of(cluster, &[], QUICK);
    fs::write(cohort.site(), FOUR_NODES).expect("a profile");
    let (began, cpu_before) = (Instant::now(), children_cpu_s());
    let what = [
        "sweep",
        "gsa",
        "--resamples",
        "2",
        "--out",
        "run",
        "--slurm",
        &cohort.site(),
        "--watch",
    ];
    let said = cohort.call(&[&what[..], &["--account", "t01"]].concat());
    assert_eq!(said.code, 0, "{said:?}");
    let (wall_s, ticks_s) = (began.elapsed().as_secs_f64(), children_cpu_s() - cpu_before);
    let samples: usize = (cohort.attempts_with("samples.csv").iter())
        .map(|path| {
            fs::read_to_string(path.join("samples.csv"))
                .expect("a table")
                .lines()
                .count()
                - 1
        })
        .sum();
    assert_eq!(samples, 45_056);
    let outcomes = cohort.attempts_with("outcome.json");
    let of_worker = |path: &std::path::PathBuf| -> f64 {
        let text = fs::read_to_string(path.join("outcome.json")).expect("an outcome");
        serde_json::from_str::<Value>(&text).expect("JSON")["provenance"]["cpu_s"]
            .as_f64()
            .expect("a time")
    };
    let workers_s: f64 = outcomes.iter().map(of_worker).sum();
    let names = cohort
        .jobs()
        .iter()
        .map(|job| {
            job.file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned()
        })
        .collect::<Vec<_>>();
    // Rows of the jobs' steps: srun's step, with driver and workers, and the script's.
    let accounted = || {
        let columns = ["-n", "-P", "-o", "JobID,TotalCPU,NodeList,State", "--name"];
        let text = cluster.slurm("sacct", &[&columns[..], &[&names.join(",")]].concat());
        let is_step = |row: &&str| row.split('|').next().is_some_and(|id| id.contains('.'));
        text.lines()
            .filter(is_step)
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    cluster.wait("accounting", || {
        accounted().len() >= 8 && accounted().iter().all(|row| row.contains("COMPLETED"))
    });
    let rows = accounted();
    let jobs_s: f64 = rows
        .iter()
        .map(|row| seconds(row.split('|').nth(1).unwrap_or_default()))
        .sum();
    let mut nodes: Vec<&str> = rows
        .iter()
        .filter_map(|row| row.split('|').nth(2))
        .collect();
    nodes.sort_unstable();
    nodes.dedup();
    let each_us = |s: f64| s * 1e6 / samples as f64;
    println!(
        "{samples} samples in {} array of jobs on nodes {nodes:?}, {} tasks, wall {wall_s:.1} s; processor time for each sample: workers' \
         tasks {:.1} µs; jobs {:.1} µs; ticks with Slurm's commands, analysis and files {:.1} µs",
        cohort.jobs().len(),
        outcomes.len(),
        each_us(workers_s),
        each_us(jobs_s),
        each_us(ticks_s),
    );
    assert_eq!(nodes.len(), 4, "{rows:?}");
}
