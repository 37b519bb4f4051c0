//! Writer for VTU files, in base64 with zlib compression.

use super::{Field, SURFACE_PREFIX, TETRAHEDRON, TRIANGLE, data};
use crate::files::error::{MeshFileError, write_bytes};
use crate::tet_mesh::TetMesh;
use std::path::Path;

/// Content of a file besides points, elements and tags.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Content<'a> {
    /// Whether to write the mesh's surfaces, as triangles after the tetrahedra.
    pub surfaces: bool,
    /// Numeric fields at nodes.
    pub point_fields: &'a [Field],
    /// Numeric fields at elements.
    pub cell_fields: &'a [Field],
    /// Whether to write fields and points as 32-bit numbers, in half the space. This suits series
    /// for viewing, not for computation.
    pub compact: bool,
}

/// Writes a mesh in mm.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written; [`MeshFileError::Content`] for a field
/// of the wrong length.
pub fn write(file: &Path, mesh: &TetMesh, content: &Content) -> Result<(), MeshFileError> {
    for (fields, n, what) in [
        (content.point_fields, mesh.n_nodes(), "nodes"),
        (content.cell_fields, mesh.n_tets(), "elements"),
    ] {
        if let Some(field) = fields
            .iter()
            .find(|field| field.values.len() != n * field.n_components)
        {
            return Err(MeshFileError::content(
                file,
                format!("{} values of the field {}", field.values.len(), field.name),
                format!("{} for each of {n} {what}", field.n_components),
            ));
        }
    }
    write_bytes(file, encode(mesh, content).as_bytes())
}

/// Text of the file. Fields must have the right length.
#[must_use]
pub fn encode(mesh: &TetMesh, content: &Content) -> String {
    let surfaces = if content.surfaces {
        mesh.surfaces.as_slice()
    } else {
        &[]
    };
    let n_triangles: usize = surfaces.iter().map(|surface| surface.triangles.len()).sum();
    let n_cells = mesh.n_tets() + n_triangles;
    let mut out = Document {
        text: String::new(),
        compact: content.compact,
    };
    out.text += "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
                 byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n";
    out.text += "<UnstructuredGrid>\n";
    out.text += &format!(
        "<Piece NumberOfPoints=\"{}\" NumberOfCells=\"{n_cells}\">\n",
        mesh.n_nodes()
    );
    out.text += "<Points>\n";
    out.floats(
        "Points",
        3,
        &mesh.nodes_mm.iter().flatten().copied().collect::<Vec<_>>(),
    );
    out.text += "</Points>\n<Cells>\n";
    let triangles = || {
        surfaces
            .iter()
            .flat_map(|surface| surface.triangles.iter().flatten())
    };
    let connectivity = mesh
        .tets
        .iter()
        .flatten()
        .chain(triangles())
        .map(|node| i64::from(*node));
    out.integers("connectivity", &connectivity.collect::<Vec<_>>());
    let sizes = std::iter::repeat_n(4, mesh.n_tets()).chain(std::iter::repeat_n(3, n_triangles));
    let offsets: Vec<i64> = sizes
        .scan(0, |end, size| {
            *end += size;
            Some(*end)
        })
        .collect();
    out.integers("offsets", &offsets);
    let kinds = std::iter::repeat_n(TETRAHEDRON, mesh.n_tets())
        .chain(std::iter::repeat_n(TRIANGLE, n_triangles));
    out.bytes("types", &kinds.map(|kind| kind as u8).collect::<Vec<_>>());
    out.text += "</Cells>\n<PointData>\n";
    for field in content.point_fields {
        out.floats(&field.name, field.n_components, &field.values);
    }
    out.text += "</PointData>\n<CellData Scalars=\"tag\">\n";
    let tags = mesh
        .tags
        .iter()
        .map(|tag| i64::from(*tag))
        .chain(std::iter::repeat_n(0, n_triangles));
    out.integers("tag", &tags.collect::<Vec<_>>());
    if !mesh.frames.is_empty() {
        let fibres: Vec<f64> = mesh.frames.iter().flat_map(|frame| frame.fibre).collect();
        let sheets: Vec<f64> = mesh.frames.iter().flat_map(|frame| frame.sheet).collect();
        out.cells("fibre", 3, fibres, n_triangles);
        out.cells("sheet", 3, sheets, n_triangles);
    }
    for field in content.cell_fields {
        out.cells(
            &field.name,
            field.n_components,
            field.values.clone(),
            n_triangles,
        );
    }
    let mut begin = mesh.n_tets();
    for surface in surfaces {
        let end = begin + surface.triangles.len();
        let marks: Vec<u8> = (0..n_cells)
            .map(|cell| u8::from((begin..end).contains(&cell)))
            .collect();
        out.bytes(&format!("{SURFACE_PREFIX}{}", surface.name), &marks);
        begin = end;
    }
    out.text += "</CellData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n";
    out.text
}

struct Document {
    text: String,
    compact: bool,
}

impl Document {
    fn array(&mut self, kind: &str, name: &str, n_components: usize, bytes: &[u8]) {
        let name = name
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('"', "&quot;");
        self.text += &format!(
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{n_components}\" format=\"binary\">\n"
        );
        self.text += &data::compress(bytes);
        self.text += "\n</DataArray>\n";
    }

    fn floats(&mut self, name: &str, n_components: usize, values: &[f64]) {
        if self.compact {
            let bytes: Vec<u8> = values
                .iter()
                .flat_map(|x| (*x as f32).to_le_bytes())
                .collect();
            self.array("Float32", name, n_components, &bytes);
        } else {
            let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
            self.array("Float64", name, n_components, &bytes);
        }
    }

    /// Writes a field of elements; the triangles after them get zeros.
    fn cells(&mut self, name: &str, n_components: usize, mut values: Vec<f64>, n_triangles: usize) {
        values.resize(values.len() + n_components * n_triangles, 0.0);
        self.floats(name, n_components, &values);
    }

    fn integers(&mut self, name: &str, values: &[i64]) {
        let bytes: Vec<u8> = values.iter().flat_map(|x| x.to_le_bytes()).collect();
        self.array("Int64", name, 1, &bytes);
    }

    fn bytes(&mut self, name: &str, values: &[u8]) {
        self.array("UInt8", name, 1, values);
    }
}
