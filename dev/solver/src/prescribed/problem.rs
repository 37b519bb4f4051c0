//! Problem definition, and the body with supports, loads, probes and cavities that is built from it.

use cardiotwin_linalg::Pattern;
use cardiotwin_linalg::parallel::{Layout, SingleProcess};
use cardiotwin_mesh::surface::{SurfaceDefect, openings};
use cardiotwin_mesh::tet_mesh::{TetMesh, shape_gradients};

use super::time_course::Course;
use cardiotwin_mechanics::body::{Body, BodyError, BodyInput};
use cardiotwin_mechanics::boundary::{
    Cavity, PressureSurface, Robin, RobinDirection, SurfaceError,
};
use cardiotwin_mechanics::element::batch::Frame;
use cardiotwin_mechanics::element::quadratic::QuadraticMesh;
use cardiotwin_mechanics::element::shape::values;
use cardiotwin_mechanics::material::Tissue;
use cardiotwin_mechanics::organ::ElementKind;

/// Springs and dashpots on triangles of the mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceSupport {
    /// Triangles with normals out of the tissue.
    pub triangles: Vec<[u32; 3]>,
    /// Displacement components that the support resists.
    pub direction: RobinDirection,
    /// Stiffness of the springs per area \[kPa/mm\].
    pub spring: f64,
    /// Damping of the dashpots per area \[kPa·ms/mm\].
    pub dashpot: f64,
}

/// Position of the mid-edge node between two vertices \[mm\]; `None` for the edge's midpoint.
pub type Middle<'a> = dyn Fn(u32, u32) -> Option<[f64; 3]> + 'a;

/// A problem on a mesh of linear tetrahedra, for any kind of elements.
pub struct Problem<'a> {
    /// The mesh; its fibre frames are ignored.
    pub mesh: &'a TetMesh,
    /// Interpolation and volume law of the elements.
    pub kind: ElementKind,
    /// Curved edges of quadratic elements.
    pub middle: &'a Middle<'a>,
    /// Tissues that elements refer to.
    pub tissues: Vec<Tissue>,
    /// Viscosity of each tissue \[kPa·ms\].
    pub viscosity_kpa_ms: Vec<f64>,
    /// Tissue of each element.
    pub tissue_of: Vec<usize>,
    /// Fibre frame at a point of an element (element, coordinates \[mm\]).
    pub frame: &'a dyn Fn(usize, [f64; 3]) -> Frame,
    /// Springs and dashpots on surfaces.
    pub supports: Vec<SurfaceSupport>,
    /// Triangles with constrained nodes, and the constrained components.
    pub fixed: Vec<(Vec<[u32; 3]>, [bool; 3])>,
    /// Triangles under a pressure that follows their deformation.
    pub pressures: Vec<(Vec<[u32; 3]>, Course)>,
    /// Active stress of all contracting tissue.
    pub active: Course,
    /// Surfaces that each enclose a cavity; openings are closed by flat triangle fans.
    pub cavities: Vec<Vec<[u32; 3]>>,
    /// Points whose displacement is sampled \[mm\].
    pub probes: Vec<[f64; 3]>,
}

impl std::fmt::Debug for Problem<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Problem")
            .field("kind", &self.kind)
            .field("tissues", &self.tissues)
            .finish_non_exhaustive()
    }
}

/// Reasons why a problem cannot be set up.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProblemError {
    /// An element or tissue is invalid.
    #[error("invalid body")]
    Body(#[from] BodyError),
    /// A surface does not belong to the mesh.
    #[error("invalid surface")]
    Surface(#[from] SurfaceError),
    /// A cavity's surface is not an orientable surface.
    #[error("invalid surface of cavity {cavity}")]
    Cavity {
        /// Index of the cavity.
        cavity: usize,
        /// Defect of the surface.
        source: SurfaceDefect,
    },
    /// A probe lies outside of the tissue.
    #[error(
        "probe {probe} at ({:.3}, {:.3}, {:.3}) mm lies outside of every element (its smallest barycentric coordinate \
         in the nearest is {outside:.2}, expected at least −{TOLERANCE})", at[0], at[1], at[2]
    )]
    Probe {
        /// Index of the probe.
        probe: usize,
        /// Position of the probe \[mm\].
        at: [f64; 3],
        /// Smallest barycentric coordinate of the probe in the nearest element; it is negative
        /// outside.
        outside: f64,
    },
}

/// Largest distance of a probe from its element in barycentric coordinates, since surfaces are faceted.
const TOLERANCE: f64 = 0.2;

/// A body with supports, loads, cavities and probes.
#[derive(Debug)]
pub struct Setup {
    /// Body with its elements and tissues.
    pub body: Body,
    /// Springs and dashpots: matrix, stiffness \[kPa/mm\], damping \[kPa·ms/mm\].
    pub supports: Vec<(Robin, f64, f64)>,
    /// Constrained components of each node; empty for none.
    pub fixed: Vec<[bool; 3]>,
    /// Surfaces with the course of their pressure.
    pub pressures: Vec<(PressureSurface, Course)>,
    /// Course of the active stress in all contracting tissue.
    pub active: Course,
    /// Cavities whose volumes are sampled.
    pub cavities: Vec<Cavity>,
    /// Nodes and shape functions of each probe.
    pub probes: Vec<Vec<(u32, f64)>>,
}

/// Triangles with the nodes of the elements' faces.
enum Faces {
    Linear(Vec<[u32; 3]>),
    Quadratic(Vec<[u32; 6]>),
}

