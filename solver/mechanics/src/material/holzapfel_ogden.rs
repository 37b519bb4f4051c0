//! Holzapfel and Ogden's orthotropic law of passive myocardium.

use cardiotwin_vocabulary::passive_law::HolzapfelOgden;

use super::tensor::{Sym, add_square, at};
use super::{MaterialError, PassiveLaw, Response};
use crate::number::Real;

/// `W = a/2b (e^{b(Ī₁−3)} − 1) + Σ_{i=f,s} a_i/2b_i H(I₄ᵢ)(e^{b_i (I₄ᵢ−1)²} − 1) + a_fs/2b_fs (e^{b_fs I₈²} − 1)`,
/// with `H(x) = 1/(1 + e^{−k(x−1)})`: fibres and sheets bear load in extension only. Ī₁ is isochoric, I₄ and I₈ are not.
///
/// Source: Holzapfel and Ogden 2009, Phil Trans A 367:3445, eq. 5.38, with the smooth switch of Aróstica et al. 2025.
impl PassiveLaw for HolzapfelOgden {
    const NAME: &'static str = "Holzapfel-Ogden";

    fn check(&self) -> Result<(), MaterialError> {
        let values = [
            ("a_kPa", self.a_kpa),
            ("b", self.b),
            ("b_f", self.b_f),
            ("b_s", self.b_s),
            ("b_fs", self.b_fs),
            ("switch", self.switch),
        ];
        for (name, value) in values {
            MaterialError::unless(
                value > 0.0 && value.is_finite(),
                name,
                value,
                "positive and finite",
            )?;
        }
        for (name, value) in [
            ("a_f_kPa", self.a_f_kpa),
            ("a_s_kPa", self.a_s_kpa),
            ("a_fs_kPa", self.a_fs_kpa),
        ] {
            MaterialError::unless(
                value >= 0.0 && value.is_finite(),
                name,
                value,
                "zero or more, and finite",
            )?;
        }
        Ok(())
    }

    fn isochoric_energy<R: Real>(&self, cbar: &Sym<R>) -> R {
        let i1 = cbar[0] + cbar[1] + cbar[2] - cbar[0].like(3.0);
        (i1.times(self.b).exp() - i1.like(1.0)).times(self.a_kpa / (2.0 * self.b))
    }

    fn fibre_energy<R: Real>(&self, c: &Sym<R>) -> Option<R> {
        let one = c[0].like(1.0);
        let along = |x: R, a: f64, b: f64| {
            let y = x - one;
            let h = one / (one + y.times(-self.switch).exp());
            h * ((y * y).times(b).exp() - one).times(a / (2.0 * b))
        };
        Some(
            along(c[0], self.a_f_kpa, self.b_f)
                + along(c[1], self.a_s_kpa, self.b_s)
                + ((c[3] * c[3]).times(self.b_fs).exp() - one)
                    .times(self.a_fs_kpa / (2.0 * self.b_fs)),
        )
    }

    #[inline(always)]
    fn add_isochoric<R: Real, const TANGENT: bool>(&self, cbar: &Sym<R>, out: &mut Response<R>) {
        let i1 = cbar[0] + cbar[1] + cbar[2] - cbar[0].like(3.0);
        let k = i1.times(self.b).exp().times(self.a_kpa);
        for i in 0..3 {
            out.s[i] = k;
        }
        if TANGENT {
            let (zero, one) = (k.like(0.0), k.like(1.0));
            add_square(
                &mut out.d,
                k.times(2.0 * self.b),
                &[one, one, one, zero, zero, zero],
            );
        }
    }

    #[inline(always)]
    fn add_fibres<R: Real, const TANGENT: bool>(&self, c: &Sym<R>, out: &mut Response<R>) {
        let one = c[0].like(1.0);
        for (i, a, b) in [(0, self.a_f_kpa, self.b_f), (1, self.a_s_kpa, self.b_s)] {
            // W(x) = H(x) g(x); S_ii = 2 W', D_iiii = 4 W''.
            let y = c[i] - one;
            let h = one / (one + y.times(-self.switch).exp());
            let h1 = (h * (one - h)).times(self.switch);
            let h2 = (h1 * (one - h - h)).times(self.switch);
            let e = (y * y).times(b).exp();
            let g = (e - one).times(a / (2.0 * b));
            let g1 = (y * e).times(a);
            out.s[i] = out.s[i] + (h * g1 + h1 * g).times(2.0);
            if TANGENT {
                let g2 = (e + (y * y * e).times(2.0 * b)).times(a);
                out.d[at(i, i)] =
                    out.d[at(i, i)] + (h * g2 + (h1 * g1).times(2.0) + h2 * g).times(4.0);
            }
        }
        // I₈ = C₁₂: S₁₂ = ∂W/∂E₁₂ over both off-diagonal entries = dW/dI₈, D₁₂₁₂ = d²W/dI₈².
        let e = (c[3] * c[3]).times(self.b_fs).exp().times(self.a_fs_kpa);
        out.s[3] = out.s[3] + c[3] * e;
        if TANGENT {
            out.d[at(3, 3)] = out.d[at(3, 3)] + e + (c[3] * c[3] * e).times(2.0 * self.b_fs);
        }
    }

    fn stiffness_kpa(&self) -> f64 {
        self.a_kpa
    }

    fn with_stiffness(self, kpa: f64) -> Self {
        let factor = kpa / self.a_kpa;
        let [a_f_kpa, a_s_kpa, a_fs_kpa] =
            [self.a_f_kpa, self.a_s_kpa, self.a_fs_kpa].map(|a| factor * a);
        Self {
            a_kpa: kpa,
            a_f_kpa,
            a_s_kpa,
            a_fs_kpa,
            ..self
        }
    }

    fn exponent(&self) -> Option<f64> {
        Some(self.b_f)
    }

    fn with_exponents_times(self, factor: f64) -> Self {
        let [b, b_f, b_s, b_fs] = [self.b, self.b_f, self.b_s, self.b_fs].map(|b| b * factor);
        Self {
            b,
            b_f,
            b_s,
            b_fs,
            ..self
        }
    }
}
