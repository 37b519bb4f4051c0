//! Tables and traces of one patient as one object for other programs, in long form.

use std::path::PathBuf;

use cardiotwin_schemas::cell::cell_parameter;
use cardiotwin_schemas::formats::PATIENT_TABLES;
use cardiotwin_schemas::posterior::PosteriorResult;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::status::PatientStatus;
use cardiotwin_schemas::step1::Step1Parameter;
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_schemas::verdict::Verdict;
use serde::Serialize;

use crate::results::tables::biomarkers;
use crate::results::{PatientView, Signals, Step};
use crate::table::{Column, Kind, Table, cells};

/// Results of one patient so far.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PatientTables {
    /// Version of [`PATIENT_TABLES`].
    pub schema_version: u32,
    /// State of the patient.
    pub status: PatientStatus,
    /// Agreement of the twin's beat with the measured biomarkers.
    pub verdict: Option<Verdict>,
    /// A row for each biomarker.
    pub biomarkers: Table,
    /// A row for each personalised parameter of each step.
    pub parameters: Table,
    /// A row for each parameter of the posterior.
    pub posterior: Table,
    /// Why a finished twin has no posterior although the settings ask for one.
    pub without_intervals: Option<String>,
    /// Draws of the posterior, by draw, in the order of `posterior`.
    pub draws: Vec<Vec<f64>>,
    /// Measured and simulated traces.
    pub traces: Vec<TraceColumns>,
    /// One sentence for each file whose traces could not be read.
    pub problems: Vec<String>,
    /// Specification of the twin's beat, or of step 1's before there is a twin.
    pub beat: Option<OrganBeatSpec>,
    /// Surface of the twin's 3D wall (`heart.json`).
    pub heart: Option<PathBuf>,
    /// Index of the twin's series for ParaView (`beat.pvd`).
    pub series: Option<PathBuf>,
}

/// One trace by column.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TraceColumns {
    /// `measured`, `step1`, `step2` or `step3`.
    pub source: &'static str,
    /// Quantity, without unit.
    pub signal: &'static str,
    /// Unit; `1` stands for dimensionless.
    pub unit: &'static str,
    /// Time from the beat's start.
    pub time_ms: Vec<f64>,
    /// Value at each time.
    pub value: Vec<f64>,
}

impl PatientTables {
    /// Tables of a patient with the specification of its beat.
    #[must_use]
    pub fn of(record: &PatientRecord, beat: Option<OrganBeatSpec>) -> Self {
        let signals = Signals::read(record);
        let posterior = record.posterior.as_ref().map(|task| &task.result);
        let artefact = |name: &str| {
            let best = PatientView(record).beat(Step::Step1);
            record.twin().or(best).and_then(|task| task.artefact(name))
        };
        Self {
            schema_version: PATIENT_TABLES.version,
            status: record.status.clone(),
            verdict: record.verdict.clone(),
            biomarkers: biomarkers::by_step(record).without(Column::is_difference),
            parameters: parameters(record),
            posterior: posterior.map(knowledge).unwrap_or_default(),
            without_intervals: record.without_intervals(),
            draws: posterior.map_or_else(Vec::new, |p| p.draws.clone()),
            traces: signals
                .all
                .iter()
                .map(|signal| TraceColumns {
                    source: signal.source.name(),
                    signal: signal.kind.name(),
                    unit: signal.kind.unit(),
                    time_ms: signal.points.iter().map(|p| p.0).collect(),
                    value: signal.points.iter().map(|p| p.1).collect(),
                })
                .collect(),
            problems: signals.problems,
            beat,
            heart: artefact("heart"),
            series: artefact("series"),
        }
    }
}

fn data<const N: usize>(key: &'static str, keys: [&'static str; N]) -> Table {
    Table::new(key, "", keys.map(|key| Column::new(key, Kind::Data)))
}

/// Every personalised parameter with the step that gave its value.
fn parameters(record: &PatientRecord) -> Table {
    let mut table = data("parameters", ["step", "parameter", "unit", "value"]);
    let mut add = |step, name: &str, value: f64| {
        table.rows.push(cells![step, name, unit(name), value]);
    };
    if let Some(iteration) = PatientView(record).best_iteration() {
        for p in Step1Parameter::ALL {
            add("step1", p.key(), iteration.parameters.get(p));
        }
    }
    let fit = record.cell_fit.iter();
    for p in fit.flat_map(|fit| &fit.result.parameters) {
        add("step2", &p.name, p.value);
    }
    for (name, value) in record.step3.iter().flat_map(|step3| &step3.parameters) {
        add("step3", name, *value);
    }
    table
}

/// Knowledge about each parameter: quantiles at 5, 50 and 95 % after and before the measurements.
fn knowledge(posterior: &PosteriorResult) -> Table {
    let keys = [
        "parameter",
        "unit",
        "twin",
        "p5",
        "p50",
        "p95",
        "prior_p5",
        "prior_p50",
        "prior_p95",
        "mark",
    ];
    let mut table = data("posterior", keys);
    for (name, spread) in &posterior.parameters {
        let (after, before) = (&spread.posterior, &spread.prior);
        let mark = serde_json::to_value(spread.mark).unwrap_or_default();
        let mut row = cells![
            name.as_str(),
            unit(name),
            spread.twin,
            after.p5,
            after.p50,
            after.p95
        ];
        row.extend(cells![before.p5, before.p50, before.p95, mark]);
        table.rows.push(row);
    }
    table
}

fn unit(name: &str) -> &'static str {
    let of_step1 = Step1Parameter::named(name).map(Step1Parameter::label);
    let label = of_step1.or_else(|| cell_parameter(name).map(|p| p.label));
    label.map_or("", |label| label.unit)
}
