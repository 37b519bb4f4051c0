//! Resistance to a change of volume.

use serde::Deserialize;

use super::MaterialError;
use crate::number::Real;

/// Form of the volumetric energy `U(J)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VolumetricLaw {
    /// `κ/2 (ln J)²`, the paper's form for myocardium.
    LnSquared,
    /// `κ/2 (J − 1)²`, the paper's form for the aorta.
    Quadratic,
    /// `κ/4 (J² − 1 − 2 ln J)`, the form of the benchmark of Aróstica et al. 2025.
    QuadraticLn,
}

/// Volumetric energy with its modulus.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Volumetric {
    /// Form of the energy.
    pub law: VolumetricLaw,
    /// Bulk modulus `κ` \[kPa\].
    #[serde(rename = "kappa_kPa")]
    pub kappa_kpa: f64,
}

impl Volumetric {
    pub(super) fn check(&self) -> Result<(), MaterialError> {
        MaterialError::unless(
            self.kappa_kpa > 0.0 && self.kappa_kpa.is_finite(),
            "kappa_kPa",
            self.kappa_kpa,
            "positive and finite",
        )
    }
}

impl VolumetricLaw {
    /// Energy of volume change over the bulk modulus, `U/κ`, at the volume ratio `j`.
    #[inline(always)]
    pub fn energy<R: Real>(self, j: R) -> R {
        let one = j.like(1.0);
        match self {
            Self::LnSquared => {
                let l = j.ln();
                (l * l).times(0.5)
            }
            Self::Quadratic => ((j - one) * (j - one)).times(0.5),
            Self::QuadraticLn => (j * j - one - j.ln().times(2.0)).times(0.25),
        }
    }

    /// First and second derivative of this energy, `U'/κ` and `U''/κ`.
    #[inline(always)]
    pub fn slopes<R: Real>(self, j: R) -> (R, R) {
        let one = j.like(1.0);
        let r = one / j;
        match self {
            Self::LnSquared => {
                let l = j.ln();
                (l * r, (one - l) * (r * r))
            }
            Self::Quadratic => (j - one, one),
            Self::QuadraticLn => ((j - r).times(0.5), (one + r * r).times(0.5)),
        }
    }
}
