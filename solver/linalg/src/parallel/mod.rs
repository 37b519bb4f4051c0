//! Everything that is global: sums, halos, gathers. Code above this module runs unchanged on one process, on threads or on
//! MPI ranks; an implementation of [`Communicator`] is all that differs.

mod agreement;
mod communicator;
mod layout;
mod message;
mod part;
#[cfg(feature = "metis")]
mod partition;
mod threads;
mod traffic;

pub use agreement::{Disagreement, agree};
pub use communicator::{Communicator, SingleProcess};
pub use layout::{Layout, Neighbour, VectorLayout};
pub use message::{MessageReader, MessageWriter};
pub use part::Part;
#[cfg(feature = "metis")]
pub use partition::{CutFigures, PartitionError, figures as cut_figures, owners};
pub use threads::{Crew, RankFailure, ThreadRank, ThreadSettings, crew, on_threads};
pub use traffic::{Counted, Traffic};
