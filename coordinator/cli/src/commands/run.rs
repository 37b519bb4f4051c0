//! `cardiotwin run`: drives a cohort to its end. A second call continues an unfinished run.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_engine::{
    self as engine, Chosen, EngineEvent, Foreseen, Reader, RunOptions, RunSummary, StopSignal,
    StoreError,
};
use cardiotwin_input::{self as input, Cohort, Options, Report};
use cardiotwin_report::html::{self, Pages};
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::PatientRecord;
use cardiotwin_schemas::settings::ExecutorKind;
use cardiotwin_schemas::status::{PatientStatus, RefusedPatient};
use cardiotwin_sweep::discovery;
use clap::Args;

use crate::commands::after::{job_number, with_dependency};
use crate::commands::report::FILE;
use crate::commands::status;
use crate::error::CliError;
use crate::exit::Exit;
use crate::notices::Notifier;
use crate::open::open as open_in_viewer;
use crate::place::{Folders, Place};
use crate::progress::Watcher;
use crate::seen::Seen;
use crate::store::open;
use crate::table::{Columns, duration};
use crate::talk::{Talk, count};
use crate::tick::without_a_tick;
use crate::vtu::announcement;
use crate::{access, kept, problems, redone, scratch, summary};

/// Largest number of patients for which each patient's result is printed as soon as it is known.
const LINES_WITH_RESULTS: usize = 100;
/// Rows of the status table that a run on a cluster prints.
const ROWS: usize = 60;

/// Personalise a cohort; the same command continues an interrupted run
#[derive(Debug, Args)]
#[command(
    after_help = "One Ctrl-C lets short tasks finish and then stops; a second one stops at once. \
                  Neither loses a finished result."
)]
pub struct RunArgs {
    #[command(flatten)]
    place: Place,
    /// Number of workers at a time; 0 is one per core
    #[arg(long, value_name = "N")]
    workers: Option<u32>,
    /// Personalise only this patient (may be given several times)
    #[arg(long = "patient", value_name = "PATIENT")]
    patients: Vec<String>,
    /// Ventricle to simulate (solver.fidelity)
    #[arg(long, value_name = "NAME", value_parser = ["reduced", "finite-element"])]
    fidelity: Option<String>,
    /// Approximate number of nodes of the finite-element mesh (solver.finite_element.mesh_nodes)
    #[arg(long, value_name = "N")]
    mesh_nodes: Option<u32>,
    /// Method by which step 1 finds the next parameters (step1.update)
    #[arg(long, value_name = "NAME", value_parser = ["auto", "fixed-point", "space-mapping"])]
    update: Option<String>,
    /// Start every patient from the organ's law in FILE, which `cardiotwin export --law FILE` wrote
    /// (workflow.law)
    #[arg(long, value_name = "FILE")]
    law: Option<PathBuf>,
    /// Write a VTU file for ParaView at this interval of simulated time, in ms, in every 3D
    /// simulation (executor.vtu_every_ms)
    #[arg(long, value_name = "MS")]
    vtu_every: Option<f64>,
    /// Set KEY to VALUE, overriding all files (may be given several times); `config show` lists the keys
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Drop KEY, or `all`, from the saved options of this run (may be given several times)
    #[arg(long, value_name = "KEY")]
    unset: Vec<String>,
    /// Redo finished work without a question where settings have changed
    #[arg(long)]
    yes: bool,
    /// Executor of the tasks (executor.kind)
    #[arg(long, value_name = "NAME", value_parser = ["local", "slurm"])]
    executor: Option<String>,
    /// On a cluster, keep advancing until all jobs are finished, instead of one tick as in
    /// `advance`
    #[arg(long)]
    watch: bool,
    /// On a cluster, let the jobs of this call wait until these jobs of Slurm have ended, for example
    /// one that copies data (may be given several times)
    #[arg(long, value_name = "JOBID", value_parser = job_number)]
    after: Vec<String>,
    /// Do not write a report at the end
    #[arg(long)]
    no_report: bool,
    /// Open the report at the end in the desktop's viewer
    #[arg(long, conflicts_with = "no_report")]
    open: bool,
    /// Print one JSON object at the end, as `status --json` does, instead of a table
    #[arg(long)]
    json: bool,
    /// Show what would be done without doing it
    #[arg(long)]
    dry_run: bool,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    /// Continue with this worker although the run began with another version
    #[arg(long)]
    adopt_version: bool,
    /// Read every input file again, even those whose size and times are as at the last run
    #[arg(long)]
    verify: bool,
    /// Do nothing if the files of any patient have errors, instead of running the other patients
    #[arg(long)]
    strict: bool,
}

