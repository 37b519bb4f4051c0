//! Algebraic multigrid for elasticity, by smoothed aggregation with rigid motions.
//!
//! This preconditioner is for static problems, in which the effect of one node extends through the
//! whole body and a Jacobi preconditioner takes thousands of iterations. It is built from the
//! stiffness `K` alone, without the product `G D Gᵀ` of a [`crate::CondensedMatrix`]. If a share of
//! the bulk modulus is pointwise, `K` and the whole tangent are spectrally equivalent within a
//! factor of the inverse of that share, which the conjugate gradients on the whole tangent can
//! handle; and `K` has the narrow stencil that aggregation needs.
//!
//! Every level is distributed over the ranks like the first one, and groups of nodes end at the
//! border of a rank. The coarsest level is factorised on each rank.
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

/// A V-cycle for a stiffness; later changes of the stiffness have no effect.
#[derive(Debug)]
pub struct Multigrid {
    fine: Level<4, 3>,
    coarse: Coarse,
}

impl Multigrid {
    /// Builds the levels. Collective.
    ///
    /// - `pattern`, `block`: the stiffness, with the 3×3 block of each entry as an array of rows
    /// - `points`: current positions of the nodes, including ghosts, three numbers each
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

    /// Number of rows of each level, finest first: those of this rank, or all of them for the
    /// factorised level.
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
        // Scaled to a maximum of one, so that no value is too small for single precision.
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
