//! Errors that end the loop itself. A failed task is none of them.

use std::path::PathBuf;

use cardiotwin_slurm::access::FolderError;
use cardiotwin_store::StoreError;
use cardiotwin_store::lock::LockError;
use cardiotwin_workflow::IllegalTransition;

use crate::dispatch::DispatchError;

/// The loop cannot continue. What was committed stays, and another `run` continues from there.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// Another coordinator holds the run, or the lock cannot be taken.
    #[error(transparent)]
    Lock(#[from] LockError),
    /// The database cannot be opened, read or written.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file or directory of the run cannot be accessed.
    #[error("cannot {what} {path}")]
    File {
        /// Verb of the failed operation.
        what: &'static str,
        /// Path of the file or directory.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// The worker's executable does not exist.
    #[error("no worker at {path}: build it (`cargo build --release`) or name it with --worker")]
    NoWorker {
        /// Path at which it was expected.
        path: PathBuf,
    },
    /// The launcher of MPI ranks does not exist.
    #[error(
        "executor.launcher: no program {program:?} in PATH, expected the launcher of an MPI, such \
         as mpirun: install one (docs/mpi.md), or remove executor.launcher: 3D simulations then run \
         on threads"
    )]
    NoLauncher {
        /// Program as set in `executor.launcher`.
        program: String,
    },
    /// The worker for MPI ranks does not exist.
    #[error(
        "no worker for executor.launcher at {path}: build it with the launcher's MPI (`cargo build \
         --release --package cardiotwin-worker --features mpi --bin cardiotwin-worker-mpi`, \
         docs/mpi.md), or remove executor.launcher: 3D simulations then run on threads"
    )]
    NoMpiWorker {
        /// Path at which it was expected.
        path: PathBuf,
    },
    /// The worker differs from the one with which the run began.
    #[error(
        "this run began with the worker {began}, but this one is {found}, so its results would be \
         mixed: continue with the first, or add --adopt-version"
    )]
    OtherWorker {
        /// Version and hash of the worker with which the run began.
        began: String,
        /// Version and hash of the present worker.
        found: String,
    },
    /// A state machine refused an event: a defect of the program.
    #[error("the workflow found no next step")]
    Transition(#[from] IllegalTransition),
    /// A request cannot be applied.
    #[error("{message}")]
    Request {
        /// Message with the request, the reason and the remedy.
        message: String,
    },
    /// An attempt cannot be started or inspected.
    #[error(transparent)]
    Dispatch(#[from] DispatchError),
    /// A file of a job's folder cannot be accessed.
    #[error(transparent)]
    JobFolder(#[from] FolderError),
    /// The disk of the run is full.
    #[error(
        "only {free_mb} MB are free for {path}: free some space and run again; no finished result \
         is lost"
    )]
    NoSpace {
        /// Path of the run directory, whose file system is full.
        path: PathBuf,
        /// Free space that is left \[MB\].
        free_mb: u64,
    },
    /// A stored plan cannot be read by this version.
    #[error("the stored plan of {patient} cannot be read; run the cohort again to replace it")]
    Plan {
        /// Pseudonym of the patient.
        patient: String,
        /// Error of the JSON parser.
        source: serde_json::Error,
    },
    /// The site's profile asks for an account, but the settings name none.
    #[error("site {site} needs an account: set executor.slurm.account")]
    NoAccount {
        /// Name of the site.
        site: String,
    },
    /// The site's profile is missing or wrong.
    #[error("{message}")]
    Site {
        /// Message with the file, the error and the remedy.
        message: String,
    },
    /// A run with jobs on a cluster was started with another executor.
    #[error(
        "{jobs} of this run are on a cluster: continue with executor.kind = \"slurm\", or end them \
         with `cardiotwin cancel --all` first"
    )]
    OnCluster {
        /// Number of jobs, in words.
        jobs: String,
    },
    /// A crash point that a test set.
    #[cfg(test)]
    #[error("crash point: {place}")]
    Crashed {
        /// Name of the crash point.
        place: String,
    },
}

impl EngineError {
    /// Error of a database that was being opened. A crash point that a test set is handed through
    /// by the store.
    pub(super) fn of_opening(error: StoreError) -> Self {
        let StoreError::File { what, file, source } = error else {
            return error.into();
        };
        match source.downcast() {
            Ok(own) => own,
            Err(source) => StoreError::File { what, file, source }.into(),
        }
    }
}
