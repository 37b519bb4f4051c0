//! A checked patient as the engine takes it: settings resolved, input files hashed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::PatientDefaults;
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_schemas::patient::PatientFile;
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::Settings;
use cardiotwin_schemas::task::{InputFile, PassiveStateSpec};
use cardiotwin_signals::Problem;

use super::report::Report;

/// Makes the plan of a patient. A file that cannot be read is a problem in `report`, and then there is no plan.
pub fn resolve(
    file: &PatientFile,
    folder: &Path,
    defaults: &PatientDefaults,
    settings: &Settings,
    overlay: Option<&ModelOverlay>,
    report: &mut Report,
) -> Option<ResolvedPatient> {
    let mut hashed = |name: &str, file_name: &Option<String>| match file_name {
        None => Some(None),
        Some(file_name) => hash(name, &folder.join(file_name), &file.id, report).map(Some),
    };
    let measured = &file.measured;
    let pressure = hashed("pressure", &measured.pressure)?;
    let volume = hashed("volume", &measured.volume)?;
    let calcium = hashed("calcium", &measured.calcium)?;
    let biomarkers = measured.biomarkers.unwrap_or_default();
    let step0 = PassiveStateSpec {
        cycle_length_ms: file.cycle_length_ms,
        pressure,
        volume,
        biomarkers,
        end_diastolic_pressure_mmhg: measured.end_diastolic_pressure_mmhg.or(biomarkers.edp_mmhg),
        end_diastolic_volume_ml: measured.end_diastolic_volume_ml.or(biomarkers.edv_ml),
        diastasis_time_ms: measured.diastasis.as_ref().map(|image| image.time_ms),
        diastasis_volume_ml: measured.diastasis.as_ref().map(|image| image.volume_ml),
        aortic_systolic_mmhg: measured.aortic_pressure.as_ref().map(|aorta| aorta.systolic_mmhg),
        aortic_diastolic_mmhg: measured.aortic_pressure.as_ref().map(|aorta| aorta.diastolic_mmhg),
        wall_volume_ml: file.anatomy.wall_volume_ml,
        passive_exponent: file.passive.as_ref().and_then(|p| p.exponent).or(defaults.passive_exponent),
        // What was accepted for the patient belongs together, and wins over what the files state.
        afterload: overlay.and_then(|o| o.afterload).or(file.afterload),
        left_atrial_pressure_mmhg: overlay
            .and_then(|o| o.left_atrial_pressure_mmhg)
            .or_else(|| left_atrial_pressure(file, defaults)),
        start: settings.solver.start,
        activation: settings.solver.activation,
        biomarker_factors: BTreeMap::new(),
        passive_law: overlay.and_then(|o| o.passive),
        corrections: overlay.map_or_else(Vec::new, |o| o.corrections.clone()),
        finite_element: None,
        guccione_c_kpa: file.passive.as_ref().and_then(|p| p.guccione_c_kpa),
    };
    Some(ResolvedPatient {
        id: PatientId(file.id.clone()),
        workflow: Workflow::Personalise,
        random_stream: None,
        step0,
        calcium,
        settings: settings.clone(),
        effects: overlay.map_or_else(Vec::new, |o| o.effects.clone()),
    })
}

/// The patient's own filling pressure, else the cohort's.
#[must_use]
pub fn left_atrial_pressure(file: &PatientFile, defaults: &PatientDefaults) -> Option<f64> {
    file.preload.as_ref().map(|preload| preload.left_atrial_pressure_mmhg).or(defaults.left_atrial_pressure_mmhg)
}

/// A file by its content; one that cannot be read is a problem in `report`.
pub(super) fn hash(name: &str, path: &Path, patient: &str, report: &mut Report) -> Option<InputFile> {
    let read = || -> std::io::Result<(PathBuf, Vec<u8>)> { Ok((path.canonicalize()?, std::fs::read(path)?)) };
    match read() {
        Ok((absolute, bytes)) => Some(InputFile { name: name.to_owned(), path: absolute, sha256: sha256_hex(&bytes) }),
        Err(error) => {
            let found = format!("no readable file ({error})");
            let problem =
                Problem::error(path, found, "a trace file", "check its name in patient.toml and its permissions");
            report.add(Some(patient), problem);
            None
        }
    }
}
