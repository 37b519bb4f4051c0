//! Serialisation of costs. JSON has no infinity, but the infinite cost of a failed evaluation must
//! survive storage.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Replaces a cost that is not finite by infinity, the worst cost.
pub(crate) fn worst_if_not_finite(cost: f64) -> f64 {
    if cost.is_finite() {
        cost
    } else {
        f64::INFINITY
    }
}

/// Serialises a list of costs with null for infinity.
pub(crate) mod costs {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(
        costs: &[f64],
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let finite: Vec<Option<f64>> = costs.iter().map(|c| c.is_finite().then_some(*c)).collect();
        finite.serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Vec<f64>, D::Error> {
        let costs = Vec::<Option<f64>>::deserialize(deserializer)?;
        Ok(costs
            .into_iter()
            .map(|c| c.unwrap_or(f64::INFINITY))
            .collect())
    }
}

/// Serialises one cost with null for infinity.
pub(crate) mod cost {
    use super::*;

    pub(crate) fn serialize<S: Serializer>(cost: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        cost.is_finite().then_some(*cost).serialize(serializer)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        Ok(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::INFINITY))
    }
}
