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
    read_naming_directions(path, unit).map(|(mesh, _)| mesh)
}

/// As [`read`], with the names of the file's arrays of directions that no reader takes. Only VTU files
/// have such arrays.
///
/// # Errors
/// Same as for [`read`].
pub fn read_naming_directions(
    path: &Path,
    unit: LengthUnit,
) -> Result<(TetMesh, Vec<String>), MeshFileError> {
    let (mut mesh, unread) = match path.extension().and_then(|e| e.to_str()) {
        Some("vtu") => {
            let grid = vtu::read(path, unit)?;
            let unread = vtu::unread_directions(&grid);
            (grid.mesh, unread)
        }
        Some("msh") => (gmsh::read(path, unit)?, Vec::new()),
        Some("mesh") => (medit::read(path, unit)?, Vec::new()),
        _ => (carp::read(path, unit)?, Vec::new()),
    };
    mesh.orient_if_all_negative();
    Ok((mesh, unread))
}
