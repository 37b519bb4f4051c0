//! The table printed at the end of a run: result of each step, next to the results of the paper's
//! cohort.

use cardiotwin_report::results::{
    MeanSd, PAPER_STEP1_PERCENT, PAPER_STEP2_PERCENT, PatientView, Step,
};
use cardiotwin_schemas::biomarkers::Biomarker;
use cardiotwin_schemas::record::{PatientRecord, RunRecord};
use cardiotwin_schemas::status::NO_INTERVALS;

use super::table::{Columns, duration, number, optional, percent};
use super::talk::{Talk, Tone};

const HEADINGS: [&str; 11] = [
    "PATIENT",
    "STEP",
    "RESULT",
    ">COST",
    ">P_max",
    ">dPdt_max",
    ">dPdt_min",
    ">PTD90",
    ">SV",
    ">VOLUME GAP mL",
    ">TIME",
];

/// A row for each step of a patient, followed by means of the absolute differences and the paper's
/// means. Of more than `most` patients those that failed come first, and the rest are only counted.
#[must_use]
pub fn table(run: &RunRecord, most: usize, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &HEADINGS);
    let mut shown: Vec<&PatientRecord> = run.patients.iter().collect();
    if shown.len() > most {
        shown.sort_by_key(|patient| patient.failure.is_none());
        shown.truncate(most);
    }
    for patient in &shown {
        rows(patient).into_iter().for_each(|row| table.toned(row));
    }
    let any_step3 = run.patients.iter().any(|patient| patient.step3.is_some());
    for (step, name, paper) in [
        (Step::Step1, "step-1", Some(PAPER_STEP1_PERCENT)),
        (Step::Step2, "step-2", Some(PAPER_STEP2_PERCENT)),
        (Step::Step3, "step-3", None),
    ] {
        if step == Step::Step3 && !any_step3 {
            continue;
        }
        // Step 3's mean is over all patients that finished it; the paper's means are over patients
        // that converged.
        let counts = |patient: &&PatientRecord| match step {
            Step::Step3 => patient.step3.is_some(),
            _ => PatientView(patient).step1_converged(),
        };
        let converged: Vec<&PatientRecord> = run.patients.iter().filter(counts).collect();
        let mean = |biomarker: Biomarker| {
            let values = converged.iter().map(|p| {
                PatientView(p)
                    .relative_difference(step, biomarker)
                    .map(f64::abs)
            });
            MeanSd::of(values).map_or("-".to_owned(), |mean| format!("{:.1} %", 100.0 * mean.mean))
        };
        let mut row = vec![
            "mean".to_owned(),
            name.to_owned(),
            match step {
                Step::Step3 => format!("of {}, absolute", converged.len()),
                _ => format!("of {} converged, absolute", converged.len()),
            },
        ];
        row.push(String::new());
        row.extend(Biomarker::TABLE_2.map(mean));
        let open = converged
            .iter()
            .map(|p| PatientView(p).simulated(step)?.get(Biomarker::EndOfBeatGap));
        row.push(MeanSd::of(open).map_or("-".to_owned(), |mean| format!("{:.1}", mean.mean)));
        table.row(row);
        let Some(paper) = paper else { continue };
        let mut row = vec![
            "paper".to_owned(),
            name.to_owned(),
            "Jung et al. 2022".to_owned(),
            String::new(),
        ];
        row.extend(paper.map(|value| format!("{value:.1} %")));
        table.row(row);
    }
    let mut text = table.text();
    if run.patients.len() > most {
        text.push_str(&format!(
            "… {} more patients: the report and `status --all` show them; the means are over all\n",
            run.patients.len() - most
        ));
    }
    text.push_str(&verdicts(run, most));
    text.push_str(
        "differences are (simulated - measured) / measured; VOLUME GAP: end minus beginning of the beat;\n\
         COST: step 1's sum of squares at the organ, step 2's weighted misfit at the cell,\n\
         step 3's squared differences divided by the measurements' variances\n",
    );
    text
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
    for (step, name) in [
        (Step::Step1, "step 1"),
        (Step::Step2, "step 2"),
        (Step::Step3, "step 3"),
    ] {
        if view.simulated(step).is_none() {
            continue;
        }
        let errors = Biomarker::TABLE_2.map(|b| {
            format!(
                "{} {}",
                short(b),
                percent(view.relative_difference(step, b))
            )
        });
        parts.push(format!("{name}: {}", errors.join(", ")));
    }
    parts.extend(patient.without_intervals());
    if let Some(failure) = &patient.failure {
        parts.push(format!("[{}] {}", failure.class.as_str(), failure.message));
    }
    parts.join("; ")
}

