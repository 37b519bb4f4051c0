//! Contributions of each block to the sums whose ratios are the indices.

use super::saltelli::rows_per_block;
use nalgebra::DMatrix;
use std::collections::HashMap;

/// Contributions of the blocks, and the set of blocks that has the rows of each index.
///
/// The order of indices is D of first order, D totals, then the pairs.
pub(super) struct Terms {
    /// Shape (blocks, 3 × sets + indices). Each set of blocks has three columns: membership, and
    /// the sum and the sum of squares of A and B. Then each index has its numerator, which is zero
    /// in blocks without its rows.
    values: DMatrix<f64>,
    /// Set of blocks of each index.
    set_of: Vec<usize>,
    /// Number of blocks of each set.
    n_blocks: Vec<usize>,
}

/// Standardised output of one block.
struct Block<'a> {
    rows: &'a [f64],
    n_parameters: usize,
}

impl Block<'_> {
    fn a(&self) -> f64 {
        self.rows[0]
    }

    fn b(&self) -> f64 {
        self.rows[self.rows.len() - 1]
    }

    /// A with one parameter from B.
    fn ab(&self, parameter: usize) -> f64 {
        self.rows[1 + parameter]
    }

    /// B with one parameter from A.
    fn ba(&self, parameter: usize) -> f64 {
        self.rows[1 + self.n_parameters + parameter]
    }

    /// All numerators; NaN if a row of the index failed.
    fn numerators(&self) -> impl Iterator<Item = f64> {
        let (a, b, n) = (self.a(), self.b(), self.n_parameters);
        let first = move |j: usize| b * (self.ab(j) - a);
        let total = move |j: usize| 0.5 * (a - self.ab(j)).powi(2);
        let second =
            move |[j, k]: [usize; 2]| (self.ba(j) * self.ab(k) - a * b) - first(j) - first(k);
        // B does not enter the numerator of a total index, but its variance.
        let total = move |j| if b.is_finite() { total(j) } else { f64::NAN };
        (0..n)
            .map(first)
            .chain((0..n).map(total))
            .chain(pairs(n).map(second))
    }
}

impl Terms {
    /// Builds the terms from one standardised output with blocks of 2D + 2 rows.
    pub(super) fn new(n_parameters: usize, output: &[f64]) -> Self {
        let rows_per_block = rows_per_block(n_parameters);
        let n_blocks = output.len() / rows_per_block;
        let n_indices = 2 * n_parameters + n_parameters * (n_parameters - 1) / 2;
        let blocks = || {
            output
                .chunks_exact(rows_per_block)
                .map(|rows| Block { rows, n_parameters })
        };

        let mut numerators = DMatrix::zeros(n_blocks, n_indices);
        for (row, block) in blocks().enumerate() {
            for (column, value) in block.numerators().enumerate() {
                numerators[(row, column)] = value;
            }
        }
        // Indices whose rows failed in the same blocks, mostly in none, share their sums over A and
        // B.
        let mut sets: HashMap<Vec<bool>, usize> = HashMap::new();
        let mut members: Vec<Vec<bool>> = Vec::new();
        let set_of: Vec<usize> = (0..n_indices)
            .map(|i| {
                let holds: Vec<bool> = numerators.column(i).iter().map(|v| v.is_finite()).collect();
                *sets.entry(holds).or_insert_with_key(|holds| {
                    members.push(holds.clone());
                    members.len() - 1
                })
            })
            .collect();
        let mut values = DMatrix::zeros(n_blocks, 3 * members.len() + n_indices);
        for (set, holds) in members.iter().enumerate() {
            for (row, block) in blocks().enumerate().filter(|(row, _)| holds[*row]) {
                let (a, b) = (block.a(), block.b());
                values[(row, 3 * set)] = 1.0;
                values[(row, 3 * set + 1)] = a + b;
                values[(row, 3 * set + 2)] = a * a + b * b;
            }
        }
        let finite = numerators.map(|v| if v.is_finite() { v } else { 0.0 });
        values
            .columns_mut(3 * members.len(), n_indices)
            .copy_from(&finite);
        let n_blocks = members
            .iter()
            .map(|holds| holds.iter().filter(|h| **h).count())
            .collect();
        Self {
            values,
            set_of,
            n_blocks,
        }
    }

    /// Number of blocks that an index is computed from.
    pub(super) fn n_blocks(&self, index: usize) -> usize {
        self.n_blocks[self.set_of[index]]
    }

    /// All indices for each row of weights, shape (rows of weights, indices); NaN where no block
    /// counts.
    pub(super) fn indices(&self, weights: &DMatrix<f64>) -> DMatrix<f64> {
        let sums = weights * &self.values;
        let first_numerator = 3 * self.n_blocks.len();
        DMatrix::from_fn(weights.nrows(), self.set_of.len(), |row, index| {
            let set = 3 * self.set_of[index];
            let n = sums[(row, set)];
            let mean = sums[(row, set + 1)] / (2.0 * n);
            let variance = sums[(row, set + 2)] / (2.0 * n) - mean * mean;
            // As in SALib, an index is zero if A and B do not vary.
            if variance <= f64::EPSILON {
                0.0
            } else {
                sums[(row, first_numerator + index)] / n / variance
            }
        })
    }
}

/// All pairs of parameters, the smaller index first.
pub(super) fn pairs(n_parameters: usize) -> impl Iterator<Item = [usize; 2]> {
    (0..n_parameters).flat_map(move |j| (j + 1..n_parameters).map(move |k| [j, k]))
}
