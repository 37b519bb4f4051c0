//! Algebraic multigrid for elasticity: smoothed aggregation with rigid motions.
//!
//! A preconditioner for static problems, where what one node feels reaches through the whole body and Jacobi's method
//! takes thousands of iterations. It is made of the stiffness `K` alone, without the product `G D Gᵀ` of a
//! [`crate::CondensedMatrix`]: with a share of the bulk modulus pointwise, `K` is spectrally within a factor of the inverse of that share, which conjugate
//! gradients on the whole tangent bridge, and has the narrow stencil that aggregation needs.
//!
//! Every level is spread over the ranks like the first; groups of nodes end at the border of a rank. The coarsest is factorised on
//! each of them.
//!
//! Source: Vaněk, Mandel and Brezina 1996, Computing 56:179.

mod aggregates;
mod blocks;
mod coarsen;
mod halo;
mod level;

use self::blocks::Blocks;
use self::level::{Coarse, Level};
use crate::parallel::VectorLayout;
use crate::{Pattern, Preconditioner};

/// One V-cycle on a stiffness, as it was when this was made.
#[derive(Debug)]
pub struct Multigrid {
    fine: Level<4, 3>,
    coarse: Coarse,
}

impl Multigrid {
    /// Builds the levels. Collective.
    ///
    /// - `pattern`, `block`: the stiffness, with the 3×3 block of each entry, row-major
    /// - `points`: where the nodes are now, ghosts included, three numbers each
    #[must_use]
    pub fn new(
        space: VectorLayout<'_>,
        pattern: &Pattern,
        block: &dyn Fn(usize) -> [[f32; 3]; 3],
        points: &[f64],
    ) -> Self {
        let padded = |slot: usize| {
            let block = block(slot);
            std::array::from_fn(|j| [block[0][j], block[1][j], block[2][j], 0.0])
        };
        let blocks = (0..pattern.column.len()).map(padded).collect();
        let matrix = Blocks {
            pattern: Pattern::clone(pattern),
            blocks,
        };
        let rigid = |place: &[f64; 3], centre: &[f64; 3], per_mm: f64| {
            let [x, y, z]: [f32; 3] =
                std::array::from_fn(|i| ((place[i] - centre[i]) * per_mm) as f32);
            [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, -z, y, 0.0],
                [z, 0.0, -x, 0.0],
                [-y, x, 0.0, 0.0],
            ]
        };
        let (fine, coarse) = Level::new(
            space.comm,
            space.layout,
            matrix,
            points.as_chunks::<3>().0,
            &rigid,
        );
        Self { fine, coarse }
    }

    /// Rows of the levels, finest first: this rank's, of the factorised one all.
    #[must_use]
    pub fn sizes(&self) -> Vec<usize> {
        let mut sizes = vec![3 * self.fine.n()];
        self.coarse.sizes(&mut sizes);
        sizes
    }
}

impl Preconditioner for Multigrid {
    fn apply(&self, space: VectorLayout<'_>, r: &[f64], z: &mut [f64]) {
        let n = 3 * self.fine.n();
        // Scaled to one, so that nothing is too small for single precision.
        let mut largest = [r[..n].iter().fold(0.0_f64, |m, r| m.max(r.abs()))];
        space.comm.max(&mut largest);
        let scale = if largest[0] > 0.0 {
            1.0 / largest[0]
        } else {
            1.0
        };
        let single = |r: f64| (scale * r) as f32;
        let right: Vec<[f32; 4]> = r[..n]
            .as_chunks::<3>()
            .0
            .iter()
            .map(|r| [single(r[0]), single(r[1]), single(r[2]), 0.0])
            .collect();
        let solution = self.fine.cycle(space.comm, &right, &self.coarse);
        for (z, s) in z[..n].as_chunks_mut::<3>().0.iter_mut().zip(&solution) {
            *z = [s[0], s[1], s[2]].map(|s| f64::from(s) / scale);
        }
    }
}
