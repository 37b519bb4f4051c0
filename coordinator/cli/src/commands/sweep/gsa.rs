//! `cardiotwin sweep gsa`: Sobol sensitivity analysis of the 0D cell or of a patient's organ. A
//! second call continues it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_engine::clock;
use cardiotwin_engine::{RunOptions, RunSummary};
use cardiotwin_schemas::formats;
use cardiotwin_schemas::organ::{BeatCount, ContractionSpec};
use cardiotwin_schemas::settings::ExecutorSettings;
use cardiotwin_schemas::sweep::{GsaSpec, SweepFile, SweepSpec, SweptOrgan};
use cardiotwin_schemas::task::OrganBeatSpec;
use cardiotwin_sweep::gsa::spec::{self, DesignOptions};
use cardiotwin_sweep::gsa::{chunks, selection};
use cardiotwin_sweep::{SweepError, folder};
use clap::{Args, ValueEnum};

use super::drive::drive;
use super::on_cluster::{self, OnCluster};
use super::outcome::{self, Answer, Phases};
use super::screen;
use crate::error::CliError;
use crate::exit::Exit;
use crate::open::open as open_in_viewer;
use crate::place::Folders;
use crate::talk::Talk;
use crate::ventricle::Ventricle;

/// Rank the cell's parameters by Sobol indices of its biomarkers, as in Jung et al. 2022, or of a
/// patient's organ
#[derive(Debug, Args)]
#[command(
    after_help = "The defaults of the cell are those of the paper: 1024 blocks of 44 samples over \
                  17 Land and 4 Rice parameters. The same command continues an interrupted sweep, \
                  and with more --samples it extends a sweep without repeating any. Ctrl-C works as \
                  in `run`."
)]
pub struct GsaArgs {
    /// Folder of the sweep, created if absent [default: gsa, or gsa-PATIENT with --organ]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Simulate this patient's reduced ventricle with each cell, for indices of the organ's seven
    /// biomarkers
    #[arg(long, value_name = "PATIENT", conflicts_with_all = ["cycle_length_ms", "lambda_0", "tolerance"])]
    organ: Option<String>,
    /// Intervals of the cell's parameters: `twin`, 30 % around those of the patient's twin, or
    /// `paper`, those of Table A5
    #[arg(
        long,
        value_name = "BOX",
        requires = "organ",
        value_enum,
        hide_possible_values = true
    )]
    r#box: Option<Intervals>,
    /// Sweep the valves' forward resistances, too
    #[arg(long, requires = "organ")]
    valves: bool,
    /// Folder of the patient's cohort (with cohort.toml) or run (with cardiotwin.db) [default: .]
    #[arg(long, value_name = "DIR", requires = "organ")]
    cohort: Option<PathBuf>,
    /// Folder of the patient's run [default: COHORT/run]
    #[arg(long, value_name = "DIR", requires = "organ")]
    run_dir: Option<PathBuf>,
    /// Number of base points, best a power of two; each gives 2D + 2 samples for D parameters
    /// [default: 1024]
    #[arg(long, value_name = "N")]
    samples: Option<u32>,
    /// Seed of the bootstrap and the scrambling [default: 1]
    #[arg(long, value_name = "SEED")]
    seed: Option<u64>,
    /// Use scrambled Sobol points instead of plain ones
    #[arg(long)]
    scramble: bool,
    /// Number of blocks per task, which does not affect results [default: 64, 32 with --organ]
    #[arg(long, value_name = "N")]
    chunk_blocks: Option<u32>,
    /// Number of bootstrap resamples for the intervals [default: 1000]
    #[arg(long, value_name = "N")]
    resamples: Option<u32>,
    /// Coverage probability of the intervals [default: 0.95]
    #[arg(long, value_name = "P")]
    confidence: Option<f64>,
    /// Change the interval of a swept parameter, or sweep a further parameter (may be given several
    /// times)
    #[arg(long, value_name = "NAME=LOWER,UPPER", value_parser = bounds)]
    bounds: Vec<(String, [f64; 2])>,
    /// Fix a parameter at a value; a swept parameter leaves the design (may be given several times)
    #[arg(long, value_name = "NAME=VALUE", value_parser = value)]
    set: Vec<(String, f64)>,
    /// Cycle length in ms [default: 1000]
    #[arg(long, value_name = "MS")]
    cycle_length_ms: Option<f64>,
    /// Initial stretch [default: 1.1]
    #[arg(long, value_name = "STRETCH")]
    lambda_0: Option<f64>,
    /// Tolerance of the cell engine [default: 1e-4]
    #[arg(long, value_name = "TOLERANCE")]
    tolerance: Option<f64>,
    /// Write settings that fit the N most influential parameters: of step 2, or of step 3 for an
    /// organ
    #[arg(long, value_name = "N")]
    select: Option<usize>,
    /// Number of workers at a time; 0 is one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    workers: u32,
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

/// Where an organ's intervals come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Intervals {
    Twin,
    Paper,
}

