//! The table printed at the end of a run: result of each step, next to the results of the paper's
//! cohort.

use cardiotwin_report::results::tables::cohort;
use cardiotwin_report::results::{
    MeanSd, PAPER_STEP1_PERCENT, PAPER_STEP2_PERCENT, PatientView, Step, mean_error,
};
use cardiotwin_report::table::{Cell, Column, Digits, Table, cells};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::status::NO_INTERVALS;

use super::table::{number, percent, text};
use super::talk::{Talk, Tone};

/// Key of the volume gap in the cohort's table and in this one.
const GAP: &str = "gap";

fn columns() -> Vec<Column> {
    let mut columns = ["patient", "step", "result"].map(Column::words).to_vec();
    columns.push(Column::numbers("cost"));
    columns.extend(Biomarker::TABLE_2.map(|b| {
        let difference = Column::numbers(b.key()).digits(Digits::Difference);
        difference.label(b.name())
    }));
    columns.push(Column::fixed(GAP, 1).label("volume gap").unit("mL"));
    columns.push(Column::numbers("time").digits(Digits::Duration));
    columns
}

/// A row for each step of a patient, followed by means of the absolute differences and the paper's
/// means. Of more than `most` patients those that failed come first, and the rest are only counted.
#[must_use]
pub fn table(run: &RunRecord, most: usize, talk: &Talk) -> String {
    let patients = cohort::patients(run);
    let mut shown: Vec<usize> = (0..run.patients.len()).collect();
    if shown.len() > most {
        shown.sort_by_key(|n| run.patients[*n].failure.is_none());
        shown.truncate(most);
    }
    let mut table = Table::new("summary", "", columns());
    let values = |n: usize, step: Step, keys: &[Column]| -> Vec<Cell> {
        let value = |column: &Column| patients.values(&cohort::key(step, &column.key)).nth(n);
        keys.iter()
            .map(|column| Cell::from(value(column).cloned()))
            .collect()
    };
    let numbers = &columns()[3..];
    let (numbers, last) = (&numbers[..numbers.len() - 1], numbers.len() + 2);
    for n in shown {
        let patient = &run.patients[n];
        for (k, step) in PatientView(patient).steps().iter().enumerate() {
            let name = match k {
                0 => patient.plan.id.as_str(),
                _ => "",
            };
            let (result, tone) = result(patient, *step);
            let mut row = cells![name, hyphened(*step)];
            row.push(Cell::from(result).toned(tone));
            row.extend(values(n, *step, numbers));
            row.push(Cell::from(""));
            table.rows.push(row);
        }
        if let Some(row) = table.rows.last_mut() {
            row[last] = Cell::from(PatientView(patient).wall_s());
        }
    }
    let any_step3 = run.patients.iter().any(|patient| patient.step3.is_some());
    for (step, paper) in [
        (Step::Step1, Some(PAPER_STEP1_PERCENT)),
        (Step::Step2, Some(PAPER_STEP2_PERCENT)),
        (Step::Step3, None),
    ] {
        // Step 3's mean is over all patients that finished it; the paper's means are over patients
        // that converged.
        let is_last = step == Step::Step3;
        if is_last && !any_step3 {
            continue;
        }
        let counted: Vec<PatientView> = (run.patients.iter())
            .filter(|patient| match is_last {
                true => patient.step3.is_some(),
                false => PatientView(patient).step1_converged(),
            })
            .map(PatientView)
            .collect();
        let of = match is_last {
            true => format!("of {}, absolute", counted.len()),
            false => format!("of {} with step 1 converged, absolute", counted.len()),
        };
        let mut row = cells!["mean", hyphened(step), of, ""];
        row.extend(Biomarker::TABLE_2.map(|b| {
            let mean = mean_error(&run.patients, step, b, !is_last);
            size(mean.map(|mean| mean.mean))
        }));
        let gaps = counted
            .iter()
            .map(|view| view.simulated(step)?.get(Biomarker::EndOfBeatGap));
        row.push(Cell::from(MeanSd::of(gaps).map(|mean| mean.mean)));
        row.push(Cell::from(""));
        table.rows.push(row);
        let Some(paper) = paper else { continue };
        let mut row = cells!["paper", hyphened(step), "Jung et al. 2022", ""];
        row.extend(paper.map(|percent| size(Some(percent))));
        row.extend(cells!["", ""]);
        table.rows.push(row);
    }
    let mut text = text(&table, talk);
    if run.patients.len() > most {
        text.push_str(&format!(
            "… {} more patients: the report and `status --all` show them; the means are over all\n",
            run.patients.len() - most
        ));
    }
    text.push_str(&verdicts(run, most));
    text.push_str(
        "differences are (simulated - measured) / measured; VOLUME GAP: volume at the beginning of the beat minus that at its end;\n\
         COST: step 1's sum of squares at the organ, step 2's weighted misfit at the cell,\n\
         step 3's squared differences divided by the measurements' variances\n",
    );
    text
}

