//! From a folder of recordings that was read to a patient's files, and what each step says of itself.

mod afterload;
mod files;
mod patient;
mod settings;
mod steps;

use cardiotwin_recordings::prepare::{PrepareError, Prepared, Raw, prepare};
use cardiotwin_schemas::preparation::{BeatLeftOut, BeatsFound, Preparation};

pub use afterload::{EjectionFlow, ejection_flow, table as afterload_table};

use crate::input::RawFolder;

/// Folder beside `patient.toml` that holds what the steps did.
pub const PREPARED: &str = "prepared";

/// A patient made of recordings: nothing is written yet.
#[derive(Debug, Clone)]
pub struct Made {
    /// What the steps did.
    pub prepared: Prepared,
    /// The same for people and machines; `written` is for who writes.
    pub answer: Preparation,
    /// Files of the patient's folder: name, content. `prepare.json` and drawings come beside them.
    pub files: Vec<(String, String)>,
}

/// Makes a patient.
///
/// # Errors
/// [`PrepareError`] where the recordings give no beat.
pub fn make(folder: &RawFolder, id: &str) -> Result<Made, PrepareError> {
    let raw = Raw {
        recording: folder.recording.clone(),
        cine: folder.cine.clone(),
        whole_heart: settings::whole_heart(&folder.file),
    };
    let prepared = prepare(&raw, &settings::of(&folder.file.steps))?;
    let facts = patient::Facts::of(folder, &prepared);
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
        .found
        .beats
        .iter()
        .zip(&prepared.reasons)
        .enumerate()
        .filter_map(|(idx, (beat, reasons))| {
            Some(BeatLeftOut {
                number: idx + 1,
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
