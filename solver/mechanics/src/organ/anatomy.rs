//! Nodes, elements, fibre frames and surfaces of a ventricle, taken from a mesh of linear tetrahedra.

use std::borrow::Cow;

use cardiotwin_linalg::parallel::Part;
use cardiotwin_linalg::vec3::{cross, dot, norm, sub};
use cardiotwin_mesh::NodeFibres;
use cardiotwin_mesh::laplace::LaplaceError;
use cardiotwin_mesh::right_ventricle::{left_alone, rims};
use cardiotwin_mesh::surface::{Surface, SurfaceDefect, openings};
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};

use super::right_ventricle::RightVentricle;
use crate::boundary::NOT_HERE;
use crate::element::batch::Frame;
use crate::element::kernel::VolumeChange;
use crate::element::quadratic::QuadraticMesh;

pub use super::triangles::Triangles;

/// Interpolation and volume law of a ventricle's elements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElementKind {
    /// Whether the tetrahedra are quadratic (ten nodes, straight edges) rather than linear.
    pub quadratic: bool,
    /// Resistance of the elements to a change of volume.
    pub volume: VolumeChange,
}

impl ElementKind {
    /// Linear tetrahedra with nodal volume change, a hundredth of it pointwise: of 1,000 kPa that is a modulus of 10 kPa, about
    /// the tissue's across its fibres, which does not lock.
    pub const LINEAR_NODAL: Self = Self {
        quadratic: false,
        volume: VolumeChange::Nodal {
            pointwise_share: 0.01,
        },
    };
    /// Linear tetrahedra with a plain pointwise penalty (P1/P0 of the paper), which lock.
    pub const LINEAR_POINTWISE: Self = Self {
        quadratic: false,
        volume: VolumeChange::Pointwise,
    };
    /// Quadratic tetrahedra with nodal volume change: Taylor–Hood with a lumped pressure.
    pub const QUADRATIC_NODAL: Self = Self {
        quadratic: true,
        volume: VolumeChange::Nodal {
            pointwise_share: 0.0,
        },
    };
}

/// The elements of a cohort that names none.
impl Default for ElementKind {
    fn default() -> Self {
        Self::LINEAR_NODAL
    }
}

impl std::fmt::Display for ElementKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(if self.quadratic {
            "quadratic"
        } else {
            "linear"
        })?;
        match self.volume {
            VolumeChange::Pointwise => f.write_str(" pointwise"),
            VolumeChange::Nodal {
                pointwise_share: 0.0,
            } => f.write_str(" nodal"),
            VolumeChange::Nodal { pointwise_share } => {
                write!(f, " nodal ({pointwise_share} pointwise)")
            }
        }
    }
}

/// Elements with four or ten nodes.
#[derive(Debug, Clone, PartialEq)]
pub enum Tets {
    /// Tetrahedra with four nodes.
    Linear(Vec<[u32; 4]>),
    /// Tetrahedra with ten nodes.
    Quadratic(Vec<[u32; 10]>),
}

/// Reasons why a mesh does not describe a ventricle.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AnatomyError {
    /// A required surface is missing.
    #[error("the mesh has no surface {name:?}; give its surfaces or determine them first")]
    NoSurface {
        /// Name of the surface.
        name: &'static str,
    },
    /// The endocardium is not an orientable surface with one or more openings.
    #[error("invalid endocardium")]
    Endocardium(#[from] SurfaceDefect),
    /// The endocardium has no opening for a valve.
    #[error("the endocardium has no opening, expected one for each valve or one for all")]
    Closed,
    /// A contracting element has no fibre direction.
    #[error("element {element} contracts, but has no fibre; compute fibres first")]
    NoFibre {
        /// Number of the element in the mesh.
        element: usize,
    },
    /// The transmural depth could not be computed.
    #[error(transparent)]
    Depth(#[from] LaplaceError),
    /// No element has a contracting tag.
    #[error("no element has one of the contracting tags {tags:?}")]
    NoMuscle {
        /// Tags that contract.
        tags: Vec<i32>,
    },
}

/// The long axis of a ventricle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LongAxis {
    /// The node of the outer wall farthest from the base \[mm\].
    pub apex_mm: [f64; 3],
    /// Mean of the rim's nodes \[mm\].
    pub base_mm: [f64; 3],
}

