//! CARP text files: `.pts` (µm), `.elem`, `.lon`, `.surf`, `.vtx`.
//!
//! A mesh is named by its stem: `heart.pts`, `heart.elem`, `heart.NAME.surf` for each surface, and
//! `heart.lon` if there are fibres. The number of rows in `heart.lon` determines whether they
//! belong to elements or to nodes.

use super::error::{MeshFileError, read_text, write_bytes};
use super::text::{Line, Lines};
use super::unit::LengthUnit;
use crate::node_fibres::NodeFibres;
use crate::surface::Surface;
use crate::tet_mesh::{Frame, TetMesh};
use crate::vec3::{Vec3, any_perpendicular, cross, dot, reject, unit};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Cosine of the angle between fibre and sheet above which they are not accepted as perpendicular.
const NOT_PERPENDICULAR: f64 = 0.1;

/// `stem` with `.extension` appended.
fn with(stem: &Path, extension: &str) -> PathBuf {
    let mut name = stem.as_os_str().to_owned();
    name.push(".");
    name.push(extension);
    PathBuf::from(name)
}

/// Reads `stem.pts`, `stem.elem`, `stem.lon` (if it exists) and every `stem.NAME.surf`, in the
/// order of their names.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn read(stem: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    let pts = with(stem, "pts");
    let nodes_mm = parse_pts(&read_text(&pts)?, &pts, unit)?;
    let elem = with(stem, "elem");
    let (tets, tags) = parse_elem(&read_text(&elem)?, &elem, nodes_mm.len())?;
    let lon = with(stem, "lon");
    let mut directions = Directions::default();
    if lon.exists() {
        directions = directions_of(&read_text(&lon)?, &lon, &tets, nodes_mm.len())?;
    }
    let Directions { frames, fibres } = directions;
    let mut surfaces = Vec::new();
    for (name, file) in surface_files(stem)? {
        let triangles = parse_surf(&read_text(&file)?, &file, nodes_mm.len())?;
        surfaces.push(Surface { name, triangles });
    }
    Ok(TetMesh {
        nodes_mm,
        tets,
        tags,
        frames,
        fibres,
        surfaces,
    })
}

/// Tissue directions of a `.lon` file.
#[derive(Debug, Default)]
struct Directions {
    /// Frames of the elements, at their centroids if the file holds directions of nodes.
    frames: Vec<Frame>,
    fibres: NodeFibres,
}

/// Reads directions of elements or of nodes, depending on the number of rows.
fn directions_of(
    text: &str,
    file: &Path,
    tets: &[[u32; 4]],
    n_nodes: usize,
) -> Result<Directions, MeshFileError> {
    let n_rows = text
        .lines()
        .filter(|line| !line.trim().is_empty())
        .count()
        .saturating_sub(1);
    if n_rows != n_nodes {
        return Ok(Directions {
            frames: parse_lon(text, file, tets.len())?,
            fibres: NodeFibres::PerElement,
        });
    }
    if n_rows == tets.len() {
        let found = format!("{n_rows} fibres for a mesh of as many nodes as elements");
        let expected = "a file that tells fibres of elements from fibres of nodes: write the mesh as VTU, with `fibre` as \
                        cell data or as point data";
        return Err(MeshFileError::content(file, found, expected));
    }
    let fibres = NodeFibres::Frames(parse_rows(text, file, n_nodes, "node")?);
    let none = Frame {
        fibre: [0.0; 3],
        sheet: [0.0; 3],
        normal: [0.0; 3],
    };
    let frames = tets
        .iter()
        .map(|tet| fibres.frame(tet, &[0.25; 4]).unwrap_or(none))
        .collect();
    Ok(Directions { frames, fibres })
}

/// Surface files next to the stem, `stem.NAME.surf`, by name.
fn surface_files(stem: &Path) -> Result<Vec<(String, PathBuf)>, MeshFileError> {
    let folder = match stem.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    let prefix = format!(
        "{}.",
        stem.file_name().unwrap_or_default().to_string_lossy()
    );
    let failed = |source| MeshFileError::Read {
        file: folder.to_owned(),
        source,
    };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        let file_name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        if let Some(name) = file_name
            .strip_prefix(&prefix)
            .and_then(|rest| rest.strip_suffix(".surf"))
        {
            found.push((name.to_owned(), path));
        }
    }
    found.sort();
    Ok(found)
}