fn bounds(text: &str) -> Result<(String, [f64; 2]), String> {
    let parts = text
        .split_once('=')
        .and_then(|(name, range)| Some((name, range.split_once(',')?)));
    let (name, (lower, upper)) = parts.ok_or("expected NAME=LOWER,UPPER")?;
    Ok((name.to_owned(), [number(lower)?, number(upper)?]))
}

fn value(text: &str) -> Result<(String, f64), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE")?;
    Ok((name.to_owned(), number(value)?))
}

fn number(text: &str) -> Result<f64, String> {
    text.trim()
        .parse()
        .map_err(|_| format!("`{text}` is not a number"))
}

impl GsaArgs {
    /// Folder of the sweep: `--out`, or the default name.
    fn out(&self) -> PathBuf {
        let default = || {
            self.organ
                .as_ref()
                .map_or_else(|| "gsa".into(), |patient| format!("gsa-{patient}").into())
        };
        self.out.clone().unwrap_or_else(default)
    }

    /// Settings given on the command line.
    ///
    /// - `beat`: beat of the swept organ; `None` for the cell
    fn wishes(&self, beat: Option<&OrganBeatSpec>) -> DesignOptions {
        // The box comes first, so that intervals from `--bounds` replace its own.
        let mut bounds = match self.r#box {
            None => Vec::new(),
            Some(Intervals::Paper) => spec::of_paper(),
            Some(Intervals::Twin) => {
                spec::around(beat.and_then(|beat| beat.contraction.cell_parameters()))
            }
        };
        if self.valves {
            bounds.extend(spec::valves());
        }
        bounds.extend(self.bounds.iter().cloned());
        DesignOptions {
            samples: self.samples,
            seed: self.seed,
            scramble: self.scramble,
            chunk_blocks: self.chunk_blocks,
            resamples: self.resamples,
            confidence: self.confidence,
            cycle_length_ms: self.cycle_length_ms,
            lambda_0: self.lambda_0,
            tolerance: self.tolerance,
            bounds,
            set: self.set.clone(),
        }
    }
}

/// Runs the sweep, analyses it and prints the result.
///
/// # Errors
/// [`SweepError`] for settings that are invalid or do not fit the sweep in the folder; errors of
/// the engine.
pub async fn execute(args: &GsaArgs, talk: &Talk) -> Result<Exit, CliError> {
    let began = Instant::now();
    let (out, spec) = (args.out(), settle(args).await?);
    let n_parameters = spec.design.parameters.len();
    if args
        .select
        .is_some_and(|n| !(1..=n_parameters).contains(&n))
    {
        let expected = format!("1 to {n_parameters}, the number of swept parameters");
        let found = args.select.unwrap_or_default().to_string();
        return Err(SweepError::Setting {
            name: "--select".into(),
            found,
            expected,
        }
        .into());
    }
    let mut executor = ExecutorSettings {
        workers: args.workers,
        ..ExecutorSettings::default()
    };
    args.cluster.apply(&mut executor);
    let options = RunOptions {
        run_dir: out.clone(),
        chosen: None,
        cohort_name: "gsa".into(),
        description: format!(
            "sensitivity of {} to {n_parameters} parameters, {} blocks",
            subject(&spec),
            spec.n_blocks
        ),
        cohort_dir: out.clone(),
        patients: Some(chunks::members(&spec)),
        refused: Vec::new(),
        recognised: Default::default(),
        only: Vec::new(),
        executor,
        worker: args.worker.clone(),
        adopt_version: true,
        watch: args.cluster.watch,
    };
    let summary = drive(options, "chunks", talk).await?;
    if summary.on_cluster() {
        on_cluster::tell(&summary, "chunks", talk);
        return Ok(Exit::Unfinished);
    }
    let simulated_s = began.elapsed().as_secs_f64();
    finish(
        args,
        &summary,
        Phases {
            simulate_s: simulated_s,
            ..Phases::default()
        },
        began,
        talk,
    )
    .await
}

fn subject(spec: &GsaSpec) -> String {
    let organ = spec.design.organ.as_ref();
    organ.map_or_else(
        || "the 0D cell".to_owned(),
        |organ| format!("the organ of {}", organ.patient),
    )
}

/// The default design: in the patient's ventricle with `--organ`, otherwise the published one of
/// the cell.
async fn base(args: &GsaArgs) -> Result<GsaSpec, CliError> {
    let Some(patient) = &args.organ else {
        return Ok(spec::published());
    };
    let cohort = args.cohort.as_deref().unwrap_or(Path::new("."));
    let folders = Folders::of(cohort, args.run_dir.as_deref());
    let ventricle = Ventricle::of_run(&folders, patient, "--organ").await?;
    let beats = BeatCount::Fixed {
        n: ventricle.plan.settings.solver.beats,
    };
    let mut beat = ventricle.beat_of_twin("--organ", beats)?;
    let (parameters, lambda_0) = match beat.contraction {
        ContractionSpec::Land2017Rice {
            parameters,
            lambda_0,
        }
        | ContractionSpec::Land2017Trace {
            parameters,
            lambda_0,
            ..
        } => (parameters, lambda_0),
        ContractionSpec::Tanh { .. } | ContractionSpec::Catalogue { .. } => (BTreeMap::new(), 1.0),
    };
    // Calcium parameters are swept, too, so that the beat must not use a calcium trace.
    beat.contraction = ContractionSpec::Land2017Rice {
        parameters,
        lambda_0,
    };
    Ok(spec::of_organ(
        SweptOrgan {
            patient: ventricle.plan.id.clone(),
            beat,
            law: ventricle.law(),
        },
        lambda_0,
    ))
}

