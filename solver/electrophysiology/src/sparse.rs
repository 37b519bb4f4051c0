//! A symmetric matrix in compressed rows, and conjugate gradients.

use cardiotwin_mesh::Adjacency;
use rayon::prelude::*;

/// Rows that one thread takes at a time. Sums are formed chunk by chunk and added in their order, so that results do not
/// depend on how many threads there are.
const CHUNK: usize = 2048;

/// A symmetric matrix on the nodes of a mesh.
#[derive(Debug, Clone)]
pub struct SymmetricMatrix {
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl SymmetricMatrix {
    /// Zeros on the pattern of linear elements.
    #[must_use]
    pub fn zeros(n: usize, tets: &[[u32; 4]]) -> Self {
        let Adjacency {
            starts,
            items: columns,
        } = Adjacency::node_to_nodes(n, tets);
        Self {
            starts,
            values: vec![0.0; columns.len()],
            columns,
        }
    }

    /// How many rows.
    #[must_use]
    pub fn n_rows(&self) -> usize {
        self.starts.len() - 1
    }

    fn place(&self, row: usize, column: u32) -> Option<usize> {
        let columns = &self.columns[self.starts[row]..self.starts[row + 1]];
        columns
            .binary_search(&column)
            .ok()
            .map(|k| self.starts[row] + k)
    }

    /// Adds to an entry of the pattern; entries outside of it stay zero.
    pub fn add(&mut self, row: usize, column: u32, value: f64) {
        if let Some(k) = self.place(row, column) {
            self.values[k] += value;
        }
    }

    /// The diagonal.
    #[must_use]
    pub fn diagonal(&self) -> Vec<f64> {
        (0..self.n_rows())
            .map(|i| self.place(i, i as u32).map_or(0.0, |k| self.values[k]))
            .collect()
    }

    /// `diagonal` + `factor` · self.
    #[must_use]
    pub fn scaled_plus_diagonal(&self, factor: f64, diagonal: &[f64]) -> Self {
        let mut other = self.clone();
        for value in &mut other.values {
            *value *= factor;
        }
        for (i, value) in diagonal.iter().enumerate() {
            other.add(i, i as u32, *value);
        }
        other
    }

    /// y = A x.
    pub fn times(&self, x: &[f64], y: &mut [f64]) {
        let part = |first: usize, y: &mut [f64]| {
            for (i, out) in y.iter_mut().enumerate() {
                let row = self.starts[first + i]..self.starts[first + i + 1];
                let (columns, values) = (&self.columns[row.clone()], &self.values[row]);
                *out = columns
                    .iter()
                    .zip(values)
                    .map(|(column, value)| value * x[*column as usize])
                    .sum();
            }
        };
        if y.len() <= CHUNK {
            part(0, y);
        } else {
            y.par_chunks_mut(CHUNK)
                .enumerate()
                .for_each(|(k, y)| part(k * CHUNK, y));
        }
    }
}

fn inner(x: &[f64], y: &[f64]) -> f64 {
    let chunks = x.chunks(CHUNK).zip(y.chunks(CHUNK));
    chunks
        .map(|(x, y)| x.iter().zip(y).map(|(x, y)| x * y).sum::<f64>())
        .sum()
}

/// Conjugate gradients with Jacobi's preconditioner for one positive definite matrix, with its own memory.
#[derive(Debug, Clone)]
pub struct ConjugateGradients {
    inverse: Vec<f64>,
    weight: f64,
    r: Vec<f64>,
    z: Vec<f64>,
    p: Vec<f64>,
    ap: Vec<f64>,
}

/// Conjugate gradients did not converge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stalled {
    /// Where the error's estimate stands.
    pub error: f64,
    /// After so many iterations.
    pub iterations: usize,
}

/// Iterations before a solve counts as stalled; a sound mesh takes fewer than ten.
const MOST_ITERATIONS: usize = 500;

impl ConjugateGradients {
    /// For the matrix `a`.
    #[must_use]
    pub fn new(a: &SymmetricMatrix) -> Self {
        let n = a.n_rows();
        let diagonal = a.diagonal();
        let weight = diagonal.iter().sum();
        let inverse = diagonal.iter().map(|d| 1.0 / d).collect();
        Self {
            inverse,
            weight,
            r: vec![0.0; n],
            z: vec![0.0; n],
            p: vec![0.0; n],
            ap: vec![0.0; n],
        }
    }

    /// Solves `a` x = b from the guess in `x`, until the root mean square of the preconditioned residual, weighted with
    /// the diagonal, is at most `tolerance`, in the unit of `x`. Returns the iterations.
    ///
    /// # Errors
    /// [`Stalled`].
    pub fn solve(
        &mut self,
        a: &SymmetricMatrix,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
    ) -> Result<usize, Stalled> {
        a.times(x, &mut self.ap);
        for (i, b) in b.iter().enumerate() {
            self.r[i] = b - self.ap[i];
            self.z[i] = self.inverse[i] * self.r[i];
        }
        self.p.copy_from_slice(&self.z);
        let mut rz = inner(&self.r, &self.z);
        for iteration in 0..MOST_ITERATIONS {
            if rz <= tolerance * tolerance * self.weight {
                return Ok(iteration);
            }
            a.times(&self.p, &mut self.ap);
            let step = rz / inner(&self.p, &self.ap);
            for (i, x) in x.iter_mut().enumerate() {
                *x += step * self.p[i];
                self.r[i] -= step * self.ap[i];
                self.z[i] = self.inverse[i] * self.r[i];
            }
            let next = inner(&self.r, &self.z);
            let turn = next / rz;
            rz = next;
            for (p, z) in self.p.iter_mut().zip(&self.z) {
                *p = z + turn * *p;
            }
            if !rz.is_finite() {
                break;
            }
        }
        Err(Stalled {
            error: (rz / self.weight).sqrt(),
            iterations: MOST_ITERATIONS,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_small_system_is_solved() {
        let tets = [[0, 1, 2, 3], [1, 2, 3, 4]];
        let mut a = SymmetricMatrix::zeros(5, &tets);
        for tet in tets {
            for i in tet {
                for j in tet {
                    a.add(i as usize, j, if i == j { 4.0 } else { -0.5 });
                }
            }
        }
        a.add(0, 4, 7.0); // not in the pattern
        let exact = [1.0, -2.0, 3.0, 0.5, 4.0];
        let mut b = [0.0; 5];
        a.times(&exact, &mut b);
        let mut x = [0.0; 5];
        let iterations = ConjugateGradients::new(&a)
            .solve(&a, &b, &mut x, 1e-12)
            .unwrap();
        assert!(iterations <= 6, "{iterations}");
        for (x, exact) in x.iter().zip(exact) {
            assert!((x - exact).abs() < 1e-10, "{x} {exact}");
        }
    }

    #[test]
    fn what_is_not_finite_stalls() {
        let a = SymmetricMatrix::zeros(4, &[[0, 1, 2, 3]]).scaled_plus_diagonal(1.0, &[1.0; 4]);
        let b = [f64::NAN, 0.0, 0.0, 0.0];
        assert!(
            ConjugateGradients::new(&a)
                .solve(&a, &b, &mut [0.0; 4], 1e-9)
                .is_err()
        );
    }
}