/// Rows of a file whose first line is the number of rows.
fn rows<'a>(text: &'a str, file: &'a Path, what: &str) -> Result<Vec<Line<'a>>, MeshFileError> {
    let mut lines = Lines::new(text, file);
    let header = lines.expect(&format!("the number of {what}"))?;
    let count = header.count(&format!("the number of {what}"))?;
    counted(&mut lines, count, what)
}

fn counted<'a>(
    lines: &mut Lines<'a>,
    count: usize,
    what: &str,
) -> Result<Vec<Line<'a>>, MeshFileError> {
    let mut rows = Vec::with_capacity(count.min(10_000_000));
    for i in 0..count {
        rows.push(lines.expect(&format!(
            "{} more {what} (the header says {count})",
            count - i
        ))?);
    }
    match lines.next() {
        Some(extra) => Err(extra.error(format!(
            "the end of the file after {count} {what}, as its header says"
        ))),
        None => Ok(rows),
    }
}

/// Parses points: a count, then `x y z` for each point.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn parse_pts(text: &str, file: &Path, unit: LengthUnit) -> Result<Vec<Vec3>, MeshFileError> {
    rows(text, file, "points")?
        .iter()
        .map(|row| Ok(unit.to_mm(row.floats("three numbers, x y z")?)))
        .collect()
}

/// Parses elements: a count, then `Tt a b c d [tag]` for each element. A missing tag is 0.
///
/// # Errors
/// [`MeshFileError`] with file and line, also for elements that are not tetrahedra.
pub fn parse_elem(
    text: &str,
    file: &Path,
    n_nodes: usize,
) -> Result<(Vec<[u32; 4]>, Vec<i32>), MeshFileError> {
    let expected = "`Tt a b c d tag`, a tetrahedron of four node numbers and a whole tag";
    let (mut tets, mut tags) = (Vec::new(), Vec::new());
    for row in rows(text, file, "elements")? {
        let words = row.words();
        if words[0] != "Tt" || !(5..=6).contains(&words.len()) {
            return Err(row.error(expected));
        }
        tets.push(row.nodes(&words[1..5], n_nodes, expected)?);
        tags.push(
            words
                .get(5)
                .map_or(Ok(0), |word| row.number(word, expected))?,
        );
    }
    Ok((tets, tags))
}

/// Parses fibres: 1 or 2, then a fibre, or fibre and sheet, for each element. A fibre of zeros
/// means that the element has none.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn parse_lon(text: &str, file: &Path, n_tets: usize) -> Result<Vec<Frame>, MeshFileError> {
    parse_rows(text, file, n_tets, "element")
}

fn parse_rows(
    text: &str,
    file: &Path,
    count: usize,
    of: &str,
) -> Result<Vec<Frame>, MeshFileError> {
    let mut lines = Lines::new(text, file);
    let expected = format!("1 (a fibre for each {of}) or 2 (fibre and sheet)");
    let header = lines.expect(&expected)?;
    let per_row = header.count(&expected)?;
    if !(1..=2).contains(&per_row) {
        return Err(header.error(expected));
    }
    let rows = counted(&mut lines, count, &format!("fibres, one for each {of}"))?;
    rows.iter()
        .map(|row| {
            let values: [f64; 6] = if per_row == 2 {
                row.floats("six numbers, fibre and sheet")?
            } else {
                let [x, y, z] = row.floats("three numbers, a fibre")?;
                [x, y, z, 0.0, 0.0, 0.0]
            };
            let fibre = [values[0], values[1], values[2]];
            let sheet = [values[3], values[4], values[5]];
            frame(fibre, (per_row == 2).then_some(sheet)).ok_or_else(|| {
                row.error("a sheet that is perpendicular to the fibre, or zeros for both where there is no fibre")
            })
        })
        .collect()
}

/// Orthonormal frame of a fibre and, if given, a sheet. The frame is zero if the fibre is; `None`
/// if fibre and sheet are far from perpendicular.
pub(super) fn frame(fibre: Vec3, sheet: Option<Vec3>) -> Option<Frame> {
    let Some(fibre) = unit(fibre) else {
        return Some(Frame {
            fibre: [0.0; 3],
            sheet: [0.0; 3],
            normal: [0.0; 3],
        });
    };
    let sheet = match sheet {
        Some(sheet) => {
            let sheet = unit(sheet)?;
            if dot(fibre, sheet).abs() > NOT_PERPENDICULAR {
                return None;
            }
            unit(reject(sheet, fibre))?
        }
        None => any_perpendicular(fibre),
    };
    Some(Frame {
        fibre,
        sheet,
        normal: cross(fibre, sheet),
    })
}

