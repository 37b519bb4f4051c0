//! Reader for VTU files with one piece. Arrays may be text, base64 or appended (base64 or raw),
//! with or without zlib compression.

use super::data::{self, Encoding, Undecoded, numbers};
use super::{Field, Grid, SURFACE_PREFIX, TETRAHEDRON, TRIANGLE};
use crate::files::LengthUnit;
use crate::files::carp::frame;
use crate::files::error::{MeshFileError, read_bytes};
use crate::node_fibres::NodeFibres;
use crate::surface::Surface;
use crate::tet_mesh::{Frame, TetMesh};
use crate::vec3::{Vec3, cross, norm};
use roxmltree::{Document, Node};
use std::cell::Cell;
use std::path::Path;

/// Names of an array, in lower case without anything but letters and digits.
struct Names(&'static [&'static str]);

/// Names under which programs write fibres: ours, SimVascular's (`FIB_DIR`), those of LDRB, cardiac
/// libraries on FEniCS (`f0`) and others.
const FIBRES: Names = Names(&[
    "fibre",
    "fiber",
    "fibres",
    "fibers",
    "fibdir",
    "f0",
    "fibredirection",
    "fiberdirection",
    "fibredirections",
    "fiberdirections",
    "fibredir",
    "fiberdir",
    "fiberlongitudinal",
]);
/// Names of sheets.
const SHEETS: Names = Names(&[
    "sheet",
    "sheets",
    "sheetdir",
    "s0",
    "sheetdirection",
    "sheetdirections",
    "shedir",
]);

impl Names {
    fn is(&self, name: &str) -> bool {
        let plain: String = name
            .chars()
            .filter(|c| c.is_alphanumeric())
            .flat_map(char::to_lowercase)
            .collect();
        self.0.contains(&plain.as_str())
    }
}

/// Reads a file with coordinates in `unit`. The array `tag` gives the tags; a file without any array
/// of whole numbers has tag 0. `fibre` and `sheet`, or arrays of other programs' names for them, give
/// the directions, at cells or at points. All other numeric arrays become fields.
///
/// # Errors
/// [`MeshFileError`] with file and line, also for several pieces, cells other than tetrahedra and
/// triangles, and arrays that cannot be decoded.
pub fn read(file: &Path, unit: LengthUnit) -> Result<Grid, MeshFileError> {
    parse(&read_bytes(file)?, file, unit)
}

/// [`read`] from the content of a file.
///
/// # Errors
/// Same as for [`read`].
pub fn parse(bytes: &[u8], file: &Path, unit: LengthUnit) -> Result<Grid, MeshFileError> {
    let (xml, appended) = split_appended(bytes);
    let xml = std::str::from_utf8(&xml)
        .map_err(|_| MeshFileError::content(file, "bytes that are not text", "a VTU file (XML)"))?;
    let document = Document::parse(xml).map_err(|cause| {
        MeshFileError::content(
            file,
            format!("text that is not XML ({cause})"),
            "a VTU file (XML)",
        )
    })?;
    let reader = Reader::new(file, &document, appended, bytes.len())?;
    reader.grid(unit)
}

/// Names of the arrays that [`read`] took neither as fibres nor as sheets, though they contain directions or
/// are named after fibres.
#[must_use]
pub fn unread_directions(grid: &Grid) -> Vec<String> {
    let fields = grid.cell_fields.iter().chain(&grid.point_fields);
    let unread = fields.filter(|field| {
        !SHEETS.is(&field.name) && (are_directions(field) || is_named_after_fibres(&field.name))
    });
    unread.map(|field| field.name.clone()).collect()
}

/// Whether a name speaks of fibres: three components, angles or several fibres of an element may be in one
/// array or in several.
fn is_named_after_fibres(name: &str) -> bool {
    let name = name.to_lowercase();
    ["fiber", "fibre", "orientation"]
        .iter()
        .any(|word| name.contains(word))
}

/// Share of an array's vectors that have the same length where the array contains directions.
const SAME_LENGTH: f64 = 0.9;

/// Whether an array contains directions: vectors of one length. Displacements and velocities vary.
fn are_directions(field: &Field) -> bool {
    let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    if field.n_components != 3 {
        return false;
    }
    let mut lengths: Vec<f64> = field.values.chunks_exact(3).map(length).collect();
    lengths.sort_by(f64::total_cmp);
    let Some(&middle) = lengths.get(lengths.len() / 2) else {
        return false;
    };
    let same = lengths.iter().filter(|l| (*l / middle - 1.0).abs() < 0.01);
    middle > 0.0 && same.count() as f64 >= SAME_LENGTH * lengths.len() as f64
}

