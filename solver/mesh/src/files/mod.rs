//! Mesh files: CARP text, VTU and PVD, gmsh `.msh`, Medit `.mesh`, and plain lists of node values.

pub mod carp;
pub mod error;
pub mod gmsh;
pub mod medit;
pub mod node_values;
pub mod pvd;
mod text;
pub mod unit;
pub mod vtu;

pub use error::MeshFileError;
pub use unit::LengthUnit;

use std::path::Path;

use crate::tet_mesh::TetMesh;

/// Reads a `.vtu`, `.msh` or `.mesh` file, or the CARP files of a stem. If all elements are
/// inverted, they are turned.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn read(path: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    let mut mesh = match path.extension().and_then(|e| e.to_str()) {
        Some("vtu") => vtu::read(path, unit)?.mesh,
        Some("msh") => gmsh::read(path, unit)?,
        Some("mesh") => medit::read(path, unit)?,
        _ => carp::read(path, unit)?,
    };
    mesh.orient_if_all_negative();
    Ok(mesh)
}
