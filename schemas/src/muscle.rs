//! Tissue of the wall: passive tissue by the mesh's tags. The laws of muscle are part of the vocabulary.

use std::collections::BTreeMap;

pub use cardiotwin_vocabulary::passive_law::{
    ActiveConvention, Guccione, HolzapfelOgden, MuscleLaw, NeoHookean,
};
use schemars::JsonSchema;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

/// Neo-Hookean tissue without contraction, for one tag of the mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PassiveTissueSettings {
    /// Shear modulus of the tissue.
    #[serde(rename = "mu_kPa")]
    #[schemars(extend("exclusiveMinimum" = 0.0, "maximum" = 1e5))]
    pub mu_kpa: f64,
    /// Bulk modulus of the tissue.
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
