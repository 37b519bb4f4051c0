//! The isotropic law of the aortic root and other passive tissue.

use super::tensor::Sym;
use super::{MaterialError, Response};
use crate::number::Real;

/// `W = µ/2 (Ī₁ − 3)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeoHookean {
    /// Shear modulus `µ` \[kPa\].
    pub mu_kpa: f64,
}

impl NeoHookean {
    pub(super) fn check(&self) -> Result<(), MaterialError> {
        MaterialError::unless(
            self.mu_kpa > 0.0 && self.mu_kpa.is_finite(),
            "mu_kPa",
            self.mu_kpa,
            "positive and finite",
        )
    }

    pub(super) fn energy<R: Real>(&self, cbar: &Sym<R>) -> R {
        (cbar[0] + cbar[1] + cbar[2] - cbar[0].like(3.0)).times(0.5 * self.mu_kpa)
    }

    #[inline(always)]
    pub(super) fn add_isochoric<R: Real>(&self, cbar: &Sym<R>, out: &mut Response<R>) {
        let mu = cbar[0].like(self.mu_kpa);
        for i in 0..3 {
            out.s[i] = out.s[i] + mu;
        }
    }
}
