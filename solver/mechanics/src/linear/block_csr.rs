//! Sparse matrices of 3×3 blocks.

/// Slot of a block that this rank does not hold.
pub const NO_SLOT: u32 = u32::MAX;

/// Rows of blocks in compressed storage: columns ascending within a row. Rows are nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    /// First entry of each row, and the end of the last.
    pub row_start: Vec<u32>,
    /// Column of each entry.
    pub column: Vec<u32>,
}

impl Pattern {
    /// Pattern of `n_rows` nodes with an entry wherever an element holds both the row's node and the column's.
    ///
    /// - `elements`: for each element its nodes as rows and its nodes as columns
    pub fn of_elements<'a>(
        n_rows: usize,
        elements: impl Iterator<Item = (&'a [u32], &'a [u32])> + Clone,
    ) -> Self {
        let mut start = vec![0_u32; n_rows + 1];
        for (rows, columns) in elements.clone() {
            for r in rows.iter().filter(|r| (**r as usize) < n_rows) {
                start[*r as usize + 1] += columns.len() as u32;
            }
        }
        for r in 0..n_rows {
            start[r + 1] += start[r];
        }
        let mut found = vec![0_u32; start[n_rows] as usize];
        let mut next = start.clone();
        for (rows, columns) in elements {
            for r in rows.iter().filter(|r| (**r as usize) < n_rows) {
                let at = &mut next[*r as usize];
                found[*at as usize..*at as usize + columns.len()].copy_from_slice(columns);
                *at += columns.len() as u32;
            }
        }
        let mut row_start = Vec::with_capacity(n_rows + 1);
        let mut column = Vec::new();
        row_start.push(0);
        for r in 0..n_rows {
            let row = &mut found[start[r] as usize..start[r + 1] as usize];
            row.sort_unstable();
            let mut last = None;
            for &c in row.iter() {
                if last != Some(c) {
                    column.push(c);
                    last = Some(c);
                }
            }
            row_start.push(column.len() as u32);
        }
        Self { row_start, column }
    }

    /// Number of rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.row_start.len() - 1
    }

    /// Entries of a row.
    #[inline(always)]
    #[must_use]
    pub fn row(&self, row: usize) -> std::ops::Range<usize> {
        self.row_start[row] as usize..self.row_start[row + 1] as usize
    }

    /// Position of the entry `(row, column)`; [`NO_SLOT`] where there is none.
    #[must_use]
    pub fn slot(&self, row: u32, column: u32) -> u32 {
        if row as usize >= self.n_rows() {
            return NO_SLOT;
        }
        let range = self.row(row as usize);
        match self.column[range.clone()].binary_search(&column) {
            Ok(k) => (range.start + k) as u32,
            Err(_) => NO_SLOT,
        }
    }
}

/// A matrix of 3×3 blocks, row-major within a block.
#[derive(Debug, Clone)]
pub struct BlockCsr {
    /// Where the blocks are.
    pub pattern: std::sync::Arc<Pattern>,
    /// The blocks.
    pub blocks: Vec<[f64; 9]>,
}

impl BlockCsr {
    /// Zeros on `pattern`.
    #[must_use]
    pub fn zeros(pattern: std::sync::Arc<Pattern>) -> Self {
        let blocks = vec![[0.0; 9]; pattern.column.len()];
        Self { pattern, blocks }
    }

    /// `y = A x` over the rows held here.
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

    /// The diagonal block of a row; zeros where the pattern lacks it.
    #[must_use]
    pub fn diagonal(&self, row: usize) -> [f64; 9] {
        match self.pattern.slot(row as u32, row as u32) {
            NO_SLOT => [0.0; 9],
            slot => self.blocks[slot as usize],
        }
    }
}

/// A matrix of 3×1 blocks: rows are nodes, columns are pressure nodes.
#[derive(Debug, Clone)]
pub struct Coupling {
    /// Where the blocks are.
    pub pattern: std::sync::Arc<Pattern>,
    /// The blocks.
    pub blocks: Vec<[f64; 3]>,
}

impl Coupling {
    /// Zeros on `pattern`.
    #[must_use]
    pub fn zeros(pattern: std::sync::Arc<Pattern>) -> Self {
        let blocks = vec![[0.0; 3]; pattern.column.len()];
        Self { pattern, blocks }
    }

    /// `p = Gᵀ x`; `p` is overwritten.
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
