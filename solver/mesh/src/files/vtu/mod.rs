//! VTU, VTK's XML format of unstructured grids, as ParaView reads and writes it.
//!
//! Points are in mm. Tetrahedra come first, then, if wanted, the triangles of surfaces. Cell arrays: `tag`; `fibre` and
//! `sheet`; for each surface `surface:NAME`, 1 on its triangles and 0 elsewhere.

mod data;
mod read;
mod write;

pub use read::{parse, read};
pub use write::{Content, encode, write};

/// Prefix of the cell arrays that mark surfaces.
pub const SURFACE_PREFIX: &str = "surface:";

/// VTK's cell types.
const TRIANGLE: i64 = 5;
const TETRAHEDRON: i64 = 10;

/// Named values, at nodes or at elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// As ParaView lists it; put the unit into it, `Ta_kPa`.
    pub name: String,
    /// 1 for a number, 3 for a vector.
    pub n_components: usize,
    /// `n_components` for each node or element.
    pub values: Vec<f64>,
}

impl Field {
    /// A number for each.
    #[must_use]
    pub fn scalar(name: &str, values: Vec<f64>) -> Self {
        Self {
            name: name.to_owned(),
            n_components: 1,
            values,
        }
    }

    /// A vector for each.
    #[must_use]
    pub fn vector(name: &str, values: &[[f64; 3]]) -> Self {
        Self {
            name: name.to_owned(),
            n_components: 3,
            values: values.iter().flatten().copied().collect(),
        }
    }
}

/// A mesh with the fields that came with it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// The mesh.
    pub mesh: crate::tet_mesh::TetMesh,
    /// Fields of numbers at nodes.
    pub point_fields: Vec<Field>,
    /// Fields of numbers at elements, without tag, directions and surfaces.
    pub cell_fields: Vec<Field>,
}
