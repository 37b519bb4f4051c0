//! Analysis of a sweep's folder, and the files that hold its results.

use std::path::{Path, PathBuf};
use std::time::Instant;

use cardiotwin_engine::{Reader, RunSummary};
use cardiotwin_report::html::sensitivity;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::sensitivity::SensitivityRecord;
use cardiotwin_sweep::folder::{self, write_result};
use cardiotwin_sweep::gsa::samples::read_first;
use cardiotwin_sweep::gsa::{analysis, spec, tables};
use serde::Serialize;

use crate::error::CliError;

/// Wall times of the successive phases of a sweep.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Phases {
    /// Simulation of the chunks through the engine until the run is closed, s.
    pub simulate_s: f64,
    /// Reading of the samples, including the check of their hashes, s.
    pub read_s: f64,
    /// Indices, bootstrap and ranking, s.
    pub analyse_s: f64,
    /// Writing of the result files, s.
    pub write_s: f64,
    /// The whole command, s.
    pub total_s: f64,
}

/// Answer of `sweep gsa --json`.
#[derive(Debug, Serialize)]
pub struct Answer<'a> {
    schema_version: u32,
    folder: &'a Path,
    /// Numbers of chunks by state, and of those published by this call.
    chunks: Chunks,
    stopped: bool,
    phases: Phases,
    files: &'a [PathBuf],
    /// `None` before two blocks are complete.
    sensitivity: Option<&'a SensitivityRecord>,
}

#[derive(Debug, Serialize)]
struct Chunks {
    total: usize,
    done: usize,
    failed: usize,
    cancelled: usize,
    unfinished: usize,
    published_now: u64,
}

impl<'a> Answer<'a> {
    /// The answer for one call.
    pub fn new(
        folder: &'a Path,
        run: &RunSummary,
        phases: Phases,
        files: &'a [PathBuf],
        sensitivity: Option<&'a SensitivityRecord>,
    ) -> Self {
        let chunks = Chunks {
            total: run.patients,
            done: run.done,
            failed: run.failed,
            cancelled: run.cancelled,
            unfinished: run.unfinished,
            published_now: run.published,
        };
        Self {
            schema_version: formats::SWEEP_OUTCOME.version,
            folder,
            chunks,
            stopped: run.stopped,
            phases,
            files,
            sensitivity,
        }
    }
}

/// Analyses the complete blocks from the first on, at most `blocks` of them.
///
/// # Errors
/// [`SweepError`](cardiotwin_sweep::SweepError) if the folder holds no sweep, if too few blocks are
/// complete, or if an artefact is damaged.
pub async fn analysed(
    folder: &Path,
    blocks: Option<u32>,
    phases: &mut Phases,
) -> Result<SensitivityRecord, CliError> {
    let spec = spec::of(folder::read(folder)?)?;
    let began = Instant::now();
    let members = Reader::open(folder).await?.members().await?;
    let chunks = members
        .iter()
        .map(|member| (&member.plan, member.task.as_ref()));
    let samples = read_first(&spec, blocks.unwrap_or(u32::MAX), chunks)?;
    phases.read_s = began.elapsed().as_secs_f64();
    let began = Instant::now();
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let record = analysis::sensitivity(&spec, &samples, threads)?;
    phases.analyse_s = began.elapsed().as_secs_f64();
    Ok(record)
}

/// The page among written files.
pub fn page_among(files: &[PathBuf]) -> Option<&PathBuf> {
    files
        .iter()
        .find(|file| file.extension().is_some_and(|ending| ending == "html"))
}

/// Writes tables, figure, page and record into the folder's `results`.
///
/// # Errors
/// A file cannot be written.
pub fn write(folder: &Path, record: &SensitivityRecord) -> Result<Vec<PathBuf>, CliError> {
    let json = serde_json::to_string_pretty(record).map_err(|error| CliError::Io {
        what: "cannot write JSON",
        source: error.into(),
    })?;
    let files = [
        ("indices.csv", tables::indices(record)),
        ("second_order.csv", tables::second_order(record)),
        ("ranking.csv", tables::ranking(record)),
        ("sensitivity.json", json + "\n"),
        ("sensitivity.svg", sensitivity::figure(record)),
        ("report.html", sensitivity::page(record)),
    ];
    Ok(files
        .iter()
        .map(|(name, text)| write_result(folder, name, text))
        .collect::<Result<_, _>>()?)
}
