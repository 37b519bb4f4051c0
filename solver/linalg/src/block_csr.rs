//! Sparse matrices of 3×3 blocks.

use crate::{NO_SLOT, Pattern};

/// A sparse matrix of 3×3 blocks, each stored row by row.
#[derive(Debug, Clone)]
pub struct BlockCsr {
    /// Positions of the blocks.
    pub pattern: std::sync::Arc<Pattern>,
    /// Values of the blocks, in the order of the pattern.
    pub blocks: Vec<[f64; 9]>,
}

impl BlockCsr {
    /// A zero matrix on `pattern`.
    #[must_use]
    pub fn zeros(pattern: std::sync::Arc<Pattern>) -> Self {
        let blocks = vec![[0.0; 9]; pattern.column.len()];
        Self { pattern, blocks }
    }

    /// `y = A x` over the rows of this rank.
    pub fn multiply(&self, x: &[f64], y: &mut [f64]) {
        let (x, _) = x.as_chunks::<3>();
        let (y, _) = y.as_chunks_mut::<3>();
        for (row, y) in y.iter_mut().enumerate().take(self.pattern.n_rows()) {
            let mut sum = [0.0; 3];
            for k in self.pattern.row(row) {
                let (b, v) = (&self.blocks[k], &x[self.pattern.column[k] as usize]);
                for i in 0..3 {
                    sum[i] += b[3 * i] * v[0] + b[3 * i + 1] * v[1] + b[3 * i + 2] * v[2];
                }
            }
            *y = sum;
        }
    }

    /// Diagonal block of a row; zeros if the pattern lacks it.
    #[must_use]
    pub fn diagonal(&self, row: usize) -> [f64; 9] {
        match self.pattern.slot(row as u32, row as u32) {
            NO_SLOT => [0.0; 9],
            slot => self.blocks[slot as usize],
        }
    }
}

/// A sparse matrix of 3×1 blocks. Rows are nodes, and columns are pressure nodes.
#[derive(Debug, Clone)]
pub struct Coupling {
    /// Positions of the blocks.
    pub pattern: std::sync::Arc<Pattern>,
    /// Values of the blocks, in the order of the pattern.
    pub blocks: Vec<[f64; 3]>,
}

impl Coupling {
    /// A zero matrix on `pattern`.
    #[must_use]
    pub fn zeros(pattern: std::sync::Arc<Pattern>) -> Self {
        let blocks = vec![[0.0; 3]; pattern.column.len()];
        Self { pattern, blocks }
    }

    /// `p = Gᵀ x`. The old content of `p` is overwritten.
    pub fn multiply_transposed(&self, x: &[f64], p: &mut [f64]) {
        p.fill(0.0);
        let (x, _) = x.as_chunks::<3>();
        for row in 0..self.pattern.n_rows() {
            let v = x[row];
            for k in self.pattern.row(row) {
                let b = &self.blocks[k];
                p[self.pattern.column[k] as usize] += b[0] * v[0] + b[1] * v[1] + b[2] * v[2];
            }
        }
    }

    /// `y += G p`.
    pub fn add_product(&self, p: &[f64], y: &mut [f64]) {
        let (y, _) = y.as_chunks_mut::<3>();
        for (row, y) in y.iter_mut().enumerate().take(self.pattern.n_rows()) {
            for k in self.pattern.row(row) {
                let (b, v) = (&self.blocks[k], p[self.pattern.column[k] as usize]);
                for i in 0..3 {
                    y[i] += b[i] * v;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_dense_ones() {
        let elements = [[0_u32, 1, 2, 3], [1, 2, 3, 4]];
        let pattern = std::sync::Arc::new(Pattern::of_elements(
            5,
            elements.iter().map(|e| (&e[..], &e[..])),
        ));
        assert_eq!(pattern.column.len(), 4 + 5 * 3 + 4);
        assert_eq!((pattern.slot(0, 4), pattern.slot(7, 0)), (NO_SLOT, NO_SLOT));
        let mut a = BlockCsr::zeros(pattern.clone());
        let mut g = Coupling::zeros(pattern.clone());
        for (k, b) in a.blocks.iter_mut().enumerate() {
            *b = std::array::from_fn(|i| ((k * 9 + i) as f64 * 0.37).sin());
        }
        for (k, b) in g.blocks.iter_mut().enumerate() {
            *b = std::array::from_fn(|i| ((k * 3 + i) as f64 * 0.61).cos());
        }
        let mut dense = nalgebra::DMatrix::<f64>::zeros(15, 15);
        let mut dense_g = nalgebra::DMatrix::<f64>::zeros(15, 5);
        for row in 0..5 {
            for k in pattern.row(row) {
                let c = pattern.column[k] as usize;
                for i in 0..3 {
                    for j in 0..3 {
                        dense[(3 * row + i, 3 * c + j)] = a.blocks[k][3 * i + j];
                    }
                    dense_g[(3 * row + i, c)] = g.blocks[k][i];
                }
            }
        }
        let x: Vec<f64> = (0..15).map(|k| f64::from(k).sqrt()).collect();
        let mut y = vec![0.0; 15];
        a.multiply(&x, &mut y);
        let mut p = vec![1.0; 5];
        g.multiply_transposed(&x, &mut p);
        g.add_product(&p, &mut y);
        let xv = nalgebra::DVector::from_vec(x);
        let want = &dense * &xv + &dense_g * (dense_g.transpose() * &xv);
        assert!((nalgebra::DVector::from_vec(y) - want).norm() < 1e-12);
        assert_eq!(a.diagonal(2), a.blocks[pattern.slot(2, 2) as usize]);
    }
}
