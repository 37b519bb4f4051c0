//! A flow and a pressure named on the command line, read as one record.

use std::path::Path;

use cardiotwin_calibrate::afterload::{AfterloadError, Record};
use cardiotwin_input::preparation::ejection_flow;
use cardiotwin_schemas::afterload::AfterloadRecord;
use cardiotwin_signals::checks::Facts;
use cardiotwin_signals::{Problem, Quantity, Trace};
use cardiotwin_units::Ms;

use super::trace::{self, Accepted};
use crate::error::CliError;
use crate::talk::{Talk, count};

/// A record that was read, with its description.
pub struct Measured {
    /// Flow and pressure on one time grid, for the fit.
    pub record: Record,
    /// Names, counts and means, for the answer.
    pub described: AfterloadRecord,
    /// Pressure samples in use: time since the first sample, ms, and pressure, mmHg.
    pub pressure: Vec<(f64, f64)>,
    /// What is doubtful about the two files, in words.
    pub doubts: Vec<String>,
}

/// Relative difference between the lengths of two records that is worth a word.
const LENGTHS: f64 = 0.05;
/// Relative difference between R1 + R2 and mean pressure over mean flow that is worth a word. They are
/// equal where the record is periodic.
const RESISTANCE: f64 = 0.15;

/// Compliance over stroke volume over pulse pressure, outside of which it is worth a word. Without R1 it
/// is below 1; in the records of examples/afterload it is 0.9 in a human, 1.4 to 1.8 in pigs in vivo.
const COMPLIANCE: std::ops::RangeInclusive<f64> = 0.25..=2.0;

impl Measured {
    /// Warning where a fit's compliance does not go with the stroke volume and the pulse pressure.
    pub fn against_pulse(&self, compliance: f64) -> Option<String> {
        let of = &self.described;
        let stroke_ml = of.mean_flow_ml_per_s * of.cycle_length_ms / 1e3;
        let usual = stroke_ml / of.pulse_pressure_mmhg;
        (!COMPLIANCE.contains(&(compliance / usual))).then(|| {
            format!(
                "C = {compliance:.2} mL/mmHg, but a stroke of {stroke_ml:.0} mL over a pulse of {:.0} \
                 mmHg is {usual:.2}: check that flow and pressure are of the same site and instant, and \
                 that the flow has no sharp peak, which R1 turns into pressure",
                of.pulse_pressure_mmhg
            )
        })
    }

    /// Mean pressure over mean flow, mmHg s/mL.
    fn resistance(&self) -> f64 {
        mean(&self.pressure) / self.described.mean_flow_ml_per_s
    }

    /// Warning where the sum of a fit's resistances is not the mean pressure over the mean flow.
    pub fn against(&self, r1: f64, r2: f64) -> Option<String> {
        let expected = self.resistance();
        let off = ((r1 + r2) / expected - 1.0).abs();
        (off.is_nan() || off > RESISTANCE).then(|| {
            format!(
                "R1 + R2 = {:.3} mmHg s/mL, but the mean pressure over the mean flow is {expected:.3}: \
                 the record is not periodic, too short, or flow and pressure are of other times",
                r1 + r2
            )
        })
    }
}

fn mean(samples: &[(f64, f64)]) -> f64 {
    samples.iter().map(|(_, value)| value).sum::<f64>() / samples.len().max(1) as f64
}

/// Time that samples cover, the last one included.
fn sampled_ms(trace: &Trace) -> f64 {
    let n = trace.n_samples() as f64;
    (trace.end_ms() - trace.time_ms()[0]) * n / (n - 1.0)
}

/// What is doubtful about the times of a flow and a pressure.
fn doubts(q: &Trace, p: &Trace) -> Vec<String> {
    let mut said = Vec::new();
    let length = |trace: &Trace| trace.end_ms() - trace.time_ms()[0];
    let (of_flow, of_pressure) = (length(q), length(p));
    if (of_flow - of_pressure).abs() > LENGTHS * of_flow.max(of_pressure) {
        said.push(format!(
            "a flow of {of_flow:.0} ms and a pressure of {of_pressure:.0} ms: are they of the same \
             beats, and counted from the same instant?"
        ));
    }
    said
}

