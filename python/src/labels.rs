//! The vocabulary as rows for tables: keys with units, symbols, meanings, defaults.

use cardiotwin_vocabulary::biomarkers::{Biomarker, CELL_BIOMARKERS};
use cardiotwin_vocabulary::cell::CELL;
use cardiotwin_vocabulary::label::Label;
use pyo3::prelude::*;

/// Name, unit and meaning.
type Row = (&'static str, &'static str, &'static str);
/// Name, unit, meaning, default, and the interval of the sensitivity analysis.
type ParameterRow = (
    &'static str,
    &'static str,
    &'static str,
    f64,
    Option<[f64; 2]>,
);

fn row(label: &Label) -> Row {
    (label.key, label.unit, label.meaning)
}

/// Parameters of the 0D cell: name, unit, meaning, default, interval of the sensitivity analysis.
#[pyfunction]
pub fn cell_parameters() -> Vec<ParameterRow> {
    let row = |p: &cardiotwin_vocabulary::cell::CellParameter| {
        let (key, unit, meaning) = row(&p.label);
        (key, unit, meaning, p.default, p.interval)
    };
    CELL.iter().map(row).collect()
}

/// Biomarkers of the 0D cell in the order of a batch's columns: name, unit, meaning.
#[pyfunction]
pub fn cell_biomarkers() -> Vec<Row> {
    CELL_BIOMARKERS.iter().map(row).collect()
}

/// Biomarkers of a ventricle's beat in the order of a batch's columns: name, unit, meaning.
#[pyfunction]
pub fn organ_biomarkers() -> Vec<Row> {
    Biomarker::ALL.iter().map(|b| row(&b.label())).collect()
}