/// Runs the cohort.
///
/// # Errors
/// [`CliError::Input`] if the input has errors; errors of the engine and the report.
pub async fn execute(args: &RunArgs, talk: &Talk) -> Result<Exit, CliError> {
    let began = Instant::now();
    let mut folders = args.place.folders();
    folders.find_cohort().await?;
    folders
        .refuse_sweep("continue it with `cardiotwin sweep`, see `cardiotwin sweep status DIR`")?;
    let given = args.settings();
    let choice = kept::choose(&folders.run, &args.unset, &given, talk).await?;
    let seen = match args.dry_run || args.verify {
        true => Seen::Nothing,
        false => Seen::of(&folders.run).await?,
    };
    let wanted = Wanted {
        kept: &kept::as_assignments(&choice.kept),
        set: &given,
        only: &args.patients,
        meshes: true,
        strict: args.strict,
        follows_jobs: false,
        known: seen.known(),
    };
    let (cohort, refused) = load(&folders, &wanted, talk)?;
    let changes = redone::changed(choice.before.as_ref(), &cohort.settings);
    let plans = || cohort.plans();
    let told = redone::told(&folders.run, plans, &args.patients, &changes).await?;
    if args.dry_run {
        if let Some(told) = told.as_ref().filter(|_| !args.json) {
            talk.data(&format!("{told}\n"))?;
        }
        return dry_run(&cohort, &folders, args, talk).await;
    }
    if let Some(told) = &told {
        redone::consent(told, args.yes, talk)?;
    }
    let n_refused = refused.len();
    if let Some(said) = (cohort.patients.iter())
        .find_map(|patient| patient.resolved.as_ref())
        .and_then(|plan| announcement(plan, plan.settings.executor.vtu_every_ms))
    {
        talk.say(&said);
    }
    let executor = with_dependency(cohort.settings.settings.executor.clone(), &args.after)?;
    let options = RunOptions {
        executor,
        only: args
            .patients
            .iter()
            .map(|id| PatientId(id.clone()))
            .collect(),
        chosen: Some(Chosen {
            set: choice.set,
            settings: cohort.settings.value.clone(),
        }),
        watch: args.watch,
        adopt_version: args.adopt_version,
        ..of_cohort(cohort, seen, refused, &folders, args.worker.as_deref())
    };
    let stop = StopSignal::from_signals().map_err(|source| CliError::Io {
        what: "cannot listen to signals",
        source,
    })?;
    access::apply(&options.executor, &options.run_dir)?;
    scratch::lay_out(&options.executor, &options.run_dir)?;
    let (events, received) = tokio::sync::mpsc::unbounded_channel();
    let notifier = Notifier::start(&options.run_dir, &options.executor.notices, talk);
    let watcher = tokio::spawn(watch(received, notifier, folders.clone(), *talk));
    let is_tick = options.executor.kind == ExecutorKind::Slurm && !options.watch;
    let outcome = engine::run(options, events, stop).await;
    // The watcher ends when the engine drops its sender.
    let _ = watcher.await;
    let summary = match outcome {
        Err(error) if is_tick => return without_a_tick(error, talk),
        outcome => outcome?,
    };
    finish(args, (&summary, n_refused), &folders, began, talk).await
}