/// Source of a flow.
#[derive(Debug, Clone, Copy)]
pub enum FlowSource<'a> {
    /// A file of measured flow.
    Measured(&'a Path),
    /// A file of volume whose fall in ejection is the flow, and its cycle length in ms if given.
    Ejected(&'a Path, Option<f64>),
}

impl FlowSource<'_> {
    /// The file from which the flow is computed.
    #[must_use]
    pub fn file(&self) -> &Path {
        match self {
            Self::Measured(file) | Self::Ejected(file, _) => file,
        }
    }

    /// Name of the flow in answers.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Measured(file) => file.display().to_string(),
            Self::Ejected(file, _) => format!("-dV/dt in ejection of {}", file.display()),
        }
    }

    /// Reads the flow and prints every problem.
    ///
    /// # Errors
    /// [`CliError::Trace`] if the trace has errors or no flow can be derived from the volume.
    pub fn read(&self, talk: &Talk) -> Result<Trace, CliError> {
        let (file, given) = match self {
            Self::Measured(file) => return trace::read(file, Quantity::Flow, talk),
            Self::Ejected(file, given) => (*file, *given),
        };
        let volume = trace::read(file, Quantity::Volume, talk)?;
        let refused = |why: String| {
            let remedy = "give one whole cycle of the ventricle's volume, and its length with --cycle-length";
            trace::refused(
                Problem::error(file, why, "a volume that falls in ejection", remedy),
                talk,
            )
        };
        let cycle_ms = given.unwrap_or_else(|| sampled_ms(&volume));
        let flow =
            ejection_flow(&volume, Ms(cycle_ms)).map_err(|error| refused(error.to_string()))?;
        Trace::uniform(Quantity::Flow, flow.step_ms, flow.flow_ml_per_s)
            .map_err(|error| refused(error.to_string()))
    }
}

/// Reads both files, prints every problem, and prints a note if their sampling differs.
///
/// # Errors
/// [`CliError::Trace`] if a trace has errors or the two do not make a record.
pub fn read(
    flow: &Path,
    pressure: &Path,
    accepted: Accepted<'_>,
    talk: &Talk,
) -> Result<Measured, CliError> {
    read_from(FlowSource::Measured(flow), pressure, accepted, talk)
}

/// Reads flow and pressure, where the flow may come from a volume.
///
/// # Errors
/// The same as for [`read`].
pub fn read_from(
    source: FlowSource<'_>,
    pressure: &Path,
    accepted: Accepted<'_>,
    talk: &Talk,
) -> Result<Measured, CliError> {
    // Both files are read before either is refused, so that the user sees all problems at once.
    let (q, p) = trace::both(
        source.read(talk),
        trace::read(pressure, Quantity::Pressure, talk),
    )?;
    let flow = source.file();
    let record = Record::new(q.time_ms(), q.values(), p.time_ms(), p.values())
        .map_err(|error| trace::refused(problem(flow, pressure, &error), talk))?;
    let record = match source {
        FlowSource::Measured(_) => record,
        FlowSource::Ejected(..) => record.of_one_cycle(sampled_ms(&q)),
    };
    if !record.sampled_alike() {
        talk.say(
            "note: flow and pressure are sampled at different times; the flow is interpolated \
             linearly, and the load is computed at the pressure's times",
        );
    }
    if record.n_dropped() > 0 {
        let left_out = count(record.n_dropped(), "pressure sample");
        talk.say(&format!(
            "note: {left_out} omitted, at times without a measured flow"
        ));
    }
    if let Some(problem) = no_beat(&record, pressure) {
        return Err(trace::refused(problem, talk));
    }
    let described = AfterloadRecord {
        flow: source.name(),
        pressure: pressure.display().to_string(),
        n_samples: record.n_samples(),
        n_left_out: record.n_dropped(),
        n_beats: record.n_beats(),
        cycle_length_ms: record.cycle_ms(),
        mean_flow_ml_per_s: record.mean_flow_ml_per_s(),
        pulse_pressure_mmhg: record.pulse_pressure_mmhg(),
    };
    let samples = record.pressure_samples();
    let of_flow = Facts {
        aortic_flow_ml_per_s: Some(described.mean_flow_ml_per_s),
        ..Facts::default()
    };
    let of_pressure = Facts {
        aortic_mean_mmhg: Some(mean(&samples)),
        ..Facts::default()
    };
    let mut broken = accepted.doubts(&of_flow, flow);
    broken.extend(accepted.doubts(&of_pressure, pressure));
    // A misspelt name is reported for each file.
    broken.dedup_by(|a, b| a.key.as_deref() == Some(accepted.option) && a.found == b.found);
    trace::checked(broken, talk)?;
    let doubts = doubts(&q, &p);
    Ok(Measured {
        pressure: samples,
        record,
        described,
        doubts,
    })
}

