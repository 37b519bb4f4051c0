//! Calls of mmg3d as a separate program, which exchanges meshes through a temporary folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use cardiotwin_mesh::files::medit;
use cardiotwin_mesh::surface::{Surface, sorted};
use cardiotwin_mesh::{LengthUnit, TetMesh, transfer};

use crate::error::CliError;
use crate::mesh_error::MmgError;

/// Names under which mmg3d is installed.
const NAMES: [&str; 2] = ["mmg3d_O3", "mmg3d"];
/// Number of last output lines that an error message repeats.
const SHOWN: usize = 6;

/// Path of mmg3d: the named one, otherwise the first in PATH.
///
/// # Errors
/// [`MmgError::Missing`] if no path was named and PATH holds no mmg3d.
pub fn program(named: Option<&Path>) -> Result<PathBuf, CliError> {
    if let Some(named) = named {
        return Ok(named.to_owned());
    }
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    let places = NAMES
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
    places
        .into_iter()
        .find(|place| place.is_file())
        .ok_or_else(|| MmgError::Missing.into())
}

/// Meshes the same body again with edges of about `edge_mm`; the new surface lies within
/// `distance_mm` of the old one. Tags and surfaces follow mmg's references, directions come from
/// the nearest old element.
///
/// # Errors
/// [`CliError::Mmg`] if mmg3d cannot be run or its answer cannot be read.
pub fn remesh(
    program: &Path,
    old: &TetMesh,
    edge_mm: f64,
    distance_mm: f64,
) -> Result<TetMesh, CliError> {
    let folder = tempfile::tempdir().map_err(MmgError::Folder)?;
    let (given, made) = (
        folder.path().join("given.mesh"),
        folder.path().join("made.mesh"),
    );
    let parts = Parts::of(old);
    medit::write(&parts.mesh, &given).map_err(MmgError::from)?;
    let output = Command::new(program)
        .args([
            "-v",
            "1",
            "-hsiz",
            &edge_mm.to_string(),
            "-hausd",
            &distance_mm.to_string(),
        ])
        .arg("-in")
        .arg(&given)
        .arg("-out")
        .arg(&made)
        .output()
        .map_err(|source| MmgError::Start {
            program: program.to_owned(),
            source,
        })?;
    if !output.status.success() || !made.is_file() {
        let said = [output.stdout, output.stderr].concat();
        let said = String::from_utf8_lossy(&said);
        let lines: Vec<&str> = said
            .lines()
            .map(str::trim)
            .filter(|line| !line.is_empty())
            .collect();
        let said = lines[lines.len().saturating_sub(SHOWN)..].join("\n");
        return Err(MmgError::Failed {
            program: program.to_owned(),
            said,
        }
        .into());
    }
    let mut mesh = medit::read(&made, LengthUnit::Millimetre).map_err(MmgError::from)?;
    mesh.surfaces = parts.joined(&mesh.surfaces, old);
    mesh.frames = transfer::frames(old, &mesh);
    Ok(mesh)
}

/// A mesh whose surfaces share no triangle. If surfaces of the old mesh overlap (a file's own
/// `endo` next to `endocardium`), each combination of them becomes a surface of its own, because mmg
/// keeps one reference per triangle.
struct Parts {
    mesh: TetMesh,
    /// Indices of the old mesh's surfaces that contain each part.
    of: Vec<Vec<usize>>,
}

impl Parts {
    fn of(old: &TetMesh) -> Self {
        let mut surfaces_of: BTreeMap<[u32; 3], ([u32; 3], Vec<usize>)> = BTreeMap::new();
        for (i, surface) in old.surfaces.iter().enumerate() {
            for triangle in &surface.triangles {
                let entry = surfaces_of
                    .entry(sorted(*triangle))
                    .or_insert((*triangle, vec![]));
                if entry.1.last() != Some(&i) {
                    entry.1.push(i);
                }
            }
        }
        let mut parts: BTreeMap<Vec<usize>, Vec<[u32; 3]>> = BTreeMap::new();
        for (triangle, surfaces) in surfaces_of.into_values() {
            parts.entry(surfaces).or_default().push(triangle);
        }
        let (of, triangles): (Vec<_>, Vec<_>) = parts.into_iter().unzip();
        let surfaces = triangles
            .into_iter()
            .map(|triangles| Surface {
                name: String::new(),
                triangles,
            })
            .collect();
        Self {
            mesh: TetMesh {
                surfaces,
                ..old.clone()
            },
            of,
        }
    }

    /// The old mesh's surfaces, put together again from the parts in mmg's answer by their
    /// references.
    fn joined(&self, found: &[Surface], old: &TetMesh) -> Vec<Surface> {
        let empty = |surface: &Surface| Surface {
            name: surface.name.clone(),
            triangles: vec![],
        };
        let mut surfaces: Vec<Surface> = old.surfaces.iter().map(empty).collect();
        for part in found {
            let number = part
                .name
                .strip_prefix(medit::SURFACE_PREFIX)
                .and_then(|n| n.parse::<usize>().ok());
            for i in number
                .and_then(|n| self.of.get(n.wrapping_sub(1)))
                .into_iter()
                .flatten()
            {
                surfaces[*i].triangles.extend(&part.triangles);
            }
        }
        surfaces.retain(|surface| !surface.triangles.is_empty());
        surfaces
    }
}

impl From<MmgError> for CliError {
    fn from(error: MmgError) -> Self {
        Self::Mmg(error)
    }
}
