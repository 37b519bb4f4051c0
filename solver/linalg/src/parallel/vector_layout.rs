//! Vectors over the nodes of all ranks.

use super::{Communicator, Layout};

/// Vectors over the nodes of all ranks, with three numbers per node and owned nodes first.
#[derive(Debug, Clone, Copy)]
pub struct VectorLayout<'a> {
    /// Communicator of the ranks.
    pub comm: &'a dyn Communicator,
    /// Nodes of this rank.
    pub layout: &'a Layout,
}

impl VectorLayout<'_> {
    /// Length of a vector, including ghosts.
    #[must_use]
    pub fn len(&self) -> usize {
        3 * self.layout.n_local
    }

    /// Whether this rank holds no nodes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.layout.n_local == 0
    }

    /// Length of the owned part of a vector.
    #[must_use]
    pub fn n_owned(&self) -> usize {
        3 * self.layout.n_owned
    }

    /// Scalar product over all ranks. Collective.
    #[must_use]
    pub fn dot<T: Copy + Into<f64>>(&self, a: &[T], b: &[T]) -> f64 {
        let mut sum = [self.own_dot(a, b)];
        self.comm.sum(&mut sum);
        sum[0]
    }

    /// This rank's part of a scalar product, in double precision.
    #[must_use]
    pub fn own_dot<A: Copy + Into<f64>, B: Copy + Into<f64>>(&self, a: &[A], b: &[B]) -> f64 {
        let n = self.n_owned();
        dot(&a[..n], &b[..n])
    }

    /// Several scalar products over all ranks in one reduction. Collective.
    #[must_use]
    pub fn dots<T: Copy + Into<f64>, const N: usize>(&self, pairs: [(&[T], &[T]); N]) -> [f64; N] {
        let mut sums = pairs.map(|(a, b)| self.own_dot(a, b));
        self.comm.sum(&mut sums);
        sums
    }

    /// Euclidean norm over all ranks. Collective.
    #[must_use]
    pub fn norm<T: Copy + Into<f64>>(&self, a: &[T]) -> f64 {
        self.dot(a, a).sqrt()
    }

    /// Updates ghosts with their owners' values. Collective.
    pub fn update(&self, values: &mut [f64]) {
        self.comm.update_ghosts(self.layout, 3, values);
    }

    /// [`Self::update`] in single precision.
    pub fn update_single(&self, values: &mut [f32]) {
        self.comm.update_ghosts_single(self.layout, 3, values);
    }
}

/// Scalar product with eight partial sums, whose fixed order of summation can be vectorised.
fn dot<A: Copy + Into<f64>, B: Copy + Into<f64>>(a: &[A], b: &[B]) -> f64 {
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    let mut sums = [0.0; 8];
    for (x, y) in a8.iter().zip(b8) {
        for k in 0..8 {
            sums[k] += x[k].into() * y[k].into();
        }
    }
    let rest = a_rest.iter().zip(b_rest);
    sums.iter().sum::<f64>() + rest.map(|(x, y)| (*x).into() * (*y).into()).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::super::SingleProcess;
    use super::*;

    #[test]
    fn products_run_over_owned_nodes_only() {
        let layout = Layout {
            n_owned: 3,
            n_local: 4,
            neighbours: vec![],
        };
        let space = VectorLayout {
            comm: &SingleProcess,
            layout: &layout,
        };
        let a: Vec<f64> = (0..12).map(f64::from).collect();
        let want: f64 = (0..9).map(|k| f64::from(k * k)).sum();
        assert_eq!(space.dot(&a, &a), want);
        assert_eq!(
            (space.len(), space.n_owned(), space.is_empty()),
            (12, 9, false)
        );
    }
}
