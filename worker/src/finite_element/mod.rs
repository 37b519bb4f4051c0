//! The finite-element ventricle between files and solver: it is made from a patient's data, stored
//! in one file, and read again.

pub mod arrays;
pub mod checkpoint;
pub mod error;
pub mod frames;
pub mod heart;
pub mod motion;
pub mod passive;
pub mod right_ventricle;
pub mod rows;
pub mod series;
pub mod shapes;
pub mod stored;
pub mod tissue;
pub mod wall;
pub mod wall_means;

pub use error::FiniteElementError;
pub use stored::StoredVentricle;
