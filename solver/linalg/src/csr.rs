//! Sparse matrices of scalars.

use crate::{NO_SLOT, Pattern};

/// A sparse matrix of scalars, stored by rows.
#[derive(Debug, Clone)]
pub struct Csr {
    /// Positions of the entries.
    pub pattern: Pattern,
    /// Values of the entries, in the order of the pattern.
    pub values: Vec<f64>,
}

impl Csr {
    /// A zero matrix on `pattern`.
    #[must_use]
    pub fn zeros(pattern: Pattern) -> Self {
        let values = vec![0.0; pattern.column.len()];
        Self { pattern, values }
    }

    /// Adds to an entry of the pattern. Values for entries outside the pattern are dropped.
    #[inline]
    pub fn add(&mut self, row: u32, column: u32, value: f64) {
        let slot = self.pattern.slot(row, column);
        if slot != NO_SLOT {
            self.values[slot as usize] += value;
        }
    }

    /// The diagonal; zero for entries that the pattern lacks.
    #[must_use]
    pub fn diagonal(&self) -> Vec<f64> {
        let entry = |row: u32| match self.pattern.slot(row, row) {
            NO_SLOT => 0.0,
            slot => self.values[slot as usize],
        };
        (0..self.pattern.n_rows() as u32).map(entry).collect()
    }

    /// `diagonal` + `factor` · self.
    #[must_use]
    pub fn scaled_plus_diagonal(&self, factor: f64, diagonal: &[f64]) -> Self {
        let mut other = self.clone();
        for value in &mut other.values {
            *value *= factor;
        }
        for (row, value) in diagonal.iter().enumerate() {
            other.add(row as u32, row as u32, *value);
        }
        other
    }

    /// Makes products add the entries of a row in ascending order of their columns' `key`. Entries
    /// can no longer be found by column afterwards, so that [`Self::add`] and [`Self::diagonal`]
    /// have to be called before.
    pub fn order_rows_by<K: Ord>(&mut self, key: impl Fn(u32) -> K) {
        let mut row_entries: Vec<(u32, f64)> = vec![];
        for row in 0..self.pattern.n_rows() {
            let range = self.pattern.row(row);
            row_entries.clear();
            row_entries.extend(
                self.pattern.column[range.clone()]
                    .iter()
                    .copied()
                    .zip(self.values[range.clone()].iter().copied()),
            );
            row_entries.sort_unstable_by_key(|(column, _)| key(*column));
            for (slot, (column, value)) in range.zip(&row_entries) {
                self.pattern.column[slot] = *column;
                self.values[slot] = *value;
            }
        }
    }

    /// Computes as many rows of `A x` as `y` holds, beginning with row `first`.
    #[inline]
    pub fn multiply_rows(&self, first: usize, x: &[f64], y: &mut [f64]) {
        for (row, out) in (first..).zip(y) {
            let range = self.pattern.row(row);
            let (columns, values) = (&self.pattern.column[range.clone()], &self.values[range]);
            *out = columns
                .iter()
                .zip(values)
                .map(|(column, value)| value * x[*column as usize])
                .sum();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_agree_with_dense_ones_in_any_order_of_columns() {
        let elements = [[0_u32, 1, 2, 3], [1, 2, 3, 4]];
        let mut a = Csr::zeros(Pattern::of_elements(
            5,
            elements.iter().map(|e| (&e[..], &e[..])),
        ));
        let mut dense = nalgebra::DMatrix::<f64>::zeros(5, 5);
        for (k, (row, column)) in elements
            .iter()
            .flat_map(|e| e.iter().flat_map(|r| e.iter().map(|c| (*r, *c))))
            .enumerate()
        {
            let value = (k as f64 * 0.37).sin();
            a.add(row, column, value);
            dense[(row as usize, column as usize)] += value;
        }
        a.add(0, 4, 7.0); // not in the pattern
        assert_eq!(a.diagonal(), dense.diagonal().as_slice());
        let shifted = a.scaled_plus_diagonal(0.5, &[2.0; 5]);
        let want = &dense * 0.5 + nalgebra::DMatrix::identity(5, 5) * 2.0;
        let x = [1.0, -2.0, 3.0, 0.5, 4.0];
        let product = |a: &Csr| {
            let mut y = [0.0; 5];
            let (low, high) = y.split_at_mut(2);
            a.multiply_rows(0, &x, low);
            a.multiply_rows(2, &x, high);
            nalgebra::DVector::from_row_slice(&y)
        };
        let xv = nalgebra::DVector::from_row_slice(&x);
        assert!((product(&shifted) - want * &xv).norm() < 1e-14);
        a.order_rows_by(std::cmp::Reverse);
        assert_eq!(a.pattern.columns(0), [3, 2, 1, 0]);
        assert!((product(&a) - dense * xv).norm() < 1e-14);
    }
}
