//! The traces behind a patient's record, read from the measured files and the artefacts.

use std::path::{Path, PathBuf};

use cardiotwin_schemas::hash::sha256_of_file;
use cardiotwin_schemas::record::PatientRecord;

use super::columns::Columns;
use super::comparison::PatientView;

/// Source of a trace.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Source {
    /// The patient's measured traces.
    Measured,
    /// Step 1, the iterate that was taken (active stress, calcium, stretch: medians over its nodes).
    Step1,
    /// Step 2: the verification beat (active stress, calcium, stretch: the fitted cell).
    Step2,
    /// Step 3: the beat that was taken, if it is not the verification beat.
    Step3,
}

impl Source {
    /// Name of the source in files and columns.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Measured => "measured",
            Self::Step1 => "step1",
            Self::Step2 => "step2",
            Self::Step3 => "step3",
        }
    }
}

macro_rules! kinds {
    ($($kind:ident $name:literal $column:literal $unit:literal;)*) => {
        /// Quantity of a trace.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum SignalKind {
            $(#[doc = concat!("`", $column, "`")] $kind,)*
        }

        impl SignalKind {
            /// Name in files, without unit.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$kind => $name,)* }
            }

            /// Column of the artefact.
            #[must_use]
            pub fn column(self) -> &'static str {
                match self { $(Self::$kind => $column,)* }
            }

            /// Unit in files; `1` stands for dimensionless.
            #[must_use]
            pub fn unit(self) -> &'static str {
                match self { $(Self::$kind => $unit,)* }
            }
        }
    };
}

kinds! {
    Pressure "pressure" "pressure_mmHg" "mmHg";
    Volume "volume" "volume_mL" "mL";
    AorticPressure "aortic_pressure" "aortic_pressure_mmHg" "mmHg";
    AorticFlow "aortic_flow" "aortic_flow_mL_per_s" "mL/s";
    MitralFlow "mitral_flow" "mitral_flow_mL_per_s" "mL/s";
    ActiveStress "active_stress" "Sa_kPa" "kPa";
    Calcium "calcium" "Ca_uM" "uM";
    Stretch "stretch" "lambda" "1";
}

const BEAT: [SignalKind; 5] = [
    SignalKind::Pressure,
    SignalKind::Volume,
    SignalKind::AorticPressure,
    SignalKind::AorticFlow,
    SignalKind::MitralFlow,
];
const CELL: [SignalKind; 3] = [
    SignalKind::ActiveStress,
    SignalKind::Calcium,
    SignalKind::Stretch,
];

impl SignalKind {
    /// What times count from: the `beat`'s beginning, or the cell's `activation`, which comes later.
    #[must_use]
    pub fn clock(self) -> &'static str {
        if CELL.contains(&self) {
            "activation"
        } else {
            "beat"
        }
    }
}

/// One trace: time in ms on the clock of its kind, and value.
#[derive(Debug, Clone, PartialEq)]
pub struct Signal {
    /// Source of the trace.
    pub source: Source,
    /// Quantity of the trace.
    pub kind: SignalKind,
    /// Samples in order of time.
    pub points: Vec<(f64, f64)>,
}

/// Value of a trace at `x`: linear between samples, constant beyond the first and last one. `None`
/// for an empty trace.
#[must_use]
pub fn at(points: &[(f64, f64)], x: f64) -> Option<f64> {
    let i = points.partition_point(|p| p.0 < x);
    match (i.checked_sub(1).and_then(|i| points.get(i)), points.get(i)) {
        (Some(a), Some(b)) => Some(a.1 + (b.1 - a.1) * (x - a.0) / (b.0 - a.0)),
        (a, b) => a.or(b).map(|p| p.1),
    }
}

/// All traces that could be read, and the problems of the others.
#[derive(Debug, Clone, Default)]
pub struct Signals {
    /// Traces that were read.
    pub all: Vec<Signal>,
    /// One sentence for each file that is recorded but cannot be used.
    pub problems: Vec<String>,
}

