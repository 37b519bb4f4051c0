//! Conversion of the search's answer to the schema.

use std::collections::BTreeMap;

use cardiotwin_discover::forward::{Forward as _, Prediction};
use cardiotwin_discover::locate::{self, PHASES};
use cardiotwin_discover::{Discovery, Reduced, Settings, result, series};
use cardiotwin_models::effects::{self, InThreeDimensions};
use cardiotwin_schemas::biomarkers::Biomarkers;
use cardiotwin_schemas::discover as files;
use cardiotwin_schemas::discover::{DiscoverSpec, Discovered};

use super::measured::Patient;
use super::model;
use crate::error::TaskError;

/// All results for a patient.
///
/// # Errors
/// [`TaskError`] when the model has no beat for the parameters that the search found.
pub fn result(
    spec: &DiscoverSpec,
    patient: &Patient,
    reduced: &Reduced,
    settings: &Settings,
    found: &Discovery,
) -> Result<Discovered, TaskError> {
    let stated_filling = spec
        .left_atrial_pressure_mmhg
        .map(|pressure| model::stated_filling(reduced, found, &patient.data, pressure))
        .transpose()?;
    let (before, after) = (
        model::beat(reduced, found, false)?,
        model::beat(reduced, found, true)?,
    );
    let finite = |value: f64| value.is_finite().then_some(value);
    let names: Vec<String> = if settings.effects.is_empty() {
        reduced
            .candidates()
            .iter()
            .map(|c| c.name.clone())
            .collect()
    } else {
        settings.effects.clone()
    };
    Ok(Discovered {
        none: found.none,
        effects: found.effects.iter().map(ranked).collect::<Result<_, _>>()?,
        accepted: found.accepted.clone(),
        confusable: distinct(found.confusable.iter().map(|c| &c.rival)),
        confusable_with: found
            .confusable
            .iter()
            .map(|c| files::Confusable {
                effect: c.effect.clone(),
                rival: c.rival.clone(),
                expected_misfit: c.expected_misfit,
            })
            .collect(),
        deciding_measurement: found.deciding_measurement.clone(),
        not_identifiable: distinct(found.not_identifiable.iter().map(|n| &n.name)),
        not_identifiable_without: found
            .not_identifiable
            .iter()
            .map(|n| files::NotIdentifiable {
                name: n.name.clone(),
                expected_misfit: n.expected_misfit,
                would_show: n.would_show.clone(),
            })
            .collect(),
        unexplained: found.unexplained.as_ref().map(unexplained),
        gap_before: found.gap_before,
        gap_after: found.gap_after,
        gap_heldout_before: finite(found.gap_heldout_before),
        gap_heldout_after: finite(found.gap_heldout_after),
        p_value: found.p_value,
        threshold: found.threshold,
        nameless_evidence: found.nameless_evidence,
        places: found.located.iter().map(place).collect(),
        where_after: found.located_after.iter().map(place).collect(),
        gaps: found.series.gaps.iter().map(gap).collect(),
        biomarkers: biomarkers(patient, &before, &after)?,
        stated_filling,
        base: found.base.clone(),
        base_before: found.base_before.clone(),
        model: model::accepted(reduced, found)?,
        noise_seen_over_stated: found.noise_seen_over_stated,
        n_evaluations: found.n_evaluations as u64,
        series: drawn(&found.series),
        seed: settings.seed,
        settings: files::SearchSettings {
            effects: names,
            least_evidence: settings.least_evidence,
            false_alarm: settings.false_alarm,
            n_bootstrap: settings.n_bootstrap as u32,
            max_effects: settings.max_effects as u32,
        },
        data: [&spec.pressure, &spec.volume]
            .map(|f| (f.name.clone(), f.sha256.clone()))
            .into(),
    })
}

fn distinct<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut list: Vec<String> = Vec::new();
    for name in names {
        if !list.contains(name) {
            list.push(name.clone());
        }
    }
    list
}

