//! Specification of the search for missing effects from a patient's file.

use cardiotwin_schemas::discover::DiscoverSpec;
use cardiotwin_schemas::further::{FurtherTraceSpec, LoadedBeatSpec};
use cardiotwin_schemas::task::InputFile;
use cardiotwin_signals::Problem;

use super::cohort::Patient;
use super::hashed::hash;
use super::report::Report;

/// Specification of a search in this patient. If a trace is missing, the result is `None` and
/// `report` gets a problem.
///
/// - `effects`: names of the candidates; empty for the whole catalogue
pub fn specification(
    patient: &Patient,
    effects: &[String],
    seed: u64,
    report: &mut Report,
) -> Option<DiscoverSpec> {
    let measured = &patient.file.measured;
    let mut trace = |name: &str, file: &Option<String>| -> Option<InputFile> {
        if let Some(file) = file {
            return hash(name, &patient.folder.join(file), &patient.id, report);
        }
        let path = &patient.positions.0;
        let remedy =
            format!("add `{name} = \"{name}.csv\"` to [measured], or leave this patient out");
        let expected = "both pressure and volume, since a search compares traces, not biomarkers";
        let problem = Problem::error(path, "no such key", expected, remedy)
            .at_key(format!("measured.{name}"));
        report.add(Some(&patient.id), problem);
        None
    };
    let (pressure, volume) = (
        trace("pressure", &measured.pressure),
        trace("volume", &measured.volume),
    );
    let further = further(patient, report);
    Some(DiscoverSpec {
        cycle_length_ms: patient.file.cycle_length_ms,
        pressure: pressure?,
        volume: volume?,
        noise: measured.noise.clone().unwrap_or_default(),
        aortic_pressure: measured.aortic_pressure.clone(),
        forward_stroke_volume: measured.forward_stroke_volume.clone(),
        diastasis: measured.diastasis.clone(),
        traces: further.0?,
        valve_times: measured.valve_times.clone(),
        qrs: measured.qrs.clone(),
        loaded: further.1?,
        wall_volume_ml: patient.file.anatomy.wall_volume_ml,
        left_atrial_pressure_mmhg: patient
            .file
            .preload
            .as_ref()
            .map(|preload| preload.left_atrial_pressure_mmhg),
        afterload: patient.file.afterload,
        effects: effects.to_vec(),
        seed,
    })
}

/// Further traces, and beats under changed load, with their files; `None` if a file cannot be read.
fn further(
    patient: &Patient,
    report: &mut Report,
) -> (Option<Vec<FurtherTraceSpec>>, Option<Vec<LoadedBeatSpec>>) {
    let measured = &patient.file.measured;
    let mut file =
        |role: &str, name: &str| hash(role, &patient.folder.join(name), &patient.id, report);
    let stated = measured.traces.iter().flat_map(|traces| traces.stated());
    let traces = stated
        .map(|stated| {
            let file = file(stated.quantity.name(), stated.file)?;
            Some(stated.with_file(file))
        })
        .collect();
    let loaded = (measured.loaded.iter().enumerate())
        .map(|(idx, beat)| {
            let role = |of: &str| format!("loaded_{}_{of}", idx + 1);
            Some(LoadedBeatSpec {
                cycle_length_ms: beat.cycle_length_ms.unwrap_or(patient.file.cycle_length_ms),
                pressure: file(&role("pressure"), &beat.pressure)?,
                volume: file(&role("volume"), &beat.volume)?,
            })
        })
        .collect();
    (traces, loaded)
}
