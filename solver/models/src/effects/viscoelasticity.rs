//! Viscoelasticity: a viscous resistance of the wall.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::ventricle::CavityPressureTerm;
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of viscoelasticity.
pub const EFFECT: Effect = Effect {
    name: "viscoelasticity",
    kind: Kind::Physiology,
    meaning: "The wall resists the rate of its stretch.",
    equation: "P_lv gains η dV/dt (q η dV/dt while the volume falls)",
    source: "Our values. The abstract of Rankin et al. 1977, Circ Res 41:37 (a viscous element fits dogs better), does not have them. Land et al. 2017, J Mol Cell Cardiol 106:68, was not read",
    parameters: &[
        Parameter {
            name: "viscosity_mmHg_s_per_mL",
            unit: "mmHg s/mL",
            meaning: "viscosity η of the cavity",
            range: (0.0, 0.04),
            off: Some(0.0),
            smallest: 0.003,
            typical: 0.012,
            prior_scale: 0.008,
            role: Role::Strength,
        },
        Parameter {
            name: "shortening_share",
            unit: "1",
            meaning: "share q that acts while the volume falls; 0 for lengthening alone",
            range: (0.0, 1.0),
            off: None,
            smallest: 0.0,
            typical: 1.0,
            prior_scale: 0.3,
            role: Role::Held,
        },
    ],
    signature: "rapid filling: the pressure is above the passive curve in proportion to dV/dt and filling is slower, nothing in \
                diastasis; slightly lower pressure in ejection",
    marks: &[
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Pressure,
            sign: Sign::Down,
        },
    ],
    confused_with: &[
        "pressure_offset",
        "passive_stiffening",
        "delayed_relaxation",
    ],
    separated_by: &[
        Measurement::MitralFlow.words(),
        Measurement::Loaded.words(),
        "tissue Doppler (e')",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::MaterialTerm {
        how: "viscous fibre stress η_w dλ/dt, η_w = 9 η (V_ref + V_w/3)/ln(1 + V_w/V_ref) (kPa s, λ = 1 at V_ref)",
    },
    hidden_because: None,
    remedy: None,
    action: Action::Wall(add),
};

#[derive(Debug)]
struct Viscosity {
    mmhg_s_per_ml: f64,
    shortening_share: f64,
}

impl CavityPressureTerm for Viscosity {
    fn pressure(&self, _volume_ml: f64, rate_ml_per_s: f64) -> (f64, f64, f64) {
        let share = if rate_ml_per_s < 0.0 {
            self.shortening_share
        } else {
            1.0
        };
        let viscosity = share * self.mmhg_s_per_ml;
        (viscosity * rate_ml_per_s, 0.0, viscosity)
    }
}

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    parts.pressure_terms.push(Box::new(Viscosity {
        mmhg_s_per_ml: values[0],
        shortening_share: values[1],
    }));
    Ok(parts)
}
