//! A flow and a pressure named on the command line, as one record.

use std::path::Path;

use cardiotwin_calibrate::afterload::{AfterloadError, Record};
use cardiotwin_schemas::afterload::AfterloadRecord;
use cardiotwin_signals::{Problem, Quantity};

use super::trace;
use crate::cli::error::CliError;
use crate::cli::talk::{Talk, count};

/// What was read.
pub struct Measured {
    /// For the fit.
    pub record: Record,
    /// For the answer.
    pub described: AfterloadRecord,
    /// Pressure samples in use: time since the first, ms, and mmHg.
    pub pressure: Vec<(f64, f64)>,
}

/// Reads both files; says every problem, and how different samplings are dealt with.
///
/// # Errors
/// [`CliError::Trace`] for what cannot be used.
pub fn read(flow: &Path, pressure: &Path, talk: &Talk) -> Result<Measured, CliError> {
    // Both are read before either is refused, so that all problems are said at once.
    let (q, p) = (trace::read(flow, Quantity::Flow, talk), trace::read(pressure, Quantity::Pressure, talk));
    let (q, p) = (q?, p?);
    let record = Record::new(q.time_ms(), q.values(), p.time_ms(), p.values())
        .map_err(|error| trace::refused(problem(flow, pressure, &error), talk))?;
    if !record.sampled_alike() {
        talk.say(
            "note: flow and pressure are sampled at different times; the flow is taken as linear between its samples and \
             the load is computed at the pressure's times",
        );
    }
    if record.n_dropped() > 0 {
        let left_out = count(record.n_dropped(), "pressure sample");
        talk.say(&format!("note: {left_out} left out, where no flow was measured"));
    }
    let described = AfterloadRecord {
        flow: flow.display().to_string(),
        pressure: pressure.display().to_string(),
        n_samples: record.n_samples(),
        n_left_out: record.n_dropped(),
        n_beats: record.n_beats(),
        cycle_length_ms: record.cycle_ms(),
        mean_flow_ml_per_s: record.mean_flow_ml_per_s(),
        pulse_pressure_mmhg: record.pulse_pressure_mmhg(),
    };
    Ok(Measured { pressure: record.pressure_samples(), record, described })
}

/// What the record refused, as a problem of a file.
fn problem(flow: &Path, pressure: &Path, error: &AfterloadError) -> Problem {
    match error {
        AfterloadError::Samples { trace, n_times, .. } => {
            let file = if *trace == "flow" { flow } else { pressure };
            let remedy = "export the trace with more of its samples";
            Problem::error(file, format!("{n_times} samples"), "at least 20, over one beat or more", remedy)
        }
        AfterloadError::Overlap { n_samples, flow_ms, pressure_ms } => Problem::error(
            pressure,
            format!(
                "{n_samples} samples where flow was measured: pressure from {} to {} ms, flow from {} to {} ms",
                pressure_ms[0], pressure_ms[1], flow_ms[0], flow_ms[1]
            ),
            "at least 20",
            "count the times of both files from the same instant",
        )
        .at_key("time_ms"),
        AfterloadError::NoEjection { lowest_ml_per_s, highest_ml_per_s } => Problem::error(
            flow,
            format!("values from {lowest_ml_per_s} to {highest_ml_per_s} mL/s: nothing is ejected"),
            "a pulse of positive flow out of the heart",
            "turn the sign if the probe was mounted the other way, and give at least one whole beat",
        )
        .at_key("flow_mL_per_s"),
        AfterloadError::Sample { .. } | AfterloadError::Confidence { .. } | AfterloadError::LeastSquares(_) => {
            Problem::error(pressure, error.to_string(), "aortic flow and pressure", "look at both traces")
        }
    }
}
