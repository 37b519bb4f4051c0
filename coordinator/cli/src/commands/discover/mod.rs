//! `cardiotwin discover`: search for effects that the model lacks in the traces of a patient or a
//! cohort.

mod accept;
mod afterload;
mod args;
mod choice;
mod in_3d;
mod search;
mod source;
mod text;

use std::time::Instant;

use cardiotwin_engine::Reader;
use cardiotwin_report::html::{discovery_svg, write_discovery};
use cardiotwin_report::results::discovery::faults;
use cardiotwin_schemas::discover::DiscoverCases;
use cardiotwin_sweep::discovery;

use crate::commands::report::FILE;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::{DATABASE, Folders};
use crate::table::duration;
use crate::talk::{Talk, count};
use choice::Choice;
use source::Source;

pub use args::DiscoverArgs;

/// Runs the search and prints the findings.
///
/// # Errors
/// [`CliError::Input`] if the input has errors; errors of the engine; a file that cannot be
/// written.
pub async fn execute(args: &DiscoverArgs, talk: &Talk) -> Result<Exit, CliError> {
    if let Some([flow, pressure]) = args.afterload.as_deref() {
        let (json, plot) = (args.json.as_ref(), args.plot.as_ref());
        return afterload::execute(
            &afterload::Request {
                flow,
                pressure,
                effects: &args.effects,
                accepted: &args.accept_rule,
                json,
                plot,
            },
            talk,
        );
    }
    let began = Instant::now();
    let choice = Choice::of(args, talk).await?;
    let source = Source::read(args, &choice, talk)?;
    if source.is_cohort() && args.plot.is_some() {
        return Err(CliError::Usage(
            "--plot draws only one patient: name a patient's folder".to_owned(),
        ));
    }
    if args.accept || args.revert {
        accept::whose(args, &source)?;
    }
    if args.revert {
        return accept::revert(&source, talk);
    }
    let mut ended = search::run(args, &source, &choice, talk).await?;
    add_run(&source, &mut ended.cases).await;
    discovery::keep_finite_element(discovery::read_cases(&ended.run_dir), &mut ended.cases);
    if args.in_3d && !ended.stopped {
        let in_3d = in_3d::add(
            args,
            (&source, &choice),
            &ended.run_dir,
            &mut ended.cases,
            talk,
        )
        .await?;
        ended.failures.extend(in_3d.failures);
        ended.stopped = in_3d.stopped;
    }
    let cases = &ended.cases;
    discovery::write(
        &discovery::cases_file(&ended.run_dir),
        &discovery::cases_text(cases),
    )
    .map_err(CliError::file(
        "write",
        discovery::cases_file(&ended.run_dir),
    ))?;
    let page = ended.run_dir.join(FILE);
    write_discovery(&source.name, cases, &page).map_err(CliError::Report)?;
    if let (Some(file), Some(svg)) = (&args.plot, cases.values().next().and_then(discovery_svg)) {
        discovery::write(file, &svg).map_err(CliError::file("write", file))?;
    }
    let on_stdout = args
        .json
        .as_ref()
        .is_some_and(|file| file.as_os_str() == "-");
    if let Some(file) = &args.json {
        let text = json(&source, cases);
        if on_stdout {
            talk.data(&text)?;
        } else {
            discovery::write(file, &text).map_err(CliError::file("write", file))?;
        }
    }
    if !on_stdout {
        cases
            .values()
            .try_for_each(|case| talk.data(&text::case(case, source.is_cohort(), talk)))?;
        if source.is_cohort() {
            talk.data(&text::cohort(cases, talk))?;
        }
    }
    let n_left_out = if args.accept {
        accept::accept(args, &source, cases, talk)?
    } else {
        0
    };
    for (patient, failure) in &ended.failures {
        talk.say(&format!("{patient} failed: {failure}"));
    }
    for refused in &source.refused {
        let errors = count(refused.errors.len(), "error");
        talk.say(&format!(
            "{} refused: {errors} in its files",
            refused.patient
        ));
    }
    let wall = duration(began.elapsed().as_secs_f64());
    talk.say(&format!(
        "{} searched in {wall}; report: {}",
        count(cases.len(), "patient"),
        page.display()
    ));
    if args.open {
        open_in_viewer(&page, talk);
    }
    if ended.stopped {
        talk.say("stopped; no finished result is lost, and the same command continues");
        return Ok(Exit::Interrupted);
    }
    Ok(
        if ended.failures.is_empty() && source.refused.is_empty() && n_left_out == 0 {
            Exit::Ok
        } else {
            Exit::Problems
        },
    )
}

/// Adds the misses of the beats in the cohort's run. Without a run, or if it cannot be read, adds
/// nothing.
async fn add_run(source: &Source, cases: &mut DiscoverCases) {
    let Some(folders) = source
        .cohort_folder()
        .map(|cohort| Folders::of(cohort, None))
    else {
        return;
    };
    if !folders.run.join(DATABASE).exists() {
        return;
    }
    let Ok(reader) = Reader::open(&folders.run).await else {
        return;
    };
    let Ok(record) = reader.record().await else {
        return;
    };
    for patient in &record.patients {
        if let Some(case) = cases.get_mut(patient.plan.id.0.as_str()) {
            case.run = faults::of_run(patient);
        }
    }
}

/// JSON text: one object for a patient; for a cohort, an object with one entry per patient.
fn json(source: &Source, cases: &DiscoverCases) -> String {
    match cases.values().next().filter(|_| !source.is_cohort()) {
        Some(case) => discovery::case_text(case),
        None => discovery::cases_text(cases),
    }
}
