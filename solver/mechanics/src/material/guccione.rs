//! Guccione's law of passive myocardium.

use super::tensor::{Sym, add_square, at};
use super::{MaterialError, Response};
use crate::number::Real;

/// `W = C/2 (e^Q − 1)`, `Q = b_f E₁₁² + b_t (E₂₂² + E₃₃² + 2 E₂₃²) + 2 b_fs (E₁₂² + E₁₃²)` of the isochoric Green strain.
///
/// Source: Guccione et al. 1995, J Biomech 28:1167, as quoted in the problem text of Land et al. 2015.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Guccione {
    /// Stiffness `C` \[kPa\].
    pub c_kpa: f64,
    /// Exponent `b_f` of fibre strain.
    pub b_f: f64,
    /// Exponent `b_t` of strains in the transverse plane.
    pub b_t: f64,
    /// Exponent `b_fs` of fibre shear.
    pub b_fs: f64,
}

impl Guccione {
    /// Guccione's exponents of 1995 with stiffness `c_kpa` \[kPa\].
    #[must_use]
    pub fn guccione1995(c_kpa: f64) -> Self {
        Self {
            c_kpa,
            b_f: 18.48,
            b_t: 3.58,
            b_fs: 1.627,
        }
    }

    pub(super) fn check(&self) -> Result<(), MaterialError> {
        for (name, value) in [
            ("C_kPa", self.c_kpa),
            ("b_f", self.b_f),
            ("b_t", self.b_t),
            ("b_fs", self.b_fs),
        ] {
            MaterialError::unless(
                value > 0.0 && value.is_finite(),
                name,
                value,
                "positive and finite",
            )?;
        }
        Ok(())
    }

    /// `B Ē` and `Q = Ē : B Ē`.
    #[inline(always)]
    fn strain<R: Real>(&self, cbar: &Sym<R>) -> (Sym<R>, R) {
        let one = cbar[0].like(1.0);
        let b = [self.b_f, self.b_t, self.b_t, self.b_fs, self.b_fs, self.b_t];
        let (mut e, mut be) = ([one; 6], [one; 6]);
        for i in 0..6 {
            e[i] = if i < 3 {
                (cbar[i] - one).times(0.5)
            } else {
                cbar[i].times(0.5)
            };
            be[i] = e[i].times(b[i]);
        }
        (be, super::tensor::contract(&be, &e))
    }

    pub(super) fn energy<R: Real>(&self, cbar: &Sym<R>) -> R {
        let (_, q) = self.strain(cbar);
        (q.exp() - q.like(1.0)).times(0.5 * self.c_kpa)
    }

    #[inline(always)]
    pub(super) fn add_isochoric<R: Real, const TANGENT: bool>(
        &self,
        cbar: &Sym<R>,
        out: &mut Response<R>,
    ) {
        let (be, q) = self.strain(cbar);
        let k = q.exp().times(self.c_kpa);
        for i in 0..6 {
            out.s[i] = k * be[i];
        }
        if TANGENT {
            let diagonal = [
                self.b_f,
                self.b_t,
                self.b_t,
                0.5 * self.b_fs,
                0.5 * self.b_fs,
                0.5 * self.b_t,
            ];
            for i in 0..6 {
                out.d[at(i, i)] = k.times(diagonal[i]);
            }
            add_square(&mut out.d, k + k, &be);
        }
    }
}
