//! `cardiotwin sweep robustness`: personalisations with perturbed data or initial guesses.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_engine::clock;
use cardiotwin_engine::{Chosen, Reader, RunOptions, RunSummary};
use cardiotwin_input::{self as input, Cohort, Options, Report};
use cardiotwin_report::html::write_robustness;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::ids::PatientId;
use cardiotwin_schemas::plan::ResolvedPatient;
use cardiotwin_schemas::record::RunRecord;
use cardiotwin_schemas::robustness::{RobustnessResult, RobustnessSpec, Uncertainty};
use cardiotwin_schemas::sweep::{SweepFile, SweepSpec};
use cardiotwin_sweep::{SweepError, folder, robustness};
use clap::{Args, ValueEnum};

use super::drive::drive;
use super::on_cluster::{self, OnCluster};
use super::robustness_text;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::cohort_folder;
use crate::table::duration;
use crate::talk::{Talk, count};
use crate::{kept, problems, redone};

/// Value of `--patient` that stands for every patient.
const ALL: &str = "all";

/// Setting for the stopping rule of step 1, as it begins in `--set`.
const STOP: &str = "step1.stop=";
/// Settings over guesses: step 1 continues until no iteration improves the cost any more. Otherwise
/// the guess would decide where within the tolerance step 1 stops, and that difference would be
/// taken for an effect of the guess. Over data, step 1 stops as in the paper: beyond that point,
/// parameters that uncertain targets hardly determine pay for the last thousandth
/// (docs/robustness.md).
const TO_THE_END: [&str; 3] = [
    "step1.stop=best-of-limit",
    "step1.max_iterations=30",
    "step1.stall_iterations=6",
];

/// Personalise with perturbed data or initial guesses, and tabulate the spread of results (Tables 3
/// to 10 and Figure 6 of the paper)
#[derive(Debug, Args)]
#[command(
    after_help = "The same command continues an interrupted sweep without recomputing finished \
                  members. The folder is a run: `status`, `show`, `logs` and `cancel` work on it. \
                  For data, step 1 stops at the first iterate within the tolerance, as in the \
                  paper. For guesses it continues until six iterations in a row bring no \
                  improvement, at most 30, since the guess would otherwise decide where it stops. \
                  --set step1.stop=first-converged or best-of-limit overrides either."
)]
pub struct RobustnessArgs {
    /// Folder of the cohort
    #[arg(value_name = "COHORT", default_value = ".")]
    cohort: PathBuf,
    /// Inputs to vary: the measured biomarkers, or the initial guesses of both steps
    #[arg(long, value_name = "data|guess", value_enum)]
    kind: Kind,
    /// Patient to personalise (may be given several times), or `all` [default: all]
    #[arg(long = "patient", value_name = "PATIENT")]
    patients: Vec<String>,
    /// Number of samples of the Latin hypercube [default: 10 for data, 5 for guess, as in the
    /// paper]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100_000))]
    samples: Option<u32>,
    /// Number of members that differ only in step 2's seed [default: 0 for data, 5 for guess]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=100_000))]
    seeds: Option<u32>,
    /// Half-width of the hypercube as a fraction of each value [default: 0.1 for data, 0.5 for
    /// guess]
    #[arg(long, value_name = "SHARE")]
    range: Option<f64>,
    /// Seed of the hypercube [default: 1]
    #[arg(long, value_name = "S")]
    seed: Option<u64>,
    /// Folder of the sweep [default: COHORT/sweeps/robustness-KIND]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of workers at a time; 0 is one per core
    #[arg(long, value_name = "N")]
    workers: Option<u32>,
    /// Set KEY to VALUE, overriding all files (may be given several times); `config show` lists the keys
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Drop KEY, or `all`, from the saved options of this sweep (may be given several times)
    #[arg(long, value_name = "KEY")]
    unset: Vec<String>,
    /// Redo finished members without a question where settings have changed
    #[arg(long)]
    yes: bool,
    /// Write the tables of finished members without running any
    #[arg(long)]
    results_only: bool,
    #[command(flatten)]
    cluster: OnCluster,
    /// Path of the worker's executable [default: cardiotwin-worker next to this program]
    #[arg(long, value_name = "PATH")]
    worker: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    /// Open the page in the desktop's viewer
    #[arg(long)]
    open: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    Data,
    Guess,
}

impl Kind {
    fn over(self) -> Uncertainty {
        match self {
            Self::Data => Uncertainty::Data,
            Self::Guess => Uncertainty::Guess,
        }
    }
}

impl RobustnessArgs {
    /// Assignments of `--set`, followed by the settings that other options stand for.
    fn given(&self) -> Vec<String> {
        let workers = self.workers.map(|n| format!("executor.workers={n}"));
        self.set.iter().cloned().chain(workers).collect()
    }
}

