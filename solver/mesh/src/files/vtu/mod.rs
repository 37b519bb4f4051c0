//! VTU files, VTK's XML format of unstructured grids, which ParaView reads and writes.
//!
//! Points are in mm. Tetrahedra come first, then, if wanted, the triangles of surfaces. Cell
//! arrays: `tag`; `fibre` and `sheet`; for each surface `surface:NAME`, 1 on its triangles and 0
//! elsewhere.

mod data;
mod read;
mod write;

pub use read::{parse, read, unread_directions};
pub use write::{Content, encode, write};

/// Prefix of the cell arrays that mark surfaces.
pub const SURFACE_PREFIX: &str = "surface:";

/// Cell types of VTK.
const TRIANGLE: i64 = 5;
const TETRAHEDRON: i64 = 10;

/// Named values at nodes or at elements.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Name that ParaView lists. It should contain the unit, as in `Ta_kPa`.
    pub name: String,
    /// Number of components: 1 for a scalar, 3 for a vector.
    pub n_components: usize,
    /// Values, `n_components` for each node or element.
    pub values: Vec<f64>,
}

impl Field {
    /// A field with one value for each node or element.
    #[must_use]
    pub fn scalar(name: &str, values: Vec<f64>) -> Self {
        Self {
            name: name.to_owned(),
            n_components: 1,
            values,
        }
    }

    /// A field with one vector for each node or element.
    #[must_use]
    pub fn vector(name: &str, values: &[[f64; 3]]) -> Self {
        Self {
            name: name.to_owned(),
            n_components: 3,
            values: values.iter().flatten().copied().collect(),
        }
    }
}

/// A mesh with the fields of its file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Grid {
    /// Nodes, tetrahedra, tags, directions and surfaces.
    pub mesh: crate::tet_mesh::TetMesh,
    /// Numeric fields at nodes.
    pub point_fields: Vec<Field>,
    /// Numeric fields at elements, except for tag, directions and surfaces.
    pub cell_fields: Vec<Field>,
}
