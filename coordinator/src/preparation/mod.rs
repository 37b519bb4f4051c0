//! Preparation of a patient's files from a folder of recordings, with a description of each step.

mod afterload;
mod facts;
mod files;
mod patient;
mod steps;

use cardiotwin_recordings::prepare::{PrepareError, Prepared, Raw, prepare};
use cardiotwin_schemas::preparation::{BeatLeftOut, BeatsFound, Preparation};

pub use afterload::{EjectionFlow, EjectionFlowError, ejection_flow, table as afterload_table};
pub use files::PREPARED;

use crate::input::RawFolder;

/// A patient prepared from recordings, before anything is written.
#[derive(Debug, Clone)]
pub struct Made {
    /// Results of the steps.
    pub prepared: Prepared,
    /// Description of the results. The caller that writes the files fills in `written`.
    pub answer: Preparation,
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
    Ok(Made {
        prepared,
        answer,
        files,
    })
}

fn beats(folder: &RawFolder, prepared: &Prepared) -> BeatsFound {
    let begin = folder.recording.begin_ms;
    let left_out: Vec<BeatLeftOut> = prepared
        .judged()
        .filter_map(|(number, beat, reasons)| {
            Some(BeatLeftOut {
                number,
                onset_ms: begin + beat.onset_ms,
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