fn short(biomarker: Biomarker) -> &'static str {
    let key = biomarker.key();
    ["_mmHg_per_ms", "_mmHg", "_ms", "_mL"]
        .iter()
        .find_map(|unit| key.strip_suffix(unit))
        .unwrap_or(key)
}

fn rows(patient: &PatientRecord) -> Vec<Vec<(String, Option<Tone>)>> {
    let view = PatientView(patient);
    let mut first = vec![
        (patient.plan.id.to_string(), None),
        ("step-1".to_owned(), None),
    ];
    match (&patient.step1, &patient.failure) {
        (Some(step1), _) => {
            let tone = if view.step1_converged() {
                Tone::Good
            } else {
                Tone::Doubtful
            };
            first.push((
                format!("{step1} of {}", patient.iterations.len()),
                Some(tone),
            ));
            first.push((number(step1.cost), None));
        }
        (None, failure) => {
            let state = failure
                .as_ref()
                .map_or(patient.status.state.to_string(), |f| {
                    format!("failed [{}]", f.class.as_str())
                });
            first.push((state, failure.as_ref().map(|_| Tone::Bad)));
            first.push((optional(patient.status.step1_cost), None));
        }
    }
    let mut second = vec![(String::new(), None), ("step-2".to_owned(), None)];
    match &patient.cell_fit {
        Some(fit) => {
            let fit = &fit.result;
            let (text, tone) = match (fit.unreachable_targets.is_empty(), fit.converged) {
                (false, _) => ("target not reachable".to_owned(), Tone::Doubtful),
                (true, true) => (
                    format!("converged: generation {}", fit.generations),
                    Tone::Good,
                ),
                (true, false) => (
                    format!("limit: generation {}", fit.generations),
                    Tone::Doubtful,
                ),
            };
            second.push((text, Some(tone)));
            second.push((number(fit.cost), None));
        }
        None => {
            let state = if patient.step1.is_some() {
                patient.status.state.to_string()
            } else {
                String::new()
            };
            second.push((state, None));
            second.push(("-".to_owned(), None));
        }
    }
    let mut rows = vec![(first, Step::Step1), (second, Step::Step2)];
    if let Some(step3) = &patient.step3 {
        let tone = if patient.verdict.as_ref().is_some_and(|v| v.personalised) {
            Tone::Good
        } else {
            Tone::Doubtful
        };
        let taken = match step3.best_iteration {
            0 => "verification beat kept".to_owned(),
            best => format!("beat {best} of {}", patient.step3_iterations.len()),
        };
        let third = [
            (String::new(), None),
            ("step-3".to_owned(), None),
            (taken, Some(tone)),
            (number(step3.misfit), None),
        ];
        rows.push((third.into(), Step::Step3));
    }
    for (row, step) in &mut rows {
        row.extend(Biomarker::TABLE_2.map(|b| (percent(view.relative_difference(*step, b)), None)));
        let open = view
            .simulated(*step)
            .and_then(|b| b.get(Biomarker::EndOfBeatGap));
        row.push((
            open.map_or("-".to_owned(), |open| format!("{open:.1}")),
            None,
        ));
    }
    let time = view.wall_s().map_or("-".to_owned(), duration);
    let n = rows.len();
    for (i, (row, _)) in rows.iter_mut().enumerate() {
        row.push((
            if i + 1 == n {
                time.clone()
            } else {
                String::new()
            },
            None,
        ));
    }
    rows.into_iter().map(|(row, _)| row).collect()
}
