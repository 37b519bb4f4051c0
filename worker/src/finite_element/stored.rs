//! Storage of a ventricle in one file, which step 0 writes and from which all simulations of the
//! patient start.

use std::path::Path;

use cardiotwin_linalg::parallel::{MessageReader, MessageWriter};
use cardiotwin_mechanics::fibre_message;
use cardiotwin_mechanics::organ::{Anatomy, EndDiastole, RightPressure, WallParameters};
use cardiotwin_mesh::surface::Surface;
use cardiotwin_mesh::tags;
use cardiotwin_mesh::tet_mesh::{Frame, TetMesh};
use cardiotwin_schemas::finite_element::{ElementKind, WallSettings};
use cardiotwin_schemas::formats::VENTRICLE;
use cardiotwin_schemas::task::InputFile;
use serde::{Deserialize, Serialize};

use super::arrays::{Arrays, ArraysError};
use super::{FiniteElementError, wall};
use crate::error::TaskError;
use crate::inputs::read_verified;

/// Content of the file other than arrays.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Kind of finite elements.
    pub element: ElementKind,
    /// Settings of the wall, with the fitted stiffness.
    pub wall: WallSettings,
    /// Factor of the law's exponents. It is lowered if no stiffness fits.
    pub exponent_factor: f64,
    /// Part of this factor that comes from the patient's effects.
    pub effects_exponent_factor: f64,
    /// Pressure of the left ventricle at end-diastole \[kPa\].
    pub end_diastolic_pressure_kpa: f64,
    /// Names of the mesh's surfaces.
    pub surfaces: Vec<String>,
    /// Whether the mesh is the patient's own and not a generated one.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_own_mesh: bool,
    /// Pressure of the right ventricle, if the mesh has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub right_pressure: Option<RightPressure>,
}

impl About {
    /// Parameters of the wall, with an additional share of the active stress across the fibre.
    #[must_use]
    pub fn wall(&self, cross_fibre: f64) -> WallParameters {
        WallParameters {
            right_pressure: self.right_pressure.clone(),
            ..wall::parameters(&self.wall, self.exponent_factor, cross_fibre)
        }
    }
}

/// A ventricle in the form of its file.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredVentricle {
    /// Content other than arrays.
    pub about: About,
    /// Mesh of the image: nodes, elements, tags, fibres, surfaces.
    pub mesh: TetMesh,
    /// Activation times of the vertices from the first activation on \[ms\]; infinite in passive
    /// tissue.
    pub activation_ms: Vec<f64>,
    /// Unloaded node positions \[mm\].
    pub unloaded: Vec<[f64; 3]>,
    /// Rest position of the rim's springs relative to the image \[mm\].
    pub anchor: Vec<f64>,
    /// Displacement from the unloaded geometry to end-diastole \[mm\].
    pub u: Vec<f64>,
}

/// A ventricle in the form that the solver uses.
#[derive(Debug)]
pub struct Restored {
    /// Anatomy of the mesh.
    pub anatomy: Anatomy,
    /// Parameters of the wall.
    pub wall: WallParameters,
    /// Deformation and pressure at end-diastole, from which beats start.
    pub end_diastole: EndDiastole,
}