/// Runs the personalisations and prints the spread.
///
/// # Errors
/// [`CliError::Input`] if the cohort has errors; errors of the sweep, the engine and the report.
pub async fn execute(args: &RobustnessArgs, talk: &Talk) -> Result<Exit, CliError> {
    let began = Instant::now();
    let out = args.out.clone().unwrap_or_else(|| {
        cohort_folder(&args.cohort)
            .join("sweeps")
            .join(format!("robustness-{}", args.kind.over().word()))
    });
    let before = before(args.kind.over(), &out)?;
    let choice = kept::choose(&out, &args.unset, &args.given(), talk).await?;
    let cohort = load(args, &choice.set, before.as_ref(), talk)?;
    let spec = specification(args, before.as_ref(), &cohort, &out)?;
    let plans = cohort.plans();
    let members = members(&spec, &plans)?;
    let mut summary = None;
    if !args.results_only {
        let changes = redone::changed(choice.before.as_ref(), &cohort.settings);
        if let Some(told) = redone::told(&out, || members.clone(), &[], &changes).await? {
            redone::consent(&told, args.yes, talk)?;
        }
        take(&out, &spec)?;
        let chosen = Chosen {
            set: choice.set,
            settings: cohort.settings.value.clone(),
        };
        let ran = run(args, &cohort, (&out, chosen), members, talk).await?;
        if ran.on_cluster() {
            on_cluster::tell(&ran, "personalisations", talk);
            return Ok(Exit::Unfinished);
        }
        summary = Some(ran);
    }
    let record = Reader::open(&out).await?.record().await?;
    let result = robustness::result(&spec, &plans, &record).map_err(SweepError::from)?;
    let page = write(&result, &record, &out)?;
    if args.json {
        talk.json(&result)?;
    } else {
        talk.data(&robustness_text::tables(&result, talk))?;
    }
    talk.say(&format!("tables and figure: {}", page.display()));
    if args.open {
        open_in_viewer(&page, talk);
    }
    Ok(summary.map_or(Exit::Ok, |summary| ended(&summary, began, talk)))
}

/// Results of the members so far, and the record from which they are computed. The cohort's files
/// are not read.
///
/// # Errors
/// Errors of the store; [`SweepError::Empty`] if the run has no member yet.
pub(super) async fn stored(
    out: &Path,
    spec: &RobustnessSpec,
) -> Result<(RobustnessResult, RunRecord), CliError> {
    let record = Reader::open(out).await?.record().await?;
    let plans = robustness::patients(spec, &record);
    if plans.is_empty() {
        return Err(SweepError::Empty {
            path: out.to_owned(),
        }
        .into());
    }
    let result = robustness::result(spec, &plans, &record).map_err(SweepError::from)?;
    Ok((result, record))
}

/// Specification of the sweep that is already in the folder; an error if that sweep is of another
/// kind.
fn before(over: Uncertainty, out: &Path) -> Result<Option<RobustnessSpec>, CliError> {
    match folder::find(out)?.map(|file| file.sweep) {
        None => Ok(None),
        Some(SweepSpec::Robustness(spec)) if spec.over == over => Ok(Some(*spec)),
        Some(other) => {
            let changes = format!("it holds a sweep of {}", described(&other));
            Err(SweepError::Changed {
                path: out.to_owned(),
                changes,
            }
            .into())
        }
    }
}

/// Loads the patients that are named and those already in the sweep, or the whole cohort if none is
/// named. Prints all problems.
fn load(
    args: &RobustnessArgs,
    chosen: &BTreeMap<String, String>,
    before: Option<&RobustnessSpec>,
    talk: &Talk,
) -> Result<Cohort, CliError> {
    let mut set = kept::as_assignments(chosen);
    if matches!(args.kind.over(), Uncertainty::Guess)
        && !set.iter().any(|setting| setting.starts_with(STOP))
    {
        // The defaults come first, so that settings from `--set` replace them.
        set.splice(0..0, TO_THE_END.map(str::to_owned));
    }
    let mut only: Vec<String> = before.map_or(Vec::new(), |s| {
        s.patients.iter().map(ToString::to_string).collect()
    });
    only.extend(
        args.patients
            .iter()
            .filter(|id| !before.is_some_and(|s| s.patients.iter().any(|p| p.as_str() == **id)))
            .cloned(),
    );
    if args.patients.iter().any(|id| id == ALL) {
        only.clear();
    }
    let mut report = Report::default();
    let cohort = input::load(
        cohort_folder(&args.cohort),
        &Options {
            set,
            only,
            ..Options::default()
        },
        &mut report,
    );
    problems::say(&report, talk);
    cohort
        .filter(|_| report.n_errors() == 0)
        .ok_or_else(|| CliError::Input {
            errors: count(report.n_errors(), "error"),
        })
}

