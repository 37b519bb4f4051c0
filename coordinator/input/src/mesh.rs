//! Checks of a patient's own mesh as in step 0, so that every defect is found before a task waits
//! in a queue.

use std::path::Path;

use cardiotwin_mesh::checks::{Defect, Severity};
use cardiotwin_mesh::files::LengthUnit;
use cardiotwin_mesh::intake::{self, Activation, Asked, Fibres};
use cardiotwin_mesh::tet_mesh::surface_names;
use cardiotwin_schemas::finite_element::MeshFibres;
use cardiotwin_schemas::patient::{PatientFile, PatientMesh};
use cardiotwin_schemas::settings::StartMode;
use cardiotwin_signals::image::is_before_end_diastole;
use cardiotwin_signals::read::read_trace;
use cardiotwin_signals::resample::STEP;
use cardiotwin_signals::{BeatBiomarkers, Continuation, Problem, Quantity, Trace, resample};
use cardiotwin_units::{Ml, Mmhg, Ms};

use super::document::Document;
use super::effects::Accepted;
use super::layers::{Merged, position_of};
use super::report::Report;

/// Surfaces of a generated mesh.
const GENERATED: [&str; 4] = [
    surface_names::ENDOCARDIUM,
    surface_names::EPICARDIUM,
    surface_names::RIM,
    surface_names::SEPTUM,
];

/// Reports every defect of the patient's mesh if its files exist. For a patient without a mesh,
/// reports springs on surfaces that a generated mesh does not have.
///
/// - `accepted`: effects of the patient, which may need parts of the anatomy
pub fn check(
    file: &PatientFile,
    folder: &Path,
    settings: &Merged,
    document: &Document,
    accepted: Option<&Accepted<'_>>,
    report: &mut Report,
) {
    let start = settings.settings.solver.start;
    let surfaces = &settings.settings.solver.finite_element.wall.surface;
    let Some(mesh) = &file.anatomy.mesh else {
        for name in surfaces
            .keys()
            .filter(|name| !GENERATED.contains(&name.as_str()))
        {
            let found = "no surface of this name: the patient has no mesh of its own";
            let expected = format!(
                "one of {}, which the generated mesh has",
                GENERATED.join(", ")
            );
            let remedy = "set it in [settings] of the patients whose meshes have the surface";
            report.add(
                named(folder),
                settings.problem(&sprung(name), Some(document), [found, &expected, remedy]),
            );
        }
        return;
    };
    let Some(unit) = LengthUnit::from_symbol(&mesh.unit) else {
        return;
    }; // `check_values` of the patient reports it
    let patient = named(folder);
    let path = folder.join(&mesh.file);
    let times = mesh
        .activation_times_ms
        .as_ref()
        .map(|name| folder.join(name));
    let activation = match &times {
        Some(times) if times.is_file() => Activation::Times(times),
        None if !mesh.activation_sites_mm.is_empty() => {
            Activation::Sites(&mesh.activation_sites_mm)
        }
        _ => Activation::Unasked, // `check_values` of the patient reports it
    };
    let fibres = match mesh.fibres {
        MeshFibres::Auto => Fibres::Auto,
        MeshFibres::Mesh => Fibres::Mesh,
        MeshFibres::Rule => Fibres::Rule,
    };
    let sprung: Vec<&str> = surfaces.keys().map(String::as_str).collect();
    let asked = Asked {
        unit,
        left_ventricle: &mesh.left_ventricle,
        fibres,
        cavity: imaged_volume(file, folder, start),
        wall: file.anatomy.wall_volume_ml.map(Ml),
        activation,
        right_ventricle: mesh
            .right_ventricle
            .as_ref()
            .map(|right| right.surface.as_str()),
        sprung: &sprung,
    };
    let told_at = |problem: Problem, key: &str| problem.at_key(key).at(position_of(document, key));
    match intake::read(&path, &asked) {
        Ok(intake) => {
            // A right ventricle that the file names shows where the septum is.
            if let (Some(accepted), Some(patient), None) =
                (accepted, patient, &mesh.right_ventricle)
            {
                accepted.check_on_mesh(patient, &intake.mesh, report);
            }
            for defect in &intake.defects {
                if let Defect::NoFurther { name, .. } = defect
                    && key_of(defect, mesh) == SPRUNG
                {
                    let said = [defect.found(), defect.expected(), defect.remedy()];
                    report.add(
                        patient,
                        settings.problem(
                            &self::sprung(name),
                            Some(document),
                            said.each_ref().map(String::as_str),
                        ),
                    );
                    continue;
                }
                report.add(
                    patient,
                    told_at(problem(&document.file, defect), key_of(defect, mesh)),
                );
            }
        }
        Err(error) => {
            // `check_values` of the patient reports a missing file.
            let there = [path.clone(), path.with_extension("pts")]
                .iter()
                .any(|path| path.is_file())
                || with_ending(&path, ".pts").is_file();
            if there {
                let (found, expected) = (chain(&error), "a mesh of tetrahedra");
                let remedy = "write the file again in one of the formats CARP text, VTU, gmsh .msh or Medit \
                     .mesh";
                let problem = Problem::error(&document.file, found, expected, remedy);
                report.add(patient, told_at(problem, "anatomy.mesh.file"));
            }
        }
    }
}

