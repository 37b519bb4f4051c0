//! The MPI launcher of tests, for the worker and for the programs of developers.

use std::process::{Command, Stdio};

/// `program` on `n_ranks` ranks of the launcher. `CARDIOTWIN_MPIRUN` is the launcher with its arguments; the default is
/// `mpirun`.
pub fn mpirun(program: &str, n_ranks: usize, arguments: &[&str]) -> Command {
    let launcher = std::env::var("CARDIOTWIN_MPIRUN").unwrap_or_else(|_| "mpirun".to_owned());
    let mut words = launcher.split_whitespace();
    let mut command = Command::new(words.next().expect("a launcher"));
    command
        .args(words)
        .args(["-n", &n_ranks.to_string(), program])
        .args(arguments);
    // Variables of Open MPI; MPICH ignores them and does not need them.
    for name in [
        "OMPI_ALLOW_RUN_AS_ROOT",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM",
        "OMPI_MCA_rmaps_base_oversubscribe",
    ] {
        command.env(name, "1");
    }
    // The equivalent from Open MPI 5 on.
    command.env("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe");
    // Ranks that share a core already sleep between polls. Yielding inside each MPI call as well
    // costs milliseconds on a busy machine.
    command.env("OMPI_MCA_mpi_yield_when_idle", "0");
    command.stdin(Stdio::null());
    command
}
