//! Printed forms of the quantities that files name by keys: symbol, unit and meaning.

use crate::biomarkers::{Biomarker, CELL_BIOMARKERS};
use crate::cell::CELL;
use crate::step1::Step1Parameter;

/// Symbol, unit and meaning of a parameter or biomarker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Label {
    /// Key in files, for example `tau_SR_ref_ms`.
    pub key: &'static str,
    /// Symbol, for example `τ`.
    pub symbol: &'static str,
    /// Subscript of the symbol, for example `SR,ref`; may be empty.
    pub subscript: &'static str,
    /// Unit, for example `ms`; empty for a dimensionless quantity.
    pub unit: &'static str,
    /// Meaning in a few words, in lower case, for tables and messages.
    pub meaning: &'static str,
}

impl Label {
    /// Label of a biomarker, or of a parameter of step 1 or of the cell model, by its key; `None`
    /// for other keys.
    #[must_use]
    pub fn of(key: &str) -> Option<Self> {
        let of_step1 = Step1Parameter::ALL.into_iter().map(Step1Parameter::label);
        let of_cell = CELL.iter().map(|parameter| parameter.label);
        let of_beat = Biomarker::ALL.into_iter().map(Biomarker::label);
        of_step1
            .chain(of_cell)
            .chain(of_beat)
            .chain(CELL_BIOMARKERS)
            .find(|label| label.key == key)
    }
}
