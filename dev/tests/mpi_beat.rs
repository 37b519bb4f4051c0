//! The measurement of a beat in 3D on MPI ranks, with the real program on the smallest mesh.

#[path = "../../worker/tests/support/launcher.rs"]
mod launcher;

#[test]
fn a_beat_on_two_ranks_is_measured() {
    let beat = [
        "--nodes", "500", "--cycle", "60", "--step", "5", "--json", "--ranks", "2",
    ];
    let out = launcher::mpirun(env!("CARGO_BIN_EXE_cardiotwin-dev-mpi"), 2, &beat)
        .output()
        .expect("the launcher starts");
    assert!(
        out.status.success(),
        "{}",
        String::from_utf8_lossy(&out.stderr)
    );
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).expect("JSON");
    assert_eq!(
        (found["threads"].as_u64(), found["steps"].as_u64()),
        (Some(2), Some(12))
    );
    let ranks = found["ranks"].as_array().expect("ranks");
    assert_eq!(ranks.len(), 2);
    let sum = |key: &str| {
        ranks
            .iter()
            .map(|rank| rank[key].as_f64().expect(key))
            .sum::<f64>()
    };
    assert_eq!(Some(sum("nodes")), found["nodes"].as_f64());
    assert!(sum("elements") > found["elements"].as_f64().expect("elements"));
    for key in [
        "ghosts",
        "halo_messages",
        "halo_MB",
        "reductions",
        "peak_memory_MB",
    ] {
        assert!(sum(key) > 0.0, "{key} in {found}");
    }
}
