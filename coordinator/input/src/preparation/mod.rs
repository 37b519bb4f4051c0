//! Preparation of a patient's files from a folder of recordings, with a description of each step.

mod afterload;
mod facts;
mod files;
mod patient;
mod steps;

use cardiotwin_recordings::prepare::{PrepareError, Prepared, Raw, prepare};
use cardiotwin_schemas::preparation::{BeatLeftOut, BeatsFound, Preparation};
use cardiotwin_signals::checks::{Facts, VOLUME_KEY, contradictions, top_is_cut};
use cardiotwin_signals::{Problem, Quantity, Trace};

pub use afterload::{EjectionFlow, EjectionFlowError, ejection_flow, table as afterload_table};
pub use files::PREPARED;

use crate::RawFolder;

/// A patient prepared from recordings, before anything is written.
#[derive(Debug, Clone)]
pub struct Made {
    /// Results of the steps.
    pub prepared: Prepared,
    /// Description of the results. The caller that writes the files fills in `written`.
    pub answer: Preparation,
    /// Contradictions among the results; with an error among them nothing should be written.
    pub problems: Vec<Problem>,
    /// Name and content of the files in the patient's folder. The caller adds `prepare.json` and
    /// drawings.
    pub files: Vec<(String, String)>,
}

/// Prepares a patient.
///
/// # Errors
/// [`PrepareError`] if no beat can be made from the recordings.
pub fn make(folder: &RawFolder, id: &str) -> Result<Made, PrepareError> {
    let raw = Raw {
        recording: folder.recording.clone(),
        cine: folder.cine.clone(),
        whole_heart: folder.file.whole_heart,
    };
    let prepared = prepare(&raw, &folder.file.steps)?;
    let facts = facts::Facts::of(folder, &prepared);
    let load = afterload::fit(folder, &prepared, &facts);
    let mut warnings = steps::warnings(folder, &prepared);
    warnings.extend(load.warning());
    let patient_toml = patient::toml(id, folder, &prepared, &facts, &load);
    let answer = Preparation {
        schema_version: cardiotwin_schemas::formats::PREPARATION.version,
        id: id.to_owned(),
        files: folder.inputs.clone(),
        cycle_length_ms: prepared.average.cycle_length_ms,
        beats: beats(folder, &prepared),
        steps: steps::done(folder, &prepared, &facts, &load),
        warnings,
        written: Vec::new(),
        patient_toml: patient_toml.clone(),
    };
    let mut files = vec![("patient.toml".to_owned(), patient_toml)];
    files.extend(files::tables(folder, &prepared));
    let problems = contradictions_of(folder, &prepared, &facts, &load);
    Ok(Made {
        prepared,
        answer,
        problems,
        files,
    })
}

/// The rules of consistency that the results break.
fn contradictions_of(
    folder: &RawFolder,
    prepared: &Prepared,
    facts: &facts::Facts,
    load: &afterload::Load,
) -> Vec<Problem> {
    let average = &prepared.average;
    let pressure = average
        .lv_pressure
        .as_ref()
        .and_then(|lv| Trace::uniform(Quantity::Pressure, average.step_ms, lv.mean.clone()).ok());
    let aortic_pressure = average.aortic_pressure.as_ref().and_then(|aorta| {
        Trace::uniform(Quantity::Pressure, average.step_ms, aorta.mean.clone()).ok()
    });
    let volume = prepared.volume.as_ref().and_then(|volume| {
        let frames = &volume.synchronised;
        Trace::new(
            Quantity::Volume,
            frames.time_ms.clone(),
            frames.volume_ml.clone(),
        )
        .ok()
    });
    let told = Facts {
        cycle_ms: average.cycle_length_ms,
        cut_beats: cut_beats(folder, prepared),
        pressure: pressure.as_ref(),
        aortic_pressure: aortic_pressure.as_ref(),
        volume: volume.as_ref(),
        aorta: facts
            .aortic
            .map(|(systolic, diastolic, ..)| [systolic, diastolic]),
        forward_ml: facts.forward.map(|(volume, ..)| volume),
        windkessel: load.parameters(),
        ..Facts::default()
    };
    let file = folder
        .inputs
        .first()
        .map_or("the recordings", |input| input.file.as_str());
    let mut problems = contradictions(&told, &folder.file.accept, std::path::Path::new(file));
    // Frames of a cine were judged on their own clock when they were read.
    if prepared
        .volume
        .as_ref()
        .is_some_and(|v| !v.on_pressure_clock)
    {
        problems.retain(|problem| problem.key.as_deref() != Some(VOLUME_KEY));
    }
    problems
}

/// Beats of the mean whose own top an amplifier cut, and all of them.
fn cut_beats(folder: &RawFolder, prepared: &Prepared) -> Option<[usize; 2]> {
    let recording = &folder.recording;
    let pressure = recording.channels.lv_pressure_mmhg.as_ref()?;
    let at = |ms: f64| ((ms / recording.step_ms).round() as usize).min(pressure.len());
    let of_mean: Vec<Trace> = prepared
        .judged()
        .filter(|(_, _, reasons)| reasons.is_empty())
        .filter_map(|(_, beat, _)| {
            let values = pressure.get(at(beat.onset_ms)..at(beat.onset_ms + beat.length_ms))?;
            Trace::uniform(Quantity::Pressure, recording.step_ms, values.to_vec()).ok()
        })
        .collect();
    let n_cut = of_mean.iter().filter(|beat| top_is_cut(beat)).count();
    Some([n_cut, of_mean.len()])
}

fn beats(folder: &RawFolder, prepared: &Prepared) -> BeatsFound {
    let recording = &folder.recording;
    let left_out: Vec<BeatLeftOut> = prepared
        .judged()
        .filter_map(|(number, beat, reasons)| {
            Some(BeatLeftOut {
                number,
                onset_ms: recording.begin_ms + recording.elapsed_ms(beat.onset_ms),
                length_ms: beat.length_ms,
                kind: reasons.first()?.kind().to_owned(),
                reasons: reasons.iter().map(ToString::to_string).collect(),
            })
        })
        .collect();
    let found = prepared.found.beats.len();
    BeatsFound {
        source: steps::source_in_words(folder, prepared).to_owned(),
        found,
        kept: found - left_out.len(),
        left_out,
    }
}
