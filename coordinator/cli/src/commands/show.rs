//! `cardiotwin show`: results, parameters, failure and files of one patient.

use cardiotwin_schemas::biomarkers::Biomarker;
use std::path::{Path, PathBuf};

use cardiotwin_report::export::PatientTables;
use cardiotwin_report::html::{patient_page, spread_svg};
use cardiotwin_report::results::tables::{biomarkers, motion};
use cardiotwin_report::results::{PatientView, SpreadFile, learned_law, teachers};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::organ::BeatCount;
use cardiotwin_schemas::organ_law::LawError;
use cardiotwin_schemas::outcome::{Determination, FittedParameter, Step1ProposalResult};
use cardiotwin_schemas::record::{IterationRecord, PatientRecord};
use cardiotwin_schemas::settings::Update;
use cardiotwin_schemas::status::PatientState;
use cardiotwin_schemas::step1::Step1Parameter;
use cardiotwin_schemas::task::OrganBeatSpec;
use clap::Args;

use crate::error::CliError;
use crate::exit::Exit;
use crate::place::{Folders, OfCohort};
use crate::store::open;
use crate::table::{Columns, duration, number, optional, text};
use crate::talk::{Talk, Tone, count};
use crate::ventricle::Ventricle;

/// Show one patient in detail: results, iterations, parameters, failure and location of its files
#[derive(Debug, Args)]
pub struct ShowArgs {
    /// Name of the patient
    patient: String,
    /// Print one JSON object instead of text
    #[arg(long)]
    json: bool,
    /// Print one JSON object of tables for other programs: biomarkers, parameters, posterior,
    /// traces, and the twin's beat
    #[arg(long, conflicts_with = "json")]
    tables: bool,
    /// Print the patient's section of the report as an HTML page
    #[arg(long, conflicts_with_all = ["json", "tables"])]
    html: bool,
    /// Draw the spread of the nodes' stretch and active stress around their medians into an SVG
    /// file
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    of: OfCohort,
}

/// Prints the patient's record.
///
/// # Errors
/// Errors of the store; [`CliError::Usage`] if `--plot` lacks data.
pub async fn execute(args: &ShowArgs, talk: &Talk) -> Result<Exit, CliError> {
    let folders = args.of.folders();
    let record = open(&folders)
        .await?
        .patient_record(&PatientId(args.patient.clone()))
        .await?;
    if let Some(file) = &args.plot {
        plot(&record, file)?;
    }
    if args.json {
        talk.json(&record)?;
        return Ok(Exit::Ok);
    }
    if args.tables {
        let beat = beat(&record, &folders).await?;
        talk.json(&PatientTables::of(&record, beat))?;
        return Ok(Exit::Ok);
    }
    if args.html {
        talk.data(&patient_page(&record))?;
        return Ok(Exit::Ok);
    }
    talk.data(&text_of(&record, talk))?;
    if let Some(hint) = hint(&record, &folders) {
        talk.hint(&hint);
    }
    Ok(Exit::Ok)
}

/// Everything about a patient as text.
#[must_use]
pub fn text_of(record: &PatientRecord, talk: &Talk) -> String {
    let sections = [
        heading(record),
        record
            .step0
            .as_ref()
            .map_or_else(String::new, |_| text(&biomarkers::shown(record), talk)),
        motion::by_step(record).map_or_else(String::new, |motion| text(&motion, talk)),
        iterations(record, talk),
        step3(record, talk),
        organ_law(record),
        posterior(record, talk),
        cell(record, talk),
        estimates(record, talk),
        files(record, talk),
    ];
    let sections: Vec<String> = sections
        .into_iter()
        .filter(|section| !section.is_empty())
        .collect();
    sections.join("\n")
}

/// Specification of the twin's beat, or of step 1's before step 2 is done; `None` before step 0.
async fn beat(
    record: &PatientRecord,
    folders: &Folders,
) -> Result<Option<OrganBeatSpec>, CliError> {
    if record.step0.is_none() {
        return Ok(None);
    }
    let ventricle = Ventricle::of_run(folders, record.plan.id.as_str(), "--tables").await?;
    let beats = BeatCount::Fixed {
        n: record.plan.settings.solver.beats,
    };
    if record.cell_fit.is_none() {
        return Ok(Some(ventricle.beat_of_step1(beats)));
    }
    ventricle.beat_of_twin("--tables", beats).map(Some)
}

