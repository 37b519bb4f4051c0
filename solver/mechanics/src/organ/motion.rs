//! Motion of the ventricle: landmarks of a mesh, their shape at an instant, and measures of a beat.
//!
//! All landmarks are found on the mesh itself, in any orientation. The long axis points from the middle of the rim to the
//! endocardial point farthest from it, the **apex**. Rotations are counter-clockwise as seen from the apex, as in the
//! echocardiographic literature: a healthy apex turns by a positive angle, the base by a negative one, and twist (apical minus
//! basal rotation) is positive.

mod measures;

pub use measures::{Phases, Series};

use cardiotwin_linalg::vec3::{Vec3, add, axpy, cross, distance, dot, norm, reject, sub, unit};
use cardiotwin_mesh::surface::Surface;
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};

/// Heights of the apical, middle and basal short-axis levels from the endocardial apex (0) to the middle of the rim (1). The
/// basal level lies below a passive ring at the rim.
pub const LEVELS: [f64; 3] = [0.25, 0.5, 0.75];
/// Distance from a level over which a node's weight falls linearly to zero; wide enough for nodes of coarse meshes.
const HALF_WIDTH: f64 = 0.125;
/// Smallest distance of an apical node from the rim's middle, relative to the farthest node's.
const APEX: f64 = 0.98;

/// Reasons why landmarks could not be found on a mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarkError {
    /// A surface is missing or empty.
    #[error("the mesh has no surface {name:?}, on which motion is measured")]
    NoSurface {
        /// Name of the surface.
        name: &'static str,
    },
    /// No node of a surface lies near a level.
    #[error(
        "no node of the {name} lies near height {level} (apex 0, rim 1), so its motion cannot be measured"
    )]
    NoNode {
        /// Name of the surface.
        name: &'static str,
        /// Height of the level.
        level: f64,
    },
}

/// Nodes with weights whose sum is one.
#[derive(Debug, Clone, PartialEq)]
struct Patch(Vec<(u32, f64)>);

impl Patch {
    /// Normalises positive weights; `None` if no weight is positive.
    fn of(weights: impl Iterator<Item = (u32, f64)>) -> Option<Self> {
        let mut nodes: Vec<(u32, f64)> = weights.filter(|(_, w)| *w > 0.0).collect();
        let sum: f64 = nodes.iter().map(|(_, w)| w).sum();
        nodes.iter_mut().for_each(|(_, w)| *w /= sum);
        (!nodes.is_empty()).then_some(Self(nodes))
    }

    fn mean(&self, x: &[Vec3]) -> Vec3 {
        self.0
            .iter()
            .fold([0.0; 3], |sum, (node, w)| axpy(sum, *w, x[*node as usize]))
    }

    /// Mean distance from the patch's own centre, perpendicular to the axis \[mm\].
    fn radius(&self, x: &[Vec3], axis: Vec3) -> f64 {
        let middle = self.mean(x);
        self.0
            .iter()
            .map(|(node, w)| w * norm(reject(sub(x[*node as usize], middle), axis)))
            .sum()
    }

    /// Mean rotation about the axis since `begin`, about the patch's own centre and weighted by the squared radius \[degrees\].
    /// The axis is first rotated back to its initial direction.
    fn rotation_deg(
        &self,
        (begin, axis_begin): (&[Vec3], Vec3),
        (x, axis): (&[Vec3], Vec3),
    ) -> f64 {
        let (middle_begin, middle) = (self.mean(begin), self.mean(x));
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (node, w) in &self.0 {
            let from = reject(sub(begin[*node as usize], middle_begin), axis_begin);
            let to = tilted(
                reject(sub(x[*node as usize], middle), axis),
                axis,
                axis_begin,
            );
            sine += w * dot(axis_begin, cross(from, to));
            cosine += w * dot(from, to);
        }
        sine.atan2(cosine).to_degrees()
    }
}

/// Rotates `v` by the smallest rotation that takes the unit vector `from` to `to`.
fn tilted(v: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let (k, c) = (cross(from, to), dot(from, to));
    let kv = cross(k, v);
    add(v, axpy(kv, 1.0 / (1.0 + c), cross(k, kv)))
}

