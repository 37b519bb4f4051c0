//! Labels of all quantities that files name by keys.

use crate::biomarkers::{Biomarker, CELL_BIOMARKERS};
use crate::cell::CELL;
use crate::label::Label;
use crate::step1::Step1Parameter;

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
