//! The search's final model: accepted effects, its beats, and the values for the patient's overlay.

use std::collections::BTreeMap;

use cardiotwin_discover::forward::{Forward as _, Prediction, Request};
use cardiotwin_discover::reduced::{BASE, Reduced};
use cardiotwin_discover::{Discovery, Measured};
use cardiotwin_models::effects::Kind;
use cardiotwin_models::ventricle::{OneFibrePassive, PassiveLaw as _};
use cardiotwin_schemas::discover::{FoundModel, StatedFilling};
use cardiotwin_schemas::organ::{EffectSpec, WindkesselParameters};
use cardiotwin_units::{Ml, Mmhg};

use crate::error::TaskError;

/// A term of the model with its fitted values.
type Term = (usize, Vec<f64>);

fn predict(model: &Reduced, base: &[f64], terms: &[Term]) -> Option<Prediction> {
    let terms: Vec<(usize, &[f64])> = terms
        .iter()
        .map(|(term, values)| (*term, values.as_slice()))
        .collect();
    model.predict(
        &Request {
            base,
            terms: &terms,
            bumps: &[],
        },
        None,
    )
}

/// Base values in the model's order.
fn values(base: &BTreeMap<String, f64>) -> Result<Vec<f64>, TaskError> {
    BASE.iter()
        .map(|name| base.get(*name).copied().ok_or(TaskError::SearchEnded))
        .collect()
}

/// Accepted effects with their fitted values in the model's order.
fn terms(model: &Reduced, found: &Discovery) -> Vec<Term> {
    let candidates = model.candidates();
    let term = |name: &String| {
        let at = candidates.iter().position(|c| c.name == *name)?;
        let effect = found.findings.effects.iter().find(|e| e.name == *name)?;
        let values = candidates[at]
            .parameters
            .iter()
            .map(|p| effect.strength.get(&p.name).copied());
        Some((at, values.collect::<Option<Vec<f64>>>()?))
    };
    found.findings.accepted.iter().filter_map(term).collect()
}

/// The model that `--accept` writes to the overlay.
///
/// # Errors
/// [`TaskError`] when the fitted passive law is invalid.
pub fn accepted(model: &Reduced, found: &Discovery) -> Result<FoundModel, TaskError> {
    let base = |name: &str| found.base.get(name).copied().ok_or(TaskError::SearchEnded);
    let reference = base("reference_volume_mL")?;
    let pressure = base("passive_pressure_mmHg")?;
    let wall = base("wall_volume_mL")?;
    let unloaded = Ml(base("unloaded_share")? * reference);
    let exponent = base("passive_exponent")?;
    let law = OneFibrePassive::through(unloaded, Ml(reference), Mmhg(pressure), Ml(wall), exponent)
        .map_err(TaskError::PassiveState)?;
    let terms = terms(model, found);
    let borrowed: Vec<(usize, &[f64])> = terms
        .iter()
        .map(|(term, values)| (*term, values.as_slice()))
        .collect();
    let settings = model.settings(&borrowed);
    let of = |kind: Kind| -> Vec<EffectSpec> {
        let chosen = settings
            .iter()
            .filter(|setting| setting.effect.kind == kind);
        chosen
            .map(|s| EffectSpec {
                name: s.effect.name.to_owned(),
                parameters: s.parameters(),
            })
            .collect()
    };
    Ok(FoundModel {
        effects: of(Kind::Physiology),
        corrections: of(Kind::Artefact),
        afterload: WindkesselParameters {
            characteristic_resistance_mmhg_s_per_ml: base(
                "characteristic_resistance_mmHg_s_per_mL",
            )?,
            peripheral_resistance_mmhg_s_per_ml: base("peripheral_resistance_mmHg_s_per_mL")?,
            compliance_ml_per_mmhg: base("compliance_mL_per_mmHg")?,
        },
        left_atrial_pressure_mmhg: base("left_atrial_pressure_mmHg")?,
        passive: law,
    })
}

/// Both models with the filling pressure of the patient file and all other values as fitted.
///
/// # Errors
/// [`TaskError::SearchEnded`] when base values are missing.
pub fn stated_filling(
    model: &Reduced,
    found: &Discovery,
    data: &Measured,
    left_atrial_pressure_mmhg: f64,
) -> Result<StatedFilling, TaskError> {
    let series = &found.series.volume;
    let end = found.phases.isovolumic_contraction_ms;
    let near = |t: f64| {
        let distance = (t - end).rem_euclid(data.cycle_ms);
        distance.min(data.cycle_ms - distance) <= END_DIASTOLE_MS
    };
    let late = |t: f64| found.phases.at(t, data.cycle_ms) >= LATE_FILLING;
    let mean = |inside: &dyn Fn(f64) -> bool, value: &dyn Fn(usize) -> f64| {
        let chosen: Vec<usize> = (0..series.time_ms.len())
            .filter(|i| inside(series.time_ms[*i]))
            .collect();
        chosen.iter().map(|i| value(*i)).sum::<f64>() / chosen.len().max(1) as f64
    };
    let compared = |base: &BTreeMap<String, f64>,
                    terms: &[Term]|
     -> Result<(Option<f64>, Option<f64>), TaskError> {
        let mut base = values(base)?;
        base[0] = left_atrial_pressure_mmhg;
        let Some(beat) = predict(model, &base, terms) else {
            return Ok((None, None));
        };
        let at = |i: usize| beat.at(&beat.volume_ml, series.time_ms[i]);
        let square = mean(&late, &|i| (series.measured[i] - at(i)).powi(2));
        Ok((Some(mean(&near, &at)), Some(square.sqrt())))
    };
    let before = compared(&found.base_before, &[])?;
    let after = compared(&found.base, &terms(model, found))?;
    Ok(StatedFilling {
        left_atrial_pressure_mmhg,
        measured_ml: mean(&near, &|i| series.measured[i]),
        before_ml: before.0,
        after_ml: after.0,
        late_filling_before_ml: before.1,
        late_filling_after_ml: after.1,
    })
}

/// Largest time between an end-diastolic frame and the foot of the upstroke \[ms\].
const END_DIASTOLE_MS: f64 = 35.0;
/// Position of diastasis in the order of phases; atrial systole follows it.
const LATE_FILLING: usize = 5;
