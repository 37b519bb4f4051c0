//! Medit `.mesh` files in ASCII, the format of mmg and of many other meshing programs.
//!
//! References of tetrahedra are tags. Triangles with reference `r` form the surface `surface-r` if
//! they lie on the boundary; meshing programs also write triangles between two tags, which are
//! ignored. References and node numbers begin at 1; 0 means none.

use std::collections::{BTreeMap, HashMap};
use std::fmt::Write as _;
use std::path::Path;

use super::error::{MeshFileError, read_text, write_bytes};
use super::unit::LengthUnit;
use crate::surface::{Surface, boundary, sorted};
use crate::tet_mesh::TetMesh;

/// Prefix of the surfaces' names.
pub const SURFACE_PREFIX: &str = "surface-";

/// Words of the file with their line numbers. White space separates all items, and line breaks have
/// no meaning.
struct Words<'a> {
    file: &'a Path,
    words: std::iter::Peekable<Box<dyn Iterator<Item = (usize, &'a str)> + 'a>>,
    line: usize,
}

impl<'a> Words<'a> {
    fn of(text: &'a str, file: &'a Path) -> Self {
        let words = text.lines().enumerate().flat_map(|(i, line)| {
            let line = line.split('#').next().unwrap_or_default();
            line.split_ascii_whitespace().map(move |word| (i + 1, word))
        });
        let words: Box<dyn Iterator<Item = (usize, &'a str)> + 'a> = Box::new(words);
        Self {
            file,
            words: words.peekable(),
            line: 1,
        }
    }

    fn next(&mut self) -> Option<&'a str> {
        let (line, word) = self.words.next()?;
        self.line = line;
        Some(word)
    }

    fn number<T: std::str::FromStr>(&mut self, expected: &str) -> Result<T, MeshFileError> {
        let word = self.next().ok_or_else(|| {
            MeshFileError::line(
                self.file,
                self.line,
                "the end of the file",
                expected.to_owned(),
            )
        })?;
        word.parse().map_err(|_| {
            MeshFileError::line(
                self.file,
                self.line,
                format!("`{word}`"),
                expected.to_owned(),
            )
        })
    }

    fn node(&mut self, n_nodes: usize) -> Result<u32, MeshFileError> {
        let number: i64 = self.number("a node number")?;
        if number < 1 || number as u64 > n_nodes as u64 {
            let found = format!("node {number}");
            return Err(MeshFileError::line(
                self.file,
                self.line,
                found,
                format!("a node from 1 to {n_nodes}"),
            ));
        }
        Ok((number - 1) as u32)
    }

    /// Skips the words before the next keyword.
    fn skip(&mut self) {
        while self
            .words
            .next_if(|(_, word)| !word.starts_with(|c: char| c.is_ascii_alphabetic()))
            .is_some()
        {}
    }
}

/// Reads a file with coordinates in `unit`.
///
/// # Errors
/// [`MeshFileError`] with file and line, also for binary files, other dimensions, and nodes that do
/// not exist.
pub fn read(file: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    parse(&read_text(file)?, file, unit)
}