impl RunArgs {
    /// Assignments of `--set`, followed by the settings that other options stand for.
    fn settings(&self) -> Vec<String> {
        let mut set = self.set.clone();
        set.extend(
            self.fidelity
                .iter()
                .map(|name| format!("solver.fidelity={name}")),
        );
        set.extend(
            self.mesh_nodes
                .map(|n| format!("solver.finite_element.mesh_nodes={n}")),
        );
        set.extend(
            self.update
                .iter()
                .map(|name| format!("step1.update={name}")),
        );
        set.extend(self.law.iter().map(|file| {
            let file = std::path::absolute(file).unwrap_or_else(|_| file.clone());
            format!("workflow.law={}", file.display())
        }));
        set.extend(
            self.vtu_every
                .map(|every| format!("executor.vtu_every_ms={every:?}")),
        );
        set.extend(self.workers.map(|n| format!("executor.workers={n}")));
        set.extend(
            self.executor
                .iter()
                .map(|name| format!("executor.kind={name}")),
        );
        set
    }
}

/// Options for a run of the whole cohort; on a cluster it ends after its first tick.
fn of_cohort(
    cohort: Cohort,
    seen: Seen,
    refused: Vec<RefusedPatient>,
    folders: &Folders,
    worker: Option<&Path>,
) -> RunOptions {
    let recognised = seen.recognised(&cohort);
    let plans = cohort.patients.into_iter();
    RunOptions {
        run_dir: folders.run.clone(),
        cohort_name: cohort.name,
        description: cohort.description,
        cohort_dir: cohort.directory,
        patients: Some(plans.filter_map(|patient| patient.resolved).collect()),
        recognised,
        refused,
        only: Vec::new(),
        chosen: None,
        executor: cohort.settings.settings.executor.clone(),
        worker: worker.map(Path::to_owned),
        adopt_version: false,
        watch: false,
    }
}

/// Options for a run of the cohort on a cluster, whatever `executor.kind` its files set.
///
/// - `reads_all`: whether the plans of unchanged patients are read, too
pub(super) async fn load_for_cluster(
    folders: &Folders,
    set: &[String],
    strict: bool,
    worker: Option<&Path>,
    reads_all: bool,
    talk: &Talk,
) -> Result<RunOptions, CliError> {
    let set: Vec<String> = std::iter::once("executor.kind=slurm".to_owned())
        .chain(set.iter().cloned())
        .collect();
    let kept = kept::assignments(&folders.run).await?;
    // Meshes are checked before the first submission and not at every tick.
    let has_begun = folders.run.join(crate::place::DATABASE).exists();
    let seen = match reads_all {
        true => Seen::Nothing,
        false => Seen::of(&folders.run).await?,
    };
    let wanted = Wanted {
        kept: &kept,
        set: &set,
        only: &[],
        meshes: !has_begun,
        strict,
        follows_jobs: has_begun,
        known: seen.known(),
    };
    let (cohort, refused) = load(folders, &wanted, talk)?;
    Ok(of_cohort(cohort, seen, refused, folders, worker))
}

/// What is loaded of a cohort, and what is refused.
struct Wanted<'a> {
    /// Assignments that the run keeps.
    kept: &'a [String],
    /// Assignments of `--set`.
    set: &'a [String],
    /// Patients of the cohort to work on; empty means all.
    only: &'a [String],
    /// Whether the patients' own meshes are checked, too.
    meshes: bool,
    /// Whether an error of one patient refuses the whole cohort.
    strict: bool,
    /// Whether patients may all be refused: there are jobs that must be followed.
    follows_jobs: bool,
    /// Patients that the run has read; `None` reads all.
    known: Option<input::Known>,
}

