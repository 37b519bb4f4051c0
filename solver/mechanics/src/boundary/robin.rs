//! Springs and dashpots between a surface and a fixed frame, with constant matrices.

use cardiotwin_linalg::Pattern;
use cardiotwin_linalg::vec3::{cross, norm};
use serde::Deserialize;

use super::SurfaceError;
use super::pressure::Faces;
use crate::linear::Assembled;

/// Displacement components that a support resists.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RobinDirection {
    /// Along the reference normal, as for the pericardium.
    Normal,
    /// In all directions, as for the basal rim.
    All,
}

/// `∫ k Nₐ N_b (N⊗N or I) dA` over a surface of the reference configuration, for `k` = 1 kPa/mm.
#[derive(Debug, Clone)]
pub struct Robin {
    entries: Vec<Entry>,
}

#[derive(Debug, Clone)]
struct Entry {
    row: u32,
    column: u32,
    slot: u32,
    block: [f64; 9],
}

impl Robin {
    /// Integrates over `triangles` of three or six nodes with coordinates `reference`.
    ///
    /// # Errors
    /// [`SurfaceError`] for a triangle with another number of nodes, or one that is not a face of the body.
    pub fn new<const N: usize>(
        triangles: &[[u32; N]],
        direction: RobinDirection,
        reference: &[f64],
        pattern: &Pattern,
    ) -> Result<Self, SurfaceError> {
        Self::weighted(triangles, direction, reference, pattern, &|_| 1.0)
    }

    /// As [`Self::new`], with a stiffness that varies over the surface.
    ///
    /// - `share`: relative stiffness at a point of the reference surface \[mm\]
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn weighted<const N: usize>(
        triangles: &[[u32; N]],
        direction: RobinDirection,
        reference: &[f64],
        pattern: &Pattern,
        share: &dyn Fn([f64; 3]) -> f64,
    ) -> Result<Self, SurfaceError> {
        let faces = Faces::new(triangles, pattern)?;
        let mut entries = vec![];
        for (nodes, slots) in faces.nodes.chunks(N).zip(faces.slots.chunks(N * N)) {
            let x = Faces::positions(nodes, reference, &[]);
            let mut blocks = vec![[0.0; 9]; N * N];
            for (weight, shape) in &faces.points {
                let [e1, e2] = Faces::tangents(shape, &x);
                let normal = cross(e1, e2);
                let length = norm(normal);
                let at =
                    std::array::from_fn(|i| shape.iter().zip(&x).map(|(s, x)| s.0 * x[i]).sum());
                let share = share(at);
                for a in 0..N {
                    for b in 0..N {
                        let k = 0.5 * share * weight * length * shape[a].0 * shape[b].0;
                        for i in 0..3 {
                            for j in 0..3 {
                                blocks[a * N + b][3 * i + j] += k * match direction {
                                    RobinDirection::Normal => {
                                        normal[i] * normal[j] / (length * length)
                                    }
                                    RobinDirection::All => f64::from(u8::from(i == j)),
                                };
                            }
                        }
                    }
                }
            }
            for a in 0..N {
                for b in 0..N {
                    let slot = slots[a * N + b];
                    entries.push(Entry {
                        row: nodes[a],
                        column: nodes[b],
                        slot,
                        block: blocks[a * N + b],
                    });
                }
            }
        }
        entries.sort_by_key(|e| (e.row, e.column));
        entries.dedup_by(|next, kept| {
            let same = (next.row, next.column) == (kept.row, kept.column);
            if same {
                kept.block
                    .iter_mut()
                    .zip(next.block)
                    .for_each(|(k, n)| *k += n);
            }
            same
        });
        Ok(Self { entries })
    }

    /// Adds `k A u` \[mN\] to `force` for `k` in kPa/mm; with a velocity and `k` in kPa·ms/mm, the force of a dashpot.
    pub fn add_forces(&self, k: f64, displacement: &[f64], force: &mut [f64]) {
        for e in &self.entries {
            for i in 0..3 {
                if let Some(f) = force.get_mut(3 * e.row as usize + i) {
                    for j in 0..3 {
                        *f += k * e.block[3 * i + j] * displacement[3 * e.column as usize + j];
                    }
                }
            }
        }
    }

    /// Adds `k A` to `tangent`.
    pub fn add_tangent(&self, k: f64, tangent: &mut dyn Assembled) {
        for e in &self.entries {
            tangent.add_block(e.slot, &e.block.map(|b| k * b));
        }
    }
}
