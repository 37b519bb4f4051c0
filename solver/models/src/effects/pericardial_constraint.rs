//! Pericardial constraint, as a function of the left ventricle alone.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, OneFibreParts, Parameter, Phase,
    Role, Sign, Signal,
};
use super::{EffectError, Surroundings};
use crate::ventricle::CavityPressureTerm;
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the pericardial constraint.
pub const EFFECT: Effect = Effect {
    name: "pericardial_constraint",
    kind: Kind::Physiology,
    meaning: "The pericardium presses on the heart from outside as it fills.",
    equation: "P_lv gains p exp((V − V_ref)/(c V_ref)), V_ref the volume of end-diastole",
    source: "Our values. The abstract of Freeman and LeWinter 1984, Circ Res 54:294 (pericardium of dogs), does not have them. Conscious dogs have 2 to 4 mmHg at end-diastole (Tyson et al. 1984, Circ Res 54:173, abstract). Sun et al. 1997, Am J Physiol 272:H1499, was not read",
    parameters: &[
        Parameter {
            name: "pressure_mmHg",
            unit: "mmHg",
            meaning: "pericardial pressure p at end-diastole",
            range: (0.0, 15.0),
            off: Some(0.0),
            smallest: 2.0,
            typical: 6.0,
            prior_scale: 4.0,
            role: Role::Strength,
        },
        Parameter {
            name: "volume_scale",
            unit: "1",
            meaning: "volume c over which it grows e-fold, as a share of the end-diastolic volume",
            range: (0.05, 1.0),
            off: None,
            smallest: 0.0,
            typical: 0.3,
            prior_scale: 0.2,
            role: Role::Shape,
        },
    ],
    signature: "diastole only: the passive curve is shifted and straightened, dip and plateau",
    marks: &[
        Mark {
            phase: Phase::RapidFilling,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::AtrialSystole,
            signal: Signal::Volume,
            sign: Sign::Down,
        },
    ],
    confused_with: &["pressure_offset", "passive_stiffening", "viscoelasticity"],
    separated_by: &[
        Measurement::Loaded.words(),
        "right-atrial pressure",
        "volumes of the other chambers",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Wall(add),
};

#[derive(Debug)]
struct Pericardium {
    pressure_mmhg: f64,
    reference_ml: f64,
    scale_ml: f64,
}

impl CavityPressureTerm for Pericardium {
    fn pressure(&self, volume_ml: f64, _rate_ml_per_s: f64) -> (f64, f64, f64) {
        // The exponent is limited: an extreme candidate gives a large pressure, not an infinite
        // one.
        let pressure = self.pressure_mmhg
            * ((volume_ml - self.reference_ml) / self.scale_ml)
                .min(50.0)
                .exp();
        (pressure, pressure / self.scale_ml, 0.0)
    }
}

fn add(
    values: &[f64],
    _around: &Surroundings,
    mut parts: OneFibreParts,
) -> Result<OneFibreParts, EffectError> {
    let reference_ml = parts.passive.end_diastolic_volume_ml;
    let term = Pericardium {
        pressure_mmhg: values[0],
        reference_ml,
        scale_ml: values[1] * reference_ml,
    };
    parts.pressure_terms.push(Box::new(term));
    Ok(parts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grows_e_fold_over_its_scale() {
        let term = Pericardium {
            pressure_mmhg: 6.0,
            reference_ml: 150.0,
            scale_ml: 45.0,
        };
        assert_eq!(term.pressure(150.0, 80.0).0, 6.0);
        assert!((term.pressure(195.0, 0.0).0 / 6.0 - 1f64.exp()).abs() < 1e-12);
        let slope = (term.pressure(140.001, 0.0).0 - term.pressure(139.999, 0.0).0) / 0.002;
        assert!((slope - term.pressure(140.0, 0.0).1).abs() < 1e-8);
    }
}