/// Loads the cohort and prints all its problems. Patients with errors in their files are returned
/// next to it.
///
/// # Errors
/// [`CliError::Input`] if `cohort.toml` has errors, no wanted patient is free of them, or, with
/// `strict`, any patient has one.
fn load(
    folders: &Folders,
    wanted: &Wanted<'_>,
    talk: &Talk,
) -> Result<(Cohort, Vec<RefusedPatient>), CliError> {
    let Some(directory) = &folders.cohort else {
        let run = folders.run.display();
        let message = format!("{run} is a run: name its cohort, and the run with --run-dir {run}");
        return Err(CliError::Usage(message));
    };
    let mut report = Report::default();
    let options = Options {
        kept: wanted.kept.to_vec(),
        set: wanted.set.to_vec(),
        meshes: wanted.meshes,
        known: wanted.known.clone(),
        plans_only: true,
        ..Options::default()
    };
    let cohort = input::load(directory, &options, &mut report);
    problems::say(&report, talk);
    let refused = problems::refused(&report);
    let is_refused = |id: &String| refused.iter().any(|one| one.patient == *id);
    let is_wanted = |id: &String| wanted.only.is_empty() || wanted.only.contains(id);
    let Some(cohort) = cohort.filter(|cohort| {
        let mut ids = all_ids(cohort);
        report.n_errors() == 0
            || !wanted.strict
                && !report.has_error_of_cohort()
                && (wanted.follows_jobs || ids.any(|id| is_wanted(id) && !is_refused(id)))
    }) else {
        return Err(CliError::Input {
            errors: count(report.n_errors(), "error"),
        });
    };
    let known = |id: &&String| is_refused(id) || all_ids(&cohort).any(|known| known == *id);
    match wanted.only.iter().find(|id| !known(id)) {
        Some(id) => Err(CliError::Usage(unknown_patient(id, &cohort))),
        None => Ok((cohort, refused)),
    }
}

/// Names of all patients of a cohort, read or recognised.
fn all_ids(cohort: &Cohort) -> impl Iterator<Item = &String> {
    let read = cohort.patients.iter().map(|patient| &patient.id);
    read.chain(cohort.unchanged.iter().map(|(_, id)| id))
}

fn unknown_patient(id: &str, cohort: &Cohort) -> String {
    let known: Vec<&str> = all_ids(cohort).map(String::as_str).collect();
    let meant =
        input::nearest(id, known.iter().copied()).map(|meant| format!("; did you mean `{meant}`?"));
    format!(
        "no patient `{id}` in {}{}",
        cohort.directory.display(),
        meant.unwrap_or_default()
    )
}

/// Shows events, and the result of each patient as soon as it is known.
async fn watch(
    mut events: tokio::sync::mpsc::UnboundedReceiver<EngineEvent>,
    notifier: Notifier,
    folders: Folders,
    talk: Talk,
) {
    let mut watcher = Watcher::new(&talk, "patients");
    let mut last = None;
    while let Some(event) = events.recv().await {
        notifier.on(&event);
        let mut instead = None;
        if let EngineEvent::PatientEnded {
            patient, over, of, ..
        } = &event
        {
            if over == of && *of <= LINES_WITH_RESULTS {
                // The coordinator is about to close the database, and a reader would keep it from
                // tidying up.
                last = Some((patient.clone(), event));
                continue;
            }
            instead = result_line(patient, (*over, *of), &folders).await;
        }
        watcher.on(&event, instead.as_deref());
    }
    if let Some((patient, event)) = last
        && let EngineEvent::PatientEnded { over, of, .. } = event
    {
        let instead = result_line(&patient, (over, of), &folders).await;
        watcher.on(&event, instead.as_deref());
    }
    watcher.finish();
    notifier.finish().await;
}

/// Result of a patient in one line; `None` in a cohort so large that such lines would bury the
/// other output.
async fn result_line(
    patient: &PatientId,
    (over, of): (usize, usize),
    folders: &Folders,
) -> Option<String> {
    if of > LINES_WITH_RESULTS {
        return None;
    }
    let record = Reader::open(&folders.run)
        .await
        .ok()?
        .patient_record(patient)
        .await
        .ok()?;
    Some(format!(
        "{patient}  {} ({over} of {of})",
        summary::line(&record)
    ))
}