/// Specification from the arguments. An absent argument takes the value in the folder, or the
/// paper's.
fn specification(
    args: &RobustnessArgs,
    before: Option<&RobustnessSpec>,
    cohort: &Cohort,
    out: &Path,
) -> Result<RobustnessSpec, CliError> {
    let over = args.kind.over();
    let paper = match over {
        Uncertainty::Data => (10, 0, robustness::DATA_RANGE),
        Uncertainty::Guess => (5, 5, robustness::GUESS_RANGE),
    };
    let spec = RobustnessSpec {
        over,
        patients: cohort
            .patients
            .iter()
            .map(|p| PatientId(p.id.clone()))
            .collect(),
        n_samples: args
            .samples
            .or(before.map(|s| s.n_samples))
            .unwrap_or(paper.0),
        n_seeds: args.seeds.or(before.map(|s| s.n_seeds)).unwrap_or(paper.1),
        range: args.range.or(before.map(|s| s.range)).unwrap_or(paper.2),
        seed: args.seed.or(before.map(|s| s.seed)).unwrap_or(1),
    };
    if !(spec.range > 0.0 && spec.range < 1.0) {
        let expected = "a fraction above 0 and below 1, for example 0.1 for ±10 %".to_owned();
        return Err(SweepError::Setting {
            name: "--range".into(),
            found: spec.range.to_string(),
            expected,
        }
        .into());
    }
    match before
        .map(|before| changes(before, &spec))
        .filter(|changes| !changes.is_empty())
    {
        Some(changes) => Err(SweepError::Changed {
            path: out.to_owned(),
            changes: changes.join(", "),
        }
        .into()),
        None => Ok(spec),
    }
}

fn described(sweep: &SweepSpec) -> String {
    match sweep {
        SweepSpec::Robustness(spec) => format!("robustness of kind {}", spec.over.word()),
        other => other.kind().to_owned(),
    }
}

/// Changed settings on which the samples depend. More patients or more seeds are allowed.
fn changes(before: &RobustnessSpec, now: &RobustnessSpec) -> Vec<String> {
    let mut changes = Vec::new();
    let mut compare = |name: &str, before: String, now: String| {
        if before != now {
            changes.push(format!("{name} was {before}, now {now}"));
        }
    };
    compare(
        "--samples",
        before.n_samples.to_string(),
        now.n_samples.to_string(),
    );
    compare("--range", before.range.to_string(), now.range.to_string());
    compare("--seed", before.seed.to_string(), now.seed.to_string());
    changes
}

/// Members of all patients.
fn members(
    spec: &RobustnessSpec,
    plans: &[ResolvedPatient],
) -> Result<Vec<ResolvedPatient>, CliError> {
    let mut all = Vec::new();
    for plan in plans {
        let members = robustness::members(plan, spec).map_err(SweepError::from)?;
        all.extend(members.into_iter().map(|member| member.plan));
    }
    Ok(all)
}

/// Writes the specification into the folder, unless it is there already.
fn take(out: &Path, spec: &RobustnessSpec) -> Result<(), CliError> {
    let sweep = SweepSpec::Robustness(Box::new(spec.clone()));
    let before = folder::find(out)?;
    if before.as_ref().is_some_and(|file| file.sweep == sweep) {
        return Ok(());
    }
    let file = SweepFile {
        schema_version: formats::SWEEP.version,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        created: before.map_or_else(clock::now_utc, |file| file.created),
        sweep,
    };
    Ok(folder::write(out, &file)?)
}

async fn run(
    args: &RobustnessArgs,
    cohort: &Cohort,
    (out, chosen): (&Path, Chosen),
    members: Vec<ResolvedPatient>,
    talk: &Talk,
) -> Result<RunSummary, CliError> {
    let mut executor = cohort.settings.settings.executor.clone();
    args.cluster.apply(&mut executor);
    let options = RunOptions {
        run_dir: out.to_owned(),
        chosen: Some(chosen),
        cohort_name: cohort.name.clone(),
        description: format!("robustness, {}", args.kind.over().word()),
        cohort_dir: cohort.directory.clone(),
        patients: Some(members),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor,
        worker: args.worker.clone(),
        adopt_version: true,
        watch: args.cluster.watch,
    };
    drive(options, "personalisations", talk).await
}

/// Writes all files and returns the path of the page.
pub(super) fn write(
    result: &RobustnessResult,
    record: &RunRecord,
    out: &Path,
) -> Result<PathBuf, CliError> {
    let json = serde_json::to_string_pretty(result).expect("a result is JSON") + "\n";
    for (name, text) in [
        ("robustness.json", json),
        ("tables.csv", robustness::tables_csv(result)),
        ("members.csv", robustness::members_csv(result)),
        ("targets.csv", robustness::targets_csv(result)),
    ] {
        folder::write_result(out, name, &text)?;
    }
    let page = out.join(folder::RESULTS).join("robustness.html");
    write_robustness(result, record, &page).map_err(CliError::Report)?;
    Ok(page)
}

fn ended(summary: &RunSummary, began: Instant, talk: &Talk) -> Exit {
    let failed = summary.failed + summary.cancelled;
    talk.say(&format!(
        "{} in {}: {} done, {failed} failed or cancelled, {} unfinished; {} computed",
        count(summary.patients, "personalisation"),
        duration(began.elapsed().as_secs_f64()),
        summary.done,
        summary.unfinished,
        count(
            usize::try_from(summary.published).unwrap_or(usize::MAX),
            "task"
        ),
    ));
    if summary.stopped {
        talk.say("stopped; no finished result is lost, and the same command continues");
        return Exit::Interrupted;
    }
    if failed > 0 { Exit::Problems } else { Exit::Ok }
}