/// Draws the spread of the nodes' stretch and active stress into an SVG file.
fn plot(record: &PatientRecord, file: &Path) -> Result<(), CliError> {
    let nothing = || {
        let id = &record.plan.id;
        CliError::Usage(format!(
            "--plot: the targets of {id} are not done, or were computed without the nodes' spread"
        ))
    };
    let spread =
        SpreadFile::read(record).map_err(|error| CliError::Usage(format!("--plot: {error}")))?;
    let svg = spread
        .as_ref()
        .and_then(|spread| spread_svg(record, spread))
        .ok_or_else(nothing)?;
    std::fs::write(file, svg).map_err(CliError::file("write", file))
}

fn heading(record: &PatientRecord) -> String {
    let status = &record.status;
    let time = duration(status.for_s);
    let since = match status.state {
        PatientState::Done => format!(", finished {time} ago"),
        PatientState::Failed | PatientState::Cancelled => format!(", {time} ago"),
        PatientState::Waiting | PatientState::Running | PatientState::Unknown => {
            format!(" for {time}")
        }
    };
    let mut text = format!("{}: {}{since}", status.patient, status.words());
    if !status.note.is_empty() {
        text.push_str(&format!(" ({})", status.note));
    }
    text.push('\n');
    if let Some(start) = record.start_of_the_law() {
        text.push_str(&format!("organ's law at the start: {start}\n"));
    }
    if let Some(step1) = &record.step1 {
        text.push_str(&format!("step 1 {step1}, cost {}\n", number(step1.cost)));
    }
    if let Some(fit) = &record.cell_fit {
        let fit = &fit.result;
        let how = if fit.converged {
            "converged"
        } else {
            "stopped at the limit"
        };
        let cost = number(fit.cost);
        text.push_str(&format!(
            "step 2 {how}, cost {cost}, generation {}, {} cells\n",
            fit.generations, fit.evaluations
        ));
        for target in &fit.unreachable_targets {
            text.push_str(&format!("target not reachable: {target}\n"));
        }
    }
    if let Some(off) = PatientView(record).off_outside_the_verdict() {
        text.push_str(&format!("{off}\n"));
    }
    if let Some(failure) = &record.failure {
        text.push_str(&format!(
            "failure [{}]: {}\n",
            failure.class.as_str(),
            failure.message
        ));
        if let Some(remedy) = &failure.remedy {
            text.push_str(&format!("remedy: {remedy}\n"));
        }
    }
    text
}

fn iterations(record: &PatientRecord, talk: &Talk) -> String {
    if record.iterations.is_empty() {
        return String::new();
    }
    let mut headings = vec![">ITERATION", ">COST"];
    let proposed = record
        .iterations
        .iter()
        .any(|iteration| iteration.proposal.is_some());
    if proposed {
        headings.extend([">PREDICTED", "PROPOSED BY"]);
    }
    let names: Vec<String> = Step1Parameter::KEYS
        .iter()
        .map(|name| format!(">{name}"))
        .collect();
    headings.extend(names.iter().map(String::as_str));
    headings.push("NOTE");
    let mut table = Columns::new(talk, &headings);
    let best = PatientView(record)
        .best_iteration()
        .map(|iteration| iteration.number);
    for iteration in &record.iterations {
        let mut row = vec![
            (iteration.number.to_string(), None),
            (optional(iteration.cost), None),
        ];
        if proposed {
            let proposal = iteration.proposal.as_ref().map(|task| &task.result);
            row.push((
                optional(proposal.map(|proposal| proposal.predicted_cost)),
                None,
            ));
            row.push((proposed_by(proposal), None));
        }
        row.extend(
            iteration
                .parameters
                .updated()
                .iter()
                .map(|value| (number(*value), None)),
        );
        row.push(note(iteration, best == Some(iteration.number)));
        table.toned(row);
    }
    table.text()
}

fn proposed_by(proposal: Option<&Step1ProposalResult>) -> String {
    let Some(proposal) = proposal else {
        return "-".to_owned();
    };
    let ventricle = match proposal.law_beats {
        None => "one-fibre ventricle".to_owned(),
        Some(0) => "organ's law of the prior".to_owned(),
        Some(n) => format!("organ's law of {}", count(n as usize, "beat")),
    };
    match proposal.from_iteration {
        None => ventricle,
        Some(iteration) => format!("{ventricle}, corrected to {iteration}"),
    }
}

fn note(iteration: &IterationRecord, best: bool) -> (String, Option<Tone>) {
    match &iteration.failure {
        Some(failure) => (
            format!("failed [{}]: {}", failure.class.as_str(), failure.message),
            Some(Tone::Bad),
        ),
        None if best => ("best".to_owned(), Some(Tone::Good)),
        None => match iteration
            .run
            .as_ref()
            .and_then(|run| run.result.failed_valve())
        {
            Some(valve) => (
                format!("no whole beat: {}, found {}", valve.name, valve.found),
                Some(Tone::Doubtful),
            ),
            None => (String::new(), None),
        },
    }
}

