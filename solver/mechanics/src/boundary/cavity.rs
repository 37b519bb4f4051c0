//! The cavity: its volume with flat caps over the openings, and the load of its pressure on wall and valve plane.

use cardiotwin_linalg::Pattern;
use cardiotwin_linalg::parallel::Communicator;
use cardiotwin_linalg::vec3::{cross, dot, norm, sub};
use serde::{Deserialize, Serialize};

use super::SurfaceError;
use super::pressure::{Faces, PressureSurface};
use crate::linear::Assembled;

/// Marks a node of an opening's loop that another rank owns.
pub const NOT_HERE: u32 = u32::MAX;

/// Support of the pressure on the caps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ValvePlane {
    /// Pressure acts on the endocardium alone, as in the benchmarks.
    Open,
    /// The rim bears the pressure evenly over its reference area, as closed valves pull on their ring. The cavity's load then
    /// has no resultant, and the heart needs no support against it.
    HangsOnRim,
}

/// An endocardium whose openings are closed by triangle fans around the mean of their nodes.
#[derive(Debug, Clone)]
pub struct Cavity {
    wall: PressureSurface,
    /// Node loops around the openings in the direction of the surface's edges, equal on all ranks up to [`NOT_HERE`].
    openings: Vec<Vec<u32>>,
    /// Share of the caps' load on each rim node.
    rim: Vec<(u32, f64)>,
    /// Whether a rim carries the caps' load, on this rank or another.
    hangs: bool,
}

