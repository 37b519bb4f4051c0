//! The benchmark of a 3D beat, with the real program on the smallest mesh.

use std::process::Command;

#[test]
fn a_beat_on_two_threads_is_measured_with_all_that_it_is_made_of() {
    let run = |more: &[&str]| {
        let program = env!("CARGO_BIN_EXE_cardiotwin-dev");
        Command::new(program)
            .args(["bench", "beat", "--nodes", "500", "--cycle", "60"])
            .args(more)
            .output()
            .unwrap()
    };
    let out = run(&["--threads", "2", "--step", "5", "--json"]);
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let number = |path: &str| path.split('/').fold(&found, |at, key| &at[key]).as_f64();
    assert_eq!(
        (number("steps"), number("threads"), &found["element"]),
        (Some(12.0), Some(2.0), &"linear".into())
    );
    for path in [
        "nodes",
        "elements",
        "seconds_total",
        "seconds_per_phase/isovolumic_contraction",
        "peak_memory_MB",
        "beat_peak_memory_MB",
        "ns_per_tet/deform",
        "ns_per_tet/forces",
        "ns_per_tet/forces_tangent_scatter",
        "ms_per_krylov_iteration",
        "MB_per_krylov_iteration",
        "krylov_GB_per_s",
        "triad_GB_per_s",
        "krylov_over_bandwidth_bound",
        "newton_per_step",
        "krylov_per_newton",
        "biomarkers/P_max_mmHg",
    ] {
        assert!(
            number(path).is_some_and(|value| value > 0.0 && value.is_finite()),
            "{path} in {found}"
        );
    }
    let both = run(&["--threads", "1,2", "--step", "5", "--json"]);
    let both: serde_json::Value = serde_json::from_slice(&both.stdout).unwrap();
    assert_eq!(
        (
            both["beats"].as_array().map(Vec::len),
            both["speedup"][0].as_f64()
        ),
        (Some(2), Some(1.0))
    );
    assert!(both["speedup"][1].as_f64() > Some(0.0));
    let ranks = |beat: usize| both["beats"][beat]["ranks"].as_array().unwrap().clone();
    assert_eq!(
        (ranks(0).len(), ranks(0)[0]["halo_messages"].as_u64()),
        (1, Some(0))
    );
    assert!(
        ranks(1)
            .iter()
            .all(|rank| rank["halo_MB"].as_f64() > Some(0.0))
    );
    let refused = run(&["--threads", "0"]);
    assert_eq!(
        refused.status.code(),
        Some(2),
        "{}",
        String::from_utf8_lossy(&refused.stderr)
    );
}

#[test]
fn shortcuts_stand_beside_a_tight_run() {
    let program = env!("CARGO_BIN_EXE_cardiotwin-dev");
    let bench = [
        "bench",
        "shortcuts",
        "--nodes",
        "500",
        "--cycle",
        "60",
        "--step",
        "5",
        "--json",
    ];
    let out = Command::new(program).args(bench).output().unwrap();
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let rows = found["rows"].as_array().unwrap();
    let p_max = |row: &serde_json::Value| row["biomarkers"]["P_max_mmHg"].as_f64().unwrap();
    assert_eq!(rows[0]["off_percent"][0].as_f64(), Some(0.0));
    for row in rows
        .iter()
        .filter(|row| row["name"] != "steps twice as long")
    {
        let off = 100.0 * (p_max(row) / p_max(&rows[0]) - 1.0);
        assert!(
            (row["off_percent"][0].as_f64().unwrap() - off).abs() < 1e-9 && off.abs() < 0.5,
            "{row}"
        );
    }
    let off = |name: &str| {
        rows.iter().find(|row| row["name"] == name).unwrap()["off_percent"][0]
            .as_f64()
            .unwrap()
            .abs()
    };
    assert!(
        off("Newton's tolerance 1e-6") < off("Newton's tolerance 1e-3"),
        "{found}"
    );
}

/// METIS handles SIGTERM itself during the partition; afterwards the handler must be the
/// benchmark's again.
#[test]
fn sigterm_ends_a_beat_on_two_threads() {
    use std::io::{BufRead as _, BufReader};
    // With steps so short that the beat does not end during the test.
    let program = env!("CARGO_BIN_EXE_cardiotwin-dev");
    let bench = [
        "bench",
        "beat",
        "--nodes",
        "500",
        "--threads",
        "2",
        "--cycle",
        "10000",
        "--step",
        "0.05",
    ];
    let mut child = Command::new(program)
        .args(bench)
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap())
        .lines()
        .map(Result::unwrap);
    assert!(
        lines.any(|line| line.contains(" of 10000 ms")),
        "the beat has begun"
    );
    assert!(
        Command::new("kill")
            .arg(child.id().to_string())
            .status()
            .unwrap()
            .success()
    );
    let rest: Vec<String> = lines.collect();
    assert_eq!(child.wait().unwrap().code(), Some(1));
    assert!(
        rest.iter().any(|line| line.contains("stopped on request")),
        "{rest:?}"
    );
}
