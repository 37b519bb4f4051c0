//! Biomarkers by step.

use cardiotwin_schemas::biomarkers::{Biomarker, Biomarkers};
use cardiotwin_schemas::record::PatientRecord;

use crate::results::comparison::relative_difference;
use crate::results::{PatientView, Step};
use crate::table::{Cell, Column, Digits, Kind, Table, cells};

/// A simulated beat: key and name of its column, and its biomarkers, if there is such a beat.
pub type Simulated<'a> = (&'static str, &'static str, Option<&'a Biomarkers>);

/// Every biomarker as it was measured, followed by its value in each beat and the relative
/// difference. Every table of biomarkers takes its columns from here.
#[must_use]
pub fn compared(measured: &Biomarkers, beats: &[Simulated<'_>]) -> Table {
    let mut columns = vec![
        Column::new("biomarker", Kind::Keys),
        Column::new("unit", Kind::Data),
        Column::new("meaning", Kind::Data),
        Column::numbers("measured"),
    ];
    for (key, name, _) in beats {
        let difference = Column::numbers(format!("{key}_difference"));
        columns.push(Column::numbers(*key).label(*name));
        columns.push(difference.label("difference").digits(Digits::Difference));
    }
    let mut table = Table::new("biomarkers", "Biomarkers", columns);
    for b in Biomarker::ALL {
        let measured = measured.get(b);
        let mut row = cells![b.key(), b.unit(), b.label().meaning, measured];
        for (.., beat) in beats {
            let simulated = beat.and_then(|values| values.get(b));
            let both = simulated.zip(measured);
            row.push(Cell::from(simulated));
            row.push(Cell::from(
                both.and_then(|(s, m)| relative_difference(s, m)),
            ));
        }
        table.rows.push(row);
    }
    table
}

/// The biomarkers of a patient by step.
#[must_use]
pub fn by_step(record: &PatientRecord) -> Table {
    let view = PatientView(record);
    let beats = Step::ALL.map(|step| (step.key(), step.name(), view.simulated(step)));
    compared(view.measured(), &beats)
}

/// The table for a reader: without biomarkers that nobody knows, and without a step 3 that is not
/// there.
#[must_use]
pub fn shown(record: &PatientRecord) -> Table {
    let absent = |step: &Step| !PatientView(record).steps().contains(step);
    by_step(record)
        .without(|column| {
            Step::ALL
                .iter()
                .any(|step| absent(step) && column.key.starts_with(step.key()))
        })
        .without_empty_rows()
}
