//! A sparse symmetric matrix in double precision with its factorisation, for the problems of the verification that the library's
//! tangent cannot hold.

use cardiotwin_linalg::Pattern;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side, Spec};

/// Both halves are stored.
pub struct Symmetric {
    start: Vec<usize>,
    row: Vec<usize>,
    value: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
}

impl Symmetric {
    /// A matrix of zeros, with an entry for each pair of unknowns that share a set.
    pub fn new(n: usize, sets: &[Vec<u32>]) -> Self {
        let pattern = Pattern::of_elements(n, sets.iter().map(|s| (&s[..], &s[..])));
        let start: Vec<usize> = pattern.row_start.iter().map(|k| *k as usize).collect();
        let row: Vec<usize> = pattern.column.iter().map(|k| *k as usize).collect();
        let symbolic = factorize_symbolic_cholesky(
            SymbolicSparseColMatRef::new_checked(n, n, &start, None, &row),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .expect("memory for the factor's pattern");
        let (value, factor) = (vec![0.0; row.len()], vec![0.0; symbolic.len_val()]);
        Self {
            start,
            row,
            value,
            symbolic,
            factor,
        }
    }

    pub fn clear(&mut self) {
        self.value.fill(0.0);
    }

    pub fn add_entry(&mut self, i: u32, j: u32, x: f64) {
        let range = self.start[j as usize]..self.start[j as usize + 1];
        let at = self.row[range.clone()]
            .binary_search(&(i as usize))
            .expect("an entry of the pattern");
        self.value[range.start + at] += x;
    }

    /// Adds a dense matrix of the unknowns of a set, row by row, without rows and columns of `fixed` ones.
    pub fn add(&mut self, set: &[u32], matrix: &[f64], fixed: &[bool]) {
        for (a, i) in set.iter().enumerate().filter(|(_, i)| !fixed[**i as usize]) {
            for (b, j) in set.iter().enumerate().filter(|(_, j)| !fixed[**j as usize]) {
                self.add_entry(*i, *j, matrix[a * set.len() + b]);
            }
        }
    }

    /// # Panics
    /// When a pivot vanishes.
    pub fn factorise(&mut self) {
        let n = self.start.len() - 1;
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.start, None, &self.row);
        let scratch = self
            .symbolic
            .factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Spec::default());
        let mut memory = MemBuffer::new(scratch);
        self.symbolic
            .factorize_numeric_ldlt(
                &mut self.factor,
                SparseColMatRef::new(pattern, &self.value),
                Side::Lower,
                LdltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut memory),
                Spec::default(),
            )
            .expect("a regular matrix");
    }

    /// Replaces the right-hand side `x` by the solution.
    pub fn solve(&self, x: &mut [f64]) {
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        let n = x.len();
        LdltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(x, n, 1),
            Par::Seq,
            MemStack::new(&mut memory),
        );
    }
}
