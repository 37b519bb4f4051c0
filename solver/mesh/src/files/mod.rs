//! Mesh files: CARP text, VTU and PVD, gmsh `.msh`, and plain lists of node values.

pub mod carp;
pub mod error;
pub mod gmsh;
pub mod node_values;
pub mod pvd;
mod text;
pub mod unit;
pub mod vtu;

pub use error::MeshFileError;
pub use unit::LengthUnit;
