//! The tangent of linear elements in single precision, laid out for one pass over memory.
//!
//! Newton's method takes its residual in double precision, so that a tangent off by 1e-7 costs nothing; a product with it reads
//! half as much. Each entry holds, column by column, a 3×3 block of `K` with the derivative of the row's vertex volume below it,
//! `[K; gᵀ]`, so that one pass gives both `K x` and `Gᵀ x`. Entries of `G`, for `y += G D (Gᵀ x)`, lie by themselves: the second pass
//! reads a quarter of what the first one does.

use std::sync::Arc;

use cardiotwin_linalg::parallel::VectorLayout;
use cardiotwin_linalg::{Operator, Pattern, prefetch};
use pulp::{Arch, Simd, WithSimd};

/// Three columns of `[K; gᵀ]`.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(16))]
pub struct PackedBlock(pub [[f32; 4]; 3]);

/// An entry of `G`: three numbers and a zero.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(16))]
pub struct PackedVolume(pub [f32; 4]);

/// `K + G D Gᵀ` in single precision, where every node is a vertex: rows and columns of all three are nodes.
#[derive(Debug, Clone)]
pub struct PackedTangent {
    pub(super) pattern: Arc<Pattern>,
    pub(super) blocks: Vec<PackedBlock>,
    /// Entries of `G`, one a block.
    pub(super) volumes: Vec<PackedVolume>,
    /// `D` \[kPa/mm³\], one a vertex; empty without nodal volume change.
    pub(super) bulk: Vec<f64>,
    pub(super) arch: Arch,
}

impl PackedTangent {
    /// A tangent of zeros with the entries of `pattern`.
    #[must_use]
    pub fn zeros(pattern: Arc<Pattern>) -> Self {
        let blocks = vec![PackedBlock([[0.0; 4]; 3]); pattern.column.len()];
        let volumes = vec![PackedVolume([0.0; 4]); pattern.column.len()];
        Self {
            pattern,
            blocks,
            volumes,
            bulk: vec![],
            arch: Arch::new(),
        }
    }

    /// Blocks and entries of `G`, for assembly.
    pub fn entries_mut(&mut self) -> (&mut [PackedBlock], &mut [PackedVolume]) {
        (&mut self.blocks, &mut self.volumes)
    }
}

/// `y = K x`, `p = Gᵀ x`.
pub(super) struct Rows<'a>(
    pub(super) &'a PackedTangent,
    pub(super) &'a [[f64; 3]],
    pub(super) &'a mut [[f64; 3]],
    pub(super) &'a mut [f64],
);

impl WithSimd for Rows<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self(matrix, x, y, p) = self;
        let starts = &matrix.pattern.row_start;
        for (row, (y, p)) in y.iter_mut().zip(p).enumerate() {
            let range = starts[row] as usize..starts[row + 1] as usize;
            prefetch(&matrix.blocks, &range);
            let mut sum = [0.0_f64; 4];
            for (PackedBlock(block), column) in matrix.blocks[range.clone()]
                .iter()
                .zip(&matrix.pattern.column[range])
            {
                let v = &x[*column as usize];
                for i in 0..4 {
                    sum[i] += f64::from(block[0][i]) * v[0]
                        + f64::from(block[1][i]) * v[1]
                        + f64::from(block[2][i]) * v[2];
                }
            }
            *y = [sum[0], sum[1], sum[2]];
            *p = sum[3];
        }
    }
}

/// `y += G p`.
struct Pressures<'a>(&'a PackedTangent, &'a [f64], &'a mut [[f64; 3]]);

impl WithSimd for Pressures<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        let Self(matrix, p, y) = self;
        let starts = &matrix.pattern.row_start;
        for (row, y) in y.iter_mut().enumerate() {
            let range = starts[row] as usize..starts[row + 1] as usize;
            prefetch(&matrix.volumes, &range);
            let mut sum = [0.0_f64; 4];
            for (PackedVolume(g), column) in matrix.volumes[range.clone()]
                .iter()
                .zip(&matrix.pattern.column[range])
            {
                let p = p[*column as usize];
                for i in 0..4 {
                    sum[i] += f64::from(g[i]) * p;
                }
            }
            for i in 0..3 {
                y[i] += sum[i];
            }
        }
    }
}

impl Operator for PackedTangent {
    fn n_rows(&self) -> usize {
        self.pattern.n_rows()
    }

    fn multiply(&self, space: VectorLayout<'_>, x: &mut [f64], y: &mut [f64]) {
        space.update(x);
        let n = self.pattern.n_rows();
        let (x, y) = (x.as_chunks::<3>().0, &mut y.as_chunks_mut::<3>().0[..n]);
        let mut p = vec![0.0; n.max(self.bulk.len())];
        self.arch.dispatch(Rows(self, x, y, &mut p[..n]));
        if self.bulk.is_empty() {
            return;
        }
        for (p, d) in p.iter_mut().zip(&self.bulk) {
            *p *= d;
        }
        space.comm.update_ghosts(space.layout, 1, &mut p);
        self.arch.dispatch(Pressures(self, &p, y));
    }

    fn diagonal(&self, row: usize) -> [f64; 9] {
        diagonal(
            &self.pattern,
            row,
            |slot, i, j| f64::from(self.blocks[slot].0[j][i]),
            |slot, i| f64::from(self.volumes[slot].0[i]),
            |vertex| self.bulk.get(vertex).copied().unwrap_or(0.0),
        )
    }
}

/// Diagonal block of a row of `K + G D Gᵀ`, from the entries of `K` (slot, row and column in the block), of `G` (slot and row)
/// and of `D` (vertex).
pub(super) fn diagonal(
    pattern: &Pattern,
    row: usize,
    stiffness: impl Fn(usize, usize, usize) -> f64,
    volume: impl Fn(usize, usize) -> f64,
    bulk: impl Fn(usize) -> f64,
) -> [f64; 9] {
    let mut out = [0.0; 9];
    for slot in pattern.row(row) {
        let column = pattern.column[slot] as usize;
        let d = bulk(column);
        for i in 0..3 {
            for j in 0..3 {
                out[3 * i + j] += d * volume(slot, i) * volume(slot, j);
                if column == row {
                    out[3 * i + j] += stiffness(slot, i, j);
                }
            }
        }
    }
    out
}
