//! The method of conjugate gradients, independent of the distribution of its vectors and of the
//! criterion that ends it.

use std::ops::{Add, Mul, Sub};

/// Entries of the vectors: single or double precision.
pub trait Entry:
    Copy + Default + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Into<f64>
{
    /// The nearest number.
    fn nearest(x: f64) -> Self;
}

impl Entry for f64 {
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        x
    }
}

impl Entry for f32 {
    #[inline(always)]
    fn nearest(x: f64) -> Self {
        x as Self
    }
}

/// Operations that the conjugate gradients need of a system `A x = b` with a symmetric positive
/// definite `A`.
pub trait SymmetricSystem {
    /// Entries of its vectors.
    type Number: Entry;

    /// Preconditions a residual, `z ≈ A⁻¹ r`.
    fn precondition(&self, r: &[Self::Number], z: &mut [Self::Number]);

    /// Multiplies a direction, `q = A p`. Updates the ghosts of `p` first.
    fn multiply(&self, p: &mut [Self::Number], q: &mut [Self::Number]);

    /// Scalar product `p · q` over all ranks.
    fn dot(&self, p: &[Self::Number], q: &[Self::Number]) -> f64;

    /// `r · z`, and the size by which the residual is judged.
    fn measure(&self, r: &[Self::Number], z: &[Self::Number]) -> Measure;

    /// Whether to use a direction with curvature `p · A p`, where `rz` is `r · z`. The method ends
    /// if not.
    fn accepts(&self, _curvature: f64, _rz: f64) -> bool {
        true
    }
}

/// Two scalar products of a residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measure {
    /// Scalar product `r · z`.
    pub rz: f64,
    /// Square of the residual's size.
    pub squared_size: f64,
}

/// Vectors of the conjugate gradients, all of the same length. They can be reused in any number of
/// solves.
#[derive(Debug, Clone)]
pub struct Directions<T = f64> {
    /// The residual `b − A x`.
    pub r: Vec<T>,
    z: Vec<T>,
    p: Vec<T>,
    q: Vec<T>,
}

impl<T: Entry> Directions<T> {
    /// Vectors of length `n`.
    #[must_use]
    pub fn new(n: usize) -> Self {
        Self {
            r: vec![T::default(); n],
            z: vec![T::default(); n],
            p: vec![T::default(); n],
            q: vec![T::default(); n],
        }
    }
}

/// Result of the conjugate gradients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ended {
    /// Number of iterations that were made.
    pub iterations: usize,
    /// Square of the residual's size.
    pub squared_size: f64,
    /// Whether the method ended because a direction was not accepted.
    pub is_indefinite: bool,
}

/// Improves `x`, whose residual is in `directions.r`, until `ends` accepts the square of the
/// residual's size, or for `max_iterations` iterations. Collective if the operations of the system
/// are.
///
/// Source: Hestenes and Stiefel 1952, J. Res. Natl. Bur. Stand. 49:409, with a preconditioner.
#[inline]
pub fn iterate<S: SymmetricSystem + ?Sized>(
    system: &S,
    x: &mut [S::Number],
    directions: &mut Directions<S::Number>,
    max_iterations: usize,
    mut ends: impl FnMut(f64) -> bool,
) -> Ended {
    let Directions { r, z, p, q } = directions;
    p.fill(S::Number::default());
    let (mut rz, mut iterations) = (0.0, 0);
    loop {
        system.precondition(r, z);
        let measure = system.measure(r, z);
        let ended = |is_indefinite| Ended {
            iterations,
            squared_size: measure.squared_size,
            is_indefinite,
        };
        if ends(measure.squared_size) || iterations >= max_iterations {
            return ended(false);
        }
        let beta = if iterations == 0 {
            0.0
        } else {
            measure.rz / rz
        };
        rz = measure.rz;
        let beta = S::Number::nearest(beta);
        for (p, z) in p.iter_mut().zip(&*z) {
            *p = *z + beta * *p;
        }
        system.multiply(p, q);
        let curvature = system.dot(p, q);
        if !system.accepts(curvature, rz) {
            return ended(true);
        }
        let alpha = S::Number::nearest(rz / curvature);
        for ((x, r), (p, q)) in x.iter_mut().zip(&mut *r).zip(p.iter().zip(&*q)) {
            *x = *x + alpha * *p;
            *r = *r - alpha * *q;
        }
        iterations += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Csr, Pattern};

    struct Jacobi(Csr);

    impl SymmetricSystem for Jacobi {
        type Number = f64;

        fn precondition(&self, r: &[f64], z: &mut [f64]) {
            for ((z, r), d) in z.iter_mut().zip(r).zip(self.0.diagonal()) {
                *z = r / d;
            }
        }

        fn multiply(&self, p: &mut [f64], q: &mut [f64]) {
            self.0.multiply_rows(0, p, q);
        }

        fn dot(&self, p: &[f64], q: &[f64]) -> f64 {
            p.iter().zip(q).map(|(p, q)| p * q).sum()
        }

        fn measure(&self, r: &[f64], z: &[f64]) -> Measure {
            Measure {
                rz: self.dot(r, z),
                squared_size: self.dot(r, r),
            }
        }

        fn accepts(&self, curvature: f64, _: f64) -> bool {
            curvature > 0.0
        }
    }

    fn system(diagonal: f64) -> Jacobi {
        let tets = [[0_u32, 1, 2, 3], [1, 2, 3, 4]];
        let rows = tets.iter().map(|e| (&e[..], &e[..]));
        let mut a = Csr::zeros(Pattern::of_elements(5, rows));
        for tet in tets {
            for i in tet {
                for j in tet {
                    a.add(i, j, if i == j { diagonal } else { -0.5 });
                }
            }
        }
        Jacobi(a)
    }

    #[test]
    fn a_small_system_is_solved_in_as_many_iterations_as_it_has_unknowns() {
        let a = system(4.0);
        let mut exact = [1.0, -2.0, 3.0, 0.5, 4.0];
        let (mut x, mut directions) = ([0.0; 5], Directions::new(5));
        a.multiply(&mut exact, &mut directions.r);
        let ended = iterate(&a, &mut x, &mut directions, 20, |squared| squared < 1e-24);
        assert!(
            ended.iterations <= 6 && ended.squared_size < 1e-24,
            "{ended:?}"
        );
        for (x, exact) in x.iter().zip(exact) {
            assert!((x - exact).abs() < 1e-10, "{x} {exact}");
        }
    }

    #[test]
    fn limits_and_refused_directions_end_the_method() {
        let ending = |a: &Jacobi, most| {
            let mut directions = Directions::new(5);
            directions.r = vec![1.0, 2.0, -1.0, 0.5, 1.0];
            iterate(a, &mut [0.0; 5], &mut directions, most, |squared| {
                squared < 1e-24
            })
        };
        let short = ending(&system(4.0), 2);
        assert_eq!((short.iterations, short.is_indefinite), (2, false));
        assert!(ending(&system(0.5), 20).is_indefinite);
    }
}
