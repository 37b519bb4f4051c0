//! gmsh `.msh` files in ASCII, versions 2.2 and 4.1. Physical groups of tetrahedra become tags, and
//! named physical surfaces become surfaces.
//!
//! A negative number of a group means that group, turned. A surface may belong to several groups and
//! then has all their names; tetrahedra in two groups are refused, because a tag is one number. A
//! partitioned file has the groups of its parts.
//!
//! Nodes without a tetrahedron are left out, because gmsh also writes points of its geometry.
//! Triangles are turned so that their normals point out of the tissue; triangles inside the tissue
//! are rejected.

use super::error::{MeshFileError, read_text};
use super::text::{Line, Lines};
use super::unit::LengthUnit;
use crate::surface::{Surface, boundary, sorted};
use crate::tet_mesh::TetMesh;
use crate::vec3::Vec3;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

const POINT: u32 = 15;
const LINE: u32 = 1;
const TRIANGLE: u32 = 2;
const TETRAHEDRON: u32 = 4;

/// What is expected of tetrahedra in two physical groups.
const ONE_GROUP: &str = "each volume in one physical group: its number is the tag of the tissue (cut the volume, or remove it from one of the groups)";

/// Content of a file, with gmsh's own numbers.
#[derive(Default)]
struct Raw {
    nodes: Vec<(u64, Vec3)>,
    /// Physical group, corners, line.
    tets: Vec<(i32, [u64; 4], usize)>,
    triangles: Vec<(i32, [u64; 3], usize)>,
    /// Names of the physical groups, by dimension and number.
    names: BTreeMap<(u32, i32), String>,
    /// Physical groups of each geometric entity (version 4), by dimension and number.
    groups: BTreeMap<(u32, i64), Vec<i32>>,
}

/// Reads a file with coordinates in `unit`.
///
/// # Errors
/// [`MeshFileError`] with file and line, also for other versions, binary files, and elements of
/// higher order or other shape.
pub fn read(file: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    parse(&read_text(file)?, file, unit)
}

/// [`read`] from the content of a file.
///
/// # Errors
/// Same as for [`read`].
pub fn parse(text: &str, file: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
    let mut lines = Lines::new(text, file);
    let first = lines.expect("`$MeshFormat`")?;
    if first.text != "$MeshFormat" {
        return Err(first.error("`$MeshFormat`, the beginning of a gmsh file"));
    }
    let format = lines.expect("version, file type and data size")?;
    let words = format.words();
    let version = *words.first().unwrap_or(&"");
    if words.get(1) != Some(&"0") {
        return Err(format.error("an ASCII file, type 0 (save with `Mesh.Binary = 0`)"));
    }
    let fourth = match version {
        "4.1" => true,
        "2" | "2.1" | "2.2" => false,
        _ => {
            return Err(
                format.error("version 2.2 or 4.1 (save with `gmsh -format msh41` or `msh22`)")
            );
        }
    };
    close(&mut lines, "$EndMeshFormat")?;
    let mut raw = Raw::default();
    while let Some(section) = lines.next() {
        match section.text {
            "$PhysicalNames" => physical_names(&mut lines, &mut raw)?,
            "$Entities" if fourth => entities(&mut lines, &mut raw)?,
            "$PartitionedEntities" if fourth => partitioned_entities(&mut lines, &mut raw)?,
            "$Nodes" if fourth => nodes_v4(&mut lines, &mut raw)?,
            "$Nodes" => nodes_v2(&mut lines, &mut raw)?,
            "$Elements" if fourth => elements_v4(&mut lines, &mut raw)?,
            "$Elements" => elements_v2(&mut lines, &mut raw)?,
            other if other.starts_with('$') => skip(&mut lines, other)?,
            _ => return Err(section.error("the beginning of a section, `$…`")),
        }
    }
    raw.into_mesh(file, unit)
}

fn close(lines: &mut Lines, end: &str) -> Result<(), MeshFileError> {
    let line = lines.expect(&format!("`{end}`"))?;
    if line.text == end {
        Ok(())
    } else {
        Err(line.error(format!("`{end}`")))
    }
}

