//! 3D simulations on the ranks of an MPI launcher, if one is installed.

use std::path::Path;
use std::process::Command;

use super::support::{Cohort, binary};

/// Step 0 and one beat, as short as possible.
const RUN: [&str; 15] = [
    "run",
    "--no-report",
    "--fidelity",
    "finite-element",
    "--mesh-nodes",
    "500",
    "--set",
    "executor.threads=2",
    "--set",
    "step1.max_iterations=1",
    "--set",
    "verification.enabled=false",
    "--set",
    "solver.time_step_ms=2",
    "--set",
];

#[test]
fn a_launcher_that_is_not_there_is_named_before_anything_runs() {
    let cohort = Cohort::quick_of("06-CoA");
    let setting = "executor.launcher=[\"no-such-launcher\", \"-x\"]";
    let said = cohort.call(&[&RUN[..], &[setting]].concat());
    assert_ne!(said.code, 0);
    said.complains_of(&[
        "executor.launcher",
        "no-such-launcher",
        "expected the launcher of an MPI",
    ]);
}

#[test]
fn a_beat_in_3d_runs_on_the_ranks_of_a_launcher() {
    let worker = binary("cardiotwin-worker").with_file_name("cardiotwin-worker-mpi");
    let launcher = std::env::var("CARDIOTWIN_MPIRUN").unwrap_or_else(|_| "mpirun".to_owned());
    let is_there = Command::new(launcher.split_whitespace().next().unwrap_or_default())
        .arg("--version")
        .output()
        .is_ok();
    if !worker.is_file() || !is_there {
        cardiotwin_not_tested::not_tested(
            "mpi",
            format!("{} or {launcher} is not there", worker.display()),
        );
        return;
    }
    let cohort = Cohort::quick_of("06-CoA");
    let words: Vec<String> = ["env"]
        .into_iter()
        .chain(OPEN_MPI)
        .chain(launcher.split_whitespace())
        .map(|word| format!("{word:?}"))
        .collect();
    let setting = format!("executor.launcher=[{}]", words.join(", "));
    cohort.call(&[&RUN[..], &[&setting]].concat()).expect(0);
    let patient = cohort.patient("06-CoA");
    let run = &patient["iterations"][0]["run"];
    let directory = Path::new(run["directory"].as_str().expect("a directory"));
    let outcome = std::fs::read_to_string(directory.join("outcome.json")).expect("an outcome");
    let outcome: serde_json::Value = serde_json::from_str(&outcome).expect("JSON");
    assert_eq!(outcome["provenance"]["ranks"], 2, "{outcome:#}");
}

/// Settings for Open MPI as root and on more ranks than cores; MPICH ignores them.
const OPEN_MPI: [&str; 5] = [
    "OMPI_ALLOW_RUN_AS_ROOT=1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1",
    "OMPI_MCA_rmaps_base_oversubscribe=1",
    "PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe",
    "OMPI_MCA_mpi_yield_when_idle=0",
];
