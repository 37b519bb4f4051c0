//! The measurement of a beat in 3D on MPI ranks, with the real program on the smallest mesh.

use std::process::{Command, Stdio};

fn mpirun(n_ranks: usize, arguments: &[&str]) -> Command {
    let launcher = std::env::var("CARDIOTWIN_MPIRUN").unwrap_or_else(|_| "mpirun".to_owned());
    let mut words = launcher.split_whitespace();
    let mut command = Command::new(words.next().expect("a launcher"));
    command
        .args(words)
        .args([
            "-n",
            &n_ranks.to_string(),
            env!("CARGO_BIN_EXE_cardiotwin-dev-mpi"),
        ])
        .args(arguments);
    // Open MPI's; MPICH knows none of them and needs none.
    for name in [
        "OMPI_ALLOW_RUN_AS_ROOT",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM",
        "OMPI_MCA_rmaps_base_oversubscribe",
    ] {
        command.env(name, "1");
    }
    // The same from Open MPI 5 on.
    command.env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe");
    // Ranks that share a core nap by themselves; a yield inside each of MPI's calls besides costs milliseconds where others work.
    command.env("OMPI_MCA_mpi_yield_when_idle", "0");
    command.stdin(Stdio::null());
    command
}

#[test]
fn a_beat_on_two_ranks_is_measured() {
    let beat = [
        "--nodes", "500", "--cycle", "60", "--step", "5", "--json", "--ranks", "2",
    ];
    let out = mpirun(2, &beat).output().expect("the launcher starts");
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
