//! The bench of a beat in 3D, with the real program on the smallest mesh.

use std::process::Command;

#[test]
fn a_beat_on_two_threads_is_measured_with_all_that_it_is_made_of() {
    let run = |more: &[&str]| {
        let program = env!("CARGO_BIN_EXE_cardiotwin-worker");
        Command::new(program).args(["bench", "beat", "--nodes", "500", "--cycle", "60"]).args(more).output().unwrap()
    };
    let out = run(&["--threads", "2", "--step", "5", "--json"]);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let number = |path: &str| path.split('/').fold(&found, |at, key| &at[key]).as_f64();
    assert_eq!((number("steps"), number("threads"), &found["element"]), (Some(12.0), Some(2.0), &"linear".into()));
    for path in [
        "nodes",
        "elements",
        "seconds_total",
        "seconds_per_phase/isovolumic_contraction",
        "peak_memory_MB",
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
        assert!(number(path).is_some_and(|value| value > 0.0 && value.is_finite()), "{path} in {found}");
    }
    let refused = run(&["--threads", "0"]);
    assert_eq!(refused.status.code(), Some(2), "{}", String::from_utf8_lossy(&refused.stderr));
}