impl StoredVentricle {
    /// Encodes the file. The same ventricle always gives the same bytes.
    ///
    /// # Panics
    /// Never in practice: the content other than arrays is valid JSON.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let about = serde_json::to_value(&self.about).expect("plain fields are JSON");
        let mesh = &self.mesh;
        let frames = mesh
            .frames
            .iter()
            .flat_map(|f| [f.fibre, f.sheet, f.normal])
            .flatten();
        let mut arrays = Arrays::new(&VENTRICLE.kind(), about)
            .with("nodes_mm", mesh.nodes_mm.as_flattened())
            .with_indices("tets", mesh.tets.as_flattened())
            .with_indices(
                "tags",
                mesh.tags
                    .iter()
                    .map(|tag| tag.cast_unsigned())
                    .collect::<Vec<_>>(),
            )
            .with("frames", frames.collect::<Vec<_>>());
        let mut fibres = MessageWriter::default();
        fibre_message::pack(&mesh.fibres, &mut fibres);
        arrays = arrays.with("fibres", fibres.numbers);
        let (mut triangles, mut lengths) = (Vec::new(), Vec::new());
        for surface in &mesh.surfaces {
            lengths.push(surface.triangles.len() as u32);
            triangles.extend_from_slice(surface.triangles.as_flattened());
        }
        arrays = arrays
            .with_indices("surface_lengths", lengths)
            .with_indices("triangles", triangles);
        arrays
            .with("activation_ms", self.activation_ms.as_slice())
            .with("unloaded_mm", self.unloaded.as_flattened())
            .with("anchor_mm", self.anchor.as_slice())
            .with("u_mm", self.u.as_slice())
            .to_bytes()
    }

    /// Reads a task's file and checks that its content is the one that the task was planned with.
    ///
    /// # Errors
    /// [`TaskError`] when the file is missing, changed, truncated, or not a ventricle.
    pub fn read(input: &InputFile) -> Result<Self, TaskError> {
        let bytes = read_verified(input)?;
        Self::from_bytes(&bytes, &input.path).map_err(TaskError::FiniteElement)
    }

    fn from_bytes(bytes: &[u8], file: &Path) -> Result<Self, FiniteElementError> {
        let refused = |source| FiniteElementError::File {
            file: file.to_owned(),
            source,
        };
        Self::parse(bytes).map_err(refused)
    }

    fn parse(bytes: &[u8]) -> Result<Self, ArraysError> {
        let mut arrays = Arrays::from_bytes(bytes, &VENTRICLE.kind())?;
        let about: About =
            serde_json::from_value(arrays.about.take()).map_err(ArraysError::Header)?;
        let frames = arrays.take("frames")?;
        let fibres = arrays.take("fibres")?;
        let mut mesh = TetMesh {
            nodes_mm: arrays.take("nodes_mm")?.as_chunks().0.to_vec(),
            tets: arrays.take_indices("tets")?.as_chunks().0.to_vec(),
            tags: arrays
                .take_indices("tags")?
                .into_iter()
                .map(u32::cast_signed)
                .collect(),
            frames: frames.as_chunks::<9>().0.iter().map(frame).collect(),
            fibres: fibre_message::unpack(&mut MessageReader::new(&fibres)),
            surfaces: Vec::new(),
        };
        let lengths = arrays.take_indices("surface_lengths")?;
        let triangles = arrays.take_indices("triangles")?;
        let mut triangles = triangles.as_chunks::<3>().0.iter();
        for (name, length) in about.surfaces.iter().zip(lengths) {
            let triangles = triangles.by_ref().take(length as usize).copied().collect();
            mesh.surfaces.push(Surface {
                name: name.clone(),
                triangles,
            });
        }
        let stored = Self {
            about,
            activation_ms: arrays.take("activation_ms")?,
            unloaded: arrays.take("unloaded_mm")?.as_chunks().0.to_vec(),
            anchor: arrays.take("anchor_mm")?,
            u: arrays.take("u_mm")?,
            mesh,
        };
        stored.check()?;
        Ok(stored)
    }

    /// Checks that indices are in range and that the lengths of related arrays agree.
    fn check(&self) -> Result<(), ArraysError> {
        let (n, m) = (self.mesh.n_nodes(), self.mesh.n_tets());
        let surfaces = self
            .mesh
            .surfaces
            .iter()
            .flat_map(|s| s.triangles.as_flattened());
        let inside = self
            .mesh
            .tets
            .as_flattened()
            .iter()
            .chain(surfaces)
            .all(|node| (*node as usize) < n);
        let missing = |name, expected: String| Err(ArraysError::Missing { name, expected });
        if !inside {
            return missing(
                "nodes_mm",
                "all nodes that elements and surfaces name".to_owned(),
            );
        }
        if self.mesh.tags.len() != m || self.mesh.frames.len() != m {
            return missing("frames", format!("{m} elements, as of tags"));
        }
        if self.mesh.fibres.n_nodes().is_some_and(|found| found != n) {
            return missing("fibres", format!("{n} nodes"));
        }
        if self.activation_ms.len() != n {
            return missing("activation_ms", format!("{n} nodes"));
        }
        let all = self.unloaded.len();
        if all < n || self.anchor.len() != 3 * all || self.u.len() != 3 * all {
            return missing(
                "unloaded_mm",
                format!("{n} nodes or more, as of anchor_mm and u_mm"),
            );
        }
        Ok(())
    }

    /// Restores the ventricle at end-diastole.
    ///
    /// - `cross_fibre`: share of the active stress across the fibre, added to that of the wall's settings
    ///
    /// # Errors
    /// [`FiniteElementError`] for an invalid mesh or wall.
    pub fn restore(&self, cross_fibre: f64) -> Result<Restored, FiniteElementError> {
        let about = &self.about;
        let anatomy = Anatomy::of(
            &self.mesh,
            &[tags::LEFT_VENTRICLE],
            wall::element(about.element, about.wall.pointwise_share),
        )?;
        let wall = about.wall(cross_fibre);
        let end_diastole = EndDiastole {
            unloaded: self.unloaded.clone(),
            anchor: self.anchor.clone(),
            u: self.u.clone(),
            pressure_kpa: about.end_diastolic_pressure_kpa,
        };
        Ok(Restored {
            anatomy,
            wall,
            end_diastole,
        })
    }
}

fn frame(f: &[f64; 9]) -> Frame {
    let axis = |k: usize| [f[3 * k], f[3 * k + 1], f[3 * k + 2]];
    Frame {
        fibre: axis(0),
        sheet: axis(1),
        normal: axis(2),
    }
}
