//! The isotropic law of the aortic root and other passive tissue.

use cardiotwin_vocabulary::passive_law::NeoHookean;

use super::tensor::Sym;
use super::{MaterialError, PassiveLaw, Response};
use crate::number::Real;

/// `W = µ/2 (Ī₁ − 3)`.
impl PassiveLaw for NeoHookean {
    const NAME: &'static str = "neo-Hookean";

    fn check(&self) -> Result<(), MaterialError> {
        MaterialError::unless(
            self.mu_kpa > 0.0 && self.mu_kpa.is_finite(),
            "mu_kPa",
            self.mu_kpa,
            "positive and finite",
        )
    }

    fn isochoric_energy<R: Real>(&self, cbar: &Sym<R>) -> R {
        (cbar[0] + cbar[1] + cbar[2] - cbar[0].like(3.0)).times(0.5 * self.mu_kpa)
    }

    #[inline(always)]
    fn add_isochoric<R: Real, const TANGENT: bool>(&self, cbar: &Sym<R>, out: &mut Response<R>) {
        let mu = cbar[0].like(self.mu_kpa);
        for i in 0..3 {
            out.s[i] = out.s[i] + mu;
        }
    }

    fn stiffness_kpa(&self) -> f64 {
        self.mu_kpa
    }

    fn with_stiffness(self, kpa: f64) -> Self {
        Self { mu_kpa: kpa }
    }
}