/// Table of the springs by surface.
const SPRUNG: &str = "solver.finite_element.wall.surface";

/// Key of a surface's springs.
fn sprung(name: &str) -> String {
    format!("{SPRUNG}.{name}")
}

fn named(folder: &Path) -> Option<&str> {
    folder.file_name().and_then(|name| name.to_str())
}

fn with_ending(path: &Path, ending: &str) -> std::path::PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(ending);
    name.into()
}

fn chain(error: &dyn std::error::Error) -> String {
    let cause = error
        .source()
        .map(|source| format!(": {source}"))
        .unwrap_or_default();
    format!("{error}{cause}")
}

/// A defect as a problem of the patient's file.
pub fn problem(file: &Path, defect: &Defect) -> Problem {
    let make = match defect.severity() {
        Severity::Error => Problem::error,
        Severity::Warning => Problem::warning,
    };
    make(file, defect.found(), defect.expected(), defect.remedy())
}

/// The key whose value may cause the defect.
fn key_of(defect: &Defect, mesh: &PatientMesh) -> &'static str {
    match defect {
        Defect::NoTag { .. } => "anatomy.mesh.left_ventricle",
        Defect::Size { .. } => "anatomy.mesh.unit",
        Defect::NoFibres
        | Defect::FibreLength { .. }
        | Defect::OneDirection { .. }
        | Defect::Unordered { .. }
        | Defect::UnreadDirections { .. } => "anatomy.mesh.fibres",
        Defect::Site { .. } => "anatomy.mesh.activation_sites_mm",
        Defect::Times { .. } if mesh.activation_times_ms.is_some() => {
            "anatomy.mesh.activation_times_ms"
        }
        Defect::Wall { .. } => "anatomy.wall_volume_mL",
        Defect::NoFurther { key, .. } => key,
        Defect::NotRight { .. } | Defect::RightOverlap { .. } | Defect::RightHole { .. } => {
            "anatomy.mesh.right_ventricle.surface"
        }
        _ => "anatomy.mesh.file",
    }
}

/// Volume of the cavity in the state that the mesh shows, determined as in step 0; `None` if the
/// data do not give one. Accepted corrections of traces are ignored, because they are far smaller
/// than the tolerance.
fn imaged_volume(file: &PatientFile, folder: &Path, start: StartMode) -> Option<Ml> {
    let measured = &file.measured;
    let given = measured.biomarkers.unwrap_or_default();
    let periodic = Continuation::periodic(Ms(file.cycle_length_ms));
    let read = |name: &Option<String>, quantity| -> Option<Trace> {
        let trace = read_trace(&folder.join(name.as_ref()?), quantity).trace?;
        resample(&trace, periodic, STEP).ok()
    };
    let pressure = read(&measured.pressure, Quantity::Pressure);
    let volume = read(&measured.volume, Quantity::Volume);
    let of_traces = BeatBiomarkers::of_samples(pressure.as_ref(), volume.as_ref(), periodic)
        .ok()
        .map(|beat| beat.values);
    let edv = given
        .edv_ml
        .map(Ml)
        .or(of_traces.and_then(|set| set.edv_ml).map(Ml));
    let edv = edv.or(measured.end_diastolic_volume_ml.map(Ml));
    let edp = measured
        .end_diastolic_pressure_mmhg
        .or(given.edp_mmhg)
        .map(Mmhg);
    let edp = edp.or(of_traces.and_then(|set| set.edp_mmhg).map(Mmhg));
    let Some(image) = &measured.diastasis else {
        return edv;
    };
    let at_image = pressure.as_ref().map(|trace| Mmhg(trace.at(image.time_ms)));
    match (start, edv, edp, at_image) {
        (StartMode::Diastasis, ..) | (_, None, ..) => Some(Ml(image.volume_ml)),
        (StartMode::EndDiastole, Some(edv), Some(edp), Some(pressure))
            if is_before_end_diastole((Ml(image.volume_ml), pressure), (edv, edp)) =>
        {
            Some(Ml(image.volume_ml))
        }
        (StartMode::EndDiastole, edv, ..) => edv,
    }
}