impl Problem<'_> {
    /// Builds the body.
    ///
    /// # Errors
    /// [`ProblemError`] for an invalid tissue, element, surface or probe.
    pub fn set_up(&self) -> Result<Setup, ProblemError> {
        let quadratic = self
            .kind
            .quadratic
            .then(|| QuadraticMesh::new(&self.mesh.nodes_mm, &self.mesh.tets, self.middle));
        let mut body = match &quadratic {
            Some(q) => Body::quadratic(&self.input(&q.nodes, &q.tets), &SingleProcess)?,
            None => Body::linear(
                &self.input(&self.mesh.nodes_mm, &self.mesh.tets),
                &SingleProcess,
            )?,
        };
        body.set_viscosity(self.viscosity_kpa_ms.clone())?;
        let faces = |triangles: &[[u32; 3]]| match &quadratic {
            None => Ok(Faces::Linear(triangles.to_vec())),
            Some(q) => (triangles.iter().enumerate())
                .map(|(triangle, t)| {
                    let missing = SurfaceError::NotOfBody {
                        triangle,
                        a: t[0],
                        b: t[1],
                    };
                    q.triangle(*t).ok_or(missing)
                })
                .collect::<Result<_, _>>()
                .map(Faces::Quadratic),
        };
        let pattern = body.pattern().clone();
        let reference = body.reference().to_vec();
        let mut supports = vec![];
        for s in &self.supports {
            let robin = match faces(&s.triangles)? {
                Faces::Linear(t) => Robin::new(&t, s.direction, &reference, &pattern)?,
                Faces::Quadratic(t) => Robin::new(&t, s.direction, &reference, &pattern)?,
            };
            supports.push((robin, s.spring, s.dashpot));
        }
        let mut fixed = if self.fixed.is_empty() {
            vec![]
        } else {
            vec![[false; 3]; body.n_nodes()]
        };
        for (triangles, components) in &self.fixed {
            let nodes = match faces(triangles)? {
                Faces::Linear(t) => t.as_flattened().to_vec(),
                Faces::Quadratic(t) => t.as_flattened().to_vec(),
            };
            for node in nodes {
                (0..3).for_each(|i| fixed[node as usize][i] |= components[i]);
            }
        }
        let mut pressures = vec![];
        for (triangles, course) in &self.pressures {
            let surface = match faces(triangles)? {
                Faces::Linear(t) => PressureSurface::new(&t, &pattern)?,
                Faces::Quadratic(t) => PressureSurface::new(&t, &pattern)?,
            };
            pressures.push((surface, course.clone()));
        }
        let mut cavities = vec![];
        for (cavity, triangles) in self.cavities.iter().enumerate() {
            let mut loops =
                openings(triangles).map_err(|source| ProblemError::Cavity { cavity, source })?;
            if let Some(q) = &quadratic {
                for nodes in &mut loops {
                    let next = nodes.iter().skip(1).chain(nodes.first()).copied();
                    *nodes = nodes
                        .iter()
                        .zip(next)
                        .flat_map(|(a, b)| [Some(*a), q.middle(*a, b)])
                        .flatten()
                        .collect();
                }
            }
            cavities.push(enclosed(&faces(triangles)?, loops, &reference, &pattern)?);
        }
        let probes = (0..self.probes.len())
            .map(|p| self.probe(p, quadratic.as_ref()))
            .collect::<Result<_, _>>()?;
        Ok(Setup {
            body,
            supports,
            fixed,
            pressures,
            active: self.active.clone(),
            cavities,
            probes,
        })
    }

    fn input<'a, const N: usize>(
        &'a self,
        nodes: &'a [[f64; 3]],
        tets: &'a [[u32; N]],
    ) -> BodyInput<'a, N> {
        BodyInput {
            nodes,
            n_vertices: self.mesh.n_nodes(),
            tets,
            tissues: self.tissues.clone(),
            tissue_of: &self.tissue_of,
            frame: self.frame,
            volume: self.kind.volume,
            layout: Layout::whole(nodes.len()),
            elements: &[],
        }
    }

    /// Nodes and weights of the element that contains a probe or is closest to it.
    fn probe(
        &self,
        probe: usize,
        quadratic: Option<&QuadraticMesh>,
    ) -> Result<Vec<(u32, f64)>, ProblemError> {
        let at = self.probes[probe];
        let mut best = (f64::NEG_INFINITY, 0, [0.0; 4]);
        for e in 0..self.mesh.n_tets() {
            let l = barycentric(self.mesh.corners(e), at);
            let least = l.into_iter().fold(f64::INFINITY, f64::min);
            if least > best.0 {
                best = (least, e, l);
            }
        }
        let (outside, e, l) = best;
        if !(outside >= -TOLERANCE) {
            return Err(ProblemError::Probe { probe, at, outside });
        }
        Ok(match quadratic {
            None => self.mesh.tets[e].into_iter().zip(l).collect(),
            Some(q) => q.tets[e].into_iter().zip(values::<10>(&l)).collect(),
        })
    }
}

fn enclosed(
    faces: &Faces,
    loops: Vec<Vec<u32>>,
    reference: &[f64],
    pattern: &Pattern,
) -> Result<Cavity, SurfaceError> {
    match faces {
        Faces::Linear(t) => Cavity::new::<3>(t, loops, &[], reference, pattern, &SingleProcess),
        Faces::Quadratic(t) => Cavity::new::<6>(t, loops, &[], reference, pattern, &SingleProcess),
    }
}

/// Barycentric coordinates of a point inside or outside the tetrahedron.
fn barycentric(corners: [[f64; 3]; 4], at: [f64; 3]) -> [f64; 4] {
    let (gradients, _) = shape_gradients(corners);
    std::array::from_fn(|k| {
        // The shape function is one at its own corner.
        1.0 + (0..3)
            .map(|i| gradients[k][i] * (at[i] - corners[k][i]))
            .sum::<f64>()
    })
}
