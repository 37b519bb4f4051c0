//! Everything that is global: sums, halos, gathers. Code above this module runs unchanged on one process, on threads or on
//! MPI ranks; an implementation of [`Communicator`] is all that differs.

mod communicator;
mod layout;

pub use communicator::{Communicator, SingleProcess};
pub use layout::{Layout, Neighbour, Space};
