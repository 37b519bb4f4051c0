//! Assembly of a base model with effects.

use super::declaration::{Action, OneFibreParts};
use super::{EffectError, EffectSetting, Kind, Measurement, Surroundings};
use crate::circulation::left_heart::{AORTIC_VALVE, MITRAL_VALVE};
use crate::circulation::{Circulation, ClosedLoop, LeftHeart};
use crate::ventricle::{
    ActivationGroups, ActivationSpread, GroupContraction, OneFibreParameters, OneFibrePassive,
    OneFibreVentricle, OrganLaw,
};
use cardiotwin_vocabulary::circulation::OPEN_CIRCUIT_EFFECTS;
use std::sync::Arc;

/// A base model: a one-fibre ventricle and a circulation, with exact measurement.
#[derive(Debug)]
pub struct BaseModel {
    /// Circulation and cycle length.
    pub heart: LeftHeart,
    /// Passive law and reference volumes.
    pub passive: OneFibrePassive,
    /// Activation of the wall.
    pub activation: ActivationSpread,
    /// Contraction model of all groups.
    pub contraction: GroupContraction,
    /// Inertance of the blood in the mitral and in the aortic valve \[mmHg·s²/mL\].
    pub inertances: [f64; 2],
    /// Closed loop in the place of the constant atrium and the Windkessel that drains; `None` for the
    /// open circuit.
    pub closed: Option<ClosedLoop>,
    /// Learned correction of the wall; `None` for the one-fibre ventricle itself.
    pub law: Option<Arc<OrganLaw>>,
}

/// A model that is ready to run, with the changes of its effects.
#[derive(Debug)]
pub struct Assembled {
    /// Ventricle in its end-diastolic state.
    pub ventricle: OneFibreVentricle,
    /// Circulation at its start.
    pub circulation: Circulation,
    /// Artefacts between the heart and the data.
    pub measurement: Measurement,
}

/// Measurement with these artefacts between heart and data.
///
/// # Errors
/// [`EffectError::NoArtefact`] for an effect of the heart, and the errors of [`assemble`].
pub fn measurement(artefacts: &[EffectSetting]) -> Result<Measurement, EffectError> {
    check(artefacts)?;
    let mut measurement = Measurement::default();
    for EffectSetting { effect, values } in artefacts {
        let Action::Measurement(make) = effect.action else {
            return Err(EffectError::NoArtefact {
                effect: effect.name,
            });
        };
        measurement.push(make(values)?);
    }
    Ok(measurement)
}

/// Checks that each effect occurs once and has valid values.
fn check(effects: &[EffectSetting]) -> Result<(), EffectError> {
    for (idx, setting) in effects.iter().enumerate() {
        setting.check()?;
        if effects[..idx]
            .iter()
            .any(|other| other.effect.name == setting.effect.name)
        {
            return Err(EffectError::Twice {
                effect: setting.effect.name,
            });
        }
    }
    Ok(())
}

/// The circuit around a left heart before its effects: the open one, or the loop.
///
/// # Errors
/// [`EffectError::NoPart`] for an effect on a part that a loop does not have, and parameters outside the
/// range of the circuit.
pub(super) fn circuit(
    heart: &LeftHeart,
    closed: Option<&ClosedLoop>,
    effects: &[EffectSetting],
) -> Result<Circulation, EffectError> {
    let Some(closed) = closed else {
        return Ok(heart.build()?);
    };
    let is_on = |name: &str| effects.iter().any(|e| e.effect.name == name && !e.is_off());
    match OPEN_CIRCUIT_EFFECTS
        .into_iter()
        .find(|(name, _)| is_on(name))
    {
        Some((effect, part)) => Err(EffectError::NoPart { effect, part }),
        None => Ok(closed.build()?),
    }
}

/// Adds to a circulation the effects that act on it. Effects of the ventricle and of the
/// measurement are ignored.
///
/// # Errors
/// [`EffectError`] if the list is invalid or the circulation lacks a part that an effect acts on.
pub fn add_to_circulation(
    circulation: &mut Circulation,
    surroundings: &Surroundings,
    effects: &[EffectSetting],
) -> Result<(), EffectError> {
    check(effects)?;
    for setting in effects.iter().filter(|setting| !setting.is_off()) {
        if let Action::Circulation(change) = setting.effect.action {
            change(&setting.values, surroundings, circulation)?;
        }
    }
    Ok(())
}

/// Builds ventricle, circulation and measurement of a base model with any effects. An effect at its
/// off-values does not change the model at all.
///
/// # Errors
/// [`EffectError`] if the list is invalid or parameters are outside the range of the models.
pub fn assemble(base: BaseModel, effects: &[EffectSetting]) -> Result<Assembled, EffectError> {
    let surroundings = Surroundings {
        heart: base.heart,
        onset: base.activation.onset,
    };
    let mut circulation = circuit(&base.heart, base.closed.as_ref(), effects)?;
    add_to_circulation(&mut circulation, &surroundings, effects)?;
    // After the effects, which may replace valves.
    for (valve, inertance) in [MITRAL_VALVE, AORTIC_VALVE].iter().zip(base.inertances) {
        if let Some(path) = circulation.path_idx(valve) {
            circulation.set_inertance(path, inertance);
        }
    }
    let (times_ms, weights) = base.activation.groups()?;
    let mut parts = OneFibreParts {
        passive: base.passive,
        groups: ActivationGroups::new(times_ms, weights)?,
        contraction: base.contraction,
        pressure_terms: Vec::new(),
    };
    let mut measurement = Measurement::default();
    for setting in effects.iter().filter(|setting| !setting.is_off()) {
        match setting.effect.action {
            Action::Circulation(_) => {}
            Action::Wall(change) => parts = change(&setting.values, &surroundings, parts)?,
            Action::Measurement(make) => measurement.push(make(&setting.values)?),
        }
    }
    let parameters = OneFibreParameters {
        passive: parts.passive,
        activation: base.activation,
        contraction: parts.contraction,
        cycle_length: surroundings.cycle_length(),
        pressure_terms: parts.pressure_terms,
        law: base.law,
    };
    let ventricle = OneFibreVentricle::with_groups(parameters, &parts.groups)?;
    Ok(Assembled {
        ventricle,
        circulation,
        measurement,
    })
}

impl EffectSetting {
    /// Rejects an effect of the measurement where only the heart is simulated.
    ///
    /// # Errors
    /// [`EffectError::Artefact`] with the remedy.
    pub fn require_physiology(&self) -> Result<(), EffectError> {
        match self.effect.kind {
            Kind::Physiology => Ok(()),
            Kind::Artefact => Err(EffectError::Artefact {
                effect: self.effect.name,
                remedy: self.effect.remedy.unwrap_or("correct the data"),
            }),
        }
    }
}