/// Prints table, report and hints, and returns the exit code.
async fn finish(
    args: &RunArgs,
    (summary, n_refused): (&RunSummary, usize),
    folders: &Folders,
    began: Instant,
    talk: &Talk,
) -> Result<Exit, CliError> {
    if summary.on_cluster() && args.json {
        talk.json(&open(folders).await?.status().await?)?;
        return Ok(Exit::Unfinished);
    }
    if summary.on_cluster() {
        return on_cluster(summary, folders, talk).await;
    }
    let reader = open(folders).await?;
    let cases = discovery::beside(folders.cohort.as_deref());
    let out = folders.run.join(FILE);
    let is_shown = summary.nothing_to_do()
        && !args.no_report
        && html::shows(
            &out,
            &reader.revision().await?,
            cases.as_ref(),
            summary.patients,
        );
    if !is_shown {
        let is_large = summary.patients > html::ONE_FILE;
        let record = match is_large {
            true => reader.overview().await?,
            false => reader.record().await?,
        };
        if !args.json {
            talk.data(&summary::table(&record, ROWS, talk))?;
        }
        if !args.no_report && record.patients.len() > html::ONE_FILE {
            let mut index =
                html::Index::new(&record, Pages::Changed, &out).map_err(CliError::Report)?;
            let page = |patient| index.page(&patient).map_err(CliError::Report);
            reader.each_record(page).await?;
            index.finish(cases.as_ref()).map_err(CliError::Report)?;
        } else if !args.no_report {
            html::write_report(&record, cases.as_ref(), Pages::Changed, &out)
                .map_err(CliError::Report)?;
        }
    }
    let report = if args.no_report {
        String::new()
    } else {
        format!("report: {}\n", out.display())
    };
    let wall = duration(began.elapsed().as_secs_f64());
    let parts = [
        (summary.done, "done"),
        (summary.failed, "failed"),
        (summary.cancelled, "cancelled"),
        (summary.unfinished, "unfinished"),
        (n_refused, "refused for errors in their files"),
    ];
    let parts: Vec<String> = parts
        .iter()
        .filter(|(n, _)| *n > 0)
        .map(|(n, what)| format!("{n} {what}"))
        .collect();
    let tasks = if summary.nothing_to_do() {
        "nothing to do: every task had its result".to_owned()
    } else {
        format!(
            "{} computed",
            count(
                usize::try_from(summary.published).unwrap_or(usize::MAX),
                "task"
            )
        )
    };
    if args.json {
        talk.json(&reader.status().await?)?;
    } else {
        talk.data(&format!(
            "{}: {} in {wall}, {tasks}\n{report}",
            count(summary.patients, "patient"),
            parts.join(", ")
        ))?;
    }
    if args.open {
        open_in_viewer(&out, talk);
    }
    if summary.stopped {
        talk.say("stopped; no finished result is lost");
        let only: String = (args.patients.iter())
            .map(|patient| format!(" --patient {patient}"))
            .collect();
        talk.hint(&format!(
            "continue with `cardiotwin run{}{only}`",
            folders.as_argument("")
        ));
        return Ok(Exit::Interrupted);
    }
    if summary.failed > 0 {
        let place = folders.as_argument("");
        talk.hint(&format!(
            "`cardiotwin status{place}` lists the failures first"
        ));
    }
    if n_refused > 0 {
        let place = folders.as_argument("");
        talk.hint(&format!(
            "`cardiotwin check{place}` shows the errors of refused patients; once they are mended, \
             `run` takes these patients up"
        ));
    }
    if summary.held > 0 {
        let place = folders.as_argument("");
        talk.hint(&format!(
            "{} still to learn from pilots: `cardiotwin status{place}` says for whom they wait, and \
             what to do",
            count(summary.held, "patient")
        ));
    }
    if summary.failed + summary.cancelled + summary.held + n_refused > 0 {
        return Ok(Exit::Problems);
    }
    done(&reader).await
}

