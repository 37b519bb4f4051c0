//! Declaration of an effect in the catalogue.

use super::measurement::MeasurementTerm;
use super::{EffectError, Surroundings};
use crate::circulation::Circulation;
use crate::ventricle::{ActivationGroups, CavityPressureTerm, GroupContraction, OneFibrePassive};
use serde::Serialize;

/// Origin of an effect: the heart or the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// The effect belongs to heart and vessels: the model is changed.
    Physiology,
    /// The effect belongs to the measurement: the data should be corrected, not the heart.
    Artefact,
}

/// Treatment of a parameter in a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// The strength. Its distance from the off-value is the magnitude of the effect.
    Strength,
    /// A parameter that is fitted together with the strength.
    Shape,
    /// A parameter that keeps its typical value unless the user sets another one.
    Held,
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parameter {
    /// Key in files, with the unit.
    pub name: &'static str,
    /// Unit, `1` for a dimensionless number.
    pub unit: &'static str,
    /// Meaning of the parameter.
    pub meaning: &'static str,
    /// Plausible range; a fit stays inside.
    pub range: (f64, f64),
    /// Value at which the parameter has no effect, if there is one. The effect is off if all
    /// parameters with an off-value are at it.
    pub off: Option<f64>,
    /// Distance from the off-value below which the effect is not named; zero for a parameter that
    /// does not decide this.
    pub smallest: f64,
    /// Typical value if the effect is present.
    pub typical: f64,
    /// Standard deviation of the prior around the typical value (around the off-value for a
    /// strength).
    pub prior_scale: f64,
    /// Treatment in a fit.
    pub role: Role,
}

impl Parameter {
    /// Whether a value has no effect.
    #[must_use]
    pub fn is_off(&self, value: f64) -> bool {
        self.off == Some(value)
    }

    /// Range extended to the off-value, which files may contain.
    #[must_use]
    pub fn accepted(&self) -> (f64, f64) {
        let (low, high) = self.range;
        self.off
            .map_or((low, high), |off| (low.min(off), high.max(off)))
    }
}

/// Transfer of an effect to a finite-element ventricle. Names of parameters are those of the
/// declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "way", rename_all = "kebab-case")]
pub enum InThreeDimensions {
    /// The circulation, contraction, cavity pressure or measurement object is used without change.
    AsItIs,
    /// Part of the wall is activated later.
    ActivationMap {
        /// Derivation of the activation map from the parameters.
        how: &'static str,
    },
    /// All exponents of Guccione's law are multiplied by a parameter; step 0 fits the scale of the
    /// law again.
    PassiveExponents {
        /// Name of the parameter.
        factor: &'static str,
    },
    /// The material law has an additional term.
    MaterialTerm {
        /// Derivation of the term from the parameters.
        how: &'static str,
    },
    /// The effect cannot be transferred.
    Cannot {
        /// Reason, as the end of a sentence.
        why: &'static str,
    },
}

/// Parts of a one-fibre ventricle that an effect may change before it is built.
#[derive(Debug)]
pub struct OneFibreParts {
    /// Passive fibre law and reference volumes.
    pub passive: OneFibrePassive,
    /// Activation times and weights of the groups.
    pub groups: ActivationGroups,
    /// Active stress, which [`GroupContraction::wrapped`] changes.
    pub contraction: GroupContraction,
    /// Additional terms of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
}

/// Changes a circulation; parameters are in the order of the declaration.
pub type ChangeCirculation = fn(&[f64], &Surroundings, &mut Circulation) -> Result<(), EffectError>;
/// Changes a one-fibre ventricle; parameters are in the order of the declaration.
pub type ChangeWall =
    fn(&[f64], &Surroundings, OneFibreParts) -> Result<OneFibreParts, EffectError>;
