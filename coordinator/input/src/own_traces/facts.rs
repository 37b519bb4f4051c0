//! What was understood of traces, quantity by quantity.

use cardiotwin_schemas::patient::PatientFile;

use super::read::OwnTraces;
use super::rises::ends;
use super::told::{Learned, Signal, column_words};
use crate::preparation::Made;

/// Where a value comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// From the file, as its header or the user says.
    Measured,
    /// From the file, under an assumption on what a column is or which unit it has.
    Assumed,
}

impl Origin {
    /// The origin in a word.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Assumed => "assumed",
        }
    }
}

/// A quantity as it was understood.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// Name of the quantity.
    pub quantity: &'static str,
    /// Value with its unit, in words.
    pub value: String,
    /// Where it comes from.
    pub origin: Origin,
    /// From what, in words.
    pub from: String,
}

/// What was understood, in the order of a table.
#[must_use]
pub fn facts(traces: &OwnTraces, made: &Made, patient: &PatientFile) -> Vec<Fact> {
    let average = &made.prepared.average;
    let column = |signal: &Signal| {
        let learned = match (signal.chosen.0, signal.unit.0) {
            (Learned::Told, Learned::Told) => Origin::Measured,
            _ => Origin::Assumed,
        };
        let from = format!(
            "{} {}, {}",
            column_words(&signal.label),
            signal.chosen.1,
            signal.unit.1
        );
        (learned, from)
    };
    let fact = |quantity, value, (origin, from)| Fact {
        quantity,
        value,
        origin,
        from,
    };
    let measured = |from: &str| (Origin::Measured, from.to_owned());
    let range = |values: &[f64], unit: &str| {
        let (low, high) = ends(values);
        format!("{low:.1} to {high:.1} {unit}")
    };
    let origin = match traces.time.0 {
        Learned::Told => Origin::Measured,
        Learned::Guessed => Origin::Assumed,
    };
    let recording = &traces.raw.recording;
    let n_rows = traces.raw.inputs.first().map_or(0, |input| input.n_rows);
    let mut facts = vec![
        fact(
            "pressure",
            range(&traces.pressure.values, "mmHg"),
            column(&traces.pressure),
        ),
        fact(
            "volume",
            range(&traces.volume.values, "mL"),
            column(&traces.volume),
        ),
        fact(
            "time",
            format!(
                "{n_rows} samples in {:.2} s",
                1e-3 * recording.duration_ms()
            ),
            (origin, traces.time.1.clone()),
        ),
    ];
    let beats = &made.answer.beats;
    match &traces.single {
        Some(how) => facts.push(fact(
            "cycle length",
            format!("{:.1} ms", average.cycle_length_ms),
            (origin, format!("a single beat, {how}")),
        )),
        None => {
            facts.push(fact(
                "beats",
                format!("{} of {}", beats.kept, beats.found),
                measured("those that are alike; their mean is the patient's beat"),
            ));
            facts.push(fact(
                "cycle length",
                format!("{:.1} ms", average.cycle_length_ms),
                (origin, "the median of the beats".to_owned()),
            ));
        }
    }
    let from = "where the pressure begins to rise";
    if let Some(lv) = &average.lv_pressure {
        facts.push(fact(
            "end-diastolic pressure",
            format!("{:.1} mmHg", lv.mean[0]),
            measured(from),
        ));
    }
    if let Some(volume) = &made.prepared.volume {
        let volumes = &volume.synchronised.volume_ml;
        let begin = volume.synchronised.at(0.0);
        let (low, high) = ends(volumes);
        facts.push(fact(
            "end-diastolic volume",
            format!("{begin:.1} mL"),
            measured(from),
        ));
        facts.push(fact(
            "stroke volume",
            format!("{:.1} mL", high - low),
            measured("the largest minus the smallest volume"),
        ));
    }
    if let Some(cuff) = &patient.measured.aortic_pressure {
        facts.push(fact(
            "arterial pressure",
            format!("{:.0}/{:.0} mmHg", cuff.systolic_mmhg, cuff.diastolic_mmhg),
            measured("as stated"),
        ));
    }
    if let Some(wall) = patient.anatomy.wall_volume_ml {
        facts.push(fact(
            "wall volume",
            format!("{wall:.1} mL"),
            measured("as stated"),
        ));
    }
    if let Some(preload) = &patient.preload {
        let value = format!("{:.1} mmHg", preload.left_atrial_pressure_mmhg);
        facts.push(fact("filling pressure", value, measured("as stated")));
    }
    facts
}
