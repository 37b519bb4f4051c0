//! Passive stiffening: a passive law that rises faster with volume.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::ventricle::PassiveLaw as _;
use cardiotwin_units::Ml;
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of passive stiffening.
pub const EFFECT: Effect = Effect {
    name: "passive_stiffening",
    kind: Kind::Physiology,
    meaning: "The wall stiffens more steeply with stretch: flat early, steep at the end of filling.",
    equation: "b → m b in σ_p = s (e^{b E} − 1), s such that the passive pressure at the reference volume stays",
    source: "Our values. The typical factor agrees with stiffness constants of 0.03 in patients and 0.01 in healthy people (Zile, Baicu and Gaasch 2004, N Engl J Med 350:1953, abstract). The abstract of Guccione, McCulloch and Waldman 1991, J Biomech Eng 113:42, has no such factor",
    parameters: &[Parameter {
        name: "exponent_factor",
        unit: "1",
        meaning: "factor m of the exponent; the scale is a parameter of the base model",
        range: (1.0, 6.0),
        off: Some(1.0),
        smallest: 0.5,
        typical: 3.0,
        prior_scale: 1.5,
        role: Role::Strength,
    }],
    signature: "late filling: the pressure is steep at the end and filling stops abruptly; flat early",
    marks: &[
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Pressure,
            sign: Sign::Down,
        },
    ],
    confused_with: &["pericardial_constraint", "atrial_kick", "pressure_offset"],
    separated_by: &[
        Measurement::Loaded.words(),
        "fibrosis imaging (T1, extracellular volume)",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::PassiveExponents {
        factor: "exponent_factor",
    },
    hidden_because: None,
    remedy: None,
    action: Action::Wall(add),
};

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    let passive = &mut parts.passive;
    let volume = Ml(passive.end_diastolic_volume_ml);
    let before = passive.pressure(volume);
    passive.exponent *= values[0];
    passive.stiffness_kpa *= before.0 / passive.pressure(volume).0;
    Ok(parts)
}