/// Parses a surface: a count, then `Tr a b c [tag]` for each triangle.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn parse_surf(text: &str, file: &Path, n_nodes: usize) -> Result<Vec<[u32; 3]>, MeshFileError> {
    let expected = "`Tr a b c`, a triangle of three node numbers";
    rows(text, file, "triangles")?
        .iter()
        .map(|row| {
            let words = row.words();
            if words[0] != "Tr" || !(4..=5).contains(&words.len()) {
                return Err(row.error(expected));
            }
            row.nodes(&words[1..4], n_nodes, expected)
        })
        .collect()
}

/// Parses a list of nodes: a count, the word `intra` or `extra`, then one node number per line.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn parse_vtx(text: &str, file: &Path, n_nodes: usize) -> Result<Vec<u32>, MeshFileError> {
    let mut lines = Lines::new(text, file);
    let count = lines
        .expect("the number of nodes")?
        .count("the number of nodes")?;
    let domain = lines.expect("`intra` or `extra`")?;
    if !matches!(domain.text, "intra" | "extra") {
        return Err(domain.error("`intra` or `extra`"));
    }
    counted(&mut lines, count, "nodes")?
        .iter()
        .map(|row| Ok(row.nodes::<1>(&row.words(), n_nodes, "a node number")?[0]))
        .collect()
}

/// Reads a `.vtx` file.
///
/// # Errors
/// [`MeshFileError`] with file and line.
pub fn read_vtx(file: &Path, n_nodes: usize) -> Result<Vec<u32>, MeshFileError> {
    parse_vtx(&read_text(file)?, file, n_nodes)
}

/// Writes a mesh as `stem.pts` (µm), `stem.elem`, `stem.lon` (fibre and sheet, if the mesh has
/// frames) and one `stem.NAME.surf` for each surface.
///
/// # Errors
/// [`MeshFileError::Write`] if a file cannot be written.
pub fn write(mesh: &TetMesh, stem: &Path) -> Result<(), MeshFileError> {
    write_pts(&mesh.nodes_mm, &with(stem, "pts"))?;
    let mut text = format!("{}\n", mesh.n_tets());
    for ([a, b, c, d], tag) in mesh.tets.iter().zip(&mesh.tags) {
        let _ = writeln!(text, "Tt {a} {b} {c} {d} {tag}");
    }
    write_bytes(&with(stem, "elem"), text.as_bytes())?;
    if !mesh.frames.is_empty() {
        let mut text = String::from("2\n");
        for Frame {
            fibre: f, sheet: s, ..
        } in &mesh.frames
        {
            let _ = writeln!(
                text,
                "{} {} {} {} {} {}",
                f[0], f[1], f[2], s[0], s[1], s[2]
            );
        }
        write_bytes(&with(stem, "lon"), text.as_bytes())?;
    }
    for surface in &mesh.surfaces {
        let mut text = format!("{}\n", surface.triangles.len());
        for [a, b, c] in &surface.triangles {
            let _ = writeln!(text, "Tr {a} {b} {c}");
        }
        write_bytes(
            &with(stem, &format!("{}.surf", surface.name)),
            text.as_bytes(),
        )?;
    }
    Ok(())
}

/// Writes points in µm.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written.
pub fn write_pts(nodes_mm: &[Vec3], file: &Path) -> Result<(), MeshFileError> {
    let mut text = format!("{}\n", nodes_mm.len());
    for p in nodes_mm {
        let [x, y, z] = p.map(|x| x * LengthUnit::Micrometre.per_mm());
        let _ = writeln!(text, "{x} {y} {z}");
    }
    write_bytes(file, text.as_bytes())
}

/// Writes a list of nodes.
///
/// # Errors
/// [`MeshFileError::Write`] if the file cannot be written.
pub fn write_vtx(nodes: &[u32], file: &Path) -> Result<(), MeshFileError> {
    let mut text = format!("{}\nintra\n", nodes.len());
    for node in nodes {
        let _ = writeln!(text, "{node}");
    }
    write_bytes(file, text.as_bytes())
}