/// Surface patches whose motion is followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Landmarks {
    rim: Patch,
    /// Apex of the endocardium and of the epicardium.
    apex: [Patch; 2],
    /// Apical, middle and basal level of the endocardium and of the epicardium.
    levels: [[Patch; 3]; 2],
}

/// Shape of the ventricle at an instant.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Shape {
    /// Position of the rim's middle along the initial axis, positive towards the apex \[mm\].
    pub base_mm: f64,
    /// Position of the epicardial apex along the same axis \[mm\].
    pub apex_mm: f64,
    /// Distance from the endocardial apex to the middle of the rim \[mm\].
    pub cavity_length_mm: f64,
    /// Mean radii of the endocardium and epicardium at the middle level \[mm\]; their difference is the mean wall thickness.
    pub radius_mm: [f64; 2],
    /// Rotations of the apical and basal levels of the endocardium since the beginning \[degrees\].
    pub endo_rotation_deg: [f64; 2],
    /// Rotations of the same levels of the epicardium \[degrees\].
    pub epi_rotation_deg: [f64; 2],
}

impl Shape {
    /// Number of entries of [`Self::numbers`].
    pub const N: usize = 9;

    /// Mean thickness of the wall at the middle level \[mm\].
    #[must_use]
    pub fn wall_mm(&self) -> f64 {
        self.radius_mm[1] - self.radius_mm[0]
    }

    /// Twist (apical minus basal rotation) of the endocardium and of the epicardium \[degrees\].
    #[must_use]
    pub fn twist_deg(&self) -> [f64; 2] {
        [self.endo_rotation_deg, self.epi_rotation_deg].map(|[apical, basal]| apical - basal)
    }

    /// The shape as an array of numbers.
    #[must_use]
    pub fn numbers(&self) -> [f64; Self::N] {
        let ([a, b], [c, d], [e, f]) = (
            self.radius_mm,
            self.endo_rotation_deg,
            self.epi_rotation_deg,
        );
        [
            self.base_mm,
            self.apex_mm,
            self.cavity_length_mm,
            a,
            b,
            c,
            d,
            e,
            f,
        ]
    }

    /// Restores a shape from [`Self::numbers`].
    #[must_use]
    pub fn of_numbers(
        [base_mm, apex_mm, cavity_length_mm, a, b, c, d, e, f]: [f64; Self::N],
    ) -> Self {
        let (radius_mm, endo_rotation_deg, epi_rotation_deg) = ([a, b], [c, d], [e, f]);
        Self {
            base_mm,
            apex_mm,
            cavity_length_mm,
            radius_mm,
            endo_rotation_deg,
            epi_rotation_deg,
        }
    }
}

