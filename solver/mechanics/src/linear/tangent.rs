//! The derivative of a body's forces: a sparse stiffness, and the nodal volume change as a product of sparse matrices.

use super::assembled::{Assembled, Operator, Sink};
use super::{BlockCsr, Coupling, NO_SLOT, Pattern};
use crate::parallel::Space;

/// `K + G D Gᵀ`: `K` by elements; `G` the derivative of the vertices' volumes, `D` their bulk stiffness. The product is
/// never formed: its rows would reach two rings of neighbours.
#[derive(Debug, Clone)]
pub struct Tangent {
    /// `K`.
    pub stiffness: BlockCsr,
    /// `G`, where volume change is resisted by nodal averages.
    pub coupling: Option<Coupling>,
    /// `D` \[kPa/mm³\], one a vertex.
    pub bulk: Vec<f64>,
}

impl Operator for Tangent {
    /// # Panics
    /// With nodal volume changes on several ranks: a rank holds `G` by rows, and lacks of `Gᵀ x` what ghosts add to it.
    /// [`super::PackedTangent`] holds both.
    fn multiply(&self, space: Space<'_>, x: &mut [f64], y: &mut [f64]) {
        assert!(
            self.coupling.is_none() || space.layout.neighbours.is_empty(),
            "nodal volume changes on several ranks"
        );
        space.update(x);
        self.stiffness.multiply(x, y);
        if let Some(coupling) = &self.coupling {
            let mut p = vec![0.0; self.bulk.len()];
            coupling.multiply_transposed(x, &mut p);
            for (p, d) in p.iter_mut().zip(&self.bulk) {
                *p *= d;
            }
            coupling.add_product(&p, y);
        }
    }

    fn diagonal(&self, row: usize) -> [f64; 9] {
        let mut block = self.stiffness.diagonal(row);
        if let Some(coupling) = &self.coupling {
            for k in coupling.pattern.row(row) {
                let (g, d) = (
                    &coupling.blocks[k],
                    self.bulk[coupling.pattern.column[k] as usize],
                );
                for i in 0..3 {
                    for j in 0..3 {
                        block[3 * i + j] += d * g[i] * g[j];
                    }
                }
            }
        }
        block
    }
}

impl Assembled for Tangent {
    fn pattern(&self) -> &Pattern {
        &self.stiffness.pattern
    }

    fn clear(&mut self, bulk: &[f64]) {
        self.stiffness.blocks.fill([0.0; 9]);
        if let Some(coupling) = &mut self.coupling {
            coupling.blocks.fill([0.0; 3]);
        }
        self.bulk.copy_from_slice(bulk);
    }

    fn vertex_volumes(&self, space: Space<'_>, x: &mut [f64]) -> Vec<f64> {
        space.update(x);
        let mut p = vec![0.0; self.bulk.len()];
        if let Some(coupling) = &self.coupling {
            coupling.multiply_transposed(x, &mut p);
            if p.len() == space.layout.n_local {
                space.comm.update_ghosts(space.layout, 1, &mut p);
            }
        }
        p
    }

    fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3] {
        let b = &self.stiffness.blocks[slot];
        std::array::from_fn(|i| std::array::from_fn(|j| b[3 * i + j] as f32))
    }

    fn sink(&mut self) -> Sink<'_> {
        Sink::Full(self)
    }

    fn scale(&mut self, k: f64) {
        if k != 1.0 {
            self.stiffness
                .blocks
                .as_flattened_mut()
                .iter_mut()
                .for_each(|b| *b *= k);
            self.bulk.iter_mut().for_each(|d| *d *= k);
        }
    }

    fn mean_diagonal(&self, space: Space<'_>) -> f64 {
        let n = self.stiffness.pattern.n_rows();
        let mut sums = [0.0, n as f64];
        for row in 0..n {
            let d = self.stiffness.diagonal(row);
            sums[0] += (d[0].abs() + d[4].abs() + d[8].abs()) / 3.0;
        }
        space.comm.sum(&mut sums);
        (sums[0] / sums[1].max(1.0)).max(f64::MIN_POSITIVE)
    }

    fn constrain(&mut self, fixed: &[[bool; 3]], scale: f64) {
        let pattern = self.stiffness.pattern.clone();
        for row in 0..pattern.n_rows() {
            for k in pattern.row(row) {
                let column = pattern.column[k] as usize;
                let (fr, fc) = (fixed[row], fixed[column]);
                if !fr.contains(&true) && !fc.contains(&true) {
                    continue;
                }
                let block = &mut self.stiffness.blocks[k];
                for i in 0..3 {
                    for j in 0..3 {
                        if fr[i] || fc[j] {
                            block[3 * i + j] = if row == column && i == j { scale } else { 0.0 };
                        }
                    }
                }
            }
        }
        if let Some(coupling) = &mut self.coupling {
            for row in (0..pattern.n_rows()).filter(|r| fixed[*r].contains(&true)) {
                for k in coupling.pattern.row(row) {
                    for i in 0..3 {
                        if fixed[row][i] {
                            coupling.blocks[k][i] = 0.0;
                        }
                    }
                }
            }
        }
    }

    fn add_block(&mut self, slot: u32, block: &[f64; 9]) {
        if slot != NO_SLOT {
            for (to, from) in self.stiffness.blocks[slot as usize].iter_mut().zip(block) {
                *to += from;
            }
        }
    }
}