/// The exit code of a run that is done: whether all twins that were verified are personalised. It comes
/// from the status, because the record of a large run takes long to read.
///
/// # Errors
/// [`StoreError`] if the run cannot be read.
pub(super) async fn done(reader: &Reader) -> Result<Exit, CliError> {
    let status = reader.status().await?;
    Ok(if status.patients.iter().any(PatientStatus::is_off) {
        Exit::Off
    } else {
        Exit::Ok
    })
}

/// Prints the state of a run that continues on the cluster, and the commands that advance it.
pub(super) async fn on_cluster(
    summary: &RunSummary,
    folders: &Folders,
    talk: &Talk,
) -> Result<Exit, CliError> {
    if summary.submitted > 0
        && let Some(said) = crate::slurm_variables::without_effect()
    {
        talk.say(&said);
    }
    let status = open(folders).await?.status().await?;
    talk.data(&status::screen(&status, "PATIENT", ROWS, talk))?;
    let place = folders.as_argument("");
    if summary.stopped {
        talk.say("stopped; jobs on the cluster keep running");
    }
    talk.hint(&format!(
        "`cardiotwin advance{place}` collects the results of jobs and continues once, `run{place} \
         --watch` until the end"
    ));
    Ok(Exit::Unfinished)
}

/// Prints the work that a run would do for each patient.
async fn dry_run(
    cohort: &Cohort,
    folders: &Folders,
    args: &RunArgs,
    talk: &Talk,
) -> Result<Exit, CliError> {
    let stands: BTreeMap<PatientId, String> = match Reader::open(&folders.run).await {
        Ok(reader) => {
            let patients = reader.record().await?.patients.into_iter();
            let stands = |p: PatientRecord| p.status.words();
            patients.map(|p| (p.plan.id.clone(), stands(p))).collect()
        }
        Err(StoreError::Missing { .. }) => BTreeMap::new(),
        Err(error) => return Err(error.into()),
    };
    let plans = cohort.plans();
    let foreseen = engine::foresee(&folders.run, &plans).await?;
    let mut rows = Vec::new();
    let is_wanted = |plan: &ResolvedPatient| {
        args.patients.is_empty() || args.patients.contains(&plan.id.to_string())
    };
    for plan in plans.into_iter().filter(is_wanted) {
        let would = match foreseen.get(&plan.id) {
            None => "start with step 0".to_owned(),
            Some(Foreseen::Stays) => "change nothing".to_owned(),
            Some(Foreseen::Waits) => "wait for pilots".to_owned(),
            Some(Foreseen::GoesOn(step)) => format!("continue with {step}"),
            Some(Foreseen::Redone(step)) => format!("redo {step} and all later steps"),
        };
        let stands = stands.get(&plan.id).map_or("-", String::as_str).to_owned();
        rows.push([plan.id.to_string(), stands, would]);
    }
    let n_patients = rows.len();
    if args.json {
        let row = |[patient, stands_at, would]: &[String; 3]| serde_json::json!({"patient": patient, "stands_at": stands_at, "would": would});
        let rows: Vec<_> = rows.iter().map(row).collect();
        talk.json(&serde_json::json!({"run_dir": folders.run, "patients": rows}))?;
        return Ok(Exit::Ok);
    }
    let mut table = Columns::new(talk, &["PATIENT", "STANDS AT", "WOULD"]);
    rows.into_iter().for_each(|row| table.row(row));
    talk.data(&table.text())?;
    let executor = &cohort.settings.settings.executor;
    let workers = if executor.workers == 0 {
        "one worker per core".to_owned()
    } else {
        count(executor.workers as usize, "worker")
    };
    talk.data(&format!(
        "{} in {}; {workers}\n",
        count(n_patients, "patient"),
        folders.run.display()
    ))?;
    Ok(Exit::Ok)
}