/// Combines this call's settings with those in the folder's file, and writes the file if they
/// differ.
async fn settle(args: &GsaArgs) -> Result<GsaSpec, CliError> {
    let (out, base) = (args.out(), base(args).await?);
    let beat = base.design.organ.as_ref().map(|organ| organ.beat.clone());
    let wishes = args.wishes(beat.as_ref());
    let before = folder::find(&out)?;
    let (spec, file) = match before {
        Some(file) => {
            let stored = spec::of(file.clone())?;
            let mut spec = wishes.on(stored.clone())?;
            if args.organ.is_some() {
                spec.design.organ = base.design.organ;
            }
            spec::may_follow(&out, &stored, &spec)?;
            if spec == stored {
                return Ok(spec);
            }
            (spec, file)
        }
        None => {
            let spec = wishes.on(base)?;
            let sweep = SweepSpec::Gsa(Box::new(spec.clone()));
            let version = env!("CARGO_PKG_VERSION").to_owned();
            (
                spec,
                SweepFile {
                    schema_version: formats::SWEEP.version,
                    version,
                    created: clock::now_utc(),
                    sweep,
                },
            )
        }
    };
    folder::write(
        &out,
        &SweepFile {
            sweep: SweepSpec::Gsa(Box::new(spec.clone())),
            ..file
        },
    )?;
    Ok(spec)
}

/// Analyses the sweep, writes files, prints tables and hints, and returns the exit code.
async fn finish(
    args: &GsaArgs,
    summary: &RunSummary,
    mut phases: Phases,
    began: Instant,
    talk: &Talk,
) -> Result<Exit, CliError> {
    let out = args.out();
    let whole = summary.unfinished + summary.failed + summary.cancelled == 0;
    let found = outcome::analysed(&out, None, &mut phases).await;
    let record = match found {
        Ok(record) => Some(record),
        // A sweep that was stopped at once has no results; `hints` says that it was stopped.
        Err(CliError::Sweep(SweepError::TooEarly { .. })) if !whole => None,
        Err(error) => return Err(error),
    };
    let mut files = Vec::new();
    if let Some(record) = &record {
        let writing = Instant::now();
        files = outcome::write(&out, record)?;
        if let Some(n) = args.select {
            files.push(folder::write_result(
                &out,
                selection::file(record),
                &selection::toml(record, n)?,
            )?);
        }
        phases.write_s = writing.elapsed().as_secs_f64();
    }
    phases.total_s = began.elapsed().as_secs_f64();
    if args.json {
        talk.json(&Answer::new(&out, summary, phases, &files, record.as_ref()))?;
    } else if let Some(record) = &record {
        talk.data(&screen::ranking(record, screen::Order::Total, talk))?;
        talk.data(&screen::remarks(record))?;
        if let Some(n) = args.select {
            talk.data(&format!("\n{}\n", selection::toml(record, n)?.trim_end()))?;
        }
        talk.data(&screen::closing(summary, &phases, &files))?;
    }
    if args.open
        && let Some(page) = outcome::page_among(&files)
    {
        open_in_viewer(page, talk);
    }
    hints(args, summary, talk);
    Ok(match (summary.stopped, whole) {
        (true, _) => Exit::Interrupted,
        (false, false) => Exit::Problems,
        (false, true) => Exit::Ok,
    })
}

fn hints(args: &GsaArgs, summary: &RunSummary, talk: &Talk) {
    let out = args.out();
    let folder = out.display();
    if summary.stopped {
        talk.say("stopped; no finished result is lost");
        talk.hint(&format!(
            "continue with `cardiotwin sweep gsa --out {folder}`"
        ));
    } else if summary.failed > 0 {
        talk.hint(&format!(
            "`cardiotwin sweep status {folder}` lists the failures; `cardiotwin retry --failed \
             --cohort {folder}` retries them"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_and_values_are_read_and_nonsense_is_named() {
        assert_eq!(bounds("n_Tm=3,7.5"), Ok(("n_Tm".into(), [3.0, 7.5])));
        assert_eq!(value("phi=-1e-3"), Ok(("phi".into(), -1e-3)));
        assert_eq!(bounds("n_Tm=3"), Err("expected NAME=LOWER,UPPER".into()));
        assert_eq!(bounds("n_Tm=3,x"), Err("`x` is not a number".into()));
        assert_eq!(value("phi"), Err("expected NAME=VALUE".into()));
    }
}
