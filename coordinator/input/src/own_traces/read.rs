//! From a file of traces to recordings from which a patient is prepared.

use std::path::{Path, PathBuf};

use cardiotwin_input_files::{self as input_files, MaxBytes};
use cardiotwin_schemas::hash::sha256_hex;
use cardiotwin_schemas::patient::Preload;
use cardiotwin_schemas::preparation::RawInput;
use cardiotwin_schemas::raw::{BeatSource, RawFile};
use cardiotwin_signals::Problem;

use super::told::{Choices, Learned, NotUnderstood, Signal};
use super::{beat, columns, units};
use crate::RawFolder;

/// Traces that were understood.
#[derive(Debug, Clone)]
pub struct OwnTraces {
    /// Recordings in the form from which a patient is prepared.
    pub raw: RawFolder,
    /// Path of the file.
    pub file: PathBuf,
    pub(crate) pressure: Signal,
    pub(crate) volume: Signal,
    /// How the time of the samples was found, in words, and whether it was told.
    pub(crate) time: (Learned, String),
    /// Whether the file has a single beat, and how its length was found.
    pub(crate) single: Option<String>,
    /// Columns that are not read.
    pub others: Vec<String>,
}

/// Reads traces from a file of any format that `cardiotwin prepare` reads.
///
/// # Errors
/// [`NotUnderstood`] for a file that cannot be used, or with a question.
pub fn read(path: &Path, choices: &Choices) -> Result<OwnTraces, NotUnderstood> {
    let bytes = input_files::read(path, MaxBytes::TRACE).map_err(|error| {
        Problem::error(
            path,
            format!("no readable file ({error})"),
            "a file with pressure and volume traces",
            "correct the path",
        )
    })?;
    let table = columns::table(path, &bytes)?;
    let chosen = columns::choose(path, &table, choices)?;
    let pressure = units::pressure(path, &chosen.pressure, choices)?;
    let volume = units::volume(path, &chosen.volume, choices)?;
    let traces = beat::assemble(path, &chosen, (&pressure, &volume), choices)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let input = RawInput {
        file: name.into_owned(),
        sha256: sha256_hex(&bytes),
        n_rows: table.columns.first().map_or(0, |c| c.values.len()),
        read_as: vec![table.said.clone()],
    };
    let mut file = RawFile {
        cuff: choices.cuff,
        preload: choices
            .left_atrial_pressure_mmhg
            .map(|left_atrial_pressure_mmhg| Preload {
                left_atrial_pressure_mmhg,
            }),
        ..RawFile::default()
    };
    file.anatomy.wall_volume_ml = choices.wall_volume_ml;
    if let Some(cycle_ms) = traces.one_beat_ms {
        // The file itself is the beat: there is nothing to choose, to average or to compare.
        let steps = &mut file.steps;
        steps.beats.source = Some(BeatSource::Given);
        steps.beats.onsets_ms = vec![0.0, cycle_ms];
        steps.reject.enabled = false;
        steps.drift.enabled = false;
        steps.average.enabled = false;
        steps.noise.enabled = false;
    }
    Ok(OwnTraces {
        raw: RawFolder {
            file,
            recording: traces.recording,
            cine: None,
            flow: None,
            inputs: vec![input],
            made_by: "cardiotwin init --from",
        },
        file: path.to_owned(),
        pressure,
        volume,
        time: traces.time,
        single: traces.single,
        others: chosen.others,
    })
}
