//! Guccione's law of passive myocardium.

use cardiotwin_vocabulary::passive_law::Guccione;

use super::tensor::{Sym, add_square, at};
use super::{MaterialError, PassiveLaw, Response};
use crate::number::Real;

/// `W = C/2 (e^Q − 1)`, `Q = b_f E₁₁² + b_t (E₂₂² + E₃₃² + 2 E₂₃²) + 2 b_fs (E₁₂² + E₁₃²)` of the isochoric Green strain.
///
/// Source: Guccione et al. 1995, J Biomech 28:1167, as quoted in the problem text of Land et al. 2015.
impl PassiveLaw for Guccione {
    const NAME: &'static str = "Guccione";

    fn check(&self) -> Result<(), MaterialError> {
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

    fn isochoric_energy<R: Real>(&self, cbar: &Sym<R>) -> R {
        let (_, q) = strain(self, cbar);
        (q.exp() - q.like(1.0)).times(0.5 * self.c_kpa)
    }

    #[inline(always)]
    fn add_isochoric<R: Real, const TANGENT: bool>(&self, cbar: &Sym<R>, out: &mut Response<R>) {
        let (be, q) = strain(self, cbar);
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

    fn stiffness_kpa(&self) -> f64 {
        self.c_kpa
    }

    fn with_stiffness(self, kpa: f64) -> Self {
        Self { c_kpa: kpa, ..self }
    }

    fn exponent(&self) -> Option<f64> {
        Some(self.b_f)
    }

    fn with_exponents_times(self, factor: f64) -> Self {
        let [b_f, b_t, b_fs] = [self.b_f, self.b_t, self.b_fs].map(|b| b * factor);
        Self {
            b_f,
            b_t,
            b_fs,
            ..self
        }
    }
}

/// `B Ē` and `Q = Ē : B Ē`.
#[inline(always)]
fn strain<R: Real>(law: &Guccione, cbar: &Sym<R>) -> (Sym<R>, R) {
    let one = cbar[0].like(1.0);
    let b = [law.b_f, law.b_t, law.b_t, law.b_fs, law.b_fs, law.b_t];
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