impl Landmarks {
    /// Finds the landmarks of a mesh with endocardium, epicardium and rim. The outer side is the epicardium with the septum: a
    /// surface that is open on one side is an arc, whose mean radius and rotation about its own centre mean nothing.
    ///
    /// # Errors
    /// [`LandmarkError`] where a surface is missing or a level has no node.
    pub fn of(mesh: &TetMesh) -> Result<Self, LandmarkError> {
        let x = &mesh.nodes_mm;
        let names = [surface_names::ENDOCARDIUM, surface_names::EPICARDIUM];
        let areas = |name: &'static str| {
            let outer;
            let surface = if name == surface_names::EPICARDIUM {
                outer = mesh.outer_wall();
                Some(&outer)
            } else {
                mesh.surface(name)
            };
            let areas = surface.map(|s| node_areas(mesh, s)).unwrap_or_default();
            if areas.is_empty() {
                Err(LandmarkError::NoSurface { name })
            } else {
                Ok(areas)
            }
        };
        let rim_areas = areas(surface_names::RIM)?;
        let surfaces = [areas(names[0])?, areas(names[1])?];
        let empty = |name| LandmarkError::NoSurface { name };
        let rim = Patch::of(rim_areas.into_iter()).ok_or(empty(surface_names::RIM))?;
        let base = rim.mean(x);
        let apex_of = |k: usize| {
            let far = |node: &u32| distance(x[*node as usize], base);
            let farthest = surfaces[k]
                .iter()
                .map(|(node, _)| far(node))
                .fold(0.0, f64::max);
            let at_apex = surfaces[k]
                .iter()
                .filter(|(node, _)| far(node) >= APEX * farthest)
                .copied();
            Patch::of(at_apex).ok_or(empty(names[k]))
        };
        let apex = [apex_of(0)?, apex_of(1)?];
        let long = sub(base, apex[0].mean(x));
        let height =
            |node: u32| dot(sub(x[node as usize], apex[0].mean(x)), long) / dot(long, long);
        let level = |k: usize, level: f64| {
            let weight = |area: f64, node: u32| {
                area * (1.0 - (height(node) - level).abs() / HALF_WIDTH).max(0.0)
            };
            let patch = Patch::of(
                surfaces[k]
                    .iter()
                    .map(|(node, area)| (*node, weight(*area, *node))),
            );
            patch.ok_or(LandmarkError::NoNode {
                name: names[k],
                level,
            })
        };
        let levels = |k| -> Result<[Patch; 3], LandmarkError> {
            Ok([
                level(k, LEVELS[0])?,
                level(k, LEVELS[1])?,
                level(k, LEVELS[2])?,
            ])
        };
        let levels = [levels(0)?, levels(1)?];
        Ok(Self { rim, apex, levels })
    }

    /// Unit vector from the middle of the rim to the endocardial apex, and their distance \[mm\].
    fn axis(&self, x: &[Vec3]) -> (Vec3, f64) {
        let long = sub(self.apex[0].mean(x), self.rim.mean(x));
        // A cavity of zero length has no axis; an arbitrary one serves, since nothing is measured on it.
        (unit(long).unwrap_or([0.0, 0.0, 1.0]), norm(long))
    }

    /// Shape of the ventricle with nodes at `x`; angles and the axis start from the positions `begin`. The mesh's nodes come
    /// first in both.
    #[must_use]
    pub fn shape(&self, begin: &[Vec3], x: &[Vec3]) -> Shape {
        let (axis_begin, _) = self.axis(begin);
        let (axis, cavity_length_mm) = self.axis(x);
        let rotation = |k: usize| {
            [0, 2].map(|level: usize| {
                self.levels[k][level].rotation_deg((begin, axis_begin), (x, axis))
            })
        };
        Shape {
            base_mm: dot(self.rim.mean(x), axis_begin),
            apex_mm: dot(self.apex[1].mean(x), axis_begin),
            cavity_length_mm,
            radius_mm: [0, 1].map(|k: usize| self.levels[k][1].radius(x, axis)),
            endo_rotation_deg: rotation(0),
            epi_rotation_deg: rotation(1),
        }
    }
}

/// Area of a surface assigned to each of its nodes, ascending by node.
fn node_areas(mesh: &TetMesh, surface: &Surface) -> Vec<(u32, f64)> {
    let mut areas = std::collections::BTreeMap::new();
    for triangle in &surface.triangles {
        let [a, b, c] = triangle.map(|node| mesh.nodes_mm[node as usize]);
        let third = norm(cross(sub(b, a), sub(c, a))) / 6.0;
        triangle
            .iter()
            .for_each(|node| *areas.entry(*node).or_insert(0.0) += third);
    }
    areas.into_iter().collect()
}

/// Smallest and largest ratio of an element's volume to its unloaded volume, from the elements' vertices.
#[must_use]
pub fn volume_ratios(tets: &[[u32; 4]], unloaded: &[Vec3], x: &[Vec3]) -> [f64; 2] {
    let volume = |tet: &[u32; 4], x: &[Vec3]| {
        cardiotwin_mesh::tet_mesh::volume_mm3(tet.map(|node| x[node as usize]))
    };
    tets.iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], tet| {
            let ratio = volume(tet, x) / volume(tet, unloaded);
            [least.min(ratio), most.max(ratio)]
        })
}

#[cfg(test)]
#[path = "motion/tests.rs"]
mod tests;