fn cell(record: &PatientRecord, talk: &Talk) -> String {
    let Some(fit) = &record.cell_fit else {
        return String::new();
    };
    let columns = [
        "CELL PARAMETER OF STEP 2",
        ">VALUE",
        ">LOWER",
        ">UPPER",
        "NEAR-OPTIMAL",
        "NOTE",
    ];
    let mut table = Columns::new(talk, &columns);
    for parameter in &fit.result.parameters {
        let mut row: Vec<(String, Option<Tone>)> = vec![(parameter.name.clone(), None)];
        row.extend(
            [parameter.value, parameter.lower, parameter.upper].map(|value| (number(value), None)),
        );
        let near = parameter.near_optimal;
        row.push((
            near.map_or_else(String::new, |n| {
                format!("{} to {}", number(n.lower), number(n.upper))
            }),
            None,
        ));
        row.push(determination(parameter));
        table.toned(row);
    }
    let mut text = table.text();
    if let Some(found) = &fit.result.identifiability {
        text.push_str(&format!(
            "near-optimal: cost up to {}, with all other parameters refitted",
            number(found.threshold)
        ));
        text.push_str(if found.complete {
            "\n"
        } else {
            "; some intervals may be wider\n"
        });
    }
    text
}

/// Mark for how well the data determine a parameter, and whether it lies on a bound.
fn determination(parameter: &FittedParameter) -> (String, Option<Tone>) {
    let mark = parameter.near_optimal.map(|near| near.mark);
    match (mark, parameter.at_bound) {
        (Some(Determination::Determined), false) => (
            Determination::Determined.as_str().to_owned(),
            Some(Tone::Good),
        ),
        (Some(mark @ (Determination::Sloppy | Determination::NotDetermined)), true) => (
            format!("{}, at a bound", mark.as_str()),
            Some(Tone::Doubtful),
        ),
        (Some(Determination::Sloppy), false) => (
            Determination::Sloppy.as_str().to_owned(),
            Some(Tone::Doubtful),
        ),
        (Some(Determination::NotDetermined), false) => {
            ("not determined".to_owned(), Some(Tone::Doubtful))
        }
        (_, true) => ("at a bound".to_owned(), Some(Tone::Doubtful)),
        (_, false) => (String::new(), None),
    }
}

fn estimates(record: &PatientRecord, talk: &Talk) -> String {
    let Some(step0) = &record.step0 else {
        return String::new();
    };
    let mut text = String::new();
    if !step0.result.estimates.is_empty() {
        let mut table = Columns::new(talk, &["ESTIMATED", ">VALUE", "HOW"]);
        for estimate in &step0.result.estimates {
            table.row([
                estimate.key.clone(),
                match estimate.sd {
                    Some(sd) => format!("{} ± {}", number(estimate.value), number(sd)),
                    None => number(estimate.value),
                },
                estimate.method.clone(),
            ]);
        }
        text = table.text();
    }
    for remark in &step0.result.remarks {
        text.push_str(&format!("remark: {remark}\n"));
    }
    text
}

fn files(record: &PatientRecord, talk: &Talk) -> String {
    let mut table = Columns::new(talk, &["FILES OF", "FOLDER"]);
    let mut n_rows = 0;
    let mut row = |name: String, folder: &std::path::Path| {
        n_rows += 1;
        table.row([name, folder.display().to_string()]);
    };
    if let Some(task) = &record.step0 {
        row("step-0".to_owned(), &task.directory);
    }
    if let Some((iteration, run)) = PatientView(record)
        .best_iteration()
        .and_then(|i| Some((i, i.run.as_ref()?)))
    {
        row(
            format!("step-1 iteration {}", iteration.number),
            &run.directory,
        );
    }
    if let Some(task) = &record.targets {
        row("targets".to_owned(), &task.directory);
    }
    if let Some(task) = &record.cell_fit {
        row("step-2".to_owned(), &task.directory);
    }
    if let Some(task) = &record.verification {
        row("verification".to_owned(), &task.directory);
    }
    if let (Some(task), Some(step3)) = (PatientView(record).step3_beat(), &record.step3) {
        row(
            format!("step-3 iteration {}", step3.best_iteration),
            &task.directory,
        );
    }
    if n_rows == 0 {
        String::new()
    } else {
        table.text()
    }
}

