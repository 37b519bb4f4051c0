//! MPI: a communicator over its messages, the start of ranks, the end of all ranks because of one, a check of launcher and
//! network. Compiled with the feature `mpi` only.

mod check;
mod communicator;
mod failure;
mod launch;

pub use check::Fault;
pub use launch::{RankProgram, Ranks, check_ranks, run_on_ranks};
