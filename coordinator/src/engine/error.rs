//! What can end the loop itself; what a task does never is among it.

use std::path::PathBuf;

use cardiotwin_workflow::IllegalTransition;

use crate::dispatch::DispatchError;
use crate::store::StoreError;
use crate::store::lock::LockError;

/// The loop cannot go on. What was committed stays; `run` again continues.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// Another coordinator holds the run, or the lock cannot be had.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The database.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file or directory of the run.
    #[error("cannot {what} {path}")]
    File {
        /// Verb.
        what: &'static str,
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The worker is not where it should be.
    #[error("no worker at {path}: build it (`cargo build --release`) or name it with --worker")]
    NoWorker {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// The launcher of MPI ranks is not there.
    #[error(
        "executor.launcher: no program {program:?} in PATH, expected the launcher of an MPI, such as mpirun: install one \
         (docs/mpi.md), or leave executor.launcher away: 3D simulations then run on threads"
    )]
    NoLauncher {
        /// As it was set.
        program: String,
    },
    /// The worker for MPI ranks is not where it should be.
    #[error(
        "no worker for executor.launcher at {path}: build it with the launcher's MPI \
         (`cargo build --release --package cardiotwin-worker --features mpi --bin cardiotwin-worker-mpi`, docs/mpi.md), or leave \
         executor.launcher away: 3D simulations then run on threads"
    )]
    NoMpiWorker {
        /// Where it was looked for.
        path: PathBuf,
    },
    /// Another worker than the run began with.
    #[error(
        "this run began with the worker {began}, and this one is {found}: results of both would stand side by side; \
         go on with the first, or say --adopt-version"
    )]
    OtherWorker {
        /// Version and hash of the first.
        began: String,
        /// Version and hash of this one.
        found: String,
    },
    /// A defect of ours.
    #[error("a decision led nowhere")]
    Transition(#[from] IllegalTransition),
    /// A request that makes no sense.
    #[error("{message}")]
    Request {
        /// What was asked, what was found, what to do.
        message: String,
    },
    /// An attempt cannot be handed over or looked at.
    #[error(transparent)]
    Dispatch(#[from] DispatchError),
    /// The disk is full.
    #[error(
        "only {free_mb} MB are free for {path}: free some and run again, nothing that is finished is lost"
    )]
    NoSpace {
        /// The run directory.
        path: PathBuf,
        /// What is left.
        free_mb: u64,
    },
    /// A stored plan that this version cannot read.
    #[error("the stored plan of {patient} cannot be read; run the cohort again to replace it")]
    Plan {
        /// Whose.
        patient: String,
        /// Why.
        source: serde_json::Error,
    },
    /// The site's profile.
    #[error("{message}")]
    Site {
        /// What is wrong with it, where, and what to do.
        message: String,
    },
    /// A run with jobs on a cluster, asked to run elsewhere.
    #[error(
        "{jobs} of this run are on a cluster: go on with executor.kind = \"slurm\", or end them with `cardiotwin cancel --all` first"
    )]
    OnCluster {
        /// How many, in words.
        jobs: String,
    },
    /// A crash that a test asked for.
    #[cfg(test)]
    #[error("crash point: {place}")]
    Crashed {
        /// Where.
        place: String,
    },
}