fn skip(lines: &mut Lines, section: &str) -> Result<(), MeshFileError> {
    let end = format!("$End{}", &section[1..]);
    while lines.expect(&format!("`{end}`"))?.text != end {}
    Ok(())
}

fn whole<const N: usize>(line: &Line, expected: &str) -> Result<[i64; N], MeshFileError> {
    let words = line.words();
    let mut values = [0; N];
    if words.len() < N {
        return Err(line.error(expected));
    }
    for (value, word) in values.iter_mut().zip(words) {
        *value = line.number(word, expected)?;
    }
    Ok(values)
}

fn physical_names(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let count = lines
        .expect("the number of names")?
        .count("the number of names")?;
    for _ in 0..count {
        let expected = "dimension, number and \"name\" of a physical group";
        let line = lines.expect(expected)?;
        let [dimension, number] = whole(&line, expected)?;
        let name = line
            .text
            .split('"')
            .nth(1)
            .ok_or_else(|| line.error(expected))?;
        raw.names
            .insert((dimension as u32, number as i32), name.to_owned());
    }
    close(lines, "$EndPhysicalNames")
}

/// Reads the entities of version 4.1. Points have 3 coordinates before their physical groups, all
/// other entities have 6.
fn entities(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let counts: [i64; 4] = whole(
        &lines.expect("four counts")?,
        "numbers of points, curves, surfaces and volumes",
    )?;
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let expected = "number, bounds and physical groups of an entity";
            let line = lines.expect(expected)?;
            let words = line.words();
            let at = if dimension == 0 { 4 } else { 7 };
            let word = |i: usize| words.get(i).ok_or_else(|| line.error(expected));
            let number: i64 = line.number(word(0)?, expected)?;
            let n_groups: usize = line.number(word(at)?, expected)?;
            let groups = groups(&line, &words, at, n_groups, expected)?;
            raw.groups.insert((dimension as u32, number), groups);
        }
    }
    close(lines, "$EndEntities")
}

