//! Ends all ranks when one of them fails.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;
use std::{panic, thread};

use crate::{clock, files};
use mpi::topology::SimpleCommunicator;
use mpi::traits::Communicator as _;
use serde::Serialize;

/// Exit code of all ranks if one of them failed.
pub const EXIT_RANK_FAILED: i32 = 6;
/// Name of the file in the task's directory.
pub const FILE: &str = "rank-failure.json";

/// Time for a launcher to read a line.
const TO_BE_READ: Duration = Duration::from_millis(200);

/// Record of a failure.
#[derive(Serialize)]
struct Failure<'a> {
    rank: usize,
    ranks: usize,
    at: &'a str,
    reason: &'a str,
}

/// Ends all ranks on behalf of one.
#[derive(Debug)]
pub struct Failures {
    pub rank: usize,
    pub n_ranks: usize,
    /// Directory of the task, to which the failure is written; `None` if there is none.
    pub directory: Option<PathBuf>,
}

impl Failures {
    /// Reports the reason, once for all ranks, and ends them.
    pub fn end(&self, reason: &str) -> ! {
        let (rank, ranks, at) = (self.rank, self.n_ranks, &clock::now());
        let failure = serde_json::to_string(&Failure {
            rank,
            ranks,
            at,
            reason,
        })
        .expect("plain fields are JSON");
        let written = self
            .directory
            .as_ref()
            .map(|dir| files::create_exclusive(&dir.join(FILE), failure.as_bytes()));
        // If another rank failed at the same time, it has already reported the failure.
        let said = matches!(written, Some(Ok(false)));
        if !said {
            eprintln!("error: rank {rank} of {ranks} failed at {at}: {reason}; all ranks end");
            // When told to abort, MPICH's launcher may drop output of a rank that it has not read
            // yet.
            thread::sleep(TO_BE_READ);
        }
        SimpleCommunicator::world().abort(EXIT_RANK_FAILED)
    }

    /// Makes every panic end all ranks. An unwinding rank would wait for the others in
    /// `MPI_Finalize`, and they for it.
    pub fn on_panic(self: &Arc<Self>) {
        let failures = Arc::clone(self);
        panic::set_hook(Box::new(move |info| {
            let place = info
                .location()
                .map(|place| format!(" at {}:{}", place.file(), place.line()));
            let message = info.payload_as_str().unwrap_or("no message");
            failures.end(&format!("panicked{}: {message}", place.unwrap_or_default()));
        }));
    }

    /// Ends all ranks after an error that other ranks may have met, too. The delay gives rank 0
    /// time to publish it.
    pub fn end_after_rank_0(&self, reason: &str) -> ! {
        thread::sleep(Duration::from_secs(3));
        self.end(reason)
    }
}
