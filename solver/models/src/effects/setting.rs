//! An effect with values for its parameters.

use super::{Effect, EffectError, find};
use std::collections::BTreeMap;

/// An effect with a value for each parameter, in the order of its declaration.
#[derive(Debug, Clone)]
pub struct EffectSetting {
    /// Entry of the catalogue.
    pub effect: &'static Effect,
    /// Values of its parameters.
    pub values: Vec<f64>,
}

impl EffectSetting {
    /// Creates the setting of the effect `name` from parameters by name. Absent parameters take
    /// their typical value, except for the strength, which is required.
    ///
    /// # Errors
    /// [`EffectError`] if the catalogue lacks the name, the strength is missing, or a value is
    /// outside its range.
    pub fn named(name: &str, parameters: &BTreeMap<String, f64>) -> Result<Self, EffectError> {
        let effect = find(name)?;
        if let Some(found) = parameters
            .keys()
            .find(|key| effect.parameters.iter().all(|p| p.name != key.as_str()))
        {
            return Err(EffectError::UnknownParameter {
                effect: effect.name,
                found: found.clone(),
                expected: effect
                    .parameters
                    .iter()
                    .map(|p| p.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            });
        }
        let strength = effect.strength().name;
        if !parameters.contains_key(strength) {
            return Err(EffectError::NoStrength {
                effect: effect.name,
                expected: strength,
            });
        }
        let values = effect
            .parameters
            .iter()
            .map(|p| parameters.get(p.name).copied().unwrap_or(p.typical))
            .collect();
        let setting = Self { effect, values };
        setting.check()?;
        Ok(setting)
    }

    /// The effect at its typical values.
    #[must_use]
    pub fn typical(effect: &'static Effect) -> Self {
        Self {
            effect,
            values: effect.typical(),
        }
    }

    /// Whether the values have no effect.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.effect.is_off(&self.values)
    }

    /// Values of the parameters by name, in the units of the declaration.
    #[must_use]
    pub fn parameters(&self) -> BTreeMap<String, f64> {
        self.effect
            .parameters
            .iter()
            .zip(&self.values)
            .map(|(p, value)| (p.name.to_owned(), *value))
            .collect()
    }

    /// Checks number and ranges of the values.
    ///
    /// # Errors
    /// [`EffectError::Range`] or [`EffectError::Count`].
    pub fn check(&self) -> Result<(), EffectError> {
        let effect = self.effect.name;
        if self.values.len() != self.effect.parameters.len() {
            return Err(EffectError::Count {
                effect,
                found: self.values.len(),
                expected: self.effect.parameters.len(),
            });
        }
        for (p, value) in self.effect.parameters.iter().zip(&self.values) {
            let (low, high) = p.accepted();
            if !(*value >= low && *value <= high) {
                return Err(EffectError::Range {
                    effect,
                    parameter: p.name,
                    value: *value,
                    low,
                    high,
                });
            }
        }
        Ok(())
    }
}
