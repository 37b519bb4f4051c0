//! Wave reflection: two arterial compartments with an inertance between them, for coarctation and
//! reflected waves.

use super::declaration::{
    Action, Effect, InThreeDimensions, Kind, Mark, ONE_OF_MANY, Parameter, Phase, Role, Sign,
    Signal,
};
use super::{EffectError, Surroundings};
use crate::circulation::left_heart::AORTA;
use crate::circulation::{ArterialJunction, Circulation, SplitWindkessel};
use cardiotwin_vocabulary::measurements::Measurement;

/// Catalogue entry of the wave reflection.
pub const EFFECT: Effect = Effect {
    name: "wave_reflection",
    kind: Kind::Physiology,
    meaning: "Inertia or a narrowing between proximal and distal arteries sends part of the ejected wave back.",
    equation: "C split f : 1 − f, between them L dQ/dt = P_1 − P_2 − R_l Q − K Q|Q|",
    source: "Our values. The abstracts of Stergiopulos et al. 1999, Am J Physiol 276:H81 (inertance next to the Windkessel), and Westerhof et al. 2009, Med Biol Eng Comput 47:131, do not have them",
    parameters: &[
        Parameter {
            name: "inertance_mmHg_s2_per_mL",
            unit: "mmHg s²/mL",
            meaning: "inertance L between the two parts",
            range: (0.0, 0.03),
            off: Some(0.0),
            smallest: 0.003,
            typical: 0.01,
            prior_scale: 0.008,
            role: Role::Strength,
        },
        Parameter {
            name: "proximal_share",
            unit: "1",
            meaning: "share f of the compliance before the inertance",
            range: (0.1, 0.7),
            off: None,
            smallest: 0.0,
            typical: 0.3,
            prior_scale: 0.15,
            role: Role::Shape,
        },
        Parameter {
            name: "loss_mmHg_s2_per_mL2",
            unit: "mmHg s²/mL²",
            meaning: "quadratic loss K of a coarctation",
            range: (0.0, 4e-4),
            off: Some(0.0),
            smallest: 0.0,
            typical: 0.0,
            prior_scale: 1e-4,
            role: Role::Held,
        },
        Parameter {
            name: "resistance_mmHg_s_per_mL",
            unit: "mmHg s/mL",
            meaning: "linear resistance R_l between the two parts",
            range: (0.0, 0.15),
            off: Some(0.0),
            smallest: 0.0,
            typical: 0.0,
            prior_scale: 0.05,
            role: Role::Held,
        },
    ],
    signature: "late ejection: a bump of the pressure or a second hump of the aortic flow, ejection with two slopes",
    marks: &[
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Pressure,
            sign: Sign::Up,
        },
        Mark {
            phase: Phase::EarlyEjection,
            signal: Signal::Volume,
            sign: Sign::Up,
        },
    ],
    confused_with: &["aortic_stenosis", "dyssynchrony"],
    separated_by: &[
        Measurement::AorticPressure.words(),
        Measurement::AorticFlow.words(),
    ],
    prior_odds: ONE_OF_MANY,
    in_3d: InThreeDimensions::AsItIs,
    hidden_because: Some(
        "the shape of the activation absorbs what it leaves in pressure and volume of the ventricle; an aortic pressure or \
         flow trace shows it",
    ),
    remedy: None,
    action: Action::Circulation(add),
};

fn add(
    values: &[f64],
    around: &Surroundings,
    circulation: &mut Circulation,
) -> Result<(), EffectError> {
    let aorta = circulation
        .compartment_idx(AORTA)
        .ok_or(EffectError::NoPart {
            effect: EFFECT.name,
            part: AORTA,
        })?;
    let junction = ArterialJunction {
        inertance: values[0],
        proximal_share: values[1],
        loss: values[2],
        resistance: values[3],
    };
    let load = SplitWindkessel::new(
        AORTA,
        &around.heart.windkessel,
        junction,
        around.heart.start_pressure(),
    )?;
    circulation.replace_compartment(aorta, Box::new(load));
    Ok(())
}
