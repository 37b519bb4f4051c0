//! How the ventricle moves: landmarks of a mesh, the shape that they have at an instant, and measures of a beat.
//!
//! Pure geometry: everything is found on the mesh itself, whatever way it lies in space. The long axis points from the
//! middle of the rim to the endocardial point farthest from it, towards the **apex**. Rotations are counter-clockwise as
//! seen from the apex, as the echocardiographic literature counts them: a healthy apex turns by a positive angle, the base
//! by a negative one, and twist, apical less basal rotation, is positive.

mod measures;

pub use measures::{Measures, Phases, Series};

use cardiotwin_linalg::vec3::{Vec3, add, axpy, cross, distance, dot, norm, reject, sub, unit};
use cardiotwin_mesh::tet_mesh::{TetMesh, surface_names};

/// Heights of the short-axis levels on the way from the endocardial apex (0) to the middle of the rim (1): apical, middle
/// and basal. The basal one lies below a passive ring at the rim.
pub const LEVELS: [f64; 3] = [0.25, 0.5, 0.75];
/// Nodes count for a level with a weight that falls linearly to zero at so much above and below it: coarse meshes have a
/// node in it everywhere.
const HALF_WIDTH: f64 = 0.125;
/// Nodes at least so far from the rim, over the farthest one's distance, make up the apex.
const APEX: f64 = 0.98;

/// Why a mesh has no landmarks.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LandmarkError {
    /// A surface is missing or empty.
    #[error("the mesh has no surface {name:?}, on which its motion is measured")]
    NoSurface {
        /// Which.
        name: &'static str,
    },
    /// No node of a surface lies near a level.
    #[error(
        "no node of the {name} lies near height {level} between apex, 0, and rim, 1: its motion is not measured"
    )]
    NoNode {
        /// Which surface.
        name: &'static str,
        /// Height of the level.
        level: f64,
    },
}

/// Nodes with weights whose sum is one.
#[derive(Debug, Clone, PartialEq)]
struct Patch(Vec<(u32, f64)>);

impl Patch {
    /// Of nodes with any positive weights; none where there are none.
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

    /// Mean distance from the patch's own middle across the axis.
    fn radius(&self, x: &[Vec3], axis: Vec3) -> f64 {
        let middle = self.mean(x);
        self.0
            .iter()
            .map(|(node, w)| w * norm(reject(sub(x[*node as usize], middle), axis)))
            .sum()
    }

    /// Mean rotation around the axis since `begin` about the patch's own middle, weighted by the square of the radius,
    /// degrees. The axis is tilted back before angles are taken.
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

/// `v` after the smallest rotation that takes the unit vector `from` to `to`.
fn tilted(v: Vec3, from: Vec3, to: Vec3) -> Vec3 {
    let (k, c) = (cross(from, to), dot(from, to));
    let kv = cross(k, v);
    add(v, axpy(kv, 1.0 / (1.0 + c), cross(k, kv)))
}

/// Parts of a mesh whose motion is followed.
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
    /// Middle of the rim along the axis at the beginning, towards the apex \[mm\].
    pub base_mm: f64,
    /// Epicardial apex along the same axis \[mm\].
    pub apex_mm: f64,
    /// Endocardial apex to the middle of the rim \[mm\].
    pub cavity_length_mm: f64,
    /// Mean radius of the endocardium and of the epicardium at the middle level \[mm\]; their difference is the mean wall
    /// thickness there.
    pub radius_mm: [f64; 2],
    /// Rotation of the apical and the basal level of the endocardium since the beginning, degrees.
    pub endo_rotation_deg: [f64; 2],
    /// The same of the epicardium.
    pub epi_rotation_deg: [f64; 2],
}

impl Shape {
    /// How many numbers it is.
    pub const N: usize = 9;

    /// Mean thickness of the wall at the middle level \[mm\].
    #[must_use]
    pub fn wall_mm(&self) -> f64 {
        self.radius_mm[1] - self.radius_mm[0]
    }

    /// Apical less basal rotation of the endocardium and of the epicardium, degrees.
    #[must_use]
    pub fn twist_deg(&self) -> [f64; 2] {
        [self.endo_rotation_deg, self.epi_rotation_deg].map(|[apical, basal]| apical - basal)
    }

    /// As numbers.
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

    /// From [`Self::numbers`].
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
    /// Of a mesh with endocardium, epicardium and rim.
    ///
    /// # Errors
    /// [`LandmarkError`] where a surface is missing or a level has no node.
    pub fn of(mesh: &TetMesh) -> Result<Self, LandmarkError> {
        let x = &mesh.nodes_mm;
        let names = [surface_names::ENDOCARDIUM, surface_names::EPICARDIUM];
        let areas = |name: &'static str| {
            let areas = node_areas(mesh, name);
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

    /// From the middle of the rim to the endocardial apex, and the distance.
    fn axis(&self, x: &[Vec3]) -> (Vec3, f64) {
        let long = sub(self.apex[0].mean(x), self.rim.mean(x));
        // A cavity without length has no axis: any will do, since nothing is measured on it.
        (unit(long).unwrap_or([0.0, 0.0, 1.0]), norm(long))
    }

    /// Shape of nodes that lie at `x` and lay at `begin` where angles and the axis begin; the mesh's nodes come first in both.
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

/// Area that belongs to each node of a surface, in the order of the nodes; empty where there is no such surface.
fn node_areas(mesh: &TetMesh, name: &str) -> Vec<(u32, f64)> {
    let mut areas = std::collections::BTreeMap::new();
    for triangle in mesh
        .surface(name)
        .iter()
        .flat_map(|surface| &surface.triangles)
    {
        let [a, b, c] = triangle.map(|node| mesh.nodes_mm[node as usize]);
        let third = norm(cross(sub(b, a), sub(c, a))) / 6.0;
        triangle
            .iter()
            .for_each(|node| *areas.entry(*node).or_insert(0.0) += third);
    }
    areas.into_iter().collect()
}

/// Smallest and largest volume of an element over its unloaded one, each element singly, from the elements' corners.
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