/// Lengths of a beat \[ms\].
const CYCLE_MS: std::ops::RangeInclusive<f64> = 100.0..=5000.0;
/// Smallest difference of a pulse's pressures \[mmHg\].
const PULSE_MMHG: f64 = 1.0;

/// Why a record is none of a heart's beats.
fn no_beat(record: &Record, pressure: &Path) -> Option<Problem> {
    let (cycle_ms, pulse) = (record.cycle_ms(), record.pulse_pressure_mmhg());
    if !CYCLE_MS.contains(&cycle_ms) {
        let expected = format!("a beat of {} to {} ms", CYCLE_MS.start(), CYCLE_MS.end());
        let remedy = "are the times in s, or numbers of samples? convert those of both files to ms";
        let found = format!("a beat of {cycle_ms:.4} ms");
        return Some(Problem::error(pressure, found, expected, remedy).at_key("time_ms"));
    }
    (pulse < PULSE_MMHG).then(|| {
        Problem::error(
            pressure,
            format!("a pulse pressure of {pulse:.3} mmHg"),
            format!("a pulse of at least {PULSE_MMHG} mmHg"),
            "give the aorta's pressure of at least one beat, not its mean",
        )
        .at_key(Quantity::Pressure.column())
    })
}

/// Error of the record as a problem of one of its files.
fn problem(flow: &Path, pressure: &Path, error: &AfterloadError) -> Problem {
    match error {
        AfterloadError::Samples { trace, n_times, .. } => {
            let file = if *trace == "flow" { flow } else { pressure };
            let remedy = "export the trace with more samples";
            Problem::error(file, format!("{n_times} samples"), "at least 20 samples over one beat or more", remedy)
        }
        AfterloadError::Overlap { n_samples, flow_ms, pressure_ms } => Problem::error(
            pressure,
            format!(
                "{n_samples} samples at times with a measured flow: pressure from {} to {} ms, flow \
                 from {} to {} ms",
                pressure_ms[0], pressure_ms[1], flow_ms[0], flow_ms[1]
            ),
            "at least 20",
            "count the times of both files from the same instant",
        )
        .at_key("time_ms"),
        AfterloadError::NoEjection { lowest_ml_per_s, highest_ml_per_s } => Problem::error(
            flow,
            format!("values from {lowest_ml_per_s} to {highest_ml_per_s} mL/s without an ejection"),
            "a pulse of positive flow out of the heart",
            "change the sign if the probe was mounted the other way, and give at least one whole \
             beat",
        )
        .at_key("flow_mL_per_s"),
        AfterloadError::Sample { .. }
        | AfterloadError::Cuff { .. }
        | AfterloadError::NoLoad { .. }
        | AfterloadError::Confidence { .. }
        | AfterloadError::LeastSquares(_) => {
            Problem::error(pressure, error.to_string(), "aortic flow and pressure", "check both traces")
        }
    }
}
