//! Conversion of the search's answer to the schema.

use std::collections::BTreeMap;

use cardiotwin_discover::forward::{Forward as _, Prediction};
use cardiotwin_discover::{Discovery, Reduced, Settings};
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::discover as files;
use cardiotwin_schemas::discover::{DiscoverSpec, Discovered};

use super::indices::indices;
use super::measured::Patient;
use super::model;
use crate::error::TaskError;

/// All results for a patient.
///
/// # Errors
/// [`TaskError`] when base values are missing or the fitted passive law is invalid.
pub fn result(
    spec: &DiscoverSpec,
    patient: &Patient,
    reduced: &Reduced,
    settings: &Settings,
    found: Discovery,
) -> Result<Discovered, TaskError> {
    let stated_filling = spec
        .left_atrial_pressure_mmhg
        .map(|pressure| model::stated_filling(reduced, &found, &patient.data, pressure))
        .transpose()?;
    let [before, after] = &found.beats;
    let mut search = settings.search.clone();
    if search.effects.is_empty() {
        let tried = reduced.candidates().iter();
        search.effects = tried.map(|candidate| candidate.name.clone()).collect();
    }
    let (biomarkers, model) = (
        biomarkers(patient, before, after)?,
        model::accepted(reduced, &found)?,
    );
    let indices = indices([before, after], [&found.base_before, &found.base]);
    Ok(Discovered {
        findings: found.findings,
        biomarkers,
        indices,
        stated_filling,
        base: found.base,
        base_before: found.base_before,
        model,
        noise_seen_over_stated: found.noise_seen_over_stated,
        n_evaluations: found.n_evaluations,
        series: found.series,
        seed: settings.seed,
        settings: search,
        data: (spec.files().into_iter())
            .map(|f| (f.name.clone(), f.sha256.clone()))
            .collect(),
    })
}

/// Biomarkers of the data and of both beats, with the same definitions and at the sample times of
/// the data.
fn biomarkers(
    patient: &Patient,
    before: &Prediction,
    after: &Prediction,
) -> Result<Vec<files::BiomarkerGap>, TaskError> {
    let of_beat = |beat: &Prediction| {
        let at = |times: &[f64], trace: &[f64]| times.iter().map(|t| beat.at(trace, *t)).collect();
        let pressure = at(patient.pressure.time_ms(), &beat.pressure_mmhg);
        patient.biomarkers(pressure, at(patient.volume.time_ms(), &beat.volume_ml))
    };
    let measured = patient.biomarkers(
        patient.pressure.values().to_vec(),
        patient.volume.values().to_vec(),
    )?;
    let by_name = |b: &Biomarkers| -> BTreeMap<String, f64> {
        let value = serde_json::to_value(b).unwrap_or_default();
        let map = value.as_object().into_iter().flatten();
        map.filter_map(|(name, value)| Some((name.clone(), value.as_f64()?)))
            .collect()
    };
    let (before, after) = (by_name(&of_beat(before)?), by_name(&of_beat(after)?));
    let row = |(name, measured): (String, f64)| files::BiomarkerGap {
        measured,
        before: before.get(&name).copied(),
        after: after.get(&name).copied(),
        name,
    };
    Ok(by_name(&measured).into_iter().map(row).collect())
}
