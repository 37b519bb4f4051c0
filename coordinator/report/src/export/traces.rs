//! All traces of a run in long form, with one value per row.

use std::io::{self, Write};

use cardiotwin_schemas::record::RunRecord;

use super::parquet::{Parquet, Values};
use crate::results::{Signal, Signals};

const COLUMNS: [&str; 7] = [
    "patient", "source", "signal", "time_ms", "value", "unit", "clock",
];

/// Writes the columns `patient,source,signal,time_ms,value,unit,clock`, one patient after the other, so
/// that memory does not grow with the cohort. `problems` gets a sentence for each file that could
/// not be read.
pub fn write(run: &RunRecord, out: &mut dyn Write, problems: &mut Vec<String>) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(COLUMNS)?;
    for patient in &run.patients {
        let signals = Signals::read_as_stored(patient);
        for signal in &signals.all {
            for (time, value) in &signal.points {
                csv.write_record([
                    patient.plan.id.as_str(),
                    signal.source.name(),
                    signal.kind.name(),
                    &time.to_string(),
                    &value.to_string(),
                    signal.kind.unit(),
                    signal.kind.clock(),
                ])?;
            }
        }
        problems.extend(signals.problems);
    }
    csv.flush()
}

/// Writes the same columns as Parquet, with a group of rows for each patient.
pub fn write_parquet(run: &RunRecord, out: &mut (dyn Write + Send)) -> io::Result<()> {
    let text = || Values::Text(Vec::new());
    let number = || Values::Number(Vec::new());
    let empty = [text(), text(), text(), number(), number(), text(), text()];
    let mut file = Parquet::begin(out, &COLUMNS, &empty)?;
    for patient in &run.patients {
        let signals = Signals::read_as_stored(patient).all;
        let each = |name: &dyn Fn(&Signal) -> String| {
            let names = signals
                .iter()
                .flat_map(|signal| std::iter::repeat_n(Some(name(signal)), signal.points.len()));
            Values::Text(names.collect())
        };
        let points = || signals.iter().flat_map(|signal| &signal.points);
        file.rows(&[
            each(&|_| patient.plan.id.to_string()),
            each(&|signal| signal.source.name().to_owned()),
            each(&|signal| signal.kind.name().to_owned()),
            Values::Number(points().map(|(time, _)| Some(*time)).collect()),
            Values::Number(points().map(|(_, value)| Some(*value)).collect()),
            each(&|signal| signal.kind.unit().to_owned()),
            each(&|signal| signal.kind.clock().to_owned()),
        ])?;
    }
    file.end()
}