impl Signals {
    /// Reads the files named in the record. A file that is not recorded is not missed. A recorded
    /// file that cannot be read becomes a problem instead of an error, because the other traces of
    /// the patient are still worth showing.
    #[must_use]
    pub fn read(patient: &PatientRecord) -> Self {
        Self::read_if(patient, |_, _| Ok(()))
    }

    /// As [`Signals::read`]. A file whose content is not the one whose hash is stored is left out, and
    /// becomes a problem.
    #[must_use]
    pub fn read_as_stored(patient: &PatientRecord) -> Self {
        Self::read_if(patient, as_stored)
    }

    fn read_if(patient: &PatientRecord, check: impl Fn(&Path, &str) -> Result<(), String>) -> Self {
        let mut signals = Self::default();
        let step0 = &patient.plan.step0;
        let measured = [
            (&step0.pressure, SignalKind::Pressure),
            (&step0.volume, SignalKind::Volume),
        ];
        // Traces that were corrected for artefacts are shown with the corrections with which they
        // were used.
        let corrected = patient
            .step0
            .as_ref()
            .and_then(|record| record.stored("measured"));
        for (input, kind) in measured {
            if let Some(input) = input {
                let own = || (input.path.clone(), input.sha256.as_str());
                let file = corrected.clone().unwrap_or_else(own);
                signals.add(Source::Measured, file, &[kind], &check);
            }
        }
        let step1 = PatientView(patient)
            .best_iteration()
            .and_then(|i| i.run.as_ref())
            .and_then(|r| r.stored("traces"));
        let parts = [
            (Source::Step1, step1, &BEAT[..]),
            (
                Source::Step2,
                patient
                    .verification
                    .as_ref()
                    .and_then(|r| r.stored("traces")),
                &BEAT[..],
            ),
            (
                Source::Step3,
                PatientView(patient)
                    .step3_beat()
                    .and_then(|r| r.stored("traces")),
                &BEAT[..],
            ),
            (
                Source::Step1,
                patient.targets.as_ref().and_then(|r| r.stored("median")),
                &CELL[..],
            ),
            (
                Source::Step2,
                patient.cell_fit.as_ref().and_then(|r| r.stored("cell")),
                &CELL[..],
            ),
        ];
        for (source, file, kinds) in parts {
            if let Some(file) = file {
                signals.add(source, file, kinds, &check);
            }
        }
        signals
    }

    fn add(
        &mut self,
        source: Source,
        (file, sha256): (PathBuf, &str),
        kinds: &[SignalKind],
        check: impl Fn(&Path, &str) -> Result<(), String>,
    ) {
        if let Err(problem) = check(&file, sha256) {
            self.problems.push(problem);
            return;
        }
        match Columns::read(&file) {
            Err(error) => self.problems.push(error.to_string()),
            Ok(columns) => {
                for kind in kinds {
                    match columns.pairs("time_ms", kind.column()) {
                        Some(points) => self.all.push(Signal {
                            source,
                            kind: *kind,
                            points,
                        }),
                        None if matches!(
                            kind,
                            SignalKind::Pressure | SignalKind::ActiveStress | SignalKind::Stretch
                        ) =>
                        {
                            self.problems.push(format!(
                                "{} has no usable columns `time_ms` and `{}`",
                                file.display(),
                                kind.column()
                            ));
                        }
                        None => {} // calcium under Tanh, or volume of a pressure-only patient
                    }
                }
            }
        }
    }

    /// Samples of a trace; `None` if it was not read.
    #[must_use]
    pub fn get(&self, source: Source, kind: SignalKind) -> Option<&[(f64, f64)]> {
        self.all
            .iter()
            .find(|s| s.source == source && s.kind == kind)
            .map(|s| s.points.as_slice())
    }
}

/// A sentence about a file that was edited since its hash was stored. What cannot be read is told by
/// its reader.
fn as_stored(file: &Path, sha256: &str) -> Result<(), String> {
    match sha256_of_file(file) {
        Ok(found) if found != sha256 => Err(format!(
            "{} was changed after it was written, and is left out: found SHA-256 {found}, expected \
             {sha256}; restore it (`cardiotwin verify` lists all such files)",
            file.display()
        )),
        _ => Ok(()),
    }
}