/// Table of step 3's parameters: their bounds and their values in each beat, the verification beat
/// first.
fn step3(record: &PatientRecord, talk: &Talk) -> String {
    let Some(step3) = &record.step3 else {
        return String::new();
    };
    let mut headings = vec![
        "STEP 3".to_owned(),
        ">LOWER".to_owned(),
        ">UPPER".to_owned(),
    ];
    headings.extend(record.step3_iterations.iter().map(|iteration| {
        let taken = if iteration.number == step3.best_iteration {
            " (taken)"
        } else {
            ""
        };
        format!(">BEAT {}{taken}", iteration.number)
    }));
    let headings: Vec<&str> = headings.iter().map(String::as_str).collect();
    let mut table = Columns::new(talk, &headings);
    for name in &record.plan.settings.step3.parameters {
        let bounds = record.plan.settings.step3.bounds.get(name);
        let mut row = vec![name.clone()];
        row.extend([0, 1].map(|end| optional(bounds.map(|bounds| bounds[end]))));
        row.extend(
            record
                .step3_iterations
                .iter()
                .map(|iteration| optional(iteration.parameters.get(name).copied())),
        );
        table.row(row);
    }
    let mut row = vec!["misfit".to_owned(), String::new(), String::new()];
    row.extend(
        record
            .step3_iterations
            .iter()
            .map(|iteration| optional(iteration.misfit)),
    );
    table.row(row);
    table.text()
}

/// Where the organ's law comes from, and how far it is from the beats that taught.
fn organ_law(record: &PatientRecord) -> String {
    let Some(law) = learned_law(record) else {
        return String::new();
    };
    let error = |error: LawError| {
        format!(
            "rms error {:.2} mmHg, worst {:.2} mmHg",
            error.rms_mmhg, error.worst_mmhg
        )
    };
    let of_all = law
        .error()
        .map_or_else(String::new, |of_all| format!("; {}", error(of_all)));
    let mut text = format!("organ's law: {}{of_all}\n", law.origin_words());
    for (beat, teacher) in law.beats.iter().zip(teachers(record, law)) {
        text += &format!("  before {}: {}\n", teacher.name, error(beat.before));
    }
    text
}

/// Why a finished twin has no intervals although its settings ask for them. The task's failure does not fail the
/// patient, so that nothing else says it.
fn without_posterior(record: &PatientRecord) -> String {
    record.without_intervals().map_or_else(String::new, |why| {
        format!("{why}; `predict` gives no intervals\n\n")
    })
}

/// Table of the twin's uncertainty: 90 % intervals of parameters and biomarkers.
fn posterior(record: &PatientRecord, talk: &Talk) -> String {
    let Some(result) = record.posterior.as_ref().map(|task| &task.result) else {
        return without_posterior(record);
    };
    let mut table = Columns::new(
        talk,
        &[
            "UNCERTAINTY",
            ">TWIN",
            ">5 %",
            ">50 %",
            ">95 %",
            "IDENTIFIABILITY",
        ],
    );
    for (name, spread) in &result.parameters {
        let values = [
            spread.twin,
            spread.posterior.p5,
            spread.posterior.p50,
            spread.posterior.p95,
        ];
        let mut row = vec![name.clone()];
        row.extend(values.map(|value| optional(Some(value))));
        let outside = if spread.excludes_twin() {
            "; outside its 90 % interval"
        } else {
            ""
        };
        row.push(format!("{}{outside}", spread.mark.as_str()));
        table.row(row);
    }
    let twin = record.twin().map(|twin| &twin.result.biomarkers);
    for (name, spread) in &result.biomarkers {
        let own = twin.and_then(|twin| twin.get(Biomarker::named(name)?));
        let mut row = vec![name.clone(), optional(own)];
        row.extend([spread.p5, spread.p50, spread.p95].map(|value| optional(Some(value))));
        row.push(String::new());
        table.row(row);
    }
    let sampling = &result.sampling;
    let doubt = sampling.doubt().map_or_else(String::new, |doubt| {
        format!("; the intervals are only a rough estimate: {doubt}")
    });
    let outside = result
        .outside_words()
        .map_or_else(String::new, |words| words + "\n");
    table.text()
        + &format!(
            "{} draws, {} beats of the reduced ventricle{doubt}\n",
            result.draws.len(),
            sampling.evaluations
        )
        + &outside
}

fn hint(record: &PatientRecord, folders: &Folders) -> Option<String> {
    let (id, of) = (&record.plan.id, folders.as_argument("--cohort "));
    if record.failure.is_some() {
        return Some(format!("`cardiotwin logs {id}{of}` shows the worker's log"));
    }
    let stalled = record.step1.is_some() && !PatientView(record).step1_converged();
    let other = if record.plan.settings.step1_update() == Update::SpaceMapping {
        "--set step1.update=fixed-point"
    } else {
        "--damping 0.5"
    };
    stalled.then(|| {
        format!(
            "`cardiotwin rerun {id} --from step1 {other}{of}` continues from the stored iterations"
        )
    })
}