/// Size of a difference without its sign, percent.
fn size(percent: Option<f64>) -> Cell {
    Cell::from(percent.map(|percent| percent / 100.0)).digits(Digits::Share)
}

/// Name of a step as in `status`.
fn hyphened(step: Step) -> String {
    step.name().replace(' ', "-")
}

/// Names of the personalised patients, and the verdicts of the others; only numbers if more than
/// `most` were verified.
fn verdicts(run: &RunRecord, most: usize) -> String {
    let verified: Vec<_> = run
        .patients
        .iter()
        .filter_map(|p| Some((p, p.verdict.as_ref()?)))
        .collect();
    if verified.is_empty() {
        return String::new();
    }
    let (hold, off): (Vec<_>, Vec<_>) = verified
        .iter()
        .partition(|(_, verdict)| verdict.personalised);
    let mut text = format!(
        "personalised: {} of {} verified",
        hold.len(),
        verified.len()
    );
    if verified.len() > most {
        text.push('\n');
        let n = run
            .patients
            .iter()
            .filter(|p| p.without_intervals().is_some())
            .count();
        if n > 0 {
            text.push_str(&format!("{NO_INTERVALS}: {n} of them\n"));
        }
        return text;
    }
    if !hold.is_empty() {
        let names: Vec<String> = hold
            .iter()
            .map(|(patient, _)| patient.plan.id.to_string())
            .collect();
        text.push_str(&format!(": {}", names.join(", ")));
    }
    text.push('\n');
    for (patient, verdict) in off {
        text.push_str(&format!("{}: {verdict}\n", patient.plan.id));
    }
    for patient in &run.patients {
        if let Some(why) = patient.without_intervals() {
            text.push_str(&format!("{}: {why}\n", patient.plan.id));
        }
    }
    text
}

/// Summary in one line of a patient that has just ended.
#[must_use]
pub fn line(patient: &PatientRecord) -> String {
    let view = PatientView(patient);
    let mut parts = vec![patient.status.state.to_string()];
    parts.extend(patient.verdict.as_ref().map(ToString::to_string));
    if let Some(step1) = &patient.step1 {
        parts.push(format!("step 1 {step1}, cost {}", number(step1.cost)));
    }
    if let Some(fit) = &patient.cell_fit {
        parts.push(format!("step 2 cost {}", number(fit.result.cost)));
    }
    for step in Step::ALL {
        if view.simulated(step).is_none() {
            continue;
        }
        let errors = Biomarker::TABLE_2.map(|b| {
            format!(
                "{} {}",
                b.name(),
                percent(view.relative_difference(step, b))
            )
        });
        parts.push(format!("{}: {}", step.name(), errors.join(", ")));
    }
    parts.extend(patient.without_intervals());
    if let Some(failure) = &patient.failure {
        parts.push(format!("[{}] {}", failure.class.as_str(), failure.message));
    }
    parts.join("; ")
}

/// How a step of a patient ended, or where it stands.
fn result(patient: &PatientRecord, step: Step) -> (String, Option<Tone>) {
    match step {
        Step::Step1 | Step::Step1FirstConverged => match (&patient.step1, &patient.failure) {
            (Some(step1), _) => {
                let tone = match PatientView(patient).step1_converged() {
                    true => Tone::Good,
                    false => Tone::Doubtful,
                };
                (
                    format!("{step1} of {}", patient.iterations.len()),
                    Some(tone),
                )
            }
            (None, Some(failure)) => (
                format!("failed [{}]", failure.class.as_str()),
                Some(Tone::Bad),
            ),
            (None, None) => (patient.status.state.to_string(), None),
        },
        Step::Step2 => match patient.cell_fit.as_ref().map(|fit| &fit.result) {
            Some(fit) if !fit.unreachable_targets.is_empty() => {
                ("target not reachable".to_owned(), Some(Tone::Doubtful))
            }
            Some(fit) if fit.converged => (
                format!("converged: generation {}", fit.generations),
                Some(Tone::Good),
            ),
            Some(fit) => (
                format!("limit: generation {}", fit.generations),
                Some(Tone::Doubtful),
            ),
            None if patient.step1.is_some() => (patient.status.state.to_string(), None),
            None => (String::new(), None),
        },
        Step::Step3 => {
            let taken = match patient
                .step3
                .as_ref()
                .map_or(0, |step3| step3.best_iteration)
            {
                0 => "verification beat kept".to_owned(),
                best => format!("beat {best} of {}", patient.step3_iterations.len()),
            };
            let is_personalised = patient.verdict.as_ref().is_some_and(|v| v.personalised);
            let tone = match is_personalised {
                true => Tone::Good,
                false => Tone::Doubtful,
            };
            (taken, Some(tone))
        }
    }
}