impl LongAxis {
    fn of(mesh: &TetMesh) -> Self {
        let at = |nodes: Vec<u32>| -> Vec<[f64; 3]> {
            let place = |node: u32| mesh.nodes_mm[node as usize];
            nodes.into_iter().map(place).collect()
        };
        let rim = at((mesh.surface(surface_names::RIM).map(Surface::nodes)).unwrap_or_default());
        let n = rim.len().max(1) as f64;
        let base_mm = rim.iter().fold([0.0; 3], |sum: [f64; 3], x| {
            std::array::from_fn(|i| sum[i] + x[i] / n)
        });
        let far = |x: &[f64; 3]| dot(sub(*x, base_mm), sub(*x, base_mm));
        let apex_mm = at(mesh.outer_wall().nodes())
            .into_iter()
            .max_by(|a, b| far(a).total_cmp(&far(b)));
        Self {
            apex_mm: apex_mm.unwrap_or(base_mm),
            base_mm,
        }
    }

    /// Height of a point \[mm\] along the axis: 0 at the apex, 1 at the base and above.
    #[must_use]
    pub fn height(&self, x: [f64; 3]) -> f64 {
        let axis = sub(self.base_mm, self.apex_mm);
        (dot(sub(x, self.apex_mm), axis) / dot(axis, axis)).clamp(0.0, 1.0)
    }
}

/// A left ventricle in its imaged configuration.
#[derive(Debug, Clone, PartialEq)]
pub struct Anatomy {
    /// Node positions \[mm\], vertices first.
    pub nodes: Vec<[f64; 3]>,
    /// Number of vertices, which are the first nodes.
    pub n_vertices: usize,
    /// Elements with the nodes of their interpolation.
    pub tets: Tets,
    /// The four vertices of each element.
    pub corners: Vec<[u32; 4]>,
    /// Resistance of the elements to a change of volume.
    pub volume: VolumeChange,
    /// Whether each element contracts.
    pub contracts: Vec<bool>,
    /// Tag of each element.
    pub tags: Vec<i32>,
    /// Fibre frame of each element in the imaged configuration, arbitrary in passive tissue; unused where `fibres` holds
    /// directions.
    pub frames: Vec<Frame>,
    /// Fibre directions at the vertices, in the imaged configuration.
    pub fibres: NodeFibres,
    /// Transmural depth of each vertex of the muscle: 0 at the endocardium, 1 at the epicardium.
    pub depth: Vec<f64>,
    /// Triangles of the endocardium.
    pub endocardium: Triangles,
    /// Triangles of the epicardium.
    pub epicardium: Triangles,
    /// Triangles of the septum, where the mesh distinguishes it.
    pub septum: Option<Triangles>,
    /// Rim at the base.
    pub rim: Triangles,
    /// The right ventricle, where the mesh has one.
    pub right: Option<RightVentricle>,
    /// Further surfaces of the mesh, by their names.
    pub further: Vec<(String, Triangles)>,
    /// Long axis in the imaged configuration.
    pub axis: LongAxis,
    /// Closed node loops around the endocardium's openings; [`NOT_HERE`] stands for nodes that another rank owns.
    pub openings: Vec<Vec<u32>>,
}

