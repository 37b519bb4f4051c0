//! Aortic regurgitation: a leak of the closed aortic valve.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::left_heart::AORTA;
use crate::circulation::{Circulation, Direction, Orifice};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of aortic regurgitation.
pub const EFFECT: Effect = Effect {
    name: "aortic_regurgitation",
    kind: Kind::Physiology,
    meaning: "The closed aortic valve lets blood back into the ventricle while it relaxes and fills.",
    equation: "Q = 50 A √(P_ao − P_lv) for P_ao > P_lv, into the ventricle (A in cm², Q in mL/s)",
    source: "Our values. A copy of the European table of grades has below 0.1 cm² for mild, from 0.3 cm² for severe. Zoghbi et al. 2017, J Am Soc Echocardiogr 30:303, and Gorlin and Gorlin 1951, Am Heart J 41:1, were not read",
    parameters: &[Parameter {
        name: "orifice_cm2",
        unit: "cm²",
        meaning: "effective regurgitant orifice area A",
        range: (0.0, 0.4),
        off: Some(0.0),
        smallest: 0.02,
        typical: 0.12,
        prior_scale: 0.1,
        role: Role::Strength,
    }],
    signature: "the volume rises in isovolumic relaxation and all diastole; the aortic pressure runs down faster, so the \
                valve opens at a lower pressure; wide pulse pressure of the cuff; stroke volume above the forward stroke volume",
    marks: &[
        Mark {
            phase: Phase::IsovolumicRelaxation,
            signal: Signal::VolumeRate,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::Diastasis,
            signal: Signal::VolumeRate,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::AtrialSystole,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::VolumeRate,
            sign: Sign::Down,
        },
    ],
    confused_with: &["mitral_regurgitation", "atrial_kick", "pressure_offset"],
    separated_by: &[
        Measurement::AorticFlow.words(),
        Measurement::Cuff.words(),
        "colour Doppler of the aortic valve",
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
    let aorta = circulation
        .compartment_idx(AORTA)
        .ok_or(EffectError::NoPart {
            effect: EFFECT.name,
            part: AORTA,
        })?;
    let leak = Orifice::new(EFFECT.name, values[0])?;
    circulation.connect(Box::new(leak), aorta, Direction::IntoVentricle);
    Ok(())
}
