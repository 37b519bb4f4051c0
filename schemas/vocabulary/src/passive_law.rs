//! Passive laws of muscle with their constants, and the conventions of active stress. `cardiotwin-mechanics` has the
//! equations, one file for each law.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Passive law of muscle. Step 0 fits one factor on all its moduli and, if the law has exponents,
/// one factor on all exponents.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum MuscleLaw {
    /// Guccione et al. 1995, with `guccione_C_kPa`, `b_f`, `b_t`, `b_fs`.
    #[default]
    Guccione,
    /// Holzapfel and Ogden 2009, with the table `holzapfel_ogden`.
    HolzapfelOgden,
    /// Neo-Hookean, with `neo_hookean_mu_kPa`. Without exponents it can match one volume, not two.
    NeoHookean,
}

/// Constants of Holzapfel and Ogden's law. The defaults are those of the benchmark of Aróstica et
/// al. 2025, by name of Holzapfel and Ogden 2009, which was not read.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HolzapfelOgden {
    /// Modulus of the ground substance, at which the search begins. It is also the stiffness
    /// reported for the law.
    #[serde(rename = "a_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub a_kpa: f64,
    /// Exponent of the ground substance.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b: f64,
    /// Modulus along the fibre.
    #[serde(rename = "a_f_kPa")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e4))]
    pub a_f_kpa: f64,
    /// Exponent along the fibre.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_f: f64,
    /// Modulus along the sheet.
    #[serde(rename = "a_s_kPa")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e4))]
    pub a_s_kpa: f64,
    /// Exponent along the sheet.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_s: f64,
    /// Modulus of shear between fibre and sheet.
    #[serde(rename = "a_fs_kPa")]
    #[schemars(extend("minimum" = 0.0, "maximum" = 1e4))]
    pub a_fs_kpa: f64,
    /// Exponent of shear between fibre and sheet.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e3))]
    pub b_fs: f64,
    /// Steepness of the switch: fibres and sheets carry load only in extension.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e4))]
    pub switch: f64,
}

impl HolzapfelOgden {
    /// The constants of Aróstica et al. 2025, CMAME 435:117485, as a participant's program has them.
    #[must_use]
    pub const fn arostica2025() -> Self {
        Self {
            a_kpa: 0.059,
            b: 8.023,
            a_f_kpa: 18.472,
            b_f: 16.026,
            a_s_kpa: 2.481,
            b_s: 11.12,
            a_fs_kpa: 0.216,
            b_fs: 11.436,
            switch: 100.0,
        }
    }
}

impl Default for HolzapfelOgden {
    fn default() -> Self {
        Self::arostica2025()
    }
}

/// Constants of Guccione's law. A cohort gives them as keys of the wall.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Guccione {
    /// Stiffness `C`, a factor on all stress \[kPa\].
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
    pub const fn guccione1995(c_kpa: f64) -> Self {
        Self {
            c_kpa,
            b_f: 18.48,
            b_t: 3.58,
            b_fs: 1.627,
        }
    }
}

/// Constant of the neo-Hookean law.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct NeoHookean {
    /// Shear modulus `µ` \[kPa\].
    pub mu_kpa: f64,
}

/// Stress tensor that the stress `Ta` of the contraction model enters; it determines the area to
/// which the force refers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ActiveConvention {
    /// `S = Ta/λ² f⊗f`, the paper's convention.
    #[default]
    PerSquaredStretch,
    /// `S = Ta/λ f⊗f`: force per reference area.
    FirstPiola,
    /// `S = Ta f⊗f`, the convention of the mechanics benchmarks.
    SecondPiola,
}