fn ranked(effect: &result::RankedEffect) -> Result<files::RankedEffect, TaskError> {
    let declared = effects::find(&effect.name).map_err(TaskError::Effect)?;
    Ok(files::RankedEffect {
        name: effect.name.clone(),
        meaning: declared.meaning.to_owned(),
        artefact: effect.artefact,
        probability: effect.probability,
        delta_bic: effect.delta_bic,
        log_evidence: effect.log_evidence,
        robust_evidence: effect.robust_evidence,
        delta_deviance: effect.delta_deviance,
        strength: effect.strength.clone(),
        interval: effect.interval.clone(),
        plausible: effect.plausible,
        in_3d: in_3d(declared.in_3d),
        remedy: declared.remedy.map(str::to_owned),
    })
}

fn in_3d(declared: InThreeDimensions) -> files::InThreeDimensions {
    let (way, how) = match declared {
        InThreeDimensions::AsItIs => ("as-it-is", None),
        InThreeDimensions::ActivationMap { how } => ("activation-map", Some(how.to_owned())),
        InThreeDimensions::PassiveExponents { factor } => {
            let how =
                format!("all exponents of Guccione's law times {factor}; its scale is fitted anew");
            ("passive-exponents", Some(how))
        }
        InThreeDimensions::MaterialTerm { how } => ("material-term", Some(how.to_owned())),
        InThreeDimensions::Cannot { why } => ("cannot", Some(why.to_owned())),
    };
    files::InThreeDimensions {
        way: way.to_owned(),
        how,
    }
}

fn place(place: &locate::Place) -> files::Place {
    let unit = match place.signal.as_str() {
        "pressure_rate" => "mmHg/s",
        "volume" | "end_diastolic_volume" | "forward_stroke_volume" | "whole_heart_volume" => "mL",
        _ => "mmHg",
    };
    files::Place {
        signal: place.signal.clone(),
        phase: place.phase.clone(),
        sign: if place.size < 0.0 {
            files::Side::Below
        } else {
            files::Side::Above
        },
        size: place.size,
        unit: unit.to_owned(),
        z: place.z,
        share: place.share,
        biomarkers: place.biomarkers.clone(),
    }
}

fn unexplained(gap: &result::Unexplained) -> files::Unexplained {
    let dependence = |d: &result::Dependence| files::Dependence {
        signal: d.signal.clone(),
        variable: d.variable.clone(),
        share: d.share,
    };
    files::Unexplained {
        kind: gap.kind.clone(),
        log_evidence: gap.log_evidence,
        place: place(&gap.place),
        depends_on: gap.depends_on.iter().map(dependence).collect(),
    }
}

fn gap(row: &series::GapAt) -> files::GapAt {
    files::GapAt {
        signal: row.signal.clone(),
        phase: row.phase.clone(),
        n: row.n as u32,
        before: row.before,
        after: row.after,
        heldout_before: row.held_out_before,
        heldout_after: row.held_out_after,
    }
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

fn drawn(series: &series::Series) -> files::DiscoverSeries {
    let compared = |signal: &series::Compared| files::ComparedSignal {
        time_ms: signal.time_ms.clone(),
        measured: signal.measured.clone(),
        before: signal.before.clone(),
        after: signal.after.clone(),
        heldout_before: signal.held_out_before.clone(),
        heldout_after: signal.held_out_after.clone(),
        noise_sd: signal.noise_sd,
    };
    let begin = |(phase, begin_ms): (&str, f64)| files::PhaseBegin {
        phase: phase.to_owned(),
        begin_ms,
    };
    let curves = &series.curves;
    files::DiscoverSeries {
        phases: std::iter::zip(PHASES, series.phases.beginnings())
            .map(begin)
            .collect(),
        pressure: compared(&series.pressure),
        volume: compared(&series.volume),
        curves: files::SimulatedCurves {
            time_ms: curves.time_ms.clone(),
            pressure_before_mmhg: curves.pressure_before_mmhg.clone(),
            pressure_after_mmhg: curves.pressure_after_mmhg.clone(),
            volume_before_ml: curves.volume_before_ml.clone(),
            volume_after_ml: curves.volume_after_ml.clone(),
        },
    }
}