/// The physical groups after their count, without the sign that turns an entity.
fn groups(
    line: &Line,
    words: &[&str],
    at: usize,
    n: usize,
    expected: &str,
) -> Result<Vec<i32>, MeshFileError> {
    let words = (at + 1)
        .checked_add(n)
        .and_then(|end| words.get(at + 1..end));
    let words = words.ok_or_else(|| line.error(expected))?;
    let mut groups = Vec::with_capacity(n);
    for word in words {
        let group: i32 = line.number(word, expected)?;
        let group = group.checked_abs().ok_or_else(|| line.error(expected))?;
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    Ok(groups)
}

/// Reads the entities of a partitioned mesh: each part of an entity has a number and groups of its own.
fn partitioned_entities(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let expected = "number, parent, partitions, bounds and physical groups of a part";
    lines.expect("the number of partitions")?;
    let ghosts = lines.expect("the number of ghost entities")?;
    let n_ghosts = ghosts.count("the number of ghost entities")?;
    for _ in 0..n_ghosts {
        lines.expect("a ghost entity and its partition")?;
    }
    let counts: [i64; 4] = whole(
        &lines.expect("four counts")?,
        "numbers of points, curves, surfaces and volumes",
    )?;
    for (dimension, count) in counts.into_iter().enumerate() {
        for _ in 0..count {
            let line = lines.expect(expected)?;
            let words = line.words();
            let word = |i: usize| words.get(i).ok_or_else(|| line.error(expected));
            let number: i64 = line.number(word(0)?, expected)?;
            let n_partitions: usize = line.number(word(3)?, expected)?;
            let bounds = if dimension == 0 { 3 } else { 6 };
            let at = n_partitions
                .checked_add(4 + bounds)
                .ok_or_else(|| line.error(expected))?;
            let n_groups: usize = line.number(word(at)?, expected)?;
            let groups = groups(&line, &words, at, n_groups, expected)?;
            raw.groups.insert((dimension as u32, number), groups);
        }
    }
    close(lines, "$EndPartitionedEntities")
}

fn nodes_v2(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let count = lines
        .expect("the number of nodes")?
        .count("the number of nodes")?;
    for _ in 0..count {
        let expected = "number, x, y and z of a node";
        let line = lines.expect(expected)?;
        let (number, rest) = line
            .text
            .split_once(char::is_whitespace)
            .ok_or_else(|| line.error(expected))?;
        let number = line.number(number, expected)?;
        let position = Line { text: rest, ..line }.floats(expected)?;
        raw.nodes.push((number, position));
    }
    close(lines, "$EndNodes")
}

fn nodes_v4(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let [n_blocks, ..] = whole::<4>(
        &lines.expect("four counts")?,
        "blocks, nodes, smallest and largest number",
    )?;
    for _ in 0..n_blocks {
        let header = lines.expect("a block of nodes")?;
        let [_, _, parametric, count] =
            whole(&header, "dimension, entity, parametric and number of nodes")?;
        if parametric != 0 {
            return Err(
                header.error("nodes without parameters (save with `Mesh.SaveParametric = 0`)")
            );
        }
        let mut numbers = Vec::new();
        for _ in 0..count {
            numbers
                .push(whole::<1>(&lines.expect("a node's number")?, "a node's number")?[0] as u64);
        }
        for number in numbers {
            raw.nodes.push((
                number,
                lines
                    .expect("x, y and z of a node")?
                    .floats("x, y and z of a node")?,
            ));
        }
    }
    close(lines, "$EndNodes")
}

fn elements_v2(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let count = lines
        .expect("the number of elements")?
        .count("the number of elements")?;
    for _ in 0..count {
        let expected = "number, type, number of tags, tags and nodes of an element";
        let line = lines.expect(expected)?;
        let words = line.words();
        let [_, kind, n_tags] = whole(&line, expected)?;
        let group: i32 = if n_tags > 0 {
            line.number(words.get(3).unwrap_or(&""), expected)?
        } else {
            0
        };
        let group = group.checked_abs().ok_or_else(|| line.error(expected))?;
        let nodes = usize::try_from(n_tags)
            .ok()
            .and_then(|n| words.get(3 + n..))
            .ok_or_else(|| line.error(expected))?;
        raw.element(&line, kind as u32, &[group], nodes)?;
    }
    close(lines, "$EndElements")
}

fn elements_v4(lines: &mut Lines, raw: &mut Raw) -> Result<(), MeshFileError> {
    let [n_blocks, ..] = whole::<4>(
        &lines.expect("four counts")?,
        "blocks, elements, smallest and largest number",
    )?;
    for _ in 0..n_blocks {
        let header = lines.expect("a block of elements")?;
        let [dimension, entity, kind, count] =
            whole(&header, "dimension, entity, type and number of elements")?;
        let groups = raw
            .groups
            .get(&(dimension as u32, entity))
            .cloned()
            .unwrap_or_default();
        for _ in 0..count {
            let line = lines.expect("number and nodes of an element")?;
            let words = line.words();
            let nodes = words.get(1..).unwrap_or_default();
            raw.element(&line, kind as u32, &groups, nodes)?;
        }
    }
    close(lines, "$EndElements")
}

impl Raw {
    fn element(
        &mut self,
        line: &Line,
        kind: u32,
        groups: &[i32],
        words: &[&str],
    ) -> Result<(), MeshFileError> {
        fn corners<const N: usize>(line: &Line, words: &[&str]) -> Result<[u64; N], MeshFileError> {
            let expected = format!("{N} nodes of an element");
            let words: &[&str; N] = words.try_into().map_err(|_| line.error(expected.clone()))?;
            let mut found = [0; N];
            for (node, word) in found.iter_mut().zip(words) {
                *node = line.number(word, &expected)?;
            }
            Ok(found)
        }
        match kind {
            TETRAHEDRON => {
                if let [one, other, ..] = groups {
                    let found = self.in_both(*one, *other);
                    return Err(MeshFileError::line(
                        line.file,
                        line.number,
                        found,
                        ONE_GROUP,
                    ));
                }
                let group = groups.first().copied().unwrap_or(0);
                self.tets.push((group, corners(line, words)?, line.number));
            }
            TRIANGLE => {
                let corners = corners(line, words)?;
                for group in groups {
                    self.triangles.push((*group, corners, line.number));
                }
            }
            POINT | LINE => {}
            11 | 9 | 8 => {
                return Err(line.error(format!(
                    "elements of first order, not of gmsh's type {kind} (mesh with `Mesh.ElementOrder = 1`)"
                )));
            }
            _ => {
                return Err(line.error(format!(
                    "tetrahedra and triangles, not gmsh's element type {kind}"
                )));
            }
        }
        Ok(())
    }

    /// Description of tetrahedra in two physical groups.
    fn in_both(&self, one: i32, other: i32) -> String {
        let name = |group: i32| match self.names.get(&(3, group)) {
            Some(name) => format!("{name:?} ({group})"),
            None => group.to_string(),
        };
        format!(
            "a tetrahedron in the physical groups {} and {}",
            name(one),
            name(other)
        )
    }

    fn into_mesh(self, file: &Path, unit: LengthUnit) -> Result<TetMesh, MeshFileError> {
        // Version 2 writes an element of two groups twice.
        let mut seen: HashMap<[u64; 4], i32> = HashMap::with_capacity(self.tets.len());
        for (group, corners, line) in &self.tets {
            let mut key = *corners;
            key.sort_unstable();
            match seen.insert(key, *group) {
                Some(other) if other != *group => {
                    let found = self.in_both(other, *group);
                    return Err(MeshFileError::line(file, *line, found, ONE_GROUP));
                }
                _ => {}
            }
        }
        let positions: HashMap<u64, Vec3> = self.nodes.iter().copied().collect();
        let mut used: Vec<u64> = self
            .tets
            .iter()
            .flat_map(|(_, corners, _)| *corners)
            .collect();
        used.sort_unstable();
        used.dedup();
        let index: HashMap<u64, u32> = used
            .iter()
            .enumerate()
            .map(|(i, number)| (*number, i as u32))
            .collect();
        let mut mesh = TetMesh::default();
        for (group, corners, line) in &self.tets {
            if let Some(missing) = corners
                .iter()
                .find(|number| !positions.contains_key(number))
            {
                return Err(MeshFileError::line(
                    file,
                    *line,
                    format!("node {missing}"),
                    "a node listed in `$Nodes`",
                ));
            }
            mesh.tets.push(corners.map(|number| index[&number]));
            mesh.tags.push(*group);
        }
        if mesh.tets.is_empty() {
            return Err(MeshFileError::content(
                file,
                "no tetrahedra",
                "a volume mesh (gmsh saves only physical groups where there are any: put the volume into one)",
            ));
        }
        mesh.nodes_mm = used
            .iter()
            .map(|number| unit.to_mm(positions[number]))
            .collect();
        mesh.orient_if_all_negative();
        let outward: HashMap<[u32; 3], [u32; 3]> = boundary(&mesh)
            .iter()
            .map(|face| (sorted(face.triangle), face.triangle))
            .collect();
        let mut surfaces: BTreeMap<i32, Vec<[u32; 3]>> = BTreeMap::new();
        for (group, corners, line) in &self.triangles {
            let face = corners.map(|number| index.get(&number).copied());
            let face = match face {
                [Some(a), Some(b), Some(c)] => outward.get(&sorted([a, b, c])),
                _ => None,
            };
            match (face, *group) {
                (_, 0) => {}
                (Some(face), group) => surfaces.entry(group).or_default().push(*face),
                (None, group) => {
                    return Err(MeshFileError::line(
                        file,
                        *line,
                        format!(
                            "a triangle of physical surface {group} that is no boundary face of the tetrahedra"
                        ),
                        "physical surfaces on the boundary only",
                    ));
                }
            }
        }
        for (group, triangles) in surfaces {
            let name = self
                .names
                .get(&(2, group))
                .cloned()
                .unwrap_or_else(|| format!("surface-{group}"));
            mesh.surfaces.push(Surface { name, triangles });
        }
        Ok(mesh)
    }
}
