//! Plan of a checked patient for the engine, with resolved settings and hashed input files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_schemas::cohort::PatientDefaults;
use cardiotwin_schemas::filling::FlowMeasurements;
use cardiotwin_schemas::finite_element::{OwnMesh, OwnRightVentricle, RightPressureSpec};
use cardiotwin_schemas::further::FurtherQuantity;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::overlay::ModelOverlay;
use cardiotwin_schemas::patient::{Measured, PatientFile, PatientMesh, PatientRightVentricle};
use cardiotwin_schemas::plan::{ResolvedPatient, Workflow};
use cardiotwin_schemas::settings::Settings;
use cardiotwin_schemas::shared::Shared;
use cardiotwin_schemas::task::PassiveStateSpec;

use super::external;
use super::hashed::hash;
use super::law;
use super::report::Report;

/// Makes the plan of a patient. Files are looked up in the patient's folder before the cohort's. A
/// file that cannot be read becomes a problem in `report`, and the result is `None`.
pub fn resolve(
    file: &PatientFile,
    (folder, cohort_folder): (&Path, &Path),
    defaults: &PatientDefaults,
    settings: &Shared<Settings>,
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
    let own_mesh = match &file.anatomy.mesh {
        None => None,
        Some(mesh) => Some(own_mesh(mesh, folder, &file.id, report)?),
    };
    let external_files = external::files(settings, folder, cohort_folder, &file.id, report)?;
    let flows = flows(measured, folder, &file.id, report)?;
    let biomarkers = measured.biomarkers.unwrap_or_default();
    let law = law::file(settings, cohort_folder, &file.id, report)?;
    let step0 = PassiveStateSpec {
        cycle_length_ms: file.cycle_length_ms,
        pressure,
        volume,
        biomarkers,
        end_diastolic_pressure_mmhg: measured.end_diastolic_pressure_mmhg.or(biomarkers.edp_mmhg),
        end_diastolic_volume_ml: measured.end_diastolic_volume_ml.or(biomarkers.edv_ml),
        diastasis_time_ms: measured.diastasis.as_ref().map(|image| image.time_ms),
        diastasis_volume_ml: measured.diastasis.as_ref().map(|image| image.volume_ml),
        aortic_systolic_mmhg: measured
            .aortic_pressure
            .as_ref()
            .map(|aorta| aorta.systolic_mmhg),
        aortic_diastolic_mmhg: measured
            .aortic_pressure
            .as_ref()
            .map(|aorta| aorta.diastolic_mmhg),
        wall_volume_ml: file.anatomy.wall_volume_ml,
        passive_exponent: file
            .passive
            .as_ref()
            .and_then(|p| p.exponent)
            .or(defaults.passive_exponent),
        afterload: file.afterload,
        left_atrial_pressure_mmhg: left_atrial_pressure(file, defaults),
        flows,
        start: settings.solver.start,
        activation: settings.solver.activation,
        biomarker_factors: BTreeMap::new(),
        passive_law: None,
        corrections: Vec::new(),
        finite_element: None,
        own_mesh,
        guccione_c_kpa: file.passive.as_ref().and_then(|p| p.guccione_c_kpa),
    };
    Some(ResolvedPatient {
        id: PatientId(file.id.clone()),
        workflow: Workflow::Personalise,
        random_stream: None,
        step0,
        calcium,
        law,
        noise: measured.noise.clone(),
        external_files,
        settings: settings.clone(),
        effects: Vec::new(),
        is_unconfirmed: false,
    })
}

/// The plan with what was accepted for the patient. Effects and loads belong together and replace the
/// values in the files.
#[must_use]
pub fn with_overlay(mut plan: ResolvedPatient, overlay: &ModelOverlay) -> ResolvedPatient {
    let step0 = &mut plan.step0;
    step0.afterload = overlay.afterload.or(step0.afterload);
    step0.left_atrial_pressure_mmhg = overlay
        .left_atrial_pressure_mmhg
        .or(step0.left_atrial_pressure_mmhg);
    step0.passive_law = overlay.passive;
    step0.corrections.clone_from(&overlay.corrections);
    plan.effects.clone_from(&overlay.effects);
    plan.is_unconfirmed =
        (overlay.accepted.as_ref()).is_some_and(|accepted| !accepted.is_confirmed());
    plan
}

