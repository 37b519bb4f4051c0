//! Motion of a patient's finite-element ventricle against the normal ranges.

use cardiotwin_schemas::motion::{Against, MOTION};
use cardiotwin_schemas::record::PatientRecord;

use crate::results::PatientView;
use crate::table::{Cell, Column, Kind, Table, Tone, cells, number};

/// Each measure by step, with a mark for its place next to the normal range; `None` without a
/// finite-element beat.
#[must_use]
pub fn by_step(record: &PatientRecord) -> Option<Table> {
    let view = PatientView(record);
    let beats: Vec<_> = view
        .steps()
        .iter()
        .map(|step| view.beat(*step).and_then(|beat| beat.result.motion))
        .collect();
    if beats.iter().all(Option::is_none) {
        return None;
    }
    let mut columns = vec![Column::words("motion"), Column::words("unit")];
    for step in view.steps() {
        columns.push(Column::numbers(step.key()).label(step.name()));
        columns.push(Column::words(format!("{}_against", step.key())).label(""));
    }
    columns.extend([
        Column::words("normal"),
        Column::new("source", Kind::Remarks),
    ]);
    let title = "Motion, against the normal range";
    let mut table = Table::new("motion", title, columns);
    for measure in MOTION {
        let mut row = cells![measure.name, measure.unit];
        for beat in &beats {
            row.push(Cell::from(beat.as_ref().and_then(measure.of)));
            let against = beat.as_ref().and_then(|beat| measure.against(beat));
            row.push(
                Cell::from(against.map_or("", Against::as_str)).toned(against.map(|against| {
                    match against {
                        Against::Within => Tone::Good,
                        _ => Tone::Doubtful,
                    }
                })),
            );
        }
        let [lower, upper] = measure.normal.map(number);
        row.extend(cells![format!("{lower} to {upper}"), measure.source]);
        table.rows.push(row);
    }
    Some(table)
}