/// Separates the appended data from the file, because raw bytes are not valid XML.
fn split_appended(bytes: &[u8]) -> (Vec<u8>, &[u8]) {
    let find = |from: usize, what: &[u8]| {
        bytes
            .get(from..)?
            .windows(what.len())
            .position(|window| window == what)
            .map(|at| at + from)
    };
    let cut = || {
        let open = find(0, b"<AppendedData")?;
        let begin = find(open, b"_")?;
        let end = bytes
            .windows(15)
            .rposition(|window| window == b"</AppendedData>")?;
        (end > begin).then_some((begin, end))
    };
    match cut() {
        Some((begin, end)) => (
            [&bytes[..begin], &bytes[end..]].concat(),
            &bytes[begin + 1..end],
        ),
        None => (bytes.to_vec(), &[]),
    }
}

/// Memory for numbers that a file of any size may need \[MiB\].
const FREE_BYTES_MIB: u64 = 256;
/// Bytes of numbers for each byte of the file beyond that. Numbers as text and uncompressed ones have
/// at most eight, compressed meshes up to twenty; a file made to fill the memory has a thousand.
const MAX_RATIO: u64 = 50;

struct Reader<'a> {
    file: &'a Path,
    /// Memory that the arrays of this file may need \[bytes\].
    allowed: u64,
    /// The part of it that is left.
    allowance: Cell<u64>,
    document: &'a Document<'a>,
    encoding: Encoding,
    appended: &'a [u8],
    appended_raw: bool,
}

impl<'a> Reader<'a> {
    fn new(
        file: &'a Path,
        document: &'a Document<'a>,
        appended: &'a [u8],
        n_bytes: usize,
    ) -> Result<Self, MeshFileError> {
        let root = document.root_element();
        let allowed = (FREE_BYTES_MIB << 20) + (n_bytes as u64).saturating_mul(MAX_RATIO);
        let mut reader = Self {
            file,
            allowed,
            allowance: Cell::new(allowed),
            document,
            encoding: Encoding {
                big_endian: false,
                header_size: 4,
                compressed: false,
            },
            appended,
            appended_raw: false,
        };
        if root.tag_name().name() != "VTKFile" || root.attribute("type") != Some("UnstructuredGrid")
        {
            return Err(reader.error(
                root,
                "another document",
                "<VTKFile type=\"UnstructuredGrid\">",
            ));
        }
        reader.encoding.big_endian = root.attribute("byte_order") == Some("BigEndian");
        reader.encoding.header_size = if root.attribute("header_type") == Some("UInt64") {
            8
        } else {
            4
        };
        reader.encoding.compressed = match root.attribute("compressor") {
            None | Some("") => false,
            Some("vtkZLibDataCompressor") => true,
            Some(other) => {
                let found = format!("the compressor {other}");
                return Err(reader.error(
                    root,
                    found,
                    "zlib or none (save again with another compressor)",
                ));
            }
        };
        reader.appended_raw = reader
            .document
            .descendants()
            .find(|node| node.has_tag_name("AppendedData"))
            .is_some_and(|node| node.attribute("encoding") == Some("raw"));
        Ok(reader)
    }

