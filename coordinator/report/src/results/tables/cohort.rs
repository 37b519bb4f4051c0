//! The patients of a run, a row for each.

use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::status::PatientState;
use cardiotwin_schemas::verdict::OFF;

use crate::results::standing::standing;
use crate::results::{MeanSd, PAPER_STEP1_PERCENT, PAPER_STEP2_PERCENT, PatientView, Step};
use crate::table::{Cell, Column, Digits, Kind, Table, Tone, cells};

/// A value of a patient, by its key.
type Of = Box<dyn Fn(PatientView) -> Option<f64>>;

/// Key of a column of a step: its cost, the difference of a biomarker, the gap.
#[must_use]
pub fn key(step: Step, what: &str) -> String {
    format!("{}_{what}", step.key())
}

/// The columns with their values, with those of step 3 if any patient has one.
fn columns(run: &RunRecord) -> Vec<(Column, Of)> {
    let mut all: Vec<(Column, Of)> = Vec::new();
    let mut add = |column: Column, step: Option<Step>, of: Of| {
        let group = step.map_or("", Step::name);
        all.push((Column { group, ..column }, of));
    };
    let with_step3 = run.patients.iter().any(|patient| patient.step3.is_some());
    for step in &Step::ALL[..2 + usize::from(with_step3)] {
        let (step, of_step) = (*step, Some(*step));
        let cost = Column::numbers(key(step, "cost")).label("cost");
        match step {
            Step::Step1 | Step::Step1FirstConverged => {
                add(
                    Column {
                        short: "iter.",
                        ..Column::fixed(key(step, "iterations"), 0)
                            .label("iterations")
                            .meaning("simulations of step 1")
                    },
                    of_step,
                    Box::new(|v| Some(v.0.iterations.len() as f64).filter(|n| *n > 0.0)),
                );
                add(
                    cost.meaning("cost of the selected iterate, or of the best one so far"),
                    of_step,
                    Box::new(|v| match &v.0.step1 {
                        Some(step1) => Some(step1.cost),
                        None => v.0.status.step1_cost,
                    }),
                );
            }
            Step::Step2 => add(
                cost.meaning("cost of the fit at the cell; ▲ not all targets are reachable"),
                of_step,
                Box::new(|v| v.0.cell_fit.as_ref().map(|fit| fit.result.cost)),
            ),
            Step::Step3 => add(
                Column::new(cost.key, Kind::Data),
                of_step,
                Box::new(|v| v.0.step3.as_ref().map(|step3| step3.misfit)),
            ),
        }
        for b in Biomarker::TABLE_2 {
            let difference = Column {
                symbol: Some(b),
                ..Column::numbers(key(step, b.key())).digits(Digits::Difference)
            };
            add(
                difference.label(format!("{} difference", b.name())),
                of_step,
                Box::new(move |v| v.relative_difference(step, b)),
            );
        }
        add(
            Column::fixed(key(step, "gap"), 1)
                .label("gap")
                .unit("mL")
                .meaning(Biomarker::EndOfBeatGap.label().meaning),
            of_step,
            Box::new(move |v| v.simulated(step)?.get(Biomarker::EndOfBeatGap)),
        );
        if step == Step::Step2 {
            add(
                Column::numbers("organ_cost")
                    .meaning("cost of the verification beat by step 1's formula"),
                of_step,
                Box::new(|v| v.0.verification_cost),
            );
        }
    }
    add(
        Column::numbers("time")
            .meaning("wall time of all tasks")
            .digits(Digits::Duration),
        None,
        Box::new(|v| v.wall_s()),
    );
    all
}

/// The table, with mean, standard deviation and the paper's means at its end.
#[must_use]
pub fn patients(run: &RunRecord) -> Table {
    let with_values = columns(run);
    let own = with_values.iter().map(|(column, _)| column.clone());
    let names = [Column::words("patient"), Column::words("state")];
    let title = "Biomarkers: signed relative differences from the measured values, %";
    let mut table = Table::new("cohort", title, names.into_iter().chain(own));
    for patient in &run.patients {
        let mut row = cells![patient.plan.id.as_str(), state(patient)];
        for (column, of) in &with_values {
            let cell = Cell::from(of(PatientView(patient)));
            let is_fit = column.key == key(Step::Step2, "cost");
            row.push(if is_fit {
                with_doubt(cell, patient)
            } else {
                cell
            });
        }
        table.rows.push(row);
    }
    let spread: Vec<Option<MeanSd>> = with_values
        .iter()
        .map(|(column, of)| {
            let size = |value: f64| match column.is_difference() {
                true => value.abs(),
                false => value,
            };
            MeanSd::of((run.patients.iter()).map(|patient| of(PatientView(patient)).map(size)))
        })
        .collect();
    let mut paper = PAPER_STEP1_PERCENT.into_iter().chain(PAPER_STEP2_PERCENT);
    let mut foot = |name: &str, of: &mut dyn FnMut(usize, &Column) -> Cell| {
        let mut row = cells![name, ""];
        let own = with_values.iter().enumerate();
        row.extend(own.map(|(k, (column, _))| of(k, column)));
        table.foot.push(row);
    };
    let of_values = |value: Option<f64>, column: &Column| match value {
        Some(value) => Cell::from(value).digits(digits_of_mean(column)),
        None => Cell::from(""),
    };
    foot("mean, absolute errors", &mut |k, column| {
        of_values(spread[k].map(|s| s.mean), column)
    });
    foot("SD", &mut |k, column| {
        of_values(spread[k].and_then(|s| s.sd), column)
    });
    foot("the paper's mean", &mut |_, column| {
        let percent = column.is_difference().then(|| paper.next()).flatten();
        Cell::from(percent.map_or_else(String::new, |percent| format!("{percent:.1}")))
    });
    table
}

/// Format of a column's mean: sizes of differences have no sign, and means of counts a decimal.
fn digits_of_mean(column: &Column) -> Digits {
    match column.kind {
        Kind::Numbers(Digits::Difference) => Digits::Share,
        Kind::Numbers(Digits::Fixed(_)) => Digits::Fixed(1),
        Kind::Numbers(digits) => digits,
        _ => Digits::Auto,
    }
}

fn state(patient: &PatientRecord) -> Cell {
    let (tone, words) = standing(patient);
    // The sizes of the differences are in the columns. Longer words would break each row into two
    // lines, and the summary over more than two sheets.
    let words = if words.starts_with(OFF) {
        "off"
    } else {
        &*words
    };
    let view = PatientView(patient);
    let stalled = patient
        .step1
        .as_ref()
        .filter(|_| patient.status.state == PatientState::Done && !view.step1_converged());
    Cell {
        note: stalled.map_or_else(String::new, |step1| format!("step 1 {step1}")),
        ..Cell::from(words).toned(tone)
    }
}

fn with_doubt(cell: Cell, patient: &PatientRecord) -> Cell {
    let fit = patient.cell_fit.as_ref();
    let is_short = fit.is_some_and(|fit| !fit.result.unreachable_targets.is_empty());
    if !is_short {
        return cell;
    }
    cell.toned(Tone::Doubtful)
        .hint("not all targets are reachable")
}
