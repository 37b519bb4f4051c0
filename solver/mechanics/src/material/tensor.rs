//! Symmetric 3×3 tensors and fourth-order tensors on them, in components.
//!
//! Components are ordered 11, 22, 33, 12, 13, 23. Second-order tensors hold tensor components. A tangent `D` maps engineering
//! strain (doubled shear) to stress, `δS = D δE`, and is stored as its 21 upper entries, row by row.

use crate::number::Real;

/// A symmetric second-order tensor.
pub type Sym<R> = [R; 6];

/// A tangent with major and minor symmetry; entry `(i, j)` with `i ≤ j` is stored at [`at`]`(i, j)`.
pub type Tangent<R> = [R; 21];

/// Index of entry `(i, j)` of a [`Tangent`].
#[inline(always)]
#[must_use]
pub const fn at(i: usize, j: usize) -> usize {
    let (i, j) = if i <= j { (i, j) } else { (j, i) };
    i * 6 + j - i * (i + 1) / 2
}

/// Full contraction `a : b`.
#[inline(always)]
pub fn contract<R: Real>(a: &Sym<R>, b: &Sym<R>) -> R {
    let shear = a[3].mul_add(b[3], a[4].mul_add(b[4], a[5] * b[5]));
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2].mul_add(b[2], shear + shear)))
}

/// Determinant of a symmetric tensor.
#[inline(always)]
pub fn determinant<R: Real>(a: &Sym<R>) -> R {
    a[0] * (a[1] * a[2] - a[5] * a[5]) - a[3] * (a[3] * a[2] - a[5] * a[4])
        + a[4] * (a[3] * a[5] - a[1] * a[4])
}

/// Inverse of a tensor with determinant `det`.
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

/// `D += k a ⊙ a`, `(a ⊙ a)_ijkl = (a_ik a_jl + a_il a_jk) / 2`. Loops over index pairs are not unrolled and would cost a third
/// of a linear element's stiffness.
#[inline(always)]
pub fn add_symmetric_product<R: Real>(d: &mut Tangent<R>, k: R, a: &Sym<R>) {
    let half = k.times(0.5);
    let [a11, a22, a33, a12, a13, a23] = *a;
    d[at(0, 0)] = k.mul_add(a11 * a11, d[at(0, 0)]);
    d[at(0, 1)] = k.mul_add(a12 * a12, d[at(0, 1)]);
    d[at(0, 2)] = k.mul_add(a13 * a13, d[at(0, 2)]);
    d[at(0, 3)] = k.mul_add(a11 * a12, d[at(0, 3)]);
    d[at(0, 4)] = k.mul_add(a11 * a13, d[at(0, 4)]);
    d[at(0, 5)] = k.mul_add(a12 * a13, d[at(0, 5)]);
    d[at(1, 1)] = k.mul_add(a22 * a22, d[at(1, 1)]);
    d[at(1, 2)] = k.mul_add(a23 * a23, d[at(1, 2)]);
    d[at(1, 3)] = k.mul_add(a12 * a22, d[at(1, 3)]);
    d[at(1, 4)] = k.mul_add(a12 * a23, d[at(1, 4)]);
    d[at(1, 5)] = k.mul_add(a22 * a23, d[at(1, 5)]);
    d[at(2, 2)] = k.mul_add(a33 * a33, d[at(2, 2)]);
    d[at(2, 3)] = k.mul_add(a13 * a23, d[at(2, 3)]);
    d[at(2, 4)] = k.mul_add(a13 * a33, d[at(2, 4)]);
    d[at(2, 5)] = k.mul_add(a23 * a33, d[at(2, 5)]);
    d[at(3, 3)] = half.mul_add(a11.mul_add(a22, a12 * a12), d[at(3, 3)]);
    d[at(3, 4)] = half.mul_add(a11.mul_add(a23, a13 * a12), d[at(3, 4)]);
    d[at(3, 5)] = half.mul_add(a12.mul_add(a23, a13 * a22), d[at(3, 5)]);
    d[at(4, 4)] = half.mul_add(a11.mul_add(a33, a13 * a13), d[at(4, 4)]);
    d[at(4, 5)] = half.mul_add(a12.mul_add(a33, a13 * a23), d[at(4, 5)]);
    d[at(5, 5)] = half.mul_add(a22.mul_add(a33, a23 * a23), d[at(5, 5)]);
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
        let full = |s: &Sym<f64>| {
            nalgebra::Matrix3::new(s[0], s[3], s[4], s[3], s[1], s[5], s[4], s[5], s[2])
        };
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
