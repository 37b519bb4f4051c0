//! What an entry of the catalogue declares about itself.

use super::measurement::MeasurementTerm;
use super::{EffectError, Surroundings};
use crate::circulation::Circulation;
use crate::ventricle::{ActivationGroups, CavityPressureTerm, GroupContraction, OneFibrePassive};
use serde::Serialize;

/// Whether an effect is one of the heart or of the measurement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Kind {
    /// Of heart and vessels: the model is changed.
    Physiology,
    /// Of the measurement: the data are to be corrected, not the heart.
    Artefact,
}

/// What a fit does with a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Role {
    /// Strength: its distance from the off-value is the size of the effect.
    Strength,
    /// Fitted together with the strength.
    Shape,
    /// Held at its typical value unless the user gives another.
    Held,
}

/// One parameter of an effect.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Parameter {
    /// Key in files, with the unit.
    pub name: &'static str,
    /// Unit, `1` for a pure number.
    pub unit: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Plausible values; a fit stays inside.
    pub range: (f64, f64),
    /// Value at which it adds nothing, where it has one. The effect is off where all that have one are at it.
    pub off: Option<f64>,
    /// Distance from the off-value below which the effect is not to be named; zero where that says nothing.
    pub smallest: f64,
    /// A typical value where the effect is present.
    pub typical: f64,
    /// Standard deviation of the prior around the typical value (around the off-value for a strength).
    pub prior_scale: f64,
    /// What a fit does with it.
    pub role: Role,
}

impl Parameter {
    /// Whether a value adds nothing.
    #[must_use]
    pub fn is_off(&self, value: f64) -> bool {
        self.off == Some(value)
    }

    /// Range with the off-value: what is accepted in files.
    #[must_use]
    pub fn accepted(&self) -> (f64, f64) {
        let (low, high) = self.range;
        self.off
            .map_or((low, high), |off| (low.min(off), high.max(off)))
    }
}

/// How a finite-element ventricle takes an effect over. Names of parameters are those of the declaration.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(tag = "way", rename_all = "kebab-case")]
pub enum InThreeDimensions {
    /// The same circulation, contraction, cavity pressure or measurement object.
    AsItIs,
    /// Activation times of part of the wall are later.
    ActivationMap {
        /// How the map follows from the parameters.
        how: &'static str,
    },
    /// All exponents of Guccione's law times a parameter; its scale is fitted anew in step 0.
    PassiveExponents {
        /// The parameter.
        factor: &'static str,
    },
    /// A term of the material law.
    MaterialTerm {
        /// How the term follows from the parameters.
        how: &'static str,
    },
    /// It cannot be taken over.
    Cannot {
        /// Why.
        why: &'static str,
    },
}

/// The parts of a one-fibre ventricle that an effect may change before it is built.
#[derive(Debug)]
pub struct OneFibreParts {
    /// Passive law.
    pub passive: OneFibrePassive,
    /// Activation times and weights.
    pub groups: ActivationGroups,
    /// Active stress; [`GroupContraction::wrapped`] changes it.
    pub contraction: GroupContraction,
    /// Further parts of the cavity pressure.
    pub pressure_terms: Vec<Box<dyn CavityPressureTerm>>,
}

/// Changes a circulation; parameters in the order of the declaration.
pub type ChangeCirculation = fn(&[f64], &Surroundings, &mut Circulation) -> Result<(), EffectError>;
/// Changes a one-fibre ventricle.
pub type ChangeWall =
    fn(&[f64], &Surroundings, OneFibreParts) -> Result<OneFibreParts, EffectError>;
/// Makes what stands between heart and data.
pub type ChangeMeasurement = fn(&[f64]) -> Result<Box<dyn MeasurementTerm>, EffectError>;

/// Where an effect acts.
#[derive(Debug, Clone, Copy)]
pub enum Action {
    /// On the circulation, whichever ventricle it belongs to.
    Circulation(ChangeCirculation),
    /// On the wall of the one-fibre ventricle; [`Effect::in_3d`] says what the finite-element ventricle does instead.
    Wall(ChangeWall),
    /// On the measured traces.
    Measurement(ChangeMeasurement),
}

/// Which way a trace moves where an effect is switched on and the base stays as it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sign {
    /// Up.
    Up,
    /// Down.
    Down,
}

/// Phases of a beat.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Isovolumic contraction.
    IsovolumicContraction,
    /// First half of ejection.
    EarlyEjection,
    /// Second half of ejection.
    LateEjection,
    /// Isovolumic relaxation.
    IsovolumicRelaxation,
    /// First third of filling.
    RapidFilling,
    /// Between rapid filling and atrial systole.
    Diastasis,
    /// Last part of filling.
    AtrialSystole,
}

/// What moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Signal {
    /// Cavity pressure.
    Pressure,
    /// Rate of cavity pressure.
    PressureRate,
    /// Cavity volume.
    Volume,
    /// Rate of cavity volume.
    VolumeRate,
}

/// One place of the signature: where the trace with the effect differs from that without it, everything else equal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Mark {
    /// When.
    pub phase: Phase,
    /// What.
    pub signal: Signal,
    /// Which way, on average over the phase.
    pub sign: Sign,
}

/// An entry of the catalogue.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Effect {
    /// Name in files and tables.
    pub name: &'static str,
    /// Of heart or measurement.
    pub kind: Kind,
    /// What it is, in one sentence.
    pub meaning: &'static str,
    /// The equation as it is computed.
    pub equation: &'static str,
    /// Literature.
    pub source: &'static str,
    /// Parameters, the strength first.
    pub parameters: &'static [Parameter],
    /// Where a refitted base model disagrees with data that have the effect.
    pub signature: &'static str,
    /// Where the traces move when the effect is switched on, at the typical values and at everything else equal.
    pub marks: &'static [Mark],
    /// Effects that leave similar traces.
    pub confused_with: &'static [&'static str],
    /// Measurements that would show it, or tell it from those.
    pub separated_by: &'static [&'static str],
    /// How a finite-element ventricle takes it over.
    pub in_3d: InThreeDimensions,
    /// Why pressure and volume of one ventricle cannot show it, where they cannot even in principle.
    pub hidden_because: Option<&'static str>,
    /// What to do about an artefact.
    pub remedy: Option<&'static str>,
    /// What it does.
    #[serde(skip)]
    pub action: Action,
}

impl Effect {
    /// The strength: the first parameter.
    #[must_use]
    pub fn strength(&self) -> &'static Parameter {
        &self.parameters[0]
    }

    /// Whether these values add nothing: each that has an off-value is at it.
    #[must_use]
    pub fn is_off(&self, values: &[f64]) -> bool {
        self.parameters
            .iter()
            .zip(values)
            .all(|(p, value)| p.off.is_none() || p.is_off(*value))
    }

    /// Values at which it adds nothing; typical ones where a parameter has no off-value.
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
