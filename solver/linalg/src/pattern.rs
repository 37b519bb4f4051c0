//! Sparsity patterns of matrices.

/// Marks a block that this rank does not hold.
pub const NO_SLOT: u32 = u32::MAX;

/// Pattern in compressed row storage, with ascending columns in each row. Rows are nodes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pattern {
    /// First entry of each row, followed by the number of all entries.
    pub row_start: Vec<u32>,
    /// Column of each entry.
    pub column: Vec<u32>,
}

impl Pattern {
    /// Pattern for `n_rows` nodes, with an entry for each pair of a row node and a column node of
    /// the same element.
    ///
    /// - `elements`: row nodes and column nodes of each element
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

    /// Number of rows, one for each row node.
    #[inline]
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

    /// Columns of a row.
    #[inline]
    #[must_use]
    pub fn columns(&self, row: usize) -> &[u32] {
        &self.column[self.row(row)]
    }

    /// Position of the entry `(row, column)`; [`NO_SLOT`] if the pattern lacks it.
    #[inline]
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
