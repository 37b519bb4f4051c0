//! A matrix after condensation of scalar unknowns: a sparse stiffness plus a product of sparse
//! matrices.

use crate::parallel::VectorLayout;
use crate::{BlockCsr, Coupling, Operator};

/// `K + G D Gᵀ`. `K` has the pattern of a mesh, `G` couples its nodes to eliminated scalar
/// unknowns, and `D` is diagonal. The product is never formed, because its rows would reach two
/// rings of neighbours.
///
/// In elasticity with nodal volume changes, `G` is the derivative of the vertices' volumes, and `D`
/// their bulk stiffness.
#[derive(Debug, Clone)]
pub struct CondensedMatrix {
    /// Stiffness `K`, a block for each pair of nodes.
    pub stiffness: BlockCsr,
    /// Coupling `G`; `None` if no scalar unknowns were eliminated.
    pub coupling: Option<Coupling>,
    /// Diagonal of `D`, with one value for each scalar unknown.
    pub bulk: Vec<f64>,
}

impl Operator for CondensedMatrix {
    fn n_rows(&self) -> usize {
        self.stiffness.pattern.n_rows()
    }

    /// # Panics
    /// If there is a coupling on several ranks: a rank holds `G` by rows and lacks the ghosts'
    /// contributions to `Gᵀ x`.
    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f64], y: &mut [f64]) {
        assert!(
            self.coupling.is_none() || space.layout.neighbours.is_empty(),
            "scalar unknowns on several ranks"
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

impl CondensedMatrix {
    /// A block of `K` in single precision, as an array of rows.
    #[must_use]
    pub fn stiffness_block(&self, slot: usize) -> [[f32; 3]; 3] {
        let b = &self.stiffness.blocks[slot];
        std::array::from_fn(|i| std::array::from_fn(|j| b[3 * i + j] as f32))
    }
}