    fn error(
        &self,
        at: Node,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> MeshFileError {
        let line = self.document.text_pos_at(at.range().start).row as usize;
        MeshFileError::line(self.file, line, found, expected)
    }

    fn child(&self, of: Node<'a, 'a>, name: &str) -> Result<Node<'a, 'a>, MeshFileError> {
        of.children()
            .find(|node| node.has_tag_name(name))
            .ok_or_else(|| self.error(of, format!("no <{name}>"), format!("a <{name}> within")))
    }

    fn count(&self, piece: Node, name: &str) -> Result<usize, MeshFileError> {
        let text = piece.attribute(name).unwrap_or_default();
        text.trim()
            .parse()
            .map_err(|_| self.error(piece, format!("{name}=\"{text}\""), "a whole number"))
    }

    /// Takes the memory of an array out of what a file of this size may need, before it is decoded.
    fn spend(&self, node: Node, name: &str, n_numbers: usize) -> Result<(), MeshFileError> {
        let bytes = (n_numbers as u64).saturating_mul(size_of::<f64>() as u64);
        let left = self.allowance.get();
        let Some(rest) = left.checked_sub(bytes) else {
            return Err(self.error(
                node,
                format!("the array {name} of {n_numbers} numbers in so small a file"),
                format!(
                    "arrays of at most {} MiB together: {FREE_BYTES_MIB} MiB, and {MAX_RATIO} \
                     times the file's size (save the mesh again without compression)",
                    self.allowed >> 20
                ),
            ));
        };
        self.allowance.set(rest);
        Ok(())
    }

    /// Values of an array, which must have `n_expected` of them.
    fn array(&self, node: Node, n_expected: usize) -> Result<Vec<f64>, MeshFileError> {
        let name = node.attribute("Name").unwrap_or("?");
        let kind = node.attribute("type").unwrap_or_default();
        let bad = |why: &str| {
            self.error(
                node,
                format!("the array {name} {why}"),
                format!("{n_expected} numbers of type {kind}"),
            )
        };
        self.spend(node, name, n_expected)?;
        // A packed array of any type is decoded to as many bytes as its numbers need, and no more.
        let max = data::size_of(kind).map_or(0, |size| size.saturating_mul(n_expected));
        let decoded = |bytes: Result<Vec<u8>, Undecoded>| {
            let bytes = bytes.map_err(|why| match why {
                Undecoded::Damaged => bad("that cannot be decoded"),
                Undecoded::TooLong if data::size_of(kind).is_none() => bad("of another type"),
                Undecoded::TooLong => bad("of more numbers"),
            })?;
            numbers(kind, &bytes, self.encoding.big_endian).ok_or_else(|| bad("of another type"))
        };
        // VTK inserts keys of its own between the numbers or after them.
        let text: String = node
            .children()
            .filter(|part| part.is_text())
            .filter_map(|part| part.text())
            .collect();
        let values = match node.attribute("format") {
            Some("ascii") | None => text
                .split_ascii_whitespace()
                .map(|word| word.parse().map_err(|_| bad(&format!("with `{word}`"))))
                .collect::<Result<Vec<f64>, _>>()?,
            Some("binary") => decoded(self.encoding.base64(&text, max))?,
            Some("appended") => {
                let offset = self.count(node, "offset")?;
                let rest = self
                    .appended
                    .get(offset..)
                    .ok_or_else(|| bad("beyond the appended data"))?;
                if self.appended_raw {
                    decoded(self.encoding.raw(rest, max))?
                } else {
                    decoded(
                        std::str::from_utf8(rest)
                            .map_err(|_| Undecoded::Damaged)
                            .and_then(|rest| self.encoding.base64(rest, max)),
                    )?
                }
            }
            Some(other) => return Err(bad(&format!("of the format {other}"))),
        };
        if values.len() != n_expected {
            return Err(bad(&format!("of {} numbers", values.len())));
        }
        Ok(values)
    }

    /// Values of an array that is used: finite ones.
    fn finite(&self, node: Node, n_expected: usize) -> Result<Vec<f64>, MeshFileError> {
        let values = self.array(node, n_expected)?;
        let name = node.attribute("Name").unwrap_or("?");
        self.used(node, name, &values)?;
        Ok(values)
    }

    /// An error if values that are used are not finite. What nothing reads may be.
    fn used(&self, at: Node, name: &str, values: &[f64]) -> Result<(), MeshFileError> {
        match values.iter().position(|value| !value.is_finite()) {
            None => Ok(()),
            Some(place) => Err(self.error(
                at,
                format!("the array {name} with {} at place {place}", values[place]),
                "finite numbers",
            )),
        }
    }

    fn named(&self, section: Node<'a, 'a>, name: &str) -> Result<Node<'a, 'a>, MeshFileError> {
        section
            .children()
            .find(|node| node.has_tag_name("DataArray") && node.attribute("Name") == Some(name))
            .ok_or_else(|| {
                self.error(
                    section,
                    format!("no array {name}"),
                    format!("a DataArray called {name}"),
                )
            })
    }

    /// Whole numbers as tags.
    fn tags(&self, at: Node, values: &[f64]) -> Result<Vec<i32>, MeshFileError> {
        let is_tag = |value: &f64| value.fract() == 0.0 && value.abs() <= f64::from(i32::MAX);
        match values.iter().position(|value| !is_tag(value)) {
            None => Ok(values.iter().map(|value| *value as i32).collect()),
            Some(place) => Err(self.error(
                at,
                format!("the array tag with {:?} at place {place}", values[place]),
                "whole numbers",
            )),
        }
    }

    /// An error for a file without tags that has other arrays which may be meant.
    fn no_tag(&self, at: Node, others: &[Field]) -> Result<(), MeshFileError> {
        let whole = |field: &&Field| {
            field.n_components == 1 && field.values.iter().all(|value| value.fract() == 0.0)
        };
        let names: Vec<&str> = others
            .iter()
            .filter(whole)
            .map(|field| field.name.as_str())
            .collect();
        if names.is_empty() {
            return Ok(());
        }
        Err(self.error(
            at,
            format!("no array tag, and the arrays {} at cells", names.join(", ")),
            "an array called tag with the tissue of each element (rename the right one)",
        ))
    }

    /// All numeric arrays of a section with `n` nodes or cells.
    fn fields(
        &self,
        piece: Node<'a, 'a>,
        section: &str,
        n: usize,
    ) -> Result<Vec<Field>, MeshFileError> {
        let Some(section) = piece.children().find(|node| node.has_tag_name(section)) else {
            return Ok(Vec::new());
        };
        section
            .children()
            .filter(|node| {
                node.has_tag_name("DataArray") && node.attribute("type") != Some("String")
            })
            .map(|node| {
                let n_components = node
                    .attribute("NumberOfComponents")
                    .and_then(|n| n.parse().ok())
                    .unwrap_or(1);
                let name = node.attribute("Name").unwrap_or_default().to_owned();
                Ok(Field {
                    name,
                    n_components,
                    values: self.array(node, n.saturating_mul(n_components))?,
                })
            })
            .collect()
    }

    fn grid(&self, unit: LengthUnit) -> Result<Grid, MeshFileError> {
        let grid = self.child(self.document.root_element(), "UnstructuredGrid")?;
        let pieces: Vec<_> = grid
            .children()
            .filter(|node| node.has_tag_name("Piece"))
            .collect();
        let [piece] = pieces[..] else {
            return Err(self.error(
                grid,
                format!("{} pieces", pieces.len()),
                "one piece (merge blocks before saving)",
            ));
        };
        let (n_points, n_cells) = (
            self.count(piece, "NumberOfPoints")?,
            self.count(piece, "NumberOfCells")?,
        );
        let points = self.child(piece, "Points")?;
        let points = self.finite(self.child(points, "DataArray")?, n_points.saturating_mul(3))?;
        let nodes_mm = points
            .chunks_exact(3)
            .map(|p| unit.to_mm([p[0], p[1], p[2]]))
            .collect();
        let cells = self.cells(self.child(piece, "Cells")?, n_points, n_cells)?;
        let mut grid = Grid {
            mesh: TetMesh {
                nodes_mm,
                ..TetMesh::default()
            },
            point_fields: self.fields(piece, "PointData", n_points)?,
            cell_fields: Vec::new(),
        };
        let tets: Vec<usize> = (0..n_cells)
            .filter(|cell| cells[*cell].len() == 4)
            .collect();
        grid.mesh.tets = tets
            .iter()
            .map(|cell| [0, 1, 2, 3].map(|i| cells[*cell][i]))
            .collect();
        grid.mesh.tags = vec![0; tets.len()];
        let mut fibres: Option<(String, Vec<Vec3>)> = None;
        let (mut sheets, mut tagged) = (None, false);
        for field in self.fields(piece, "CellData", n_cells)? {
            let width = field.n_components;
            if let Some(name) = field.name.strip_prefix(SURFACE_PREFIX) {
                self.used(piece, &field.name, &field.values)?;
                let on = (0..n_cells)
                    .filter(|cell| cells[*cell].len() == 3 && field.values[*cell] != 0.0);
                let triangles = on.map(|cell| [0, 1, 2].map(|i| cells[cell][i])).collect();
                grid.mesh.surfaces.push(Surface {
                    name: name.to_owned(),
                    triangles,
                });
                continue;
            }
            let values: Vec<f64> = tets
                .iter()
                .flat_map(|cell| &field.values[cell * width..(cell + 1) * width])
                .copied()
                .collect();
            match (field.name.as_str(), width) {
                ("tag", 1) => {
                    grid.mesh.tags = self.tags(piece, &values)?;
                    tagged = true;
                }
                (name, 3) if FIBRES.is(name) => {
                    self.used(piece, name, &values)?;
                    let these = vectors(&values);
                    match &fibres {
                        Some((first, others)) if !are_parallel(others, &these) => {
                            return Err(self.error(
                                piece,
                                format!("the arrays {first} and {name} with other directions"),
                                "one array of fibres (rename or remove the other)",
                            ));
                        }
                        Some(_) => {}
                        None => fibres = Some((field.name, these)),
                    }
                }
                (name, 3) if SHEETS.is(name) && sheets.is_none() => {
                    self.used(piece, name, &values)?;
                    sheets = Some(vectors(&values));
                }
                _ => grid.cell_fields.push(Field { values, ..field }),
            }
        }
        if !tagged {
            self.no_tag(piece, &grid.cell_fields)?;
        }
        let found = |place: String, fibre, sheet| {
            frame(fibre, sheet).ok_or_else(|| {
                let found = format!("a sheet of {place} that is not perpendicular to its fibre");
                self.error(piece, found, "perpendicular directions, or zeros for both")
            })
        };
        let mut at_nodes = |names: &Names| -> Result<Option<Vec<Vec3>>, MeshFileError> {
            let place = |field: &Field| names.is(&field.name) && field.n_components == 3;
            let Some(at) = grid.point_fields.iter().position(place) else {
                return Ok(None);
            };
            let field = grid.point_fields.remove(at);
            self.used(piece, &field.name, &field.values)?;
            Ok(Some(vectors(&field.values)))
        };
        if let (None, Some(fibres)) = (&fibres, at_nodes(&FIBRES)?) {
            let sheets = at_nodes(&SHEETS)?;
            let frames = (fibres.into_iter().enumerate())
                .map(|(node, fibre)| {
                    found(
                        format!("node {node}"),
                        fibre,
                        sheets.as_ref().map(|sheets| sheets[node]),
                    )
                })
                .collect::<Result<_, _>>()?;
            grid.mesh.fibres = NodeFibres::Frames(frames);
            let none = Frame {
                fibre: [0.0; 3],
                sheet: [0.0; 3],
                normal: [0.0; 3],
            };
            let middle = |tet: &[u32; 4]| grid.mesh.fibres.frame(tet, &[0.25; 4]).unwrap_or(none);
            grid.mesh.frames = grid.mesh.tets.iter().map(middle).collect();
        }
        if let Some((_, fibres)) = fibres {
            for (e, fibre) in fibres.into_iter().enumerate() {
                let sheet = sheets.as_ref().map(|sheets| sheets[e]);
                grid.mesh
                    .frames
                    .push(found(format!("element {e}"), fibre, sheet)?);
            }
        }
        Ok(grid)
    }

    /// Corners of each cell, four or three nodes.
    fn cells(
        &self,
        section: Node<'a, 'a>,
        n_points: usize,
        n_cells: usize,
    ) -> Result<Vec<Vec<u32>>, MeshFileError> {
        let kinds = self.finite(self.named(section, "types")?, n_cells)?;
        let offsets_node = self.named(section, "offsets")?;
        let offsets = self.finite(offsets_node, n_cells)?;
        let n_corners = offsets.last().map_or(0, |last| *last as usize);
        let connectivity_node = self.named(section, "connectivity")?;
        let connectivity = self.finite(connectivity_node, n_corners)?;
        let mut begin = 0;
        let mut cells = Vec::with_capacity(n_cells);
        for (cell, (kind, end)) in kinds.iter().zip(&offsets).enumerate() {
            let size = match *kind as i64 {
                TETRAHEDRON => 4,
                TRIANGLE => 3,
                other => {
                    let found = format!("cell {cell} of VTK's type {other}");
                    return Err(self.error(section, found, "tetrahedra (10) and triangles (5)"));
                }
            };
            let end = *end as usize;
            let corners = (end >= begin && end - begin == size)
                .then(|| connectivity.get(begin..end))
                .flatten();
            let corners = corners.ok_or_else(|| {
                self.error(
                    offsets_node,
                    format!("the offset {end} of cell {cell}"),
                    format!("{}", begin + size),
                )
            })?;
            if let Some(node) = corners
                .iter()
                .find(|node| **node < 0.0 || **node >= n_points as f64)
            {
                let found = format!("node {node} in cell {cell}");
                return Err(self.error(
                    connectivity_node,
                    found,
                    format!("one of {n_points} nodes, numbered from 0"),
                ));
            }
            cells.push(corners.iter().map(|node| *node as u32).collect());
            begin = end;
        }
        Ok(cells)
    }
}

/// Largest sine of the angle between two fibres of the same element that are the same.
const PARALLEL: f64 = 1e-3;

/// Whether two arrays have the same directions, whatever the signs and lengths.
fn are_parallel(a: &[Vec3], b: &[Vec3]) -> bool {
    let apart = |(a, b): (&Vec3, &Vec3)| norm(cross(*a, *b)) <= PARALLEL * norm(*a) * norm(*b);
    a.iter().zip(b).all(apart)
}

fn vectors(values: &[f64]) -> Vec<Vec3> {
    values.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect()
}
