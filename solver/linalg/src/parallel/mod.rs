//! Global operations: sums, halos, gathers. Code above this module is the same for one process,
//! threads and MPI ranks, which differ only in their implementation of [`Communicator`].

mod agreement;
mod communicator;
mod layout;
mod message;
mod nodal_values;
mod part;
#[cfg(feature = "metis")]
mod partition;
mod threads;
mod traffic;
mod vector_layout;

pub use agreement::{Disagreement, agree};
pub use communicator::{Communicator, SingleProcess};
pub use layout::{Layout, Neighbour};
pub use message::{MessageReader, MessageWriter};
pub use nodal_values::NodalValues;
pub use part::Part;
#[cfg(feature = "metis")]
pub use partition::{CutFigures, PartitionError, figures as cut_figures, owners};
pub use threads::{Crew, RankFailure, ThreadRank, ThreadSettings, crew, on_threads};
pub use traffic::{Counted, Traffic};
pub use vector_layout::VectorLayout;