/// Measured atrial pressure, mitral flow and net forward volume, with the hashes of their files.
fn flows(
    measured: &Measured,
    folder: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<FlowMeasurements> {
    let mut flows = FlowMeasurements {
        forward_stroke_volume: measured.forward_stroke_volume.clone(),
        ..FlowMeasurements::default()
    };
    for stated in measured.traces.iter().flat_map(|traces| traces.stated()) {
        let place = match stated.quantity {
            FurtherQuantity::AtrialPressure => &mut flows.atrial_pressure,
            FurtherQuantity::MitralFlow => &mut flows.mitral_flow,
            _ => continue,
        };
        let at = folder.join(stated.file);
        let file = hash(stated.quantity.name(), &at, patient, report)?;
        *place = Some(stated.with_file(file));
    }
    Some(flows)
}

/// A patient's own mesh with the hashes of its files.
fn own_mesh(
    mesh: &PatientMesh,
    folder: &Path,
    patient: &str,
    report: &mut Report,
) -> Option<OwnMesh> {
    let at = folder.join(&mesh.file);
    let one_file = ["vtu", "msh", "mesh"]
        .contains(&at.extension().and_then(|e| e.to_str()).unwrap_or_default());
    let mut paths = vec![];
    if one_file {
        paths.push(at);
    } else {
        let with = |extension: &str| {
            let mut name = at.as_os_str().to_owned();
            name.push(extension);
            PathBuf::from(name)
        };
        paths.extend([with(".pts"), with(".elem")]);
        paths.extend(Some(with(".lon")).filter(|lon| lon.exists()));
        paths.extend(surfaces_beside(&at));
    }
    let mut files = vec![];
    for path in paths {
        files.push(hash("mesh", &path, patient, report)?);
    }
    let activation_times = match &mesh.activation_times_ms {
        None => None,
        Some(name) => Some(hash(
            "activation times",
            &folder.join(name),
            patient,
            report,
        )?),
    };
    let right_ventricle = match &mesh.right_ventricle {
        None => None,
        Some(PatientRightVentricle {
            surface,
            pressure_mmhg,
            pressure,
        }) => {
            let pressure = match (pressure, pressure_mmhg) {
                (Some(name), _) => {
                    let file = hash(
                        "right ventricle's pressure",
                        &folder.join(name),
                        patient,
                        report,
                    )?;
                    RightPressureSpec::Trace { file }
                }
                (None, pressure_mmhg) => RightPressureSpec::Constant {
                    pressure_mmhg: (*pressure_mmhg)?,
                },
            };
            Some(OwnRightVentricle {
                surface: surface.clone(),
                pressure,
            })
        }
    };
    Some(OwnMesh {
        files,
        unit: mesh.unit.clone(),
        left_ventricle: mesh.left_ventricle.clone(),
        fibres: mesh.fibres,
        activation_times,
        activation_sites_mm: mesh.activation_sites_mm.clone(),
        right_ventricle,
    })
}

/// Surface files `stem.NAME.surf` next to a stem, sorted by name.
fn surfaces_beside(stem: &Path) -> Vec<PathBuf> {
    let folder = stem.parent().unwrap_or(Path::new("."));
    let prefix = format!(
        "{}.",
        stem.file_name().unwrap_or_default().to_string_lossy()
    );
    let of_the_stem = |path: &PathBuf| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with(&prefix) && name.ends_with(".surf")
    };
    let entries = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let mut found: Vec<PathBuf> = entries.filter(of_the_stem).collect();
    found.sort();
    found
}

/// The patient's own filling pressure, or the cohort's default, mmHg.
#[must_use]
pub fn left_atrial_pressure(file: &PatientFile, defaults: &PatientDefaults) -> Option<f64> {
    file.preload
        .as_ref()
        .map(|preload| preload.left_atrial_pressure_mmhg)
        .or(defaults.left_atrial_pressure_mmhg)
}
