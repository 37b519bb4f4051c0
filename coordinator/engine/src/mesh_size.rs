//! Number of nodes of a patient's mesh: the requested one for a generated mesh, the one in the file
//! for the patient's own.

use std::collections::HashMap;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::task::{InputFile, PassiveStateSpec};

/// Bytes read from the head of a mesh file. The count is in its first lines; in Gmsh's files the
/// names and entities precede it.
const HEAD_BYTES: u64 = 1 << 20;

/// Number of nodes of the mesh of a patient in 3D. If the file of a patient's own mesh does not
/// state it, the requested number is used: it decides the resources of a job, not the results.
#[must_use]
pub fn nodes(plan: &ResolvedPatient) -> u32 {
    of_step0(&plan.step0).unwrap_or(plan.settings.solver.finite_element.mesh_nodes)
}

/// Number of nodes of the patient's own mesh in step 0; `None` without such a mesh, or if its file does
/// not state the number.
#[must_use]
pub fn of_step0(spec: &PassiveStateSpec) -> Option<u32> {
    of_file(&own_file(spec)?.path)
}

/// Numbers of nodes of patients' own meshes, each read once; `None` for a file that does not state
/// it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeshSizes(HashMap<PathBuf, Option<u32>>);

impl MeshSizes {
    /// Reads the file of a patient's own mesh, unless it is known.
    pub fn learn(&mut self, plan: &ResolvedPatient) {
        if let Some(path) = self.unknown(plan) {
            let nodes = of_file(&path);
            self.0.insert(path, nodes);
        }
    }

    /// File of a patient's own mesh, unless it is known or the mesh is generated.
    pub fn unknown(&self, plan: &ResolvedPatient) -> Option<PathBuf> {
        let file = own_file(&plan.step0)?;
        (!self.0.contains_key(&file.path)).then(|| file.path.clone())
    }

    /// Adds what was read.
    pub fn extend(&mut self, read: Vec<(PathBuf, Option<u32>)>) {
        self.0.extend(read);
    }

    /// Number of nodes of a patient's mesh. A mesh whose file was not read counts as generated.
    pub fn nodes(&self, plan: &ResolvedPatient) -> u32 {
        let known = own_file(&plan.step0).and_then(|file| self.0.get(&file.path));
        let generated = plan.settings.solver.finite_element.mesh_nodes;
        known.copied().flatten().unwrap_or(generated)
    }
}

fn own_file(spec: &PassiveStateSpec) -> Option<&InputFile> {
    spec.own_mesh.as_ref()?.files.first()
}

/// Number of nodes that the file of a mesh states.
pub fn of_file(path: &Path) -> Option<u32> {
    let mut bytes = Vec::new();
    File::open(path)
        .ok()?
        .take(HEAD_BYTES)
        .read_to_end(&mut bytes)
        .ok()?;
    let text = String::from_utf8_lossy(&bytes);
    match path.extension()?.to_str()? {
        "pts" => text.lines().next()?.trim().parse().ok(),
        "vtu" => text
            .split_once("NumberOfPoints=\"")?
            .1
            .split_once('"')?
            .0
            .trim()
            .parse()
            .ok(),
        "mesh" => text
            .split_once("Vertices")?
            .1
            .split_whitespace()
            .next()?
            .parse()
            .ok(),
        // Version 2 has the count alone; version 4 has blocks, nodes, first and last tag.
        "msh" => {
            let line = text.split_once("$Nodes")?.1.trim_start().lines().next()?;
            let numbers: Vec<&str> = line.split_whitespace().collect();
            numbers.get(usize::from(numbers.len() > 1))?.parse().ok()
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::of_file;

    #[test]
    fn every_format_says_how_many_nodes_it_has() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text, nodes) in [
            ("a.pts", "1234\n0 0 0\n", Some(1234)),
            (
                "a.mesh",
                "MeshVersionFormatted 2\nDimension 3\nVertices\n77\n0 0 0 0\n",
                Some(77),
            ),
            (
                "b.vtu",
                "<VTKFile><Piece NumberOfPoints=\"77\" NumberOfCells=\"9\">",
                Some(77),
            ),
            (
                "c.msh",
                "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n51\n1 0 0 0\n",
                Some(51),
            ),
            (
                "d.msh",
                "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n3 99 1 99\n2 1 0 5\n",
                Some(99),
            ),
            ("e.pts", "many\n", None),
            ("f.obj", "12\n", None),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert_eq!(of_file(&path), nodes, "{name}");
        }
        assert_eq!(of_file(&folder.path().join("absent.pts")), None);
    }
}
