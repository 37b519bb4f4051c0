//! The measurement of the coordinator, with the real programs on a few patients.

use std::path::Path;
use std::process::Command;

fn measured(more: &[&str]) -> serde_json::Value {
    let out = Command::new(env!("CARGO_BIN_EXE_cardiotwin-dev"))
        .arg("bench")
        .args(more)
        .arg("--json")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{errors}");
    serde_json::from_slice(&out.stdout).unwrap()
}

#[test]
fn a_killed_coordinator_is_measured_to_its_end() {
    let found = measured(&["orchestration", "--patients", "50", "--kill"]);
    assert_eq!(found["tasks"], 150);
    assert!(found["restart_s"].as_f64().unwrap() > 0.0, "{found}");
}

#[test]
fn each_task_can_have_a_worker_process() {
    let worker =
        Path::new(env!("CARGO_BIN_EXE_cardiotwin-dev")).with_file_name("cardiotwin-worker");
    assert!(
        worker.exists(),
        "`cargo build --release --workspace --bins` makes {}",
        worker.display()
    );
    let found = measured(&["orchestration", "--patients", "10", "--spawn"]);
    assert_eq!(found["executor"], "local");
}

#[test]
fn a_quiet_tick_asks_a_modelled_slurm_one_question() {
    let found = measured(&["slurm", "--jobs", "20", "--samples", "200"]);
    let asked = found["quiet"]["commands"].as_object().unwrap();
    let n: u64 = asked.values().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(n, 1, "{found}");
}
