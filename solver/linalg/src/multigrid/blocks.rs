//! Sparse matrices of small dense blocks in single precision: the levels' matrices and the
//! prolongations between levels.

use crate::Pattern;
use crate::prefetch;

/// A dense block of `C` columns with `W` numbers each, the last of which may be zero padding.
pub(super) type Block<const W: usize, const C: usize> = [[f32; W]; C];

/// Blocks on a pattern, with columns padded to the width of vector registers.
#[derive(Debug, Clone)]
pub(super) struct Blocks<const W: usize, const C: usize> {
    pub(super) pattern: Pattern,
    pub(super) blocks: Vec<Block<W, C>>,
}

impl<const W: usize, const C: usize> Blocks<W, C> {
    /// A matrix without rows.
    pub(super) fn empty() -> Self {
        Self {
            pattern: Pattern {
                row_start: vec![0],
                column: vec![],
            },
            blocks: vec![],
        }
    }

    /// A matrix without rows, with capacity for `n_rows` rows and `n_blocks` blocks.
    pub(super) fn with_capacity(n_rows: usize, n_blocks: usize) -> Self {
        let mut row_start = Vec::with_capacity(n_rows + 1);
        row_start.push(0);
        Self {
            pattern: Pattern {
                row_start,
                column: Vec::with_capacity(n_blocks),
            },
            blocks: Vec::with_capacity(n_blocks),
        }
    }

    /// Releases unused capacity of the matrix's arrays.
    pub(super) fn shrink(&mut self) {
        self.pattern.column.shrink_to_fit();
        self.blocks.shrink_to_fit();
    }

    /// `y += k A x`.
    #[inline(always)]
    pub(super) fn add_product<const V: usize>(&self, k: f32, x: &[[f32; V]], y: &mut [[f32; W]]) {
        for (row, y) in y.iter_mut().enumerate() {
            let mut sum = [0.0_f32; W];
            let range = self.pattern.row(row);
            prefetch(
                self.blocks.as_flattened(),
                &(range.start * C..range.end * C),
            );
            for (block, column) in self.blocks[range.clone()]
                .iter()
                .zip(&self.pattern.column[range])
            {
                let v = &x[*column as usize];
                for j in 0..C {
                    for i in 0..W {
                        sum[i] += block[j][i] * v[j];
                    }
                }
            }
            for i in 0..W {
                y[i] += k * sum[i];
            }
        }
    }

    /// `y = Aᵀ x`.
    #[inline(always)]
    pub(super) fn transposed_product<const V: usize>(&self, x: &[[f32; W]], y: &mut [[f32; V]]) {
        y.fill([0.0; V]);
        for (row, v) in x.iter().enumerate() {
            let range = self.pattern.row(row);
            prefetch(
                self.blocks.as_flattened(),
                &(range.start * C..range.end * C),
            );
            for (block, column) in self.blocks[range.clone()]
                .iter()
                .zip(&self.pattern.column[range])
            {
                let y = &mut y[*column as usize];
                for j in 0..C {
                    y[j] += (0..W).map(|i| block[j][i] * v[i]).sum::<f32>();
                }
            }
        }
    }
}

/// A row of a matrix under construction.
pub(super) struct Row<const W: usize, const C: usize> {
    columns: Vec<u32>,
    blocks: Vec<Block<W, C>>,
}

impl<const W: usize, const C: usize> Row<W, C> {
    pub(super) fn new() -> Self {
        Self {
            columns: vec![],
            blocks: vec![],
        }
    }

    pub(super) fn clear(&mut self) {
        self.columns.clear();
        self.blocks.clear();
    }

    /// The block of a column, inserted as zeros if it does not exist.
    pub(super) fn at(&mut self, column: u32) -> &mut Block<W, C> {
        let k = match self.columns.iter().position(|c| *c == column) {
            Some(k) => k,
            None => {
                self.columns.push(column);
                self.blocks.push([[0.0; W]; C]);
                self.columns.len() - 1
            }
        };
        &mut self.blocks[k]
    }

    pub(super) fn len(&self) -> usize {
        self.columns.len()
    }

    /// Columns with their blocks, in the order of insertion.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u32, &Block<W, C>)> {
        self.columns.iter().copied().zip(&self.blocks)
    }

    pub(super) fn blocks_mut(&mut self) -> &mut [Block<W, C>] {
        &mut self.blocks
    }

    /// Appends the row to `to`, with ascending columns.
    pub(super) fn append_to(&self, to: &mut Blocks<W, C>) {
        let mut order: Vec<usize> = (0..self.columns.len()).collect();
        order.sort_unstable_by_key(|k| self.columns[*k]);
        for k in order {
            to.pattern.column.push(self.columns[k]);
            to.blocks.push(self.blocks[k]);
        }
        to.pattern.row_start.push(to.pattern.column.len() as u32);
    }
}

/// Inverse of a symmetric positive definite block with `B` rows, computed in double precision. If
/// the block is not positive definite, only its diagonal is inverted.
pub(super) fn inverse<const W: usize, const B: usize>(block: &Block<W, B>) -> Block<W, B> {
    let matrix =
        nalgebra::SMatrix::<f64, B, B>::from_fn(|i, j| f64::from(block[j][i] + block[i][j]) * 0.5);
    let mut out = [[0.0; W]; B];
    match matrix.cholesky() {
        Some(factor) => {
            let inverse = factor.inverse();
            for j in 0..B {
                for i in 0..B {
                    out[j][i] = inverse[(i, j)] as f32;
                }
            }
        }
        None => {
            let largest = (0..B).fold(f64::MIN_POSITIVE, |m, i| m.max(matrix[(i, i)].abs()));
            for i in 0..B {
                out[i][i] = (1.0 / matrix[(i, i)].abs().max(1e-3 * largest)) as f32;
            }
        }
    }
    out
}

/// `to += a b`.
#[inline(always)]
pub(super) fn add_times<const W: usize, const V: usize, const K: usize, const C: usize>(
    a: &Block<W, K>,
    b: &Block<V, C>,
    to: &mut Block<W, C>,
) {
    for j in 0..C {
        for k in 0..K {
            for i in 0..W {
                to[j][i] += a[k][i] * b[j][k];
            }
        }
    }
}

/// `to += aᵀ b`.
#[inline(always)]
pub(super) fn add_transposed_times<
    const W: usize,
    const V: usize,
    const R: usize,
    const C: usize,
>(
    a: &Block<W, R>,
    b: &Block<W, C>,
    to: &mut Block<V, C>,
) {
    for j in 0..C {
        for i in 0..R {
            to[j][i] += (0..W).map(|k| a[i][k] * b[j][k]).sum::<f32>();
        }
    }
}

/// Product of a block with a vector, `a v`.
#[inline(always)]
pub(super) fn apply<const W: usize, const B: usize>(a: &Block<W, B>, v: &[f32; W]) -> [f32; W] {
    let mut out = [0.0; W];
    for j in 0..B {
        for i in 0..W {
            out[i] += a[j][i] * v[j];
        }
    }
    out
}
