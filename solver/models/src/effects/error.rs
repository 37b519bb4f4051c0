//! Reasons why an effect could not be added.

use crate::circulation::CirculationError;
use crate::contraction::ContractionError;
use crate::ventricle::VentricleError;

/// Reasons why an effect could not be added.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EffectError {
    /// The catalogue has no effect of this name.
    #[error("unknown effect `{found}`, expected one of {expected}")]
    Unknown {
        /// Name that was asked for.
        found: String,
        /// Names in the catalogue.
        expected: String,
    },
    /// The effect has no parameter of this name.
    #[error("{effect} has no parameter `{found}`; it has {expected}")]
    UnknownParameter {
        /// Name of the effect.
        effect: &'static str,
        /// Name that was asked for.
        found: String,
        /// Names of its parameters.
        expected: String,
    },
    /// The strength of the effect was not given.
    #[error("{effect} needs its strength {expected}")]
    NoStrength {
        /// Name of the effect.
        effect: &'static str,
        /// Name of the strength parameter.
        expected: &'static str,
    },
    /// The number of values differs from the number of parameters.
    #[error("{effect}: {found} values for {expected} parameters")]
    Count {
        /// Name of the effect.
        effect: &'static str,
        /// Number of values that were given.
        found: usize,
        /// Number of parameters of the effect.
        expected: usize,
    },
    /// A value is outside its range.
    #[error("{effect}: {parameter} = {value} must be between {low} and {high}")]
    Range {
        /// Name of the effect.
        effect: &'static str,
        /// Name of the parameter.
        parameter: &'static str,
        /// Value that was given, in the parameter's unit.
        value: f64,
        /// Smallest admissible value.
        low: f64,
        /// Largest admissible value.
        high: f64,
    },
    /// The list contains an effect twice.
    #[error("{effect} is listed twice; list it once")]
    Twice {
        /// Name of the effect.
        effect: &'static str,
    },
    /// The circulation lacks the part that the effect acts on.
    #[error("{effect} acts on {part}, which this circulation does not have")]
    NoPart {
        /// Name of the effect.
        effect: &'static str,
        /// Missing compartment or path.
        part: &'static str,
    },
    /// An effect of the measurement was given where only the heart is simulated.
    #[error("{effect} is an artefact of the measurement, not of the heart: {remedy}")]
    Artefact {
        /// Name of the effect.
        effect: &'static str,
        /// Correction of the data that replaces the effect.
        remedy: &'static str,
    },
    /// The effect cannot be transferred to a finite-element ventricle.
    #[error("{effect} cannot act in a finite-element ventricle: {why}")]
    NotInThreeDimensions {
        /// Name of the effect.
        effect: &'static str,
        /// Reason, as the end of a sentence.
        why: &'static str,
    },
    /// The corrections of the data contain an effect of the heart.
    #[error(
        "{effect} is an effect of the heart: the data cannot be corrected for it, list it under `effects`"
    )]
    NoArtefact {
        /// Name of the effect.
        effect: &'static str,
    },
    /// A part of the circulation could not be created.
    #[error("invalid circulation with effects")]
    Circulation(#[from] CirculationError),
    /// The ventricle could not be created.
    #[error("invalid ventricle with effects")]
    Ventricle(#[from] VentricleError),
    /// The contraction model could not be created.
    #[error("invalid contraction model with effects")]
    Contraction(#[from] ContractionError),
}
