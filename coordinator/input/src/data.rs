//! Reading of measured traces, and checks against each other and against the patient's file.

use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::PatientDefaults;
use cardiotwin_schemas::patient::PatientFile;
use cardiotwin_signals::checks::{self, Facts, Measured, MeasuredVolume, Source, contradictions};
use cardiotwin_signals::read::read_trace;
use cardiotwin_signals::{Problem, Quantity, Trace};
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::document::Document;
use super::further;
use super::layers::position_of;
use super::report::Report;
use super::resolve::left_atrial_pressure;

/// Reads the traces of a patient and reports their problems.
pub fn check(
    file: &PatientFile,
    folder: &Path,
    document: &Document,
    defaults: &PatientDefaults,
    report: &mut Report,
) {
    let measured = &file.measured;
    let mut read = |name: &Option<String>, quantity: Quantity| -> Option<(PathBuf, Trace)> {
        let path = folder.join(name.as_ref()?);
        if !path.is_file() {
            return None; // `check_values` of the patient reports it
        }
        let reading = read_trace(&path, quantity);
        let patient = folder.file_name().and_then(|name| name.to_str());
        reading
            .problems
            .into_iter()
            .for_each(|problem| report.add(patient, problem));
        Some((path, reading.trace?))
    };
    let pressure = read(&measured.pressure, Quantity::Pressure);
    let volume = read(&measured.volume, Quantity::Volume);
    let calcium = read(&measured.calcium, Quantity::Calcium);
    let of_right = file
        .anatomy
        .mesh
        .as_ref()
        .and_then(|mesh| mesh.right_ventricle.as_ref());
    let right = of_right.and_then(|right| read(&right.pressure, Quantity::Pressure));
    let cycle_is_sound = !report.is_broken(&document.file, "cycle_length_ms");
    further::check(file, folder, cycle_is_sound, report);
    if !cycle_is_sound {
        return;
    }
    let cycle_length = Ms(file.cycle_length_ms);
    let mut problems = checks::check(&Measured {
        patient_file: &document.file,
        cycle_length,
        pressure: pressure
            .as_ref()
            .map(|(file, trace)| Source { file, trace }),
        volume: volume.as_ref().map(|(file, trace)| Source { file, trace }),
        end_diastolic_pressure: measured.end_diastolic_pressure_mmhg.map(Mmhg),
        left_atrial_pressure: left_atrial_pressure(file, defaults).map(Mmhg),
        forward_stroke_volume: measured
            .forward_stroke_volume
            .as_ref()
            .map(|flow| MeasuredVolume {
                volume: Ml(flow.volume_ml),
                sd: Ml(flow.sd_ml.unwrap_or(0.0)),
            }),
        accepted: &measured.accept,
    });
    let given = measured.biomarkers.unwrap_or_default();
    // A number outside of its range is told once, and what follows from it is not.
    let is_sound = |table: &str| !report.has_error_in(&document.file, table);
    let aorta =
        (measured.aortic_pressure.as_ref()).filter(|_| is_sound("measured.aortic_pressure"));
    let facts = Facts {
        cycle_ms: cycle_length.0,
        pressure: pressure.as_ref().map(|(_, trace)| trace),
        volume: volume.as_ref().map(|(_, trace)| trace),
        aorta: aorta.map(|aorta| [aorta.systolic_mmhg, aorta.diastolic_mmhg]),
        stated_p_max: given.p_max_mmhg,
        stated_edv: measured.end_diastolic_volume_ml.or(given.edv_ml),
        stated_esv: given.esv_ml,
        stated_sv: given.sv_ml,
        stated_edp: measured.end_diastolic_pressure_mmhg,
        diastasis_ml: (measured.diastasis.as_ref()).map(|diastasis| diastasis.volume_ml),
        forward_ml: measured
            .forward_stroke_volume
            .as_ref()
            .map(|flow| flow.volume_ml),
        windkessel: file.afterload.filter(|_| is_sound("afterload")),
        calcium: calcium.as_ref().map(|(_, trace)| trace),
        ..Facts::default()
    };
    // Where a trace itself is wrong, what follows from it is not told.
    if !problems.iter().any(Problem::is_error) {
        problems.extend(contradictions(&facts, &measured.accept, &document.file));
    }
    let patient = folder.file_name().and_then(|name| name.to_str());
    if let Some((file, trace)) = &right {
        let found = checks::check_right_pressure(Source { file, trace }, cycle_length);
        found
            .into_iter()
            .for_each(|problem| report.add(patient, problem));
    }
    for mut problem in problems {
        // In a patient's file the names of accepted rules stand among the measurements.
        if problem.key.as_deref() == Some("accept") {
            problem.key = Some("measured.accept".to_owned());
        }
        if problem.file == document.file
            && let Some(key) = problem.key.clone()
        {
            problem = problem.at(position_of(document, &key));
            if key == "preload.left_atrial_pressure_mmHg" && file.preload.is_none() {
                problem.remedy =
                    "it comes from [defaults] of cohort.toml: give this patient its own [preload]"
                        .to_owned();
            }
        }
        report.add(patient, problem);
    }
}
