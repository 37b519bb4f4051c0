//! Direct factorisation in single precision on one process, for problems of moderate size. It
//! serves as preconditioner of Krylov methods, which compensate for its limited precision.

use std::sync::Arc;

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::ldlt::factor::LdltRegularization;
use faer::perm::PermRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LdltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

use crate::dissection::nested_dissection;
use crate::parallel::VectorLayout;
use crate::{CondensedMatrix, Pattern, Preconditioner};

/// Reasons why a factorisation failed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DirectError {
    /// The symbolic factorisation failed.
    #[error("cannot analyse a matrix of {n} rows: {reason}")]
    Symbolic {
        /// Number of rows of the matrix.
        n: usize,
        /// Message of the factorisation library.
        reason: String,
    },
    /// The numeric factorisation failed, because a pivot vanished.
    #[error("cannot factorise a matrix of {n} rows: {reason}; the body may be free to move")]
    Numeric {
        /// Number of rows of the matrix.
        n: usize,
        /// Message of the factorisation library.
        reason: String,
    },
}

/// Factorisation `L D Lᵀ` of the symmetric part of `[K G; Gᵀ −D⁻¹]`. Nodal volume changes remain
/// unknowns, so that the matrix keeps the stencil of the mesh. Nested dissection limits the
/// fill-in. The symbolic part is computed once.
pub struct Direct {
    pattern: Arc<Pattern>,
    coupling: Option<Arc<Pattern>>,
    /// Lower triangle, stored by columns.
    column_start: Vec<usize>,
    row: Vec<usize>,
    value: Vec<f32>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f32>,
    n_rows: usize,
    n: usize,
}

impl std::fmt::Debug for Direct {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Direct")
            .field("n", &self.n)
            .field("factor", &self.factor.len())
            .finish_non_exhaustive()
    }
}

impl Direct {
    /// Analyses the patterns of `tangent`, with nodes at `points` (three numbers per node).
    ///
    /// # Errors
    /// [`DirectError::Symbolic`] if memory or the index range does not suffice.
    pub fn new(tangent: &CondensedMatrix, points: &[f64]) -> Result<Self, DirectError> {
        let pattern = tangent.stiffness.pattern.clone();
        let coupling = tangent.coupling.as_ref().map(|c| c.pattern.clone());
        let n_rows = pattern.n_rows();
        let n_pressures = tangent.bulk.len();
        let n = 3 * n_rows + n_pressures;
        // Lower triangle by columns; a column of it corresponds to a row of the upper triangle.
        let (mut column_start, mut row) = (vec![0], vec![]);
        for node in 0..n_rows {
            for i in 0..3 {
                for k in pattern.row(node) {
                    let other = pattern.column[k] as usize;
                    row.extend((0..3).map(|j| 3 * other + j).filter(|r| *r >= 3 * node + i));
                }
                if let Some(coupling) = &coupling {
                    row.extend(
                        coupling
                            .row(node)
                            .map(|k| 3 * n_rows + coupling.column[k] as usize),
                    );
                }
                column_start.push(row.len());
            }
        }
        for p in 0..n_pressures {
            row.push(3 * n_rows + p);
            column_start.push(row.len());
        }
        let mut forward = Vec::with_capacity(n);
        for node in nested_dissection(&pattern, points) {
            forward.extend((0..3).map(|i| 3 * node as usize + i));
            if (node as usize) < n_pressures {
                forward.push(3 * n_rows + node as usize);
            }
        }
        let mut inverse = vec![0; n];
        for (k, f) in forward.iter().enumerate() {
            inverse[*f] = k;
        }
        let error = |reason: String| DirectError::Symbolic { n, reason };
        let symbolic = factorize_symbolic_cholesky(
            SymbolicSparseColMatRef::new_checked(n, n, &column_start, None, &row),
            Side::Lower,
            SymmetricOrdering::Custom(PermRef::new_checked(&forward, &inverse, n)),
            CholeskySymbolicParams::default(),
        )
        .map_err(|e| error(format!("{e:?}")))?;
        let (value, factor) = (vec![0.0; row.len()], vec![0.0; symbolic.len_val()]);
        Ok(Self {
            pattern,
            coupling,
            column_start,
            row,
            value,
            symbolic,
            factor,
            n_rows,
            n,
        })
    }

    /// Number of values in the factor.
    #[must_use]
    pub fn fill(&self) -> usize {
        self.factor.len()
    }

    /// Factorises the symmetric part of `tangent`, which must have the analysed patterns.
    ///
    /// # Errors
    /// [`DirectError::Numeric`] if a pivot vanishes.
    pub fn factorise(&mut self, tangent: &CondensedMatrix) -> Result<(), DirectError> {
        debug_assert_eq!(self.pattern, tangent.stiffness.pattern);
        let blocks = &tangent.stiffness.blocks;
        let mut at = 0;
        for node in 0..self.n_rows {
            for i in 0..3 {
                for k in self.pattern.row(node) {
                    let other = self.pattern.column[k];
                    let back = self.pattern.slot(other, node as u32) as usize;
                    for j in 0..3 {
                        if 3 * other as usize + j >= 3 * node + i {
                            self.value[at] =
                                (0.5 * (blocks[k][3 * i + j] + blocks[back][3 * j + i])) as f32;
                            at += 1;
                        }
                    }
                }
                if let (Some(pattern), Some(coupling)) = (&self.coupling, &tangent.coupling) {
                    for k in pattern.row(node) {
                        self.value[at] = coupling.blocks[k][i] as f32;
                        at += 1;
                    }
                }
            }
        }
        for d in &tangent.bulk {
            self.value[at] = (-1.0 / d) as f32;
            at += 1;
        }
        let (n, par) = (self.n, Par::Seq);
        let matrix = SparseColMatRef::new(
            SymbolicSparseColMatRef::new_checked(n, n, &self.column_start, None, &self.row),
            &self.value,
        );
        let scratch = self
            .symbolic
            .factorize_numeric_ldlt_scratch::<f32>(par, faer::Spec::default());
        let mut memory = MemBuffer::new(scratch);
        self.symbolic
            .factorize_numeric_ldlt(
                &mut self.factor,
                matrix,
                Side::Lower,
                LdltRegularization::default(),
                par,
                MemStack::new(&mut memory),
                faer::Spec::default(),
            )
            .map_err(|e| DirectError::Numeric {
                n,
                reason: format!("{e:?}"),
            })?;
        Ok(())
    }
}

impl Preconditioner for Direct {
    fn apply(&self, _space: VectorLayout<'_>, r: &[f64], z: &mut [f64]) {
        let mut full = vec![0.0_f32; self.n];
        // Scaled to a maximum of one, so that no value is too small for single precision.
        let largest = r[..3 * self.n_rows]
            .iter()
            .fold(0.0_f64, |m, r| m.max(r.abs()));
        let scale = if largest > 0.0 { 1.0 / largest } else { 1.0 };
        full.iter_mut()
            .zip(&r[..3 * self.n_rows])
            .for_each(|(to, r)| *to = (scale * r) as f32);
        let par = Par::Seq;
        let mut memory = MemBuffer::new(self.symbolic.solve_in_place_scratch::<f32>(1, par));
        LdltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut full, self.n, 1),
            par,
            MemStack::new(&mut memory),
        );
        z.iter_mut()
            .zip(&full[..3 * self.n_rows])
            .for_each(|(z, f)| *z = f64::from(*f) / scale);
    }
}
