//! Catalogue of effects that the base model lacks: effects of heart and vessels, and artefacts of
//! the measurement.
//!
//! Each effect is one file with its declaration ([`Effect`]) and one entry of [`CATALOGUE`];
//! [`assemble`] adds any list of effects to a base model. Every state of an effect belongs to the
//! circulation or to the ventricle, so that steps are tried, rolled back, saved and restored as
//! without the effect.

mod aortic_regurgitation;
mod aortic_stenosis;
mod assembly;
mod atrial_kick;
mod catheter_response;
mod cross_fibre_stress;
mod declaration;
mod delayed_relaxation;
mod dyssynchrony;
mod error;
pub mod measurement;
mod mitral_regurgitation;
mod passive_stiffening;
mod pericardial_constraint;
mod pressure_offset;
mod pv_misalignment;
mod setting;
mod surroundings;
mod three_dimensions;
mod ventricular_septal_defect;
mod viscoelasticity;
mod volume_scaling;
mod wave_reflection;

pub use assembly::{Assembled, BaseModel, add_to_circulation, assemble, measurement};
pub use declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
pub use error::EffectError;
pub use measurement::{Measurement, MeasurementTerm, PeriodicTraces};
pub use setting::EffectSetting;
pub use surroundings::Surroundings;
pub use three_dimensions::{FibreViscosity, InThreeDimensionsParts, LatePart, in_three_dimensions};

/// Declares [`CATALOGUE`] from the names of the effects' files.
macro_rules! catalogue {
    ($($effect:ident;)*) => {
        /// All effects, physiology first.
        pub const CATALOGUE: [&Effect; [$(stringify!($effect)),*].len()] = [$(&$effect::EFFECT),*];
    };
}

catalogue! {
    atrial_kick;
    mitral_regurgitation;
    aortic_regurgitation;
    aortic_stenosis;
    wave_reflection;
    delayed_relaxation;
    passive_stiffening;
    ventricular_septal_defect;
    pericardial_constraint;
    dyssynchrony;
    viscoelasticity;
    cross_fibre_stress;
    catheter_response;
    pv_misalignment;
    pressure_offset;
    volume_scaling;
}

/// Finds an effect by its name.
///
/// # Errors
/// [`EffectError::Unknown`] with the names in the catalogue.
pub fn find(name: &str) -> Result<&'static Effect, EffectError> {
    CATALOGUE
        .into_iter()
        .find(|effect| effect.name == name)
        .ok_or_else(|| EffectError::Unknown {
            found: name.to_owned(),
            expected: CATALOGUE.map(|effect| effect.name).join(", "),
        })
}

#[cfg(test)]
mod tests;
