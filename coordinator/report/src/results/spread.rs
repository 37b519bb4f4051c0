//! Spread of the nodes' traces in step 1's result, read from the targets' artefact.

use cardiotwin_schemas::record::PatientRecord;

use super::columns::{Columns, ColumnsError};
use super::signals::SignalKind;

/// Percentages of the wall that lie below the values, as in the columns' names.
pub const LEVELS: [u32; 5] = [5, 25, 50, 75, 95];

/// The spread of one quantity.
#[derive(Debug, Clone, PartialEq)]
pub struct Spread {
    /// Quantity whose runs are compared.
    pub kind: SignalKind,
    /// One trace for each of [`LEVELS`].
    pub levels: [Vec<(f64, f64)>; 5],
}

/// Content of a file of spreads.
#[derive(Debug, Clone, PartialEq)]
pub struct SpreadFile {
    /// Spreads of stretch, active stress and, if there is any, calcium.
    pub all: Vec<Spread>,
}

impl SpreadFile {
    /// The spread of a patient; `None` if the targets left no such file.
    ///
    /// # Errors
    /// [`ColumnsError`] with the file.
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