/// [`read`] from the content of a file.
///
/// # Errors
/// Same as for [`read`].
pub fn parse(text: &str, file: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    let mut words = Words::of(text, file);
    let mut mesh = TetMesh::default();
    let mut triangles: Vec<([u32; 3], i32)> = Vec::new();
    while let Some(keyword) = words.next() {
        match keyword {
            "MeshVersionFormatted" => _ = words.number::<u32>("a version")?,
            "Dimension" => {
                let dimension: u32 = words.number("3")?;
                if dimension != 3 {
                    return Err(MeshFileError::line(
                        file,
                        words.line,
                        format!("dimension {dimension}"),
                        "3",
                    ));
                }
            }
            "Vertices" => {
                let n: usize = words.number("the number of vertices")?;
                for _ in 0..n {
                    let mut x = [0.0; 3];
                    for c in &mut x {
                        *c = words.number("three coordinates and a reference")?;
                    }
                    let _: i64 = words.number("a vertex's reference")?;
                    mesh.nodes_mm.push(unit.to_mm(x));
                }
            }
            "Tetrahedra" => {
                let n: usize = words.number("the number of tetrahedra")?;
                let n_nodes = mesh.n_nodes();
                for _ in 0..n {
                    let mut tet = [0; 4];
                    for node in &mut tet {
                        *node = words.node(n_nodes)?;
                    }
                    mesh.tets.push(tet);
                    mesh.tags.push(words.number("a tetrahedron's reference")?);
                }
            }
            "Triangles" => {
                let n: usize = words.number("the number of triangles")?;
                let n_nodes = mesh.n_nodes();
                for _ in 0..n {
                    let mut triangle = [0; 3];
                    for node in &mut triangle {
                        *node = words.node(n_nodes)?;
                    }
                    triangles.push((triangle, words.number("a triangle's reference")?));
                }
            }
            "End" => break,
            word if word.starts_with(|c: char| c.is_ascii_alphabetic()) => words.skip(),
            word => {
                return Err(MeshFileError::line(
                    file,
                    words.line,
                    format!("`{word}`"),
                    "a keyword such as Vertices",
                ));
            }
        }
    }
    if mesh.tets.is_empty() {
        return Err(MeshFileError::content(
            file,
            "no tetrahedra",
            "a volume mesh",
        ));
    }
    mesh.orient_if_all_negative();
    let outward: HashMap<[u32; 3], [u32; 3]> = boundary(&mesh)
        .iter()
        .map(|face| (sorted(face.triangle), face.triangle))
        .collect();
    let mut surfaces: BTreeMap<i32, Vec<[u32; 3]>> = BTreeMap::new();
    for (triangle, reference) in triangles
        .into_iter()
        .filter(|(_, reference)| *reference != 0)
    {
        if let Some(face) = outward.get(&sorted(triangle)) {
            surfaces.entry(reference).or_default().push(*face);
        }
    }
    let named = |(reference, triangles)| Surface {
        name: format!("{SURFACE_PREFIX}{reference}"),
        triangles,
    };
    mesh.surfaces = surfaces.into_iter().map(named).collect();
    Ok(mesh)
}

/// Writes a mesh in mm. Tags become references of tetrahedra; surfaces, numbered from 1 in their
/// order, become references of triangles.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written.
pub fn write(mesh: &TetMesh, file: &Path) -> Result<(), MeshFileError> {
    let mut text = format!(
        "MeshVersionFormatted 2\nDimension 3\nVertices\n{}\n",
        mesh.n_nodes()
    );
    for [x, y, z] in &mesh.nodes_mm {
        let _ = writeln!(text, "{x} {y} {z} 0");
    }
    let _ = writeln!(text, "Tetrahedra\n{}", mesh.n_tets());
    for (tet, tag) in mesh.tets.iter().zip(&mesh.tags) {
        let [a, b, c, d] = tet.map(|node| node + 1);
        let _ = writeln!(text, "{a} {b} {c} {d} {tag}");
    }
    let n_triangles: usize = mesh
        .surfaces
        .iter()
        .map(|surface| surface.triangles.len())
        .sum();
    let _ = writeln!(text, "Triangles\n{n_triangles}");
    for (i, surface) in mesh.surfaces.iter().enumerate() {
        for triangle in &surface.triangles {
            let [a, b, c] = triangle.map(|node| node + 1);
            let _ = writeln!(text, "{a} {b} {c} {}", i + 1);
        }
    }
    text += "End\n";
    write_bytes(file, text.as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ellipsoid::{EllipsoidSpec, generate};
    use cardiotwin_units::Ml;

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("heart.mesh");
        let mesh = generate(&EllipsoidSpec::new(Ml(120.0), Ml(130.0), 600))
            .unwrap()
            .mesh;
        write(&mesh, &file).unwrap();
        let read = read(&file, LengthUnit::Millimetre).unwrap();
        assert_eq!(
            (&read.nodes_mm, &read.tets, &read.tags),
            (&mesh.nodes_mm, &mesh.tets, &mesh.tags)
        );
        assert_eq!(read.surfaces.len(), mesh.surfaces.len());
        for (i, (read, written)) in read.surfaces.iter().zip(&mesh.surfaces).enumerate() {
            assert_eq!(read.name, format!("surface-{}", i + 1));
            assert_eq!(read.triangles.len(), written.triangles.len());
        }
    }

    #[test]
    fn a_broken_file_is_told_with_its_line() {
        let told = |text: &str| {
            parse(text, Path::new("a.mesh"), LengthUnit::Millimetre)
                .unwrap_err()
                .to_string()
        };
        assert_eq!(
            told("MeshVersionFormatted 2\nDimension 2\n"),
            "a.mesh:2: found dimension 2, expected 3"
        );
        let text = "Dimension 3\nVertices\n1\n0 0 0 0\nTetrahedra\n1\n1 1 1 9 1\nEnd\n";
        assert_eq!(
            told(text),
            "a.mesh:7: found node 9, expected a node from 1 to 1"
        );
        assert!(told("Dimension 3\nVertices\n0\nEnd\n").contains("no tetrahedra"));
    }
}
