//! All traces of a run in long form, with one value per row.

use std::io::{self, Write};

use cardiotwin_schemas::record::RunRecord;

use crate::results::Signals;

/// Writes the columns `patient,source,signal,time_ms,value,unit`, one patient after the other, so
/// that memory does not grow with the cohort. `problems` gets a sentence for each file that could
/// not be read.
pub fn write(run: &RunRecord, out: &mut dyn Write, problems: &mut Vec<String>) -> io::Result<()> {
    let mut csv = csv::Writer::from_writer(out);
    csv.write_record(["patient", "source", "signal", "time_ms", "value", "unit"])?;
    for patient in &run.patients {
        let signals = Signals::read(patient);
        for signal in &signals.all {
            for (time, value) in &signal.points {
                csv.write_record([
                    patient.plan.id.as_str(),
                    signal.source.name(),
                    signal.kind.name(),
                    &time.to_string(),
                    &value.to_string(),
                    signal.kind.unit(),
                ])?;
            }
        }
        problems.extend(signals.problems);
    }
    csv.flush()
}
