//! An effect with values for its parameters.

use super::{Effect, find};
use crate::circulation::CirculationError;
use crate::contraction::ContractionError;
use crate::ventricle::VentricleError;
use std::collections::BTreeMap;

/// An effect with a value for each parameter, in the order of its declaration.
#[derive(Debug, Clone)]
pub struct EffectSetting {
    /// The effect.
    pub effect: &'static Effect,
    /// Values of its parameters.
    pub values: Vec<f64>,
}

impl EffectSetting {
    /// The effect called `name` with parameters by name; those that are absent take their typical value, the strength
    /// must be given.
    ///
    /// # Errors
    /// [`EffectError`] for a name that the catalogue lacks, a missing strength, a value outside the range.
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

    /// Whether it adds nothing.
    #[must_use]
    pub fn is_off(&self) -> bool {
        self.effect.is_off(&self.values)
    }

    /// Its parameters by name.
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

/// Why an effect could not be added.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// The catalogue has no such effect.
    #[error("there is no effect `{found}`; the catalogue has {expected}")]
    Unknown {
        /// Name asked for.
        found: String,
        /// Names that there are.
        expected: String,
    },
    /// The effect has no such parameter.
    #[error("{effect} has no parameter `{found}`; it has {expected}")]
    UnknownParameter {
        /// Effect.
        effect: &'static str,
        /// Name asked for.
        found: String,
        /// Names that there are.
        expected: String,
    },
    /// The parameter that says how strong it is was not given.
    #[error("{effect} needs its strength {expected}")]
    NoStrength {
        /// Effect.
        effect: &'static str,
        /// Name of the parameter.
        expected: &'static str,
    },
    /// A number of values that is not that of the parameters.
    #[error("{effect}: {found} values for {expected} parameters")]
    Count {
        /// Effect.
        effect: &'static str,
        /// Values given.
        found: usize,
        /// Parameters.
        expected: usize,
    },
    /// A value outside the range.
    #[error("{effect}: {parameter} = {value} must be between {low} and {high}")]
    Range {
        /// Effect.
        effect: &'static str,
        /// Parameter.
        parameter: &'static str,
        /// Value.
        value: f64,
        /// Least.
        low: f64,
        /// Largest.
        high: f64,
    },
    /// The same effect twice.
    #[error("{effect} is there twice; give it once, with the parameters that hold")]
    Twice {
        /// Effect.
        effect: &'static str,
    },
    /// The circulation lacks what the effect acts on.
    #[error("{effect} acts on {part}, which this circulation does not have")]
    NoPart {
        /// Effect.
        effect: &'static str,
        /// Compartment or path.
        part: &'static str,
    },
    /// An effect of the measurement where only the heart is simulated.
    #[error("{effect} is an artefact of the measurement, not of the heart: {remedy}")]
    Artefact {
        /// Effect.
        effect: &'static str,
        /// What to do.
        remedy: &'static str,
    },
    /// A finite-element ventricle cannot take the effect over.
    #[error("{effect} cannot act in a finite-element ventricle: {why}")]
    NotInThreeDimensions {
        /// Effect.
        effect: &'static str,
        /// Why.
        why: &'static str,
    },
    /// An effect of the heart among corrections of the data.
    #[error(
        "{effect} is an effect of the heart: the data cannot be corrected for it, list it under `effects`"
    )]
    NoArtefact {
        /// Effect.
        effect: &'static str,
    },
    /// A part of the circulation could not be made.
    #[error("circulation with effects")]
    Circulation(#[from] CirculationError),
    /// The ventricle could not be made.
    #[error("ventricle with effects")]
    Ventricle(#[from] VentricleError),
    /// The contraction model could not be made.
    #[error("contraction with effects")]
    Contraction(#[from] ContractionError),
}
