//! Mitral regurgitation: a leak of the closed mitral valve.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::left_heart::LEFT_ATRIUM;
use crate::circulation::{Circulation, Direction, Orifice};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of mitral regurgitation.
pub const EFFECT: Effect = Effect {
    name: "mitral_regurgitation",
    kind: Kind::Physiology,
    meaning: "The closed mitral valve lets blood back into the left atrium while the ventricle contracts.",
    equation: "Q = 50 A √(P_lv − P_la) for P_lv > P_la, out of the ventricle (A in cm², Q in mL/s)",
    source: "Our values. A handbook's table of grades has below 0.2 cm² for mild, from 0.4 cm² for severe. Zoghbi et al. 2017, J Am Soc Echocardiogr 30:303, and Gorlin and Gorlin 1951, Am Heart J 41:1, were not read",
    parameters: &[Parameter {
        name: "orifice_cm2",
        unit: "cm²",
        meaning: "effective regurgitant orifice area A",
        range: (0.0, 0.6),
        off: Some(0.0),
        smallest: 0.04,
        typical: 0.2,
        prior_scale: 0.15,
        role: Role::Strength,
    }],
    signature: "the volume falls in isovolumic contraction and relaxation; ejection too fast against the afterload; stroke \
                volume above the forward stroke volume; no trace in the pressure alone",
    marks: &[
        Mark {
            phase: Phase::IsovolumicContraction,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
    ],
    confused_with: &[
        "ventricular_septal_defect",
        "volume_scaling",
        "pv_misalignment",
    ],
    separated_by: &[
        Measurement::MitralFlow.words(),
        Measurement::ForwardStrokeVolume.words(),
        "colour Doppler of the mitral valve",
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: None,
    remedy: None,
    action: Action::Circulation(add),
};

fn add(
    values: &[f64],
    _around: &Surroundings,
    circulation: &mut Circulation,
) -> Result<(), EffectError> {
    let atrium = circulation
        .compartment_idx(LEFT_ATRIUM)
        .ok_or(EffectError::NoPart {
            effect: EFFECT.name,
            part: LEFT_ATRIUM,
        })?;
    let leak = Orifice::new(EFFECT.name, values[0])?;
    circulation.connect(Box::new(leak), atrium, Direction::OutOfVentricle);
    Ok(())
}