impl Cavity {
    /// A cavity inside `endocardium`, triangles of three or six nodes with normals out of the tissue. Each rank passes the
    /// triangles that touch its owned nodes. Collective.
    ///
    /// - `openings`: closed node loops in the direction of the triangles' edges, mid-edge nodes included, or [`NOT_HERE`]
    /// - `rim`: triangles that bear the caps' load; empty for [`ValvePlane::Open`]
    ///
    /// # Errors
    /// [`SurfaceError`] for triangles that have another number of nodes or do not belong to the body.
    pub fn new<const N: usize>(
        endocardium: &[[u32; N]],
        openings: Vec<Vec<u32>>,
        rim: &[[u32; N]],
        reference: &[f64],
        pattern: &Pattern,
        comm: &dyn Communicator,
    ) -> Result<Self, SurfaceError> {
        let faces = Faces::new(rim, pattern)?;
        let mut shares = std::collections::BTreeMap::<u32, f64>::new();
        let mut area = [0.0];
        for nodes in faces.nodes.chunks(N) {
            let x = Faces::positions(nodes, reference, &[]);
            let share = faces.share(nodes);
            for (weight, shape) in &faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let da = 0.5 * weight * norm(cross(e1, e2));
                area[0] += share * da;
                for (node, (value, _)) in nodes.iter().zip(shape) {
                    *shares.entry(*node).or_default() += value * da;
                }
            }
        }
        comm.sum(&mut area);
        let rim = shares
            .into_iter()
            .map(|(node, share)| (node, share / area[0]))
            .collect();
        let hangs = area[0] > 0.0;
        Ok(Self {
            wall: PressureSurface::new(endocardium, pattern)?,
            openings,
            rim,
            hangs,
        })
    }

    /// Positions of the openings' nodes, on all ranks. Collective.
    fn loops(
        &self,
        comm: &dyn Communicator,
        reference: &[f64],
        displacement: &[f64],
    ) -> Vec<Vec<[f64; 3]>> {
        let at = |node: &u32| {
            if *node == NOT_HERE {
                [0.0; 3]
            } else {
                position(reference, displacement, *node)
            }
        };
        let mut all: Vec<[f64; 3]> = self.openings.iter().flatten().map(at).collect();
        comm.sum(all.as_flattened_mut());
        let mut rest = &all[..];
        let mut next = |nodes: &Vec<u32>| {
            let (own, others) = rest.split_at(nodes.len());
            rest = others;
            own.to_vec()
        };
        self.openings.iter().map(&mut next).collect()
    }

    /// Volume \[mm³\] at `displacement`. Collective.
    #[must_use]
    pub fn volume(&self, comm: &dyn Communicator, reference: &[f64], displacement: &[f64]) -> f64 {
        let loops = self.loops(comm, reference, displacement);
        let origin = origin(&loops);
        let mut volume = [self.wall.volume(origin, reference, displacement)];
        comm.sum(&mut volume);
        for nodes in loops.iter().skip(1) {
            let centre = mean(nodes);
            for (a, b) in edges(nodes) {
                // The cap runs against the loop's direction, which orients it like the endocardium.
                let (p, q, r) = (sub(*b, origin), sub(*a, origin), sub(centre, origin));
                volume[0] -= dot(p, cross(q, r)) / 6.0;
            }
        }
        volume[0]
    }

    /// Adds `scale` times the volume's gradient \[mm²\]; complete on owned nodes only. Collective.
    pub fn add_volume_gradient(
        &self,
        comm: &dyn Communicator,
        scale: f64,
        reference: &[f64],
        displacement: &[f64],
        out: &mut [f64],
    ) {
        let loops = self.loops(comm, reference, displacement);
        let origin = origin(&loops);
        let mut of_origin = [0.0; 3];
        let mut add = |node: u32, g: [f64; 3]| {
            if node != NOT_HERE {
                for i in 0..3 {
                    out[3 * node as usize + i] += scale * g[i];
                }
            }
        };
        let faces = self.wall.faces();
        for nodes in faces.nodes.chunks(faces.n_nodes) {
            let x = Faces::positions(nodes, reference, displacement);
            let share = faces.share(nodes);
            for (weight, shape) in &faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let n = cross(e1, e2);
                let r: [f64; 3] = std::array::from_fn(|i| {
                    shape.iter().zip(&x).map(|(s, x)| s.0 * x[i]).sum::<f64>() - origin[i]
                });
                let (g1, g2) = (cross(e2, r), cross(r, e1));
                let k = -weight / 6.0;
                for (&node, (value, slope)) in nodes.iter().zip(shape) {
                    add(
                        node,
                        std::array::from_fn(|i| {
                            k * (value * n[i] + slope[0] * g1[i] + slope[1] * g2[i])
                        }),
                    );
                }
                (0..3).for_each(|i| of_origin[i] -= share * (k * n[i]));
            }
        }
        comm.sum(&mut of_origin);
        for (places, nodes) in self.openings.iter().zip(&loops).skip(1) {
            let centre = mean(nodes);
            let mut of_centre = [0.0; 3];
            for ((a, b), (at_a, at_b)) in edges(places).zip(edges(nodes)) {
                let (p, q, r) = (sub(*at_b, origin), sub(*at_a, origin), sub(centre, origin));
                let g = [cross(q, r), cross(r, p), cross(p, q)].map(|g| g.map(|g| -g / 6.0));
                add(*b, g[0]);
                add(*a, g[1]);
                for i in 0..3 {
                    of_centre[i] += g[2][i];
                    of_origin[i] -= g[0][i] + g[1][i] + g[2][i];
                }
            }
            for &node in places {
                add(node, of_centre.map(|g| g / nodes.len() as f64));
            }
        }
        if let Some(nodes) = self.openings.first() {
            for &node in nodes {
                add(node, of_origin.map(|g| g / nodes.len() as f64));
            }
        }
    }

    /// Subtracts the force \[mN\] of `pressure` \[kPa\] on the wall, and on the rim if it bears the caps; complete on owned
    /// nodes only. Collective.
    pub fn add_forces(
        &self,
        comm: &dyn Communicator,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        force: &mut [f64],
    ) {
        self.wall
            .add_forces(pressure, reference, displacement, force);
        if !self.hangs {
            return;
        }
        let mut resultant = self.wall.resultant(reference, displacement);
        comm.sum(&mut resultant);
        for (node, share) in &self.rim {
            for i in 0..3 {
                force[3 * *node as usize + i] -= pressure * share * resultant[i];
            }
        }
    }

    /// Adds the symmetric part of the wall's share of [`Self::add_forces`]'s derivative \[mN/mm\]. The omitted terms, the
    /// change of the caps' area and an unsymmetric part at the openings' edges, are of the order of the rim's load.
    pub fn add_tangent(
        &self,
        pressure: f64,
        reference: &[f64],
        displacement: &[f64],
        tangent: &mut dyn Assembled,
    ) {
        self.wall
            .add_symmetric_tangent(pressure, reference, displacement, tangent);
    }
}

/// The mean of the first opening's nodes; the origin for a closed surface.
fn origin(loops: &[Vec<[f64; 3]>]) -> [f64; 3] {
    loops.first().map_or([0.0; 3], |nodes| mean(nodes))
}

fn edges<T>(nodes: &[T]) -> impl Iterator<Item = (&T, &T)> {
    nodes.iter().zip(nodes.iter().cycle().skip(1))
}

fn position(reference: &[f64], displacement: &[f64], node: u32) -> [f64; 3] {
    let k = 3 * node as usize;
    std::array::from_fn(|i| reference[k + i] + displacement[k + i])
}

fn mean(nodes: &[[f64; 3]]) -> [f64; 3] {
    let mut sum = [0.0; 3];
    for x in nodes {
        (0..3).for_each(|i| sum[i] += x[i] / nodes.len() as f64);
    }
    sum
}

#[cfg(test)]
mod tests;
