//! Symmetric 3×3 tensors and their fourth-order companions in components.
//!
//! Order: 11, 22, 33, 12, 13, 23. Second-order tensors hold tensor components. A tangent `D` maps engineering strain
//! (shear doubled) to stress, `δS = D δE`, and is held as its 21 upper entries, row by row.

use crate::number::Real;

/// A symmetric second-order tensor.
pub type Sym<R> = [R; 6];

/// A tangent with major and minor symmetry: entry `(i, j)` with `i ≤ j` is at [`at`]`(i, j)`.
pub type Tangent<R> = [R; 21];

/// Position of entry `(i, j)` of a [`Tangent`].
#[inline(always)]
#[must_use]
pub const fn at(i: usize, j: usize) -> usize {
    let (i, j) = if i <= j { (i, j) } else { (j, i) };
    i * 6 + j - i * (i + 1) / 2
}

/// `a : b`.
#[inline(always)]
pub fn contract<R: Real>(a: &Sym<R>, b: &Sym<R>) -> R {
    let shear = a[3].mul_add(b[3], a[4].mul_add(b[4], a[5] * b[5]));
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2].mul_add(b[2], shear + shear)))
}

/// Determinant.
#[inline(always)]
pub fn determinant<R: Real>(a: &Sym<R>) -> R {
    a[0] * (a[1] * a[2] - a[5] * a[5]) - a[3] * (a[3] * a[2] - a[5] * a[4]) + a[4] * (a[3] * a[5] - a[1] * a[4])
}

/// Inverse, from the determinant.
#[inline(always)]
pub fn inverse<R: Real>(a: &Sym<R>, det: R) -> Sym<R> {
    let r = det.like(1.0) / det;
    [
        (a[1] * a[2] - a[5] * a[5]) * r,
        (a[0] * a[2] - a[4] * a[4]) * r,
        (a[0] * a[1] - a[3] * a[3]) * r,
        (a[4] * a[5] - a[3] * a[2]) * r,
        (a[3] * a[5] - a[4] * a[1]) * r,
        (a[3] * a[4] - a[0] * a[5]) * r,
    ]
}

/// `D += k a ⊗ a`.
#[inline(always)]
pub fn add_square<R: Real>(d: &mut Tangent<R>, k: R, a: &Sym<R>) {
    for i in 0..6 {
        let ka = k * a[i];
        for j in i..6 {
            d[at(i, j)] = ka.mul_add(a[j], d[at(i, j)]);
        }
    }
}

/// `D += a ⊗ b + b ⊗ a`.
#[inline(always)]
pub fn add_pair<R: Real>(d: &mut Tangent<R>, a: &Sym<R>, b: &Sym<R>) {
    for i in 0..6 {
        for j in i..6 {
            d[at(i, j)] = a[i].mul_add(b[j], b[i].mul_add(a[j], d[at(i, j)]));
        }
    }
}

/// Index pairs of the six components.
const PAIRS: [(usize, usize); 6] = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)];

/// Component of the tensor at row `i`, column `j`.
#[inline(always)]
const fn component(i: usize, j: usize) -> usize {
    match (i, j) {
        (0, 0) => 0,
        (1, 1) => 1,
        (2, 2) => 2,
        (0, 1) | (1, 0) => 3,
        (0, 2) | (2, 0) => 4,
        _ => 5,
    }
}

/// `D += k a ⊙ a`, `(a ⊙ a)_ijkl = (a_ik a_jl + a_il a_jk) / 2`.
#[inline(always)]
pub fn add_symmetric_product<R: Real>(d: &mut Tangent<R>, k: R, a: &Sym<R>) {
    let half = k.times(0.5);
    for p in 0..6 {
        let (i, j) = PAIRS[p];
        for q in p..6 {
            let (m, n) = PAIRS[q];
            let x = a[component(i, m)].mul_add(a[component(j, n)], a[component(i, n)] * a[component(j, m)]);
            d[at(p, q)] = half.mul_add(x, d[at(p, q)]);
        }
    }
}

/// `D : a`, for a symmetric second-order tensor `a`.
#[inline(always)]
pub fn apply<R: Real>(d: &Tangent<R>, a: &Sym<R>) -> Sym<R> {
    let e = [a[0], a[1], a[2], a[3] + a[3], a[4] + a[4], a[5] + a[5]];
    let mut out = [a[0].like(0.0); 6];
    for i in 0..6 {
        for j in 0..6 {
            out[i] = d[at(i, j)].mul_add(e[j], out[i]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Sym<f64> = [1.4, 0.9, 1.1, 0.2, -0.1, 0.3];

    #[test]
    fn inverse_times_tensor_is_identity() {
        let inv = inverse(&A, determinant(&A));
        let full = |s: &Sym<f64>| nalgebra::Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2]);
        assert!((full(&A) * full(&inv) - nalgebra::Matrix3::identity()).norm() < 1e-14);
    }

    #[test]
    fn symmetric_product_of_the_identity_is_the_identity_map() {
        let mut d = [0.0; 21];
        add_symmetric_product(&mut d, 1.0, &[1.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
        let got = apply(&d, &A);
        for (g, a) in got.iter().zip(A) {
            assert!((g - a).abs() < 1e-15);
        }
    }
}
