//! How the nodes' traces of step 1's result spread, read from the targets' artefact.

use cardiotwin_schemas::record::PatientRecord;

use super::columns::{Columns, ColumnsError};
use super::signals::SignalKind;

/// Shares of the wall below the values, percent, as in the columns' names.
pub const LEVELS: [u32; 5] = [5, 25, 50, 75, 95];

/// The spread of one quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Which.
    pub kind: SignalKind,
    /// For each of [`LEVELS`] the trace.
    pub levels: [Vec<(f64, f64)>; 5],
}

/// All that a file holds.
#[derive(Debug, Clone, PartialEq)]
pub struct SpreadFile {
    /// Active stress, calcium where there is any, stretch.
    pub all: Vec<Spread>,
}

impl SpreadFile {
    /// Of a patient; `None` where the targets left none.
    ///
    /// # Errors
    /// [`ColumnsError`] naming the file.
    pub fn read(patient: &PatientRecord) -> Result<Option<Self>, ColumnsError> {
        let Some(file) = patient
            .targets
            .as_ref()
            .and_then(|targets| targets.artefact("spread"))
        else {
            return Ok(None);
        };
        let columns = Columns::read(&file)?;
        let of = |kind: SignalKind| {
            let mut levels: [Vec<(f64, f64)>; 5] = Default::default();
            for (level, trace) in LEVELS.iter().zip(&mut levels) {
                *trace = columns.pairs("time_ms", &format!("{}_p{level}", kind.column()))?;
            }
            Some(Spread { kind, levels })
        };
        let kinds = [
            SignalKind::Stretch,
            SignalKind::ActiveStress,
            SignalKind::Calcium,
        ];
        Ok(Some(Self {
            all: kinds.into_iter().filter_map(of).collect(),
        }))
    }
}