/// Creates a measurement term; parameters are in the order of the declaration.
pub type ChangeMeasurement = fn(&[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError>;

/// Part of the model that an effect acts on.
#[derive(Debug, Clone, Copy)]
pub enum Action {
    /// The effect acts on the circulation of any ventricle.
    Circulation(ChangeCirculation),
    /// The effect acts on the wall of the one-fibre ventricle; [`Effect::in_3d`] describes the
    /// counterpart in the finite-element ventricle.
    Wall(ChangeWall),
    /// The effect acts on the measured traces.
    Measurement(ChangeMeasurement),
}

/// Direction in which a trace moves when an effect is switched on and the base does not change.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// The trace lies higher with the effect.
    Up,
    /// The trace lies lower with the effect.
    Down,
}

/// Phases of a beat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// From the closing of the mitral valve to the opening of the aortic valve.
    IsovolumicContraction,
    /// First half of ejection.
    EarlyEjection,
    /// Second half of ejection.
    LateEjection,
    /// From the closing of the aortic valve to the opening of the mitral valve.
    IsovolumicRelaxation,
    /// First third of filling.
    RapidFilling,
    /// Between rapid filling and atrial systole.
    Diastasis,
    /// Last part of filling.
    AtrialSystole,
}

/// Signal that an effect changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Signal {
    /// Pressure in the cavity.
    Pressure,
    /// Rate of the cavity's pressure.
    PressureRate,
    /// Volume of the cavity.
    Volume,
    /// Rate of the cavity's volume.
    VolumeRate,
}

/// One element of a signature: a difference between traces with and without the effect, all else
/// equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Mark {
    /// Phase of the difference.
    pub phase: Phase,
    /// Signal that differs in the phase.
    pub signal: Signal,
    /// Direction of the difference, on average over the phase.
    pub sign: Sign,
}

/// Prior odds of an effect whose frequency among patients is not stated. With fifteen such effects,
/// three patients in four have at least one.
pub const ONE_OF_MANY: f64 = 0.1;

/// An entry of the catalogue.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Effect {
    /// Name in files and tables.
    pub name: &'static str,
    /// Origin of the effect.
    pub kind: Kind,
    /// Meaning, in one sentence.
    pub meaning: &'static str,
    /// Equation in the form in which it is computed.
    pub equation: &'static str,
    /// Publications on the effect, and what was read in them, in sentences without the last full stop.
    pub source: &'static str,
    /// Parameters, the strength first.
    pub parameters: &'static [Parameter],
    /// Disagreement of a refitted base model with data that contain the effect.
    pub signature: &'static str,
    /// Differences of the traces when the effect is switched on at its typical values, all else
    /// equal.
    pub marks: &'static [Mark],
    /// Effects with similar traces.
    pub confused_with: &'static [&'static str],
    /// Measurements that would show the effect or distinguish it from those.
    pub separated_by: &'static [&'static str],
    /// Odds that a patient has the effect, before the data: [`ONE_OF_MANY`] unless
    /// [`Effect::source`] names another frequency.
    pub prior_odds: f64,
    /// Transfer to a finite-element ventricle.
    pub in_3d: InThreeDimensions,
    /// Reason why pressure and volume of one ventricle cannot show the effect even in principle;
    /// `None` if they can.
    pub hidden_because: Option<&'static str>,
    /// Remedy for an artefact.
    pub remedy: Option<&'static str>,
    /// Change that the effect makes.
    #[serde(skip)]
    pub action: Action,
}

impl Effect {
    /// Strength, the first parameter.
    #[must_use]
    pub fn strength(&self) -> &'static Parameter {
        &self.parameters[0]
    }

    /// Whether these values have no effect: each parameter with an off-value is at it.
    #[must_use]
    pub fn is_off(&self, values: &[f64]) -> bool {
        self.parameters
            .iter()
            .zip(values)
            .all(|(p, value)| p.off.is_none() || p.is_off(*value))
    }

    /// Values without an effect; typical ones for parameters without an off-value.
    #[must_use]
    pub fn off(&self) -> Vec<f64> {
        self.parameters
            .iter()
            .map(|p| p.off.unwrap_or(p.typical))
            .collect()
    }

    /// Typical values of all parameters.
    #[must_use]
    pub fn typical(&self) -> Vec<f64> {
        self.parameters.iter().map(|p| p.typical).collect()
    }
}