impl Anatomy {
    /// Reads a mesh; elements with one of the `contracting` tags contract.
    ///
    /// # Errors
    /// [`AnatomyError`] where surfaces, openings or fibres are missing.
    pub fn of(
        mesh: &TetMesh,
        contracting: &[i32],
        kind: ElementKind,
    ) -> Result<Self, AnatomyError> {
        let contracts: Vec<bool> = mesh
            .tags
            .iter()
            .map(|tag| contracting.contains(tag))
            .collect();
        if !contracts.contains(&true) {
            return Err(AnatomyError::NoMuscle {
                tags: contracting.to_vec(),
            });
        }
        let mut frames = vec![[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]; mesh.n_tets()];
        for e in (0..mesh.n_tets()).filter(|e| contracts[*e]) {
            let frame = mesh
                .frames
                .get(e)
                .and_then(|f| orthonormal(f.fibre, f.sheet));
            frames[e] = frame.ok_or(AnatomyError::NoFibre { element: e })?;
        }
        let triangles = |name: &'static str| {
            mesh.surface(name)
                .map(|s| s.triangles.clone())
                .ok_or(AnatomyError::NoSurface { name })
        };
        let endocardium = triangles(surface_names::ENDOCARDIUM)?;
        let openings = openings(&endocardium)?;
        if openings.is_empty() {
            return Err(AnatomyError::Closed);
        }
        let quadratic = kind
            .quadratic
            .then(|| QuadraticMesh::new(&mesh.nodes_mm, &mesh.tets, |_, _| None));
        let surface = |triangles: Vec<[u32; 3]>| match &quadratic {
            None => Triangles::Linear(triangles),
            // The edges of the mesh's triangles are edges of its elements and so have mid-edge nodes.
            Some(q) => Triangles::Quadratic(
                triangles
                    .into_iter()
                    .filter_map(|t| q.triangle(t))
                    .collect(),
            ),
        };
        let middled = |mut openings: Vec<Vec<u32>>| {
            for nodes in openings.iter_mut().filter(|_| quadratic.is_some()) {
                let middle = |a: u32, b: u32| quadratic.as_ref().and_then(|q| q.middle(a, b));
                let next = nodes.iter().skip(1).chain(nodes.first()).copied();
                *nodes = nodes
                    .iter()
                    .zip(next)
                    .flat_map(|(a, b)| [Some(*a), middle(*a, b)])
                    .flatten()
                    .collect();
            }
            openings
        };
        let openings = middled(openings);
        let septum = mesh
            .surface(surface_names::SEPTUM)
            .map(|s| surface(s.triangles.clone()));
        let (epicardium, rim) = (
            surface(triangles(surface_names::EPICARDIUM)?),
            surface(triangles(surface_names::RIM)?),
        );
        let right = match rims(mesh)? {
            None => None,
            Some(rims) => {
                let endocardium = triangles(surface_names::RIGHT_VENTRICLE)?;
                let openings = middled(cardiotwin_mesh::surface::openings(&endocardium)?);
                let (endocardium, ring, left_ring) = (
                    surface(endocardium),
                    surface(rims.right),
                    surface(rims.left),
                );
                Some(RightVentricle {
                    endocardium,
                    openings,
                    ring,
                    left_ring,
                })
            }
        };
        let further = (mesh.surfaces.iter())
            .filter(|s| !surface_names::KNOWN.contains(&s.name.as_str()))
            .map(|s| (s.name.clone(), surface(s.triangles.clone())))
            .collect();
        let endocardium = surface(endocardium);
        let (nodes, tets) = match quadratic {
            None => (mesh.nodes_mm.clone(), Tets::Linear(mesh.tets.clone())),
            Some(q) => (q.nodes, Tets::Quadratic(q.tets)),
        };
        let axis = LongAxis::of(&left_alone(mesh, contracting));
        let depth = match &mesh.fibres {
            NodeFibres::Rule { walls, .. } => walls.iter().map(|wall| wall.depth).collect(),
            _ => {
                let found = cardiotwin_mesh::fibres::depth(mesh, contracting)?;
                found
                    .into_iter()
                    .map(|depth| if depth.is_finite() { depth } else { 0.0 })
                    .collect()
            }
        };
        let (n_vertices, corners, volume) = (mesh.n_nodes(), mesh.tets.clone(), kind.volume);
        Ok(Self {
            nodes,
            n_vertices,
            tets,
            corners,
            volume,
            contracts,
            tags: mesh.tags.clone(),
            frames,
            fibres: mesh.fibres.clone(),
            depth,
            endocardium,
            epicardium,
            septum,
            rim,
            right,
            further,
            axis,
            openings,
        })
    }

    /// The nodes, elements and triangles that touch the nodes of one rank, in that rank's numbering. The anatomy is borrowed
    /// whole for a `part` without neighbours and for quadratic elements, which are never partitioned.
    #[must_use]
    pub fn part(&self, part: &Part) -> Cow<'_, Self> {
        let (Tets::Linear(tets), false) = (&self.tets, part.layout.neighbours.is_empty()) else {
            return Cow::Borrowed(self);
        };
        let of = |node: u32| part.local(node).unwrap_or(NOT_HERE);
        let elements = || part.elements.iter().map(|e| *e as usize);
        let surface = |triangles: &Triangles| match triangles {
            Triangles::Linear(t) => {
                let touched = t
                    .iter()
                    .filter(|t| t.iter().any(|node| part.owned(*node).is_some()));
                Triangles::Linear(touched.map(|t| t.map(of)).collect())
            }
            Triangles::Quadratic(_) => triangles.clone(),
        };
        let owned = |node: &u32| part.owned(*node).unwrap_or(NOT_HERE);
        Cow::Owned(Self {
            nodes: part.take(1, &self.nodes),
            n_vertices: part.nodes.len(),
            tets: Tets::Linear(elements().map(|e| tets[e].map(of)).collect()),
            corners: elements().map(|e| self.corners[e].map(of)).collect(),
            volume: self.volume,
            contracts: elements().map(|e| self.contracts[e]).collect(),
            tags: elements().map(|e| self.tags[e]).collect(),
            frames: elements().map(|e| self.frames[e]).collect(),
            fibres: self.fibres.at(part.nodes.iter().map(|node| *node as usize)),
            depth: part.take(1, &self.depth),
            endocardium: surface(&self.endocardium),
            epicardium: surface(&self.epicardium),
            septum: self.septum.as_ref().map(surface),
            rim: surface(&self.rim),
            right: self
                .right
                .as_ref()
                .map(|right| right.mapped(surface, owned)),
            further: self
                .further
                .iter()
                .map(|(name, triangles)| (name.clone(), surface(triangles)))
                .collect(),
            axis: self.axis,
            openings: self
                .openings
                .iter()
                .map(|nodes| nodes.iter().map(owned).collect())
                .collect(),
        })
    }

    /// A surface by its name in the mesh.
    #[must_use]
    pub fn surface(&self, name: &str) -> Option<&Triangles> {
        match name {
            surface_names::ENDOCARDIUM => Some(&self.endocardium),
            surface_names::EPICARDIUM => Some(&self.epicardium),
            surface_names::RIM => Some(&self.rim),
            surface_names::SEPTUM => self.septum.as_ref(),
            surface_names::RIGHT_VENTRICLE => self.right.as_ref().map(|right| &right.endocardium),
            _ => self
                .further
                .iter()
                .find(|(own, _)| own == name)
                .map(|(_, triangles)| triangles),
        }
    }

    /// Fibre frame at the point `x` \[mm\] of element `e` with the nodes at `positions`; fibres and sheets move with the
    /// tissue.
    #[must_use]
    pub fn frame_at(&self, positions: &[[f64; 3]], e: usize, x: [f64; 3]) -> Frame {
        let corners = self.corners[e];
        let edges = |nodes: &[[f64; 3]]| -> [[f64; 3]; 3] {
            let a = nodes[corners[0] as usize];
            std::array::from_fn(|k| sub(nodes[corners[k + 1] as usize], a))
        };
        let (from, to) = (edges(&self.nodes), edges(positions));
        let frame = self.imaged_frame(e, || {
            let [l1, l2, l3] = components(sub(x, positions[corners[0] as usize]), &to);
            [1.0 - l1 - l2 - l3, l1, l2, l3]
        });
        let moved = |axis: usize| -> [f64; 3] {
            let part = components(std::array::from_fn(|i| frame[i][axis]), &from);
            std::array::from_fn(|i| (0..3).map(|k| part[k] * to[k][i]).sum())
        };
        orthonormal(moved(0), moved(1)).unwrap_or(frame)
    }

    /// Fibre frame of an element in the image. Barycentric coordinates are evaluated only where directions are given at nodes.
    fn imaged_frame(&self, e: usize, l: impl FnOnce() -> [f64; 4]) -> Frame {
        if !(self.contracts[e] && self.fibres.at_nodes()) {
            return self.frames[e];
        }
        let found = self.fibres.frame(&self.corners[e], &l());
        found
            .and_then(|f| orthonormal(f.fibre, f.sheet))
            .unwrap_or(self.frames[e])
    }
}

/// Components of `d` along three edges.
fn components(d: [f64; 3], edges: &[[f64; 3]; 3]) -> [f64; 3] {
    let det = triple(edges[0], edges[1], edges[2]);
    [
        triple(d, edges[1], edges[2]) / det,
        triple(edges[0], d, edges[2]) / det,
        triple(edges[0], edges[1], d) / det,
    ]
}

fn triple(a: [f64; 3], b: [f64; 3], c: [f64; 3]) -> f64 {
    dot(a, cross(b, c))
}

/// The right-handed orthonormal frame of this fibre and of the sheet's component perpendicular to it.
fn orthonormal(fibre: [f64; 3], sheet: [f64; 3]) -> Option<Frame> {
    let unit = |a: [f64; 3]| {
        let n = norm(a);
        (n > 1e-12).then(|| a.map(|x| x / n))
    };
    let f = unit(fibre)?;
    let along = dot(sheet, f);
    let s = unit(std::array::from_fn(|i| sheet[i] - along * f[i]))?;
    let n = cross(f, s);
    Some(std::array::from_fn(|i| [f[i], s[i], n[i]]))
}
