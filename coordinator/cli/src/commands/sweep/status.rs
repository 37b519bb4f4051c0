//! `cardiotwin sweep status`: progress and failures of a sweep.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use cardiotwin_engine::Reader;
use cardiotwin_schemas::formats;
use cardiotwin_schemas::robustness::RobustnessSpec;
use cardiotwin_schemas::status::{PatientState, PatientStatus};
use cardiotwin_schemas::sweep::SweepSpec;
use cardiotwin_sweep::folder;
use cardiotwin_sweep::gsa::{chunks, spec};
use clap::Args;
use serde::Serialize;

use crate::error::CliError;
use crate::exit::Exit;
use crate::talk::{Talk, count};

/// Show the progress of a sweep
#[derive(Debug, Args)]
pub struct StatusArgs {
    /// Folder of the sweep
    #[arg(value_name = "DIR", default_value = "gsa")]
    folder: PathBuf,
    /// Print JSON instead of text
    #[arg(long)]
    json: bool,
}

/// Progress of a sensitivity analysis.
#[derive(Debug, Serialize)]
struct SweepStatus {
    schema_version: u32,
    kind: &'static str,
    /// Time at which the store was read, UTC, RFC 3339.
    as_of: String,
    coordinator_running: bool,
    /// Number of blocks in the whole sweep.
    blocks: u32,
    /// Number of complete blocks before the first gap, from which indices can be computed now.
    blocks_complete: u32,
    samples_complete: u64,
    /// Number of chunks by state.
    chunks: BTreeMap<PatientState, u64>,
    failed: Vec<PatientStatus>,
}

/// Prints the sweep's progress.
///
/// # Errors
/// [`SweepError::NoSweep`](cardiotwin_sweep::SweepError::NoSweep) if the folder holds no sweep; errors
/// of the store.
pub async fn execute(args: &StatusArgs, talk: &Talk) -> Result<Exit, CliError> {
    if let SweepSpec::Robustness(spec) = folder::read(&args.folder)?.sweep {
        return robustness(args, &spec, talk).await;
    }
    let status = read(&args.folder).await?;
    if args.json {
        talk.json(&status)?;
    } else {
        talk.data(&text(&status))?;
        if status.blocks_complete >= 2 {
            talk.hint(&format!(
                "`cardiotwin sweep show {}` shows the indices so far",
                args.folder.display()
            ));
        }
    }
    Ok(Exit::Ok)
}

/// Progress of a robustness sweep.
#[derive(Debug, Serialize)]
struct RobustnessStatus {
    schema_version: u32,
    kind: &'static str,
    over: &'static str,
    /// Time at which the store was read, UTC, RFC 3339.
    as_of: String,
    coordinator_running: bool,
    patients: usize,
    /// Number of personalisations by state.
    members: BTreeMap<PatientState, u64>,
    failed: Vec<PatientStatus>,
}

async fn robustness(
    args: &StatusArgs,
    spec: &RobustnessSpec,
    talk: &Talk,
) -> Result<Exit, CliError> {
    let status = Reader::open(&args.folder).await?.status().await?;
    let found = RobustnessStatus {
        schema_version: formats::ROBUSTNESS_STATUS.version,
        kind: "robustness",
        over: spec.over.word(),
        as_of: status.as_of,
        coordinator_running: status.coordinator_running,
        patients: spec.patients.len(),
        members: status.counts,
        failed: status
            .patients
            .into_iter()
            .filter(|member| member.state == PatientState::Failed)
            .collect(),
    };
    if args.json {
        talk.json(&found)?;
        return Ok(Exit::Ok);
    }
    let ending = ending(&found.members, found.coordinator_running, &found.as_of);
    let patients = count(found.patients, "patient");
    let line = format!(
        "robustness, {}: {patients}; personalisations: {ending}",
        found.over
    );
    talk.data(&(failures(&found.failed) + &line))?;
    let folder = args.folder.display();
    talk.hint(&format!(
        "`cardiotwin sweep show {folder}` shows the tables so far, `cardiotwin status {folder}` each member"
    ));
    Ok(Exit::Ok)
}

async fn read(folder: &Path) -> Result<SweepStatus, CliError> {
    let file = folder::read(folder)?;
    let kind = file.sweep.kind();
    let spec = spec::of(file)?;
    let reader = Reader::open(folder).await?;
    let status = reader.status().await?;
    let members = reader.members().await?;
    let complete = members.iter().take_while(|member| member.task.is_some());
    let blocks_complete = complete
        .filter_map(|member| chunks::blocks(&member.plan))
        .map(|b| b.end)
        .max()
        .unwrap_or(0);
    Ok(SweepStatus {
        schema_version: formats::SENSITIVITY_STATUS.version,
        kind,
        as_of: status.as_of,
        coordinator_running: status.coordinator_running,
        blocks: spec.n_blocks,
        blocks_complete,
        samples_complete: u64::from(blocks_complete)
            * (2 * spec.design.parameters.len() as u64 + 2),
        chunks: status.counts,
        failed: status
            .patients
            .into_iter()
            .filter(|member| member.state == PatientState::Failed)
            .collect(),
    })
}

fn text(status: &SweepStatus) -> String {
    let ending = ending(&status.chunks, status.coordinator_running, &status.as_of);
    let line = format!(
        "{}: {} of {} blocks complete ({} samples); chunks: {ending}",
        status.kind, status.blocks_complete, status.blocks, status.samples_complete,
    );
    failures(&status.failed) + &line
}

/// Text with one line per failed member.
fn failures(failed: &[PatientStatus]) -> String {
    let line = |member: &PatientStatus| {
        let class = member.failure_class.map_or("", |class| class.as_str());
        format!("{}  failed [{class}] {}\n", member.patient, member.note)
    };
    failed.iter().map(line).collect()
}

/// Members by state, whether a coordinator is running, and the time of reading.
fn ending(counts: &BTreeMap<PatientState, u64>, coordinator_running: bool, as_of: &str) -> String {
    let counts: Vec<String> = counts
        .iter()
        .filter(|(_, n)| **n > 0)
        .map(|(state, n)| format!("{n} {state}"))
        .collect();
    let coordinator = if coordinator_running {
        "a coordinator is running"
    } else {
        "no coordinator is running"
    };
    format!("{}; {coordinator}; as of {as_of}\n", counts.join(", "))
}
