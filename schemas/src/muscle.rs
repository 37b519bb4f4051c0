//! Laws of the wall's tissue: materials of muscle and passive parts, and the direction of active
//! stress.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

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

/// Constants of Holzapfel and Ogden's law. The defaults are those of Holzapfel and Ogden 2009 for
/// the shear tests of Dokos et al. 2002.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct HolzapfelOgdenSettings {
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
    /// Steepness of the switch by which fibres and sheets carry load only in extension.
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e4))]
    pub switch: f64,
}

impl Default for HolzapfelOgdenSettings {
    fn default() -> Self {
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

/// Neo-Hookean tissue without contraction, for one tag of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PassiveTissueSettings {
    /// Shear modulus.
    #[serde(rename = "mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub mu_kpa: f64,
    /// Bulk modulus.
    #[serde(rename = "kappa_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e8))]
    pub kappa_kpa: f64,
}

/// Passive tissues by element tag.
pub type PassiveTissues = BTreeMap<i32, PassiveTissueSettings>;

/// Reads tissues with text tags. JSON has only text keys, and serde does not convert them to
/// numbers inside an internally tagged enum.
pub(crate) fn by_tag<'de, D: Deserializer<'de>>(from: D) -> Result<PassiveTissues, D::Error> {
    let named = BTreeMap::<String, PassiveTissueSettings>::deserialize(from)?;
    let tag = |name: &str| {
        name.parse()
            .map_err(|_| D::Error::custom(format!("{name:?} is no tag, expected a whole number")))
    };
    named
        .iter()
        .map(|(name, tissue)| Ok((tag(name)?, *tissue)))
        .collect()
}

#[cfg(test)]
mod tests {
    use crate::finite_element::WallSettings;

    use super::*;

    #[test]
    fn tissues_by_tag_come_back_from_within_a_task() {
        /// An internally tagged enum, like a task.
        #[derive(Debug, PartialEq, Serialize, Deserialize)]
        #[serde(tag = "kind")]
        enum Task {
            Wall(WallSettings),
        }
        let mut wall = WallSettings::default();
        wall.passive.insert(
            -7,
            PassiveTissueSettings {
                mu_kpa: 5.0,
                kappa_kpa: 300.0,
            },
        );
        let task = Task::Wall(wall);
        let text = serde_json::to_string(&task).unwrap();
        assert!(text.contains(r#""passive":{"-7":{"#), "{text}");
        assert_eq!(serde_json::from_str::<Task>(&text).unwrap(), task);
        let error = serde_json::from_str::<Task>(&text.replace("-7", "seven"))
            .unwrap_err()
            .to_string();
        assert!(error.contains("\"seven\" is no tag"), "{error}");
    }
}
